"""The pictures of a call in a stream, for an encoder that compares them with its source."""

from collections.abc import Generator
from typing import BinaryIO

from decoder.call_pictures import CallPictures
from decoder.playout.call_source import CallSource
from shared_model.arrays import Picture


def draw_call(stream: BinaryIO) -> Generator[tuple[int, Picture], None, None]:
    """Source frame and picture, (h, w, 3) uint8 BGR, of each frame of a call.

    Raises `UserError` if the call cannot be drawn.
    """
    with CallPictures(CallSource(call_file=stream), lambda: False) as pictures:
        for frame in pictures:
            yield frame.index, frame.picture
