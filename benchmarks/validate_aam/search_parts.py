"""Parts of the experiments about searches (3.1.2): where they end, step by step, how fast."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from aam.charts import has_charts
from aam.search.search import METHODS, SearchOptions
from aam.training.train import TrainingOptions
from benchmarks.validate_aam import tables
from benchmarks.validate_aam.asked import Asked, Part, verdict
from benchmarks.validate_aam.contenders import (
    Contender,
    found_points,
    start_pose,
    train_residual_head,
)
from benchmarks.validate_aam.plots import convergence_chart
from benchmarks.validate_aam.samples import Sample
from benchmarks.validate_aam.search_experiments import (
    Generalisation,
    best_possible,
    convergence,
    generalisation,
    step_sheet,
)
from runtime.parallel import one_blas_thread

# Share of the shape's variance that modes keep where they include residual ones.
RESIDUAL_RETAINED = 0.97
# By start: whether it is displaced; the thesis' error, square pixels (Table 3.1); its share of
# pictures in which the head is better, %.
STARTS = {"exact": (False, 49.6, 83.0), "displaced": (True, 66.7, 85.4)}
# A search's CPU time, ms.
SEARCH_MS = 30.0

# By contender, way of searching and start.
Results = Mapping[tuple[str, str, str], Generalisation]
# Searches that load what the first ones need.
UNTIMED = 3


def search_part(
    pair: dict[str, Contender], train: Sequence[Sample], test: Sequence[Sample], seed: int
) -> Part:
    """Generalisation (Table 3.1); additive searches step by step (Fig. 3.1 to 3.3)."""
    results = _generalisations(pair, test, METHODS, seed)
    text = f"## Generalisation: {len(test)} pictures of new people\n\n"
    text += "Thesis: exact 49.6 (head) and 89.6 (2D), displaced 66.7 and 145.6.\n\n"
    text += _told(results, METHODS)
    text += "\nStarts at nasion and subnasale (3.2):\n\n"
    some = ("cascade", "additive")
    text += _told(_generalisations(pair, test, some, seed, "n-sn"), some)
    additive = SearchOptions("additive")
    paths = {name: convergence(each, test, additive, True, seed) for name, each in pair.items()}
    sheets = {name: step_sheet(each, test, additive, True, seed) for name, each in pair.items()}
    files: dict[str, str | bytes] = {
        f"search_{name}.png": cv2.imencode(".png", sheet)[1].tobytes()
        for name, sheet in sheets.items()
    }
    if has_charts():
        files["convergence.svg"] = convergence_chart(paths)
    asked = [*_asked_errors(results), _asked_better(results, "cascade")]
    asked.append(_asked_better(results, "additive", ", the thesis' own (additive) search"))
    return Part(text + "\n" + tables.convergence_table(paths), files, asked)


def residual_part(
    pair: dict[str, Contender],
    train: Sequence[Sample],
    test: Sequence[Sample],
    options: TrainingOptions,
    seed: int,
) -> Part:
    """The same for a head with modes of what AE shapes leave of the landmarks (3.1.2)."""
    richer = replace(options, shape_retained=RESIDUAL_RETAINED, regression=False)
    head = train_residual_head(train, richer)
    methods = ("cascade", "additive")
    results = _generalisations({"head": head, "2D": pair["2D"]}, test, methods, seed)
    counts = ", ".join(str(len(level.shape.variances)) for level in head.levels)
    text = "## Generalisation of the head with residual modes\n\n"
    text += f"Shape modes of the levels: {counts}; best possible error of the test set, px^2: "
    text += f"{best_possible(head, test).error:.1f}.\n\n"
    asked = [_asked_better(results, way, f", with residual modes, {way}") for way in methods]
    return Part(text + _told(results, methods), {}, asked)


def speed_part(pair: dict[str, Contender], test: Sequence[Sample]) -> Part:
    """CPU time of a search, ms."""
    times = {
        method: [search_time(each, test, SearchOptions(method)) for each in pair.values()]
        for method in METHODS
    }
    rows = [
        [method, *(f"{each.median_ms:.1f} ({each.p95_ms:.1f})" for each in both)]
        for method, both in times.items()
    ]
    head = times[SearchOptions().method][0]
    asked = Asked(
        "one search, CPU, ms: median (95th percentile)",
        f"{SEARCH_MS:g}",
        f"{head.median_ms:.0f} ({head.p95_ms:.0f})",
        verdict({"": head.median_ms <= SEARCH_MS}),
    )
    text = "## CPU time of a search, ms: median (95th percentile)\n\n"
    return Part(text + tables.table(["search", *pair], rows), {}, (asked,))


def _generalisations(
    pair: dict[str, Contender],
    test: Sequence[Sample],
    methods: Sequence[str],
    seed: int,
    anchors: str = "eyes",
) -> Results:
    return {
        (name, method, start): generalisation(
            contender, test, SearchOptions(method), displaced, seed, anchors
        )
        for start, (displaced, _, _) in STARTS.items()
        for method in methods
        for name, contender in pair.items()
    }


def _told(results: Results, methods: Sequence[str]) -> str:
    lines = [
        f"- {start} start, {method}: {_better(results, method, start):.1f} %"
        for start in STARTS
        for method in methods
    ]
    text = tables.search_table(results)
    return text + "\nThe head is better (thesis: 83.0 and 85.4 %) in\n\n" + "\n".join(lines) + "\n"


def _better(results: Results, method: str, start: str) -> float:
    """Share of the pictures in which the head is better than the 2D AAM, %."""
    head, planar = (results[name, method, start] for name in ("head", "2D"))
    return 100 * head.better_than(planar)


def _asked_errors(results: Results) -> list[Asked]:
    found = []
    for start, (_, limit, _) in STARTS.items():
        head, planar = (results[name, "cascade", start].error for name in ("head", "2D"))
        what, asked = f"error, {start} start, px^2", f"below {limit}, and below the 2D AAM"
        met = verdict({"": head < min(limit, planar)})
        found.append(Asked(what, asked, f"{head:.1f} against {planar:.1f}", met))
    return found


def _asked_better(results: Results, method: str, more: str = "") -> Asked:
    shares = {start: _better(results, method, start) for start in STARTS}
    met = {start: shares[start] >= share for start, (_, _, share) in STARTS.items()}
    asked = ", ".join(f"{share:.1f}" for _, _, share in STARTS.values())
    reached = ", ".join(f"{share:.1f}" for share in shares.values())
    what = f"pictures in which the head is better, exact, displaced, %{more}"
    return Asked(what, asked, reached, verdict(met))


@dataclass(frozen=True, slots=True)
class SearchTime:
    """CPU time of a search with the preparation of its picture, ms: median and 95th percentile."""

    median_ms: float
    p95_ms: float


def search_time(
    contender: Contender, samples: Sequence[Sample], options: SearchOptions
) -> SearchTime:
    """Search each picture from its eyes, one after the other on one core."""
    times = []
    with one_blas_thread():
        for sample in [*samples[:UNTIMED], *samples]:
            pose = start_pose(contender, sample, np.zeros(2), 1.0)
            begin = time.thread_time()
            found_points(contender, sample, pose, options)
            times.append(1000 * (time.thread_time() - begin))
    median_ms, p95_ms = np.percentile(times[UNTIMED:], (50, 95))
    return SearchTime(float(median_ms), float(p95_ms))
