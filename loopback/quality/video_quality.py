"""PSNR of a decoded video against its source, over the face and over the whole picture."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import zip_longest
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.capture.colour import luma_u8
from encoder.capture.picture_size import in_square_pixels
from encoder.capture.video_source import Capture, open_source
from encoder.detection.landmark_indices import face_outline
from encoder.detection.landmarks import open_landmark_tracker
from encoder.detection.tflite import NetworkFilesMissing
from loopback.quality.psnr import psnr_db, squared_error
from loopback.quality.region_quality import RegionMeter, RegionQuality
from loopback.report import figures_of, rounded
from runtime.image_ops import hull_mask
from shared_model.arrays import Array, Mask, Picture
from shared_model.errors import UserError

# Of structural similarity: the Gaussian window, pixels, and (0.01 * 255)^2 and (0.03 * 255)^2.
WINDOW, SIGMA = (11, 11), 1.5
C1, C2 = 6.5025, 58.5225

Progress = Callable[[int, int | None], None]
# The face of a picture as a mask, (height, width) bool; None: no face.
FaceMaskFinder = Callable[[Picture], Mask | None]


@dataclass(frozen=True, slots=True)
class Quality:
    """PSNR of luma (eq. 6.1), dB: mean over the frames and 5th percentile.

    frames: compared; face_frames: those of them whose source shows a face.
    face_*: over the face mask of the source, None without any face; full_*: over the whole picture.
    *_ssim: mean structural similarity, if it was measured.
    regions: what is around the face, if it was measured.
    """

    frames: int
    face_frames: int
    face_psnr_db: float | None
    face_psnr_p5_db: float | None
    full_psnr_db: float | None
    full_psnr_p5_db: float | None
    face_ssim: float | None = None
    full_ssim: float | None = None
    regions: RegionQuality | None = None

    def figures(self) -> dict[str, Any]:
        """All figures by name, those of the regions among the others if they were measured."""
        return figures_of(self)


class TrackedFaceMask:
    """Finds the face mask of one picture after another by the landmark network.

    Raises `NetworkFilesMissing` where it is not installed.
    """

    def __init__(self) -> None:
        self._tracker = open_landmark_tracker(refine_eyelids=False)

    def __call__(self, picture: Picture) -> Mask | None:
        """The mask inside the outline of the face in `picture`; None if there is no face."""
        found = self._tracker.update(picture)
        return None if found is None else face_oval_mask(found.points, *picture.shape[:2])


def measure_quality(
    source: str,
    decoded: str,
    find_face_mask: FaceMaskFinder,
    progress: Progress,
    max_frames: int | None = None,
    is_strict: bool = True,
    regions: RegionMeter | None = None,
    with_ssim: bool = False,
) -> Quality:
    """Compare a decoded video with its source, frame by frame.

    source, decoded: anything `open_source` opens.  max_frames: compare no more frames.
    is_strict: one that ends before the other, and before `max_frames`, is an error; else only the
        frames of both are compared.
    regions: measures what is around the face as well.  with_ssim: see `Quality`.
    Raises `UserError` if they have different sizes.
    """
    with open_source(source) as originals, open_source(decoded) as copies:
        check_size(originals, copies.name, copies.width, copies.height)

        def pairs() -> Iterator[tuple[Picture, Picture]]:
            for index, (original, copy) in enumerate(zip_longest(originals, copies)):
                ends = original is None or copy is None
                if index == max_frames or (ends and not is_strict):
                    break
                if original is None or copy is None:
                    raise UserError(
                        f"{decoded} and {source} have different numbers of frames: one ends at"
                        f" {index}"
                    )
                yield original[1], copy[1]
                progress(index + 1, max_frames or originals.frame_count)

        aspect = originals.sample_aspect
        return measure_pictures(pairs(), find_face_mask, aspect, regions, with_ssim)


def measure_pictures(
    pairs: Iterable[tuple[Picture, Picture]],
    find_face_mask: FaceMaskFinder,
    aspect: Fraction = Fraction(1),
    regions: RegionMeter | None = None,
    with_ssim: bool = False,
) -> Quality:
    """Compare pictures of a source (h, w, 3) uint8 BGR with what was decoded of them, in order.

    aspect: of a sample.  regions, with_ssim: see `measure_quality`.
    """
    face: list[float] = []
    full: list[float] = []
    face_ssim: list[float] = []
    full_ssim: list[float] = []
    for index, (original, copy) in enumerate(pairs):
        error = squared_error(original, copy)
        full.append(psnr_db(error))
        mask = in_source_pixels(find_face_mask, original, aspect)
        has_face = mask is not None and bool(mask.any())
        if has_face:
            face.append(psnr_db(error[mask]))
        if with_ssim:
            similar = ssim_map(original, copy)
            full_ssim.append(float(similar.mean()))
            face_ssim += [float(similar[mask].mean())] if has_face else []
        if regions is not None:
            regions.add(index, original, copy, mask)
    around = None if regions is None else regions.result()
    psnr = *_mean_and_p5(face), *_mean_and_p5(full)
    return Quality(len(full), len(face), *psnr, _mean(face_ssim), _mean(full_ssim), around)


def source_frame_count(source: str, expected: int) -> int:
    """Number of frames of a recorded video.

    expected: where the container states this number, it is believed.  Any other number may be a
    guess of the container's: the frames are counted.
    """
    with open_source(source) as capture:
        return expected if capture.frame_count == expected else sum(1 for _ in capture)


def face_oval_mask(points_px: NDArray[np.floating], height: int, width: int) -> Mask:
    """The mask inside the face's outline.  points_px: (468 or more, 2 or more), pixels."""
    return hull_mask(face_outline(points_px), (height, width)) > 0


def in_source_pixels(find: FaceMaskFinder, picture: Picture, aspect: Fraction) -> Mask | None:
    """The mask of the face in a picture of this sample aspect ratio, found in square pixels."""
    square = in_square_pixels(picture, aspect)
    mask = find(square)
    if mask is None or square is picture:
        return mask
    size = picture.shape[1], picture.shape[0]
    return cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0


def check_size(originals: Capture, copy: str, width: int, height: int) -> None:
    """Raise `UserError` if what is called `copy` has not the size of its source."""
    if (originals.width, originals.height) != (width, height):
        raise UserError(
            f"{copy} is {width}x{height} but {originals.name} is"
            f" {originals.width}x{originals.height}: is it another call's?"
        )


def _mean_and_p5(values: list[float]) -> tuple[float | None, float | None]:
    if not values:
        return None, None
    return rounded(float(np.mean(values))), rounded(float(np.percentile(values, 5)))


def _mean(values: list[float]) -> float | None:
    return rounded(float(np.mean(values)), 4) if values else None


def face_mask_finder(warn: Callable[[str], None]) -> FaceMaskFinder:
    """A finder with the landmark network; where that is not installed, one that finds no face."""
    try:
        return TrackedFaceMask()
    except NetworkFilesMissing as error:
        warn(f"risorius: warning: {error}; no PSNR over the face")
        return lambda picture: None


def ssim_map(original: Picture, copy: Picture) -> Array:
    """(h, w) structural similarity of luma (Wang et al. 2004) at each pixel of pictures
    (h, w, 3) uint8 BGR, 1 where they are equal.
    """
    a, b = (luma_u8(picture).astype(np.float64) for picture in (original, copy))
    mean_a, mean_b = _window_mean(a), _window_mean(b)
    variance_a, variance_b = _window_mean(a * a) - mean_a**2, _window_mean(b * b) - mean_b**2
    covariance = _window_mean(a * b) - mean_a * mean_b
    likeness = (2 * mean_a * mean_b + C1) * (2 * covariance + C2)
    return likeness / ((mean_a**2 + mean_b**2 + C1) * (variance_a + variance_b + C2))


def _window_mean(values: Array) -> Array:
    return np.asarray(cv2.GaussianBlur(values, WINDOW, SIGMA), np.float64)
