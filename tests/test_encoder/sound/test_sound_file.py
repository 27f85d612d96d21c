"""Sound tracks of video files that people have: one test for each kind, on a file that it makes."""

import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import cast

import av
import numpy as np
import pytest
from av.audio.stream import AudioStream
from numpy.typing import NDArray

from encoder.sound.sound_file import has_sound, read_sound
from shared_model.arrays import Array

RATE_HZ = 8000
SECONDS = 2.0


def tone(rate_hz: int, seconds: float = SECONDS) -> Array:
    """A tone of 440 Hz, half as loud as can be, (n,); silent before half a second."""
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    return np.asarray(0.5 * np.sin(2 * np.pi * 440 * time_s) * (time_s >= 0.5))


@dataclass
class Track:
    """channels: (c, n) -1..1.  start_s: time of the first sample.  jump_s: at half of them."""

    channels: Array
    rate_hz: int = 48000
    layout: str = "mono"
    codec: str = "flac"
    format: str = "s16"
    start_s: float = 0.0
    jump_s: float = 0.0
    warnings: list[str] = field(default_factory=list)


def write(path: Path, track: Track, frames: int = 50, first_picture_s: float = 0.0) -> None:
    """A video of black pictures, 25 a second, with a sound track in pieces of 20 ms."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        video.codec_context.time_base = Fraction(1, 1000)
        sound = cast(AudioStream, container.add_stream(track.codec, rate=track.rate_hz))
        sound.layout, sound.format = track.layout, track.format
        for number in range(frames):
            black = np.zeros((72, 64), np.uint8)
            frame = av.VideoFrame.from_ndarray(black, format="yuv420p")
            frame.pts = round(1000 * (first_picture_s + number / 25))
            frame.time_base = Fraction(1, 1000)
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        piece = track.rate_hz // 50
        count = track.channels.shape[1]
        for first in range(0, count, piece):
            part = track.channels[:, first : first + piece]
            made = packed(part, track.format, track.layout)
            made.sample_rate = track.rate_hz
            made.time_base = Fraction(1, track.rate_hz)
            late_s = track.start_s + (track.jump_s if first >= count // 2 else 0.0)
            made.pts = first + round(late_s * track.rate_hz)
            container.mux(sound.encode(made))
        container.mux(sound.encode(None))


def packed(part: Array, kind: str, layout: str) -> av.AudioFrame:
    interleaved = part.T.reshape(1, -1)
    if kind == "u8":
        data: NDArray[np.generic] = np.rint(127 * interleaved + 128).astype(np.uint8)
    else:
        data = np.rint(32767 * interleaved).astype(np.int16)
    return av.AudioFrame.from_ndarray(data, kind, layout)  # type: ignore[arg-type]


def read(path: Path, warnings: list[str] | None = None) -> Array:
    """The track as it is heard, (n,) -1..1."""
    said = list[str]() if warnings is None else warnings
    return np.concatenate(list(read_sound(path, RATE_HZ, said.append))) / 32768


def begin_s(sound: Array) -> float:
    """When the tone begins."""
    return float(np.flatnonzero(np.abs(sound) > 0.05)[0]) / RATE_HZ


def loudness(sound: Array) -> float:
    return float(np.abs(sound[round(0.7 * RATE_HZ) : round(1.7 * RATE_HZ)]).max())


@pytest.mark.parametrize(
    ("rate_hz", "layout", "codec", "kind"),
    [
        (44100, "mono", "flac", "s16"),
        (48000, "stereo", "flac", "s16"),
        (48000, "5.1", "flac", "s16"),
        (8000, "mono", "pcm_u8", "u8"),
        (96000, "stereo", "pcm_s16le", "s16"),
    ],
)
def test_rates_channels_and_depths(
    tmp_path: Path, rate_hz: int, layout: str, codec: str, kind: str
) -> None:
    count = {"mono": 1, "stereo": 2, "5.1": 6}[layout]
    track = Track(np.tile(tone(rate_hz), (count, 1)), rate_hz, layout, codec, kind)
    write(tmp_path / "v.mkv", track)
    sound = read(tmp_path / "v.mkv", track.warnings)
    assert len(sound) / RATE_HZ == pytest.approx(SECONDS, abs=0.05)
    assert begin_s(sound) == pytest.approx(0.5, abs=0.02)
    assert 0.3 < loudness(sound) <= 1 and track.warnings == []


@pytest.mark.parametrize("start_s", [-0.3, 0.4, 3.0])
def test_sound_that_begins_at_another_time_than_the_pictures(
    tmp_path: Path, start_s: float
) -> None:
    path = tmp_path / "v.mkv"
    write(path, Track(tone(48000)[None], start_s=1 + start_s), first_picture_s=1.0)
    assert begin_s(read(path)) == pytest.approx(0.5 + start_s, abs=0.05)


def test_pictures_that_begin_between_key_frames_do_not_move_the_sound(tmp_path: Path) -> None:
    write(tmp_path / "whole.ts", Track(tone(48000)[None], codec="mp2"))
    names = str(tmp_path / "whole.ts"), str(tmp_path / "v.ts")
    with av.open(names[0]) as whole, av.open(names[1], "w") as container:
        made = {s.index: container.add_stream_from_template(s) for s in whole.streams}
        pictures = 0
        for packet in whole.demux():
            is_picture = packet.stream.type == "video"
            pictures += is_picture
            # The key frame and four pictures that need it are lost.
            if packet.size and not (is_picture and pictures <= 5):
                packet.stream = made[packet.stream.index]
                container.mux(packet)
    with av.open(str(tmp_path / "v.ts")) as cut:
        first = next(cut.decode(video=0))
        assert first.pts is not None and first.time_base is not None
        shown_s = float(first.pts * first.time_base)
    with av.open(str(tmp_path / "whole.ts")) as whole:
        first = next(whole.decode(video=0))
        assert first.pts is not None and first.time_base is not None
        shown_s -= float(first.pts * first.time_base)
    assert shown_s > 0.1
    before, after = begin_s(read(tmp_path / "whole.ts")), begin_s(read(tmp_path / "v.ts"))
    assert after == pytest.approx(before - shown_s, abs=0.05)


def test_sound_that_is_longer_than_the_pictures_is_whole(tmp_path: Path) -> None:
    write(tmp_path / "v.mkv", Track(tone(48000, 4.0)[None]), frames=25)
    assert len(read(tmp_path / "v.mkv")) / RATE_HZ == pytest.approx(4.0, abs=0.05)


def test_silence_is_silent_and_clipped_sound_does_not_wrap(tmp_path: Path) -> None:
    write(tmp_path / "silent.mkv", Track(np.zeros((1, 96000))))
    assert not read(tmp_path / "silent.mkv").any()
    write(tmp_path / "clipped.mkv", Track(np.clip(8 * tone(48000), -1, 1)[None]))
    sound = read(tmp_path / "clipped.mkv")
    assert loudness(sound) > 0.9
    # A sample that had wrapped would jump from one end of the range to the other.
    assert np.abs(np.diff(sound)).max() < 1.5


def test_channels_that_are_each_others_inverse_are_heard(tmp_path: Path) -> None:
    one = tone(48000)
    write(tmp_path / "v.mkv", Track(np.array([one, -one]), layout="stereo"))
    assert loudness(read(tmp_path / "v.mkv")) > 0.3
    other = 0.5 * np.sin(2 * np.pi * 700 * np.arange(len(one)) / 48000)
    write(tmp_path / "wide.mkv", Track(np.array([one, other]), layout="stereo"))
    assert 0.3 < loudness(read(tmp_path / "wide.mkv")) < 0.6


def test_time_stamps_that_jump_by_hours_are_closed_and_said(tmp_path: Path) -> None:
    track = Track(tone(48000)[None], start_s=40_000.0, jump_s=28_800.0, codec="pcm_s16le")
    write(tmp_path / "v.mkv", track, first_picture_s=40_000.0)
    tracemalloc.start()
    try:
        sound = read(tmp_path / "v.mkv", track.warnings)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
    assert len(sound) / RATE_HZ == pytest.approx(SECONDS, abs=0.1)
    assert begin_s(sound) == pytest.approx(0.5, abs=0.1)
    assert len(track.warnings) == 1 and "jump" in track.warnings[0]


def joined(parts: Sequence[Path], path: Path) -> None:
    path.write_bytes(b"".join(part.read_bytes() for part in parts))


def test_a_format_that_changes_in_the_middle_is_followed(tmp_path: Path) -> None:
    for name, layout, count in (("a", "mono", 1), ("b", "stereo", 2)):
        track = Track(np.tile(tone(48000), (count, 1)), layout=layout, codec="mp2")
        write(tmp_path / f"{name}.ts", track)
    joined([tmp_path / "a.ts", tmp_path / "b.ts"], tmp_path / "v.ts")
    said = list[str]()
    sound = read(tmp_path / "v.ts", said)
    assert len(sound) / RATE_HZ == pytest.approx(2 * SECONDS, abs=0.3)
    second = sound[round((SECONDS + 0.8) * RATE_HZ) :]
    assert np.abs(second).max() > 0.3


def test_damaged_sound_is_passed_over_and_said(tmp_path: Path) -> None:
    write(tmp_path / "v.mkv", Track(tone(48000)[None]))
    with av.open(str(tmp_path / "v.mkv")) as container:
        places = [p.pos for p in container.demux(audio=0) if p.size and p.pos is not None]
    data = bytearray((tmp_path / "v.mkv").read_bytes())
    for place in places[40:44]:
        data[place + 8 : place + 40] = bytes(32)
    (tmp_path / "v.mkv").write_bytes(data)
    said = list[str]()
    sound = read(tmp_path / "v.mkv", said)
    assert len(sound) / RATE_HZ == pytest.approx(SECONDS, abs=0.3)
    assert loudness(sound) > 0.3


def test_the_sound_of_a_recording_with_a_url_is_read(tmp_path: Path) -> None:
    write(tmp_path / "v.mkv", Track(tone(48000)[None]))
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/v.mkv"
        assert has_sound(url) and not has_sound(url.replace("v.mkv", "none.mkv"))
        assert begin_s(np.concatenate(list(read_sound(url, RATE_HZ))) / 32768) == pytest.approx(
            0.5, abs=0.02
        )
        server.shutdown()
