"""Stopgap displacement fields out of the CC0 targets, until the muscle model supplies its own."""

import numpy as np
from numpy.typing import NDArray

from scripts.head_asset.mesh_parts import EYE_LEFT, EYE_RIGHT, Mesh
from scripts.head_asset.regions import smoothstep
from shared_model.parameters import AAUS, EAU_INDEX, EAUS

Array = NDArray[np.float64]


def eau_fields(mesh: Mesh) -> tuple[Array, Array]:
    """(len(EAUS), n, 3) mm at +1 and at -1."""
    t = mesh.targets

    def both(name: str) -> Array:
        return t[name + "Left"] + t[name + "Right"]

    inner = np.exp(-((mesh.vertices[:, [0]] / 22) ** 2))
    none = np.zeros_like(mesh.vertices)
    pairs = {
        "jaw_drop": (0.8 * t["jawOpen"], none),
        "mouth_corners": (both("mouthSmile"), both("mouthFrown")),
        "eyebrow_middle": (0.8 * both("browOuterUp") + 0.4 * t["browInnerUp"], both("browDown")),
        "eyebrow_inner": (t["browInnerUp"], both("browDown") * inner),
        "eyebrow_outer": (both("browOuterUp"), both("browDown") * (1 - inner)),
        "nose_base": (both("noseSneer"), none),
        "lid_left": (t["eyeBlinkLeft"], 2 * t["eyeWideLeft"]),
        "lid_right": (t["eyeBlinkRight"], 2 * t["eyeWideRight"]),
        "gaze_horizontal": (_turn(mesh, (0, 1, 0)), _turn(mesh, (0, -1, 0))),
        "gaze_vertical": (
            _turn(mesh, (-1, 0, 0)) + both("eyeLookUp"),
            _turn(mesh, (1, 0, 0)) + both("eyeLookDown"),
        ),
        "lip_stretch": (both("mouthStretch"), t["mouthPucker"]),
        "upper_lip_raise": (both("mouthUpperUp"), none),
        "lower_lip_lower": (both("mouthLowerDown"), none),
        "lip_press": (both("mouthPress"), none),
    }
    up, down = np.zeros((2, len(EAUS), *mesh.vertices.shape))
    for name, (raised, lowered) in pairs.items():
        up[EAU_INDEX[name]], down[EAU_INDEX[name]] = raised, lowered
    return up, down


def aau_fields(mesh: Mesh) -> Array:
    """(len(AAUS), n, 3) mm at +1: one dimension each."""
    x, y, z = mesh.vertices.T

    def near(px: float, py: float, pz: float, reach: float) -> Array:
        away = (np.abs(x) - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2
        return np.asarray(np.exp(-away / (2 * reach**2)))

    def outward(reach: float) -> Array:
        return np.asarray(np.sign(x) * smoothstep(np.abs(x), 0, reach))

    field = np.zeros((len(AAUS), *mesh.vertices.shape))
    field[0, :, 0] = x / 12
    field[1, :, 1] = 6 * smoothstep(y, 10, 80) - 6 * smoothstep(-y, -10, 90)
    field[2, :, 2] = 8 * smoothstep(z, 0, 80)
    field[3, :, 0] = 7 * outward(30) * near(56, -55, 18, 30)
    field[4, :, 1] = -5 * smoothstep(-y, 68, 95) * (z > -20)
    field[5, :, 1] = -4 * near(0, -28, 98, 16)
    field[6, :, 2] = 4 * near(0, -15, 108, 14)
    field[7, :, 0] = 4 * outward(15) * near(18, -22, 90, 11)
    field[8, :, 1] = -3 * near(0, -48, 95, 18)
    field[9, :, 0] = 5 * outward(22) * near(26, -49, 86, 15)
    field[10, :, 1] = 4 * near(33, 40, 82, 14)
    return field


def _turn(mesh: Mesh, axis: tuple[int, int, int], degrees: float = 25.0) -> Array:
    field = np.zeros_like(mesh.vertices)
    for side in (EYE_LEFT, EYE_RIGHT):
        ball = mesh.parts == side
        points = mesh.vertices[ball]
        radius = np.ptp(points[:, 1]) / 2
        centre = np.append((points[:, :2].min(0) + points[:, :2].max(0)) / 2, points[:, 2].max() - radius)
        field[ball] = np.cross(axis, points - centre) * np.sin(np.radians(degrees))
    return field
