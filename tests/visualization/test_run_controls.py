from meshcat_spy import MeshcatSpy

from mirte_drake.visualization.run_controls import (
    FASTEST,
    PAUSE,
    RESTART,
    SPEED,
    STOP,
    RunControls,
    Wish,
)


def test_controls_are_read_as_they_are_used():
    meshcat = MeshcatSpy()
    controls = RunControls(meshcat)
    assert controls.read() == Wish(speed=1.0, paused=False, restarts=0, stop=False)
    assert set(meshcat.GetButtonNames()) == {PAUSE, RESTART, STOP}
    meshcat.click(PAUSE)
    assert controls.read().paused
    meshcat.click(PAUSE)
    assert not controls.read().paused
    meshcat.click(RESTART)
    meshcat.click(RESTART)
    assert controls.read().restarts == 2
    meshcat.SetSliderValue(SPEED, 0.5)
    assert controls.read().speed == 0.5
    meshcat.SetSliderValue(SPEED, 1000.0)
    assert controls.read().speed == FASTEST
    meshcat.click(STOP)
    assert controls.read().stop
