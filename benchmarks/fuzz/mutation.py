"""Bytes that have been changed in the ways in which a line, a disk or somebody changes them."""

import random
from collections.abc import Callable, Sequence

Change = Callable[[random.Random, bytes, bytes], bytes]

# Bits that are flipped, and bytes that are put in, at most.
MAX_FLIPS, MAX_INSERTED = 8, 64


def mutated(source: random.Random, samples: Sequence[bytes]) -> bytes:
    """One of the samples, changed once or twice; other samples lend what is put in."""
    data = source.choice(samples)
    for _ in range(source.choice((1, 1, 2))):
        data = source.choice(CHANGES)(source, data, source.choice(samples))
    return data


def _flip(source: random.Random, data: bytes, other: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(source.randint(1, MAX_FLIPS) if data else 0):
        changed[_place(source, data)] ^= 1 << source.randrange(8)
    return bytes(changed)


def _flip_in_front(source: random.Random, data: bytes, other: bytes) -> bytes:
    """Headers stand in front."""
    return _flip(source, data[:8], other) + data[8:]


def _cut(source: random.Random, data: bytes, other: bytes) -> bytes:
    return data[: source.randint(0, len(data))]


def _insert(source: random.Random, data: bytes, other: bytes) -> bytes:
    at = source.randint(0, len(data))
    return data[:at] + source.randbytes(source.randint(1, MAX_INSERTED)) + data[at:]


def _remove(source: random.Random, data: bytes, other: bytes) -> bytes:
    begin = source.randint(0, len(data))
    return data[:begin] + data[begin + source.randint(1, MAX_INSERTED) :]


def _repeat(source: random.Random, data: bytes, other: bytes) -> bytes:
    begin = source.randint(0, len(data))
    return data[: begin + source.randint(1, MAX_INSERTED)] + data[begin:]


def _splice(source: random.Random, data: bytes, other: bytes) -> bytes:
    return data[: source.randint(0, len(data))] + other[source.randint(0, len(other)) :]


def _fill(source: random.Random, data: bytes, other: bytes) -> bytes:
    """Largest and smallest values of fields."""
    begin = source.randint(0, len(data))
    length = min(source.randint(1, MAX_FLIPS), len(data) - begin)
    return (
        data[:begin] + source.choice((b"\x00", b"\xff", b"\x80")) * length + data[begin + length :]
    )


def _invent(source: random.Random, data: bytes, other: bytes) -> bytes:
    return data[:2] + source.randbytes(source.randint(0, 2 * MAX_INSERTED))


def _place(source: random.Random, data: bytes) -> int:
    return source.randrange(len(data))


CHANGES: tuple[Change, ...] = (
    *(_flip, _flip_in_front, _cut, _insert, _remove, _repeat, _splice, _fill, _invent),
)
