import socket

import pytest

from mirte_drake.faults.free_wire import DOMAINS, FREE_WIRES, is_free


def test_a_port_that_somebody_has_is_not_free():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        port = taken.getsockname()[1]
        assert not is_free(port)
    assert is_free(port)


@pytest.mark.parametrize("transport", FREE_WIRES)
def test_trials_have_wires_of_their_own(transport):
    assert len({FREE_WIRES[transport](number) for number in range(50)}) >= 45


def test_a_domain_that_somebody_is_in_is_passed_over():
    free = FREE_WIRES["ros2"](7)
    domain = int(free.rpartition("=")[2])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("", 7400 + 250 * domain + 10))
        assert FREE_WIRES["ros2"](7) != free
    assert domain in DOMAINS
