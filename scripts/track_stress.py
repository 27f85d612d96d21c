"""What disturbs the tracker, and how soon it is back: python -m scripts.track_stress CLIP...

Follows each clip as it is, then with an occluder crossing the face, with a shadow from the side
(thesis 5.3.3) and with a second of frames dropped, and prints how far pose and actuators are from
the undisturbed ones during the disturbance and after it, and how many frames were given up.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.appearance.photometric import NORMALISATIONS
from encoder.capture.video_source import open_source
from encoder.tracking.trackers import TRACKED_EAUS, TrackingOptions, open_tracker
from scripts.command import run, warn
from scripts.track_synthetic import follow_frame
from shared_model.geometry import Camera, euler_deg, pixel_from_head
from shared_model.mesh import generic_head
from shared_model.parameters import EAU_INDEX, THESIS_EAUS, FaceParameters

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

FIRST, LAST = 40, 65  # frames of the disturbance
SETTLE = 10
# A head's half width, mm: the occluder's size and how far it goes.
HEAD_MM = 80.0
DARKNESS = 0.35
COLUMNS = (
    *("clip", "disturbed by", "degrees off, mean", "at worst", "after"),
    *("actuators off, mean", "after", "frames lost"),
)


class Stage:
    """The undisturbed clip: its frames, and where the face was in each, pixels."""

    def __init__(self, source: str, count: int, options: TrackingOptions) -> None:
        self._options = options
        with open_source(source) as capture:
            self.frames = [frame for _, frame in islice(capture, count)]
            self.size, self.elapsed_s = (capture.width, capture.height), float(1 / capture.fps)
        found, camera = self.follow(self.frames)
        self.faces = seen = [face for face in found if face is not None]
        if len(self.frames) <= LAST + SETTLE:
            raise SystemExit(f"{source} has {len(self.frames)} frames, {LAST + SETTLE + 1} needed")
        if len(seen) < len(self.frames):
            raise SystemExit(f"{source}: lost undisturbed in {len(self.frames) - len(seen)} frames")
        self.centres = [pixel_from_head(camera, f.pose, np.array([0.0, -20, 90])) for f in seen]
        self.px_per_mm = [camera.focal_px / float(f.pose.translation_mm[2]) for f in seen]

    def follow(self, frames: Sequence[Picture]) -> tuple[list[FaceParameters | None], Camera]:
        """Faces of the frames, and the camera."""
        head = generic_head()
        follower = open_tracker(self._options, head, self.size, TRACKED_EAUS, self.elapsed_s, warn)
        faces = [follow_frame(follower, frame) for frame in frames]
        return faces, follower.fitted.camera

    def occluded(self, index: int) -> Picture:
        """A grey card as wide as half the face crosses it from left to right."""
        frame, share = self.frames[index].copy(), (index - FIRST) / (LAST - FIRST)
        reach = HEAD_MM * self.px_per_mm[index]
        x = self.centres[index][0] + (3 * share - 1.5) * reach
        y = self.centres[index][1]
        low = np.rint([x - reach / 2, y - 2 * reach]).astype(int).tolist()
        high = np.rint([x + reach / 2, y + 2 * reach]).astype(int).tolist()
        cv2.rectangle(frame, low, high, (120, 125, 130), -1)
        return frame

    def shadowed(self, index: int) -> Picture:
        """One side of the face falls into shadow, and comes out of it."""
        depth = (1 - DARKNESS) * np.sin(np.pi * (index - FIRST) / (LAST - FIRST))
        edge = (np.arange(self.size[0]) - self.centres[index][0]) / (
            0.1 * HEAD_MM * self.px_per_mm[index]
        )
        gain = 1 - depth / (1 + np.exp(np.clip(edge, -30, 30)))
        return np.asarray(np.rint(self.frames[index] * gain[None, :, None]), np.uint8)


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source", nargs="+")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--normalise", choices=tuple(NORMALISATIONS), default="none")
    options = parser.parse_args(arguments)
    print(f"| {' | '.join(COLUMNS)} |")
    print("|---" * len(COLUMNS) + "|")
    for source in options.source:
        stage = Stage(source, options.frames, TrackingOptions(normalise=options.normalise))
        for name, disturbed in disturbances(stage).items():
            print(f"| {source.rsplit('/', 1)[-1]} | {name} | {row(stage, disturbed)} |", flush=True)


def disturbances(stage: Stage) -> Mapping[str, Sequence[int | Picture]]:
    """Name -> frames: the number of an undisturbed one, or another picture."""

    def replaced(change: Callable[[int], Picture]) -> list[int | Picture]:
        return [change(i) if FIRST <= i < LAST else i for i in range(len(stage.frames))]

    return {
        "occluder": replaced(stage.occluded),
        "side shadow": replaced(stage.shadowed),
        "a second dropped": [i for i in range(len(stage.frames)) if not FIRST <= i < LAST],
    }


def row(stage: Stage, disturbed: Sequence[int | Picture]) -> str:
    """One row's cells."""
    frames = [stage.frames[item] if isinstance(item, int) else item for item in disturbed]
    faces, _ = stage.follow(frames)
    numbers = [item if isinstance(item, int) else i for i, item in enumerate(disturbed)]
    during: list[tuple[float, float]] = []
    after: list[tuple[float, float]] = []
    for number, face in zip(numbers, faces, strict=True):
        if face is None or number < FIRST:
            continue
        off = _off(face, stage.faces[number])
        (during if number < LAST + SETTLE else after).append(off)
    lost = sum(face is None for face in faces)
    hit, rest = np.array(during), np.array(after)
    return (
        f"{hit[:, 0].mean():.2f} | {hit[:, 0].max():.2f} | {rest[:, 0].mean():.2f}"
        f" | {hit[:, 1].mean():.3f} | {rest[:, 1].mean():.3f} | {lost}"
    )


def _off(face: FaceParameters, like: FaceParameters) -> tuple[float, float]:
    """Root mean square difference of the three angles, degrees, and of the four actuators."""
    angles = np.array(euler_deg(face.pose)) - euler_deg(like.pose)
    at = [EAU_INDEX[name] for name in THESIS_EAUS]
    difference = face.eau[at] - like.eau[at]
    return float(np.sqrt(np.mean(angles**2))), float(np.sqrt(np.mean(difference**2)))


if __name__ == "__main__":
    run(main)
