"""When a tracked face counts as lost, and what cannot be one (thesis 5.2)."""

from encoder.fitting.fit_results import Fitted, Refined
from encoder.tracking.klt import Tracks
from shared_model.parameters import FaceParameters

# Correlation with the caller's texture below which a frame does not show them.
LEAST_CORRELATION = 0.5
# The same where the landmark network looked and saw no face.
UNSEEN_CORRELATION = 0.75
# A face found again must look more like the caller than one merely held.
FOUND_CORRELATION = 0.6
# The same for KLT alone: share of its points that are still followed.
LEAST_SHARE = 0.3
# A head this many times farther or nearer than at first is none.
FARTHEST = 6.0


def is_bad(unseen: bool, tracks: Tracks | None, refined: Refined | None) -> bool:
    """Whether a frame does not show the caller where they were expected, as far as was measured.

    unseen: the landmark network looked and saw no face.
    """
    if refined is not None:
        return refined.correlation < (UNSEEN_CORRELATION if unseen else LEAST_CORRELATION)
    return unseen or (tracks is not None and tracks.share < LEAST_SHARE)


def is_plausible(face: FaceParameters, fitted: Fitted) -> bool:
    """Whether the head is before the camera, and not absurdly nearer or farther than at first."""
    times = face.pose.translation_mm[2] / fitted.frames[0].pose.translation_mm[2]
    return bool(1 / FARTHEST < times < FARTHEST)
