"""Recorded calls with bits to spare: what the model does not show is seen all the same."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from call_contents import packets_of, raw_packets
from conftest import without_layers
from disc_film import BITRATE, FRAMES, around_disc, decoded, pictures, psnr

from decoder.drawn_call import draw_call
from decoder.sinks.frame_sink import open_sink
from encoder.calls.call_session import RecordedPass
from encoder.calls.packet_sender import PacketSender
from encoder.calls.recorded_session import send_call
from encoder.calls.session_callbacks import SessionCallbacks
from encoder.calls.session_stats import SessionStats
from encoder.capture.frame_times import exact_fps
from encoder.capture.video_source import open_source
from encoder.options import EncodeOptions
from encoder.pipeline import EncodeRun, encode, encode_recorded, first_and_second_pass
from encoder.residual.draw_call import DrawCall
from protocol.call_file import CallWriter
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, parse_packet
from protocol.summary import summarise
from shared_model.errors import UserError

UNTOLD = SessionCallbacks(lambda *_: None, lambda: False)

Passed = tuple[EncodeRun, RecordedPass]


@pytest.fixture(scope="module")
def passed(disc_film: Path) -> Iterator[Passed]:
    """After both passes over the film: what can be sent with a residual and without."""
    options = EncodeOptions(str(disc_film), bitrate=BITRATE, model_bytes=9000, draw=draw_call)
    with open_source(str(disc_film)) as source:
        run = EncodeRun(options, source, SessionStats(), UNTOLD)
        yield run, first_and_second_pass(run)


def send(
    passed: Passed, path: Path, draw: DrawCall | None, callbacks: SessionCallbacks = UNTOLD
) -> SessionStats:
    """Send what was passed into a file."""
    (run, encoder), stats = passed, SessionStats()
    options = replace(run.options, draw=draw)
    with CallWriter(path) as sink:
        call = encode_recorded(
            encoder, replace(run, options=options, stats=stats, callbacks=callbacks)
        )
        send_call(call, PacketSender(sink, stats), None, lambda: False)
    return stats


@pytest.fixture(scope="module")
def call(passed: Passed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("residual") / "call.rzo"
    send(passed, path, draw_call)
    return path


def test_what_the_model_does_not_know_is_seen(
    disc_film: Path, passed: Passed, call: Path, tmp_path: Path
) -> None:
    plain = tmp_path / "plain.rzo"
    send(passed, plain, None)
    source, (shown, _), (without, _) = (
        pictures(disc_film),
        decoded(call, tmp_path),
        decoded(plain, tmp_path),
    )
    assert len(shown) == len(source)
    assert psnr(shown, source) > psnr(without, source) + 2
    seen, unseen = (psnr(around_disc(each), around_disc(source)) for each in (shown, without))
    assert seen > unseen + 6


def test_a_call_keeps_to_its_rate_and_says_where_the_bits_are(call: Path) -> None:
    summary = summarise(call)
    assert 0.6 * BITRATE < summary.frame_bps <= BITRATE
    assert summary.groups["residual"] > 0.5 * sum(summary.groups.values())
    model = packets_of(call)[0]
    assert isinstance(model, ModelPacket) and model.call.has_residual


def test_at_the_usual_rate_there_is_none(demo_run: Path) -> None:
    model = packets_of(demo_run / "out" / "demo" / "call.rzo")[0]
    assert isinstance(model, ModelPacket) and not model.call.has_residual


def test_a_lost_residual_does_not_stay_in_the_picture(call: Path, tmp_path: Path) -> None:
    lost = tmp_path / "lost.rzo"
    numbers = [i for i, data in enumerate(raw_packets(call)) if is_frame(data)]
    with CallWriter(lost) as writer:
        for index, data in enumerate(raw_packets(call)):
            if index != numbers[2]:
                writer.send(data)
    (whole, _), (shown, report) = decoded(call, tmp_path), decoded(lost, tmp_path)
    assert report.lost_packets == 1 and len(shown) == len(whole)
    # The packet had frames 9 to 16; faces heal within three packets, the residual needs none.
    assert psnr(shown[33:41], whole[33:41]) > psnr(shown[9:17], whole[9:17]) + 6


def test_a_face_that_leaves_takes_its_residual_along(carphone: Path, tmp_path: Path) -> None:
    path, call = tmp_path / "leaves.mkv", tmp_path / "leaves.rzo"
    with open_source(str(carphone)) as capture, open_sink(path, 176, 144, exact_fps(25)) as sink:
        for index, picture in capture:
            if index == 25:
                break
            sink.write(picture if index < 14 else np.full_like(picture, 90))
    options = EncodeOptions(str(path), call, bitrate=BITRATE, model_bytes=9000, draw=draw_call)
    with without_layers():
        encode(options, lambda *_: None, lambda: False)
    shown, report = decoded(call, tmp_path)
    assert len(shown) == 25 and not any("damaged" in warning for warning in report.warnings)


def is_frame(data: bytes) -> bool:
    return isinstance(parse_packet(data), FramePacket)


def test_a_damaged_residual_is_told_and_the_face_goes_on(call: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.rzo"
    packets = raw_packets(call)
    first = next(i for i, data in enumerate(packets) if is_frame(data) and len(data) > 200)
    # One byte of the block's length and one behind it: the tiles end too early.
    body = bytearray(packets[first])
    body[60:90] = bytes(30)
    packets[first] = bytes(body)
    with CallWriter(damaged) as writer:
        for data in packets:
            writer.send(data)
    shown, report = decoded(damaged, tmp_path)
    assert len(shown) == FRAMES and report.complete


def test_a_call_that_is_stopped_is_whole_with_less_residual(passed: Passed, tmp_path: Path) -> None:
    said, path = list[str](), tmp_path / "stopped.rzo"

    def stop() -> bool:
        return "picture residual, frame 25" in said

    send(passed, path, draw_call, replace(UNTOLD, stop=stop, on_preparing=said.append))
    summary = summarise(path)
    assert summary.complete and summary.frames == FRAMES
    sizes = [len(data) for data in raw_packets(path) if is_frame(data)]
    assert min(sizes[1:4]) > 2 * max(sizes[4:])


def test_where_nothing_can_be_drawn_the_call_is_one_without(passed: Passed, tmp_path: Path) -> None:
    def cannot(stream: object, wants: object) -> NoReturn:
        raise UserError("no EGL here")

    path = tmp_path / "plain.rzo"
    stats = send(passed, path, cannot)
    assert any("no EGL here" in warning for warning in stats.warnings)
    model = packets_of(path)[0]
    assert isinstance(model, ModelPacket) and not model.call.has_residual
    assert summarise(path).complete
