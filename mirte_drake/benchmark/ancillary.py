"""What the ancillary law costs: linearisation, Riccati equation and its checks."""

import time
from collections.abc import Sequence

import numpy as np

from mirte_drake.benchmark.measure import collection_off
from mirte_drake.benchmark.problems import Sample
from mirte_drake.control.dlqr import design_dlqr
from mirte_drake.scenario import Scenario, load_prediction_model
from mirte_drake.systems.ancillary_dlqr import AncillaryDlqrConfig


def time_designs(scenario: Scenario, samples: Sequence[Sample], repeats: int) -> np.ndarray:
    """Returns the time (repeats times samples,) [s] of the DLQR designs along a run.

    Args:
        scenario: Its weights are used, or the default ones where it has no ancillary law.
        samples: Of the run; each plan's first state and input is linearised at.
        repeats: Rounds over the run.
    """
    weights = scenario.ancillary_dlqr or AncillaryDlqrConfig()
    Q, R = np.diag(weights.state_weight), np.diag(weights.input_weight)
    model, times = load_prediction_model(scenario), []
    with collection_off():
        for sample in [*samples] * repeats:
            x, u = sample.plan.nominal_state, sample.plan.nominal_input
            start = time.perf_counter()
            design_dlqr(model, x, u, scenario.period, Q, R)
            times.append(time.perf_counter() - start)
    return np.array(times)
