"""Curves of clips: our calls beside other codecs, on the same frames.

What is measured of a clip is noted in the folder codec by codec: a bench that was stopped goes on
where it was, and one with more rivals, rungs or clips measures only those.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np

from encoder.capture.video_source import open_source
from loopback.bench import ClipFailure, check_recorded, make_folder, output_names
from loopback.curves.contenders import (
    ClipPictures,
    Rung,
    call_path,
    look_interval,
    own_points,
    read_clip,
    rival_points,
)
from loopback.curves.exhibits import (
    Exhibit,
    nearest_point,
    own_exhibit,
    rival_exhibit,
    source_exhibit,
)
from loopback.curves.points import (
    DURATIONS_S,
    MEASURES,
    Curve,
    Point,
    bd_rate_percent,
    crossing_bps,
    curve_of,
)
from loopback.curves.rivals import RIVALS, Rival, RivalSetting
from loopback.judge.comparison import observe_source
from loopback.judge.observer import Observer, find_observer
from loopback.report import Cell, rounded, write_json
from shared_model.errors import UserError

OURS = "risorius"
SCHEMA = "risorius-curves/1"
# For a cluster's scheduler to answer, s.
CONNECT_S = 10
# The rate of a call by default; the length of the calls whose pictures are shown at equal bytes.
DEFAULT_BPS, EQUAL_S = 800.0, 10.0
Say = Callable[[str], None]
# Points of all codecs by codec.
Contenders = dict[str, list[Point]]


@dataclass(frozen=True, slots=True)
class CurveSettings:
    """rungs: of ours.  rivals: by name.  is_live: a single pass, and rivals in real time."""

    rungs: tuple[Rung, ...]
    rivals: tuple[str, ...]
    is_live: bool = False
    max_frames: int | None = None


def rivals_named(names: Iterable[str]) -> list[Rival]:
    """Raises `UserError` for one that is not known or not installed."""
    found = []
    for name in names:
        if name not in RIVALS:
            raise UserError(f"{name} is no rival; there are {', '.join(RIVALS)}")
        if not RIVALS[name].is_installed:
            raise UserError(f"neither PyAV nor an ffmpeg here codes {name}; see make judge")
        found.append(RIVALS[name])
    return found


def bench_curves(
    sources: Sequence[str],
    settings: CurveSettings,
    folder: Path,
    say: Say,
    pool: "Pool | None" = None,
) -> tuple[dict[str, Contenders], str, list[ClipFailure]]:
    """The points of each codec of each clip, the judge's name, and the clips that failed.

    Notes, exhibits and our call files are left in `folder`, which a cluster must share.
    pool: see `open_pool`.
    Raises `UserError` as `check_recorded` and `rivals_named` do, before anything is coded.
    """
    check_recorded(sources)
    rivals_named(settings.rivals)
    make_folder(folder)
    say(f"bench: the judge is {find_observer().name}")
    clips, failures = dict[str, Contenders](), list[ClipFailure]()
    tasks = zip(sources, output_names(sources), strict=True)
    if pool is None:
        results = (
            (s, name, partial(bench_clip, s, name, settings, folder, say)) for s, name in tasks
        )
    else:
        # All at once; what a clip says stays with whom it runs at.
        futures = [(s, n, pool.submit(bench_clip, s, n, settings, folder)) for s, n in tasks]
        results = ((source, name, future.result) for source, name, future in futures)
    judge = ""
    for source, name, result in results:
        try:
            clips[name], judge = result()
            say(f"bench: {name} is done, {len(clips)} of {len(sources)}")
        except UserError as error:
            failures.append(ClipFailure(source, error))
            say(f"bench: {name} failed: {error}")
    return clips, judge, failures


class Pool(Protocol):
    """Runs functions elsewhere, as `concurrent.futures` and dask.distributed do."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """What has a `result` once it is done."""


@contextmanager
def open_pool(jobs: int, scheduler: str | None) -> Iterator[Pool | None]:
    """A pool of so many processes on this host, or a cluster by the address of its scheduler.

    None: clips are measured one after the other here.  Raises `UserError`.
    """
    if scheduler is not None:
        try:
            from distributed import Client
        except ImportError as error:
            raise UserError("a cluster needs dask: pip install '.[cluster]'") from error
        try:
            connect: Any = Client
            client = connect(scheduler, timeout=CONNECT_S)
        except (OSError, TimeoutError, ValueError) as error:
            raise UserError(f"no scheduler of dask answers at {scheduler}") from error
        with client:
            yield client
    elif jobs > 1:
        context = get_context("spawn")
        with ProcessPoolExecutor(jobs, mp_context=context) as pool:
            yield cast(Pool, pool)
    else:
        yield None


def _silent(line: str) -> None:
    """Nobody reads here."""


def bench_clip(
    source: str, name: str, settings: CurveSettings, folder: Path, say: Say = _silent
) -> tuple[Contenders, str]:
    """The points of one clip, noted in `folder`, and the judge's name.  Raises `UserError`."""
    observer, stem = find_observer(), folder / name
    notes = _Notes(folder / f"{name}.points.json", _identity(source, settings, observer))
    clip: ClipPictures | None = None
    said: set[str] = set()

    def read() -> ClipPictures:
        nonlocal clip
        if clip is None:
            with open_source(source) as capture:
                interval = look_interval((capture.width, capture.height))
            clip = read_clip(observe_source(source, observer, settings.max_frames, interval))
        return clip

    def warn(line: str) -> None:
        if line not in said:
            said.add(line)
            say(line)

    missing = [rung for rung in settings.rungs if rung.label not in notes.labels(OURS)]
    if missing:
        say(f"bench: {name}: our calls, {len(missing)} rungs")
        for point in own_points(missing, read(), settings.is_live, stem, warn):
            notes.add(OURS, [point])
    for rival in rivals_named(settings.rivals):
        if not notes.labels(rival.name):
            say(f"bench: {name}: {rival.name}")
            notes.add(rival.name, rival_points(rival, read(), settings.is_live, warn))
    exhibits = _exhibits_path(folder, name)
    if clip is not None or not exhibits.is_file():
        say(f"bench: {name}: pictures for the report")
        shown = [asdict(each) for each in _exhibits(settings, notes, read(), stem)]
        write_json(exhibits, {"exhibits": shown})
    wanted = {rung.label for rung in settings.rungs}
    ours = [point for point in notes.points(OURS) if point.label in wanted]
    rivals = {rival: notes.points(rival) for rival in settings.rivals}
    return {OURS: ours} | rivals, observer.name


def shown_rung(rungs: Sequence[Rung]) -> Rung:
    """The one that the report compares: nearest to what a call has by default."""
    return min(rungs, key=lambda rung: abs(np.log(rung.bitrate / DEFAULT_BPS)))


def _exhibits(
    settings: CurveSettings, notes: "_Notes", clip: ClipPictures, stem: Path
) -> Iterator[Exhibit]:
    """The source, our call of the rung that is compared, and each rival at as many bytes."""
    yield source_exhibit(clip)
    rung = shown_rung(settings.rungs)
    ours = next(point for point in notes.points(OURS) if point.label == rung.label)
    bps = ours.total_bps(EQUAL_S)
    title = f"{OURS}<br>{bps / 1000:.1f} kbit/s"
    call = call_path(stem, rung, settings.is_live)
    if not call.is_file():  # Somebody has tidied up.
        list(own_points([rung], clip, settings.is_live, stem, lambda line: None))
    yield own_exhibit(title, call, clip)
    for rival in rivals_named(settings.rivals):
        point = nearest_point(notes.points(rival.name), bps, EQUAL_S)
        if point is not None:
            rate = point.total_bps(EQUAL_S) / 1000
            title = f"{rival.name}, {point.label}<br>{rate:.1f} kbit/s"
            yield rival_exhibit(rival, RivalSetting(**point.setting), title, clip)


def read_exhibits(folder: Path, name: str) -> list[Exhibit]:
    """Those of a clip; none if there are no such notes."""
    try:
        content = json.loads(_exhibits_path(folder, name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    return [Exhibit(**each) for each in content["exhibits"]]


def _exhibits_path(folder: Path, name: str) -> Path:
    return folder / f"{name}.exhibits.json"


class _Notes:
    """The points of one clip, in a file.

    identity: what they must have in common; notes of another one are forgotten.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
        self._path = path
        self._content: dict[str, Any] = {**identity, "points": {}}
        try:
            old = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return
        if isinstance(old, dict) and all(old.get(k) == v for k, v in identity.items()):
            self._content = old

    def add(self, codec: str, points: Sequence[Point]) -> None:
        """Note more points."""
        self._content["points"].setdefault(codec, []).extend(map(asdict, points))
        write_json(self._path, self._content)

    def points(self, codec: str) -> list[Point]:
        """Those of a codec."""
        return [Point(**each) for each in self._content["points"].get(codec, [])]

    def labels(self, codec: str) -> set[str]:
        """Their settings."""
        return {point.label for point in self.points(codec)}


def _identity(source: str, settings: CurveSettings, observer: Observer) -> dict[str, Any]:
    path = Path(source)
    return {
        "schema": SCHEMA,
        "source": path.name,
        "source_bytes": path.stat().st_size if path.is_file() else None,
        "max_frames": settings.max_frames,
        "live": settings.is_live,
        "judge": observer.name,
    }


@dataclass(frozen=True, slots=True)
class Duel:
    """Ours against a rival on one clip, by one measure, for calls of one length.

    our_bps, our_quality: of our rung.  their_bps: what the rival needs for that quality; None: it
        has no such point.  crossing_bps: from which rate on the rival is at least as good; None:
        nowhere up to `their_highest_bps`.  bd_rate_percent: see `bd_rate_percent`.
    """

    clip: str
    rival: str
    measure: str
    duration_s: float
    our_bps: float
    our_quality: float | None
    their_bps: float | None
    crossing_bps: float | None
    bd_rate_percent: float | None
    their_highest_bps: float


def duels(clips: Mapping[str, Contenders], rung: str) -> list[Duel]:
    """Every rival of every clip against our rung of this label, by every measure and length."""
    found = []
    for clip, contenders in clips.items():
        ours = contenders[OURS]
        ours_at = next((point for point in ours if point.label == rung), None)
        for rival, points in contenders.items():
            if rival == OURS or ours_at is None:
                continue
            for measure in MEASURES:
                for duration_s in DURATIONS_S:
                    our_curve = curve_of(ours, measure, duration_s)
                    theirs = curve_of(points, measure, duration_s)
                    found.append(
                        _duel(clip, rival, measure, duration_s, ours_at, our_curve, theirs)
                    )
    return found


def _duel(
    clip: str,
    rival: str,
    measure: str,
    duration_s: float,
    point: Point,
    ours: Curve,
    theirs: Curve,
) -> Duel:
    quality = point.figures.get(measure)
    needed = None if quality is None else theirs.rate_for(quality)
    return Duel(
        clip,
        rival,
        measure,
        duration_s,
        point.total_bps(duration_s),
        quality,
        rounded(needed, 0),
        rounded(crossing_bps(ours, theirs), 0),
        rounded(bd_rate_percent(ours, theirs), 1),
        float(theirs.rates[-1]) if len(theirs.rates) else 0.0,
    )


def geometric_mean_kbps(rates: Sequence[float | None], highest: Sequence[float]) -> str | None:
    """The geometric mean of rates, kbit/s.

    A rate that is not known is above its `highest`, which stands for it: then the mean is a lower
    bound, "> 50.1".  None: nothing stands for one of the rates.
    """
    known = [rate or bound for rate, bound in zip(rates, highest, strict=True)]
    if not all(known):
        return None
    mean = float(np.exp(np.mean(np.log(known)))) / 1000
    return f"{'' if all(rates) else '> '}{mean:.{1 if mean >= 10 else 2}f}"


def curve_report(
    clips: Mapping[str, Contenders], settings: CurveSettings, failures: Sequence[ClipFailure]
) -> dict[str, Any]:
    """What report.json says."""
    rung = shown_rung(settings.rungs).label
    return {
        "schema": SCHEMA,
        "settings": asdict(settings),
        "rung": rung,
        "clips": {
            name: {codec: [asdict(point) for point in points] for codec, points in each.items()}
            for name, each in clips.items()
        },
        "duels": [asdict(duel) for duel in duels(clips, rung)],
        "failed": [{"source": item.source, "error": str(item.error)} for item in failures],
    }


def duel_rows(found: Sequence[Duel], duration_s: float) -> tuple[tuple[str, ...], list[list[Cell]]]:
    """Header and rows: what each rival needs for our quality, and where it overtakes us.

    Both are geometric means over the clips, see `geometric_mean_kbps`.
    """
    header = (
        "rival",
        "measure",
        "clips",
        "ours kbit/s",
        "needs kbit/s",
        "overtakes at",
        "BD-rate %",
    )
    rows: list[list[Cell]] = []
    at = [duel for duel in found if duel.duration_s == duration_s]
    for rival in dict.fromkeys(duel.rival for duel in at):
        for measure in MEASURES:
            each = [d for d in at if (d.rival, d.measure) == (rival, measure)]
            each = [duel for duel in each if duel.our_quality is not None]
            if each:
                rows.append(_duel_row(rival, measure, each))
    return header, rows


def _duel_row(rival: str, measure: str, each: Sequence[Duel]) -> list[Cell]:
    rates = [duel.bd_rate_percent for duel in each if duel.bd_rate_percent is not None]
    highest = [duel.their_highest_bps for duel in each]
    return [
        rival,
        measure,
        len(each),
        geometric_mean_kbps([duel.our_bps for duel in each], highest),
        geometric_mean_kbps([duel.their_bps for duel in each], highest),
        geometric_mean_kbps([duel.crossing_bps for duel in each], highest),
        f"{np.mean(rates):+.0f}" if rates else None,
    ]


def point_rows(clips: Mapping[str, Contenders]) -> tuple[tuple[str, ...], list[list[Cell]]]:
    """Header and rows: our rungs of each clip."""
    header = ("clip", "rung", "start B", "bit/s", *MEASURES)
    rows: list[list[Cell]] = []
    for name, contenders in clips.items():
        for point in contenders[OURS]:
            rate = rounded(point.steady_bps, 0)
            qualities = (point.figures.get(measure) for measure in MEASURES)
            rows.append([name, point.label, point.start_bytes, rate, *qualities])
    return header, rows
