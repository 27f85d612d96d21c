"""Whether a decoded face shows the emotion of its source, by their signatures (Table 2.3)."""

import numpy as np
from numpy.typing import NDArray

from encoder.fitting.sequence_fit import fit_faces, fit_sequence
from loopback.report import rounded
from shared_model.anatomy.expressions import EMOTIONS, signature
from shared_model.arrays import Array
from shared_model.mesh import generic_head

# What the strongest signature must be for a face to show an emotion.
SHOWN = 0.7
REST = len(EMOTIONS)


def shown_emotions(eau: Array) -> NDArray[np.intp]:
    """(n,) index into `EMOTIONS` of the emotion that each face shows, `REST` where it shows none.

    eau: (n, 14) actuators.
    """
    found = np.stack(list(signature(eau).values()), axis=-1)
    return np.asarray(np.where(found.max(-1) < SHOWN, REST, found.argmax(-1)), dtype=np.intp)


def emotion_agreement(source: Array, decoded: Array, size: tuple[int, int]) -> float | None:
    """Share of the frames whose decoded face shows the emotion of the source, or none as that does.

    source, decoded: landmarks (t, 468, 3) of two videos, pixels; nan: no face.  Actuators are
    fitted to both with the identity of the source.  size: (width, height) of the pictures.
    None where no frame has a face in both.
    """
    both = np.isfinite(source[:, 0, 0]) & np.isfinite(decoded[:, 0, 0])
    if not both.any():
        return None
    head = generic_head()
    fitted, faces = fit_sequence(head, size, list(source[both]))
    copies = fit_faces(head, fitted, list(decoded[both]))
    first, second = (
        shown_emotions(np.stack([face.eau for face in each])) for each in (faces, copies)
    )
    return rounded(float((first == second).mean()), 3)
