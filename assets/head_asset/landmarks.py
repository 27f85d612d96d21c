"""The anatomical landmarks of thesis A.1, and the muscles' own, as vertices of the skin."""

import numpy as np

from assets.head_asset.mesh_parts import SKIN, Mesh
from shared_model.arrays import Integers

# Where each landmark lies on MakeHuman's head, mm, read off its profile and front.
MIDLINE = {
    "v": (138.1, 9.6),
    "tr": (80.9, 84.5),
    "on": (45.0, 93.4),
    "g": (35.6, 92.4),
    "n": (21.3, 90.6),
    "prn": (-20.1, 108.1),
    "sn": (-32.1, 96.3),
    "ls": (-41.4, 99.7),
    "sto_upper": (-50.3, 95.3),
    "sto_lower": (-50.5, 94.3),
    "li": (-62.2, 95.6),
    "sl": (-68.0, 89.1),
    "pg": (-78.3, 89.9),
    "gn": (-94.9, 74.6),
    "op": (33.2, -99.2),
}
# The left side (x > 0); the right is its mirror image.
LEFT = {
    "eu": (78.0, 60.0, -15.0),
    "ft": (58.0, 50.0, 58.0),
    "fz": (52.0, 26.0, 68.0),
    "zy": (68.0, -2.0, 35.0),
    "cdl": (71.0, -3.0, 12.0),
    "t": (73.0, 1.0, 4.0),
    "po": (72.0, 2.0, -3.0),
    "go": (58.0, -55.0, 15.0),
    "or": (31.0, 2.0, 78.0),
    "sci": (37.0, 40.5, 80.0),
    "en": (16.9, 15.0, 78.7),
    "ex": (45.0, 17.2, 74.8),
    "ps": (31.0, 22.8, 81.0),
    "pi": (31.0, 12.5, 80.2),
    "al": (17.1, -20.7, 90.9),
    "ac": (17.6, -22.0, 86.9),
    "ch": (25.2, -48.4, 84.2),
    "cph": (6.0, -41.0, 98.5),
}


def find_landmarks(mesh: Mesh) -> dict[str, int]:
    """Landmark name (sides as `_l`, `_r`) -> vertex of the skin nearest to its stated place."""
    skin = mesh.parts == SKIN
    middle = np.flatnonzero(skin & (np.abs(mesh.vertices[:, 0]) < 1e-6))
    left = np.flatnonzero(skin & (mesh.vertices[:, 0] > 1e-6) & (mesh.masks["inside-mouth"] < 0.5))
    found = {name: _nearest(mesh, middle, (0.0, *place)) for name, place in MIDLINE.items()}
    found["sto"] = found["sto_upper"]
    for name, place in LEFT.items():
        found[name + "_l"] = _nearest(mesh, left, place)
        found[name + "_r"] = int(mesh.mirror[found[name + "_l"]])
    return dict(sorted(found.items()))


def _nearest(mesh: Mesh, among: Integers, place: tuple[float, ...]) -> int:
    away = np.linalg.norm(mesh.vertices[among] - np.array(place), axis=1)
    return int(among[np.argmin(away)])
