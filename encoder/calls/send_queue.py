"""Sends one thing after the other where some have to wait for what is computed meanwhile."""

from collections import deque
from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

# What waits is sent after so many seconds in any case.
MAX_WAIT_S = 0.25


@dataclass(frozen=True, slots=True)
class _Waiting:
    """What is sent once `result` is done, or at a time of the clock.

    result: None: it need not wait.
    """

    send: Callable[[], object]
    result: "Future[Any] | None"
    until_s: float


class SendQueue:
    """Calls what sends, in order.

    clock: seconds from any origin.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._waiting, self._clock = deque[_Waiting](), clock

    def put(self, send: Callable[[], object], result: "Future[Any] | None" = None) -> None:
        """Call `send` after what waits, and once a result is done, if there is one to wait for."""
        self._waiting.append(_Waiting(send, result, self._clock() + MAX_WAIT_S))
        self.send_due()

    def send_due(self) -> None:
        """Send what need not wait, or has waited for long enough."""
        while self._waiting and self._left_s(self._waiting[0]) <= 0:
            self._waiting.popleft().send()

    def send_all(self) -> None:
        """Send what waits, each once it is due."""
        while self._waiting:
            first = self._waiting[0]
            if first.result is not None:
                futures.wait([first.result], max(self._left_s(first), 0))
            self._waiting.popleft().send()

    def _left_s(self, waiting: _Waiting) -> float:
        if waiting.result is None or waiting.result.done():
            return 0.0
        return waiting.until_s - self._clock()
