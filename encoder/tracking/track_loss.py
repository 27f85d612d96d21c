"""When a tracked face counts as lost, and what cannot be one (thesis 5.2)."""

from encoder.fitting.fit_results import IdentityFit, TextureFit
from encoder.tracking.klt import Tracks
from shared_model.parameters import FaceParameters

# Correlation with the caller's texture below which a frame does not show them.
MIN_CORRELATION = 0.5
# The same where the landmark network looked and saw no face.
MIN_CORRELATION_UNDETECTED = 0.75
# A face found again must look more like the caller than one merely held.
MIN_CORRELATION_RECOVERED = 0.6
# The same for KLT alone: share of its points that are still followed.
MIN_INLIER_SHARE = 0.3
# A head this many times farther or nearer than at first is none.
MAX_DEPTH_RATIO = 6.0


def is_tracking_failure(unseen: bool, tracks: Tracks | None, refined: TextureFit | None) -> bool:
    """Whether a frame does not show the caller where they were expected, as far as was measured.

    unseen: the landmark network looked and saw no face.
    """
    if refined is not None:
        return refined.correlation < (MIN_CORRELATION_UNDETECTED if unseen else MIN_CORRELATION)
    return unseen or (tracks is not None and tracks.inlier_share < MIN_INLIER_SHARE)


def is_plausible(face: FaceParameters, fitted: IdentityFit) -> bool:
    """Whether the head is before the camera, and not absurdly nearer or farther than at first."""
    times = face.pose.translation_mm[2] / fitted.frames[0].pose.translation_mm[2]
    return bool(1 / MAX_DEPTH_RATIO < times < MAX_DEPTH_RATIO)
