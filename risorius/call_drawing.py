"""What draws a call for its encoder, loaded once a call needs it: most do not."""

from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from protocol.picture_residual.drawn_picture import DrawnPicture


def draw(stream: BinaryIO, wants: Callable[[int], bool]) -> "Generator[DrawnPicture, None, None]":
    """`decoder.drawn_call.draw_call`."""
    from decoder.drawn_call import draw_call

    return draw_call(stream, wants)
