"""`risorius info`: its parts add up, for damaged calls as well."""

import json
from pathlib import Path

import pytest
from processes import error_line, one_line

from protocol.call_file import MAGIC, CallReader
from protocol.call_records import serialise_records
from risorius.cli import main

Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "no such file"),
        (b"", "no call file"),
        (b"RIFF....AVI ", "no call file"),
        (b"RZO2", "no model packet"),
    ],
)
@pytest.mark.parametrize("command", ["decode", "info"])
def test_what_is_no_call_is_one_line(
    command: str, content: bytes | None, reason: str, tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "call.rzo"
    if content is not None:
        path.write_bytes(content)
    assert main([command, str(path)]) == 2
    assert reason in error_line(capsys)


@pytest.mark.parametrize("command", ["decode", "info"])
def test_a_call_of_another_version_is_refused(
    command: str, call: Path, tmp_path: Path, capsys: Capture
) -> None:
    with call.open("rb") as file:
        model = bytearray(next(iter(CallReader(file))))
    # The version stands first in a model packet, after its kind.
    model[1] = 99
    newer = tmp_path / "newer.rzo"
    newer.write_bytes(MAGIC + serialise_records([bytes(model)]))
    assert main([command, str(newer)]) == 2
    assert "version is 99" in error_line(capsys)


@pytest.mark.parametrize("command", ["decode", "info"])
def test_a_call_cut_off_in_its_model_is_said_to_be(
    command: str, call: Path, tmp_path: Path, capsys: Capture
) -> None:
    short = tmp_path / "short.rzo"
    short.write_bytes(call.read_bytes()[:1000])
    assert main([command, str(short)]) == 2
    assert "short.rzo: the call is cut off: byte 4: record has 993 bytes" in error_line(capsys)


@pytest.mark.parametrize("kind", ["recorded_call", "live_call"])
def test_of_a_truncated_call_info_counts_the_frames_that_decode_draws(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path, capsys: Capture
) -> None:
    short, report = tmp_path / "short.rzo", tmp_path / "report.json"
    whole = Path(request.getfixturevalue(kind)).read_bytes()
    for missing in (1, 40):
        short.write_bytes(whole[:-missing])
        assert main(["decode", str(short), "--report", str(report), "-q"]) == 0
        assert "cut off" in error_line(capsys)
        assert main(["info", str(short), "--json"]) == 0
        told = capsys.readouterr()
        assert "cut off" in one_line(told.err)
        decoded, info = json.loads(report.read_text()), json.loads(told.out)
        assert 0 < info["frames"] == decoded["frames"] <= 75
        assert info["frame_bytes"] == decoded["frame_bytes"]
        assert info["complete"] == decoded["complete"] is False


@pytest.mark.parametrize("command", ["decode", "info"])
def test_bytes_after_the_end_of_a_call_are_left_out_with_a_warning(
    command: str, call: Path, tmp_path: Path, capsys: Capture
) -> None:
    longer = tmp_path / "longer.rzo"
    longer.write_bytes(call.read_bytes() + b"junk")
    assert main([command, str(longer)]) == 0
    assert "4 bytes after the end of the call are left out" in error_line(capsys)


def test_the_parts_of_a_call_add_up_to_the_file(call: Path, capsys: Capture) -> None:
    assert main(["info", str(call), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    parts = ("model_bytes", "frame_bytes", "control_bytes", "container_bytes")
    assert sum(info[part] for part in parts) == info["file_bytes"] == call.stat().st_size
    assert info["frames"] == 30 and (info["width"], info["height"]) == (176, 144)
    assert info["frame_bps"] == 800 and info["profile"] == "thesis"
    assert info["duration_s"] == pytest.approx(30 * 1001 / 30000)


def test_info_prints_every_figure(call: Path, capsys: Capture) -> None:
    assert main(["info", str(call), "--json"]) == 0
    names = json.loads(capsys.readouterr().out)
    assert main(["info", str(call)]) == 0
    text = capsys.readouterr().out
    assert all(name.replace("_", " ") in text for name in names)
