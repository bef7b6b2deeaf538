import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from mirte_drake.angles import rotation
from mirte_drake.geometry import wheel_speeds
from mirte_drake.identification.recorded_run import load_recorded_run
from mirte_drake.robots.odometry_sensor import (
    AddOdometrySensor,
    OdometrySensor,
    OdometrySensorConfig,
    body_increment,
    encoder_ticks,
    next_pose,
    tick_age,
)

START = np.array([1.0, -2.0, 0.5])
TICK = 2 * np.pi / 1320  # [rad]
# One tick of one wheel: R TICK / 4, and that over a + b = 0.225 m.
STEP = np.array([6.06898581e-05, 6.06898581e-05, 2.69732703e-04])
PORTS = ("pose", "body_velocity")


class Wheels(LeafSystem):
    """Wheel angles as a function of time, without feedthrough as a robot's."""

    def __init__(self, angles) -> None:
        super().__init__()
        self._angles = angles
        self.DeclareVectorOutputPort("wheel_angles", 4, self._calc, {self.time_ticket()})

    def _calc(self, context, output):
        output.SetFromVector(self._angles(context.get_time()))


class Controller(LeafSystem):
    """Keeps what it saw at its samples, as the NMPC does: by unrestricted updates."""

    def __init__(self) -> None:
        super().__init__()
        self._input = self.DeclareVectorInputPort("pose", 3)
        self.seen = self.DeclareDiscreteState(3)
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.1, 0.0, self._update)

    def _update(self, context, state):
        state.get_mutable_discrete_state(int(self.seen)).SetFromVector(self._input.Eval(context))


def make_dut(*, seed=0, start=START, **config) -> OdometrySensor:
    return OdometrySensor(OdometrySensorConfig(**config), start=start, seed=seed)


def turning(rate):
    """Wheels that turn at constant rates (4,) [rad/s]."""
    return lambda time: time * np.asarray(rate)


def accelerating(time):
    return np.array([3.0, -1.0, 2.0, 4.0]) * time**2


def driven(angles, *, seed=0, start=START, **config) -> Simulator:
    """A sensor on wheels, its outputs exported."""
    builder = DiagramBuilder()
    wheels = builder.AddSystem(Wheels(angles))
    dut = builder.AddNamedSystem("dut", make_dut(seed=seed, start=start, **config))
    builder.Connect(wheels.get_output_port(), dut.get_input_port())
    for port in PORTS:
        builder.ExportOutput(dut.GetOutputPort(port), port)
    return Simulator(builder.Build())


def read(simulator, port) -> np.ndarray:
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


def at(simulator, times, port="pose") -> np.ndarray:
    """An output at increasing times; at an instant of sampling, before its update."""
    rows = []
    for time in times:
        simulator.AdvanceTo(time)
        rows.append(read(simulator, port))
    return np.array(rows)


def samples(angles, count, port="pose", **config) -> np.ndarray:
    return at(driven(angles, **config), 0.1 * np.arange(count), port)


def port_names(system):
    inputs = [system.get_input_port(i) for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i) for i in range(system.num_output_ports())]
    return {p.get_name(): p.size() for p in inputs}, {p.get_name(): p.size() for p in outputs}


def test_ports():
    assert port_names(make_dut()) == ({"wheel_angles": 4}, {"pose": 3, "body_velocity": 3})


@pytest.mark.parametrize(("latency", "feedthrough"), [(0.0, True), (0.03, False), (0.1, False)])
def test_feedthrough_without_latency_only(latency, feedthrough):
    dut = make_dut(latency=latency)
    for port in PORTS:
        assert dut.HasDirectFeedthrough(0, dut.GetOutputPort(port).get_index()) == feedthrough


# Ticks and increments.


def test_ticks_are_counted_at_their_edges():
    angles = TICK * np.array([0.49, 0.51, -0.49, -0.51, 1.49, 1319.9])
    np.testing.assert_array_equal(encoder_ticks(angles, 1320), [0, 1, 0, -1, 1, 1320])


@pytest.mark.parametrize("seed", range(3))
def test_counting_is_off_by_half_a_tick_at_most(seed):
    angles = np.random.default_rng(seed).uniform(-1e3, 1e3, (1000, 4))
    assert np.all(np.abs(TICK * encoder_ticks(angles, 1320) - angles) <= TICK / 2 + 1e-12)


def test_one_tick_gives_the_quanta_of_the_recordings():
    quanta = np.abs(body_increment(np.array([0.0, 0.0, 1.0, 0.0]), OdometrySensorConfig()))
    np.testing.assert_allclose(quanta, STEP, rtol=1e-8)
    velocity = quanta / OdometrySensorConfig().period
    np.testing.assert_allclose(velocity, [0.000607, 0.000607, 0.00270], rtol=1e-3)


@pytest.mark.parametrize(
    ("ticks", "increment"),
    [
        ([100, 100, 100, 100], [400, 0, 0]),
        ([-100, 100, -100, 100], [0, 400, 0]),
        ([-100, 100, 100, -100], [0, 0, 400]),
        ([100, 0, 0, 0], [100, -100, -100]),
        ([100, -100, 0, 0], [0, -200, -200]),
        ([1, 1, -1, -1], [0, 0, 0]),  # Only slip can do this.
    ],
)
def test_increments_by_hand(ticks, increment):
    actual = body_increment(np.array(ticks), OdometrySensorConfig())
    np.testing.assert_allclose(actual, increment * STEP, rtol=1e-8, atol=1e-15)


def test_a_believed_radius_scales_every_increment():
    ticks = np.array([10.0, -20.0, 35.0, 4.0])
    small = body_increment(ticks, OdometrySensorConfig(wheel_radius=0.0255))
    np.testing.assert_allclose(2 * small, body_increment(ticks, OdometrySensorConfig()))


def test_an_increment_is_turned_by_the_yaw_at_its_end():
    pose = next_pose(np.array([1.0, 2.0, np.pi / 4]), np.array([0.1, 0.02, np.pi / 4]))
    np.testing.assert_allclose(pose, [1.0 - 0.02, 2.0 + 0.1, np.pi / 2])


@pytest.mark.parametrize("name", ["training_data", "validation_const_rect", "validation_turn_rect"])
def test_the_recordings_are_made_of_whole_ticks(recordings, name):
    """Of 1320 a turn, integrated as here; x, y and yaw all even or all odd, as of four wheels."""
    pose = load_recorded_run(recordings / f"{name}.csv").pose
    quanta = np.abs(body_increment(np.array([1.0, 0.0, 0.0, 0.0]), OdometrySensorConfig()))
    moved = np.einsum("nji,nj->ni", rotation(pose[1:, 2]), np.diff(pose, axis=0)) / quanta
    whole = np.round(moved)
    # The validation files have nine decimals. Where the recorder missed a reading of the training
    # run, two increments are turned as one.
    assert np.count_nonzero(np.abs(moved - whole).max(axis=1) > 1e-4) <= 1
    assert np.all(whole % 2 == whole[:, :1] % 2)


# Drives.


def test_straight_drive_by_hand():
    # 0.2 m/s: 0.02 m in a sample are 82.385 ticks a wheel.
    angles = turning(wheel_speeds(np.array([0.2, 0.0, 0.0])))
    forward = 4 * STEP[0] * np.array([0, 82, 165, 247, 330, 412])
    pose = samples(angles, 6)
    np.testing.assert_allclose(pose[:, 0], START[0] + np.cos(0.5) * forward, rtol=1e-7)
    np.testing.assert_allclose(pose[:, 1], START[1] + np.sin(0.5) * forward, rtol=1e-7)
    np.testing.assert_allclose(pose[:, 2], 0.5, rtol=1e-14)
    velocity = samples(angles, 6, "body_velocity")
    expected = [0, *np.diff(forward) / 0.1]
    np.testing.assert_allclose(velocity[:, 0], expected, rtol=1e-7, atol=1e-15)
    np.testing.assert_allclose(velocity[:, 1:], 0.0, atol=1e-14)


def test_lateral_drive_by_hand():
    # -0.1 m/s to the left: the wheels count 41.19 ticks a sample, 41 and 82.
    angles = turning(wheel_speeds(np.array([0.0, -0.1, 0.0])))
    left = -4 * STEP[1] * np.array([0, 41, 82])
    pose = samples(angles, 3, start=np.zeros(3))
    np.testing.assert_allclose(pose, np.outer(left, [0, 1, 0]), rtol=1e-7, atol=1e-15)


def test_rotation_by_hand():
    # 0.9 rad/s: 0.09 rad in a sample are 83.416 ticks a wheel, 83 and 166 (166.83: 167).
    angles = turning(wheel_speeds(np.array([0.0, 0.0, 0.9])))
    pose = samples(angles, 3)
    yaw = 4 * STEP[2] * np.array([0, 83, 167])
    np.testing.assert_allclose(pose[:, 2], 0.5 + yaw, rtol=1e-8)
    np.testing.assert_allclose(pose[:, :2], np.tile(START[:2], (3, 1)), rtol=1e-12)


@pytest.mark.parametrize("turns", [4, -4])
def test_yaw_is_unwrapped_over_several_turns(turns):
    rate = turns * 2 * np.pi / 20
    yaw = samples(turning(wheel_speeds(np.array([0.0, 0.0, rate]))), 201)[:, 2]
    np.testing.assert_allclose(yaw, 0.5 + rate * 0.1 * np.arange(201), atol=2 * STEP[2] + 1e-12)


def test_a_circle_ends_where_it_began():
    # Radius 0.4 m in 20 s. A wrong half tick a wheel turns and moves by at most two steps, and
    # a turn of the whole circle by that moves no end.
    angles = turning(wheel_speeds(np.array([2 * np.pi * 0.4 / 20, 0.0, 2 * np.pi / 20])))
    pose = samples(angles, 201)
    diameter = np.linalg.norm(pose[100, :2] - START[:2])
    assert diameter == pytest.approx(0.8, abs=1e-3)
    np.testing.assert_allclose(pose[200, 2] - START[2], 2 * np.pi, atol=2 * STEP[2])
    # Yaw errs by two steps at most on the way, which bends the path of 2.5 m.
    assert np.linalg.norm(pose[200, :2] - START[:2]) < 2 * np.pi * 0.4 * 2 * STEP[2] + 2 * STEP[0]


@pytest.mark.parametrize("seed", range(3))
def test_no_tick_is_lost(seed):
    """Coarse ticks err by half of one per wheel, however long and to and fro they are counted."""
    amplitude, frequency = np.random.default_rng(seed).uniform(1, 5, (2, 2))

    def angles(time):  # Straight and lateral only: without turns, increments just add up.
        x, y = amplitude * np.sin(frequency * time)
        return np.array([x - y, x + y, x - y, x + y])

    fine, coarse = (
        samples(angles, 200, ticks_per_revolution=n, start=np.zeros(3)) for n in (10**9, 48)
    )
    errors = np.abs(fine - coarse)[:, :2]
    assert np.all(errors <= 2 * STEP[0] * 1320 / 48 + 1e-9)
    assert errors.max() > STEP[0] * 1320 / 48


# Time.


def test_a_controller_sees_the_reading_of_its_instant():
    builder = DiagramBuilder()
    wheels = builder.AddSystem(Wheels(accelerating))
    controller = builder.AddSystem(Controller())  # Before the sensor, and not by its order.
    dut = AddOdometrySensor(builder, OdometrySensorConfig(), start=START)
    builder.Connect(wheels.get_output_port(), dut.get_input_port())
    builder.Connect(dut.GetOutputPort("pose"), controller.get_input_port())
    simulator = Simulator(builder.Build())
    expected = START
    for k in range(6):
        if k:
            moved = encoder_ticks(accelerating(0.1 * k), 1320)
            moved = moved - encoder_ticks(accelerating(0.1 * (k - 1)), 1320)
            expected = next_pose(expected, body_increment(moved, OdometrySensorConfig()))
        simulator.AdvanceTo(0.1 * k + 0.05)
        context = controller.GetMyContextFromRoot(simulator.get_context())
        seen = context.get_discrete_state(int(controller.seen)).value()
        np.testing.assert_allclose(seen, expected, rtol=1e-12)


def test_outputs_are_held_between_readings_and_through_the_update():
    simulator = driven(accelerating)
    for k in range(1, 6):
        simulator.AdvanceTo(0.1 * k)
        before = [read(simulator, port) for port in PORTS]
        simulator.AdvancePendingEvents()
        for time in (0.1 * k, 0.1 * k + 0.05, 0.1 * k + 0.0999):
            simulator.AdvanceTo(time)
            for port, value in zip(PORTS, before, strict=True):
                np.testing.assert_array_equal(read(simulator, port), value)


@pytest.mark.parametrize("latency", [0.001, 0.03, 0.1, 0.14, 0.3, 0.999])
def test_a_controller_sees_the_pose_of_exactly_the_latency_ago(latency):
    fine = {"ticks_per_revolution": 10**9, "start": np.zeros(3)}
    angles = turning(wheel_speeds(np.array([0.3, 0.1, 0.0])))
    times = 0.1 * np.arange(21)
    pose = at(driven(angles, latency=latency, **fine), times)
    ago = np.maximum(times - latency, 0.0)
    np.testing.assert_allclose(pose, np.outer(ago, [0.3, 0.1, 0.0]), atol=1e-9)


def test_whole_periods_of_latency_shift_the_readings():
    late = samples(accelerating, 12, latency=0.3)
    np.testing.assert_array_equal(late[3:], samples(accelerating, 9))
    np.testing.assert_array_equal(late[:3], np.tile(START, (3, 1)))
    velocity = samples(accelerating, 12, "body_velocity", latency=0.3)
    np.testing.assert_array_equal(velocity[3:], samples(accelerating, 9, "body_velocity"))


def test_a_reading_arrives_at_the_period_not_before():
    simulator = driven(turning(np.ones(4)), latency=0.03, start=np.zeros(3))
    seen = at(simulator, [0.069, 0.071, 0.0999, 0.1, 0.169, 0.171, 0.1999, 0.2])[:, 0]
    assert np.all(seen[:3] == 0) and np.all(seen[3:7] == seen[3]) and seen[7] > seen[3] > 0


def test_a_run_may_begin_at_any_time():
    late = driven(lambda time: accelerating(time - 5.0))
    late.get_mutable_context().SetTime(5.0)
    np.testing.assert_allclose(
        at(late, 5.0 + 0.1 * np.arange(6)), samples(accelerating, 6), rtol=1e-12
    )


# Jitter.


def test_age_is_uniform_and_depends_on_seed_and_number_alone():
    ages = np.array([tick_age(0.02, 3, k) for k in range(1000)])
    counts = np.histogram(ages, bins=10, range=(0.0, 0.02))[0]
    assert counts.sum() == 1000 and np.all(np.abs(counts - 100) < 40)  # Deviation 9.5.
    assert abs(np.corrcoef(ages[:-1], ages[1:])[0, 1]) < 0.13  # Standard error 0.032.
    assert tick_age(0.02, 3, 7) == ages[7] != tick_age(0.02, 4, 7)


def test_jittered_ticks_are_those_of_their_age():
    fine = {"ticks_per_revolution": 10**9, "start": np.zeros(3)}
    pose = samples(
        turning(wheel_speeds(np.array([0.3, 0.0, 0.0]))), 20, seed=5, jitter=0.02, **fine
    )
    ages = np.array([tick_age(0.02, 5, k) for k in range(1, 20)])
    np.testing.assert_allclose(pose[1:, 0], 0.3 * (0.1 * np.arange(1, 20) - ages), atol=1e-9)


def test_velocity_of_jittered_ticks_is_over_the_nominal_period():
    config = {"seed": 5, "jitter": 0.02, "start": np.zeros(3)}
    angles = turning(wheel_speeds(np.array([0.3, 0.0, 0.0])))
    pose, velocity = (samples(angles, 20, port, **config) for port in PORTS)
    np.testing.assert_allclose(velocity[1:], np.diff(pose, axis=0) / 0.1, atol=1e-12)
    assert 0.01 < velocity[2:, 0].std() / 0.3 < 0.2  # 8 % expected.
    quanta = velocity[:, 0] * 0.1 / STEP[0]
    np.testing.assert_allclose(quanta, np.round(quanta), atol=1e-6)


def test_jitter_is_bit_identical_between_runs_and_differs_by_seed():
    first, again, other = (
        samples(accelerating, 20, seed=seed, jitter=0.02, latency=0.03) for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(first, again)
    assert np.all(first[2:, 0] != other[2:, 0])


def test_seed_can_be_changed_in_a_context():
    simulator = driven(accelerating, seed=7, jitter=0.02)
    dut = simulator.get_system().GetSubsystemByName("dut")
    context = dut.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, 8.0)
    expected = samples(accelerating, 10, seed=8, jitter=0.02)
    np.testing.assert_array_equal(at(simulator, 0.1 * np.arange(10)), expected)


# House rules.


def test_interleaved_simulators_do_not_disturb_each_other():
    alone = samples(accelerating, 10, jitter=0.02, latency=0.14)
    first = driven(accelerating, jitter=0.02, latency=0.14)
    second = Simulator(first.get_system())
    for k in range(10):
        np.testing.assert_array_equal(at(first, [0.1 * k])[0], alone[k])
        if k % 2 == 0:
            np.testing.assert_array_equal(at(second, [0.05 * k])[0], alone[k // 2])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("ticks_per_revolution", 0),
        ("period", 0.0),
        ("period", np.inf),
        ("latency", -0.1),
        ("latency", np.nan),
        ("jitter", -0.001),
        ("jitter", 0.2),
        ("wheel_radius", 0.0),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


@pytest.mark.parametrize(
    ("argument", "value"), [("start", np.ones(2)), ("start", np.full(3, np.nan)), ("seed", -1)]
)
def test_rejects_bad_arguments(argument, value):
    with pytest.raises(ValueError, match=f"^{argument}: "):
        make_dut(**{argument: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddOdometrySensor(builder, OdometrySensorConfig(), start=START, name="odometry")
    assert isinstance(dut, OdometrySensor)
    assert builder.Build().GetSubsystemByName("odometry") is dut
