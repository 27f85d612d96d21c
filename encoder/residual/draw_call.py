"""What draws a call for its encoder; `decoder.drawn_call.draw_call` does."""

from collections.abc import Callable, Generator
from typing import BinaryIO

from shared_model.arrays import Picture

# A call in a stream -> source frame and picture (h, w, 3) uint8 BGR of each frame, in order.
DrawCall = Callable[[BinaryIO], Generator[tuple[int, Picture], None, None]]
