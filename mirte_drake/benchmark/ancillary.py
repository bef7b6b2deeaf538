"""What the ancillary law costs: a DLQR design, or the inversion of the input map."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from mirte_drake.benchmark.measure import collection_off
from mirte_drake.benchmark.problems import Sample
from mirte_drake.control.dlqr import design_dlqr
from mirte_drake.model.lagged_model import LaggedModel
from mirte_drake.scenario import Scenario, load_prediction_model
from mirte_drake.systems.ancillary_dlqr import AncillaryDlqrConfig
from mirte_drake.systems.ancillary_lagged import AncillaryLagged


def time_designs(scenario: Scenario, samples: Sequence[Sample], repeats: int) -> np.ndarray:
    """Returns the time (repeats times samples,) [s] of the ancillary law's work along a run.

    Of a lagged prediction model that is its whole command, whose gains are designed once; else the
    DLQR design.

    Args:
        scenario: Its weights are used, or the default ones where it has no ancillary law.
        samples: Of the run; each plan's first state and input is linearised at.
        repeats: Rounds over the run.
    """
    work, times = _work(scenario), []
    with collection_off():
        for sample in [*samples] * repeats:
            start = time.perf_counter()
            work(sample)
            times.append(time.perf_counter() - start)
    return np.array(times)


def _work(scenario: Scenario) -> Callable[[Sample], object]:
    model, period = load_prediction_model(scenario), scenario.period
    if isinstance(model, LaggedModel):
        assert scenario.ancillary_lagged is not None
        limit = model.effective_limit(scenario.input_limit)
        law = AncillaryLagged(scenario.ancillary_lagged, model, period=period, input_limit=limit)
        return lambda sample: law.command(sample.plan, sample.data.state, np.zeros(3))
    weights = scenario.ancillary_dlqr or AncillaryDlqrConfig()
    Q, R = np.diag(weights.state_weight), np.diag(weights.input_weight)
    return lambda sample: design_dlqr(
        model, sample.plan.nominal_state, sample.plan.nominal_input, period, Q, R
    )
