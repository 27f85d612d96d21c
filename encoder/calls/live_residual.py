"""The picture residual of a live call: which packets get one, and how long they wait for it."""

from collections import deque
from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Future
from dataclasses import dataclass, replace

from encoder.residual.call_drawing import ResidualTask
from encoder.residual.residual_worker import ResidualWorker
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, Packet, serialise
from protocol.picture_residual.framing import join_payload
from shared_model.arrays import Picture
from shared_model.errors import UserError

# A packet waits so long for its residual, seconds.
MAX_RESIDUAL_WAIT_S = 0.25


class LiveResidual:
    """Has the residual of each frame packet coded before it is sent.

    worker: who codes; a packet whose turn comes while it still codes another one has no residual.
    warn: called with a line if the call cannot be drawn; from then on its packets have none.
    """

    def __init__(self, worker: ResidualWorker, warn: Callable[[str], None]) -> None:
        self._worker, self._warn = worker, warn
        self._sources = dict[int, Picture]()
        self._coded: Future[bytes] | None = None
        self._has_failed = False
        self._packets = self._missed = 0

    def warm_up(self, model: ModelPacket, face: bytes) -> None:
        """Warm up the worker by a model and the payload of its first frame packet."""
        packets = _with_residual(model), FramePacket(0, join_payload(b"", face))
        self._worker.warm_up([serialise(packet) for packet in packets])

    @property
    def missed_message(self) -> str | None:
        """The warning if packets had to go without a residual for want of time, else None."""
        if not self._missed or self._has_failed:
            return None
        share = f"{self._missed} of {self._packets} packets"
        return f"{share} have no picture residual: drawing the call took too long"

    def see(self, packet: Packet) -> None:
        """Take a packet without frames; packets are taken in the order in which they are sent."""
        self._worker.see(serialise(packet))

    def model(self, packet: ModelPacket) -> ModelPacket:
        """Take a model packet in this order; returns it as it is to be sent."""
        stated = _with_residual(packet)
        self.see(stated)
        return stated

    def add_source(self, index: int, picture: Picture) -> None:
        """Add a source frame, (h, w, 3) BGR, that shows a face, before its packet is coded."""
        if not self._has_failed:
            self._sources[index] = picture

    def begin_packet(
        self, number: int, face: bytes, covered: range, seconds: float, has_time: bool
    ) -> "Future[bytes] | None":
        """Have the residual of frame packet `number` of the call coded.  None: it gets none.

        face: the packet's faces.  covered: its source frames.  seconds: of the call.
        has_time: whether there is time for it.
        """
        packet = FramePacket(number % SEQUENCE_MODULUS, join_payload(b"", face))
        self._worker.see(serialise(packet))
        sources = {i: picture for i, picture in self._sources.items() if i in covered}
        self._sources = {i: each for i, each in self._sources.items() if i >= covered.stop}
        is_busy = self._coded is not None and not self._coded.done()
        if self._has_failed or not sources:
            return None
        self._packets += 1
        if is_busy or not has_time:
            self._missed += 1
            return None
        # A header byte, and the length of the residual.
        task = ResidualTask(covered, sources, seconds, 8 * (len(face) + 2))
        self._coded = self._worker.block(task)
        return self._coded

    def payload(self, coded: "Future[bytes] | None", face: bytes) -> bytes:
        """The payload of a frame packet, with the residual that is coded by now.

        coded: see `begin_packet`.
        """
        block = b""
        if coded is not None and not coded.done():
            self._missed += 1
        elif coded is not None:
            try:
                block = coded.result()
            except UserError as error:
                self._has_failed = True
                self._warn(f"without a picture residual: {error}")
            except ChildProcessError:
                # That has been told.
                self._has_failed = True
        return join_payload(block, face)


def _with_residual(packet: ModelPacket) -> ModelPacket:
    return replace(packet, call=replace(packet.call, has_residual=True))


@dataclass(frozen=True, slots=True)
class _Waiting:
    """What is sent once a residual is coded, or at a time of the clock.

    coded: the residual; None: it need not wait.
    """

    send: Callable[[], object]
    coded: "Future[bytes] | None"
    until_s: float


class SendQueue:
    """Sends one thing after the other; frame packets wait for their residual.

    clock: seconds from any origin.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._waiting, self._clock = deque[_Waiting](), clock

    def put(self, send: Callable[[], object], coded: "Future[bytes] | None" = None) -> None:
        """Send after what waits, and once a residual is coded, if there is one to wait for."""
        self._waiting.append(_Waiting(send, coded, self._clock() + MAX_RESIDUAL_WAIT_S))
        self.send_due()

    def send_due(self) -> None:
        """Send what need not wait, or has waited for long enough."""
        while self._waiting and self._left_s(self._waiting[0]) <= 0:
            self._waiting.popleft().send()

    def send_all(self) -> None:
        """Send what waits, each once it is due."""
        while self._waiting:
            first = self._waiting[0]
            if first.coded is not None:
                futures.wait([first.coded], max(self._left_s(first), 0))
            self._waiting.popleft().send()

    def _left_s(self, waiting: _Waiting) -> float:
        if waiting.coded is None or waiting.coded.done():
            return 0.0
        return waiting.until_s - self._clock()
