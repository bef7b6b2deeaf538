import os

import pytest


@pytest.mark.skipif("PYTEST_XDIST_WORKER" not in os.environ, reason="needs several processes")
@pytest.mark.xdist_group("wire")
def test_tests_of_a_group_share_a_process(request):
    """By a name that they are given: pytest and pytest-xdist must be of an age."""
    assert request.node.nodeid.endswith("@wire")
