"""Train the probability model of wavelet coefficients on the pictures in call files.

    python -m assets.training_faces PICTURES calls
    python -m assets.train_probability_model calls/*.rzo --held-out others/*.rzo

writes protocol/data/probability_model.npz and prints the bits per decision in either set, before
the weights are rounded.  Hold out the people of published results.  Call files are read by the
weights in place; with new ones they can no longer be decoded, so the format needs new numbers.
Optimiser: Adam (Kingma & Ba 2015).
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from assets.array_band_decoder import ArrayBandDecoder
from assets.array_context import CodingPass, class_rows, pass_features, tile_sums
from benchmarks.command import run
from protocol.call_file import CallReader
from protocol.entropy.range_coder import PROBABILITY_ONE, RangeDecoder
from protocol.frames.transform_coding import parse_transform
from protocol.model_packet import ModelPacket
from protocol.packets import parse_packet
from protocol.pictures.coefficient_coding import STEP_OUTPUTS, UNARY_LIMIT
from protocol.pictures.layered_background import background_pictures
from protocol.pictures.picture_codec import parse_picture_header, plane_shapes
from protocol.pictures.plane_decoding import decode_planes
from protocol.pictures.probability_model import (
    CLASS_COUNT,
    CLASS_STARTS,
    HIDDEN_BITS,
    LOGIT_BITS,
    MIN_PROBABILITY,
    MODE,
    WEIGHT_ARRAYS,
    WEIGHT_BITS,
    BandPosition,
    ProbabilityModels,
)
from protocol.pictures.subband_coding import PictureSequence
from protocol.pictures.subband_pyramid import SubbandPyramid
from shared_model.arrays import Array, Integers, Picture, Single, VertexIndices

OUTPUT = Path(__file__).parents[1] / "protocol" / "data" / "probability_model.npz"
# Of the networks of tiles, sizes and signs: hidden units, epochs, weight decay.
HIDDEN, ROUNDS, DECAY = (16, 40, 24), (6, 14, 12), (0.0, 0.0, 1e-3)
BATCH, RATE, SEED = 8192, 6e-3, 1
# Features are sixteenths of an octave.
SCALE = 16


@dataclass(frozen=True, slots=True)
class Samples:
    """Decisions of one network: inputs and outcomes.

    features: (n, f) int16.
    classes: (n, c) uint8, rows of the class weights.
    sizes: (n,) uint8, magnitudes; of tiles and signs 0 or 1.
    """

    features: NDArray[np.int16]
    classes: Picture
    outcomes: Picture

    def __len__(self) -> int:
        return len(self.outcomes)


def concatenated(samples: Sequence[Samples]) -> Samples:
    """All samples of a sequence."""
    return Samples(
        np.concatenate([each.features for each in samples]),
        np.concatenate([each.classes for each in samples]),
        np.concatenate([each.outcomes for each in samples]),
    )


class ContextRecorder:
    """Records what the networks are asked while pictures are decoded."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, BandPosition, CodingPass, Array]] = []

    def bands(self, coder: RangeDecoder) -> ArrayBandDecoder:
        """A decoder whose questions are recorded."""
        return ArrayBandDecoder(coder, lambda *asked: self.asked.append(asked))

    def samples(self, pyramids: Sequence[SubbandPyramid]) -> Iterator[tuple[str, Samples]]:
        """The inputs recorded since the last call, with the outcomes in the picture decoded."""
        for network, site, turn, features in self.asked:
            band = pyramids[site.plane].band(site)
            if network == "tiles":
                found = tile_sums(np.abs(band))[turn.rows, turn.columns] > 0
            else:
                values = band[turn.rows, turn.columns]
                found = values < 0 if network == "signs" else np.abs(values)
            known = _all_features(features, site, turn), _classes(site, turn)
            yield network, Samples(*known, np.minimum(found, UNARY_LIMIT).astype(np.uint8))
        self.asked.clear()


def _all_features(features: Array, site: BandPosition, turn: CodingPass) -> NDArray[np.int16]:
    whole = np.array([pass_features(site, turn)] * len(features))
    return np.concatenate([features, whole], 1).astype(np.int16)


def _classes(site: BandPosition, turn: CodingPass) -> Picture:
    same = np.array([class_rows(site, turn)] * len(turn.rows))
    cells = np.column_stack(turn.position_cells) + np.array(CLASS_STARTS[-2:])
    return np.concatenate([same, cells], 1).astype(np.uint8)


def read_call(path: Path) -> tuple[list[Samples], ...]:
    """The samples of each network in the pictures of a call file's model packets."""
    recorder = ContextRecorder()
    found: dict[str, list[Samples]] = {name: [] for name in ProbabilityModels.__slots__}

    def keep(pyramids: Sequence[SubbandPyramid]) -> None:
        for network, samples in recorder.samples(pyramids):
            found[network].append(samples)

    reader = CallReader(path)
    for data in reader:
        packet = parse_packet(data)
        if not isinstance(packet, ModelPacket):
            continue
        if packet.call.profile != "default":
            raise SystemExit(f"{path} is of the {packet.call.profile} profile, expected default")
        size = packet.call.width, packet.call.height
        for still in (*background_pictures(packet.background, *size), packet.texture):
            head = parse_picture_header("still", still)
            shapes, sequence = plane_shapes(head.height, head.width), PictureSequence(head.kind)
            data = still[head.start + 1 :]
            keep(decode_planes(sequence, "still", data, shapes, recorder.bands))
        modes = PictureSequence(MODE)
        for mode in parse_transform(packet.profile_data).modes:
            keep(decode_planes(modes, "mode", mode[1:], shapes, recorder.bands))
    return tuple(found.values())


@dataclass(frozen=True, slots=True)
class Weights:
    """The weights of a network before rounding.

    first: (f + CLASS_COUNT, h).  last: (h + 1, outputs).
    """

    first: Single
    last: Single


def train(samples: Samples, hidden: int, outputs: int, rounds: int, decay: float) -> Weights:
    """The weights that minimise the code length of the samples."""
    rng = np.random.default_rng(SEED)
    inputs = samples.features.shape[1] + CLASS_COUNT
    scales = np.where(np.arange(inputs) < inputs - CLASS_COUNT, 0.15, 0.05)[:, None]
    weights = Weights(
        (scales * rng.normal(size=(inputs, hidden))).astype(np.float32),
        (0.2 * rng.normal(size=(hidden + 1, outputs))).astype(np.float32),
    )
    parts = (weights.first, weights.last)
    means, squares = ([np.zeros_like(part) for part in parts] for _ in range(2))
    batches = len(samples) // BATCH
    if not batches:
        raise SystemExit(f"{len(samples)} samples, expected at least {BATCH}: give more calls")
    for turn in range(rounds):
        order = rng.permutation(len(samples))
        for number in range(batches):
            chosen = order[number * BATCH : (number + 1) * BATCH]
            slopes = gradient(weights, samples, chosen)
            step = turn * batches + number + 1
            rate = RATE * (1 + np.cos(np.pi * step / (rounds * batches))) / 2
            for part, slope, mean, square in zip(parts, slopes, means, squares, strict=True):
                mean += 0.1 * (slope - mean)
                square += 0.003 * (slope**2 - square)
                usual = np.sqrt(square / (1 - 0.997**step)) + 1e-8
                part -= rate * (mean / (1 - 0.9**step) / usual + decay * part)
    return weights


def gradient(weights: Weights, samples: Samples, chosen: Integers) -> tuple[Single, Single]:
    """Gradient of the mean code length of the chosen samples, by `first` and by `last`."""
    given, hidden, stops = forward(weights, samples, chosen)
    stopped, asked = outputs_and_decisions(samples.outcomes[chosen], weights.last.shape[1])
    error = ((stops * asked - stopped) / len(chosen)).astype(np.float32)
    back = (error @ weights.last[:-1].T) * (hidden > 0)
    ahead = np.concatenate([hidden.T @ error, error.sum(0, keepdims=True)])
    return given.T @ back, ahead


def forward(weights: Weights, samples: Samples, chosen: Integers) -> tuple[Single, Single, Single]:
    """Inputs (n, i), hidden values (n, h) and probabilities (n, outputs) of zeros."""
    count = samples.features.shape[1]
    given = np.zeros((len(chosen), count + CLASS_COUNT), np.float32)
    given[:, :count] = samples.features[chosen] / np.float32(SCALE)
    given[np.arange(len(chosen))[:, None], count + samples.classes[chosen]] = 1
    hidden = np.maximum(given @ weights.first, 0)
    logits = hidden @ weights.last[:-1] + weights.last[-1]
    return given, hidden, 1 / (1 + np.exp(-np.clip(logits, -30, 30)))


def outputs_and_decisions(sizes: Picture, outputs: int) -> tuple[Single, Single]:
    """(n, outputs) number of zeros decided by each output, and number of its decisions."""
    if outputs == 1:
        return (sizes == 0)[:, None].astype(np.float32), np.ones((len(sizes), 1), np.float32)
    steps = np.eye(outputs, dtype=np.float32)[list(STEP_OUTPUTS)]
    unary = np.minimum(sizes, UNARY_LIMIT - 1)
    return steps[unary], np.cumsum(steps, axis=0)[unary]


def code_length_bits(weights: Weights, samples: Samples) -> float:
    """The code length of the samples, bits."""
    total = 0.0
    for start in range(0, len(samples), 8 * BATCH):
        chosen = np.arange(start, min(start + 8 * BATCH, len(samples)))
        stops = np.clip(
            forward(weights, samples, chosen)[2],
            MIN_PROBABILITY / PROBABILITY_ONE,
            1 - MIN_PROBABILITY / PROBABILITY_ONE,
        )
        stopped, asked = outputs_and_decisions(samples.outcomes[chosen], weights.last.shape[1])
        total -= float((stopped * np.log2(stops) + (asked - stopped) * np.log2(1 - stops)).sum())
    return total


def integer_weights(weights: Weights) -> dict[str, VertexIndices]:
    """The weights in the integers of `probability_model.Mlp`."""
    count = len(weights.first) - CLASS_COUNT
    unit, hidden_unit = 2**WEIGHT_BITS, 2**HIDDEN_BITS
    logit_unit = 2 ** (LOGIT_BITS + WEIGHT_BITS)
    last = weights.last * logit_unit
    last[:-1] /= hidden_unit
    parts = (weights.first[:count] * unit / SCALE, weights.first[count:] * unit, last)
    return {
        name: np.rint(part).astype(np.int32)
        for name, part in zip(WEIGHT_ARRAYS, parts, strict=True)
    }


def main(arguments: Sequence[str]) -> None:
    """Read calls, train, write, report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("calls", nargs="+", type=Path, help="call files to train on")
    parser.add_argument(
        "--held-out", nargs="*", type=Path, default=[], help="call files to evaluate on"
    )
    options: Any = parser.parse_args(arguments)
    calls, others = ([read_call(p) for p in ps] for ps in (options.calls, options.held_out))
    stored: dict[str, VertexIndices] = {}
    outputs = (1, len(set(STEP_OUTPUTS)), 1)
    for index, name in enumerate(ProbabilityModels.__slots__):
        ours = concatenated([samples for call in calls for samples in call[index]])
        weights = train(ours, HIDDEN[index], outputs[index], ROUNDS[index], DECAY[index])
        stored |= {f"{name}_{part}": values for part, values in integer_weights(weights).items()}
        print(
            f"{name}: {code_length_bits(weights, ours) / len(ours):.4f} bits each of {len(ours)}",
            end="",
        )
        if others:
            rest = concatenated([samples for call in others for samples in call[index]])
            print(
                f", held out {code_length_bits(weights, rest) / len(rest):.4f} of {len(rest)}",
                end="",
            )
        print(flush=True)
    # Its type stubs take the arrays for other arguments.
    np.savez_compressed(OUTPUT, **stored)  # type: ignore[arg-type]


if __name__ == "__main__":
    run(main)
