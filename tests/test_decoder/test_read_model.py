"""The model of a call file that a drawn person is made of."""

from dataclasses import replace
from pathlib import Path

from call_files import call_file

from decoder.scene.reenactment import read_model
from protocol.call_file import CallWriter
from protocol.packets import serialise


def test_an_update_without_pictures_has_those_of_the_version_before(tmp_path: Path) -> None:
    first, path = read_model(call_file(tmp_path / "first.rzo")), tmp_path / "updated.rzo"
    aau = (7, *first.aau[1:])
    update = replace(first, aau=aau, version=1, version_count=2, background=b"", texture=b"")
    with CallWriter(path) as writer:
        for packet in (replace(first, version_count=2), update):
            writer.send(serialise(packet))
    newest = read_model(path)
    assert newest.aau == aau
    assert [newest.texture, newest.background] == [first.texture, first.background]
