"""The bytes of a call by purpose: model packets by part, frame packets by group of parameters.

The ideal code length of each decision in a frame packet, -log2 of its probability, gives the bits
of each component.  A component moves several parameters; its bits are divided among the groups in
proportion to the distortion that each group adds: a basis row is in units of equal distortion
(`FrameTransform.units`), so in proportion to the squares of its entries.
"""

from dataclasses import dataclass
from math import log2

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.range_coder import PROBABILITY_ONE
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import GEOMETRY_SIZE, FrameTransform
from protocol.frames.payload_coding import code_payload_stepwise, parse_payload
from protocol.frames.temporal_prediction import FramePredictor
from protocol.frames.transform_coding import parse_transform
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, Packet, serialise
from protocol.picture_residual.framing import split_payload
from protocol.progressive_model import LayerBuffer
from shared_model.arrays import Array
from shared_model.parameters import EAUS, LID_EAUS, THESIS_EAUS

GROUPS = ("pose", "expression", "lids", "gaze", "layers", "modes")
# Headers and the rounding to whole bytes; packets that cannot be decoded.
OVERHEAD, DAMAGED = "overhead", "damaged"
# The picture residual.
RESIDUAL = "residual"
_THESIS_VALUES = {"pose": 6, "expression": len(THESIS_EAUS)}


@dataclass(frozen=True, slots=True)
class PacketSize:
    """Payload bytes of the frame packets: mean, 95th percentile, largest."""

    mean: float
    p95: float
    largest: int


class BitAccounting:
    """Sums of the bytes of one call's packets, which are added in order."""

    def __init__(self) -> None:
        self._model_parts: dict[str, int] = {}
        self._layers, self._open_layers = LayerBuffer(), set[int]()
        self._groups: dict[str, float] = {}
        self._sizes: list[int] = []
        self._model: ModelPacket | None = None
        self._context: _FrameContext | None = None
        self._next_context: _FrameContext | None = None

    @property
    def model_parts(self) -> dict[str, int]:
        """Bytes of each part of model and layer packets, without byte 0 of each packet."""
        parts = dict(self._model_parts)
        for model in self._open_layers:
            _reclassify(parts, self._layers.bytes_by_item(model))
        return parts

    @property
    def groups(self) -> dict[str, float]:
        """Payload bytes of the frame packets by group of parameters."""
        return dict(self._groups)

    @property
    def packet_size(self) -> PacketSize | None:
        """Statistics of the frame packets' sizes; None without frame packets."""
        if not self._sizes:
            return None
        p95 = float(np.percentile(self._sizes, 95))
        return PacketSize(float(np.mean(self._sizes)), p95, max(self._sizes))

    def add(self, packet: Packet) -> None:
        """Add a packet.  The model packets before a frame packet determine how it is parsed.

        Raises `ProtocolError` if a model packet's transform or the stream of layers is damaged.
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
            transform = parse_transform(packet.profile_data)
            modes = transform.modes
            if self._model is None or packet.version > self._model.version:
                # A call that is recorded from the middle on may begin with two models.
                self._context = self._context or self._next_context
                self._next_context = _FrameContext(transform, packet.sequence)
        if self._model is None or packet.version > self._model.version:
            # Frame packets of the version before may follow; those of older ones may not.
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
        """Count the packet as shape until its version's stream is closed."""
        self._layers.add(packet)
        try:
            self._layers.bytes_by_item(packet.model_version)
        except ProtocolError:
            # The items of a damaged stream stay unknown.
            self._open_layers.discard(packet.model_version)
            raise
        size = len(serialise(packet)) - 1
        self._model_parts["shape"] = self._model_parts.get("shape", 0) + size
        self._open_layers.add(packet.model_version)

    def _close_layers(self, model: int) -> None:
        """Assign the bytes of the layers of versions before `model` to their items."""
        for older in {version for version in self._open_layers if version < model}:
            _reclassify(self._model_parts, self._layers.bytes_by_item(older))
            self._open_layers.remove(older)
        self._layers.drop_before(model)

    def _add_frame(self, packet: FramePacket) -> None:
        size = len(packet.payload)
        self._sizes.append(size)
        try:
            if self._model is not None and self._model.call.has_residual:
                packet = FramePacket(packet.sequence, split_payload(packet.payload)[1])
                self._add_group(RESIDUAL, size - len(packet.payload))
            shares = self._shares(packet)
        except ProtocolError:
            shares = {DAMAGED: 1.0}
        for name, share in shares.items():
            self._add_group(name, share * len(packet.payload))

    def _add_group(self, name: str, size: float) -> None:
        self._groups[name] = self._groups.get(name, 0.0) + size

    def _shares(self, packet: FramePacket) -> dict[str, float]:
        if self._model is None:
            raise ProtocolError("a frame packet before the model packet")
        if self._model.call.profile == "thesis":
            values = _THESIS_VALUES | (
                {"lids": len(LID_EAUS)} if self._model.call.has_eyelids else {}
            )
            total = sum(values.values())
            return {name: count / total for name, count in values.items()}
        following = self._next_context
        is_first = self._context is None
        if following and (is_first or following.packet_index(packet) < SEQUENCE_MODULUS // 2):
            self._context, self._next_context = following, None
            self._close_layers(self._model.version)
        context = self._context
        if context is None:
            raise ProtocolError("the model packet has no frame transform")
        nominal = self._model.call.frames_per_packet
        index = context.packet_index(packet)
        bits = component_bits(context.predictor, index, nominal, packet.payload)
        groups = bits @ group_shares(context.transform)
        # The coder's bytes may be fewer than the ideal length; the shares add up to 1 at most.
        whole = max(8.0 * len(packet.payload), float(groups.sum()))
        shares = dict(zip(GROUPS, (groups / whole).tolist(), strict=True))
        return shares | {OVERHEAD: 1 - sum(shares.values())}


def _reclassify(parts: dict[str, int], items: dict[str, int]) -> None:
    """Move bytes that were counted as shape to the parts they belong to."""
    for name, count in items.items():
        parts[name] = parts.get(name, 0) + count
        parts["shape"] = parts.get("shape", 0) - count


class _FrameContext:
    """How frame packets are parsed from sequence number `first` on."""

    def __init__(self, transform: FrameTransform, first: int) -> None:
        self.transform = transform
        self.predictor = FramePredictor(transform.scale_codes, transform.reserved_modes)
        self._first = first

    def packet_index(self, packet: FramePacket) -> int:
        """Index of the packet among those of its model, modulo 64."""
        return (packet.sequence - self._first) % SEQUENCE_MODULUS


def component_bits(
    predictor: FramePredictor, sequence: int, nominal_frames: int, payload: bytes
) -> Array:
    """(n,) ideal bits of each component in a payload; advances the predictor.

    Raises `ProtocolError` as `parse_payload` does.
    """
    packet = parse_payload(predictor, sequence, nominal_frames, payload)
    coder, bits, before = _IdealLengthCoder(), np.zeros(predictor.component_count), 0.0
    steps = code_payload_stepwise(
        coder, predictor, sequence, nominal_frames, packet.header, packet.values
    )
    for component in steps:
        if component is not None:
            bits[component] += coder.bits - before
        before = coder.bits
    predictor.anchor = packet.frames[-1]
    return bits


def group_shares(transform: FrameTransform) -> Array:
    """(n, GROUPS) share of each group in the distortion of each component; rows add up to 1."""
    squares = transform.basis.astype(np.float64) ** 2
    grouped = np.stack([squares[:, group_by_parameter(transform) == g].sum(1) for g in GROUPS], 1)
    return np.asarray(grouped / np.maximum(grouped.sum(1, keepdims=True), 1))


class _IdealLengthCoder:
    """A `BitCoder` that adds up ideal code lengths, `bits`."""

    def __init__(self) -> None:
        self.bits = 0.0

    def code_bit(self, bit: int, zero: int) -> int:
        self.bits -= log2((PROBABILITY_ONE - zero if bit else zero) / PROBABILITY_ONE)
        return bit


def group_by_parameter(transform: FrameTransform) -> NDArray[np.str_]:
    """(d,) name of the group of each parameter, see `FrameTransform`."""
    names = [eau.name.split("_")[0] for eau in EAUS]
    actuators = [{"lid": "lids", "gaze": "gaze"}.get(name, "expression") for name in names]
    return np.array(
        ["pose"] * (GEOMETRY_SIZE - len(EAUS))
        + actuators
        + ["layers"] * transform.layers
        + ["modes"] * len(transform.modes)
    )
