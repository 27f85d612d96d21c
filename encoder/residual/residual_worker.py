"""Who codes the residual of a live call: this process, or one of its own."""

import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import closing, suppress
from typing import Protocol

import numpy as np

from encoder.residual.call_drawing import CallDrawing, ResidualTask
from encoder.residual.draw_call import DrawCall
from runtime.parallel import lower_priority_of_process
from runtime.remote_calls import RemoteCalls, answer_calls
from shared_model.errors import UserError


class ResidualWorker(Protocol):
    """Does what it is asked in this order; what it returns may be done later."""

    def warm_up(self, packets: Sequence[bytes]) -> None:
        """Draw a call of one frame, so that the first packet does not wait for libraries, compiled
        loops and a GL context.
        """

    def see(self, packet: bytes, first_wanted: int = 0) -> None:
        """See `CallDrawing`."""

    def block(self, task: ResidualTask) -> "Future[bytes]":
        """The residual of the packet that was seen last, empty if it has none.

        Its result is a `UserError` if the call cannot be drawn.
        """

    def close(self) -> None:
        """End it."""


class LocalResidual:
    """A `ResidualWorker` in this process, see `CallDrawing`: what it returns is done."""

    def __init__(self, draw: DrawCall, size: tuple[int, int], bitrate: float) -> None:
        self._draw, self._size, self._bitrate = draw, size, bitrate
        self._drawing = CallDrawing(draw, size, bitrate)

    def warm_up(self, packets: Sequence[bytes]) -> None:
        """See `ResidualWorker`."""
        width, height = self._size
        grey = np.full((height, width, 3), 128, np.uint8)
        drawing = CallDrawing(self._draw, self._size, self._bitrate)
        # Whether a call can be drawn is told when it is.
        with closing(drawing), suppress(UserError):
            for packet in packets:
                drawing.see(packet)
            drawing.block(ResidualTask(range(1), {0: grey}, 1.0, 0.0))

    def see(self, packet: bytes, first_wanted: int = 0) -> None:
        """See `CallDrawing`."""
        self._drawing.see(packet, first_wanted)

    def block(self, task: ResidualTask) -> "Future[bytes]":
        """See `CallDrawing`."""
        result = Future[bytes]()
        try:
            result.set_result(self._drawing.block(task))
        except Exception as error:  # for whoever waits for it
            result.set_exception(error)
        return result

    def close(self) -> None:
        """See `CallDrawing`."""
        self._drawing.close()


class ResidualProcess:
    """A `ResidualWorker` in a process of its own, at a lower priority.

    draw: as `pickle` finds it.
    on_failure: called once with a line if the process ends by itself or fails.
    """

    def __init__(
        self,
        draw: DrawCall,
        size: tuple[int, int],
        bitrate: float,
        on_failure: Callable[[str], None],
    ) -> None:
        def fail(reason: str) -> None:
            on_failure(f"{reason}: from here on without a picture residual")

        self._calls = RemoteCalls(__name__, fail)
        self._begun = self._calls.call_awaited("begin", draw, size, bitrate)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._calls.pid

    def warm_up(self, packets: Sequence[bytes]) -> None:
        """See `ResidualWorker`; waits for it."""
        with suppress(ChildProcessError):
            self._begun.result()
            self._calls.call_awaited("warm_up", packets).result()

    def see(self, packet: bytes, first_wanted: int = 0) -> None:
        """See `CallDrawing`."""
        self._calls.call("see", packet, first_wanted)

    def block(self, task: ResidualTask) -> "Future[bytes]":
        """See `ResidualWorker`; a `ChildProcessError` if the process is gone or has failed."""
        return self._calls.call_awaited("block", task)

    def close(self) -> None:
        """End the process."""
        self._calls.close()


class _Server:
    def __init__(self) -> None:
        self._worker: LocalResidual | None = None

    def begin(self, draw: DrawCall, size: tuple[int, int], bitrate: float) -> None:
        self._worker = LocalResidual(draw, size, bitrate)

    def warm_up(self, packets: Sequence[bytes]) -> None:
        assert self._worker is not None
        self._worker.warm_up(packets)

    def see(self, packet: bytes, first_wanted: int = 0) -> None:
        assert self._worker is not None
        self._worker.see(packet, first_wanted)

    def block(self, task: ResidualTask) -> "Future[bytes]":
        assert self._worker is not None
        return self._worker.block(task)


def serve(descriptor: int) -> None:
    """Code the residual for the process at the other end of a socket until it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lower_priority_of_process()
    answer_calls(descriptor, _Server())
    os._exit(0)
