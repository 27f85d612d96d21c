"""The voice of a source, as the options ask for it and the host can code it."""

from encoder.sound.recorded_speech import RecordedSpeech
from encoder.sound.sound_file import Warn, has_sound
from encoder.sound.speech_encoder import voice_is_installed
from encoder.sound.voice_packer import VoicePacker
from protocol.limits import USUAL_VOICE


def chosen_voice(source: str, asked: str | None) -> tuple[str, str | None]:
    """The codec for a source, one of `VOICES`, and a warning if it is not what one may expect.

    asked: one of `VOICES`; None: the usual one where there is sound and the codec is installed.
    """
    if asked == "off":
        return "off", None
    if not has_sound(source):
        return "off", None if asked is None else f"{source} has no sound: the call has no voice"
    if asked is None and not voice_is_installed(USUAL_VOICE):
        return "off", "the sound is left out: pip install '.[voice]' to send it"
    return asked or USUAL_VOICE, None


def open_voice(source: str, voice: str, warn: Warn = lambda line: None) -> VoicePacker | None:
    """What adds the voice of a source to its packets; None for "off".

    warn: see `read_sound`.  Raises `UserError` if the codec is not installed.
    """
    return None if voice == "off" else VoicePacker(RecordedSpeech(source, voice, warn))
