"""Faces with known parameters: landmarks, and pictures of the painted head drawn in software."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aam.weak_pose import project
from encoder.fitting.landmark_fit import landmark_model
from shared_model.animate import Face, Identity
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS

Array = NDArray[np.float64]

HEAD = generic_head()
POSE = np.array([0.1, -0.15, 0.05, 100.0, 90.0, np.log(0.9)])
SIZE = (220, 200)


def known_face() -> tuple[Array, Array]:
    """AAUs and EAUs that are not at rest."""
    aau, eau = np.zeros(len(AAUS)), np.zeros(len(EAUS))
    aau[[1, 3, 9]] = 0.6, -0.5, 0.4
    eau[EAU_INDEX["jaw_drop"]], eau[EAU_INDEX["mouth_corners"]] = 0.5, 0.4
    return aau, eau


def landmarks_of(aau: Array, eau: Array, pose: Array) -> Array:
    """(468, 3) pixels under weak perspective, without depth, nan where the head has no landmark."""
    vertices = Face(HEAD, Identity(aau, np.zeros_like(HEAD.vertices))).animate(eau)
    index = landmark_model(HEAD).index
    corners = vertices[HEAD.triangles[HEAD.network_triangles[index]]]
    points = np.einsum("mc,mcd->md", HEAD.network_weights[index], corners)
    found = np.full((468, 3), np.nan)
    found[index, :2] = project(pose, points)
    return found


def write_picture(path: Path, seed: int = 1) -> None:
    """A picture of smooth noise: what it shows does not matter where landmarks are given."""
    noise = np.random.default_rng(seed).integers(0, 255, (25, 28, 3)).astype(np.uint8)
    cv2.imwrite(str(path), cv2.resize(noise, SIZE, interpolation=cv2.INTER_CUBIC))


def write_csv(path: Path, points: dict[str, Array]) -> None:
    """A CSV of given landmarks, in the order of the network."""
    lines = ["name," + ",".join(f"x{i},y{i}" for i in range(468))]
    for name, each in points.items():
        lines.append(",".join([name, *(f"{value:.4f}" for value in each[:, :2].ravel())]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
