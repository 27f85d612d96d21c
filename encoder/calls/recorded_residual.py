"""Adds the picture residual to a recorded call, which is drawn beside its source."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from io import BytesIO
from typing import BinaryIO

import numpy as np

from encoder.calls.packet_sender import PacketSender
from encoder.calls.recorded_session import send_call
from encoder.calls.session_stats import SessionStats
from encoder.calls.two_pass_session import EncodedCall
from encoder.coding.rate_control import packet_spans
from encoder.residual.draw_call import DrawCall
from encoder.residual.residual_encoder import ResidualEncoder, spent_bits, with_residual_stated
from protocol.call_file import CallStreamWriter
from protocol.picture_residual.drawn_picture import DrawnPicture
from protocol.picture_residual.framing import covered_frames, join_payload
from shared_model.arrays import Picture, Single


def with_residual(
    parts: Sequence[EncodedCall],
    draw: DrawCall,
    frames: Iterable[tuple[int, Picture]],
    bitrate: float,
    stop: Callable[[], bool] = lambda: False,
) -> list[EncodedCall]:
    """The parts of a call, their models whole, with the picture residual in frame packets.

    frames: of the source, from the first on.  bitrate: of frame packets, bits a second.
    stop: asked before each frame; the packets from there on have none.
    Raises `UserError` if the call cannot be drawn.
    """
    prepared = [_with_blocks(part, [b""] * len(part.payloads)) for part in parts]
    with closing(draw(_written(prepared), lambda index: True)) as drawn:
        differences = _Differences(drawn, frames, stop)
        return [_with_blocks(part, _blocks(part, differences, bitrate)) for part in parts]


def _with_blocks(part: EncodedCall, blocks: Iterable[bytes]) -> EncodedCall:
    """A part whose frame packets have these blocks."""
    return replace(
        part,
        model=with_residual_stated(part.model),
        payloads=tuple(map(join_payload, blocks, part.payloads)),
    )


def _written(parts: Sequence[EncodedCall]) -> BinaryIO:
    stream = BytesIO()
    sender = PacketSender(CallStreamWriter(stream), SessionStats())
    send_call(parts, sender, None, lambda: False)
    stream.seek(0)
    return stream


class _Differences:
    """The differences of source frames and drawn pictures, to be asked for in order."""

    def __init__(
        self,
        drawn: Iterator[DrawnPicture],
        frames: Iterable[tuple[int, Picture]],
        stop: Callable[[], bool],
    ) -> None:
        self._pairs, self._stop = zip(frames, drawn, strict=False), stop
        self._newest = -1

    def of(self, wanted: range, without: frozenset[int]) -> tuple[list[Single], list[Single]]:
        """Of the source frames `wanted`, and their face areas; fewer at the end.

        Differences of those `without` a face are 0.
        """
        found, areas = list[Single](), list[Single]()
        while self._newest < wanted[-1]:
            pair = None if self._stop() else next(self._pairs, None)
            if pair is None:
                break
            (self._newest, source), drawn = pair
            assert drawn.index == self._newest
            if self._newest in wanted:
                difference = source.astype(np.float32) - drawn.picture
                found.append(0 * difference if drawn.index in without else difference)
                areas.append(drawn.face_area)
        return found, areas


def _blocks(part: EncodedCall, differences: _Differences, bitrate: float) -> Iterator[bytes]:
    """The block of each frame packet."""
    call = part.model.call
    encoder = ResidualEncoder(bitrate, call.width, call.height)
    coded = len(range(call.start_frame, part.last_face + 1, call.frame_step))
    spans = packet_spans(coded, call.frames_per_packet)
    for number, (payload, (first, end)) in enumerate(zip(part.payloads, spans, strict=False)):
        covered = covered_frames(call, number, end - first)
        found, areas = differences.of(covered, part.lost)
        if len(found) < len(covered) or part.lost.issuperset(covered):
            yield b""
            continue
        yield encoder.encode(found, areas, len(covered) / call.fps, spent_bits(payload))
