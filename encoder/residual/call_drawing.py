"""Draws a live call as far as it is known, and codes what its pictures lack."""

from collections.abc import Generator, Mapping, Sequence
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
    sources: those of them that show a face, (h, w, 3) BGR, one at least; others are taken to differ
        from what is drawn as the nearest of these does.
    seconds: from its first frame to that of the next packet.
    faces_bits: bits of its faces and its record.
    was_sent: what was coded for the task before has been sent.
    """

    covered: range
    sources: Mapping[int, Picture]
    seconds: float
    faces_bits: float
    was_sent: bool = True


class CallDrawing:
    """The pictures of a call whose packets come one by one.

    draw: gets a stream that grows, at the first task, and is asked for no more pictures than its
        packets have.
    size: of the pictures, (width, height).  bitrate: of frame packets, bits a second.
    """

    def __init__(self, draw: DrawCall, size: tuple[int, int], bitrate: float) -> None:
        self._stream, self._records = _GrowingStream(), RecordWriter()
        self._stream.append(MAGIC)
        self._draw = draw
        self._drawn: Generator[DrawnPicture, None, None] | None = None
        self._wanted = range(0)
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
        if not task.was_sent:
            self._encoder.take_back()
        differences = _differences(drawn, task.sources)
        areas = [each.face_area for each in drawn]
        return self._encoder.encode(differences, areas, task.seconds, task.faces_bits)

    def close(self) -> None:
        """Free what draws."""
        if self._drawn is not None:
            self._drawn.close()

    def _wanted_pictures(self) -> list[DrawnPicture]:
        """As many as the stream has: to ask for more would end it."""
        if self._drawn is None:
            # Those after the wanted ones, which a packet about the face may have brought, are drawn
            # when they are asked for.
            self._drawn = self._draw(self._stream, lambda index: index >= self._wanted.start)
        wanted = (each for each in self._drawn if each.index in self._wanted)
        found = list(islice(wanted, len(self._wanted)))
        if len(found) < len(self._wanted):
            raise UserError("the call cannot be drawn as far as it is known")
        return found


def _differences(drawn: Sequence[DrawnPicture], sources: Mapping[int, Picture]) -> list[Single]:
    """The sources less the drawn pictures, see `ResidualTask`."""
    known = {
        each.index: sources[each.index].astype(np.float32) - each.picture
        for each in drawn
        if each.index in sources
    }
    order = np.array(list(known))
    return [known[order[np.abs(order - each.index).argmin()]] for each in drawn]


class _GrowingStream(BytesIO):
    """Holds what has been appended and not been read."""

    def append(self, data: bytes) -> None:
        rest = self.read()
        self.seek(0)
        self.truncate()
        self.write(rest + data)
        self.seek(0)
