"""Checks of a packet's fields; each raises `ValueError` with field, value and bounds."""

import struct
from typing import Any


def check_int(name: str, value: Any, low: int, high: int) -> None:
    """Check that `value` is an int in `low`..`high`; bool and NumPy integers are refused."""
    if type(value) is not int or not low <= value <= high:
        raise ValueError(f"{name} is {value!r}, expected an integer {low}..{high}")


def check_bool(name: str, value: Any) -> None:
    """Check that `value` is a bool."""
    if type(value) is not bool:
        raise ValueError(f"{name} is {value!r}, expected true or false")


def check_codes(name: str, codes: tuple[int, ...], count: int, low: int) -> None:
    """Check that `codes` are `count` ints in `low`..127."""
    if len(codes) != count:
        raise ValueError(f"{name} has {len(codes)} codes, expected {count}")
    for code in codes:
        check_int(name, code, low, 127)


def check_bytes(name: str, data: Any, limit: int) -> None:
    """Check that `data` is at most `limit` bytes."""
    if type(data) is not bytes:
        raise ValueError(f"{name} is {type(data).__name__}, expected bytes")
    if len(data) > limit:
        raise ValueError(f"{name} has {len(data)} bytes, limit {limit}")


def as_float32(name: str, value: Any) -> float:
    """`value` rounded to single precision, as packets carry it."""
    if not isinstance(value, (int, float)) or not abs(value) <= 1e9:
        raise ValueError(f"{name} is {value!r}, expected a finite float")
    rounded: float = struct.unpack("f", struct.pack("f", value))[0]
    return rounded


def as_float32s(name: str, values: Any, count: int, limit: float) -> tuple[float, ...]:
    """`count` floats of magnitude at most `limit`, each rounded to single precision."""
    if not isinstance(values, tuple) or len(values) != count:
        raise ValueError(f"{name} is {values!r}, expected {count} floats")
    rounded = tuple(as_float32(name, value) for value in values)
    if any(abs(value) > limit for value in rounded):
        raise ValueError(f"{name} is {rounded}, expected magnitudes up to {limit}")
    return rounded
