"""The residual shape of a caller, as model packets of the default profile's versions have it."""

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder

AXES = 3


def serialise_residual(codes: tuple[int, ...]) -> bytes:
    """Bytes of the codes -128..127 of some points' x, y and z: the number of points comes first."""
    coder, integers = RangeEncoder(), AdaptiveIntegers(AXES)
    for number, code in enumerate(codes):
        integers.code(coder, number % AXES, code)
    return bytes([len(codes) // AXES]) + coder.finish() if codes else b""


def parse_residual(data: bytes) -> tuple[int, ...]:
    """The codes in the bytes of a residual shape.  Raises `ValueError` if they are none."""
    if not data:
        return ()
    coder, integers = RangeDecoder(data[1:]), AdaptiveIntegers(AXES)
    codes = tuple(integers.code(coder, number % AXES, 0) for number in range(AXES * data[0]))
    if coder.unread_bytes:
        raise ValueError(f"residual has {coder.unread_bytes} bytes too many")
    return codes
