"""A picture of a person who does not exist, and where the landmarks of their face are in it."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from assets.drawn_faces.paint import Painter, Skin
from encoder.appearance.rasteriser import rasterise
from shared_model.animate import Face, Identity
from shared_model.arrays import Array, Mask, Picture, Single
from shared_model.geometry import (
    Camera,
    matrix_from_quaternion,
    pixel_from_head,
    pose_from_euler,
)
from shared_model.mesh import Head, generic_head
from shared_model.normals import vertex_normals
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, Pose, clip_eau

SIZE = 192
# Pixels of the drawing for each of the picture's side.
FINER = 2
# Depth images from which it is known how much of the sky each vertex sees, and their pixels, mm.
SKY_DIRECTIONS, SKY_PIXEL_MM, CLEARANCE_MM = 120, 1.0, 3.0
# Standard deviations of pitch, yaw and roll, degrees.
TURNS_DEG = (8.0, 14.0, 5.0)
# Probability that an actuator is not at rest.
MOVED = 0.3


@dataclass(frozen=True, slots=True)
class DrawnFace:
    """picture: (SIZE, SIZE, 3) uint8 BGR.  landmarks: (468, 2) pixels, nan where there is none."""

    picture: Picture
    landmarks: Array


class Studio:
    """Draws people before a wall, in the light of a lamp and of the sky."""

    def __init__(self, head: Head) -> None:
        self._head, self._painter = head, Painter(head)
        self._sky = sky_share(head)

    def photograph(self, random: np.random.Generator, shape: Array, skin: Skin) -> DrawnFace:
        """A person with an expression, somewhere in the picture.  shape: (n, 3) mm."""
        head, camera = self._head, Camera(SIZE, SIZE, random.uniform(1.1, 2.2) * SIZE)
        vertices = Face(head, Identity(np.zeros(len(AAUS)), shape)).animate(expression(random))
        pose = _pose(random, camera)
        large = Camera(FINER * SIZE, FINER * SIZE, FINER * camera.focal_px)
        drawn, covered = self._drawn(random, large, pose, vertices, skin)
        picture = np.where(covered, drawn, _wall(random, large, pose, skin))
        resized = cv2.resize(picture, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
        corners = head.triangles[np.maximum(head.network_triangles, 0)]
        points = np.einsum("mc,mcd->md", head.network_weights, vertices[corners])
        landmarks = pixel_from_head(camera, pose, points)
        landmarks[head.network_triangles < 0] = np.nan
        return DrawnFace(filmed(random, np.asarray(resized, np.float64)), landmarks)

    def _drawn(
        self,
        random: np.random.Generator,
        camera: Camera,
        pose: Pose,
        vertices: Array,
        skin: Skin,
    ) -> tuple[Array, Mask]:
        """(h, w) brightness and where the head is."""
        head, rotation = self._head, matrix_from_quaternion(pose.rotation)
        seen = vertices @ rotation.T + pose.translation_mm
        mask = np.ones((camera.height, camera.width), np.bool_)
        pixels = pixel_from_head(camera, pose, vertices)
        found = rasterise(pixels, seen[:, 2].copy(), head.triangles, mask)
        normals = vertex_normals(vertices, head.triangles) @ rotation.T
        values = np.vstack([head.vertices.T, normals.T, self._sky, seen.T]).astype(np.float32)
        at = found.interpolate(values).astype(np.float64)
        brightness = self._painter.brightness(skin, at[:3].T, head.parts[found.corners[0]])
        lit = _light(random, at[3:6].T, at[6], at[7:].T, skin.shine, brightness)
        drawn, covered = np.zeros(mask.size), np.zeros(mask.size, np.bool_)
        drawn[found.pixels], covered[found.pixels] = lit, True
        return drawn.reshape(mask.shape), covered.reshape(mask.shape)


def expression(random: np.random.Generator) -> Array:
    """(14,) EAUs, most of them near rest."""
    eau = random.normal(0, 0.35, len(EAUS)) * (random.random(len(EAUS)) < MOVED)
    jaw = abs(random.normal(0, 0.3)) * (random.random() < 0.35)
    eau[EAU_INDEX["jaw_drop"]] = jaw
    lids = [EAU_INDEX[name] for name in ("lid_left", "lid_right")]
    eau[lids] = random.normal(0, 0.12) if random.random() < 0.9 else random.uniform(0.3, 1.0)
    eau[[EAU_INDEX["gaze_horizontal"], EAU_INDEX["gaze_vertical"]]] = 0
    return clip_eau(eau)


@cache
def _directions() -> Array:
    """(k, 3) evenly on the sphere, the front half."""
    index = np.arange(SKY_DIRECTIONS) + 0.5
    z = 1 - index / SKY_DIRECTIONS
    turn = np.pi * (1 + 5**0.5) * index
    across = np.sqrt(1 - z**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def sky_share(head: Head) -> Single:
    """(n,) share of a uniform light that reaches each vertex of the neutral head."""
    normals = vertex_normals(head.vertices, head.triangles)
    total, lit = np.zeros(len(head.vertices)), np.zeros(len(head.vertices))
    for direction in _directions():
        facing = np.maximum(normals @ direction, 0)
        total += facing
        lit += facing * _sees(head, direction)
    return np.asarray((lit + 0.1) / (total + 0.1), np.float32)


def _sees(head: Head, direction: Array) -> Array:
    """(n,) whether no triangle lies between each vertex and a far light."""
    right = np.cross([0.0, 1.0, 0.0], direction)
    right = right / max(float(np.linalg.norm(right)), 1e-9)
    down = np.cross(right, direction)
    if np.linalg.det([right, down, -direction]) < 0:
        down = -down
    place = head.vertices @ np.column_stack([right, down]) / SKY_PIXEL_MM
    place = place - place.min(0)
    depth = 1e5 - head.vertices @ direction
    width, height = np.ceil(place.max(0)).astype(int) + 1
    found = rasterise(place, depth, head.triangles, np.ones((height, width), np.bool_))
    nearest = np.full(height * width, np.inf)
    nearest[found.pixels] = (found.weights * depth[found.corners]).sum(0)
    column, row = np.rint(place).astype(int).T
    return np.asarray(depth < nearest[row * width + column] + CLEARANCE_MM)


def _pose(random: np.random.Generator, camera: Camera) -> Pose:
    face_px = random.uniform(0.42, 0.62) * SIZE
    depth_mm = camera.focal_px * 140 / face_px
    shift = random.normal(0, 0.04 * SIZE, 2) / face_px * 140
    pitch, yaw, roll = random.normal(0, TURNS_DEG)
    return pose_from_euler(pitch, yaw, roll, np.array([*shift, depth_mm]))


def _light(
    random: np.random.Generator,
    normals: Array,
    sky: Array,
    place: Array,
    shine: float,
    brightness: Array,
) -> Array:
    """(k,) light that comes back from points whose normals (k, 3) are in the camera's axes."""
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    side, up = np.radians(random.normal(0, 35)), np.radians(random.normal(30, 20))
    lamp = np.array([np.sin(side) * np.cos(up), -np.sin(up), -np.cos(side) * np.cos(up)])
    share = random.uniform(0.15, 0.75)
    above = 0.65 - 0.35 * normals[:, 1]
    diffuse = share * np.maximum(normals @ lamp, 0) + (1 - share) * sky * above
    half = lamp - place / np.linalg.norm(place, axis=1, keepdims=True)
    half = half / np.linalg.norm(half, axis=1, keepdims=True)
    mirrored = shine * share * np.maximum((normals * half).sum(1), 0) ** random.uniform(8, 30)
    return np.asarray(brightness * diffuse * sky**0.5 + 0.5 * mirrored)


def _wall(random: np.random.Generator, camera: Camera, pose: Pose, skin: Skin) -> Array:
    """(h, w) brightness of what is behind: something blurred, and hair around the head."""
    size = camera.height
    field = cv2.GaussianBlur(random.normal(0, 1, (24, 24)), (0, 0), random.uniform(0.6, 5))
    field = random.uniform(0.05, 0.8) * np.exp(random.uniform(0, 0.6) * field / field.std())
    wall = cv2.resize(field, (size, size), interpolation=cv2.INTER_CUBIC)
    scale = camera.focal_px / pose.translation_mm[2]
    centre = camera.centre + scale * (pose.translation_mm[:2] - [0, 40])
    radii = scale * np.array([random.uniform(60, 105), random.uniform(80, 150)])
    row, column = np.mgrid[:size, :size]
    away = ((column - centre[0]) / radii[0]) ** 2 + ((row - centre[1]) / radii[1]) ** 2
    hair = skin.tone * np.exp(skin.hair) * random.uniform(0.4, 0.9)
    return np.asarray(wall + np.clip(4 * (1 - away), 0, 1) * (hair - wall))


def filmed(random: np.random.Generator, brightness: Array) -> Picture:
    """(h, w, 3) uint8 BGR of brightness (h, w), by an exposure, a lens and a sensor."""
    exposed = random.uniform(0.5, 1.1) * brightness / np.percentile(brightness, 96)
    value = 255 * np.clip(exposed, 0, 1) ** random.uniform(0.5, 0.9)
    blurred = np.asarray(cv2.GaussianBlur(value, (0, 0), random.uniform(0.3, 1.2)))
    noisy = blurred + random.uniform(0, 4) * random.standard_normal(value.shape)
    tint = np.array([random.uniform(0.75, 1.0), 1.0, random.uniform(1.0, 1.25)])
    return np.asarray(np.clip(np.rint(noisy[..., None] * tint), 0, 255), np.uint8)


@cache
def studio() -> Studio:
    """The studio of the generic head."""
    return Studio(generic_head())
