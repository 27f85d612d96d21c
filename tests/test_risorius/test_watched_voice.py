"""A page elsewhere lets a call's voice be heard, in time with its pictures."""

import time
from itertools import islice
from pathlib import Path

import pytest
from conftest import without_layers
from links import free_endpoint
from processes import LIMIT_S
from sounds import voiced_sound

pytest.importorskip("aiohttp")

from benchmarks.browser import Browser
from benchmarks.played_letter import SOFTWARE_GL
from decoder.sinks.frame_sink import open_sink
from encoder.capture.frame_times import exact_fps
from encoder.capture.video_source import open_source
from protocol.call_file import CallReader
from protocol.link.carriers import open_link_sink
from protocol.link.interface import LinkOptions
from protocol.packets import PacketKind, packet_kind
from protocol.relay.zenoh_relay import Relay, RelayOptions
from protocol.security.link_security import LinkSecurity
from risorius.cli import main
from risorius.watch.watch_server import WatchServer

RATE_HZ, FPS, FRAMES = 8000, 25, 32
# A packet of the call covers so much of it.
PACKET_S = 8 / FPS
MOST_OFF_S = 0.06
# The loudness of what is heard, as a browser measures it; by how much that is off the pictures.
LISTEN = """
window.listen = () => {
  const ear = watch.voice.context.createAnalyser();
  watch.voice.sound.connect(ear);
  const samples = new Float32Array(ear.fftSize);
  window.loudest = 0;
  setInterval(() => {
    ear.getFloatTimeDomainData(samples);
    for (const sample of samples) loudest = Math.max(loudest, Math.abs(sample));
  }, 20);
};
window.off_s = () => {
  const { context, endS, nextS, delay } = watch.voice;
  const { contextTime, performanceTime } = context.getOutputTimestamp();
  const nowS = performance.now() / 1000;
  const heardS = endS - nextS + contextTime + nowS - performanceTime / 1000;
  return heardS - (nowS - delay.offset);
};
"""


def spoken_call(clip: Path, folder: Path, voice: str) -> Path:
    """The beginning of a clip with a sound track, as a call."""
    film, call = folder / "film.mkv", folder / "call.rzo"
    with open_source(str(clip)) as source:
        pictures = [picture for _, picture in islice(source, FRAMES)]
    height, width = pictures[0].shape[:2]
    with open_sink(film, width, height, exact_fps(FPS), sound_rate_hz=RATE_HZ) as sink:
        for picture in pictures:
            sink.write(picture)
        sink.write_sound(voiced_sound(RATE_HZ * FRAMES // FPS))
    options = ["--voice", voice, "--model-bytes", "3000", "-q"]
    with without_layers():
        assert main(["encode", str(film), "-o", str(call), *options]) == 0
    return call


@pytest.mark.parametrize("voice", ["opus", "1200"])
def test_a_voice_is_heard_or_it_is_said_why_not(
    voice: str, talking_clip: Path, tmp_path: Path, chromium: str
) -> None:
    call, endpoint = spoken_call(talking_clip, tmp_path, voice), free_endpoint()
    link = LinkOptions(
        "anna",
        connect=(endpoint,),
        connect_timeout_s=LIMIT_S,
        security=LinkSecurity(None),
    )
    flags = (*SOFTWARE_GL, "--autoplay-policy=no-user-gesture-required")
    with (
        Relay(RelayOptions((endpoint,))) as relay,
        WatchServer(relay, 0) as server,
        Browser(chromium, tmp_path / "b", 800, 700, *flags) as browser,
    ):
        browser.call("Page.navigate", url=f"http://127.0.0.1:{server.port}/anna")
        packets = list(CallReader(call))
        with open_link_sink(link) as sink:
            sink.wait_for_peer(LIMIT_S)
            for packet in [each for each in packets if packet_kind(each) is PacketKind.MODEL]:
                sink.send(packet)
            browser.wait("watch.receiver.voice !== 0", LIMIT_S)
            if voice != "opus":
                said = "document.getElementById('message').textContent"
                browser.wait("watch.voiceState.includes('Codec2')", LIMIT_S)
                browser.wait(f"watch.state !== '' || {said}.includes('cannot be played')", LIMIT_S)
                return
            browser.wait("watch.voice?.decoder && watch.voice.isHeard", LIMIT_S)
            browser.value(LISTEN + "listen()")
            off_s = list[float]()
            for packet in packets:
                if packet_kind(packet) is PacketKind.FRAME:
                    sink.send(packet)
                    time.sleep(PACKET_S)
                    off_s.append(abs(browser.value("off_s()")))
            browser.wait("watch.voice.played > 0 && loudest > 0.05", LIMIT_S)
            assert min(off_s) < MOST_OFF_S
