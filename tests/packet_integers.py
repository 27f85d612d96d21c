"""What is in a packet, in integers, as a decoder of ours finds it; as the player does it:
`test_player/packet_integers.js`.

Real numbers count on grids that lie beside halves and thirds, so that two programs that round
differently find the same cell.
"""

from collections.abc import Callable, Iterable
from functools import partial
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike

from decoder.playout.frame_decoder import frame_decoder_for
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.frames.frame_times import TimesPacket
from protocol.limits import VOICE_NUMBERS
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    packet_kind,
    parse_packet,
)

# Cells of the grids: of quaternions and times, of actuators, of everything else.
FINE, OF_EAU, COARSE = 2**20, 2**12, 2**10
BESIDE = 0.41421356
# Stands for what is refused.
REFUSED = -2


def on_grid(values: ArrayLike, cells: int) -> list[int]:
    """The cells of real numbers."""
    return [int(each) for each in np.floor(np.asarray(values, np.float64) * cells + BESIDE)]


def guarded(find: Callable[[], Iterable[int]]) -> list[int]:
    """What is found, -2 if it is damaged."""
    try:
        return list(find())
    except ProtocolError:
        return [REFUSED]


def packet_integers(data: bytes) -> list[int]:
    """The fields of a packet, its kind in front; -2: it is refused, at the end of a model's fields:
    its transform is.
    """
    return guarded(partial(_packet, data))


def _packet(data: bytes) -> list[int]:
    kind, packet = int(packet_kind(data)), parse_packet(data)
    match packet:
        case FramePacket():
            return [kind, packet.sequence, len(packet.payload), crc32(packet.payload)]
        case LayerPacket():
            of_data = len(packet.data), crc32(packet.data)
            return [kind, packet.model_version, packet.number, *of_data]
        case ControlPacket():
            return [kind, packet.sequence, packet.kind, packet.frame]
        case TimesPacket():
            return [kind, packet.sequence, ControlKind.TIMES, packet.first_frame, *packet.ticks]
        case ModelPacket():
            fields = [kind, *model_fields(packet), crc32(packet.profile_data)]
            return [*fields, *guarded(partial(_newest_frame, packet))]


def _newest_frame(model: ModelPacket) -> list[int]:
    """As yet there is none: -1."""
    frame_decoder_for(model)
    return [-1]


def _call(call: CallParameters) -> list[int]:
    return [
        call.profile == "thesis",
        call.colour_matrix == "bt709",
        *(call.width, call.height, call.fps_numerator, call.fps_denominator),
        *on_grid([call.focal_px], COARSE),
        *(call.frames_per_packet, call.start_frame, call.frame_step),
        call.has_eyelids,
        VOICE_NUMBERS[call.voice],
        *(call.sample_aspect.numerator, call.sample_aspect.denominator),
        call.has_residual,
    ]


def model_fields(model: ModelPacket) -> list[int]:
    values = [
        *_call(model.call),
        *(model.version, model.sequence, model.progressive, model.extensible),
        *model.aau,
        *on_grid(model.reference_rotation, FINE),
        *on_grid(model.reference_translation_mm, COARSE),
        *model.reference_eau,
        *(len(model.residual), *model.residual),
        *(crc32(model.texture), crc32(model.background)),
    ]
    return [int(each) for each in values]
