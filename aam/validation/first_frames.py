"""First frames without a landmark network: Viola-Jones finds the eyes, the AAM the rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aam.search.find_face import find_in_window, starts_at_eyes
from aam.search.search import SearchOptions
from aam.validation.contenders import Contender, errors
from aam.validation.planar_warp import PLANAR_LANDMARKS
from aam.validation.samples import Sample
from aam.validation.search_experiments import RIGHT_NME
from encoder.detection.viola_jones import HaarDetector

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FirstFrames:
    """pictures: in all.  found: in which the detector sees a face.

    nme: (found,) mean distance of 68 landmarks in terms of the outer corners of the eyes.
    """

    pictures: int
    found: int
    nme: Array

    @property
    def right(self) -> float:
        """Share of all pictures whose mean distance is below 5 %."""
        return float((self.nme < RIGHT_NME).sum()) / self.pictures


def first_frames(contender: Contender, samples: Sequence[Sample]) -> FirstFrames:
    """Detect and search each picture; of several starts the one that leaves the least counts."""
    detector, nme = HaarDetector(), []
    for sample in samples:
        faces = detector.detect(sample.face.window.picture)
        if faces:
            mean, eyes = contender.levels[0].shape.mean, faces[0].keypoints[:2]
            fit = find_in_window(
                contender.levels,
                contender.warps,
                contender.options.normalisation,
                sample.face.window,
                starts_at_eyes(contender.warps[0], mean, eyes),
                SearchOptions(),
            )
            nme.append(errors(sample, contender.points(fit.landmarks, PLANAR_LANDMARKS))[1])
    return FirstFrames(len(samples), len(nme), np.array(nme))
