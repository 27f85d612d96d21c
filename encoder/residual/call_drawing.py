"""Draws a live call as far as it is known, and codes what its pictures lack."""

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from itertools import islice

import numpy as np

from encoder.residual.draw_call import DrawCall
from encoder.residual.residual_encoder import ResidualEncoder
from protocol.call_file import MAGIC
from protocol.call_records import RecordWriter
from protocol.picture_residual.drawn_picture import DrawnPicture
from shared_model.arrays import Picture, Single
from shared_model.errors import UserError


@dataclass(frozen=True, slots=True)
class ResidualTask:
    """The residual of a frame packet.

    covered: its source frames.
    sources: those of them that show a face, (h, w, 3) BGR; of the others nothing is coded.
    seconds: of the call.  faces_bits: what the packet has besides.
    """

    covered: range
    sources: Mapping[int, Picture]
    seconds: float
    faces_bits: float


class CallDrawing:
    """The pictures of a call whose packets come one by one.

    draw: gets a stream that grows, and is asked for no more pictures than its packets have.
    size: of the pictures, (width, height).  bitrate: of frame packets, bits a second.
    """

    def __init__(self, draw: DrawCall, size: tuple[int, int], bitrate: float) -> None:
        self._stream, self._records = _GrowingStream(), RecordWriter()
        self._stream.append(MAGIC)
        self._wanted = range(0)
        self._drawn = draw(self._stream, lambda index: index in self._wanted)
        self._encoder = ResidualEncoder(bitrate, *size)

    def see(self, packet: bytes) -> None:
        """Take the next packet of the call, a frame packet without residual."""
        self._stream.append(self._records.record(packet))

    def block(self, task: ResidualTask) -> bytes:
        """The residual of the packet that was seen last; empty: it has none.

        Raises `UserError` if the call cannot be drawn.
        """
        self._wanted = task.covered
        drawn = self._wanted_pictures()
        differences = [_difference(each, task.sources.get(each.index)) for each in drawn]
        areas = [each.face_area for each in drawn]
        return self._encoder.encode(differences, areas, task.seconds, task.faces_bits)

    def close(self) -> None:
        """Free what draws."""
        self._drawn.close()

    def _wanted_pictures(self) -> list[DrawnPicture]:
        """As many as the stream has: to ask for more would end it."""
        found = list(islice(self._drawn, len(self._wanted)))
        if len(found) < len(self._wanted):
            raise UserError("the call cannot be drawn as far as it is known")
        return found


def _difference(drawn: DrawnPicture, source: Picture | None) -> Single:
    if source is None:
        return np.zeros(drawn.picture.shape, np.float32)
    return source.astype(np.float32) - drawn.picture


class _GrowingStream(BytesIO):
    """Holds what has been appended and not been read."""

    def append(self, data: bytes) -> None:
        rest = self.read()
        self.seek(0)
        self.truncate()
        self.write(rest + data)
        self.seek(0)
