import sys

import pytest

from mirte_drake.hardware.multicast import listening_interfaces

# As a machine with a cable, a radio and another group has it.
MEMBERSHIPS = """Idx\tDevice    : Count Querier\tGroup    Users Timer\tReporter
1\tlo        :     2      V3
\t\t\t\t434CFFEF     2 0:00000000\t\t0
\t\t\t\t010000E0     1 0:00000000\t\t0
4\teth0      :     1      V3
\t\t\t\t010000E0     1 0:00000000\t\t0
5\twlan0     :     2      V3
\t\t\t\t434CFFEF     1 0:00000000\t\t0
\t\t\t\tFB0000E0     1 0:00000000\t\t0
"""

pytestmark = pytest.mark.skipif(sys.byteorder == "big", reason="the text is of a common machine")


@pytest.mark.parametrize(
    ("group", "expected"),
    [
        ("239.255.76.67", ("lo", "wlan0")),
        ("224.0.0.251", ("wlan0",)),
        ("224.0.0.1", ("lo", "eth0")),
        ("239.255.76.68", ()),
    ],
)
def test_interfaces_of_a_group(group, expected):
    assert listening_interfaces(group, MEMBERSHIPS) == expected


def test_a_machine_that_does_not_tell():
    assert listening_interfaces("239.255.76.67", "") == ()
