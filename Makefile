# `make demo` and `make test` set up everything they need in $(VENV) on the first call.
PYTHON ?= python3
VENV ?= .venv
SITE ?= docs/_build
BIN := $(VENV)/bin
# The controller's matrices are small: threads only get in each other's way.
export OMP_NUM_THREADS := 1

.PHONY: demo test test-slow lint docs diagrams clean

demo: $(VENV)/installed
	$(BIN)/mirte-drake simulate rectangle

test: $(VENV)/installed
	$(BIN)/python -m pytest -n auto -m "not slow"

test-slow: $(VENV)/installed
	$(BIN)/python -m pytest -n auto -m "slow and not realtime"
	$(BIN)/python -m pytest -m "slow and realtime"

lint: $(VENV)/installed
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

docs: $(VENV)/installed
	$(BIN)/python -m sphinx -W --keep-going -q docs $(SITE)
	@echo "Open $(SITE)/index.html"

# Redraws the pictures beside the scenarios.
diagrams: $(VENV)/installed
	$(BIN)/mirte-drake diagram --all

clean:
	rm -rf $(VENV) runs build dist docs/_build docs/generated .pytest_cache .mypy_cache .ruff_cache

$(VENV)/installed: pyproject.toml
	$(PYTHON) -c "import ensurepip, venv" || \
	  { echo "make: this Python cannot make virtual environments; on Debian and Ubuntu: apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	touch $@
