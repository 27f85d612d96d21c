"""What measures the actuators of a face in a picture: the parameters c of a statistical model."""

from dataclasses import dataclass
from typing import Protocol

from encoder.fitting.landmark_source import ExpectedFace
from shared_model.arrays import Array, Picture


@dataclass(frozen=True, slots=True)
class FoundExpression:
    """What a model of many faces makes of a picture.

    eau: (EAUs,) actuators of its c (eq. 2.19).  eau_sigma: (EAUs,) their standard deviations;
        infinite where the model does not move.
    points_px: (468, 3) its landmarks with depth, as those of the network, nan where the head has
        none.
    """

    eau: Array
    eau_sigma: Array
    points_px: Array


class ExpressionSearch(Protocol):
    """Fits a statistical model to a face whose place and expression are known about."""

    @property
    def sigma_ratio(self) -> float:
        """Standard deviation of its landmarks, in terms of the landmark network's."""
        ...

    def search(self, frame: Picture, expected: ExpectedFace) -> FoundExpression | None:
        """The face in a picture (h, w, 3) BGR near where it is expected; None: it is not there.

        The search starts at the c of the expected actuators (eq. 2.18, 2.20).
        """
        ...
