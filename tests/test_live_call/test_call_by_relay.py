"""Two ends that both connect to a relay: they settle who sends in which direction."""

import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import MakeOnce, Start
from processes import finish
from shots import draw, talking

from loopback.process_pair import free_port
from protocol.link.direction import Direction
from protocol.link.zenoh_direction import ZenohDirection
from protocol.relay.zenoh_relay import Relay, RelayOptions
from protocol.security.invitation import Invitation, random_key
from protocol.security.link_security import LinkSecurity

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")


@pytest.fixture(scope="module")
def clip(networks: Path, make_once: MakeOnce) -> Path:
    return (
        make_once("talks", lambda folder: draw(folder / "clip.mkv", talking(2.4, 5))) / "clip.mkv"
    )


def read_until(process: "subprocess.Popen[str]", text: str) -> list[str]:
    assert process.stderr is not None
    lines = list[str]()
    while not lines or text not in lines[-1]:
        lines.append(process.stderr.readline())
        assert lines[-1], lines
    return lines


def never(direction: Direction) -> None:
    raise AssertionError(f"it is {direction} now")


def settled(where: str, key: bytes | None, is_listener: bool = False) -> ZenohDirection:
    return ZenohDirection(where, "zoe", LinkSecurity(key=key), is_listener, never)


@pytest.mark.parametrize("key", [None, bytes(range(16))], ids=["open", "keyed"])
def test_who_comes_later_and_who_comes_again_take_the_free_direction(key: bytes | None) -> None:
    where = f"127.0.0.1:{free_port()}"
    with Relay(RelayOptions((where,))), settled(where, key) as first:
        assert first.settle() is Direction.A
        for _ in range(2):
            with settled(where, key) as second:
                assert second.settle() is Direction.B
        with settled(where, b"another key" * 3) as stranger:
            assert stranger.settle() is Direction.A


def test_who_calls_a_listener_takes_the_other_direction() -> None:
    where = f"127.0.0.1:{free_port()}"
    with Relay(RelayOptions((where,))), settled(where, None, True) as listener:
        assert listener.settle() is Direction.A
        with settled(where, None) as caller:
            assert caller.settle() is Direction.B


def test_where_nothing_listens_a_caller_sends_to_a_listener() -> None:
    with settled(f"tcp/127.0.0.1:{free_port()}", None) as caller:
        assert caller.settle() is Direction.B


def test_two_calls_through_a_relay_see_each_other(
    clip: Path, start: Start, record_property: Callable[[str, object], None]
) -> None:
    where = f"127.0.0.1:{free_port()}"
    invitation = Invitation("127.0.0.1", int(where.split(":")[1]), "zoe", random_key())
    camera = ("--camera", clip, "--voice", "off")
    with Relay(RelayOptions((where,))):
        begin_s = time.monotonic()
        names = ("Anna", "Zoe")
        ends = [start("call", str(invitation), *camera, "--name", name) for name in names]
        for end, other in zip(ends, names[::-1], strict=True):
            read_until(end, f"{other}: is here")
        record_property("seconds", time.monotonic() - begin_s)
        print(f"both are seen after {time.monotonic() - begin_s:.1f} s")
        ends[1].send_signal(signal.SIGINT)
        assert finish(ends[1])[0] == 0
        read_until(ends[0], "Zoe: has left")
        ends[0].send_signal(signal.SIGINT)
        assert finish(ends[0])[0] == 0
