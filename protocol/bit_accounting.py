"""Where the bytes of a call go: model packets by part, frame packets by group of parameters.

A frame packet's decisions have ideal lengths, -log2 of their probabilities, which tell what each
combined component costs.  A component moves several parameters; its bits are split by how much of
its harm each group does: a basis row is in units of equal harm (`Components.unit`), so by squares.
"""

from dataclasses import dataclass
from math import log2

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import GEOMETRY_SIZE, FrameTransform, parse_transform
from protocol.frames.payload_coding import code_payload_stepwise, parse_payload
from protocol.frames.temporal_prediction import FramePredictor
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, Packet, serialise
from protocol.progressive_model import LayerBuffer
from shared_model.parameters import EAUS, LID_EAUS, THESIS_EAUS

Array = NDArray[np.float64]

GROUPS = ("pose", "expression", "lids", "gaze", "modes")
# A packet's head, and what is lost to whole bytes; packets that nobody can decode.
OVERHEAD, DAMAGED = "overhead", "damaged"
_THESIS_VALUES = {"pose": 6, "expression": len(THESIS_EAUS)}


@dataclass(frozen=True, slots=True)
class PacketSize:
    """Bytes of payload of the frame packets: mean, 95th percentile, largest."""

    mean: float
    p95: float
    largest: int


class BitAccounting:
    """Adds up what the packets of one call, given in order, spend their bytes on."""

    def __init__(self) -> None:
        self._model_parts: dict[str, int] = {}
        self._layers, self._layered = LayerBuffer(), set[int]()
        self._groups: dict[str, float] = {}
        self._sizes: list[int] = []
        self._model: ModelPacket | None = None
        self._reading: _FrameContext | None = None
        self._waiting: _FrameContext | None = None

    @property
    def model_parts(self) -> dict[str, int]:
        """Bytes of each part of model and layer packets; they add up to these without byte 0."""
        found = dict(self._model_parts)
        for model in self._layered:
            _reclassify(found, self._layers.bytes_by_item(model))
        return found

    @property
    def groups(self) -> dict[str, float]:
        """Bytes that each group of parameters took; they add up to the frame packets' payloads."""
        return dict(self._groups)

    @property
    def packet_size(self) -> PacketSize | None:
        """How large frame packets are; None without any."""
        if not self._sizes:
            return None
        p95 = float(np.percentile(self._sizes, 95))
        return PacketSize(float(np.mean(self._sizes)), p95, max(self._sizes))

    def add(self, packet: Packet) -> None:
        """Enter a packet; frame packets are read by the model packet before them.

        Raises `ProtocolError` if a model packet's components or the stream of layers are damaged.
        """
        if isinstance(packet, ModelPacket):
            self._add_model(packet)
        elif isinstance(packet, LayerPacket):
            self._add_layer(packet)
        elif isinstance(packet, FramePacket):
            self._add_frame(packet)

    def _add_model(self, packet: ModelPacket) -> None:
        modes: tuple[bytes, ...] = ()
        if packet.profile_data:
            components = parse_transform(packet.profile_data)
            modes = components.modes
            if self._model is None or packet.version > self._model.version:
                self._waiting = _FrameContext(components, packet.sequence)
        if self._model is None or packet.version > self._model.version:
            # The one before may be in use for a while, those before that are not.
            self._close_layers(self._model.version if self._model else 0)
            self._model = packet
        parts = {
            "background": len(packet.background),
            "texture": len(packet.texture),
            "modes": sum(map(len, modes)),
        }
        parts["shape"] = len(serialise(packet)) - 1 - sum(parts.values())
        for name, count in parts.items():
            self._model_parts[name] = self._model_parts.get(name, 0) + count

    def _add_layer(self, packet: LayerPacket) -> None:
        """Counts as shape until it is known what it is of."""
        self._layers.add(packet)
        try:
            self._layers.bytes_by_item(packet.model_version)
        except ProtocolError:
            # Nor will it ever be known what those before are of.
            self._layered.discard(packet.model_version)
            raise
        size = len(serialise(packet)) - 1
        self._model_parts["shape"] = self._model_parts.get("shape", 0) + size
        self._layered.add(packet.model_version)

    def _close_layers(self, model: int) -> None:
        """Let go of the layers of older models: all that came of them has come."""
        for older in {number for number in self._layered if number < model}:
            _reclassify(self._model_parts, self._layers.bytes_by_item(older))
            self._layered.remove(older)
        self._layers.drop_before(model)

    def _add_frame(self, packet: FramePacket) -> None:
        size = len(packet.payload)
        self._sizes.append(size)
        try:
            shares = self._shares(packet)
        except ProtocolError:
            shares = {DAMAGED: 1.0}
        for name, share in shares.items():
            self._groups[name] = self._groups.get(name, 0.0) + share * size

    def _shares(self, packet: FramePacket) -> dict[str, float]:
        if self._model is None:
            raise ProtocolError("a frame packet before the model packet")
        if self._model.call.profile == "thesis":
            values = _THESIS_VALUES | (
                {"lids": len(LID_EAUS)} if self._model.call.has_eyelids else {}
            )
            total = sum(values.values())
            return {name: count / total for name, count in values.items()}
        if self._waiting and self._waiting.number(packet) < SEQUENCE_MODULUS // 2:
            self._reading, self._waiting = self._waiting, None
            self._close_layers(self._model.version)
        reading = self._reading
        if reading is None:
            raise ProtocolError("the model packet has no components")
        usual = self._model.call.frames_per_packet
        number = reading.number(packet)
        bits = component_bits(reading.predictor, number, usual, packet.payload)
        groups = bits @ group_shares(reading.components)
        # The coder may find bytes shorter than the ideal; no group then took more than there is.
        whole = max(8.0 * len(packet.payload), float(groups.sum()))
        shares = dict(zip(GROUPS, (groups / whole).tolist(), strict=True))
        return shares | {OVERHEAD: 1 - sum(shares.values())}


def _reclassify(found: dict[str, int], parts: dict[str, int]) -> None:
    """Enter what counted as shape as the parts it is of."""
    for name, count in parts.items():
        found[name] = found.get(name, 0) + count
        found["shape"] = found.get("shape", 0) - count


class _FrameContext:
    """How frame packets are read from the one numbered `first` on."""

    def __init__(self, components: FrameTransform, first: int) -> None:
        self.components, self.predictor = (
            components,
            FramePredictor(components.scale_codes, components.reserved_modes),
        )
        self._first = first

    def number(self, packet: FramePacket) -> int:
        """The packet's place in the stream of its model packet, 0..63."""
        return (packet.sequence - self._first) % SEQUENCE_MODULUS


def component_bits(
    predictor: FramePredictor, sequence: int, usual_frames: int, payload: bytes
) -> Array:
    """(n,) ideal bits that each component takes of a payload; moves the predictor on.

    Raises `ProtocolError` as `decode_packet` does.
    """
    packet = parse_payload(predictor, sequence, usual_frames, payload)
    meter, bits, before = _IdealLengthCoder(), np.zeros(predictor.component_count), 0.0
    steps = code_payload_stepwise(
        meter, predictor, sequence, usual_frames, packet.header, packet.values
    )
    for component in steps:
        if component is not None:
            bits[component] += meter.bits - before
        before = meter.bits
    predictor.anchor = packet.frames[-1]
    return bits


def group_shares(components: FrameTransform) -> Array:
    """(n, GROUPS) share of each group in the harm that each component does; rows add up to 1."""
    squares = components.basis.astype(np.float64) ** 2
    grouped = np.stack([squares[:, _group_of(components) == g].sum(1) for g in GROUPS], 1)
    return np.asarray(grouped / np.maximum(grouped.sum(1, keepdims=True), 1))


class _IdealLengthCoder:
    """A coder that writes nothing and adds up ideal lengths."""

    def __init__(self) -> None:
        self.bits = 0.0

    def code_bit(self, bit: int, zero: int) -> int:
        self.bits -= log2((PROBABILITY_ONE - zero if bit else zero) / PROBABILITY_ONE)
        return bit


def _group_of(components: FrameTransform) -> NDArray[np.str_]:
    """(d,) the group of each value of y, see `Components`."""
    names = [eau.name.split("_")[0] for eau in EAUS]
    actuators = [{"lid": "lids", "gaze": "gaze"}.get(name, "expression") for name in names]
    return np.array(
        ["pose"] * (GEOMETRY_SIZE - len(EAUS)) + actuators + ["modes"] * len(components.modes)
    )
