"""Random sequences of all that can happen to the governor: never an unsafe output.

GOVERNOR_SEEDS=10 in the environment runs all of a hundred thousand.
"""

import os

import hypothesis
import pytest
from governor_world import run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

SEQUENCES = st.binary(min_size=12, max_size=48)


@settings(deadline=None)
@given(SEQUENCES)
def test_no_sequence_leads_to_an_unsafe_output(sequence):
    run(sequence)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(int(os.environ.get("GOVERNOR_SEEDS", "1"))))
def test_none_of_ten_thousand_sequences_leads_to_an_unsafe_output(seed):
    quiet = settings(
        max_examples=10_000,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    hypothesis.seed(seed)(quiet(given(SEQUENCES)(lambda sequence: run(sequence) and None)))()
