"""The speech frames of a call that have been received, by their number."""

from bisect import bisect, insort

# The packets of which it is remembered what they brought.
MAX_BLOCKS = 16


class SpeechFrames:
    """Speech frames by number: bytes, b"" for a silent one; None: not received.

    Frames between those of two successive packets are silent: nothing was sent for them.
    """

    def __init__(self) -> None:
        self._frames: dict[int, bytes] = {}
        # Number, first frame and frame after the last of the newest packets, in order.
        self._blocks: list[tuple[int, int, int]] = []

    @property
    def known_until(self) -> int:
        """No frame before this number comes any more, unless its packet is late."""
        return self._blocks[-1][1] if self._blocks else 0

    @property
    def received_until(self) -> int:
        """The frame after the last one that has been received; before it as `known_until`."""
        return self._blocks[-1][2] if self._blocks else 0

    def add(self, number: int, first: int, frames: tuple[bytes | None, ...]) -> None:
        """Enter the frames of packet `number` of the call, the first one being frame `first`."""
        block = number, first, first + len(frames)
        self._frames.update({first + i: frame or b"" for i, frame in enumerate(frames)})
        place = bisect(self._blocks, block)
        insort(self._blocks, block)
        for before in range(max(place - 1, 0), min(place + 1, len(self._blocks) - 1)):
            self._fill_silence(self._blocks[before], self._blocks[before + 1])
        del self._blocks[:-MAX_BLOCKS]

    def _fill_silence(self, before: tuple[int, int, int], after: tuple[int, int, int]) -> None:
        """Enter what lies between two packets, unless others are missing there."""
        if after[0] - before[0] <= 1:
            for index in range(before[2], after[1]):
                self._frames.setdefault(index, b"")

    def get(self, index: int) -> bytes | None:
        """The frame of a number."""
        return self._frames.get(index)

    def drop_before(self, index: int) -> None:
        """Forget the frames before a number, which have been played."""
        for old in [number for number in self._frames if number < index]:
            del self._frames[old]
