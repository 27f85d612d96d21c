"""The sound track of a video file: FLAC in .mkv, PCM in .avi, Opus in .webm, else AAC."""

from typing import Literal

import av
from av.audio.stream import AudioStream
from av.container import OutputContainer

from shared_model.arrays import Samples

SOUND_CODECS: dict[str, Literal["flac", "pcm_s16le", "aac", "libopus"]] = {
    ".mkv": "flac",
    ".avi": "pcm_s16le",
    ".mp4": "aac",
    ".mov": "aac",
    ".webm": "libopus",
}
LOSSY_BPS = 64_000


class SoundStream:
    """A mono sound track in an open video file.

    suffix: of the file.  rate_hz: samples per second.  bits_per_second: of a codec that is lossy.
    packet_ms: length of Opus' packets.
    """

    def __init__(
        self,
        container: OutputContainer,
        suffix: str,
        rate_hz: int,
        bits_per_second: int = LOSSY_BPS,
        packet_ms: int = 20,
    ) -> None:
        codec = SOUND_CODECS[suffix]
        self._container, self._rate_hz, self._written = container, rate_hz, 0
        self._stream: AudioStream = container.add_stream(codec, rate=rate_hz, layout="mono")
        if codec in ("aac", "libopus"):
            self._stream.bit_rate = bits_per_second
        if codec == "libopus":
            self._stream.options = {"frame_duration": str(packet_ms)}

    def write(self, samples: Samples) -> None:
        """Add samples, (n,) int16."""
        if not len(samples):
            return
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate, frame.pts = self._rate_hz, self._written
        self._written += len(samples)
        self._container.mux(self._stream.encode(frame))

    def finish(self) -> None:
        """Write what the codec has kept."""
        self._container.mux(self._stream.encode(None))
