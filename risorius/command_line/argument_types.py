"""Values of options, from what the user typed; `ArgumentTypeError` says what is wrong with one."""

import argparse
from typing import TypeVar

from encoder.option_rules import check_value

# As long as the relay's own certificate.
MAX_DAYS = 3650

Number = TypeVar("Number", int, float)


def parts(text: str) -> frozenset[str]:
    """Names with commas between them."""
    return frozenset(text.split(","))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text} is not a number") from error


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number") from error


def seconds(text: str) -> float:
    """A time to wait, seconds."""
    value = _number(text)
    if not 0 <= value < 1e9:
        raise argparse.ArgumentTypeError(f"{text} is not a number of seconds")
    return value


def _checked(name: str, value: Number) -> Number:
    try:
        check_value(name, value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return value


def bitrate(text: str) -> float:
    """Bits a second."""
    return _checked("bitrate", _number(text))


def frame_rate(text: str) -> float:
    """Frames a second."""
    return _checked("fps", _number(text))


def delay(text: str) -> float:
    """How long the frames of a live call wait, seconds."""
    return _checked("delay", _number(text))


def model_bytes(text: str) -> int:
    """The size of a model packet."""
    return _checked("model_bytes", _integer(text))


def port(text: str) -> int:
    """A TCP port."""
    value = _integer(text)
    if not 0 <= value < 65536:
        raise argparse.ArgumentTypeError(f"{text} is not a TCP port, 0 to 65535")
    return value


def rungs(text: str) -> "tuple[tuple[float, int | None], ...]":
    """Rates, or BPS:MODEL_BYTES, with commas between them, each once, from low to high."""
    found = set()
    for part in text.split(","):
        rate, _, size = part.partition(":")
        found.add((bitrate(rate), _checked("model_bytes", _integer(size)) if size else None))
    return tuple(sorted(found, key=lambda each: (each[0], each[1] or 0)))


def names(text: str) -> tuple[str, ...]:
    """Names with commas between them, each once."""
    return tuple(dict.fromkeys(filter(None, (part.strip() for part in text.split(",")))))


def count(text: str) -> int:
    """A number of frames."""
    return _checked("max_frames", _integer(text))


def mode_count(text: str) -> int:
    """A number of appearance modes."""
    return _checked("texture_modes", _integer(text))


def days(text: str) -> int:
    """For how long a certificate is valid."""
    value = _integer(text)
    if not 0 < value <= MAX_DAYS:
        raise argparse.ArgumentTypeError(f"{text} is not a number of days, 1 to {MAX_DAYS}")
    return value


def peers(text: str) -> int:
    """How many peers may be connected."""
    value = _integer(text)
    if value < 2:
        raise argparse.ArgumentTypeError(f"{text} is too few peers, at least 2")
    return value


def share(text: str) -> float:
    """More than 0, at most 1."""
    value = _number(text)
    if not 0 < value <= 1:
        raise argparse.ArgumentTypeError(f"{text} is not a share, above 0 and up to 1")
    return value
