"""The residual shape of a caller, range-coded: model packets of the default profile's formats."""

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder

AXES = 3


def serialise_residual(codes: tuple[int, ...]) -> bytes:
    """The number of points, then the codes -128..127 of each point's x, y and z; or no bytes."""
    coder, integers = RangeEncoder(), AdaptiveIntegers(AXES)
    for index, code in enumerate(codes):
        integers.code(coder, index % AXES, code)
    return bytes([len(codes) // AXES]) + coder.finish() if codes else b""


def parse_residual(data: bytes) -> tuple[int, ...]:
    """The inverse of `serialise_residual`.  Raises `ValueError` if `data` is damaged."""
    if not data:
        return ()
    coder, integers = RangeDecoder(data[1:]), AdaptiveIntegers(AXES)
    codes = tuple(integers.code(coder, index % AXES, 0) for index in range(AXES * data[0]))
    if coder.unread_bytes:
        raise ValueError(f"residual has {coder.unread_bytes} bytes too many")
    return codes
