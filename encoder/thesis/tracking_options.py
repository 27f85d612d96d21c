"""What the thesis' tracker is asked for: choices by name, and what each name stands for."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from encoder.appearance.photometric import NORMALISATIONS, Normalisation
from encoder.fitting.analysis_by_synthesis import TexelFitter
from encoder.fitting.expression_search import ExpressionSearch
from encoder.fitting.landmark_source import LandmarkSource
from encoder.thesis.klt import KLT_POINTS
from encoder.thesis.measurement_model import PROJECTIONS, Projection
from encoder.thesis.prediction_matrix import PredictionMatrixFitter
from encoder.thesis.symmetry import MirroredMatrixFitter, SymmetricTexelFitter
from shared_model.errors import UserError

DETECTORS = ("network", "haar")
TRACKERS = ("single", "full")
TRACKER_PARTS = ("network", "klt", "ekf", "abs")
# How the analysis by synthesis computes its steps: by the gradient of each picture, the same with
# symmetry for turned faces, by the prediction matrices of the thesis, or by these with symmetry.
FITTERS: Mapping[str, type[TexelFitter]] = {
    "gauss-newton": TexelFitter,
    "mirrored": SymmetricTexelFitter,
    "matrix": PredictionMatrixFitter,
    "mirrored-matrix": MirroredMatrixFitter,
}


@dataclass(frozen=True, slots=True)
class TrackingOptions:
    """Options of `open_tracker` and `ModelTracker`.  Raises `UserError` for an unknown choice.

    detector: one of `DETECTORS`; has no effect with `landmarks`.
    tracker: "single" measures every frame by itself, "full" is `ModelTracker`.
    without: parts of the full tracker to leave out, some of `TRACKER_PARTS`.
    normalise: photometric normalisation of the full tracker, one of `NORMALISATIONS`.
    step: how the full tracker fits the texture, one of `FITTERS`.
    eyelids: find and send the eyelids, by the iris network.
    refine_identity: refine the identity during the call; the full tracker only, with landmarks and
        with "abs".
    landmarks: finds landmarks instead of the network; None: the detector says how.
    nose: see `HaarDetector`.
    klt_points: one of `KLT_POINTS`, of the full tracker.
    projection: how the full tracker's filter projects points, one of `PROJECTIONS`.
    free_focal: the focal length is in the filter's state, see `MeasurementFusion`.
    expression_search: measures what the full tracker's filter has, see `ModelFeedback`.
    """

    detector: str = "network"
    tracker: str = "full"
    without: frozenset[str] = frozenset()
    normalise: str = "none"
    step: str = "gauss-newton"
    eyelids: bool = False
    refine_identity: bool = True
    landmarks: LandmarkSource | None = None
    nose: Path | None = None
    klt_points: str = "first"
    projection: str = "perspective"
    free_focal: bool = False
    expression_search: ExpressionSearch | None = None

    def __post_init__(self) -> None:
        _check("detector", [self.detector], DETECTORS)
        _check("tracker", [self.tracker], TRACKERS)
        _check("part", self.without, TRACKER_PARTS)
        _check("normalisation", [self.normalise], tuple(NORMALISATIONS))
        _check("step", [self.step], tuple(FITTERS))
        _check("choice of points", [self.klt_points], KLT_POINTS)
        _check("projection", [self.projection], tuple(PROJECTIONS))

    @property
    def normalisation(self) -> Normalisation:
        """Takes a BGR picture to the values that are compared."""
        return NORMALISATIONS[self.normalise]

    @property
    def fitter(self) -> type[TexelFitter]:
        """How the steps of the texture's fit are computed."""
        return FITTERS[self.step]

    @property
    def measurement_model(self) -> Projection:
        """The filter's projection."""
        return PROJECTIONS[self.projection]


def _check(what: str, chosen: Iterable[str], known: Sequence[str]) -> None:
    for name in chosen:
        if name not in known:
            raise UserError(f"{what} {name} is unknown; choose one of {', '.join(known)}")
