"""The coding gain of each step of the default profile: bits a second at equal distortion.

    python -m benchmarks coding_gain CLIP... [--distortion 4]

Prints a table in Markdown.  Distortion is the squared luma error that quantisation adds, mean over
the visible texels, by the Gauss-Newton model of the picture (`DistortionModel`).  All rows code the
same values: pose, EAUs and mode coefficients of every frame, fitted in the shape-free frame.  From
the static code on, rows are ideal code lengths; the last row is the bytes of the packets.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import run
from benchmarks.fitted_clip import FittedClip, fit_clip
from encoder.coding.gop import FRAMES_PER_PACKET
from encoder.coding.rate_control import QUALITIES, packet_spans
from encoder.coding.rdo_quantiser import code_packet
from protocol.bit_accounting import component_bits
from protocol.frames.payload_coding import PayloadHeader, encode_payload
from protocol.frames.temporal_prediction import (
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
    CodedFrame,
    FramePredictor,
    coding_order,
    reconstruct,
    step,
)
from protocol.limits import SEQUENCE_MODULUS
from shared_model.arrays import Array, Integers

ROWS = (
    "8 bits a parameter, over its range",
    "steps of equal distortion, fixed length",
    "decorrelated components, fixed length",
    "hierarchical prediction, one static code",
    "adaptive contexts",
    "rate-distortion optimised values",
    "packet headers and whole bytes",
)


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """Distortion, and bits a second by row, of a coder at one quality."""

    distortion: float
    bps: dict[str, float]


def eight_bits(clip: FittedClip) -> OperatingPoint:
    """Every parameter in 255 steps of its range in the clip."""
    low, high = clip.vectors.min(0), clip.vectors.max(0)
    steps = np.maximum(high - low, 1e-9) / 255
    decoded = low + np.rint((clip.vectors - low) / steps) * steps
    bps = 8 * clip.vectors.shape[1] * clip.fps
    return OperatingPoint(clip.distortion_of(decoded), {ROWS[0]: bps})


def fixed_length_code(values: Array, steps: Array) -> tuple[Array, float]:
    """Values (t, k) rounded to steps (k,), and bits a frame in a code of fixed length."""
    codes = np.rint(values / steps)
    return codes * steps, float(np.ceil(np.log2(np.ptp(codes, axis=0) + 1)).sum())


def bits_at_distortion(code: Callable[[float], tuple[float, float]], distortion: float) -> float:
    """Bits a frame at `distortion` of a coder whose (distortion, bits) depend on its step."""
    low, high = -8.0, 8.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if code(2.0**middle)[0] < distortion else (low, middle)
    return code(2.0**low)[1]


def unpredicted(clip: FittedClip, distortion: float) -> dict[str, float]:
    """Bits a second without prediction, at `distortion`."""
    equal_steps = 1 / np.sqrt(np.diag(clip.distortion_matrix))

    def by_parameter(size: float) -> tuple[float, float]:
        decoded, bits = fixed_length_code(clip.vectors, size * equal_steps)
        return clip.distortion_of(decoded), bits

    def by_component(size: float) -> tuple[float, float]:
        decoded, bits = fixed_length_code(clip.values, np.full(clip.values.shape[1], size))
        return clip.distortion_of_values(decoded), bits

    coders = {ROWS[1]: by_parameter, ROWS[2]: by_component}
    return {row: clip.fps * bits_at_distortion(coder, distortion) for row, coder in coders.items()}


def predicted(clip: FittedClip, quality: int) -> OperatingPoint:
    """Prediction errors rounded to the nearest step, by a static code and by adaptive contexts."""
    predictor = FramePredictor(clip.transform.scale_codes)
    reader = FramePredictor(clip.transform.scale_codes)
    frames, symbols, by_context = [], list[Integers](), 0.0
    for number, (start, end) in enumerate(packet_spans(len(clip.values), FRAMES_PER_PACKET)):
        targets = np.rint(clip.values[start:end] * STEPS_PER_UNIT).astype(np.int64)
        header = PayloadHeader(quality, end - start, number == 0)
        sequence = number % SEQUENCE_MODULUS
        coded, known = quantise_packet(predictor, targets, header, sequence)
        symbols += [values for _, values in coded]
        payload = encode_payload(predictor, sequence, FRAMES_PER_PACKET, header, coded)
        by_context += component_bits(reader, sequence, FRAMES_PER_PACKET, payload).sum()
        frames += [known[index] for index in range(1, end - start + 1)]
        predictor.anchor = frames[-1]
    per_second = clip.fps / len(frames)
    bits_by_row = dict(zip(ROWS[3:5], (static_entropy_bits(symbols), by_context), strict=True))
    distortion = clip.distortion_of_values(np.array(frames) / STEPS_PER_UNIT)
    return OperatingPoint(
        distortion, {row: count * per_second for row, count in bits_by_row.items()}
    )


def quantise_packet(
    predictor: FramePredictor, frames: Integers, header: PayloadHeader, sequence: int
) -> tuple[list[tuple[CodedFrame, Integers]], dict[int, Integers]]:
    """The values of frames (count, n), each rounded to the nearest; and the decoded frames."""
    steps = np.array([step(header.quality, kind) for kind in range(PREDICTION_KINDS)])
    values, known = [], {0: predictor.anchor}
    for coded_frame in coding_order(len(frames)):
        kinds = predictor.kinds(coded_frame, sequence, header.intra)
        error = frames[coded_frame.index - 1] - predictor.predict(coded_frame, kinds, known)
        rounded = np.rint(error / steps[kinds]).astype(np.int64)
        values.append((coded_frame, rounded))
        known[coded_frame.index] = reconstruct(
            predictor, coded_frame, kinds, known, header.quality, rounded
        )
    return values, known


def static_entropy_bits(symbols: list[Integers]) -> float:
    """Bits of all symbols by their zero-order entropy."""
    counts = np.unique(np.concatenate(symbols), return_counts=True)[1]
    return float(-(counts * np.log2(counts / counts.sum())).sum())


def optimised(clip: FittedClip, quality: int) -> OperatingPoint:
    """Rate-distortion optimised values, at one quality."""
    predictor = FramePredictor(clip.transform.scale_codes)
    reader = FramePredictor(clip.transform.scale_codes)
    frames, ideal, payload = [], 0.0, 0
    for number, (start, end) in enumerate(packet_spans(len(clip.values), FRAMES_PER_PACKET)):
        targets = clip.values[start:end]
        sequence = number % SEQUENCE_MODULUS
        packet = code_packet(
            predictor, sequence, FRAMES_PER_PACKET, targets, quality, intra=number == 0
        )
        predictor.anchor = packet.frames[-1]
        frames.append(packet.frames)
        payload += len(packet.payload)
        ideal += component_bits(reader, sequence, FRAMES_PER_PACKET, packet.payload).sum()
    distortion = clip.distortion_of_values(np.concatenate(frames) / STEPS_PER_UNIT)
    per_second = clip.fps / len(clip.values)
    return OperatingPoint(
        distortion, {ROWS[5]: ideal * per_second, ROWS[6]: 8 * payload * per_second}
    )


def interpolated_bps(points: list[OperatingPoint], distortion: float) -> dict[str, float]:
    """Bits a second at `distortion`, interpolated in logarithms; nan outside the points."""
    ordered = sorted(points, key=lambda point: point.distortion)
    grid = np.log([point.distortion for point in ordered])

    def interpolated(row: str) -> float:
        bps = np.log([point.bps[row] for point in ordered])
        return float(np.exp(np.interp(np.log(distortion), grid, bps, left=np.nan, right=np.nan)))

    return {row: interpolated(row) for row in ordered[0].bps}


def bps_by_row(clip: FittedClip, distortion: float) -> dict[str, float]:
    """Bits a second of every row at `distortion`; the first row has its own."""
    qualities = range(QUALITIES)
    return {
        **eight_bits(clip).bps,
        **unpredicted(clip, distortion),
        **interpolated_bps([predicted(clip, quality) for quality in qualities], distortion),
        **interpolated_bps([optimised(clip, quality) for quality in qualities], distortion),
    }


def markdown(columns: dict[str, dict[str, float]]) -> str:
    """A table of the rows by clip, and the saving against the row before, geometric mean."""
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
    parser.add_argument("--distortion", type=float, default=4.0, help="grey levels squared")
    options: Any = parser.parse_args(arguments)
    columns = {}
    for path in options.clip:
        print(f"coding_gain: {path}", file=sys.stderr)
        clip = fit_clip(path)
        columns[Path(path).stem] = bps_by_row(clip, options.distortion)
        print(
            f"{Path(path).stem}: {clip.vectors.shape[1]} parameters,"
            f" {clip.values.shape[1]} components;"
            f" 8 bits each: distortion {eight_bits(clip).distortion:.2g}"
        )
    print(f"\nat distortion {options.distortion:g}:\n\n{markdown(columns)}")


if __name__ == "__main__":
    run(main)
