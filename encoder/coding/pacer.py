"""Leaky-bucket pacing of layer packets between the frame packets of a call."""

from encoder.coding.progressive_model import LayeredModel
from protocol.limits import MAX_LAYER_BYTES
from protocol.packets import LayerPacket
from protocol.progressive_model import stream_item

# Byte 0 of a packet and its length in a call file.
PACKET_OVERHEAD_BYTES = 2
# Bytes of a layer packet besides its data: those and its number.
LAYER_OVERHEAD_BYTES = PACKET_OVERHEAD_BYTES + 3
# The smallest fragment of an item, so that the overhead stays small.
MIN_FRAGMENT_BYTES = 64


class LayerPacer:
    """Fragments a model's items into layer packets such that all packets keep to a rate.

    A base layer is sent at once and leaves a debt; unused credit expires.
    bitrate: bits per second of all packets.  frames_bitrate: of the frame packets.
    min_fragment_bytes: of a layer packet, unless it is the end of an item.
    Raises `ValueError` if `bitrate` is not larger.
    """

    def __init__(
        self,
        bitrate: float,
        frames_bitrate: float = 0.0,
        min_fragment_bytes: int = MIN_FRAGMENT_BYTES,
    ) -> None:
        if not bitrate > frames_bitrate:
            raise ValueError(
                f"startup bitrate is {bitrate:g}, expected more than the frames' {frames_bitrate:g}"
            )
        self._bitrate, self._credit = bitrate, 0.0
        self._min_fragment_bytes = min_fragment_bytes
        self._model_version, self._next_number, self._item_count, self._added_modes = 0, 0, 0, 0
        self._pending: list[bytes] = []

    @property
    def bitrate(self) -> float:
        """Bits per second of all packets."""
        return self._bitrate

    @property
    def pending_items(self) -> int:
        """Items of the started model that are not completely sent; added modes do not count."""
        return max(0, len(self._pending) - self._added_modes)

    @property
    def sent_items(self) -> int:
        """Items that are completely sent, added modes included."""
        return self._item_count - len(self._pending)

    @property
    def busy(self) -> bool:
        """Whether items are pending, or a debt."""
        return bool(self._pending) or self._credit < 0

    def start(self, model: LayeredModel) -> None:
        """Send this model's layers from now on; pending items of an earlier model are dropped."""
        self._model_version, self._next_number = model.base.version, 0
        self._item_count, self._added_modes = len(model.items), 0
        self._pending = [stream_item(data) for data in model.items]

    def add_mode(self, data: bytes) -> None:
        """Append a mode to the items of the model."""
        self._item_count += 1
        self._added_modes += 1
        self._pending.append(stream_item(data))

    def transmission_time_s(self, packet_bytes: int) -> float:
        """Seconds that a packet of this size takes at the rate."""
        return 8 * packet_bytes / self._bitrate

    def on_packet_sent(self, packet_bytes: int) -> None:
        """Charge any other packet of the call."""
        self._credit -= 8 * (packet_bytes + PACKET_OVERHEAD_BYTES - 1)

    def packets_due(self, seconds: float) -> list[LayerPacket]:
        """The layer packets to send now.  seconds: since the last call."""
        earned = self._bitrate * seconds
        max_credit = max(earned, 8 * (self._min_fragment_bytes + LAYER_OVERHEAD_BYTES))
        self._credit = min(self._credit + earned, max_credit)
        packets = list[LayerPacket]()
        while self._pending:
            free_bytes = int(self._credit / 8) - LAYER_OVERHEAD_BYTES
            fragment = self._pending[0][: min(max(free_bytes, 0), MAX_LAYER_BYTES)]
            if len(fragment) < min(self._min_fragment_bytes, len(self._pending[0])):
                break
            packets.append(LayerPacket(self._model_version, self._next_number, fragment))
            self._next_number += 1
            self._credit -= 8 * (len(fragment) + LAYER_OVERHEAD_BYTES)
            self._pending[0] = self._pending[0][len(fragment) :]
            if not self._pending[0]:
                self._pending.pop(0)
        return packets
