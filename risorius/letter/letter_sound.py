"""The voice of a call as a browser plays it: Opus, whatever codec carried it in the call."""

from pathlib import Path
from tempfile import TemporaryDirectory

from decoder.playout.received_frames import DecodeStats, received_frames
from decoder.playout.receiver import Receiver
from decoder.sinks.sound_file import SoundFile
from decoder.sound.sound_track import open_sound_track
from protocol.call_file import CallReader

# Speech that Codec2 has carried needs no more.
OPUS_BPS = 6000


def letter_sound(call: Path) -> tuple[bytes | None, str]:
    """The sound of a call file from its first picture on, a WebM file; and a warning, or nothing.

    None: the call is silent, or its codec is not installed.
    """
    stats = DecodeStats()
    receiver = Receiver(on_damage=lambda error: None, kept_speech_s=1 << 30)
    with CallReader(call) as reader:
        shown = [
            frame
            for frames in received_frames(reader, receiver, stats, lambda: False)
            for frame in frames
        ]
    if not shown or receiver.model is None or receiver.model.call.voice == "off":
        return None, ""
    voice = receiver.model.call.voice
    track = open_sound_track(receiver.speech, receiver.model.call, shown[0].index)
    if track is None:
        return None, f"without the voice ({voice}): pip install '.[voice]' to put it in"
    with TemporaryDirectory() as folder:
        path = Path(folder) / "sound.webm"
        with SoundFile(path, track.rate_hz, OPUS_BPS) as file:
            file.write(track.take(len(shown), None))
        return path.read_bytes(), ""
