"""What numba compiles is kept: a second process compiles nothing."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from mirte_drake.compiled import compiled


def kept(folder) -> dict[str, float]:
    return {str(path): path.stat().st_mtime for path in folder.rglob("*.nb*")}


def test_compiles_where_nothing_can_be_kept(monkeypatch):
    """As in a read-only container."""
    njit, options_seen = numba.njit, []

    def without_folder(**options):
        options_seen.append(options)
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return njit(**options)

    monkeypatch.setattr(numba, "njit", without_folder)
    half = compiled(lambda x: 1.0 / x)
    assert half(2.0) == 0.5
    assert np.isinf(half(0.0))
    assert len(options_seen) == 2


@pytest.mark.slow
def test_the_second_run_compiles_nothing(tmp_path):
    cache = tmp_path / "cache"

    def simulate(output: str) -> None:
        command = ["simulate", "rectangle", "--no-plots", "--set", "duration=0.5"]
        subprocess.run(
            [sys.executable, "-m", "mirte_drake", *command, "--output", str(tmp_path / output)],
            env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
            check=True,
            capture_output=True,
        )

    simulate("first")
    first = kept(cache)
    assert len(first) > 20
    simulate("second")
    assert kept(cache) == first
