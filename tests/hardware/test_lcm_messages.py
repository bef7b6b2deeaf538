import dataclasses as dc
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lcm_examples import MESSAGES, check_equal

from mirte_drake.hardware import mirte_lcm
from mirte_drake.hardware.lcm_messages import TYPES, channel, decode, encode, sender_of
from mirte_drake.hardware.messages import Odometry, OperatorRequest, PlanView, Request, WheelCommand

KINDS = st.sampled_from(list(MESSAGES))
KIND = pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)


@KIND
def test_round_trip(kind):
    message = MESSAGES[kind]
    decoded = decode(kind, encode(message), arrival=12.5)
    check_equal(decoded, message, arrived_after=12.5)
    assert getattr(decoded, "arrival", 12.5) == 12.5


def test_numbers_of_numpy():
    drive = MESSAGES[next(kind for kind in MESSAGES if kind.__name__ == "DriveCommand")]
    of_numpy = dc.replace(drive, solve_failed=np.bool_(True), sequence=np.int64(7))
    assert encode(of_numpy) == encode(drive)


@given(st.lists(st.floats(), min_size=6, max_size=6), st.integers(-(2**63), 2**63 - 1))
def test_odometry_passes_as_it_is(values, stamp):
    """What is not finite too: to judge it is the guard's business."""
    message = Odometry(stamp, np.array(values[:3]), np.array(values[3:]))
    check_equal(decode(Odometry, encode(message), arrival=0.0), message)


def test_plan_without_points():
    plan = PlanView(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(3))
    check_equal(decode(PlanView, encode(plan), arrival=0.0), plan)


def test_wheel_commands_name_their_sender():
    data = encode(MESSAGES[WheelCommand], sender=2**63 - 1)
    assert sender_of(data) == 2**63 - 1
    with pytest.raises(ValueError, match="no WheelCommand"):
        sender_of(encode(MESSAGES[Odometry]))


def test_wheel_commands_are_whole_numbers():
    command = decode(WheelCommand, encode(WheelCommand(np.array([0.6, -0.6, 2.4, 3]))), arrival=0.0)
    np.testing.assert_array_equal(command.command, [1.0, -1.0, 2.0, 3.0])


@pytest.mark.parametrize("wheel", [np.nan, -np.inf, 1e300, 2.0**31])
def test_wheel_commands_that_are_no_integers_are_not_sent(wheel):
    with pytest.raises(ValueError, match="must be finite and of 32 bits"):
        encode(WheelCommand(np.array([0.0, wheel, 0.0, 0.0])))


def test_unknown_request():
    packed = mirte_lcm.operator_request_t()
    packed.request = 7
    with pytest.raises(ValueError, match="7"):
        decode(OperatorRequest, packed.encode(), arrival=0.0)
    assert decode(OperatorRequest, encode(OperatorRequest(Request.STOP)), arrival=0.0).request == 1


@KIND
def test_bytes_missing_or_too_many(kind):
    data = encode(MESSAGES[kind])
    for wrong in (b"", data[:-1], data[:7], data + b"\0", data[1:]):
        with pytest.raises(ValueError, match=f"^no {kind.__name__}: "):
            decode(kind, wrong, arrival=0.0)


@KIND
def test_another_kind(kind):
    for other in set(MESSAGES) - {kind}:
        with pytest.raises(ValueError, match=f"^no {kind.__name__}: "):
            decode(kind, encode(MESSAGES[other]), arrival=0.0)


@given(KINDS, st.binary(max_size=200))
def test_random_bytes_after_the_fingerprint(kind, data):
    """A message whose arrays have their shapes, or a ValueError."""
    try:
        message = decode(kind, encode(MESSAGES[kind])[:8] + data, arrival=0.0)
    except ValueError:
        return
    for field in dc.fields(kind):
        good = getattr(MESSAGES[kind], field.name)
        if isinstance(good, np.ndarray):
            assert getattr(message, field.name).shape[-1] == good.shape[-1]


def test_channels_have_a_prefix():
    assert {channel("MIRTE_", kind) for kind in TYPES} == {
        "MIRTE_ODOMETRY",
        "MIRTE_WHEEL_COMMAND",
        "MIRTE_DRIVE_COMMAND",
        "MIRTE_GUARD_STATUS",
        "MIRTE_OPERATOR_REQUEST",
        "MIRTE_PLAN_VIEW",
    }
    assert set(TYPES) == set(MESSAGES)


@KIND
def test_every_field_is_sent(kind):
    fields = {field.name for field in dc.fields(kind)} - {"arrival"}
    assert set(TYPES[kind].__slots__) - {"sender", "points"} == fields


def test_generated_modules_are_up_to_date(tmp_path):
    generator = shutil.which("lcm-gen") or shutil.which("lcm-gen", path=Path(sys.executable).parent)
    if generator is None:
        pytest.skip("lcm-gen is not installed: pip install lcm")
    folder = Path(mirte_lcm.__file__).parent
    source = folder / "mirte_lcm.lcm"
    subprocess.run([generator, "--python", "--ppath", tmp_path, source], check=True)
    made = sorted((tmp_path / "mirte_lcm").glob("*.py"))
    assert [path.name for path in made] == sorted(path.name for path in folder.glob("*.py"))
    for path in made:
        assert lines(path) == lines(folder / path.name), path.name


def lines(path):
    """Without the generator's version."""
    return [line for line in path.read_text().splitlines() if not line.startswith("lcm-gen ")]


def test_messages_fit_a_datagram():
    """LCM cuts larger ones in pieces, of which any may be lost."""
    assert max(len(encode(message)) for message in MESSAGES.values()) < 1400
    assert math.isclose(len(encode(MESSAGES[PlanView])), 8 + 4 + 2 * 11 * 24 + 24)
