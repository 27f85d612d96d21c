"""The tables of docs/model.md: EAUs against CC0 counterparts, AAUs against each other."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from loopback.report import markdown_table
from shared_model.anatomy.anthropometry import MEASUREMENTS, measure
from shared_model.anatomy.expressions import DOWN, UP
from shared_model.arrays import Array, Mask
from shared_model.errors import UserError
from shared_model.mesh import PARTS, Head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS

# EAU and end of its range (+ or -) -> the CC0 facial targets whose sum is its counterpart.
COUNTERPARTS: Mapping[str, tuple[str, ...]] = {
    "jaw_drop+": ("jawOpen",),
    "mouth_corners+": ("mouthSmileLeft", "mouthSmileRight"),
    "mouth_corners-": ("mouthFrownLeft", "mouthFrownRight"),
    "eyebrow_middle+": ("browInnerUp", "browOuterUpLeft", "browOuterUpRight"),
    "eyebrow_middle-": ("browDownLeft", "browDownRight"),
    "eyebrow_inner+": ("browInnerUp",),
    "eyebrow_inner-": ("browDownLeft", "browDownRight"),
    "eyebrow_outer+": ("browOuterUpLeft", "browOuterUpRight"),
    "nose_base+": ("noseSneerLeft", "noseSneerRight"),
    "lid_left+": ("eyeBlinkLeft",),
    "lid_left-": ("eyeWideLeft",),
    "gaze_vertical+": ("eyeLookUpLeft", "eyeLookUpRight"),
    "gaze_vertical-": ("eyeLookDownLeft", "eyeLookDownRight"),
    "lip_stretch+": ("mouthStretchLeft", "mouthStretchRight"),
    "lip_stretch-": ("mouthPucker",),
    "upper_lip_raise+": ("mouthUpperUpLeft", "mouthUpperUpRight"),
    "lower_lip_lower+": ("mouthLowerDownLeft", "mouthLowerDownRight"),
    "lip_press+": ("mouthRollLower", "mouthRollUpper"),
}


def reference_fields(path: Path, head: Head) -> dict[str, Array]:
    """Counterpart -> (n, 3) mm, from the file that `build_head --reference` wrote for this head.

    Raises UserError if the file belongs to another mesh.
    """
    with np.load(path, allow_pickle=False) as data:
        fields = dict(zip(data["names"].tolist(), data["fields"].astype(np.float64), strict=True))
    size = len(next(iter(fields.values())))
    if size != len(head.vertices):
        raise UserError(f"{path} has {size} vertices, expected {len(head.vertices)}")
    return {
        name: sum((fields[t] for t in targets), np.zeros((size, 3)))
        for name, targets in COUNTERPARTS.items()
    }


def face_skin(head: Head) -> Mask:
    """(n,) the skin of the face: in front of the ears, down to the chin."""
    chin = head.vertices[head.landmarks["gn"], 1]
    skin = head.parts == PARTS.index("skin")
    return np.asarray(skin & (head.vertices[:, 2] > 25) & (head.vertices[:, 1] > chin - 5))


def field_agreement(field: Array, target: Array, where: Mask) -> tuple[float, float]:
    """Cosine of two fields over the vertices `where`, and RMS difference, mm, at the best scale."""
    a, b = field[where].ravel(), target[where].ravel()
    cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
    scaled = b * (a @ b) / (b @ b)
    return cosine, float(np.sqrt(np.mean(((a - scaled).reshape(-1, 3) ** 2).sum(1))))


def eau_table(head: Head, reference: Mapping[str, Array]) -> str:
    """Markdown: actuator, AU, muscles, range, largest displacement, agreement with the target."""
    header = (
        "actuator",
        "AU",
        "what pulls",
        "at",
        "largest, mm",
        "CC0 target",
        "cosine",
        "RMS, mm",
    )
    lines = list[list[str]]()
    where = face_skin(head)
    for eau in EAUS:
        ends = (("+", eau.high, head.eau_up, UP), ("-", eau.low, head.eau_down, DOWN))
        for sign, end, fields, actuators in ends:
            if eau.name not in actuators:
                continue
            field = fields[EAU_INDEX[eau.name]]
            largest = abs(end) * np.linalg.norm(field, axis=1).max()
            key = eau.name + sign
            cells = [eau.name, eau.au, actuators[eau.name].works_by, f"{end:+g}", f"{largest:.1f}"]
            if key in reference:
                cosine, rms = field_agreement(field, reference[key], where)
                cells += [" + ".join(COUNTERPARTS[key]), f"{cosine:.2f}", f"{rms:.2f}"]
            else:
                cells += ["", "", ""]
            lines.append(cells)
    return markdown_table(header, lines)


def aau_table(head: Head) -> str:
    """Markdown: each AAU's measurement, its adults, and what it does to every measurement."""
    before = measure(head.vertices, head.landmarks)
    lines = list[list[str]]()
    for measurement, field in zip(MEASUREMENTS, head.aau, strict=True):
        after = measure(head.vertices + field, head.landmarks)
        changes = [f"{after[name] - before[name]:+.1f}" for name in AAUS]
        spread = f"{measurement.mean_mm:.1f} ({measurement.deviation_mm:.1f})"
        own = f"{before[measurement.name]:.1f}"
        cells = [measurement.name, "-".join(measurement.ends), own, spread, *changes]
        lines.append(cells)
    return markdown_table(["AAU", "measures", "generic head", "adults, mean (sd)", *AAUS], lines)


def write_tables(path: Path, name: str, table: str) -> None:
    """Put a table between its two marks in a Markdown file.  Raises ValueError without marks."""
    text = path.read_text(encoding="utf-8")
    start, end = f"<!-- {name} table -->\n", f"<!-- end of {name} table -->"
    if start not in text or end not in text:
        raise ValueError(f"{path} has no marks for the {name} table")
    head, rest = text.split(start, 1)
    path.write_text(head + start + table + "\n" + end + rest.split(end, 1)[1], encoding="utf-8")
