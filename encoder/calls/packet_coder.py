"""Codes the frame packets of a live call, with one model version after the other."""

from collections.abc import Callable, Sequence

from encoder.coding.rate_control import OnlineRateController
from encoder.coding.rdo_quantiser import CodedPacket
from encoder.live_model.model_version import ModelVersion
from protocol.frames.temporal_prediction import FramePredictor
from shared_model.arrays import Array
from shared_model.parameters import FaceParameters


class PacketCoder:
    """Holds the state that a decoder has, too: the packet number and the predictor.

    on_packet: see `CallEvents`.
    """

    def __init__(
        self, rate: OnlineRateController, on_packet: Callable[[Array, CodedPacket], None]
    ) -> None:
        self._rate, self._on_packet = rate, on_packet
        self._number = 0
        self._predictor: FramePredictor | None = None

    @property
    def number(self) -> int:
        """Number of the next packet in the call."""
        return self._number

    def code(self, version: ModelVersion, faces: Sequence[FaceParameters]) -> bytes:
        """The payload of the next packet.

        version: the one in use, with its newest modes.  Its first packet starts a new predictor.
        """
        number = self._number - version.first_packet
        if self._predictor is None or not number:
            transform = version.padded_transform
            self._predictor = FramePredictor(transform.scale_codes, transform.reserved_modes)
        targets = version.transform_faces(faces)
        packet = self._rate.encode_packet(self._predictor, number, targets)
        self._on_packet(targets, packet)
        self._predictor.anchor = packet.frames[-1]
        self._number += 1
        return packet.payload
