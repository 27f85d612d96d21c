"""Faces with known parameters: landmarks, and pictures of the painted head drawn in software."""

from pathlib import Path

import cv2
import numpy as np

from aam.annotation.annotation_file import Annotation, write_annotation
from aam.shape_space import SHAPE_COUNT
from aam.training.faces import AnnotatedFace
from aam.warps import HeadWarp, head_warp
from aam.weak_pose import project
from aam.window import WINDOW_MM, FaceWindow
from encoder.fitting.landmark_fit import landmark_model
from shared_model.animate import Face, Identity
from shared_model.arrays import Array, Picture
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS

HEAD = generic_head()
POSE = np.array([0.1, -0.15, 0.05, 100.0, 90.0, np.log(0.9)])
SIZE = (220, 200)
JAW_DROP = len(AAUS) + EAU_INDEX["jaw_drop"]


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


def synthetic_faces(people: int, each: int, seed: int = 1) -> list[AnnotatedFace]:
    """Faces of people who share features and have some of their own, drawn with known parameters.

    The head's features are smooth blobs on its texture, so that nothing is learned from a photo.
    """
    random, warp = np.random.default_rng(seed), head_warp(64, "full")
    shared = _smooth_texture(random, warp)
    found = []
    for person in range(people):
        own = shared + 0.4 * _smooth_texture(random, warp)
        for number in range(each):
            shape = np.zeros(SHAPE_COUNT)
            shape[[1, 3, 9, JAW_DROP]] = random.uniform([-0.5, -0.5, -0.5, 0], [0.5, 0.5, 0.5, 1])
            pose = np.array([0, 0, 0, 48, 44, np.log(96 / WINDOW_MM)])
            pose += random.normal(0, 1, 6) * [0.08, 0.12, 0.05, 2, 2, 0.03]
            window = FaceWindow(_drawn(warp, own, shape, pose), np.zeros(2), 1.0)
            found.append(AnnotatedFace(f"{person}_{number}", f"p{person}", window, shape, pose))
    return found


def write_annotations(folder: Path, faces: list[AnnotatedFace]) -> None:
    """The files that `risorius annotate` would write of synthetic faces."""
    folder.mkdir(exist_ok=True)
    texture, none = np.zeros((4, 4, 3), np.uint8), np.full((468, 3), np.nan)
    for face in faces:
        text = face.name, face.person, "", "", "", "weak"
        arrays = face.pose, face.shape, np.zeros((1, 3)), texture, none, face.window
        write_annotation(folder, Annotation(*text, 1.0, 0.0, *arrays))


def _smooth_texture(random: np.random.Generator, warp: HeadWarp) -> Array:
    field = cv2.GaussianBlur(random.normal(0, 1, (64, 64)), (0, 0), 2.5)
    return np.asarray((field / field.std())[warp.rows, warp.columns])


def _drawn(warp: HeadWarp, texture: Array, shape: Array, pose: Array) -> Picture:
    """(96, 96, 3) each texel a small Gaussian spot, before grey."""
    at = np.rint(4 * warp.positions(shape, pose)).astype(int).clip(0, 4 * 96 - 1)
    grey, weight = np.zeros((384, 384)), np.full((384, 384), 1e-3)
    np.add.at(grey, (at[1], at[0]), texture)
    np.add.at(weight, (at[1], at[0]), 1.0)
    smooth = np.divide(cv2.GaussianBlur(grey, (0, 0), 3), cv2.GaussianBlur(weight, (0, 0), 3))
    smooth = smooth.astype(np.float32)
    small = cv2.resize(smooth, (96, 96), interpolation=cv2.INTER_AREA)
    return np.repeat(np.clip(128 + 40 * small, 0, 255).astype(np.uint8)[..., None], 3, 2)
