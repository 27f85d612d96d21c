"""Copies of frame packets that go out a little later, for decoders that may not get the first."""

from collections.abc import Iterator

# A copy of a packet so far behind the next one might be taken for one that is ahead of it.
MAX_BEHIND = 12


class FrameCopies:
    """Copies that wait for their time."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, int, bytes]] = []

    def add(self, due_s: float, number: int, packet: bytes) -> None:
        """Send a copy of frame packet `number` at a time."""
        self._waiting.append((due_s, number, packet))

    def due(self, now_s: float, next_number: int) -> Iterator[bytes]:
        """Those whose time has come, but for those too far behind."""
        for due_s, number, packet in self._waiting:
            if due_s <= now_s and next_number - number <= MAX_BEHIND:
                yield packet
        self._waiting = [each for each in self._waiting if each[0] > now_s]
