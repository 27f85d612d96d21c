"""The pictures of a call in a stream, for an encoder that compares them with its source."""

from collections.abc import Callable, Generator
from typing import BinaryIO

from decoder.call_pictures import CallPictures
from decoder.playout.call_source import CallSource
from protocol.picture_residual.drawn_picture import DrawnPicture


def draw_call(
    stream: BinaryIO, wants: Callable[[int], bool]
) -> Generator[DrawnPicture, None, None]:
    """The picture of each frame of a call that `wants` says yes to, asked by its index.

    Raises `UserError` if the call cannot be drawn.
    """
    source = CallSource(call_file=stream)
    with CallPictures(source, lambda: False, wants=wants, with_face_areas=True) as pictures:
        for frame in pictures:
            assert frame.face_area is not None
            yield DrawnPicture(frame.index, frame.picture, frame.face_area)
