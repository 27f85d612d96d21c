"""Draws a live call as far as it is known, and codes what its pictures lack."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from encoder.residual.draw_call import DrawCall
from encoder.residual.drawing_thread import DrawingThread
from encoder.residual.residual_encoder import ResidualEncoder
from protocol.picture_residual.drawn_picture import DrawnPicture
from shared_model.arrays import Picture, Single


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
    """The pictures of a call whose packets come one by one, and what they lack.

    draw: see `DrawingThread`.
    size: of the pictures, (width, height).  bitrate: of frame packets, bits a second.
    """

    def __init__(self, draw: DrawCall, size: tuple[int, int], bitrate: float) -> None:
        self._thread = DrawingThread(draw)
        self._encoder = ResidualEncoder(bitrate, *size)

    def see(self, packet: bytes, first_wanted: int = 0) -> None:
        """Take the next packet of the call; a frame packet has no residual yet.

        first_wanted: no frame before it will be in a task.
        """
        self._thread.see(packet, first_wanted)

    def block(self, task: ResidualTask) -> bytes:
        """The residual of the packet that was seen last; empty: it has none.

        Raises `UserError` if the call cannot be drawn.
        """
        drawn = self._thread.pictures(task.covered)
        if not task.was_sent:
            self._encoder.take_back()
        differences = differences_of(drawn, task.sources)
        areas = [each.face_area for each in drawn]
        return self._encoder.encode(differences, areas, task.seconds, task.faces_bits)

    def close(self) -> None:
        """Free what draws."""
        self._thread.close()


def differences_of(drawn: Sequence[DrawnPicture], sources: Mapping[int, Picture]) -> list[Single]:
    """(h, w, 3) of each drawn picture: its source less it, or that of the nearest with a source."""
    known = {
        each.index: sources[each.index].astype(np.float32) - each.picture
        for each in drawn
        if each.index in sources
    }
    order = np.array(list(known))
    return [known[order[np.abs(order - each.index).argmin()]] for each in drawn]
