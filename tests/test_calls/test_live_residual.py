"""Live calls with bits to spare: what the model does not show is seen as soon as it comes."""

import os
import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future
from pathlib import Path
from threading import Event
from typing import BinaryIO

import numpy as np
import pytest
from call_contents import packets_of, raw_packets
from conftest import without_layers
from disc_film import BITRATE, FRAMES, around_disc, decoded, pictures, psnr

from decoder.drawn_call import draw_call
from encoder.calls.live_residual import LiveResidual
from encoder.calls.packet_sender import PacketSender
from encoder.calls.send_queue import MAX_WAIT_S
from encoder.calls.session_stats import SessionStats
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from encoder.residual.call_drawing import ResidualTask, differences_of
from encoder.residual.draw_call import DrawCall
from encoder.residual.drawing_thread import DrawingThread
from encoder.residual.residual_worker import LocalResidual, ResidualProcess
from protocol.call_file import MAGIC, CallWriter
from protocol.call_records import RecordReader
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, parse_packet, serialise
from protocol.picture_residual.drawn_picture import DrawnPicture
from protocol.picture_residual.framing import covered_frames, join_payload, split_payload
from protocol.summary import summarise
from shared_model.errors import UserError


def send(film: Path, call: Path, draw: DrawCall | None, frames: int | None = None) -> list[str]:
    """Send the film, or its first frames, live, as fast as it can be read; returns the warnings."""
    options = EncodeOptions(
        str(film), call, bitrate=BITRATE, model_bytes=9000, live=True, draw=draw, max_frames=frames
    )
    return list(encode(options, lambda *_: None, lambda: False).warnings)


@pytest.fixture(scope="module")
def call(disc_film: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("live") / "call.rzo"
    assert not any("residual" in warning for warning in send(disc_film, path, draw_call))
    return path


def test_what_the_model_does_not_know_is_seen(disc_film: Path, call: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain.rzo"
    send(disc_film, plain, None)
    source = pictures(disc_film)
    (shown, report), (without, _) = decoded(call, tmp_path), decoded(plain, tmp_path)
    assert len(shown) == len(source) == FRAMES and not report.warnings
    assert psnr(shown, source) > psnr(without, source) + 2
    seen, unseen = (psnr(around_disc(each), around_disc(source)) for each in (shown, without))
    assert seen > unseen + 5


def test_all_versions_of_the_model_have_it_and_the_rate_holds(call: Path) -> None:
    summary, packets = summarise(call), packets_of(call)
    assert 0.5 * BITRATE < summary.frame_bps <= BITRATE
    models = [packet for packet in packets if isinstance(packet, ModelPacket)]
    assert len(models) > 1 and all(model.call.has_residual for model in models)


@pytest.mark.parametrize("error", [UserError, ValueError])
def test_where_nothing_can_be_drawn_the_call_goes_on_without(
    disc_film: Path, tmp_path: Path, error: type[Exception]
) -> None:
    def cannot(stream: object, wants: object) -> Generator[DrawnPicture, None, None]:
        yield from ()
        raise error("no EGL here")

    path = tmp_path / "plain.rzo"
    # Of one frame, then twice of eight.
    frames = 17
    with without_layers():
        warnings = send(disc_film, path, cannot, frames)
    assert sum("no EGL here" in warning for warning in warnings) == 1
    assert summarise(path).complete and len(decoded(path, tmp_path)[0]) == frames


def faces_of(call: Path) -> tuple[ModelPacket, list[bytes]]:
    """The first version of a call's model, and the faces of its packets."""
    packets = packets_of(call)
    models = [i for i, packet in enumerate(packets) if isinstance(packet, ModelPacket)]
    model = packets[models[0]]
    assert isinstance(model, ModelPacket)
    own = packets[: models[1]]
    return model, [split_payload(each.payload)[1] for each in own if isinstance(each, FramePacket)]


def test_a_process_of_its_own_codes_the_same(disc_film: Path, call: Path) -> None:
    model, faces = faces_of(call)
    source, size = pictures(disc_film), (model.call.width, model.call.height)
    told = list[str]()
    workers = (
        LocalResidual(draw_call, size, 12_000),
        ResidualProcess(draw_call, size, 12_000, told.append),
    )
    blocks = []
    for worker in workers:
        first = FramePacket(0, join_payload(b"", faces[0]))
        worker.warm_up([serialise(model), serialise(first)])
        worker.see(serialise(model))
        coded = list[Future[bytes]]()
        for number, face in enumerate(faces[:2]):
            worker.see(serialise(FramePacket(number, join_payload(b"", face))))
            covered = covered_frames(model.call, number, 1 if not number else 8)
            sources = {index: source[index] for index in covered}
            coded.append(worker.block(ResidualTask(covered, sources, 0.3, 800)))
        blocks.append([each.result(120) for each in coded])
        worker.close()
    assert blocks[0] == blocks[1] and blocks[0][1] and not told


def test_a_process_that_dies_is_told_and_waited_for_by_nobody() -> None:
    told = list[str]()
    worker = ResidualProcess(draw_call, (64, 48), 12_000, told.append)
    os.kill(worker.pid, signal.SIGKILL)
    task = ResidualTask(range(1), {0: np.zeros((48, 64, 3), np.uint8)}, 0.3, 800)
    for _ in range(2):
        with pytest.raises(ChildProcessError):
            worker.block(task).result(60)
    worker.close()
    assert len(told) == 1 and "residual" in told[0]


class SlowWorker:
    """Codes a packet when it is told to."""

    def __init__(self) -> None:
        self.coded, self.tasks = list[Future[bytes]](), list[ResidualTask]()
        self.first_wanted = list[int]()

    def warm_up(self, packets: Sequence[bytes]) -> None:
        pass

    def see(self, packet: bytes, first_wanted: int = 0) -> None:
        self.first_wanted.append(first_wanted)

    def block(self, task: ResidualTask) -> "Future[bytes]":
        self.tasks.append(task)
        self.coded.append(Future())
        return self.coded[-1]

    def close(self) -> None:
        pass


def test_packets_wait_in_order_and_not_for_long(tmp_path: Path) -> None:
    worker, now_s, path = SlowWorker(), [0.0], tmp_path / "call.rzo"
    residual, stats = LiveResidual(worker, lambda _: None), SessionStats()
    picture = np.zeros((48, 64, 3), np.uint8)
    with CallWriter(path) as sink:
        sender = PacketSender(sink, stats, residual=residual, clock=lambda: now_s[0])

        def send(number: int, has_time: bool = True) -> None:
            residual.add_source(number, picture)
            sender.send_frames(number, b"face", 0.3, range(number, number + 1), has_time)

        send(0)
        sender.report_face(False, 1)
        send(1)  # the worker is busy: this one gets none, but its turn is not yet
        assert stats.sent.packets == 0
        worker.coded[0].set_result(b"block")
        sender.send_waiting()
        assert stats.sent.packets == 3
        send(2)
        send(3, has_time=False)
        now_s[0] += 0.9 * MAX_WAIT_S
        sender.send_waiting()
        assert stats.sent.packets == 3
        now_s[0] += 0.2 * MAX_WAIT_S
        sender.send_waiting()
        assert stats.sent.packets == 5
        sender.end(4)
    assert len(worker.coded) == 2
    sent = list(map(parse_packet, raw_packets(path)))
    blocks = [split_payload(each.payload)[0] for each in sent if isinstance(each, FramePacket)]
    assert blocks == [b"block", b"", b"", b""]
    kinds = [each.kind for each in sent if isinstance(each, ControlPacket)]
    assert kinds == [ControlKind.FACE_LOST, ControlKind.END]
    assert isinstance(sent[1], ControlPacket)
    assert any("3 of 4 packets have no picture residual" in warning for warning in stats.warnings)


def test_a_worker_that_is_too_slow_is_asked_less_often_until_it_is_in_time() -> None:
    worker, asked = SlowWorker(), list[int]()
    residual = LiveResidual(worker, lambda _: None)
    picture = np.zeros((48, 64, 3), np.uint8)
    for number in range(32):
        residual.add_source(number, picture)
        covered = range(number, number + 1)
        coded = residual.begin_packet(number, b"face", covered, 0.3, has_time=True)
        if coded is not None and number >= 12:
            coded.set_result(b"in time")
        residual.payload(coded, b"face")
        if coded is not None:
            asked.append(number)
            if not coded.done():
                coded.set_result(b"late")
    assert asked == [0, 1, 3, 7, *range(15, 32)]
    # Frames of packets that get none will not be asked for.
    assert worker.first_wanted == [i if i in asked else i + 1 for i in range(32)]
    assert residual.missed == 15
    # What came too late was not paid for.
    was_sent = [task.was_sent for task in worker.tasks]
    assert was_sent == [True] + [False] * 4 + [True] * 16


def test_what_comes_while_the_worker_is_busy_is_no_reason_to_wait() -> None:
    worker = SlowWorker()
    residual = LiveResidual(worker, lambda _: None)
    picture = np.zeros((48, 64, 3), np.uint8)

    def begin(number: int) -> "Future[bytes] | None":
        residual.add_source(number, picture)
        covered = range(number, number + 1)
        return residual.begin_packet(number, b"face", covered, 0.3, has_time=True)

    first = begin(0)
    assert first is not None
    residual.payload(first, b"face")
    assert all(begin(number) is None for number in range(1, 10))
    first.set_result(b"late")
    assert begin(10) is not None


def test_a_frame_without_a_source_differs_as_the_nearest_does() -> None:
    grey = np.full((8, 8, 3), 100, np.uint8)
    drawn = [DrawnPicture(i, grey + i, np.zeros((8, 8), np.float32)) for i in range(4, 10)]
    sources = {5: np.full_like(grey, 120), 8: np.full_like(grey, 90)}
    found = differences_of(drawn, sources)
    assert [np.unique(each).tolist() for each in found] == [[15], [15], [15], [-18], [-18], [-18]]


def test_pictures_that_no_packet_has_are_not_waited_for(call: Path) -> None:
    model, faces = faces_of(call)
    answers = dict[int, bool]()

    def draw(stream: BinaryIO, wants: Callable[[int], bool]) -> Generator[DrawnPicture, None, None]:
        def noted(index: int) -> bool:
            answers[index] = wants(index)
            return answers[index]

        return draw_call(stream, noted)

    drawing = DrawingThread(draw)
    drawing.see(serialise(model))
    drawing.see(serialise(FramePacket(0, join_payload(b"", faces[0]))), 0)
    with pytest.raises(UserError, match="as far as it is known"):
        drawing.pictures(range(2))
    unwanted, covered = (covered_frames(model.call, number, 8) for number in (1, 2))
    for number, first_wanted in ((1, unwanted.stop), (2, covered.start)):
        packet = FramePacket(number, join_payload(b"", faces[number]))
        drawing.see(serialise(packet), first_wanted)
    assert [each.index for each in drawing.pictures(covered)] == list(covered)
    assert not any(answers[index] for index in unwanted)
    drawing.close()


def test_packets_are_read_before_a_picture_is_asked_for() -> None:
    """Also after frames that nobody asks for: a late worker is to find its models decoded."""
    model_is_read = Event()

    def draw(stream: BinaryIO, wants: Callable[[int], bool]) -> Generator[DrawnPicture, None, None]:
        stream.read(len(MAGIC))
        records = RecordReader(stream, len(MAGIC))
        records.read()
        assert not wants(0)
        records.read()
        model_is_read.set()
        # Of this frame nothing is known: the end is told as well.
        assert not wants(1)
        yield from ()

    drawing = DrawingThread(draw)
    drawing.see(serialise(FramePacket(0, b"face")), 1)
    drawing.see(serialise(ControlPacket(0, ControlKind.FACE_LOST, 1)))
    assert model_is_read.wait(60)
    drawing.close()


def test_a_call_that_cannot_be_drawn_says_so_each_time() -> None:
    drawing = DrawingThread(nothing_drawn)
    drawing.see(b"no packet")
    for _ in range(2):
        with pytest.raises(UserError, match="no EGL here"):
            drawing.pictures(range(1))
    drawing.close()


def nothing_drawn(
    stream: BinaryIO, wants: Callable[[int], bool]
) -> Generator[DrawnPicture, None, None]:
    yield from ()
    raise UserError("no EGL here")
