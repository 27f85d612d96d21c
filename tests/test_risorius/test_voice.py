"""The voice of a call, from `risorius encode` to `risorius decode`: in a file, over a link."""

from pathlib import Path

import av
import numpy as np
import pytest
from conftest import MakeOnce, Start
from processes import LIMIT_S, finish
from sounds import voiced_sound

from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source
from encoder.sound.recorded_speech import chosen_voice
from loopback.process_pair import free_port
from protocol.summary import summarise
from risorius.cli import main
from shared_model.arrays import Array

RATE_HZ = 8000
FRAMES = 30


def sound_samples(path: Path) -> Array:
    """The samples of the sound track, and their rate last."""
    with av.open(str(path)) as container:
        frames = list(container.decode(audio=0))
        pieces = [frame.to_ndarray().reshape(-1).astype(np.float64) for frame in frames]
        return np.append(np.concatenate(pieces), frames[0].sample_rate)


@pytest.fixture(scope="session")
def talking(carphone: Path, make_once: MakeOnce) -> Path:
    """The first frames of the demo clip with a sound track."""

    def write(folder: Path) -> None:
        with open_source(str(carphone)) as capture:
            size, fps = (capture.width, capture.height), capture.fps
            path = folder / "talking.mkv"
            with open_sink(path, *size, fps, "bt601", False, RATE_HZ) as sink:
                for index, frame in capture:
                    if index == FRAMES:
                        break
                    sink.write(frame)
                sink.write_sound(voiced_sound(round(FRAMES / fps * RATE_HZ)))

    return make_once("carphone_with_voice", write) / "talking.mkv"


@pytest.mark.parametrize("voice", ["700C", "1200", "opus"])
def test_a_voice_goes_from_the_source_into_the_decoded_video(
    voice: str, talking: Path, tmp_path: Path
) -> None:
    pytest.importorskip("pycodec2")
    pytest.importorskip("webrtcvad")
    call, decoded = tmp_path / "call.rzo", tmp_path / "out.mkv"
    options = ["--profile", "thesis", "--voice", voice, "-q"]
    assert main(["encode", str(talking), "-o", str(call), *options]) == 0
    summary = summarise(call)
    assert summary.voice == voice and summary.voice_bytes > 30
    assert summary.damaged_packets == 0
    assert main(["decode", str(call), "-o", str(decoded), "-q"]) == 0
    *samples, rate_hz = sound_samples(decoded)
    with open_source(str(decoded)) as capture:
        fps = float(capture.fps)
    assert len(samples) / rate_hz == pytest.approx(FRAMES / fps, abs=0.05)
    assert np.std(samples) > 0


def test_a_voice_goes_over_a_link_into_the_decoded_video(
    talking: Path, tmp_path: Path, start: Start
) -> None:
    pytest.importorskip("pycodec2")
    pytest.importorskip("webrtcvad")
    endpoint, decoded = f"tcp/127.0.0.1:{free_port()}", tmp_path / "out.mkv"
    decoder = start("decode", "--listen", endpoint, "-o", decoded, "-q")
    options = ("--profile", "thesis", "--wait", str(LIMIT_S), "-q")
    encoder = start("encode", talking, "--connect", endpoint, *options)
    assert finish(encoder) == (0, "") and finish(decoder) == (0, "")
    *samples, rate_hz = sound_samples(decoded)
    assert rate_hz == RATE_HZ
    assert len(samples) / RATE_HZ == pytest.approx(FRAMES / 30, abs=0.25)
    assert np.std(samples) > 0


def test_a_source_without_sound_has_no_voice(carphone: Path) -> None:
    assert chosen_voice(str(carphone), None) == ("off", None)
    voice, warning = chosen_voice("0", "1200")
    assert voice == "off" and warning is not None and "no sound" in warning


def test_a_call_without_its_voice_is_that_of_a_silent_source(
    talking: Path, call: Path, tmp_path: Path
) -> None:
    off = tmp_path / "off.rzo"
    options = ["--profile", "thesis", "--voice", "off", "-q"]
    assert main(["encode", str(talking), "-o", str(off), *options]) == 0
    summary = summarise(off)
    assert (summary.voice, summary.voice_bytes) == ("off", 0)
    assert summary.frame_packets == summarise(call).frame_packets
