"""Updates of a live call's model: sent some packets before the first frame packet under them.

On a thin link the first layers of an update go ahead, its model packet once they make it better
than what there is, then the other modes.
"""

from dataclasses import dataclass
from math import ceil

from encoder.calls.model_version import Epoch
from encoder.calls.session_stats import Tally
from encoder.calls.two_pass_session import send_layers, send_model, send_part, warn_of_missing
from encoder.coding.gop import Cadence
from encoder.coding.model_packet import Budget
from encoder.coding.progressive_model import UPDATE_LAYER_BYTES, LayeredModel, LayerPacer
from protocol.link.interface import PacketSink
from protocol.packets import SEQUENCE_MODULUS, LayerPacket
from protocol.progressive_model import PICTURES, item

# Packets by which an update is announced ahead of its first frame packet, at least and at most:
# any farther, its sequence number would pass for one before.
AHEAD, MOST_AHEAD = 4, SEQUENCE_MODULUS // 2 - 1
# Layers that make an update better than the model before: texture, background and four modes.
ENOUGH_ITEMS = 6


@dataclass(frozen=True, slots=True)
class Update:
    """A model that shall replace the one before.  parts: its layers, if it is sent in layers."""

    epoch: Epoch
    parts: LayeredModel | None


@dataclass(frozen=True, slots=True)
class Place:
    """Where a call is.

    number: of the next frame packet.  coded: source frames coded so far.
    single: whether that packet is the first of its model, which holds one frame.
    """

    number: int
    coded: int
    single: bool

    def ahead(self, packets: int, cadence: Cadence) -> tuple[int, int]:
        """Number and first source frame of the frame packet that comes after so many."""
        frames = packets * cadence.frames_per_packet
        if self.single:
            frames -= cadence.frames_per_packet - 1
        return self.number + packets, self.coded + frames * cadence.frame_step


class Announcer:
    """Numbers a live call's models and sends them, in layers where there is a pacer.

    fps: of the source.  pacer: None: models are sent whole, at once.
    """

    def __init__(
        self,
        sink: PacketSink,
        tally: Tally,
        cadence: Cadence,
        fps: float,
        pacer: LayerPacer | None,
    ) -> None:
        self._sink, self._tally, self._pacer = sink, tally, pacer
        self._cadence, self._fps = cadence, fps
        self._coming: Epoch | None = None  # whose layers are on their way

    @property
    def in_layers(self) -> bool:
        """Whether models are sent in layers."""
        return self._pacer is not None

    @property
    def busy(self) -> bool:
        """Whether there are layers to send, or a debt to pay."""
        return self._coming is not None or (self._pacer is not None and self._pacer.busy)

    def carried_s(self, budget: Budget) -> float:
        """How long the link takes for the pictures of an update."""
        if self._pacer is None:
            return 0.0
        return self._pacer.carried_s(budget.face_bytes + budget.background_bytes)

    def send(self, epoch: Epoch) -> Epoch:
        """Send the model packet of an epoch that has its place."""
        send_model(epoch.model, self._sink, self._tally, self._pacer)
        if self._pacer is not None and not epoch.model.layer:
            # Nothing replaces the first layer's pictures but an update.
            self._pacer.begin(LayeredModel(epoch.model, (b"",) * len(PICTURES)))
        return epoch

    def announce(self, update: Update, place: Place) -> Epoch | None:
        """Send an update, or begin to: the epoch to come once its model packet is sent."""
        if self._pacer is None or update.parts is None:
            return self.send(update.epoch.at(*place.ahead(AHEAD, self._cadence)))
        self._pacer.begin(update.parts)
        self._coming = update.epoch
        return None

    def grow(self, epoch: Epoch, mode: bytes) -> None:
        """Send the newest mode of the model in use."""
        if self._pacer is not None:
            self._pacer.add(mode)
            return
        number = epoch.components.spare - 1
        # All else came with the model packet.
        before = b"" if number else item(b"") * len(PICTURES)
        layer = LayerPacket(epoch.model.layer, number, before + item(mode))
        send_part(layer, self._sink, self._tally)

    def packet_sent(self, packet_bytes: int, frames: int, place: Place) -> Epoch | None:
        """Send the layers that are due after a frame packet of so many coded frames.

        Once there are enough of an update its model packet goes out: the epoch to come, then.
        """
        pacer, step = self._pacer, self._cadence.frame_step
        if pacer is None:
            return None
        send_layers(pacer, packet_bytes, frames * step / self._fps, self._sink, self._tally)
        coming = self._coming
        if coming is None or (pacer.items_sent < ENOUGH_ITEMS and pacer.items_waiting):
            return None
        self._coming = None
        packet_s = self._cadence.frames_per_packet * step / self._fps
        packets = packets_ahead(pacer.carried_s(UPDATE_LAYER_BYTES), packet_s)
        return self.send(coming.at(*place.ahead(packets, self._cadence)))

    def end(self, epoch: Epoch) -> None:
        """Say what of the models was not sent by the end of a call, `epoch` being its last."""
        if self._pacer is None:
            return
        warn_of_missing(self._pacer, self._tally)
        if epoch.model.layer == 0 and not epoch.components.spare:
            self._tally.warn("the call ended with no more of its model than a first layer")


def packets_ahead(carried_s: float, packet_s: float) -> int:
    """How many packets of `packet_s` ahead to announce what takes the link `carried_s`."""
    return min(AHEAD + ceil(carried_s / packet_s), MOST_AHEAD)
