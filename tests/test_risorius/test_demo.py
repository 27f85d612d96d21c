"""The first thing a newcomer runs."""

import re
from pathlib import Path

import cv2
import pytest

from encoder.capture.video_source import open_source
from loopback.clip_paths import clip_path
from protocol.summary import summarise
from risorius.demo import demo
from shared_model.errors import UserError


def test_the_demo_leaves_a_call_videos_and_a_contact_sheet(demo_run: Path) -> None:
    folder, printed = demo_run / "out" / "demo", (demo_run / "printed.txt").read_text()
    assert summarise(folder / "call.rzo").frames == 120
    *_, headline, video = printed.splitlines()
    figures = r"\d{3} bits a second, \d\d\.\d dB over the face; a minute .* weighs 1\d\.\d kB"
    assert re.fullmatch(figures, headline)
    assert video.endswith(str(folder / "side_by_side.mp4"))
    assert "whole picture" in printed and re.search(
        "one still picture|learned from the whole call", printed
    )
    with open_source(str(folder / "side_by_side.mp4")) as both:
        assert (both.height, both.width) == (144, 2 * 176)
        assert sum(1 for _ in both) == 120
    sheet = cv2.imread(str(folder / "contact_sheet.png"))
    assert sheet is not None
    # Source above, decoded below; enlarged, since the clip is small.
    assert sheet.shape[0] * 6 * 176 == sheet.shape[1] * 2 * 144
    assert sheet.shape[0] >= 480
    assert all(str(path) in printed for path in folder.iterdir())


def test_without_the_landmark_networks_the_demo_is_of_the_thesis_profile(
    without_judge: None, carphone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        """No package of networks."""

    monkeypatch.setattr("encoder.detection.tflite.find_spec", missing)
    said = list[str]()
    demo(tmp_path, said.append, lambda: False)
    assert summarise(tmp_path / "call.rzo").profile == "thesis"
    assert any("Viola-Jones" in line for line in said)


def test_a_clip_of_a_package_that_is_missing_says_how_to_get_it() -> None:
    with pytest.raises(UserError, match="make install"):
        clip_path("package:no_such_package/clip.mp4", Path())
    with pytest.raises(UserError, match="make install"):
        clip_path("package:loopback/no_such_clip.mp4", Path())


def test_other_clips_are_looked_for_from_the_folder() -> None:
    assert clip_path("a/b.mp4", Path("/clips")) == Path("/clips/a/b.mp4")
    assert clip_path("/b.mp4", Path("/clips")) == Path("/b.mp4")
