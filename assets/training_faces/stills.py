"""Still pictures of people: an astronaut cut out of her portrait, and a painted head."""

from pathlib import Path

import cv2
import numpy as np

from assets.training_faces.skin import smooth_noise
from encoder.detection.segmentation import segment_person
from encoder.detection.tflite import find_segmentation_network
from risorius.animation.animate import open_actor
from risorius.animation.animation_script import parse_script
from shared_model.arrays import Picture, Single
from shared_model.parameters import AAUS

PORTRAIT = "astronaut.png"
# The face in the portrait: centre and half width, pixels.
FACE_CENTRE, FACE_HALF_PX = (226, 120), 60
BACKGROUNDS = ("coffee", "chelsea", "rocket", "brick", "gravel", "grass", "camera", "coins")
SIZES = ((640, 360), (360, 288), (352, 288), (512, 512), (640, 480), (176, 144), (480, 640))


def portrait(random: np.random.Generator, pictures: Path) -> Picture:
    """The astronaut before another background, cut and scaled."""
    whole = _read(pictures / PORTRAIT)
    width, height = SIZES[random.integers(len(SIZES))]
    mask = _person(whole)
    share = random.uniform(0.22, 0.5) * min(1, height / width)
    scale = share * width / (2 * FACE_HALF_PX)
    turn = np.array([[scale, 0, 0], [0, scale, 0]])
    at = np.array([width * random.uniform(0.4, 0.6), height * random.uniform(0.36, 0.48)])
    turn[:, 2] = at - scale * np.array(FACE_CENTRE)
    size = (width, height)
    flags = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
    person = cv2.warpAffine(whole, turn, size, flags=flags, borderMode=cv2.BORDER_REFLECT)
    alpha = cv2.warpAffine(mask, turn, size, flags=cv2.INTER_LINEAR)[..., None]
    clothes = np.exp(random.normal(0, 0.3, 3))
    behind = background(random, pictures, size)
    below = np.clip((np.arange(height) - at[1] - 0.8 * share * width) / 20, 0, 1)[:, None, None]
    dressed = person * (1 + below * (clothes - 1))
    return np.asarray(np.clip(behind + alpha * (dressed - behind), 0, 255), np.uint8)


def _person(whole: Picture) -> Single:
    path = find_segmentation_network()
    if path is None:
        raise SystemExit("the segmentation network is not installed, see README.md")
    middle, half = np.array(FACE_CENTRE, np.float64), FACE_HALF_PX
    outline = middle + half / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cells = segment_person(path, whole, outline)
    if cells is None:
        raise SystemExit(f"{PORTRAIT}: no person is found in it")
    size = (whole.shape[1], whole.shape[0])
    return np.asarray(cv2.resize(cells.astype(np.float32), size), np.float32)


def background(random: np.random.Generator, pictures: Path, size: tuple[int, int]) -> Single:
    """A cut of a photograph, more or less out of focus, or a wall."""
    width, height = size
    if random.random() < 0.3:
        wall = random.uniform(30, 220, 3) + 12 * smooth_noise(random, max(size), 2)[..., None]
        return np.asarray(wall[:height, :width], np.float32)
    names = [name for name in BACKGROUNDS if any(pictures.glob(f"{name}.*"))]
    photo = _read(next(pictures.glob(f"{names[random.integers(len(names))]}.*")))
    zoom = max(width / photo.shape[1], height / photo.shape[0]) * random.uniform(1, 2)
    scaled = cv2.resize(photo, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA)
    top = random.integers(scaled.shape[0] - height + 1)
    left = random.integers(scaled.shape[1] - width + 1)
    cut = scaled[top : top + height, left : left + width].astype(np.float32)
    return np.asarray(cv2.GaussianBlur(cut, (0, 0), random.uniform(0.3, 6)), np.float32)


def painted(random: np.random.Generator, pictures: Path, folder: Path) -> Picture:
    """The painted head of `risorius animate` before a photograph."""
    width, height = SIZES[random.integers(len(SIZES))]
    cv2.imwrite(str(folder / "behind.png"), background(random, pictures, (width, height)))
    aau = {name: float(random.uniform(-0.7, 0.7)) for name in AAUS}
    script = parse_script(
        {
            "width": width,
            "height": height,
            "mottle": 0.1,
            "seed": int(random.integers(1 << 30)),
            "distance_mm": float(random.uniform(450, 800)),
            "background": "behind.png",
            "key": [{"time": 0, "aau": aau}],
        },
        folder,
    )
    actor = open_actor(script, None)
    try:
        state = script.at(0.0)
        return actor.draw(state, actor.geometry(state))
    finally:
        actor.close()


def _read(path: Path) -> Picture:
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise SystemExit(f"{path} is not a readable picture")
    return np.asarray(picture, np.uint8)
