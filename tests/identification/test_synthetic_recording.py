import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mirte_drake.angles import rotation
from mirte_drake.control.excitation import ExcitationConfig, excitation
from mirte_drake.identification.csv_file import save_csv
from mirte_drake.identification.model_structure import model_structure
from mirte_drake.identification.one_step_bound import one_step_error
from mirte_drake.identification.recorded_run import load_recorded_run
from mirte_drake.identification.synthetic_recording import (
    VELOCITY_QUANTA,
    SyntheticRecordingConfig,
    recording_of,
    synthetic_recording,
)
from mirte_drake.model.candidate_library import CandidateLibrary, parse_term
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel

KINEMATIC, EXTENDED = load_model("kinematic"), load_model("extended_kinematic")
SHORT = ExcitationConfig(duration=20.0, random_duration=10.0)
EXACT = SyntheticRecordingConfig(excitation=SHORT, quantised=False)
QUANTISED = SyntheticRecordingConfig(excitation=SHORT)

# A robot with the identified lag of the body velocity: vx' = (0.01 u1 - vx) / 0.3, and so on.
LAGGED = SparseModel(
    "lagged",
    ["x", "y", "theta", "vx", "vy", "omega"],
    ["u1", "u2", "u3", "u4"],
    {
        "x": {"cos(theta)*vx": 1.0, "sin(theta)*vy": -1.0},
        "y": {"sin(theta)*vx": 1.0, "cos(theta)*vy": 1.0},
        "theta": {"omega": 1.0},
        "vx": {"u1": 0.01 / 0.3, "vx": -1 / 0.3},
        "vy": {"u2": 0.005 / 0.3, "vy": -1 / 0.3},
        "omega": {"u3": 0.02 / 0.3, "omega": -1 / 0.3},
    },
)


def test_driven_by_algorithm_1_at_10_hz():
    run = synthetic_recording(seed=3)
    np.testing.assert_array_equal(run.wheel_command, excitation(ExcitationConfig(), 3, 0.1))
    np.testing.assert_allclose(run.time, 0.1 * np.arange(1200), rtol=0, atol=1e-12)
    assert run.source == "synthetic recording of extended_kinematic, seed 3"


@pytest.mark.parametrize("model", [KINEMATIC, EXTENDED, LAGGED], ids=lambda m: m.name)
def test_unquantised_pose_is_the_models(model):
    run = synthetic_recording(model, EXACT)
    states = model.roll_out(np.zeros(model.num_states), run.wheel_command[:-1], 0.1)
    # Within a sample the body velocity of an identified model varies with its heading, that of
    # the lagged one with time: arcs of the mean velocity are off by 0.2 and 1.6 mm in the end.
    np.testing.assert_allclose(run.pose, states[:, :3], rtol=0, atol=2e-3)
    np.testing.assert_allclose(run.pose[:, 2], states[:, 2], rtol=0, atol=1e-4)


def test_velocity_is_the_mean_over_the_sample_before_the_row():
    step = np.array([[50.0, 0, 0, 0]] * 4)
    run = recording_of(LAGGED, step, EXACT)
    # v(t) = 0.5 (1 - exp(-t / 0.3)); its mean from t - 0.1 to t.
    t = 0.1 * np.arange(1, 4)
    travelled = 0.5 * (t + 0.3 * np.exp(-t / 0.3))
    expected = np.diff(np.concatenate([[0.15], travelled])) / 0.1
    np.testing.assert_allclose(run.body_velocity[1:, 0], expected, rtol=1e-4)
    np.testing.assert_array_equal(run.body_velocity[0], np.zeros(3))
    np.testing.assert_allclose(run.pose[1:, 0], travelled - 0.15, rtol=1e-4)


def test_command_of_a_row_acts_after_it():
    commands = np.zeros((5, 4))
    commands[2] = 50.0
    run = recording_of(KINEMATIC, commands, EXACT)
    moves = np.any(np.abs(run.body_velocity) > 0.01, axis=1)
    np.testing.assert_array_equal(moves, [False, False, False, True, False])


def test_quantised_velocity_is_whole_quanta():
    quanta = synthetic_recording(EXTENDED, QUANTISED).body_velocity / VELOCITY_QUANTA
    np.testing.assert_allclose(quanta, np.round(quanta), rtol=0, atol=1e-6)


def test_quanta_belong_to_the_distance_not_to_the_period():
    run = synthetic_recording(EXTENDED, dc.replace(QUANTISED, period=0.05))
    quanta = run.body_velocity / (2 * VELOCITY_QUANTA)
    np.testing.assert_allclose(quanta, np.round(quanta), rtol=0, atol=1e-6)


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 1000))
def test_quantisation_loses_nothing_on_the_way(seed):
    exact = synthetic_recording(EXTENDED, EXACT, seed=seed).body_velocity
    quantised = synthetic_recording(EXTENDED, QUANTISED, seed=seed).body_velocity
    behind = np.abs(np.cumsum(quantised - exact, axis=0))
    assert np.all(behind <= 0.5 * VELOCITY_QUANTA * (1 + 1e-6))
    assert np.all(np.abs(quantised - exact) <= VELOCITY_QUANTA * (1 + 1e-6))


@pytest.mark.parametrize("config", [EXACT, QUANTISED], ids=["exact", "quantised"])
def test_pose_integrates_the_velocity(config):
    noisy = dc.replace(config, velocity_noise=np.array([0.02, 0.02, 0.05]))
    run = synthetic_recording(EXTENDED, noisy)
    v, middle = run.body_velocity[1:], (run.pose[1:, 2] + run.pose[:-1, 2]) / 2
    np.testing.assert_allclose(np.diff(run.pose[:, 2]), 0.1 * v[:, 2], rtol=0, atol=1e-12)
    moved = 0.1 * np.einsum("kij,kj->ki", rotation(middle), v)
    np.testing.assert_allclose(np.diff(run.pose[:, :2], axis=0), moved[:, :2], rtol=0, atol=2e-4)


def test_noise_is_seeded_and_of_the_given_size():
    noise = np.array([0.02, 0.01, 0.05])
    exact = recording_of(LAGGED, excitation(ExcitationConfig(), 0, 0.1), EXACT)
    config = dc.replace(EXACT, velocity_noise=noise)
    runs = [recording_of(LAGGED, exact.wheel_command, config, seed=s) for s in (7, 7, 8)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]
    added = (runs[0].body_velocity - exact.body_velocity)[1:]
    np.testing.assert_allclose(added.std(axis=0), noise, rtol=0.1)  # Standard error 2 %.
    np.testing.assert_allclose(added.mean(axis=0) / noise, 0.0, atol=0.12)  # 0.03.
    correlation = np.corrcoef(added.T) - np.eye(3)
    assert np.all(np.abs(correlation) < 0.12)


def test_noise_is_the_disturbance_of_the_tube():
    noise = np.array([0.02, 0.01, 0.05])
    run = synthetic_recording(EXTENDED, dc.replace(EXACT, velocity_noise=noise))
    w = one_step_error(EXTENDED, run)
    np.testing.assert_allclose(w.std(axis=0), noise, rtol=0.15)  # Standard error 5 %.
    correlation = [np.corrcoef(column[:-1], column[1:])[0, 1] for column in w.T]
    assert np.all(np.abs(correlation) < 0.3)  # Standard error 0.07.


@pytest.mark.parametrize("kind", ["kinematic", "extended_kinematic"])
def test_excitation_makes_the_libraries_full_rank(kind):
    run = synthetic_recording(EXTENDED)
    names = ("x", "y", "theta", "u1", "u2", "u3", "u4")
    samples = np.hstack([run.pose, run.wheel_command])
    for state, candidates in model_structure(kind).candidates.items():
        library = CandidateLibrary(names, [parse_term(c, names) for c in candidates])
        matrix = library.evaluate(samples)
        matrix = matrix / np.linalg.norm(matrix, axis=0)
        assert np.linalg.matrix_rank(matrix) == len(candidates), state
        assert np.linalg.cond(matrix) < 100, state


def test_each_axis_is_excited():
    spread = synthetic_recording(EXTENDED).body_velocity.std(axis=0)
    recorded = np.array([0.19, 0.065, 0.75])  # Of the thesis's training data.
    assert np.all(spread > 0.5 * recorded)


def test_recording_passes_the_checks_of_a_real_one(tmp_path):
    run = synthetic_recording(seed=1)
    save_csv(run, tmp_path / "synthetic.csv")
    loaded = load_recorded_run(tmp_path / "synthetic.csv")
    np.testing.assert_allclose(loaded.pose, run.pose, rtol=0, atol=1e-6)
    np.testing.assert_allclose(loaded.wheel_command, run.wheel_command, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0.0}, "period: "),
        ({"velocity_noise": -np.ones(3)}, "velocity_noise: "),
        ({"velocity_noise": np.ones(2)}, "velocity_noise: "),
        ({"excitation": ExcitationConfig(max_change=0.0)}, "max_change: "),
    ],
)
def test_rejects_bad_config(change, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        synthetic_recording(EXTENDED, dc.replace(QUANTISED, **change))


@pytest.mark.parametrize("shape", [(10, 3), (1, 4), (0, 4), (4,)])
def test_rejects_commands_of_the_wrong_shape(shape):
    with pytest.raises(ValueError, match=r"^wheel_command: "):
        recording_of(EXTENDED, np.ones(shape), EXACT)
