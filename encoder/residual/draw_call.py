"""What draws a call for its encoder; `decoder.drawn_call.draw_call` does."""

from collections.abc import Callable, Generator
from typing import BinaryIO

from protocol.picture_residual.drawn_picture import DrawnPicture

# A call in a stream, and which source frames are wanted -> the picture of each of these, in order.
DrawCall = Callable[[BinaryIO, Callable[[int], bool]], Generator[DrawnPicture, None, None]]
