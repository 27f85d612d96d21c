"""Bits, PSNR and latency of calls on this host."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from encoder.capture.video_source import is_pipe, open_source
from encoder.option_rules import DEFAULT_OPTIONS, THESIS_OPTIONS, Options, option_typed
from loopback.call_figures import call_figures, is_call_figure
from loopback.figures import FIGURES
from loopback.judge.comparison import Comparison, compare, observe_source
from loopback.judge.observer import Observer, find_observer
from loopback.process_pair import busy_loops, pinned, run_call
from loopback.report import figure, figure_names, rounded, wrapped_table
from loopback.report_page import environment, html_table, page, stacked_bars
from shared_model.errors import UserError

# Per frame of the source, and to start the processes and fit the model.
LIMIT_S_PER_FRAME = 3.0
LIMIT_START_S = 120.0
TABLE_COLUMNS = {each.name: each.column for each in FIGURES if each.column}
AVERAGED_FIGURES = tuple(each.name for each in FIGURES if each.is_averaged)
# Of report.json: raised where a figure changes its name or meaning.
SCHEMA = "risorius-bench/1"
# Options of the encoder that a bench may be given, by name, and their defaults.  pace: at the
# clips' own rate, as latency needs it.
ENCODER_OPTIONS: Options = {
    **{"preset": None, "profile": "default", "max_frames": None, "pace": True, "model_bytes": None},
    **{name: value for name, value in THESIS_OPTIONS.items() if name != "without"},
    **DEFAULT_OPTIONS,
}


def encoder_options(given: Options) -> dict[str, Any]:
    """All of `ENCODER_OPTIONS` by name: the given ones, and the defaults of the others.

    given: as `checked_options` returns them; what is no option of a bench is left out.
    """
    return {name: given.get(name, value) for name, value in ENCODER_OPTIONS.items()}


@dataclass(frozen=True, slots=True)
class BenchSettings:
    """How clips are encoded.

    encoder: the encoder's options, all of `ENCODER_OPTIONS`: see `encoder_options`.
    busy: so many busy loops run beside.  cores: that all of it runs on, as in "0,1"; None: all.
    """

    encoder: Mapping[str, Any]
    busy: int = 0
    cores: str | None = None

    def command_line(self) -> list[str]:
        """The same as the command line of the encoder's process, which is what users run."""
        line = ["--lossless", "--voice", "off", "--profile", self.encoder["profile"]]
        for name, value in self.encoder.items():
            if name != "profile" and value != ENCODER_OPTIONS[name]:
                line.append(option_typed(name, value))
                line += [] if isinstance(value, bool) else [str(value)]
        return line


@dataclass(frozen=True, slots=True)
class ClipFailure:
    """A source whose call failed, and why."""

    source: str
    error: UserError


def bench(
    sources: Sequence[str], settings: BenchSettings, folder: Path, say: Callable[[str], None]
) -> Iterator[dict[str, Any] | ClipFailure]:
    """Measure each source: its figures by name, or why there are none, one after the other.

    Decoded videos stay in `folder`.  Raises `UserError` as `check_recorded` does, before anything
    runs.
    """
    check_recorded(sources)
    observer = find_observer()
    for source, name in zip(sources, output_names(sources), strict=True):
        say(f"bench: {source}")
        try:
            yield bench_clip(source, settings, folder / f"{name}.mkv", observer, say)
        except UserError as error:
            yield ClipFailure(source, error)


def bench_report(
    settings: BenchSettings,
    clips: Sequence[Mapping[str, Any]],
    failures: Sequence[ClipFailure] = (),
) -> dict[str, Any]:
    """What report.json says: `clips`, the figures of each, `failed` and `mean` over the clips."""
    failed = [{"source": item.source, "error": str(item.error)} for item in failures]
    mean = mean_figures(clips)
    used = {**settings.encoder, "busy": settings.busy, "cores": settings.cores}
    content = {"settings": used, "clips": clips, "failed": failed, "mean": mean}
    return {"schema": SCHEMA, **content}


def bench_clip(
    source: str,
    settings: BenchSettings,
    output: Path,
    observer: Observer,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """The figures of one source, sent from one process to another; decoded into `output`.

    say: called with a line for what cannot be measured here.
    """
    check_recorded([source])
    options = settings.encoder
    with open_source(source) as capture:
        frames = min(capture.frame_count or 10_000, options["max_frames"] or 10_000)
    make_folder(output.parent)
    limit_s = LIMIT_START_S + LIMIT_S_PER_FRAME * frames
    with pinned(settings.cores), busy_loops(settings.busy):
        result = run_call(source, output, settings.command_line(), limit_s)
    view = observe_source(source, observer, options["max_frames"])
    compared = compare(view, str(output), observer, lambda done, total: None, say)
    figures = call_figures(result, options["profile"])
    return {"source": Path(source).name, **figures, **compared.figures()}


def is_figure(name: str) -> bool:
    """Whether a clip's report has a figure of this dotted name."""
    return name in figure_names(Comparison) or is_call_figure(name)


def mean_figures(clips: Sequence[Mapping[str, Any]]) -> dict[str, float | None]:
    """Mean over the clips of the figures that have one."""
    columns = {
        name: [clip[name] for clip in clips if clip.get(name) is not None]
        for name in AVERAGED_FIGURES
    }
    return {name: rounded(float(np.mean(c))) if c else None for name, c in columns.items()}


def bench_table(clips: Sequence[Mapping[str, Any]]) -> str:
    """The main figures of each clip and their mean, as a table."""
    return wrapped_table(list(TABLE_COLUMNS.values()), _rows(clips))


def bench_page(clips: Sequence[Mapping[str, Any]]) -> bytes:
    """The same as an HTML page, with where the time goes."""
    parts = [html_table(list(TABLE_COLUMNS.values()), _rows(clips))]
    names = [clip["source"] for clip in clips]
    for end in ("encoder", "decoder"):
        stages = [clip[f"{end}_ms"] for clip in clips]
        parts.append(stacked_bars(names, stages, f"{end}, ms a frame by stage", is_level=True))
    return page("risorius bench", [*parts, environment()])


def _rows(clips: Sequence[Mapping[str, Any]]) -> list[list[Any]]:
    rows: list[list[Any]] = [[figure(clip, name) for name in TABLE_COLUMNS] for clip in clips]
    if len(clips) > 1:
        mean = {"source": "mean", **mean_figures(clips)}
        rows.append([mean.get(name) for name in TABLE_COLUMNS])
    return rows


def check_recorded(sources: Sequence[str]) -> None:
    """Raise `UserError` for a source that cannot be read or is none that can be read again."""
    for source in sources:
        if source.isdecimal() or "://" in source or is_pipe(source):
            raise UserError(f"{source}: only a recorded video can be compared with what comes out")
        open_source(source).close()


def output_names(sources: Sequence[str]) -> list[str]:
    """A file name without suffix for each source; all different."""
    names: list[str] = []
    for source in sources:
        path = Path(source)
        name = path.parent.name if "%" in path.name else path.stem
        taken = sum(other == name or other.startswith(f"{name}-") for other in names)
        names.append(f"{name}-{taken + 1}" if taken else name)
    return names


def make_folder(folder: Path) -> None:
    """Make `folder` and those above it.  Raises `UserError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot make the folder {folder}: {error.strerror}") from error
