"""What each step of the default profile's coding saves: bits a second at equal harm.

    python -m scripts.coding_gain CLIP... [--harm 4]

Prints a table in Markdown.  Harm is the squared error of luma, mean over the visible texels of the
shape-free face, that quantisation adds by the Gauss-Newton model of the picture
(`Sensitivity.harm`).
All rows code the same values: pose, actuators and coefficients of every frame, as the two-pass
encoder finds them.  From the static code on, rows are ideal code lengths; the last is what is sent.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from encoder.capture.face_crop import crop_face
from encoder.capture.video_source import open_source
from encoder.coding.distortion import measure_distortion
from encoder.coding.gop import FRAMES_PER_PACKET
from encoder.coding.model_packet import BUDGETS
from encoder.coding.rate_control import QUALITIES, packet_spans
from encoder.coding.rdo_quantiser import code_packet
from encoder.coding.transform import design_transform, project
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.tflite import find_network_folder
from encoder.fitting.sequence_fit import follow_all, smoothed
from encoder.learning.frame_sampler import UniformSubsampler
from encoder.learning.person_model import build_person_model
from protocol.bit_accounting import component_bits
from protocol.call_parameters import CallParameters
from protocol.frames.frame_transform import FrameTransform, vector_from_face
from protocol.frames.payload_coding import PayloadHeader, encode_payload
from protocol.frames.temporal_prediction import (
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
    CodedFrame,
    FramePredictor,
    Integers,
    coding_order,
    reconstruct,
    step,
)
from protocol.limits import SEQUENCE_MODULUS
from scripts.command import run
from shared_model.parameters import FaceParameters
from shared_model.surround import surrounded_head

Array = NDArray[np.float64]

ROWS = (
    "8 bits a parameter, over its range",
    "steps by sensitivity, fixed length",
    "combined components, fixed length",
    "hierarchical prediction, one static code",
    "adaptive contexts",
    "rate-distortion optimised values",
    "packet heads and whole bytes",
)


@dataclass(frozen=True, slots=True)
class Material:
    """What is to be coded: y (t, d) of each frame, the harm (d, d) of errors, its components."""

    vectors: Array
    harm: Array
    components: FrameTransform
    values: Array
    fps: float

    def harm_of(self, decoded: Array) -> float:
        """Mean harm of vectors (t, d) that come out instead, grey levels squared."""
        error = self.vectors - decoded
        return float(np.einsum("td,de,te->t", error, self.harm, error).mean())

    def harm_of_values(self, values: Array) -> float:
        """Mean harm of component values (t, n) that come out instead."""
        return self.harm_of(self.components.mean + values @ self.components.matrix)


@dataclass(frozen=True, slots=True)
class Point:
    """A way of coding at one setting: its harm, and its bits a second by row."""

    harm: float
    bps: dict[str, float]


def read_material(source: str) -> Material:
    """Learn a clip's caller and follow the face through it, as the two-pass encoder does."""
    folder, sampler = find_network_folder(), UniformSubsampler()
    tracker = LandmarkTracker(folder, BlazeFaceDetector(folder), refine_eyelids=False)
    with open_source(source) as capture:
        size, fps = (capture.width, capture.height), capture.fps
        points: list[Array] = []
        for _, frame in capture:
            if (found := tracker.update(frame)) is not None:
                sampler.offer(len(points), lambda frame=frame: frame)  # type: ignore[misc]
                points.append(found.points)
    head = surrounded_head()
    fitted, faces = follow_all(head, size, list(smoothed(np.array(points))))
    call = CallParameters("default", *size, fps.numerator, fps.denominator, fitted.camera.focal_px)
    budget = BUDGETS["default"]
    learned = build_person_model(
        head,
        fitted,
        call.camera,
        faces,
        sampler.frames,
        points,
        texture_size=budget.texture_size,
        appearance_bytes=budget.appearance_bytes,
        max_modes=budget.max_modes,
    )
    caller, refined = learned.person, list[FaceParameters]()
    tracker = LandmarkTracker(folder, BlazeFaceDetector(folder), refine_eyelids=False)
    with open_source(source) as capture:
        for _, frame in capture:
            if tracker.update(frame) is not None:
                number = len(refined)
                crop = crop_face(frame, points[number], caller.pixels_per_texel)
                refined.append(caller.texel_fitter.refine(crop, faces[number], 3))
    pose = caller.reference.pose
    measured = measure_distortion(caller.texel_fitter, learned.crops[::8], learned.faces[::8], pose)
    harm = measured.distortion_matrix(caller.texel_fitter.template.modes)
    vectors = np.array([vector_from_face(face, pose) for face in refined])
    components = design_transform(vectors, harm, caller.appearance.modes, FRAMES_PER_PACKET)
    values = project(components, vectors, harm)
    return Material(vectors, harm, components, values, float(fps))


def eight_bits(material: Material) -> Point:
    """Every parameter in 255 steps of its range in the clip."""
    low, high = material.vectors.min(0), material.vectors.max(0)
    steps = np.maximum(high - low, 1e-9) / 255
    decoded = low + np.rint((material.vectors - low) / steps) * steps
    bps = 8 * material.vectors.shape[1] * material.fps
    return Point(material.harm_of(decoded), {ROWS[0]: bps})


def fixed_length(values: Array, steps: Array) -> tuple[Array, float]:
    """Values (t, k) rounded to steps (k,), and the bits a frame takes in codes of fixed length."""
    codes = np.rint(values / steps)
    return codes * steps, float(np.ceil(np.log2(np.ptp(codes, axis=0) + 1)).sum())


def at_harm(code: Callable[[float], tuple[float, float]], harm: float) -> float:
    """Bits a frame of a way of coding whose (harm, bits) depend on a step, at `harm`."""
    low, high = -8.0, 8.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if code(2.0**middle)[0] < harm else (low, middle)
    return code(2.0**low)[1]


def plain_rows(material: Material, harm: float) -> dict[str, float]:
    """Bits a second without prediction, at `harm`."""
    sensitivity = 1 / np.sqrt(np.diag(material.harm))

    def by_parameter(size: float) -> tuple[float, float]:
        decoded, bits = fixed_length(material.vectors, size * sensitivity)
        return material.harm_of(decoded), bits

    def by_component(size: float) -> tuple[float, float]:
        decoded, bits = fixed_length(material.values, np.full(material.values.shape[1], size))
        return material.harm_of_values(decoded), bits

    ways = {ROWS[1]: by_parameter, ROWS[2]: by_component}
    return {row: material.fps * at_harm(way, harm) for row, way in ways.items()}


def predicted(material: Material, quality: int) -> Point:
    """Plain rounding of what prediction leaves, coded in two ways."""
    predictor = FramePredictor(material.components.scale_codes)
    listener = FramePredictor(material.components.scale_codes)
    frames, symbols, by_context = [], list[Integers](), 0.0
    for number, (start, end) in enumerate(packet_spans(len(material.values), FRAMES_PER_PACKET)):
        wanted = np.rint(material.values[start:end] * STEPS_PER_UNIT).astype(np.int64)
        head, sequence = PayloadHeader(quality, end - start, number == 0), number % SEQUENCE_MODULUS
        coded, known = round_packet(predictor, wanted, head, sequence)
        symbols += [differences for _, differences in coded]
        payload = encode_payload(predictor, sequence, FRAMES_PER_PACKET, head, coded)
        by_context += component_bits(listener, sequence, FRAMES_PER_PACKET, payload).sum()
        frames += [known[index] for index in range(1, end - start + 1)]
        predictor.anchor = frames[-1]
    per_second = material.fps / len(frames)
    spent = dict(zip(ROWS[3:5], (static_bits(symbols), by_context), strict=True))
    harm = material.harm_of_values(np.array(frames) / STEPS_PER_UNIT)
    return Point(harm, {row: count * per_second for row, count in spent.items()})


def round_packet(
    predictor: FramePredictor, wanted: Integers, head: PayloadHeader, sequence: int
) -> tuple[list[tuple[CodedFrame, Integers]], dict[int, Integers]]:
    """Differences of the frames (count, n) by place, each rounded to the nearest; the frames."""
    steps = np.array([step(head.quality, kind) for kind in range(PREDICTION_KINDS)])
    values, known = [], {0: predictor.anchor}
    for place in coding_order(len(wanted)):
        kinds = predictor.kinds(place, sequence, head.intra)
        error = wanted[place.index - 1] - predictor.predict(place, kinds, known)
        differences = np.rint(error / steps[kinds]).astype(np.int64)
        values.append((place, differences))
        known[place.index] = reconstruct(predictor, place, kinds, known, head.quality, differences)
    return values, known


def static_bits(symbols: list[Integers]) -> float:
    """Entropy of all symbols by one histogram of them all, bits."""
    counts = np.unique(np.concatenate(symbols), return_counts=True)[1]
    return float(-(counts * np.log2(counts / counts.sum())).sum())


def optimised(material: Material, quality: int) -> Point:
    """The encoder's own choice of values, at one quality."""
    predictor = FramePredictor(material.components.scale_codes)
    listener = FramePredictor(material.components.scale_codes)
    frames, ideal, payload = [], 0.0, 0
    for number, (start, end) in enumerate(packet_spans(len(material.values), FRAMES_PER_PACKET)):
        targets = material.values[start:end]
        sequence = number % SEQUENCE_MODULUS
        packet = code_packet(
            predictor, sequence, FRAMES_PER_PACKET, targets, quality, intra=number == 0
        )
        predictor.anchor = packet.frames[-1]
        frames.append(packet.frames)
        payload += len(packet.payload)
        ideal += component_bits(listener, sequence, FRAMES_PER_PACKET, packet.payload).sum()
    harm = material.harm_of_values(np.concatenate(frames) / STEPS_PER_UNIT)
    per_second = material.fps / len(material.values)
    return Point(harm, {ROWS[5]: ideal * per_second, ROWS[6]: 8 * payload * per_second})


def between(points: list[Point], harm: float) -> dict[str, float]:
    """Bits a second at `harm`, by logarithms between the points; nan where none are around it."""
    ordered = sorted(points, key=lambda point: point.harm)
    harms = np.log([point.harm for point in ordered])
    return {
        row: float(
            np.exp(
                np.interp(
                    np.log(harm),
                    harms,
                    np.log([point.bps[row] for point in ordered]),
                    left=np.nan,
                    right=np.nan,
                )
            )
        )
        for row in ordered[0].bps
    }


def gains(material: Material, harm: float) -> dict[str, float]:
    """Bits a second of every row at `harm`; the first has the harm that it has."""
    qualities = range(QUALITIES)
    return {
        **eight_bits(material).bps,
        **plain_rows(material, harm),
        **between([predicted(material, quality) for quality in qualities], harm),
        **between([optimised(material, quality) for quality in qualities], harm),
    }


def markdown(columns: dict[str, dict[str, float]]) -> str:
    """The rows of every clip and what each saves against the one before, geometric mean."""
    lines = [
        f"| bit/s | {' | '.join(columns)} | saves |",
        "|---" * (len(columns) + 2) + "|",
    ]
    table = np.array([[column[row] for column in columns.values()] for row in ROWS])
    for number, row in enumerate(ROWS):
        saved = 1 - np.exp(np.log(table[number] / table[number - 1]).mean()) if number else None
        cells = " | ".join(f"{value:.0f}" for value in table[number])
        lines.append(f"| {row} | {cells} | {'' if saved is None else f'{100 * saved:.0f} %'} |")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> None:
    """Print the table of the clips named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("clip", nargs="+")
    parser.add_argument("--harm", type=float, default=4.0, help="grey levels squared")
    options: Any = parser.parse_args(arguments)
    columns = {}
    for clip in options.clip:
        print(f"coding_gain: {clip}", file=sys.stderr)
        material = read_material(clip)
        columns[Path(clip).stem] = gains(material, options.harm)
        eight = eight_bits(material)
        print(
            f"{Path(clip).stem}: {material.vectors.shape[1]} parameters,"
            f" {material.values.shape[1]} components; 8 bits each: harm {eight.harm:.2g}"
        )
    print(f"\nat harm {options.harm:g}:\n\n{markdown(columns)}")


if __name__ == "__main__":
    run(main)
