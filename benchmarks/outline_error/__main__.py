"""Error near a person's outline: python -m benchmarks outline_error SOURCE DECODED

Prints the luma PSNR, dB, of a decoded call in rings along the outline of the person in the source:
0 to 6, 6 to 12 and 12 to 24 pixels from it, outside and inside, without the face.  Looks at every
tenth frame.
"""

import argparse
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import cv2
import numpy as np

from benchmarks.command import run
from encoder.capture.video_source import open_source
from encoder.detection.tflite import find_segmentation_network
from loopback.judge.observer import person_mask
from loopback.quality.psnr import psnr_db, squared_error
from loopback.quality.region_quality import FRAME_INTERVAL
from loopback.quality.video_quality import TrackedFaceMask, check_size
from shared_model.arrays import Array, Mask, Picture
from shared_model.errors import UserError

# Ends of the rings, pixels from the outline; below 0 in the person.
RINGS = ((0, 6), (6, 12), (12, 24), (-6, 0), (-12, -6), (-24, -12))


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("decoded")
    options = parser.parse_args(arguments)
    path = find_segmentation_network()
    if path is None:
        raise UserError("the segmentation network is not installed: pip install 'mediapipe'")
    with open_source(options.source) as originals, open_source(options.decoded) as copies:
        check_size(originals, copies.name, copies.width, copies.height)
        pairs = ((first[1], second[1]) for first, second in zip(originals, copies, strict=False))
        figures = ring_psnr_db(pairs, TrackedFaceMask(), partial(person_mask, path))
    print("\n".join(lines(figures)))


def lines(figures: Sequence[float]) -> list[str]:
    """A line for each ring.  figures: see `ring_psnr_db`."""
    return [
        f"{'inside' if low < 0 else 'outside'} {min(abs(low), abs(high))} to"
        f" {max(abs(low), abs(high))} px: {figure:.1f} dB"
        for (low, high), figure in zip(RINGS, figures, strict=True)
    ]


def ring_psnr_db(
    pairs: Iterable[tuple[Picture, Picture]],
    find_face: Callable[[Picture], Mask | None],
    find_person: Callable[[Picture], Mask],
) -> list[float]:
    """The PSNR, dB, in each of `RINGS`; nan where there is none.

    pairs: a frame of the source and the decoded one, (h, w, 3) uint8 BGR.
    """
    errors: list[list[Array]] = [[] for _ in RINGS]
    for index, (original, copy) in enumerate(pairs):
        if index % FRAME_INTERVAL:
            continue
        face, error = find_face(original), squared_error(original, copy)
        distance = signed_distance(find_person(original))
        for (low, high), values in zip(RINGS, errors, strict=True):
            ring = (distance > low) & (distance <= high)
            values.append(error[ring if face is None else ring & ~face])
    joined = [np.concatenate(values) if values else np.zeros(0) for values in errors]
    return [psnr_db(values) if values.size else float("nan") for values in joined]


def signed_distance(person: Mask) -> Array:
    """(h, w) pixels to the outline of a person (h, w): more than 0 outside, 0 or less inside."""
    if person.all() or not person.any():
        return np.full(person.shape, -np.inf if person.all() else np.inf)
    within, outside = (
        cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for mask in (person, ~person)
    )
    return np.asarray(np.where(person, 1 - within, outside), np.float64)


if __name__ == "__main__":
    run(main)
