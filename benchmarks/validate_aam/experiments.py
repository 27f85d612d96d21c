"""All experiments in a row; each returns its part of the tables."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from aam.search.search import SearchOptions
from aam.training.train import TrainingOptions
from aam.training.train import train as train_model
from benchmarks.validate_aam import tables
from benchmarks.validate_aam.asked import Asked, Part, asked_rows, joined, verdict
from benchmarks.validate_aam.contenders import Contender, train_head, train_planar
from benchmarks.validate_aam.first_frames import (
    WAYS,
    FirstFrames,
    Found,
    TruePicture,
    find_first_frames,
    judged_frames,
    landmark_offsets,
)
from benchmarks.validate_aam.model_parts import model_part, prediction_part
from benchmarks.validate_aam.samples import Sample, split_people
from benchmarks.validate_aam.search_experiments import generalisation
from benchmarks.validate_aam.search_parts import residual_part, search_part, speed_part
from benchmarks.validate_aam.units.unit_experiment import unit_part

Tell = Callable[[str], None]

# Experiments in the order of the tables; those that compare the AAM of the head with the 2D AAM.
PARTS = (
    *("model", "search", "residual", "speed", "prediction", "variants", "first-frames"),
    *("units", "units-n-sn", "training"),
)
# Of a part's file with its lines of the table of what was asked.
ROWS = ".rows.md"
PARTS_OF_PAIR = frozenset({"model", "search", "residual", "speed", "prediction"})
# Of these, those that need the cascade and those that need the regressed matrix.
PARTS_OF_SEARCH = frozenset({"search", "residual", "speed"})
PARTS_OF_MATRICES = frozenset({"search", "speed", "prediction"})
SEED = 1
# Texels a side of the model whose training is timed, and how long it may take, seconds.
TRAINED_SIZE, TRAINED_S = 128, 300.0
# Shares of first frames below 5 % that are asked for, %, by way and folder.
RIGHT_FRAMES = {
    "network": {"imm": 98, "ytf": 95, "orl": 95},
    "network + AAM": {"imm": 98, "ytf": 95, "orl": 95},
    "Viola-Jones + AAM": {"imm": 90, "ytf": 80, "orl": 80},
}
# What is changed one by one (2.4.2 to 2.4.5), from the full frame, retinex, W_s as it is.
VARIANTS = {
    "full frame, retinex": {},
    "inside-face frame": {"frame": "inside"},
    "no light normalisation": {"normalisation": "none"},
    "W_s / 3": {"shape_weight": 1 / 3},
    "W_s x 3": {"shape_weight": 3.0},
    "97 % of the variance": {"retained": 0.97},
    "first two modes discarded": {"discard": 2},
    "no mirror images": {"mirror": False},
}


def run_experiments(
    train: Sequence[Sample],
    test: Sequence[Sample],
    truth: Sequence[TruePicture],
    size: int,
    parts: Sequence[str],
    tell: Tell,
) -> Iterator[tuple[str, str | bytes]]:
    """Files by name and content as each part is done: a table for each part, plots, pictures.

    train, test: share no person.  truth: for the first frames.
    size: texels a side of the finest level.  parts: of `PARTS`.
    Raises `ValueError` if they share one.
    """
    if {each.face.person for each in train} & {each.face.person for each in test}:
        raise ValueError("test has people of train")
    options = TrainingOptions(size=size)
    asked = set(parts)
    needed = replace(
        options, cascade=bool(asked & PARTS_OF_SEARCH), regression=bool(asked & PARTS_OF_MATRICES)
    )
    pair = train_pair(train, needed, tell) if asked & PARTS_OF_PAIR else {}
    for part in parts:
        tell(part)
        match part:
            case "model":
                done = model_part(pair, train, test, SEED)
            case "search":
                done = search_part(pair, train, test, SEED)
            case "residual":
                done = residual_part(pair, train, test, needed, SEED)
            case "speed":
                done = speed_part(pair, test)
            case "prediction":
                done = prediction_part(pair, train, test)
            case "variants":
                done = variant_part(train, test, options, tell)
            case "first-frames":
                done = first_frame_part([*train, *test], truth, options)
            case "units":
                done = unit_part(train, test, size, SEED)
            case "units-n-sn":
                done = unit_part(train, test, size, SEED, "n-sn")
            case "training":
                done = training_part(train, replace(options, size=TRAINED_SIZE))
            case _:
                raise ValueError(f"part is {part!r}, expected one of {PARTS}")
        yield from done.files.items()
        yield f"{part}{ROWS}", asked_rows(part, done.asked)
        # The last one: a part whose table is there is done.
        yield f"{part}.md", done.text


def train_pair(
    train: Sequence[Sample], options: TrainingOptions, tell: Tell
) -> dict[str, Contender]:
    """The AAM of the head and the 2D AAM."""
    tell("training the AAM of the head and the 2D AAM")
    return {"head": train_head(train, options), "2D": train_planar(train, options)}


def variant_part(
    train: Sequence[Sample], test: Sequence[Sample], options: TrainingOptions, tell: Tell
) -> Part:
    """Frames, light, W_s and the rest, by additive search."""
    rows = []
    for name, changes in VARIANTS.items():
        tell(f"variant: {name}")
        changed = replace(options, cascade=False, **changes)  # type: ignore[arg-type]
        contender = train_head(train, changed)
        cells = [name]
        for displaced in (False, True):
            each = generalisation(contender, test, SearchOptions("additive"), displaced, SEED)
            cells += [f"{each.error:.1f}", f"{100 * each.right:.1f}"]
        rows.append(cells)
    head = [
        "head, additive search",
        "exact: px^2",
        "below 5 %, %",
        "displaced: px^2",
        "below 5 %, %",
    ]
    return Part("## Variants\n\n" + tables.table(head, rows))


def first_frame_part(
    train: Sequence[Sample], truth: Sequence[TruePicture], options: TrainingOptions
) -> Part:
    """Shares of first frames fitted right; each half of the people by a model of the other half."""
    found: dict[str, list[tuple[list[TruePicture], Mapping[str, Found]]]] = {}
    for samples, pictures in zip(*folds(train, truth), strict=True):
        model = train_model([each.face for each in samples], options)
        for folder in sorted({each.folder for each in pictures}):
            own = [each for each in pictures if each.folder == folder]
            found.setdefault(folder, []).append((own, find_first_frames(model, own)))
    results: dict[tuple[str, str], list[FirstFrames]] = {}
    for folder, halves in found.items():
        for own, by_way in halves:
            # By the offsets that the other half of the people shows.
            others = [each for each in halves if each[0] is not own]
            network = [points for _, ways in others for points in ways[WAYS[0]]]
            offsets = landmark_offsets(network, [each for half, _ in others for each in half])
            for way, frames in judged_frames(by_way, own, offsets).items():
                results.setdefault((folder, way), []).append(frames)
    rows, right = [], dict[str, dict[str, float]]()
    for folder, way in sorted(results):
        parts = results[folder, way]
        each = FirstFrames(
            np.concatenate([half.nme for half in parts]),
            np.concatenate([half.nme_shifted for half in parts]),
            np.concatenate([half.nme_offset for half in parts]),
        )
        right_shares = (each.right, each.right_shifted, each.right_offset)
        shares = [f"{100 * share:.1f}" for share in (each.found, *right_shares)]
        right.setdefault(way, {})[folder] = 100 * each.right
        rows.append([folder, way, len(each.nme), *shares, f"{100 * np.median(each.nme):.2f}"])
    head = [
        "faces",
        "found by",
        "pictures",
        "found, %",
        "below 5 %, %",
        "below 5 % of moved truth, %",
        "below 5 %, each landmark of truth moved, %",
        "median distance, %",
    ]
    asked = [_asked_frames(way, shares) for way, shares in right.items()]
    return Part("## First frames of new people\n\n" + tables.table(head, rows), {}, asked)


def _asked_frames(way: str, shares: Mapping[str, float]) -> Asked:
    """shares: of first frames below 5 %, %, by folder; those of other folders are not asked."""
    limits = {name: limit for name, limit in RIGHT_FRAMES[way].items() if name in shares}
    what = f"first frames below 5 %, {way}, %: {', '.join(limits)}"
    met = {name: shares[name] >= limit for name, limit in limits.items()} or {"": False}
    reached = ", ".join(f"{shares[name]:.1f}" for name in limits)
    return Asked(what, joined(limits.values()), reached, verdict(met))


def training_part(train: Sequence[Sample], options: TrainingOptions) -> Part:
    """How long a model of all training faces takes."""
    begin, cpu = time.perf_counter(), time.process_time()
    train_model([sample.face for sample in train], options)
    spent, cpu = time.perf_counter() - begin, time.process_time() - cpu
    what = f"training of {len(train)} faces at {options.size} texels, s"
    text = f"## Training\n\n{what}: {spent:.0f}, {cpu:.0f} of CPU\n"
    asked = Asked(what, f"{TRAINED_S:g}", f"{spent:.0f}", verdict({"": spent <= TRAINED_S}))
    return Part(text, {}, (asked,))


def folds(
    train: Sequence[Sample], truth: Sequence[TruePicture]
) -> tuple[list[list[Sample]], list[list[TruePicture]]]:
    """Training sets, and for each the pictures of people who are not in it."""
    halves = split_people(train, 2)
    people = [{sample.face.person for sample in half} for half in halves]
    known = set().union(*people)
    # Who is in neither half is judged once.
    other = [[each for each in truth if each.person in own] for own in reversed(people)]
    other[0] += [each for each in truth if each.person not in known]
    return halves, other
