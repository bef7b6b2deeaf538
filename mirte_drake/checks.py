"""Checks of configuration values, each raising one clear line."""

import dataclasses as dc
import sys
from typing import Any

import numpy as np


def check_array(name: str, value: object, shape: tuple[int, ...], minimum: float = -np.inf) -> None:
    """Checks that a value is an array of finite numbers.

    Args:
        name: Field name for the message.
        value: What was configured.
        shape: Required shape.
        minimum: Smallest allowed entry.

    Raises:
        ValueError: when shape, finiteness or range is wrong.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: must be numbers of shape {shape}, got {value}") from None
    if array.shape != shape:
        raise ValueError(f"{name}: must have shape {shape}, got shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: must be finite, got {array.tolist()}")
    if np.any(array < minimum):
        raise ValueError(f"{name}: every entry must be >= {minimum:g}, got {array.tolist()}")


def check_number(
    name: str,
    value: float,
    *,
    above: float | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
) -> None:
    """Checks that a number is finite and in range.

    Raises:
        ValueError: when it is not.
    """
    largest = sys.float_info.max  # An int may be larger than any float.
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= largest:
        raise ValueError(f"{name}: must be a finite number, got {value}")
    if above is not None and not value > above:
        raise ValueError(f"{name}: must be > {above:g}, got {value}")
    if minimum is not None and not value >= minimum:
        raise ValueError(f"{name}: must be >= {minimum:g}, got {value}")
    if maximum is not None and not value <= maximum:
        raise ValueError(f"{name}: must be <= {maximum:g}, got {value}")


def check_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Checks that a value is one of the named choices.

    Raises:
        ValueError: when it is not.
    """
    if value not in choices:
        raise ValueError(f"{name}: must be one of {', '.join(choices)}, got {value!r}")


def check_parts(config: Any) -> None:  # noqa: ANN401
    """Validates every field of a dataclass that has a ``validate``.

    Raises:
        ValueError: naming the field, then what its own ``validate`` says.
    """
    for field in dc.fields(config):
        part = getattr(config, field.name)
        if hasattr(part, "validate"):
            try:
                part.validate()
            except ValueError as error:
                raise type(error)(f"{field.name}.{error}") from None
