"""Animation scripts (thesis 5.4.2): a TOML file of key frames, read and checked."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from loopback.toml_file import read_toml
from shared_model.anatomy.expressions import EMOTIONS
from shared_model.anatomy.muscle_fields import MUSCLE_NAMES
from shared_model.arrays import Array
from shared_model.curves import smooth_curve
from shared_model.errors import UserError
from shared_model.parameters import AAUS, EAUS, clip_eau

# Track -> (value where no key sets it, lowest, highest).
POSE = {
    "pitch": (0.0, -90.0, 90.0),
    "yaw": (0.0, -90.0, 90.0),
    "roll": (0.0, -90.0, 90.0),
    "right": (0.0, -2000.0, 2000.0),
    "down": (0.0, -2000.0, 2000.0),
    "away": (0.0, -2000.0, 20000.0),
}
LIGHT = {"brightness": (1.0, 0.0, 3.0), "side": (0.0, -1.0, 1.0)}
CAMERA = {"zoom": (1.0, 0.1, 10.0)}
UNIT = (0.0, -1.0, 1.0)
GROUPS: Mapping[str, Mapping[str, tuple[float, float, float]]] = {
    "eau": {eau.name: (0.0, eau.low, eau.high) for eau in EAUS},
    "emotion": {emotion.name: (0.0, 0.0, 1.0) for emotion in EMOTIONS},
    "muscle": dict.fromkeys(MUSCLE_NAMES, (0.0, 0.0, 1.0)),
    "aau": dict.fromkeys(AAUS, UNIT),
    "pose": POSE,
    "light": LIGHT,
    "camera": CAMERA,
}
# Plain settings: name -> (default, lowest, highest).
SETTINGS = {
    "width": (640, 16, 4096),
    "height": (480, 16, 4096),
    "seconds": (5.0, 0.02, 3600.0),
    "distance_mm": (600.0, 200.0, 20000.0),
    "focal_px": (0.0, 0.0, 50000.0),
    "noise": (0.0, 0.0, 100.0),
    "blur_px": (0.0, 0.0, 50.0),
    "mottle": (0.05, 0.0, 0.5),
    "seed": (0, 0, 2**31),
}


@dataclass(frozen=True, slots=True)
class AnimationState:
    """What the script asks for at one time.

    eau: (len(EAUS),).  muscles: (len(MUSCLE_NAMES),).  aau: (len(AAUS),).
    pose: pitch, yaw, roll in degrees and right, down, away in mm.
    brightness, side: light.  zoom: focal length over that of rest.
    """

    eau: Array
    muscles: Array
    aau: Array
    pose: Mapping[str, float]
    brightness: float
    side: float
    zoom: float


@dataclass(frozen=True, slots=True)
class Script:
    """A checked script.

    tracks: (group, name) -> times in seconds and values of its keys.
    background: picture file behind the generic head, or None.  The rest: see docs/animate.md.
    """

    width: int
    height: int
    fps: Fraction
    seconds: float
    distance_mm: float
    focal_px: float
    noise: float
    blur_px: float
    mottle: float
    seed: int
    background: Path | None
    tracks: Mapping[tuple[str, str], tuple[tuple[float, ...], tuple[float, ...]]] = field(
        repr=False
    )

    @property
    def frames(self) -> int:
        """Number of pictures, at least one."""
        return max(1, round(self.seconds * self.fps))

    def at(self, time_s: float) -> AnimationState:
        """What is asked for at a time: smooth between keys, held at both ends."""
        eau = self._group("eau", time_s)
        for emotion, share in zip(EMOTIONS, self._group("emotion", time_s), strict=True):
            eau = eau + share * emotion.peak()
        pose = dict(zip(POSE, self._group("pose", time_s).tolist(), strict=True))
        brightness, side = self._group("light", time_s).tolist()
        zoom = float(self._group("camera", time_s)[0])
        shape = self._group("muscle", time_s), self._group("aau", time_s)
        return AnimationState(clip_eau(eau), *shape, pose, brightness, side, zoom)

    def _group(self, group: str, time_s: float) -> Array:
        return np.array([self._value(group, name, time_s) for name in GROUPS[group]])

    def _value(self, group: str, name: str, time_s: float) -> float:
        if (group, name) not in self.tracks:
            return GROUPS[group][name][0]
        times, values = self.tracks[group, name]
        return float(smooth_curve([time_s], times, values)[0])


def read_script(path: Path) -> Script:
    """Read a script.  Raises `UserError` that says what is wrong in it and where."""
    content = read_toml(path, "an animation script")
    try:
        return parse_script(content, path.parent)
    except ValueError as error:
        raise UserError(f"{path}: {error}") from error


def parse_script(content: Mapping[str, Any], folder: Path) -> Script:
    """A script of parsed TOML; files in it are relative to `folder`.  Raises ValueError."""
    _only(content, {*SETTINGS, "title", "fps", "background", "key"}, "setting")
    number = {
        name: _number(name, content.get(name, limits[0]), limits)
        for name, limits in SETTINGS.items()
    }
    background = content.get("background")
    if background is not None and not isinstance(background, str):
        raise ValueError(f"background is {background!r}, expected a file name")
    return Script(
        width=int(number["width"]),
        height=int(number["height"]),
        fps=_rate(content.get("fps", 25)),
        seconds=number["seconds"],
        distance_mm=number["distance_mm"],
        focal_px=number["focal_px"],
        noise=number["noise"],
        blur_px=number["blur_px"],
        mottle=number["mottle"],
        seed=int(number["seed"]),
        background=None if background is None else folder / background,
        tracks=_tracks(content.get("key", []), number["seconds"]),
    )


def _tracks(
    keys: Any, seconds: float
) -> dict[tuple[str, str], tuple[tuple[float, ...], tuple[float, ...]]]:
    if not isinstance(keys, list):
        raise ValueError(f"key is {keys!r}, expected a list of key frames")
    found: dict[tuple[str, str], dict[float, float]] = {}
    for number, key in enumerate(keys, 1):
        where = f"key {number}"
        if not isinstance(key, dict) or "time" not in key:
            raise ValueError(f"{where} has no time")
        _only(key, {"time", *GROUPS}, f"{where}: group")
        time_s = _number(f"{where}: time", key["time"], (0.0, 0.0, seconds))
        for group, names in GROUPS.items():
            for name, value in _table(key, group, where).items():
                if name not in names:
                    raise ValueError(f"{where}: {group} has no {name!r}; it has {', '.join(names)}")
                track = found.setdefault((group, name), {})
                if time_s in track:
                    raise ValueError(f"{where}: {group}.{name} has two keys at {time_s:g} s")
                track[time_s] = _number(f"{where}: {group}.{name}", value, names[name])
    return {track: _sorted(keys_of.items()) for track, keys_of in found.items()}


def _sorted(items: Iterable[tuple[float, float]]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    times, values = zip(*sorted(items), strict=True)
    return times, values


def _table(key: Mapping[str, Any], group: str, where: str) -> Mapping[str, Any]:
    table = key.get(group, {})
    if not isinstance(table, dict):
        raise ValueError(f"{where}: {group} is {table!r}, expected names and values in braces")
    return table


def _only(content: Mapping[str, Any], known: Iterable[str], what: str) -> None:
    for name in content:
        if name not in known:
            raise ValueError(f"{what} {name!r} is not known; known are {', '.join(sorted(known))}")


def _number(name: str, value: Any, limits: tuple[float, float, float]) -> float:
    _, low, high = limits
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise ValueError(f"{name} is {value!r}, expected a number from {low:g} to {high:g}")
    return float(value)


def _rate(value: Any) -> Fraction:
    try:
        rate = Fraction(value)
    except (TypeError, ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if not 1 <= rate <= 240:
        raise ValueError(f"fps is {value!r}, expected 1 to 240, or a fraction as '30000/1001'")
    return rate.limit_denominator(1001)
