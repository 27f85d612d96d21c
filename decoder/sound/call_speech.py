"""The speech frames of a whole call, in which the encoder may have been started several times."""

from decoder.sound.speech_frames import SpeechFrames


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
