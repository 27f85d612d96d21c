"""Sample aspect ratio of a source: the size that its pictures have in a call.

A head is fitted and drawn in square pixels.  A source whose pixels are nearly square is taken as it
is; pictures of others are stretched the way that loses nothing, and shrunk again when written.
"""

from fractions import Fraction

from protocol.entropy.validation import check_int
from protocol.limits import MAX_SIDE_PX

# Pixels whose sides differ by no more are taken as square; the fit of the head takes this up.
NEARLY_SQUARE = Fraction(11, 10)
MAX_ASPECT_TERM = 255
MAX_ASPECT = 8


def is_stretched(aspect: Fraction) -> bool:
    """Whether pictures with this sample aspect ratio (width over height) are stretched."""
    return max(aspect, 1 / aspect) > NEARLY_SQUARE


def square_size(width: int, height: int, aspect: Fraction) -> tuple[int, int]:
    """Width and height in the call, of pictures of this size and sample aspect ratio."""
    return shown_size(width, height, aspect) if is_stretched(aspect) else (width, height)


def shown_size(width: int, height: int, aspect: Fraction) -> tuple[int, int]:
    """Width and height at which pictures of this size and sample aspect ratio are shown."""
    return (round(width * aspect), height) if aspect > 1 else (width, round(height / aspect))


def source_size(width: int, height: int, aspect: Fraction) -> tuple[int, int]:
    """Width and height of the source, of pictures of this size in the call: of `square_size`."""
    if not is_stretched(aspect):
        return width, height
    return (
        (max(1, round(width / aspect)), height)
        if aspect > 1
        else (width, max(1, round(height * aspect)))
    )


def usable_aspect(aspect: Fraction | None, width: int, height: int) -> Fraction:
    """A stated sample aspect ratio of pictures of this size as a call can carry it; else 1."""
    if aspect is None or aspect <= 0:
        return Fraction(1)
    wide = aspect.limit_denominator(MAX_ASPECT_TERM)
    near = wide if aspect <= 1 else 1 / (1 / aspect).limit_denominator(MAX_ASPECT_TERM)
    if not is_valid_aspect(near) or max(square_size(width, height, near)) > MAX_SIDE_PX:
        return Fraction(1)
    return near


def is_valid_aspect(aspect: Fraction) -> bool:
    """Whether a call can carry this sample aspect ratio."""
    terms = max(aspect.numerator, aspect.denominator)
    return aspect > 0 and terms <= MAX_ASPECT_TERM and max(aspect, 1 / aspect) <= MAX_ASPECT


def check_aspect(aspect: Fraction) -> None:
    """Raise `ValueError` if a call cannot carry this sample aspect ratio."""
    if not is_valid_aspect(aspect):
        raise ValueError(f"sample aspect ratio is {aspect}, expected 1/{MAX_ASPECT}..{MAX_ASPECT}")


def aspect_of(numerator: int, denominator: int) -> Fraction:
    """The sample aspect ratio of these terms on the wire.  Raises `ValueError`."""
    check_int("aspect numerator", numerator, 1, MAX_ASPECT_TERM)
    check_int("aspect denominator", denominator, 1, MAX_ASPECT_TERM)
    return Fraction(numerator, denominator)
