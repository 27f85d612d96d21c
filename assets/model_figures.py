"""Draw the figures of docs/model.md and write its tables: python -m assets.model_figures."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from assets.model_tables import aau_table, eau_table, reference_fields, write_tables
from benchmarks.command import run
from decoder.rendering.renderer import Renderer
from risorius.animation.synthetic_skin import painted_colours
from shared_model.anatomy.expressions import EMOTIONS
from shared_model.animate import Face, Identity
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera, pose_from_euler
from shared_model.mesh import Head, generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS

DOCS = Path(__file__).resolve().parent.parent / "docs"
TILE = 168
DISTANCE_MM = 1100.0
ANGLES = ((0, 0), (0, -35), (0, 35), (0, -80), (22, -15))
# Few colours keep the files small without a visible loss.
LEVELS = 5


class HeadRenderer:
    """Renders the painted head in tiles of one size."""

    def __init__(self, head: Head) -> None:
        self.head = head
        self._renderer = Renderer(TILE, TILE, head, samples=4)
        self._camera = Camera(TILE, TILE, TILE * 4.6)
        self._colours = painted_colours(head)

    def draw_face(
        self, eau: Array | None = None, aau: Array | None = None, pitch: float = 0, yaw: float = 0
    ) -> Picture:
        """A tile (TILE, TILE, 3) uint8 BGR of the head with EAUs, AAUs and a pose in degrees."""
        identity = np.zeros(len(AAUS)) if aau is None else aau
        face = Face(self.head, Identity(identity, np.zeros_like(self.head.vertices)))
        vertices = face.animate(np.zeros(len(EAUS)) if eau is None else eau)
        return self.draw_vertices(vertices, pitch, yaw)

    def draw_vertices(self, vertices: Array, pitch: float = 0, yaw: float = 0) -> Picture:
        """A tile of vertices (n, 3) mm."""
        centre = np.array([0.0, 5.0, DISTANCE_MM])
        pose = pose_from_euler(pitch, yaw, 0, centre)
        return self._renderer.draw_shaded(self._camera, pose, vertices, self._colours)


def one_hot(index: int, value: float, size: int) -> Array:
    """(size,) zeros but for one value."""
    vector = np.zeros(size)
    vector[index] = value
    return vector


def labelled(picture: Picture, text: str) -> Picture:
    """The picture with a line of text at the top."""
    out = picture.copy()
    cv2.putText(out, text, (5, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA)
    return out


def tiled(rows: Sequence[Sequence[Picture]]) -> Picture:
    """Rows of equal tiles as one picture."""
    return np.vstack([np.hstack(row) for row in rows])


def eau_sheet(studio: HeadRenderer, names: Sequence[str]) -> Picture:
    """A row for each actuator: both ends of its range and rest, from the front and the side."""
    rows = []
    for name in names:
        eau = EAUS[EAU_INDEX[name]]
        row: list[Picture] = []
        for yaw in (0, -35):
            for value in (eau.low, 0.0, eau.high):
                if value == 0 and eau.low == 0 and len(row) % 3 == 0:
                    row.append(np.full((TILE, TILE, 3), 31, np.uint8))
                    continue
                tile = studio.draw_face(one_hot(EAU_INDEX[name], value, len(EAUS)), yaw=yaw)
                row.append(labelled(tile, f"{name} {value:+g}" if value else name))
        rows.append(row)
    return tiled(rows)


def emotion_sheet(studio: HeadRenderer) -> Picture:
    """The six emotions at their peak (fig. 2.8), from the front and from the side."""
    return tiled(
        [
            [
                labelled(studio.draw_face(e.peak(), yaw=yaw), e.name if yaw == 0 else "")
                for e in EMOTIONS
            ]
            for yaw in (0, -35)
        ]
    )


def aau_sheet(studio: HeadRenderer, names: Sequence[str]) -> Picture:
    """A column for each AAU: -1 above +1, from the front and from the side."""
    return tiled(
        [
            [
                labelled(
                    studio.draw_face(aau=one_hot(AAUS.index(n), v, len(AAUS)), yaw=yaw),
                    f"{n} {v:+g}",
                )
                for n in names
            ]
            for yaw in (0, -35)
            for v in (-1, 1)
        ]
    )


def angle_sheet(studio: HeadRenderer) -> Picture:
    """At rest, smiling and speaking, from five angles."""
    smile = one_hot(EAU_INDEX["mouth_corners"], 1, len(EAUS))
    speech = one_hot(EAU_INDEX["jaw_drop"], 0.35, len(EAUS))
    return tiled(
        [
            [studio.draw_face(eau, pitch=pitch, yaw=yaw) for pitch, yaw in ANGLES]
            for eau in (np.zeros(len(EAUS)), smile, speech)
        ]
    )


def reference_sheet(
    studio: HeadRenderer, reference: dict[str, Array], names: Sequence[str]
) -> Picture:
    """Ours above, the CC0 target below, for every actuator that has a counterpart."""
    head = studio.head
    ours, theirs = [], []
    for name in names:
        index = EAU_INDEX[name.rstrip("+-")]
        field = (head.eau_up if name.endswith("+") else head.eau_down)[index]
        target = reference[name]
        size = float((field * target).sum() / (target * target).sum())
        ours.append(labelled(studio.draw_vertices(head.vertices + field), name))
        theirs.append(
            labelled(studio.draw_vertices(head.vertices + size * target), f"CC0 x {size:.2f}")
        )
    half = (len(names) + 1) // 2
    blank = [np.full((TILE, TILE, 3), 31, np.uint8)] * (2 * half - len(names))
    return tiled([ours[:half], theirs[:half], ours[half:] + blank, theirs[half:] + blank])


def save(name: str, picture: Picture, folder: Path) -> None:
    """Write a figure with few colours, so that it stays small."""
    step = 256 // (1 << LEVELS)
    coarse = (picture.astype(np.int16) // step * step + step // 2).clip(0, 255).astype(np.uint8)
    path = folder / f"{name}.png"
    if not cv2.imwrite(str(path), coarse, [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise OSError(f"cannot write {path}")


def main(arguments: Sequence[str]) -> None:
    """Draw and write everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder of model.md")
    parser.add_argument(
        "--reference", type=Path, help="CC0 targets written by assets/build_head.py --reference"
    )
    options = parser.parse_args(arguments)
    head = generic_head()
    reference = reference_fields(options.reference, head) if options.reference else {}
    studio = HeadRenderer(head)
    figures = options.docs / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    names = [eau.name for eau in EAUS]
    save("eau_1", eau_sheet(studio, names[:5]), figures)
    save("eau_2", eau_sheet(studio, names[5:10]), figures)
    save("eau_3", eau_sheet(studio, names[10:]), figures)
    save("emotions", emotion_sheet(studio), figures)
    save("aau_1", aau_sheet(studio, AAUS[:6]), figures)
    save("aau_2", aau_sheet(studio, AAUS[6:]), figures)
    save("angles", angle_sheet(studio), figures)
    if reference:
        names = list(reference)
        save("reference_1", reference_sheet(studio, reference, names[:10]), figures)
        save("reference_2", reference_sheet(studio, reference, names[10:]), figures)
        write_tables(options.docs / "model.md", "eau", eau_table(head, reference))
    write_tables(options.docs / "model.md", "aau", aau_table(head))


if __name__ == "__main__":
    run(main)
