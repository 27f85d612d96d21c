"""What carries the packets of a call, a file or a network: the same to both ends."""

from collections.abc import Iterator
from typing import Protocol, Self


class PacketSink(Protocol):
    """Takes the packets of one call in order."""

    def send(self, packet: bytes) -> None:
        """Pass on one serialised packet."""

    def close(self) -> None:
        """Finish; what was sent is kept or delivered."""

    def __enter__(self) -> Self:
        """Itself; closed on leaving the block, whatever happened in it."""

    def __exit__(self, *exception: object) -> None:
        """Close."""


class PacketSource(Protocol):
    """Yields the packets of one call in order, unparsed.

    complete: the END packet has been handed out.
    ended: nothing more will come.
    """

    @property
    def complete(self) -> bool: ...

    @property
    def ended(self) -> bool: ...

    def receive(self, timeout_s: float | None = None) -> bytes | None:
        """The next packet, waiting at most `timeout_s`; None if none came in time or `ended`."""

    def __iter__(self) -> Iterator[bytes]:
        """All packets until `ended`."""

    def close(self) -> None:
        """Let go of the file or the network."""

    def __enter__(self) -> Self:
        """Itself; closed on leaving the block."""

    def __exit__(self, *exception: object) -> None:
        """Close."""
