"""A browser on no host of the call watches it through a relay, which has no key."""

import gzip
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from links import free_endpoint
from processes import LIMIT_S

pytest.importorskip("aiohttp")

from benchmarks.browser import Browser
from benchmarks.played_letter import SOFTWARE_GL
from protocol.call_file import CallReader
from protocol.link.carriers import open_link_sink
from protocol.link.interface import LinkOptions
from protocol.packets import PacketKind, packet_kind
from protocol.relay.zenoh_relay import Relay, RelayOptions
from protocol.security.invitation import format_key, random_key
from protocol.security.link_security import LinkSecurity
from risorius.cli import main
from risorius.page import player_parts
from risorius.watch.watch_server import WatchServer
from shared_model.errors import UserError

SESSIONS = "watch.delivery.sessions"


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def relay(endpoint: str) -> Iterator[Relay]:
    with Relay(RelayOptions((endpoint,))) as opened:
        yield opened


@pytest.fixture
def server(relay: Relay) -> Iterator[WatchServer]:
    with WatchServer(relay, 0) as opened:
        yield opened


@pytest.mark.parametrize("is_encrypted", [True, False], ids=["encrypted", "open"])
def test_a_page_watches_a_call(
    is_encrypted: bool,
    endpoint: str,
    server: WatchServer,
    recorded_call: Path,
    tmp_path: Path,
    chromium: str,
) -> None:
    key = random_key() if is_encrypted else None
    link = LinkOptions(
        "anna",
        connect=(endpoint,),
        connect_timeout_s=LIMIT_S,
        security=LinkSecurity(key),
    )
    place = f"http://127.0.0.1:{server.port}/anna" + (f"#{format_key(key)}" if key else "")
    with Browser(chromium, tmp_path / "b", 800, 700, *SOFTWARE_GL) as browser:
        browser.call("Page.navigate", url=place)
        _send_watched(link, recorded_call, browser)
        browser.wait("watch.shown > 0 && watch.state === 'The call has ended.'", LIMIT_S)
        assert browser.value("watch.receiver.damages") == 0
        assert browser.value("watch.faces.canvas.width") > 100
        assert server.pages == 1
        if not is_encrypted:
            return
        # The caller calls again.
        shown = browser.value("watch.shown")
        _send_watched(link, recorded_call, browser)
        browser.wait(f"watch.shown > {shown} && watch.delivery.sessions === 2", LIMIT_S)


def test_a_page_warms_up_while_a_model_is_on_its_way(
    endpoint: str, server: WatchServer, tmp_path: Path, chromium: str
) -> None:
    link = LinkOptions("anna", connect=(endpoint,), security=LinkSecurity(None))
    with (
        Browser(chromium, tmp_path / "b", 800, 700, *SOFTWARE_GL) as browser,
        open_link_sink(link) as sink,
    ):
        browser.call("Page.navigate", url=f"http://127.0.0.1:{server.port}/anna")
        sink.wait_for_peer(LIMIT_S)
        browser.wait("window.watch?.warmUp != null", LIMIT_S)
        browser.value("watch.warmUp.then((done) => { window.isDone = done; }), true")
        browser.wait("window.isDone", LIMIT_S)
        assert browser.value("watch.shown") == 0


def _send_watched(link: LinkOptions, call: Path, browser: Browser) -> None:
    """Send a call as fast as the page takes it."""
    with CallReader(call) as packets, open_link_sink(link) as sink:
        sink.wait_for_peer(LIMIT_S)
        session = f"watch.delivery.call && watch.receiver.session === {browser.value(SESSIONS)} - 1"
        for packet in packets:
            sink.send(packet)
            if packet_kind(packet) is PacketKind.FRAME:
                # A frame that the link drops is asked for when a later one has come.
                number = packet[0] % 64 - 2
                browser.wait(
                    f"{session} && watch.receiver.heard.playout.newest >= {number}", LIMIT_S
                )


def test_who_has_another_key_sees_nothing(
    endpoint: str, server: WatchServer, tmp_path: Path, chromium: str
) -> None:
    link = LinkOptions("anna", connect=(endpoint,), security=LinkSecurity(random_key()))
    place = f"http://127.0.0.1:{server.port}/anna#{format_key(random_key())}"
    with (
        Browser(chromium, tmp_path / "b", 800, 700, *SOFTWARE_GL) as browser,
        open_link_sink(replace(link, connect_timeout_s=LIMIT_S)) as sink,
    ):
        browser.call("Page.navigate", url=place)
        # It has asked several times.
        browser.wait("window.watch && watch.delivery.nonce > 3", LIMIT_S)
        assert browser.value("watch.delivery.call === null")
        assert not sink.peers
        # Another part after the # alone loads no page.
        browser.call("Page.navigate", url="about:blank")
        browser.call("Page.navigate", url=place[:-1])
        browser.wait(
            "document.getElementById('message').textContent.includes('not whole')", LIMIT_S
        )


def test_the_parts_of_the_page_are_small_and_kept(server: WatchServer) -> None:
    place = f"http://127.0.0.1:{server.port}/player.bin"
    with urlopen(Request(place, headers={"Accept-Encoding": "gzip"})) as response:
        packed, tag = response.read(), response.headers["ETag"]
    with urlopen(place) as response:
        whole = response.read()
    assert gzip.decompress(packed) == whole and len(packed) < len(whole) / 5
    with pytest.raises(HTTPError, match="304"):
        urlopen(Request(place, headers={"If-None-Match": tag}))


def test_a_taken_port_and_a_page_that_is_not_built_are_told(
    relay: Relay, server: WatchServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(UserError, match="cannot listen on port"):
        WatchServer(relay, server.port)
    monkeypatch.setattr(player_parts, "files", lambda package: tmp_path)
    with pytest.raises(UserError, match="run make player"):
        WatchServer(relay, 0)


def test_watching_needs_no_certificate_and_so_goes_without(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["relay", "--listen", "tls/:0", "--keys", str(tmp_path), "--watch", "0"]
    assert main(arguments) != 0
    assert "--watch does not go with --keys" in capsys.readouterr().err
    assert main(["call", "127.0.0.1:7447", "--share", "0"]) != 0
    assert "--share needs --listen" in capsys.readouterr().err
