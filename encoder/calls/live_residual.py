"""The picture residual of a live call: which of its packets get one."""

from collections.abc import Callable
from concurrent.futures import Future

from encoder.residual.call_drawing import ResidualTask
from encoder.residual.residual_encoder import spent_bits, with_residual_stated
from encoder.residual.residual_worker import ResidualWorker
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, Packet, serialise
from protocol.picture_residual.framing import join_payload
from shared_model.arrays import Picture

# A worker that is too slow works for nothing: after residuals in a row that came too late 0, 1, 3,
# 7 packets go without, so many at most.
MAX_PAUSE = 15


class LiveResidual:
    """Has the residual of frame packets coded before they are sent.

    worker: who codes; a packet whose turn comes while it still codes another one has no residual.
    warn: called with a line if the call cannot be drawn; from then on its packets have none.
    missed: number of packets that have none for want of time.
    """

    def __init__(self, worker: ResidualWorker, warn: Callable[[str], None]) -> None:
        self._worker, self._warn = worker, warn
        self._sources = dict[int, Picture]()
        self._coded: Future[bytes] | None = None
        self._has_failed, self._was_sent = False, True
        self._packets = self._pause = self._next_pause = 0
        self.missed = 0

    def warm_up(self, model: ModelPacket, face: bytes) -> None:
        """Warm up the worker by a model and the payload of its first frame packet."""
        packets = with_residual_stated(model), FramePacket(0, join_payload(b"", face))
        self._worker.warm_up([serialise(packet) for packet in packets])

    @property
    def missed_message(self) -> str | None:
        """The warning if packets had to go without a residual for want of time, else None."""
        if not self.missed or self._has_failed:
            return None
        share = f"{self.missed} of {self._packets} packets"
        return f"{share} have no picture residual: drawing the call took too long"

    def add_model(self, packet: ModelPacket) -> ModelPacket:
        """Add a model packet as `add_packet`; returns it as it is to be sent."""
        stated = with_residual_stated(packet)
        self.add_packet(stated)
        return stated

    def add_packet(self, packet: Packet, first_wanted: int = 0) -> None:
        """Draw with a packet, too; all are added in the order in which they are sent.

        first_wanted: no residual of an earlier frame will be asked for.
        """
        if not self._has_failed:
            self._worker.see(serialise(packet), first_wanted)

    def add_source(self, index: int, picture: Picture) -> None:
        """Add a source frame, (h, w, 3) BGR, that shows a face, before its packet is coded."""
        if not self._has_failed:
            self._sources[index] = picture

    def begin_packet(
        self, number: int, face: bytes, covered: range, seconds: float, has_time: bool
    ) -> "Future[bytes] | None":
        """Have the residual of frame packet `number` of the call coded.  None: it gets none.

        face: the packet's faces.  covered: its source frames.
        seconds: from its first frame to that of the next packet.
        has_time: whether there is time for it.
        """
        packet = FramePacket(number % SEQUENCE_MODULUS, join_payload(b"", face))
        sources = {i: picture for i, picture in self._sources.items() if i in covered}
        self._sources = {i: each for i, each in self._sources.items() if i >= covered.stop}
        is_tried = bool(sources) and self._may_try(has_time)
        self.add_packet(packet, covered.start if is_tried else covered.stop)
        if not is_tried:
            return None
        task = ResidualTask(covered, sources, seconds, spent_bits(face), self._was_sent)
        self._coded, self._was_sent = self._worker.block(task), True
        return self._coded

    def payload(self, coded: "Future[bytes] | None", face: bytes) -> bytes:
        """The payload of a frame packet, with the residual if that is coded by now.

        coded: see `begin_packet`.
        """
        if coded is not None and not coded.done():
            self._was_sent = False
            self.missed += 1
            self._pause, self._next_pause = self._next_pause, 2 * self._next_pause + 1
            self._next_pause = min(self._next_pause, MAX_PAUSE)
            return join_payload(b"", face)
        if coded is not None:
            self._next_pause = 0
        return join_payload(self._block_of(coded), face)

    def _may_try(self, has_time: bool) -> bool:
        """Whether the next packet's residual may come in time; counts those that are not tried."""
        is_busy = self._coded is not None and not self._coded.done()
        if not is_busy:
            self._block_of(self._coded)
        if self._has_failed:
            return False
        self._packets += 1
        is_paused = self._pause > 0
        self._pause = max(self._pause - 1, 0)
        if is_busy or is_paused or not has_time:
            self.missed += 1
            return False
        return True

    def _block_of(self, coded: "Future[bytes] | None") -> bytes:
        """What is coded, and done; nothing if that has failed, which is told once."""
        if coded is None or self._has_failed:
            return b""
        try:
            return coded.result()
        except ChildProcessError:
            pass  # has been told when the process ended or failed
        except Exception as error:  # of what draws: the call goes on without it
            self._warn(f"without a picture residual: {error}")
        self._has_failed = True
        return b""

    def close(self) -> None:
        """End the worker; closing twice has no further effect."""
        self._worker.close()
