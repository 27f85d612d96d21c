"""A clip that is a clock: a face that opens its mouth at times that no other stretch repeats, and
sounds just then."""

from fractions import Fraction
from pathlib import Path

import numpy as np

from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source
from risorius.animation.animate import animate
from shared_model.arrays import Array

FPS, RATE_HZ = 25, 16000
SECONDS = 20.0
# Length of an open mouth, and of a closed one at least and at most.
OPEN_S, CLOSED_S = 0.36, (0.4, 1.2)
EDGE_S = 0.04


def openings(seed: int = 5) -> list[float]:
    """When the mouth opens, seconds from the beginning."""
    source, times_s = np.random.default_rng(seed), [0.6]
    while times_s[-1] + OPEN_S + CLOSED_S[1] + 0.6 < SECONDS:
        times_s.append(times_s[-1] + OPEN_S + float(source.uniform(*CLOSED_S)))
    # On pictures, so that sound and picture change at the same moment.
    return [round(time_s * FPS) / FPS for time_s in times_s]


def is_open(time_s: Array) -> Array:
    """How far the mouth is open, 0 to 1, at times (n,) of the clip, which is repeated."""
    times_s, level = time_s % SECONDS, np.zeros(len(time_s))
    for start_s in openings():
        rise = np.clip((times_s - start_s) / EDGE_S, 0, 1)
        fall = np.clip((start_s + OPEN_S - times_s) / EDGE_S, 0, 1)
        level = np.maximum(level, np.minimum(rise, fall))
    return level


def write_clip(folder: Path) -> Path:
    """Draw the clip into a folder; returns its path."""
    script = folder / "clock.toml"
    script.write_text(_script())
    silent, path = folder / "silent.mkv", folder / "clock.mkv"
    animate(script, silent, lambda done, total: None, lambda: False)
    time_s = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    buzz = sum(np.sin(2 * np.pi * 120 * k * time_s) / k for k in range(1, 30))
    sound = np.asarray(6000 * buzz * is_open(time_s), np.int16)
    with open_source(str(silent)) as capture:
        size = capture.width, capture.height
        with open_sink(path, *size, Fraction(FPS), "bt601", False, RATE_HZ) as sink:
            for _, frame in capture:
                sink.write(frame)
            sink.write_sound(sound)
    return path


def write_empty_clip(folder: Path) -> Path:
    """Write a clip that shows nobody into a folder; returns its path."""
    path, frame = folder / "nobody.mkv", np.full((240, 320, 3), 128, np.uint8)
    with open_sink(path, 320, 240, Fraction(FPS), "bt601", False, None) as sink:
        for _ in range(round(SECONDS * FPS)):
            sink.write(frame)
    return path


def _script() -> str:
    lines = [
        "width = 320",
        "height = 240",
        f"fps = {FPS}",
        f"seconds = {SECONDS}",
        "distance_mm = 480",
        "noise = 1",
    ]
    for start_s in openings():
        for time_s, value in (
            (start_s, 0.0),
            (start_s + EDGE_S, 0.8),
            (start_s + OPEN_S - EDGE_S, 0.8),
            (start_s + OPEN_S, 0.0),
        ):
            lines += ["[[key]]", f"time = {time_s:.3f}", f"eau = {{ jaw_drop = {value} }}"]
    return "\n".join(lines) + "\n"
