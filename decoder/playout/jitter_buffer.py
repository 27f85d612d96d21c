"""Puts packets in order and decides how long the missing ones are waited for."""

from collections.abc import Callable
from dataclasses import dataclass

from protocol.packets import ControlPacket, FramePacket

# Packets that overtake each other on the way are no further apart than this.
REORDER_S = 0.06
# Packets that may wait for one that is missing; with more, the oldest no longer do.
MAX_HELD = 64


@dataclass(frozen=True, slots=True)
class NumberedPacket:
    """A packet and its number; of a control packet: the number of the next frame packet.

    packet: None: a frame packet without a face.
    """

    number: int
    packet: FramePacket | ControlPacket | None
    arrival_s: float

    @property
    def order(self) -> tuple[int, int]:
        """A control packet comes before the frame packet with its number."""
        return self.number, not isinstance(self.packet, ControlPacket)


class JitterBuffer:
    """Holds packets while an earlier one is missing whose deadline is not past.

    deadline_s: time until which the frame packet with a number is waited for.
    next: number of the frame packet to release next; None before the first.
    is_idle: no frame packets are sent until a control packet comes, which is not held then.
    """

    def __init__(self, deadline_s: Callable[[int], float]) -> None:
        self.next: int | None = None
        self.is_idle = False
        self._deadline_s = deadline_s
        self._held: list[NumberedPacket] = []

    def start(self, number: int) -> None:
        """Let `number` be the first frame packet to release."""
        self.next = number

    def add(self, item: NumberedPacket) -> None:
        """Enter a packet; one that is there already is left out."""
        if all(item.order != other.order for other in self._held):
            self._held.append(item)
            self._held.sort(key=lambda each: each.order)

    @property
    def release_s(self) -> float | None:
        """When the first packet is released, whether or not those before it come."""
        if not self._held or self.next is None:
            return None
        first = self._held[0]
        is_awaited = self.is_idle and isinstance(first.packet, ControlPacket)
        if first.number <= self.next or is_awaited or len(self._held) > MAX_HELD:
            return first.arrival_s
        oldest_s = min(item.arrival_s for item in self._held)
        return max(self._deadline_s(first.number - 1), oldest_s + REORDER_S)

    def is_ready(self, now_s: float) -> bool:
        """Whether the next packet in order is there, or those before it are no longer waited for.

        A late packet is ready at once.
        """
        release_s = self.release_s
        return release_s is not None and now_s >= release_s

    def take(self) -> NumberedPacket:
        """The next packet in order of those that are there."""
        assert self.next is not None
        item = self._held.pop(0)
        is_frame = not isinstance(item.packet, ControlPacket)
        self.next = max(self.next, item.number + is_frame)
        return item
