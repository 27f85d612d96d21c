"""The Python interface: its examples run, its arguments are checked, its import is quick."""

import doctest
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from processes import LIMIT_S

import risorius
from loopback.process_pair import free_port
from protocol.call_file import CallReader
from protocol.link.carriers import open_link_sink
from protocol.link.interface import LinkOptions
from protocol.security.invitation import Invitation
from protocol.security.link_security import LinkSecurity
from shared_model.errors import UserError


@pytest.fixture
def folder(carphone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with me.mp4 in it."""
    (tmp_path / "me.mp4").symlink_to(carphone)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_its_examples_run(folder: Path) -> None:
    result = doctest.testmod(risorius)
    assert result.attempted > 5 and result.failed == 0
    assert (folder / "me.csv").exists()


def test_its_import_loads_no_library() -> None:
    code = "import sys, risorius; sys.exit(any(n in sys.modules for n in ('numpy', 'cv2')))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_a_call_has_a_picture_for_each_frame(call: Path) -> None:
    with call.open("rb") as stream, risorius.open_call(stream) as opened:
        pictures = list(opened)
        assert opened.complete and opened.fps == pytest.approx(30000 / 1001)
    times = np.array([time_s for time_s, _ in pictures])
    np.testing.assert_allclose(times, np.arange(30) * 1001 / 30000)
    assert {(picture.shape, picture.dtype) for _, picture in pictures} == {
        ((144, 176, 3), np.dtype(np.uint8))
    }


def test_another_face_can_be_worn(call: Path) -> None:
    with risorius.open_call(str(call), face=call) as opened:
        assert next(iter(opened)).time_s == 0


def test_a_value_out_of_range_is_named() -> None:
    with pytest.raises(ValueError, match="bitrate: 0 is not above 0"):
        risorius.encode("me.mp4", "call.rzo", bitrate=0)
    with pytest.raises(ValueError, match="profile: best is none of default, thesis"):
        risorius.encode("me.mp4", "call.rzo", profile="best")


def test_options_that_do_not_go_together_are_refused_as_they_were_written() -> None:
    with pytest.raises(UserError, match=r"fps=10 is about the default profile; add profile='def"):
        risorius.encode("me.mp4", "call.rzo", profile="thesis", fps=10)


def test_what_is_missing_is_the_users_error(tmp_path: Path) -> None:
    none = tmp_path / "none"
    for fails in (risorius.info, risorius.open_call, risorius.track):
        with pytest.raises(UserError, match="none: no such file"):
            fails(none)


def test_a_call_over_a_network_is_opened_with_its_invitation(call: Path) -> None:
    invitation = Invitation("127.0.0.1", free_port(), "anna", bytes(range(16)))
    security = LinkSecurity(invitation.key)
    options = LinkOptions("anna", (invitation.address,), lossless=True, security=security)

    def send() -> None:
        with CallReader(call) as packets:
            sink.wait_for_peer(LIMIT_S)
            for packet in packets:
                sink.send(packet)

    with open_link_sink(options) as sink, ThreadPoolExecutor(1) as background:
        sending = background.submit(send)
        with risorius.open_call(invite=str(invitation)) as opened:
            assert len(list(opened)) == 30 and opened.complete
        sending.result()


def test_what_is_not_used_is_refused(call: Path) -> None:
    invitation = Invitation("127.0.0.1", 7447, "anna", bytes(range(16)))
    with pytest.raises(UserError, match="listen does not go with a call file"):
        risorius.open_call(call, listen=[":7447"])
    with pytest.raises(UserError, match="the invitation is to call 'anna'"):
        risorius.open_call(invite=str(invitation), call="bert")


@pytest.mark.parametrize(
    "place", [{"listen": [":7447"]}, {"connect": ["192.0.2.7:7447", "127.0.0.1:1"]}]
)
def test_no_call_beyond_this_host_is_open_by_mistake(place: dict[str, list[str]]) -> None:
    with pytest.raises(UserError, match="no invitation to this call"):
        risorius.open_call(**place)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="no invitation: expected"):
        risorius.open_call(**place, invite="anna")  # type: ignore[arg-type]


def test_the_version_is_an_attribute() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", risorius.__version__)
    with pytest.raises(AttributeError, match="no attribute 'x'"):
        _ = risorius.x
