"""Codes one clip by one codec at several settings, and measures what comes out."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

from decoder.drawn_call import draw_call
from decoder.pipeline import DecodeOptions, decode
from encoder.calls.call_session import RecordedPass
from encoder.calls.packet_sender import PacketSender
from encoder.calls.recorded_session import send_call
from encoder.calls.session_callbacks import SessionCallbacks
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.coding.model_packet import ModelBudget, budget_for
from encoder.options import EncodeOptions
from encoder.pipeline import EncodeRun, encode, encode_recorded, first_and_second_pass
from loopback.curves.points import Point
from loopback.curves.rivals import (
    Rival,
    RivalSetting,
    code,
    decoded,
    scaled_size,
    shrunk,
)
from loopback.judge.comparison import SourceView
from loopback.quality.region_quality import region_meter
from loopback.quality.video_quality import measure_pictures
from loopback.report import rounded
from protocol.call_file import CallWriter
from protocol.summary import summarise
from runtime.parallel import parallel_map
from shared_model.arrays import Picture
from shared_model.errors import UserError

Warn = Callable[[str], None]

# A rival's rates beyond this say nothing of calls, bits a second.
MAX_BPS = 120_000.0
SCALES, FRAME_STEPS = (1.0, 0.5, 0.25), (1, 2)
# Of qualities at half the rate of frames every second one is tried.
HALF_RATE_STRIDE = 2
# Of larger pictures fewer are looked at by what takes long, see `look_interval`.
LOOK_INTERVAL, LOOK_PIXELS = 10, 150_000


@dataclass(frozen=True, slots=True)
class Rung:
    """A setting of ours: bits a second, and bytes of the model; None: the usual number."""

    bitrate: float
    model_bytes: int | None = None

    @property
    def label(self) -> str:
        """For people."""
        model = "" if self.model_bytes is None else f", model {self.model_bytes}"
        return f"{self.bitrate:g} bit/s{model}"


# From what a radio carries to what other codecs need: the model grows with the rate.
LADDER = (
    Rung(300, 8000),
    Rung(800),
    Rung(2000, 20_000),
    Rung(5000, 35_000),
    Rung(12_000, 60_000),
    Rung(30_000, 100_000),
)


def look_interval(size: tuple[int, int]) -> int:
    """Every so many frames SSIMULACRA2 and the person are looked at, in pictures of this size."""
    return max(LOOK_INTERVAL, round(LOOK_INTERVAL * size[0] * size[1] / LOOK_PIXELS))


@dataclass(frozen=True, slots=True, eq=False)
class ClipPictures:
    """The frames of a clip that are coded, and what is known of them.

    pictures: (h, w, 3) uint8 BGR.
    """

    view: SourceView
    pictures: Sequence[Picture]
    fps: Fraction

    @property
    def seconds(self) -> float:
        """Their duration."""
        return len(self.pictures) / float(self.fps)

    def measured(self, copies: Iterator[Picture], warn: Warn) -> dict[str, Any]:
        """The figures of decoded pictures."""
        pairs = zip(self.pictures, copies, strict=False)
        regions = region_meter(self.view.people, warn, self.view.interval)
        quality = measure_pictures(pairs, self.view.face_masks(), self.view.aspect, regions)
        if quality.frames != len(self.pictures):
            raise UserError(f"{quality.frames} pictures of {len(self.pictures)} were decoded")
        return quality.figures()


def read_clip(view: SourceView) -> ClipPictures:
    """The frames that a view is of."""
    with open_source(view.source) as capture:
        pictures = [picture for _, picture in islice(capture, view.max_frames)]
        return ClipPictures(view, pictures, capture.fps)


def rival_points(rival: Rival, clip: ClipPictures, is_realtime: bool, warn: Warn) -> list[Point]:
    """All settings of a rival whose rate is below `MAX_BPS`."""
    chains = [(scale, step) for scale in SCALES for step in FRAME_STEPS]

    def along(chain: tuple[float, int]) -> list[Point]:
        scale, step = chain
        size = scaled_size(clip.view.size, scale)
        if size is None:
            return []
        small = shrunk(clip.pictures[::step], size)
        points: list[Point] = []
        for quality in rival.qualities[:: 1 if step == 1 else HALF_RATE_STRIDE]:
            setting = RivalSetting(quality, scale, step, is_realtime)
            point = _rival_point(rival, setting, small, clip, warn)
            if point is None or point.steady_bps > MAX_BPS:
                break
            points.append(point)
        return points

    return [point for points in parallel_map(along, chains, None) for point in points]


def _rival_point(
    rival: Rival, setting: RivalSetting, small: Sequence[Picture], clip: ClipPictures, warn: Warn
) -> Point | None:
    """None: the codec refuses this size."""
    try:
        packets = code(rival, setting, small, clip.fps)
    except UserError as error:
        warn(str(error))
        return None
    first, *rest = (packet.size for packet in packets)
    rate = 8 * sum(rest) / max(clip.seconds - setting.frame_step / float(clip.fps), 1e-3)
    label = f"crf {setting.quality}, 1/{round(1 / setting.scale)}"
    label += ", half the frames" if setting.frame_step > 1 else ""
    if rate > MAX_BPS:
        return Point(label, first, rate)
    copies = decoded(rival, packets, setting.frame_step, clip.view.size)
    return Point(label, first, rate, clip.measured(copies, warn), asdict(setting))


def call_path(stem: Path, rung: Rung, is_live: bool) -> Path:
    """Where the call file of a rung is left.  stem: of a clip's files."""
    live = "-live" if is_live else ""
    model = "" if rung.model_bytes is None else f"-{rung.model_bytes}"
    return stem.with_name(f"{stem.name}{live}-{rung.bitrate:g}{model}.rzo")


def own_points(
    rungs: Sequence[Rung], clip: ClipPictures, is_live: bool, stem: Path, warn: Warn
) -> Iterator[Point]:
    """Our calls of a clip, one rung after the other; each call file is left, see `call_path`."""
    trained: dict[ModelBudget, tuple[RecordedPass, EncodeRun]] = {}
    for rung in rungs:
        call = call_path(stem, rung, is_live)
        options = EncodeOptions(
            source=clip.view.source,
            output=call,
            bitrate=rung.bitrate,
            model_bytes=rung.model_bytes,
            max_frames=len(clip.pictures),
            live=is_live,
            voice="off",
            draw=draw_call,
        )
        if is_live:
            stage_ms = encode(options, _ignore, _never).stages.stage_ms
        else:
            budget = budget_for(options.profile, rung.model_bytes, rung.bitrate)
            if budget not in trained:
                trained = {budget: _trained(options)}
            encoder, run = trained[budget]
            with CallWriter(call) as sink:
                parts = encode_recorded(encoder, replace(run, options=options))
                send_call(parts, PacketSender(sink, run.stats), None, _never)
            stage_ms = run.stats.timer.mean_ms(len(clip.pictures))
        point = _own_point(rung, call, clip, warn)
        times = {name: rounded(ms, 2) for name, ms in stage_ms.items()}
        yield replace(point, figures={**point.figures, "stage_ms": times})


@contextmanager
def decoded_call(call: Path) -> Iterator[Iterator[Picture]]:
    """The pictures of a call file for the time of the `with` block."""
    draft = call.with_suffix(".mkv")
    try:
        decode(DecodeOptions(call_file=call, output=draft), _ignore, _never)
        with open_source(str(draft)) as capture:
            yield (picture for _, picture in capture)
    finally:
        draft.unlink(missing_ok=True)


def _own_point(rung: Rung, call: Path, clip: ClipPictures, warn: Warn) -> Point:
    with decoded_call(call) as copies:
        figures = clip.measured(copies, warn)
    summary = summarise(call)
    figures["groups"] = {name: rounded(count, 1) for name, count in summary.groups.items()}
    return Point(rung.label, summary.model_bytes, summary.record_bps, figures, asdict(rung))


def _trained(options: EncodeOptions) -> tuple[RecordedPass, EncodeRun]:
    with open_source(options.source, square_pixels=True) as capture:
        run = EncodeRun(options, capture, SessionStats(), _CALLBACKS)
        return first_and_second_pass(run), run


def _ignore(done: int, total: int | None) -> None:
    """Progress that nobody asks for."""


def _never() -> bool:
    return False


_CALLBACKS = SessionCallbacks(_ignore, _never)
