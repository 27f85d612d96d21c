"""What draws a call for its encoder; `decoder.drawn_call.draw_call` does."""

from collections.abc import Callable, Generator
from typing import BinaryIO

from protocol.picture_residual.drawn_picture import DrawnPicture

# A call in a stream -> the picture of each frame, in order.
DrawCall = Callable[[BinaryIO], Generator[DrawnPicture, None, None]]
