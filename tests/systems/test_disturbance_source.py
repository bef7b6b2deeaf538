import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import port_table

from mirte_drake.errors import UserError
from mirte_drake.systems.disturbance_source import (
    AddDisturbanceSource,
    ConstantDisturbance,
    CornerDisturbance,
    DisturbanceSource,
    NoDisturbance,
    RecordedDisturbance,
    UniformDisturbance,
    disturbance_sample,
)

BOUND = np.array([0.04, 0.03, 0.09])


def make_dut(config=None, *, seed=0) -> DisturbanceSource:
    return DisturbanceSource(config or UniformDisturbance(), period=0.1, seed=seed)


def samples(dut, count, simulator=None, first=0) -> np.ndarray:
    simulator = simulator or Simulator(dut)
    rows = []
    for k in range(first, first + count):
        simulator.AdvanceTo(0.1 * k + 0.05)
        rows.append(dut.GetOutputPort("disturbance").Eval(simulator.get_context()))
    return np.array(rows)


def drawn(config, count, seed=0) -> np.ndarray:
    return np.array([disturbance_sample(config, seed, k) for k in range(count)])


def test_ports():
    assert port_table(make_dut()) == ({}, {"disturbance": 3})


def test_uniform_fills_the_box_evenly():
    scaled = drawn(UniformDisturbance(), 2000) / BOUND
    assert np.all(np.abs(scaled) <= 1.0)
    counts = np.array([np.histogram(column, bins=10, range=(-1, 1))[0] for column in scaled.T])
    # 200 expected per bin, standard deviation 13.
    assert np.all(np.abs(counts - 200) < 60)
    np.testing.assert_allclose(scaled.mean(axis=0), 0.0, atol=0.06)  # Standard error 0.013.
    np.testing.assert_allclose(scaled.std(axis=0), 1 / np.sqrt(3), atol=0.03)


def test_uniform_samples_are_independent():
    scaled = drawn(UniformDisturbance(), 2000) / BOUND
    between_components = np.corrcoef(scaled.T) - np.eye(3)
    along_time = [np.corrcoef(column[:-1], column[1:])[0, 1] for column in scaled.T]
    assert np.all(np.abs(between_components) < 0.1)  # Standard error 0.022.
    assert np.all(np.abs(along_time) < 0.1)


def test_corner_samples_lie_on_the_corners_all_of_them():
    signs = drawn(CornerDisturbance(), 400) / BOUND
    np.testing.assert_array_equal(np.abs(signs), np.ones((400, 3)))
    corners, counts = np.unique(signs, axis=0, return_counts=True)
    assert len(corners) == 8
    assert np.all(counts > 25)  # 50 expected, standard deviation 6.6.


def test_constant_is_the_same_all_the_time():
    value = np.array([0.01, -0.02, 0.3])
    np.testing.assert_array_equal(samples(make_dut(ConstantDisturbance(value)), 5), [value] * 5)


def test_none_is_zero():
    np.testing.assert_array_equal(samples(make_dut(NoDisturbance()), 5), np.zeros((5, 3)))


def test_zero_bound_is_zero():
    np.testing.assert_array_equal(drawn(UniformDisturbance(np.zeros(3)), 5), np.zeros((5, 3)))


def test_system_gives_sample_k_from_time_k_on():
    dut = make_dut(CornerDisturbance(), seed=7)
    np.testing.assert_array_equal(samples(dut, 100), drawn(CornerDisturbance(), 100, seed=7))


def test_disturbance_is_held_over_a_sample():
    dut = make_dut()
    simulator = Simulator(dut)
    seen = []
    for time in (0.01, 0.05, 0.099, 0.101, 0.199):
        simulator.AdvanceTo(time)
        seen.append(dut.GetOutputPort("disturbance").Eval(simulator.get_context()))
    np.testing.assert_array_equal(seen[0], seen[1])
    np.testing.assert_array_equal(seen[0], seen[2])
    assert np.all(seen[2] != seen[3])
    np.testing.assert_array_equal(seen[3], seen[4])


def test_same_seed_gives_the_same_sequence():
    np.testing.assert_array_equal(samples(make_dut(seed=3), 10), samples(make_dut(seed=3), 10))


def test_another_seed_gives_another_sequence():
    assert np.all(samples(make_dut(seed=3), 10) != samples(make_dut(seed=4), 10))


def test_largest_seed_of_a_scenario_works():
    assert np.all(np.abs(samples(make_dut(seed=2**53), 3)) <= BOUND)


def test_seed_can_be_changed_in_a_context():
    dut = make_dut(seed=3)
    simulator = Simulator(dut)
    simulator.get_mutable_context().get_mutable_numeric_parameter(0).SetAtIndex(0, 4.0)
    np.testing.assert_array_equal(samples(dut, 10, simulator), samples(make_dut(seed=4), 10))
    np.testing.assert_array_equal(samples(dut, 10), samples(make_dut(seed=3), 10))


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut(seed=5)
    alone = samples(dut, 10)
    first, second = Simulator(dut), Simulator(dut)
    for k in range(10):
        np.testing.assert_array_equal(samples(dut, 1, first, k)[0], alone[k])
        if k % 2 == 0:
            np.testing.assert_array_equal(samples(dut, 1, second, k // 2)[0], alone[k // 2])


RECORDING = np.array([[0.01, 0.02, 0.03], [0.04, 0.05, 0.06], [-0.07, 0.08, 0.09]])


def test_recorded_csv_is_played_and_begins_anew(tmp_path):
    np.savetxt(tmp_path / "w.csv", RECORDING, delimiter=",")
    dut = make_dut(RecordedDisturbance(tmp_path / "w.csv"))
    np.testing.assert_allclose(samples(dut, 7), RECORDING[[0, 1, 2, 0, 1, 2, 0]], rtol=1e-15)


def test_recorded_log_is_played_and_begins_anew(tmp_path):
    np.savez(tmp_path / "log.npz", disturbance=RECORDING, time=np.arange(3))
    dut = make_dut(RecordedDisturbance(tmp_path / "log.npz"))
    np.testing.assert_array_equal(samples(dut, 4), RECORDING[[0, 1, 2, 0]])


def test_recorded_file_of_one_row_is_constant(tmp_path):
    (tmp_path / "w.csv").write_text("0.1,0.2,0.3\n")
    dut = make_dut(RecordedDisturbance(tmp_path / "w.csv"))
    np.testing.assert_array_equal(samples(dut, 2), [[0.1, 0.2, 0.3]] * 2)


BAD_FILES = {
    "empty.csv": b"",
    "header.csv": b"vx,vy,yaw_rate\n0,0,0\n",
    "two_columns.csv": b"0,0\n",
    "ragged.csv": b"0,0,0\n0,0\n",
    "nan.csv": b"0,nan,0\n",
    "binary.csv": b"\xff\xfe\x00\x01",
    "text.npz": b"hello",
    "empty.npz": b"",
    "truncated.npz": b"PK\x03\x04 and no more",
}


@pytest.mark.filterwarnings("ignore:loadtxt. input contained no data")
@pytest.mark.parametrize("name", BAD_FILES)
def test_wrong_file_is_a_user_error_that_names_it(tmp_path, name):
    (tmp_path / name).write_bytes(BAD_FILES[name])
    with pytest.raises(UserError, match=f"^file: .*{name}"):
        make_dut(RecordedDisturbance(tmp_path / name))


@pytest.mark.parametrize("name", ["none.csv", "none.npz", "folder.csv", "folder.npz"])
def test_unreadable_file_is_a_user_error_that_names_it(tmp_path, name):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(UserError, match=f"^file: .*{name}"):
        make_dut(RecordedDisturbance(tmp_path / name))


@pytest.mark.parametrize(
    "arrays",
    [
        {"pose": RECORDING},
        {"disturbance": RECORDING[:, :2]},
        {"disturbance": np.array([["a", "b", "c"]])},
        {"disturbance": np.full((2, 3), np.inf)},
    ],
    ids=["no_such_array", "two_columns", "text", "infinite"],
)
def test_wrong_log_is_a_user_error(tmp_path, arrays):
    np.savez(tmp_path / "log.npz", **arrays)
    with pytest.raises(UserError, match=r"^file: .*log\.npz"):
        make_dut(RecordedDisturbance(tmp_path / "log.npz"))


def test_single_array_named_npz_is_a_user_error(tmp_path):
    with (tmp_path / "w.npz").open("wb") as file:
        np.save(file, RECORDING)
    with pytest.raises(UserError, match=r"^file: .*w\.npz"):
        make_dut(RecordedDisturbance(tmp_path / "w.npz"))


@pytest.mark.parametrize(
    ("config", "field"),
    [
        (UniformDisturbance(np.array([0.1, -0.1, 0.1])), "bound"),
        (UniformDisturbance(np.array([0.1, np.nan, 0.1])), "bound"),
        (UniformDisturbance(np.ones(2)), "bound"),
        (CornerDisturbance(-np.ones(3)), "bound"),
        (CornerDisturbance(np.full(3, np.inf)), "bound"),
        (ConstantDisturbance(np.full(3, np.nan)), "value"),
        (ConstantDisturbance(np.ones(4)), "value"),
    ],
)
def test_rejects_bad_config(config, field):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(config)


@pytest.mark.parametrize("seed", [-1, np.nan])
def test_rejects_bad_seed(seed):
    with pytest.raises(ValueError, match=r"^seed: "):
        make_dut(seed=seed)


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddDisturbanceSource(builder, NoDisturbance(), period=0.1, name="wind")
    assert isinstance(dut, DisturbanceSource)
    assert builder.Build().GetSubsystemByName("wind") is dut
