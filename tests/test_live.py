import time

import numpy as np
import pytest
from meshcat_spy import MeshcatSpy

from mirte_drake.live import IDLE, KeptTime, watch
from mirte_drake.scenario_file import load_scenario
from mirte_drake.visualization.run_controls import PAUSE, RESTART, SPEED, STOP

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.xdist_group("wire"),
]  # In real time: one after the other.


class Hands:
    """Does something at the controls each time it is asked whether to go on."""

    def __init__(self, meshcat, *actions):
        self.meshcat, self.actions = meshcat, list(actions)
        self.times = []

    def __call__(self):
        self.times.append(time.perf_counter())
        if self.actions:
            self.actions.pop(0)(self.meshcat)
        return True


def click(name):
    return lambda meshcat: meshcat.click(name)


def nothing(_):
    pass


def run(*actions, overrides=("duration=30",)) -> tuple[KeptTime, MeshcatSpy, Hands]:
    meshcat = MeshcatSpy()
    hands = Hands(meshcat, *actions)
    pace = watch(load_scenario("rectangle", overrides), meshcat, ready=hands)
    return pace, meshcat, hands


def test_stops_when_somebody_stops_it():
    pace, meshcat, _ = run(*[nothing] * 5, click(STOP))
    assert pace.simulated == pytest.approx(6 / 30)
    assert meshcat.HasPath("/mirte/trail/measured/1")


@pytest.mark.slow
def test_keeps_the_pace_of_the_clock():
    started = time.perf_counter()
    pace, _, hands = run(*[nothing] * 30, click(STOP))
    assert pace.simulated == pytest.approx(31 / 30)
    assert pace.rate == pytest.approx(1.0, abs=0.05)
    assert time.perf_counter() - started > pace.simulated
    assert hands.times[-1] - hands.times[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_the_speed_is_the_one_that_is_wanted():
    pace, _, hands = run(
        lambda meshcat: meshcat.SetSliderValue(SPEED, 4.0), *[nothing] * 40, click(STOP)
    )
    # The first step still at speed 1.
    assert pace.simulated == pytest.approx(1 / 30 + 41 / 30 / 4)
    assert hands.times[-1] - hands.times[1] == pytest.approx(40 / 30 / 4, abs=0.1)


def test_waits_until_it_may_begin():
    meshcat, asked = MeshcatSpy(), []

    def ready():
        asked.append(meshcat.transforms["/mirte/robot"].translation()[0])
        if len(asked) == 7:
            meshcat.click(STOP)
        return len(asked) > 5

    pace = watch(load_scenario("rectangle"), meshcat, ready=ready)
    assert len(set(asked[:6])) == 1  # The robot is to be seen, at its start.
    assert asked[6] > asked[5] == -0.3
    assert pace.simulated == pytest.approx(2 / 30)


class Watching(MeshcatSpy):
    """Sees where the robot is each time the controls are read, and then uses them."""

    def __init__(self, actions):
        super().__init__()
        self.actions, self.x = actions, []

    def GetButtonClicks(self, name):
        if name == STOP:  # The last that is read.
            self.x.append(self.transforms["/mirte/robot"].translation()[0])
            if len(self.x) in self.actions:
                self.click(self.actions[len(self.x)])
        return super().GetButtonClicks(name)


def test_a_pause_takes_no_time_of_the_run():
    meshcat = Watching({10: PAUSE, 30: PAUSE, 40: STOP})
    started = time.perf_counter()
    pace = watch(load_scenario("rectangle"), meshcat)
    moving = np.diff(meshcat.x) != 0
    np.testing.assert_array_equal(np.flatnonzero(~moving), np.arange(10, 30))
    assert pace.simulated == pytest.approx(19 / 30)
    assert pace.taken < time.perf_counter() - started - 19 * IDLE


def test_waits_at_its_end_and_begins_anew():
    meshcat = Watching({20: RESTART, 40: STOP})
    pace = watch(load_scenario("rectangle", ["duration=0.2"]), meshcat)
    assert pace.simulated == pytest.approx(2 * 0.2)
    first, second = np.split(np.array(meshcat.x), [21])
    # Six steps of a third of a sample.
    assert np.all(np.diff(first[:7]) > 0) and len(set(first[6:])) == 1
    np.testing.assert_allclose(second[:6], first[1:7], atol=1e-12)
    assert second[-1] == pytest.approx(first[-1], abs=1e-12)


def test_the_rate_is_what_was_simulated_over_what_it_took():
    assert KeptTime().rate == 1.0  # Nothing yet.
    assert KeptTime(simulated=1.0, taken=2.0).rate == 0.5
