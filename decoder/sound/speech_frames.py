"""The speech frames that have been received: of one start of the encoder, and of a whole call."""

from bisect import bisect, bisect_right, insort

# The packets of which it is remembered what they brought.
MAX_BLOCKS = 16


class SpeechFrames:
    """Speech frames by number: bytes, b"" for a silent one; None: not received.

    Frames between those of two successive packets are silent: nothing was sent for them.
    """

    def __init__(self) -> None:
        self._frames: dict[int, bytes] = {}
        # First silent frame and the frame after the last, in order; hours of silence are one entry.
        self._silences: list[tuple[int, int]] = []
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
        silence = before[2], after[1]
        if after[0] - before[0] <= 1 and silence[0] < silence[1] and silence not in self._silences:
            insort(self._silences, silence)

    def get(self, index: int) -> bytes | None:
        """The frame of a number."""
        if (frame := self._frames.get(index)) is not None:
            return frame
        place = bisect_right(self._silences, index, key=lambda silence: silence[0]) - 1
        return b"" if place >= 0 and index < self._silences[place][1] else None

    def drop_before(self, index: int) -> None:
        """Forget the frames before a number, which have been played."""
        for old in [number for number in self._frames if number < index]:
            del self._frames[old]
        self._silences = [silence for silence in self._silences if silence[1] > index]


class CallSpeech:
    """Speech frames by their number in the call, see `SpeechFrames`.

    An encoder that starts again counts from 0: its frames are displaced.
    """

    def __init__(self, speech: SpeechFrames) -> None:
        self._speech, self._start, self._offset = speech, 0, 0
        self._before: CallSpeech | None = None

    @property
    def known_until(self) -> int:
        """No frame before this number comes any more, unless its packet is late."""
        return max(self._start, self._speech.known_until + self._offset)

    @property
    def received_until(self) -> int:
        """The frame after the last one that has been received; before it as `known_until`."""
        return max(self._start, self._speech.received_until + self._offset)

    def get(self, index: int) -> bytes | None:
        """The frame of a number; None: not received."""
        if index < self._start:
            return self._before.get(index) if self._before is not None else None
        return self._speech.get(index - self._offset)

    def drop_before(self, index: int) -> None:
        """Forget the frames before a number, which have been played."""
        if self._before is not None:
            self._before.drop_before(index)
        if index >= self._start:
            self._before = None
        self._speech.drop_before(index - self._offset)

    def go_on(self, speech: SpeechFrames, start: int, offset: int) -> None:
        """From frame `start` on take those of an encoder that has started again.

        offset: the number in the call of its frame 0.
        """
        before = CallSpeech(self._speech)
        before._start, before._offset, before._before = self._start, self._offset, self._before
        self._before, self._speech, self._start, self._offset = before, speech, start, offset
