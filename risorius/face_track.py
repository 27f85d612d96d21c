"""The tracker alone: pose and actuators of every frame of a video."""

from collections.abc import Callable, Collection, Generator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from encoder.capture.video_source import Capture, open_source
from encoder.thesis.trackers import open_tracker
from encoder.thesis.tracking_options import TrackingOptions
from risorius.statistical_model import expression_search, landmark_source
from risorius.track_files import FORMATS
from runtime.parallel import prefetch
from shared_model.anatomy.expressions import signature
from shared_model.arrays import Array, Picture
from shared_model.errors import NO_FACE, UserError
from shared_model.geometry import euler_deg
from shared_model.mesh import generic_head
from shared_model.parameters import EAUS, FaceParameters
from shared_model.whole_file import whole_file

Progress = Callable[[int, int | None], None]

POSE_COLUMNS = ("pitch_deg", "yaw_deg", "roll_deg", "x_mm", "y_mm", "z_mm")
EAU_COLUMNS = tuple(eau.name for eau in EAUS)


@dataclass(frozen=True, slots=True)
class FaceTrack:
    """The face in every frame of a video; nan where there is none.

    time_s: (t,) seconds from the first frame.
    pose: (t, 6) by `POSE_COLUMNS`: turned as `euler_deg` says; the place of the head's origin,
        between the ears, in the camera's frame: x to the right, y down, z away.
    eau: (t, 14) by `EAU_COLUMNS`, in the ranges of `shared_model.parameters.EAUS`.
    confidence: (t,) 0..1, see `FaceTracker.confidence`.
    warnings: what the user should know.
    """

    time_s: Array
    pose: Array
    eau: Array
    confidence: Array
    warnings: tuple[str, ...] = ()

    @property
    def parameters(self) -> Array:
        """(t, 20): pose and EAUs side by side."""
        return np.hstack([self.pose, self.eau])

    @property
    def action_units(self) -> dict[str, Array]:
        """(t,) intensity of each action unit, 0..1: see `action_unit_intensities`."""
        return action_unit_intensities(self.eau)

    @property
    def emotions(self) -> dict[str, Array]:
        """(t,) similarity to each of the six emotions, 0..1: see `signature`."""
        return signature(self.eau)

    @property
    def columns(self) -> dict[str, Array]:
        """(t,) each: time, pose, EAUs, action units, emotions, confidence, by name."""
        names = (*POSE_COLUMNS, *EAU_COLUMNS)
        parameters = dict(zip(names, self.parameters.T, strict=True))
        more = {**self.action_units, **self.emotions}
        return {"time_s": self.time_s, **parameters, **more, "confidence": self.confidence}

    def write(self, target: str | Path, kind: str | None = None) -> None:
        """Write it whole into a file, see `risorius.track_files`.

        kind: one of `FORMATS`; None: by the suffix, "json" or else "csv".
        Raises `UserError` if it cannot be written.
        """
        path = Path(target)
        kind = kind or ("json" if path.suffix.lower() == ".json" else "csv")
        with whole_file(path) as file:
            file.write(FORMATS[kind](self.columns).encode())

    def write_csv(self, target: str | Path | TextIO) -> None:
        """Write a line for each frame: time, pose, EAUs, action units, emotions, confidence.

        target: name of a file, or an open one.  Cells of a frame without a face are empty.
        Raises `UserError` if it cannot be written.
        """
        if isinstance(target, str | Path):
            self.write(target, "csv")
        else:
            target.write(FORMATS["csv"](self.columns))


def track(
    source: str,
    max_frames: int | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] = lambda: False,
    aam: str | Path | None = None,
    without: Collection[str] = (),
    aam_feedback: bool = False,
) -> FaceTrack:
    """Track the face of a video file, image pattern, camera index or URL, until `stop`.

    progress: called with the number of frames so far and of all, None if that is not known.
    aam: a model of many faces that finds landmarks; None: the network does.
    without: parts of the tracker to leave out, see `TrackingOptions`.
    aam_feedback: that model also measures every frame's actuators, see `ModelFeedback`.
    Raises `UserError` if the source or the model cannot be read or shows no face.
    """
    source_of_landmarks = landmark_source(aam)
    times, faces, confidence, warnings = list[float](), list[Array](), list[float](), list[str]()
    # Reading ahead ends before the capture is closed.
    with open_source(source, square_pixels=True) as capture, closing(_frames(capture)) as frames:
        size, frame_s = (capture.width, capture.height), float(1 / capture.fps)
        options = TrackingOptions(
            without=frozenset(without),
            eyelids=True,
            refine_identity=False,
            landmarks=source_of_landmarks,
            expression_search=expression_search(aam if aam_feedback else None),
        )
        active = range(len(EAUS))
        tracker = open_tracker(options, generic_head(), size, active, frame_s, warnings.append)
        for index, frame in frames:
            if stop() or index == max_frames:
                break
            times.append(index * frame_s)
            faces.append(_row(tracker.update(frame)))
            confidence.append(tracker.confidence)
            if progress is not None:
                progress(index + 1, max_frames or capture.frame_count)
    rows = np.array(faces).reshape(-1, len(POSE_COLUMNS) + len(EAUS))
    if np.isnan(rows).all():
        raise UserError(f"{source}: no face found in {len(rows)} frames", NO_FACE)
    pose, eau = np.split(rows, [len(POSE_COLUMNS)], axis=1)
    said = tuple(dict.fromkeys(warnings))
    return FaceTrack(np.array(times), pose, eau, np.array(confidence), said)


def action_unit_intensities(eau: Array) -> dict[str, Array]:
    """Intensity of each action unit of FACS, by number: 0 at rest, 1 at the end of its EAU's range.

    eau: (..., 14).  An EAU is one unit above rest and may be another below.  Of a unit that is in
    several EAUs, as those of both eyelids, the strongest counts.
    """
    found: dict[str, Array] = {}
    for index, item in enumerate(EAUS):
        above, _, below = item.au.partition(" / ")
        for name, end in ((above, item.high), (below, item.low)):
            if name:
                value = np.clip(eau[..., index] / end, 0, 1)
                found[name] = np.maximum(found[name], value) if name in found else value
    return dict(sorted(found.items(), key=lambda each: int(each[0].removeprefix("AU"))))


def _frames(capture: Capture) -> Generator[tuple[int, Picture], None, None]:
    """The frames with their numbers; those of a recorded source are read in the background."""
    yield from iter(capture) if capture.is_live else prefetch(iter(capture))


def _row(face: FaceParameters | None) -> Array:
    if face is None:
        return np.full(len(POSE_COLUMNS) + len(EAUS), np.nan)
    return np.array([*euler_deg(face.pose), *face.pose.translation_mm, *face.eau])
