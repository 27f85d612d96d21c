"""The sound track of a decoded video: as long as its pictures, and in time with them."""

from fractions import Fraction

import numpy as np

from decoder.sound.speech_decoder import open_speech_decoder, voice_is_decodable
from decoder.sound.speech_frames import CallSpeech
from decoder.sound.voice_decoder import VoiceDecoder
from protocol.call_parameters import CallParameters
from shared_model.arrays import Samples


class SoundTrack:
    """The decoded voice from the first picture on.

    fps: frames per second of the source.  first_picture: source frame of the first picture.
    """

    def __init__(self, voice: VoiceDecoder, fps: Fraction, first_picture: int) -> None:
        self._voice, self._fps, self._first_picture = voice, fps, first_picture
        self._start = self._position(first_picture)
        self._written, self._skip = 0, self._start % voice.frame_samples
        self._decoded = np.zeros(0, np.int16)
        voice.skip_to(self._start // voice.frame_samples)

    @property
    def rate_hz(self) -> int:
        """Samples per second."""
        return self._voice.rate_hz

    @property
    def written(self) -> int:
        """Samples that have been taken."""
        return self._written

    def take(self, pictures: int, known_until: int | None) -> Samples:
        """The sound of the first `pictures` that has not been taken, (n,) int16.

        known_until: only what comes before this speech frame; None: all.
        """
        wanted = self._position(self._first_picture + pictures) - self._start - self._written
        while len(self._decoded) < wanted:
            if known_until is not None and self._voice.next_frame >= known_until:
                break
            decoded = self._voice.decode_next()[self._skip :]
            self._decoded, self._skip = np.concatenate([self._decoded, decoded]), 0
        taken, self._decoded = np.split(self._decoded, [min(wanted, len(self._decoded))])
        self._written += len(taken)
        return taken

    def _position(self, frame: int) -> int:
        """The sample at the beginning of a source frame."""
        return round(frame * self.rate_hz / self._fps)


def open_sound_track(
    speech: CallSpeech, call: CallParameters, first_picture: int
) -> SoundTrack | None:
    """The sound track of a call; None: it has no voice, or none that can be decoded here."""
    if call.voice == "off" or not voice_is_decodable(call.voice):
        return None
    voice = VoiceDecoder(speech, open_speech_decoder(call.voice))
    return SoundTrack(voice, Fraction(call.fps_numerator, call.fps_denominator), first_picture)
