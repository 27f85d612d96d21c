"""Detection of tracking failure, and implausible poses (thesis 5.2)."""

from encoder.fitting.fit_results import IdentityFit, TextureFit
from encoder.thesis.klt import Tracks
from shared_model.parameters import FaceParameters

# Correlation with the person's texture below which tracking has failed.
MIN_CORRELATION = 0.5
# The same in frames in which the landmark network finds no face.
MIN_CORRELATION_UNDETECTED = 0.75
# The same for a face that is found again, which needs more evidence than one that is tracked.
MIN_CORRELATION_RECOVERED = 0.6
# Share of the KLT points that are tracked, below which KLT alone has failed.
MIN_INLIER_SHARE = 0.3
# Ratio to the first depth, or inverse ratio, from which a pose is implausible.
MAX_DEPTH_RATIO = 6.0


def is_tracking_failure(undetected: bool, tracks: Tracks | None, fit: TextureFit | None) -> bool:
    """Whether the measurements of a frame contradict the predicted face.

    undetected: the landmark network has processed the frame and found no face.
    """
    if fit is not None:
        return fit.correlation < (MIN_CORRELATION_UNDETECTED if undetected else MIN_CORRELATION)
    return undetected or (tracks is not None and tracks.inlier_share < MIN_INLIER_SHARE)


def is_plausible(face: FaceParameters, fitted: IdentityFit) -> bool:
    """Whether the head is in front of the camera, at a depth comparable to the first one."""
    ratio = face.pose.translation_mm[2] / fitted.frames[0].pose.translation_mm[2]
    return bool(1 / MAX_DEPTH_RATIO < ratio < MAX_DEPTH_RATIO)
