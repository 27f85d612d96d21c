"""Values of options, from what the user typed; `ArgumentTypeError` says what is wrong with one."""

import argparse


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


def _rate(text: str, unit: str) -> float:
    value = _number(text)
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text} is not above 0 and below 1e9 {unit}")
    return value


def bitrate(text: str) -> float:
    """Bits a second."""
    return _rate(text, "bits a second")


def frame_rate(text: str) -> float:
    """Frames a second."""
    return _rate(text, "frames a second")


def model_bytes(text: str) -> int:
    """The size of a model packet."""
    value = _integer(text)
    if not 2000 <= value <= 100_000:
        raise argparse.ArgumentTypeError(f"{text} is not 2000 to 100000 bytes")
    return value


def port(text: str) -> int:
    """A TCP port."""
    value = _integer(text)
    if not 0 <= value < 65536:
        raise argparse.ArgumentTypeError(f"{text} is not a TCP port, 0 to 65535")
    return value


def bitrates(text: str) -> tuple[float, ...]:
    """Rates with commas between them, each once, from low to high."""
    return tuple(sorted({bitrate(part) for part in text.split(",")}))


def count(text: str) -> int:
    """A number of frames."""
    value = _integer(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a number of frames above 0")
    return value
