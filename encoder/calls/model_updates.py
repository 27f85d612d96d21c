"""Sends the versions of a live call's model, each some packets before the first one that needs it.

Without a pacer a version goes out whole, in its model packet.  With one (a thin link) the first
layers of an update go ahead, between frame packets; its model packet follows once they make the
update better than the version in use, and the other modes after that.
"""

from dataclasses import dataclass
from math import ceil

from encoder.calls.packet_sender import LEAD_PACKETS, MAX_LEAD_PACKETS, PacketSender
from encoder.calls.session_stats import SessionStats
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import ModelBudget
from encoder.coding.progressive_model import UPDATE_BASE_LAYER_BYTES, LayeredModel
from encoder.live_model.model_version import ModelVersion
from protocol.packets import LayerPacket
from protocol.progressive_model import PICTURE_ITEMS, stream_item

# Layers that make an update better than the version before: texture, background and four modes.
MIN_ITEMS_BEFORE_SWITCH = 6


@dataclass(frozen=True, slots=True)
class StreamPosition:
    """How far a call has been sent.

    packet: number of the next frame packet.
    frame: source frame that it begins with.
    is_first: whether it is the first of its version.
    """

    packet: int
    frame: int
    is_first: bool

    def packet_frames(self, gop: GopStructure) -> int:
        """How many frames the next packet holds."""
        return 1 if self.is_first else gop.frames_per_packet

    def frames_to_last(self, index: int, gop: GopStructure) -> int:
        """How many coded frames come after source frame `index` in its packet."""
        most = gop.frames_per_packet
        place = (index - self.frame) // gop.frame_step + most - self.packet_frames(gop)
        return most - 1 - place % most

    def after(self, packets: int, gop: GopStructure) -> tuple[int, int]:
        """Number and first source frame of the frame packet after so many."""
        frames = packets * gop.frames_per_packet
        if self.is_first:
            frames -= gop.frames_per_packet - 1
        return self.packet + packets, self.frame + frames * gop.frame_step


class ModelUpdateSender:
    """Sends model versions, and the modes that are learned in addition to a version.

    packets: with a pacer versions are sent in layers.  fps: of the source.
    lead: packets from an update to the first one that needs it.
    """

    def __init__(
        self,
        packets: PacketSender,
        stats: SessionStats,
        gop: GopStructure,
        fps: float,
        lead: int = LEAD_PACKETS,
    ) -> None:
        self._packets, self._stats, self._pacer = packets, stats, packets.pacer
        self._gop, self._fps, self._lead = gop, fps, lead
        self._pending: ModelVersion | None = None  # its layers are sent, its packet is not

    @property
    def progressive(self) -> bool:
        """Whether versions are sent in layers."""
        return self._pacer is not None

    @property
    def busy(self) -> bool:
        """Whether there are layers to send, or the pacer is in debt."""
        return self._pending is not None or (self._pacer is not None and self._pacer.busy)

    def transmission_time_s(self, budget: ModelBudget) -> float:
        """How long the link takes for the layers of an update of this size."""
        if self._pacer is None:
            return 0.0
        return self._pacer.transmission_time_s(budget.appearance_bytes + budget.background_bytes)

    def send_first(self, version: ModelVersion) -> None:
        """Send the first version."""
        self._packets.send_model(version.packet)
        if self._pacer is not None:
            # Only an update replaces the pictures of the base layer.
            self._pacer.start(LayeredModel(version.packet, (b"",) * len(PICTURE_ITEMS)))

    def start_update(self, update: ModelVersion, position: StreamPosition) -> ModelVersion | None:
        """Send an update, or the first of its layers.

        Returns the update with its place in the call; None: see `take_announced`.
        """
        if self._pacer is None or update.layers is None:
            return self._announce(update, self._lead, position)
        self._pacer.start(update.layers)
        self._pending = update
        return None

    def take_announced(self, position: StreamPosition) -> ModelVersion | None:
        """Send the packet of an update of which enough layers have been sent.

        Asked after each frame packet.  Returns the update with its place in the call, once.
        """
        pacer, update = self._pacer, self._pending
        if pacer is None or update is None:
            return None
        if pacer.sent_items < MIN_ITEMS_BEFORE_SWITCH and pacer.pending_items:
            return None
        self._pending = None
        packet_s = self._gop.frames_per_packet * self._gop.frame_step / self._fps
        lead = lead_packets(pacer.transmission_time_s(UPDATE_BASE_LAYER_BYTES), packet_s)
        return self._announce(update, lead, position)

    def send_mode(self, version: ModelVersion, mode: bytes) -> None:
        """Send the newest of a version's learned modes, coded."""
        if self._pacer is not None:
            self._pacer.add_mode(mode)
            return
        number = version.learned_modes - 1
        # Everything else of the version was in its model packet.
        before = b"" if number else stream_item(b"") * len(PICTURE_ITEMS)
        data = before + stream_item(mode)
        self._packets.send_layer(LayerPacket(version.number, number, data))

    def warn_of_incomplete_model(self, last: ModelVersion) -> None:
        """Add warnings about what was not sent when a call ends, `last` being in use."""
        if self._pacer is None:
            return
        self._packets.warn_of_incomplete_model()
        if not last.number and not last.learned_modes:
            self._stats.warn("the call ended with no more of its model than a first layer")

    def _announce(self, update: ModelVersion, lead: int, position: StreamPosition) -> ModelVersion:
        placed = update.placed_at(*position.after(lead, self._gop))
        self._packets.send_model(placed.packet)
        return placed


def lead_packets(transmission_s: float, packet_s: float) -> int:
    """How many packets of `packet_s` ahead to announce what the link takes `transmission_s` for."""
    return min(LEAD_PACKETS + ceil(transmission_s / packet_s), MAX_LEAD_PACKETS)
