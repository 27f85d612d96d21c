"""Rendering of tracked faces at the full frame rate: python -m benchmarks full_rate SOURCE VIDEO

Tracks SOURCE and renders the first frame's texture and shape at the face of every frame: the thesis
profile without its sampling at ten frames a second and its quantisation to eight bits.  --light
fits low-order illumination to each frame's face by least squares: an offset and a quadratic gain,
seven numbers a frame, not quantised.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np

from benchmarks.command import run, warn
from benchmarks.track_synthetic import track_frame
from decoder.scene.decoded_model import decoded_model
from decoder.scene.scene import Scene
from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import Capture, open_source
from encoder.coding.model_packet import budget_for, build_thesis_model_packet, call_parameters
from encoder.thesis.trackers import TRACKED_EAUS, open_tracker
from encoder.thesis.tracking_options import TrackingOptions
from loopback.quality.video_quality import TrackedFaceMask
from shared_model.arrays import Array, Mask, Picture
from shared_model.errors import UserError
from shared_model.mesh import generic_head
from shared_model.parameters import FaceParameters
from shared_model.stage_timer import StageTimer

# The standard deviation of the illumination's edge outside the face, in picture widths.
EDGE_SIGMA = 0.01


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("video", type=Path)
    parser.add_argument("--frames", type=int, help="only so many")
    parser.add_argument("--light", action="store_true", help="light as it suits each frame")
    parser.add_argument("--without-lids", action="store_true", help="the thesis' four actuators")
    options = parser.parse_args(arguments)
    tracking = TrackingOptions(eyelids=not options.without_lids, refine_identity=False)
    with ExitStack() as stack:
        capture = stack.enter_context(open_source(options.source))
        size = capture.width, capture.height
        sink = stack.enter_context(
            open_sink(options.video, *size, capture.fps, capture.colour_matrix)
        )
        face_mask = TrackedFaceMask() if options.light else None
        for original, rendered in tracked_renderings(capture, tracking, options.frames, stack):
            face = face_mask(original) if face_mask else None
            sink.write(rendered if face is None else relit(rendered, original, face))


def tracked_renderings(
    capture: Capture, options: TrackingOptions, frames: int | None, stack: ExitStack
) -> Iterator[tuple[Picture, Picture]]:
    """Each source frame, and the rendering of its face; a lost face stays where it was."""
    head, scene, last = generic_head(), None, None
    size, elapsed_s = (capture.width, capture.height), float(1 / capture.fps)
    tracker = open_tracker(options, head, size, TRACKED_EAUS, elapsed_s, warn)
    for index, frame in capture:
        if index == frames:
            return
        face = track_frame(tracker, frame)
        if scene is None:
            if face is None:
                raise UserError(f"{capture.name} begins without a face")
            fitted = tracker.fitted
            call = call_parameters(capture.format, "thesis", fitted.camera.focal_px, index)
            model = build_thesis_model_packet(
                head, fitted, face, frame, call, budget_for("thesis", None)
            )
            scene = Scene(decoded_model(model))
            stack.callback(scene.close)
        last = face or last
        assert last is not None
        shown = FaceParameters(last.pose, last.eau)
        yield frame, scene.draw(shown, StageTimer())


def relit(rendered: Picture, original: Picture, face: Mask) -> Picture:
    """A rendering with the illumination of the original fitted to it.

    rendered, original: (h, w, 3) uint8 BGR.  face: (h, w) mask of the face in the original.
    """
    factors = _gain_basis(face)
    rendered_luma, original_luma = (_luma(picture)[face] for picture in (rendered, original))
    columns = [factor[face] * rendered_luma for factor in factors]
    # One illumination for all channels, from luma.
    coefficients = np.linalg.lstsq(
        np.stack([*columns, np.ones_like(rendered_luma)], 1),
        original_luma - rendered_luma,
        rcond=None,
    )[0]
    gain = np.tensordot(coefficients[:-1], factors, 1)
    # The illumination is extrapolated outside the face, and fades.
    opacity = cv2.GaussianBlur(face.astype(np.float64), (0, 0), EDGE_SIGMA * face.shape[1])
    opacity[face] = 1.0
    change = opacity[..., None] * (gain[..., None] * rendered + coefficients[-1])
    return np.asarray(np.clip(np.rint(rendered + change), 0, 255), np.uint8)


def _gain_basis(face: Mask) -> Array:
    """(6, h, w) quadratic monomials of the place in the picture, about the face's centre."""
    rows, columns = np.nonzero(face)
    down, across = np.mgrid[: face.shape[0], : face.shape[1]]
    x = (across - columns.mean()) / max(float(np.ptp(columns)), 1.0)
    y = (down - rows.mean()) / max(float(np.ptp(rows)), 1.0)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def _luma(picture: Picture) -> Array:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.float64)


if __name__ == "__main__":
    run(main)
