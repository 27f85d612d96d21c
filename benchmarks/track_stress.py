"""Robustness of the tracker against disturbances: python -m benchmarks track_stress CLIP...

Tracks each clip undisturbed, then with an occluder that crosses the face, with a side shadow
(thesis 5.3.3) and with a second of frames dropped.  Prints the differences of pose and EAUs from
the undisturbed track during and after the disturbance, and the number of lost frames.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from itertools import islice

import cv2
import numpy as np

from benchmarks.command import run, warn
from benchmarks.track_synthetic import track_frame
from encoder.appearance.photometric import NORMALISATIONS
from encoder.capture.video_source import open_source
from encoder.thesis.trackers import TRACKED_EAUS, TrackingOptions, open_tracker
from shared_model.arrays import Picture
from shared_model.geometry import Camera, euler_deg, pixel_from_head
from shared_model.mesh import generic_head
from shared_model.parameters import EAU_INDEX, THESIS_EAUS, FaceParameters

# Frames of the disturbance.
DISTURBED = range(40, 65)
RECOVERY_FRAMES = 10
# Half the width of a head: the occluder's size, and the length of its way.
HALF_HEAD_MM = 80.0
SHADOW_GAIN = 0.35
COLUMNS = (
    *("clip", "disturbed by", "degrees off, mean", "at worst", "after"),
    *("actuators off, mean", "after", "frames lost"),
)


class DisturbedClip:
    """A clip, and its undisturbed track: faces, their centres (pixels) and scales."""

    def __init__(self, source: str, count: int, options: TrackingOptions) -> None:
        self._options = options
        with open_source(source) as capture:
            self.frames = [frame for _, frame in islice(capture, count)]
            self.size, self.elapsed_s = (capture.width, capture.height), float(1 / capture.fps)
        found, camera = self.track(self.frames)
        self.faces = faces = [face for face in found if face is not None]
        needed = DISTURBED.stop + RECOVERY_FRAMES + 1
        if len(self.frames) < needed:
            raise SystemExit(f"{source} has {len(self.frames)} frames, {needed} needed")
        if len(faces) < len(self.frames):
            raise SystemExit(
                f"{source}: lost undisturbed in {len(self.frames) - len(faces)} frames"
            )
        self.centres = [pixel_from_head(camera, f.pose, np.array([0.0, -20, 90])) for f in faces]
        self.px_per_mm = [camera.focal_px / float(f.pose.translation_mm[2]) for f in faces]

    def track(self, frames: Sequence[Picture]) -> tuple[list[FaceParameters | None], Camera]:
        """The faces of frames, and the camera."""
        head = generic_head()
        tracker = open_tracker(self._options, head, self.size, TRACKED_EAUS, self.elapsed_s, warn)
        faces = [track_frame(tracker, frame) for frame in frames]
        return faces, tracker.fitted.camera

    def occluded(self, index: int) -> Picture:
        """Frame `index` with a grey rectangle that crosses the face from left to right."""
        frame, share = self.frames[index].copy(), _progress(index)
        reach = HALF_HEAD_MM * self.px_per_mm[index]
        x = self.centres[index][0] + (3 * share - 1.5) * reach
        y = self.centres[index][1]
        low = np.rint([x - reach / 2, y - 2 * reach]).astype(int).tolist()
        high = np.rint([x + reach / 2, y + 2 * reach]).astype(int).tolist()
        cv2.rectangle(frame, low, high, (120, 125, 130), -1)
        return frame

    def shadowed(self, index: int) -> Picture:
        """Frame `index` with one side of the face in a shadow that comes and goes."""
        depth = (1 - SHADOW_GAIN) * np.sin(np.pi * _progress(index))
        edge = (np.arange(self.size[0]) - self.centres[index][0]) / (
            0.1 * HALF_HEAD_MM * self.px_per_mm[index]
        )
        gain = 1 - depth / (1 + np.exp(np.clip(edge, -30, 30)))
        return np.asarray(np.rint(self.frames[index] * gain[None, :, None]), np.uint8)


def _progress(index: int) -> float:
    """0 at the first frame of the disturbance, 1 after its last."""
    return (index - DISTURBED.start) / len(DISTURBED)


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source", nargs="+")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--normalise", choices=tuple(NORMALISATIONS), default="none")
    options = parser.parse_args(arguments)
    print(f"| {' | '.join(COLUMNS)} |")
    print("|---" * len(COLUMNS) + "|")
    for source in options.source:
        clip = DisturbedClip(source, options.frames, TrackingOptions(normalise=options.normalise))
        for name, disturbed in disturbances(clip).items():
            print(
                f"| {source.rsplit('/', 1)[-1]} | {name} | {table_cells(clip, disturbed)} |",
                flush=True,
            )


def disturbances(clip: DisturbedClip) -> Mapping[str, Sequence[int | Picture]]:
    """The frames of each disturbance: the index of an undisturbed frame, or a picture."""

    def replaced(change: Callable[[int], Picture]) -> list[int | Picture]:
        return [change(i) if i in DISTURBED else i for i in range(len(clip.frames))]

    return {
        "occluder": replaced(clip.occluded),
        "side shadow": replaced(clip.shadowed),
        "a second dropped": [i for i in range(len(clip.frames)) if i not in DISTURBED],
    }


def table_cells(clip: DisturbedClip, disturbed: Sequence[int | Picture]) -> str:
    """The cells of one clip and disturbance."""
    frames = [clip.frames[item] if isinstance(item, int) else item for item in disturbed]
    faces, _ = clip.track(frames)
    numbers = [item if isinstance(item, int) else i for i, item in enumerate(disturbed)]
    during: list[tuple[float, float]] = []
    after: list[tuple[float, float]] = []
    for number, face in zip(numbers, faces, strict=True):
        if face is None or number < DISTURBED.start:
            continue
        errors = _rms_errors(face, clip.faces[number])
        (during if number < DISTURBED.stop + RECOVERY_FRAMES else after).append(errors)
    lost = sum(face is None for face in faces)
    during_errors, after_errors = np.array(during), np.array(after)
    return (
        f"{during_errors[:, 0].mean():.2f} | {during_errors[:, 0].max():.2f}"
        f" | {after_errors[:, 0].mean():.2f} | {during_errors[:, 1].mean():.3f}"
        f" | {after_errors[:, 1].mean():.3f} | {lost}"
    )


def _rms_errors(face: FaceParameters, reference: FaceParameters) -> tuple[float, float]:
    """RMS difference of the three angles, degrees, and of the thesis' EAUs."""
    angles = np.array(euler_deg(face.pose)) - euler_deg(reference.pose)
    at = [EAU_INDEX[name] for name in THESIS_EAUS]
    difference = face.eau[at] - reference.eau[at]
    return float(np.sqrt(np.mean(angles**2))), float(np.sqrt(np.mean(difference**2)))


if __name__ == "__main__":
    run(main)
