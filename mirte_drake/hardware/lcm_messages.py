"""The messages as LCM sees them: channels, and bytes of the types in ``mirte_lcm``."""

import dataclasses as dc
from io import BytesIO
from typing import Any, TypeVar

import numpy as np

from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Message,
    Odometry,
    OperatorRequest,
    PlanView,
    Request,
    WheelCommand,
)
from mirte_drake.hardware.mirte_lcm import (
    drive_command_t,
    guard_status_t,
    odometry_t,
    operator_request_t,
    plan_view_t,
    wheel_command_t,
)

M = TypeVar("M")

MAX_COMMAND = 2**31 - 1  # [pwm] The type's, not the robot's.

TYPES: dict[type, Any] = {
    Odometry: odometry_t,
    WheelCommand: wheel_command_t,
    DriveCommand: drive_command_t,
    GuardStatus: guard_status_t,
    OperatorRequest: operator_request_t,
    PlanView: plan_view_t,
}


def channel(prefix: str, kind: type) -> str:
    """Returns the channel of a kind of message, as MIRTE_ODOMETRY."""
    return prefix + TYPES[kind].__name__.removesuffix("_t").upper()


def encode(message: Message, *, sender: int = 0) -> bytes:
    """Returns the bytes of a message.

    Args:
        message: The message; its ``arrival`` is not sent.
        sender: In [0, 2^63), told with a wheel command: which end of the wire it comes from.

    Raises:
        ValueError: when a wheel command is not finite or too large.
    """
    packed = TYPES[type(message)]()
    for field in dc.fields(message):
        if field.name in packed.__slots__:
            value = getattr(message, field.name)
            # The generated code packs no scalars of numpy.
            setattr(packed, field.name, value.item() if isinstance(value, np.generic) else value)
    match message:
        case WheelCommand():
            packed.sender = sender
            packed.command = _whole(message.command)
        case PlanView():
            packed.points = len(message.reference)
    return packed.encode()


def decode(kind: type[M], data: bytes, *, arrival: float) -> M:
    """Returns the message of a kind in bytes of LCM, whatever its numbers are.

    Args:
        kind: Class of the message.
        data: What came.
        arrival: [s] time.monotonic() when it came.

    Raises:
        ValueError: when the bytes are not exactly one such message.
    """
    packed = _unpack(kind, data)
    values: dict[str, Any] = {}
    for field in dc.fields(kind):  # type: ignore[arg-type]
        if field.name in packed.__slots__:
            values[field.name] = getattr(packed, field.name)
        elif field.name == "arrival":
            values["arrival"] = arrival
    for name, value in values.items():
        if isinstance(value, list | tuple):
            values[name] = np.array(value, dtype=float)
    if kind is OperatorRequest:
        values["request"] = Request(values["request"])
    if kind is PlanView:  # No rows have no columns.
        values |= {name: values[name].reshape(-1, 3) for name in ("reference", "nominal")}
    return kind(**values)


def sender_of(data: bytes) -> int:
    """Returns which end of the wire a wheel command comes from.

    Raises:
        ValueError: when the bytes are not exactly one wheel command.
    """
    return _unpack(WheelCommand, data).sender


def _whole(command: np.ndarray) -> list[int]:
    if not np.all(np.abs(command) < MAX_COMMAND):  # Nor is it then for NaN.
        raise ValueError(f"a wheel command must be finite and of 32 bits, got {command.tolist()}")
    return np.rint(command).astype(int).tolist()


def _unpack(kind: type, data: bytes) -> Any:  # noqa: ANN401
    buffer = BytesIO(data)
    try:
        packed = TYPES[kind].decode(buffer)
    except Exception as error:  # Generated code fails in many ways on bytes of no sense.
        raise ValueError(f"no {kind.__name__}: {error}") from None
    if buffer.read():
        raise ValueError(f"no {kind.__name__}: bytes after its end")
    return packed
