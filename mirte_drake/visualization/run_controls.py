"""Buttons and slider in Meshcat's page for the run as a whole."""

import dataclasses as dc

from pydrake.geometry import Meshcat

PAUSE, RESTART, STOP, SPEED = "Pause or go on", "Restart", "Stop", "Speed"
SLOWEST, FASTEST = 0.1, 4.0


@dc.dataclass(frozen=True)
class Wish:
    """What those who watch want."""

    speed: float  # Simulated time per time.
    paused: bool
    restarts: int  # How often they wanted to begin anew, so far.
    stop: bool


class RunControls:
    """Adds the controls to a page, and reads them."""

    def __init__(self, meshcat: Meshcat) -> None:
        """Adds the controls to the page of a Meshcat."""
        self._meshcat = meshcat
        meshcat.AddSlider(SPEED, min=SLOWEST, max=FASTEST, step=0.1, value=1.0)
        meshcat.AddButton(PAUSE, "Space")
        meshcat.AddButton(RESTART, "KeyR")
        meshcat.AddButton(STOP)

    def read(self) -> Wish:
        """Returns what is wanted now."""
        clicks = self._meshcat.GetButtonClicks
        return Wish(
            speed=self._meshcat.GetSliderValue(SPEED),
            paused=clicks(PAUSE) % 2 == 1,
            restarts=clicks(RESTART),
            stop=clicks(STOP) > 0,
        )
