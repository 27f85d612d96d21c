"""Call files: round trip, truncation, and that their parts add up."""

import io
import resource
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packets import CALL, MODEL

from protocol.call_file import MAGIC, CallReader, CallStreamWriter, CallWriter
from protocol.call_records import TruncatedCall, serialise_records
from protocol.entropy.varint import encode_varint
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import thesis_sample_count
from protocol.limits import MAX_MODEL_PACKET_BYTES
from protocol.link.interface import PacketSink, PacketSource, Reachability
from protocol.packets import ControlKind, ControlPacket, FramePacket, Packet, serialise
from protocol.summary import summarise
from shared_model.errors import UserError

END = ControlPacket(0, ControlKind.END, 100)


def thesis_call(frames: int) -> list[Packet]:
    """A whole call of the thesis profile."""
    count = thesis_sample_count(frames, CALL.fps_numerator, CALL.fps_denominator)
    samples = [FramePacket(k % 64, bytes([128] * 10)) for k in range(count)]
    return [MODEL, *samples, replace(END, frame=frames)]


def write(path: Path, packets: list[Packet]) -> list[bytes]:
    """Write a call file; returns the packets as bytes."""
    data = [serialise(packet) for packet in packets]
    with CallWriter(path) as writer:
        for packet in data:
            writer.send(packet)
    return data


def test_a_call_comes_back_whole(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    sent = write(path, thesis_call(30))
    with CallReader(path) as reader:
        assert not reader.ended
        assert list(reader) == sent
        assert reader.complete and reader.ended
        assert reader.receive(timeout_s=1) is None
    assert list(tmp_path.iterdir()) == [path]


@given(st.lists(st.binary(min_size=1, max_size=200).map(lambda data: b"\x3f" + data)))
def test_records_round_trip(packets: list[bytes]) -> None:
    file = io.BytesIO(MAGIC + serialise_records(packets))
    assert list(CallReader(file)) == packets


def test_files_carry_a_call_as_any_link_does(tmp_path: Path) -> None:
    sink: PacketSink = CallWriter(tmp_path / "call.rzo")
    with sink:
        sink.wait_for_peer(timeout_s=0)
        sink.send(serialise(MODEL))
        assert sink.reachability is Reachability.HAS_PEER and not sink.quality.loss
    source: PacketSource = CallReader(tmp_path / "call.rzo")
    with source:
        arrival = source.receive(timeout_s=0)
        assert arrival is not None and arrival.data == serialise(MODEL)
        assert source.receive(timeout_s=0) is None and source.ended


def test_a_call_without_an_end_is_read_and_reported(tmp_path: Path) -> None:
    sent = write(tmp_path / "call.rzo", thesis_call(30)[:-1])
    with CallReader(tmp_path / "call.rzo") as reader:
        assert list(reader) == sent
        assert reader.ended and not reader.complete


def test_every_truncation_yields_the_whole_packets_before_it(tmp_path: Path) -> None:
    sent = write(tmp_path / "call.rzo", thesis_call(12))
    data = (tmp_path / "call.rzo").read_bytes()
    boundaries = {len(MAGIC + serialise_records(sent[:n])): n for n in range(len(sent) + 1)}
    for length in range(len(MAGIC), len(data)):
        records = CallReader(io.BytesIO(data[:length]))
        if length in boundaries:
            assert list(records) == sent[: boundaries[length]]
            continue
        received = []
        with pytest.raises(TruncatedCall):
            for packet in records:
                received.append(packet)
        assert received == sent[: len(received)]


@pytest.mark.parametrize("data", [b"", b"RZO", b"RIFF....", b"RZO1"])
def test_another_kind_of_file_is_named(data: bytes) -> None:
    with pytest.raises(ProtocolError, match="no call file"):
        list(CallReader(io.BytesIO(data)))


@pytest.mark.parametrize(
    ("records", "message"),
    [
        (b"\x01", "record of 0 bytes"),
        (encode_varint(2 * MAX_MODEL_PACKET_BYTES + 3), "record of 262145 bytes"),
        (b"\xff\xff\xff\xff", "length of a record is too large"),
        (b"\x81\0x", "length of a record has a byte too many"),
        (serialise_records([bytes(9000)]), "frame packet of 8999 bytes"),
        (serialise_records([b"\x80" + bytes(300)]), "too long for its kind"),
    ],
)
def test_bad_records_are_named(records: bytes, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        list(CallReader(io.BytesIO(MAGIC + records)))


def test_what_comes_after_the_end_is_no_packet_and_is_counted(tmp_path: Path) -> None:
    sent = write(tmp_path / "call.rzo", thesis_call(30))
    with (tmp_path / "call.rzo").open("ab") as file:
        file.write(b"\xff\xff\xff\xff junk")
    with CallReader(tmp_path / "call.rzo") as reader:
        arrival = reader.receive()
        assert arrival is not None and arrival.data == sent[0] and reader.trailing_bytes == 0
        assert [*reader] == sent[1:]
        assert reader.complete and reader.ended and reader.trailing_bytes == 9
    summary = summarise(tmp_path / "call.rzo")
    assert summary.trailing_bytes == 9 and summary.frames == 30
    parts = summary.model_bytes + summary.frame_bytes + summary.control_bytes
    assert parts + summary.container_bytes == summary.file_bytes


def test_a_reader_has_ended_after_an_error(tmp_path: Path) -> None:
    (tmp_path / "call.rzo").write_bytes(MAGIC + b"\0")
    with CallReader(tmp_path / "call.rzo") as reader:
        with pytest.raises(ProtocolError):
            reader.receive()
        assert reader.ended and not reader.complete


def test_what_was_sent_before_an_interrupt_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    with pytest.raises(KeyboardInterrupt), CallWriter(path) as writer:
        writer.send(serialise(MODEL))
        raise KeyboardInterrupt
    with CallReader(path) as reader:
        assert list(reader) == [serialise(MODEL)]


def test_the_old_file_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    path.write_bytes(b"old")
    writer = CallWriter(path)
    writer.send(serialise(MODEL))
    assert path.read_bytes() == b"old"
    writer.close()
    writer.close()
    assert path.read_bytes() == MAGIC + serialise_records([serialise(MODEL)])


def test_an_error_leaves_an_older_call_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    path.write_bytes(b"older")
    with pytest.raises(RuntimeError), CallWriter(path) as writer:
        writer.send(b"packet")
        raise RuntimeError
    assert path.read_bytes() == b"older"
    assert path.with_name("call.rzo.part").exists()


def test_nothing_sent_leaves_nothing_behind(tmp_path: Path) -> None:
    with CallWriter(tmp_path / "call.rzo"):
        pass
    assert not list(tmp_path.iterdir())


def test_files_that_cannot_be_opened_are_the_users_mistake(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"cannot read .*no such file"):
        CallReader(tmp_path / "none.rzo")
    with pytest.raises(UserError, match=r"cannot write .*there is no folder"):
        CallWriter(tmp_path / "none" / "call.rzo")


def test_a_disk_that_refuses_leaves_the_old_call_as_it_is(tmp_path: Path) -> None:
    path, part = tmp_path / "call.rzo", tmp_path / "call.rzo.part"
    path.write_bytes(b"old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        with CallWriter(path) as writer:
            writer.send(serialise(MODEL))
            resource.setrlimit(resource.RLIMIT_FSIZE, (part.stat().st_size + 3, limits[1]))
            with pytest.raises(UserError, match=r"cannot write .*; what was sent before is in"):
                writer.send(serialise(MODEL))
            with pytest.raises(UserError, match="the disk refused before"):
                writer.send(serialise(MODEL))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_bytes() == b"old"
    whole = MAGIC + 2 * serialise_records([serialise(MODEL)])
    assert part.read_bytes() == whole[: len(MAGIC) + len(serialise_records([serialise(MODEL)])) + 3]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_is_said_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "call.rzo.part").symlink_to("/dev/full")
    with pytest.raises(UserError, match=r"cannot write .*No space left"):
        CallWriter(tmp_path / "call.rzo")


def test_a_disk_that_fills_up_is_said_in_one_line(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    writer = CallWriter(tmp_path / "call.rzo")
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(MAGIC), hard))
    try:
        with pytest.raises(UserError, match=r"cannot write .*File too large"):
            writer.send(serialise(MODEL))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        writer.close()


@pytest.mark.parametrize("frames", [1, 3, 30, 100, 382])
def test_the_parts_add_up_and_the_thesis_profile_has_800_bps(tmp_path: Path, frames: int) -> None:
    path = tmp_path / "call.rzo"
    sent = write(path, thesis_call(frames))
    summary = summarise(path)
    parts = summary.model_bytes + summary.frame_bytes + summary.control_bytes
    model_record, frame_record, end_record = 2 + 1 + 4, 2, 3
    expected = 4 + model_record + frame_record * (len(sent) - 2) + end_record
    assert summary.container_bytes == expected
    assert parts + summary.container_bytes == summary.file_bytes == path.stat().st_size
    rates = summary.frame_bps, summary.packet_bps, summary.record_bps
    assert rates == pytest.approx((800, 880, 960))
    assert summary.frames == frames and summary.complete and summary.profile == "thesis"
    assert summary.duration_s == pytest.approx(frames * 1001 / 30000)
    assert (summary.width, summary.height) == (640, 480)
    assert summary.fps == pytest.approx(29.97, abs=0.001)
    assert summary.frame_packets == len(sent) - 2
    assert summary.model_bytes == len(serialise(MODEL)) - 1


def test_a_torn_call_is_summarised_up_to_the_tear(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    write(path, thesis_call(100))
    path.write_bytes(path.read_bytes()[:-9])
    summary = summarise(path)
    assert not summary.complete
    assert summary.frame_packets == 33 and summary.frames == 99
    parts = summary.model_bytes + summary.frame_bytes + summary.control_bytes
    assert parts + summary.container_bytes == summary.file_bytes
    assert summarise(path, shown_frames=97).frames == 97


@pytest.mark.parametrize(("step", "packed"), [(1, 6), (2, 3)])
def test_the_default_profile_counts_frames_by_packets(
    step: int, packed: int, tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    call = replace(CALL, profile="default", frames_per_packet=packed, frame_step=step)
    lost = ControlPacket(0, ControlKind.FACE_LOST, 3)
    models = [replace(MODEL, call=call, version=n, version_count=2) for n in range(2)]
    write(path, [*models, lost, *[FramePacket(n, bytes(5)) for n in range(4)]])
    summary = summarise(path)
    assert summary.frames == 24 and summary.frame_bytes == 20 and summary.control_bytes == 2
    assert summary.frame_bps == pytest.approx(20 * 8 * 29.97 / 24, rel=1e-4)


def test_what_is_damaged_is_counted_and_the_rest_accounted_for(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    sent = [serialise(packet) for packet in thesis_call(100)]
    sent.insert(5, serialise(MODEL)[:1] + b"\xff" * 9)
    path.write_bytes(MAGIC + serialise_records(sent))
    summary = summarise(path)
    assert summary.damaged_packets == 1 and summary.complete and summary.frames == 100
    parts = summary.model_bytes + summary.frame_bytes + summary.control_bytes
    assert parts + summary.container_bytes == summary.file_bytes


@pytest.mark.parametrize("is_frame_missing", [False, True])
def test_behind_a_damaged_length_the_next_records_are_found(
    tmp_path: Path, is_frame_missing: bool
) -> None:
    path = tmp_path / "call.rzo"
    sent = write(path, thesis_call(100))
    data = bytearray(path.read_bytes())
    begin = len(MAGIC + serialise_records(sent[:10]))
    if is_frame_missing:
        del data[begin : begin + 5]
    else:
        data[begin] = 0xFF
    path.write_bytes(data)
    summary = summarise(path)
    assert summary.damaged_packets == 1 and summary.complete
    assert summary.frame_packets == len(sent) - 2 - 1
    parts = summary.model_bytes + summary.frame_bytes + summary.control_bytes
    assert parts + summary.container_bytes == summary.file_bytes


def test_every_changed_byte_is_noticed_and_all_else_is_read(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    sent = write(path, thesis_call(40))
    data = path.read_bytes()
    random = Random(1)
    for _ in range(1000):
        place, change = random.randrange(len(MAGIC), len(data)), random.randrange(1, 256)
        changed = bytearray(data)
        changed[place] ^= change
        damages = list[ProtocolError]()
        received = list(CallReader(io.BytesIO(changed)).undamaged(damages.append))
        assert damages, f"byte {place} ^ {change:#x} passes"
        assert len(received) >= len(sent) - 2 and set(received) < set(sent)


def test_any_bytes_give_packets_or_protocol_errors() -> None:
    random = Random(2)
    sent = serialise_records(serialise(packet) for packet in thesis_call(40))
    for _ in range(300):
        data = bytearray(sent)
        for _ in range(random.randrange(1, 40)):
            data[random.randrange(len(data))] = random.randrange(256)
        reader = CallReader(io.BytesIO(MAGIC + data))
        assert list(reader.undamaged(lambda damage: None)) is not None and reader.ended


def test_a_damaged_model_is_said_to_be_damaged(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    damaged = bytearray(serialise(MODEL))
    damaged[1] = 0xFF
    path.write_bytes(
        MAGIC + serialise_records([bytes(damaged), serialise(FramePacket(0, bytes(10)))])
    )
    with pytest.raises(ProtocolError) as raised:
        summarise(path)
    assert "no model packet" not in str(raised.value)


def test_a_call_without_a_model_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "call.rzo", [FramePacket(0, bytes(10))])
    with pytest.raises(ProtocolError, match="no model packet"):
        summarise(tmp_path / "call.rzo")


def test_a_call_cut_off_in_its_model_is_said_to_be(tmp_path: Path) -> None:
    write(tmp_path / "call.rzo", thesis_call(30))
    (tmp_path / "call.rzo").write_bytes((tmp_path / "call.rzo").read_bytes()[:60])
    with pytest.raises(TruncatedCall, match="call is cut off: byte 4: record has 54 bytes of 155"):
        summarise(tmp_path / "call.rzo")


def test_a_stream_holds_the_bytes_of_a_file_and_stays_open(tmp_path: Path) -> None:
    stream, path = io.BytesIO(), tmp_path / "call.rzo"
    packets = write(path, thesis_call(9))
    with CallStreamWriter(stream) as sink:
        for packet in packets:
            sink.send(packet)
        assert sink.reachability is Reachability.HAS_PEER and sink.quality.loss == 0
    assert stream.getvalue() == path.read_bytes()
    stream.seek(0)
    with CallReader(stream) as reader:
        assert list(reader) == packets
        assert reader.complete and reader.trailing_bytes == 0
    assert not stream.closed
