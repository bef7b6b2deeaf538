import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.campaign import store
from mirte_drake.campaign.outcome import Failure, run_outcome
from mirte_drake.campaign.store import load_result, save_result, scenario_key
from mirte_drake.errors import UserError
from mirte_drake.model.model_file import load_model_file, save_model_file
from mirte_drake.scenario_file import load_scenario

SCENARIO = load_scenario("rectangle", ["duration=0.5"])


def test_what_was_saved_is_what_is_loaded(tmp_path):
    shown = run_outcome(SCENARIO)
    for result in (shown, dc.replace(shown, true_x_m=np.inf), Failure("no robot: gone")):
        save_result(result, tmp_path, "key")
        assert load_result(tmp_path, "key") == result
    assert [path.name for path in tmp_path.iterdir()] == ["key.json"]


@pytest.mark.parametrize(
    "text", ["", "{", "null", "[]", "{}", '{"Outcome": {"x_m": 1}}', '{"Other": {}}', '"Failure"']
)
def test_what_is_not_whole_is_not_there(text, tmp_path):
    assert load_result(tmp_path, "key") is None
    (tmp_path / "key.json").write_text(text)
    assert load_result(tmp_path, "key") is None


def test_folder_that_cannot_be_written_is_one_clear_line():
    with pytest.raises(UserError, match=r"^/dev/null/x/key\.json: cannot be written"):
        save_result(Failure("no"), store.Path("/dev/null/x"), "key")


def test_key_is_that_of_all_that_counts():
    key = scenario_key(SCENARIO)
    assert scenario_key(load_scenario("rectangle", ["duration=0.5"])) == key
    assert scenario_key(dc.replace(SCENARIO, description="in other words")) == key
    assert scenario_key(dc.replace(SCENARIO, seed=1)) == key  # Which the file's name has.
    assert scenario_key(dc.replace(SCENARIO, input_limit=50.0)) != key
    assert scenario_key(dc.replace(SCENARIO, tube_updater=None)) != key


def test_key_changes_with_a_file_that_the_scenario_names(tmp_path):
    file = tmp_path / "mine.yaml"
    save_model_file(load_model_file("extended_kinematic"), file)
    scenario = load_scenario("rectangle", [f"prediction_model={file}"])
    key = scenario_key(scenario)
    assert scenario_key(scenario) == key
    file.write_text(file.read_text() + "# Another one.\n")
    assert scenario_key(scenario) != key


def test_key_changes_with_versions(monkeypatch):
    key = scenario_key(SCENARIO)
    store._program.cache_clear()
    monkeypatch.setattr(store, "versions", lambda: {"drake": "0.1"})
    assert scenario_key(SCENARIO) != key
    store._program.cache_clear()
