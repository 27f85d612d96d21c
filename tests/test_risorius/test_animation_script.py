"""Animation scripts: what they may say, and what happens between their keys."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from risorius.animation.animate import unused_settings
from risorius.animation.animation_script import parse_script, read_script
from shared_model.anatomy.expressions import EMOTIONS
from shared_model.anatomy.muscle_fields import MUSCLE_NAMES
from shared_model.errors import UserError
from shared_model.parameters import AAUS, EAU_INDEX

SCRIPTS = sorted((Path(__file__).resolve().parents[2] / "examples/animations").glob("*.toml"))
TWO_KEYS = {
    "seconds": 2,
    "key": [
        {"time": 0, "eau": {"jaw_drop": 0}, "pose": {"yaw": -10}},
        {"time": 1, "eau": {"jaw_drop": 1}, "aau": {"nose_width": -1}},
    ],
}


def test_values_are_held_before_the_first_and_after_the_last_key() -> None:
    script = parse_script(TWO_KEYS, Path())
    assert script.at(0.5).eau[EAU_INDEX["jaw_drop"]] == pytest.approx(0.5)
    assert script.at(2).eau[EAU_INDEX["jaw_drop"]] == 1
    assert script.at(1.7).pose["yaw"] == -10
    assert script.at(0).aau[AAUS.index("nose_width")] == -1


def test_a_key_may_name_muscles_of_either_side() -> None:
    keys = [{"time": time, "muscle": {"risorius_left": time}} for time in (0, 1)]
    script = parse_script({"key": keys, "seconds": 2}, Path())
    muscles = dict(zip(MUSCLE_NAMES, script.at(0.5).muscles, strict=True))
    assert muscles["risorius_left"] == pytest.approx(0.5)
    assert sum(map(bool, muscles.values())) == 1 and not script.at(0.5).eau.any()


def test_what_no_key_sets_is_at_rest() -> None:
    state = parse_script({}, Path()).at(1)
    assert not state.eau.any() and not state.aau.any() and not any(state.pose.values())
    assert not state.muscles.any()
    assert (state.brightness, state.side, state.zoom) == (1, 0, 1)


def test_an_emotion_is_its_peak_and_adds_to_actuators_within_their_ranges() -> None:
    key = {"time": 0, "emotion": {"surprise": 1}, "eau": {"jaw_drop": 0.9}}
    eau = parse_script({"key": [key]}, Path()).at(0).eau
    peak = next(e for e in EMOTIONS if e.name == "surprise").peak()
    assert eau[EAU_INDEX["eyebrow_middle"]] == peak[EAU_INDEX["eyebrow_middle"]]
    assert eau[EAU_INDEX["jaw_drop"]] == 1


@pytest.mark.parametrize("fps", [Fraction(30000, 1001), 25])
def test_rates_are_exact(fps: Fraction) -> None:
    content = {"fps": str(fps) if isinstance(fps, Fraction) else fps, "seconds": 10}
    script = parse_script(content, Path())
    assert script.fps == fps and script.frames == round(10 * fps)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"widht": 3}, "setting 'widht' is not known"),
        ({"width": 3}, "width is 3, expected a number from 16"),
        ({"fps": "0/1"}, "fps is '0/1'"),
        ({"fps": "much"}, "fps is 'much'"),
        ({"background": 3}, "background is 3"),
        ({"key": 5}, "key is 5"),
        ({"key": [{}]}, "key 1 has no time"),
        ({"key": [{"time": 9}]}, "key 1: time is 9"),
        ({"key": [{"time": 0, "eye": {}}]}, "key 1: group 'eye' is not known"),
        ({"key": [{"time": 0, "eau": 1}]}, "key 1: eau is 1, expected names and values"),
        ({"key": [{"time": 0, "eau": {"jaw": 1}}]}, "key 1: eau has no 'jaw'"),
        ({"key": [{"time": 0, "eau": {"jaw_drop": 2}}]}, "jaw_drop is 2, expected a number from 0"),
        ({"key": [{"time": 0, "eau": {"jaw_drop": True}}]}, "jaw_drop is True"),
        ({"key": [{"time": 0, "pose": {"yaw": 1}}] * 2}, "pose.yaw has two keys at 0 s"),
    ],
)
def test_a_mistake_is_named_with_its_place(change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_script(change, Path())


def test_a_file_that_is_not_there_or_not_toml_is_the_users_mistake(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot read"):
        read_script(tmp_path / "none.toml")
    bad = tmp_path / "bad.toml"
    bad.write_text("width = ")
    with pytest.raises(UserError, match="is not an animation script in TOML"):
        read_script(bad)
    video = tmp_path / "video.mp4"
    video.write_bytes(bytes(range(256)))
    with pytest.raises(UserError, match=r"video\.mp4 is not an animation script: it is no text"):
        read_script(video)


def test_four_scripts_come_along() -> None:
    assert [p.stem for p in SCRIPTS] == ["emotions", "expressions", "head_turns", "talking"]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_that_comes_along_reads_and_moves(path: Path) -> None:
    script = read_script(path)
    states = [script.at(t) for t in np.linspace(0, script.seconds, 50)]
    moved = np.ptp([m.eau for m in states], axis=0).max()
    turned = np.ptp([m.pose["yaw"] for m in states])
    assert moved > 0.5 or turned > 20


def test_settings_that_a_call_makes_useless_are_named() -> None:
    assert unused_settings(parse_script({"title": "a", "noise": 2}, Path())) == ()
    given = {"width": 64, "mottle": 0.1, "seed": 3}
    assert unused_settings(parse_script(given, Path())) == ("width", "mottle")
