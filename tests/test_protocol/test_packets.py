"""The packets: golden bytes, round trips, and only `ProtocolError` of bad bytes."""

import random
from dataclasses import replace

import msgpack  # type: ignore[import-untyped]
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packets import CALL, GOLDEN, MODEL, VECTORS

from protocol.call_parameters import COLOUR_MATRICES, PROFILES, CallParameters
from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.limits import (
    MAX_FRAME_PAYLOAD_BYTES,
    MAX_IMAGE_BYTES,
    MAX_LAYER_BYTES,
    MAX_MODEL_PACKET_BYTES,
)
from protocol.model_packet import (
    DEFAULT_FORMAT,
    EXTENSIBLE_FORMAT,
    EYELIDS_FORMAT,
    PROGRESSIVE_FORMAT,
    THESIS_FORMAT,
    ModelPacket,
)
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    Packet,
    PacketKind,
    is_end,
    packet_kind,
    parse_packet,
    serialise,
)
from shared_model.geometry import FRONTAL
from shared_model.parameters import AAUS, EAUS


def parses_or_protocol_error(data: bytes) -> None:
    """Fails by any other exception, and if what was parsed has another encoding."""
    try:
        packet = parse_packet(data)
    except ProtocolError:
        return
    assert serialise(packet) == data


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_bytes_have_not_changed(name: str) -> None:
    data = bytes.fromhex((VECTORS / f"{name}.hex").read_text())
    assert serialise(GOLDEN[name]) == data
    assert parse_packet(data) == GOLDEN[name]


@pytest.mark.parametrize("packet", GOLDEN.values(), ids=GOLDEN)
def test_every_truncation_is_a_packet_or_a_protocol_error(packet: Packet) -> None:
    data = serialise(packet)
    for length in range(len(data)):
        parses_or_protocol_error(data[:length])


@pytest.mark.no_cover
@pytest.mark.parametrize("packet", GOLDEN.values(), ids=GOLDEN)
def test_every_bit_flip_is_a_packet_or_a_protocol_error(packet: Packet) -> None:
    data = serialise(packet)
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        parses_or_protocol_error(bytes(flipped))


@pytest.mark.parametrize("packet", GOLDEN.values(), ids=GOLDEN)
def test_an_added_byte_never_goes_unnoticed(packet: Packet) -> None:
    data = serialise(packet) + b"\0"
    if packet_kind(data) in (PacketKind.FRAME, PacketKind.LAYER):
        assert parse_packet(data) != packet
    else:
        with pytest.raises(ProtocolError):
            parse_packet(data)


@pytest.mark.no_cover
def test_fuzz_of_random_and_mutated_packets() -> None:
    seed = 20061
    print(f"seed {seed}")
    rng = random.Random(seed)
    bases = [serialise(packet) for packet in GOLDEN.values()]
    for _ in range(60_000):
        data = bytearray(rng.choice(bases))
        for _ in range(rng.randint(1, 4)):
            place = rng.randrange(len(data))
            data[place : place + rng.randint(0, 2)] = rng.randbytes(rng.randint(0, 2))
            data = data or bytearray(b"\x40")
        parses_or_protocol_error(bytes(data))
    for _ in range(50_000):
        parses_or_protocol_error(rng.randbytes(rng.randint(0, 40)))


def model_of_fields(changes: dict[str, object], model: Packet = MODEL) -> bytes:
    """A model packet with fields of the map replaced or added."""
    data = serialise(model)
    fields = msgpack.unpackb(data[2:], use_list=False) | changes
    packed: bytes = msgpack.packb(fields, use_single_float=True)
    return data[:2] + packed


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"p": 4}, "profile"),
        ({"p": "thesis"}, "limit|exceeds|profile"),
        ({"s": (0, 480)}, "width"),
        ({"s": (640, 8193)}, "height"),
        ({"s": 640}, "size"),
        ({"s": (640, 480, 3)}, "size"),
        ({"r": (30, 0)}, "fps denominator"),
        ({"r": (1_000_000, 1)}, "fps"),
        ({"r": (1, 1_000_000)}, "fps"),
        ({"f": 0.5}, "focal"),
        ({"f": float("nan")}, "focal"),
        ({"f": "x"}, "focal"),
        ({"f": 600}, "one encoding"),
        ({"n": 0}, "frames per packet"),
        ({"n": True}, "frames per packet"),
        ({"o": -1}, "start frame"),
        ({"l": (1, 1)}, "model version"),
        ({"l": (0, 65)}, "number of model versions"),
        ({"a": bytes(10)}, "aau"),
        ({"a": (0,) * 4}, "aau"),
        ({"d": bytes(4)}, "three per point"),
        ({"d": bytes(3 * 257)}, "residual"),
        ({"q": (1.0, 1.0, 0.0, 0.0)}, "length"),
        ({"q": (5.0, 0.0, 0.0, 0.0)}, "magnitudes"),
        ({"q": (1.0, 0.0, 0.0)}, "4 floats"),
        ({"t": (0.0, 0.0, -1.0)}, "depth"),
        ({"t": (0.0, 0.0, float("inf"))}, "finite"),
        ({"e": b"\x80" + bytes(13)}, "reference eau"),
        ({"b": None}, "background"),
        ({"b": bytes(MAX_IMAGE_BYTES + 1)}, "exceeds"),
        ({"x": 5}, "texture"),
        ({"m": "x"}, "profile data"),
        ({"z": 1}, "."),
    ],
)
def test_model_fields_out_of_bounds_are_named(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        parse_packet(model_of_fields(changes))


@pytest.mark.parametrize(
    ("step", "message"),
    [(0, "frame step"), (256, "frame step"), (True, "frame step"), (1, "one encoding")],
)
def test_a_step_out_of_bounds_is_named(step: int, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        parse_packet(model_of_fields({"k": step}, GOLDEN["model_step"]))


def test_progressive_is_a_boolean() -> None:
    with pytest.raises(ProtocolError, match="progressive"):
        parse_packet(model_of_fields({"y": 1}, GOLDEN["model_step"]))
    # What the older version can say is said in it.
    with pytest.raises(ProtocolError, match="one encoding"):
        parse_packet(model_of_fields({"y": False}, GOLDEN["model_progressive"]))


def test_extensible_is_a_boolean() -> None:
    with pytest.raises(ProtocolError, match="extensible"):
        parse_packet(model_of_fields({"g": 1}, GOLDEN["model_extensible"]))
    with pytest.raises(ProtocolError, match="one encoding"):
        parse_packet(model_of_fields({"g": False}, GOLDEN["model_extensible"]))


def test_lids_are_yes_or_no_and_of_the_thesis_profile() -> None:
    with pytest.raises(ProtocolError, match="eyelids"):
        parse_packet(model_of_fields({"i": 1}, GOLDEN["model_eyelids"]))
    with pytest.raises(ProtocolError, match="one encoding"):
        parse_packet(model_of_fields({"i": False}, GOLDEN["model_eyelids"]))
    with pytest.raises(ProtocolError, match="lids are an option of the thesis profile"):
        parse_packet(model_of_fields({"p": 1}, GOLDEN["model_eyelids"]))


def test_a_program_that_knows_no_lids_refuses_their_model_by_its_version() -> None:
    assert serialise(MODEL)[1] == THESIS_FORMAT
    assert serialise(GOLDEN["model_eyelids"])[1] == EYELIDS_FORMAT


def test_the_default_profile_of_an_older_program_is_refused_by_its_version() -> None:
    assert MODEL.call.profile == "thesis"
    default = replace(MODEL, call=replace(MODEL.call, profile="default"))
    assert parse_packet(serialise(default)) == default
    with pytest.raises(ProtocolError, match="version is 15, of the default profile"):
        parse_packet(model_of_fields({"p": 1}))


def test_a_program_that_knows_no_matrix_refuses_all_but_bt601_by_its_profile() -> None:
    for profile in PROFILES:
        call = replace(CALL, profile=profile)
        assert profile_field(call) < len(PROFILES)
        assert profile_field(replace(call, colour_matrix="bt709")) >= len(PROFILES)


def profile_field(call: CallParameters) -> int:
    fields = msgpack.unpackb(serialise(replace(MODEL, call=call))[2:], use_list=False)
    return int(fields["p"])


def test_a_version_has_its_own_fields_only() -> None:
    for model, version in (
        (MODEL, PROGRESSIVE_FORMAT),
        (MODEL, EXTENSIBLE_FORMAT),
        (GOLDEN["model_step"], DEFAULT_FORMAT),
        (GOLDEN["model_step"], EXTENSIBLE_FORMAT),
        (GOLDEN["model_extensible"], PROGRESSIVE_FORMAT),
        (MODEL, EYELIDS_FORMAT),
        (GOLDEN["model_eyelids"], EXTENSIBLE_FORMAT),
    ):
        data = bytearray(serialise(model))
        data[1] = version
        with pytest.raises(ProtocolError, match=r"no map|exceeds"):
            parse_packet(bytes(data))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "empty"),
        (b"\xc0", "bad number"),
        (b"\xc0\x05", "layer is empty"),
        (b"\xc0\x80\x20x", "number of a layer packet"),
        (b"\xc0\x00" + bytes(MAX_LAYER_BYTES + 1), "limit"),
        (bytes([0xC0]) + bytes(MAX_LAYER_BYTES + 6), "too long"),
        (bytes(2 + MAX_FRAME_PAYLOAD_BYTES), "too long"),
        (b"\x40", "version is missing"),
        (b"\x40\x63", "version is 99"),
        (b"\x40\x0f\x90", "no map"),
        (b"\x40\x0f\x80", "no map"),
        (b"\x40" + bytes(MAX_MODEL_PACKET_BYTES), "too long"),
        (b"\x80", "kind of control missing"),
        (b"\x80\x09\x00", "9 is not a valid"),
        (b"\x80\x00", "bad number"),
        (b"\x80\x00\x80\x00", "bad number"),
        (b"\x80\x00\xff\xff\xff\xff\xff", "bad number"),
        (b"\x80\x00\xff\xff\xff\xff\x7f", "bad number"),
        (b"\x80\x00\x05\x05", "too many"),
    ],
)
def test_bad_bytes_are_named(data: bytes, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        parse_packet(data)


def test_messages_stay_short_however_large_the_field() -> None:
    with pytest.raises(ProtocolError) as caught:
        parse_packet(model_of_fields({"p": bytes(100_000)}))
    assert len(str(caught.value)) <= 200


def test_misuse_is_a_value_error_that_names_the_field() -> None:
    with pytest.raises(ValueError, match="sequence is 64"):
        FramePacket(64, b"")
    with pytest.raises(ValueError, match="profile is 'x'"):
        replace(CALL, profile="x")
    with pytest.raises(ValueError, match="matrix is 'x'"):
        replace(CALL, colour_matrix="x")
    with pytest.raises(ValueError, match="bytearray, expected bytes"):
        FramePacket(0, bytearray(1))  # type: ignore[arg-type]


def test_a_model_whose_parts_are_allowed_but_not_their_sum_is_refused() -> None:
    image = bytes(MAX_IMAGE_BYTES)
    with pytest.raises(ValueError, match="limit"):
        serialise(replace(MODEL, background=image, texture=image))


def test_the_packet_knows_camera_rate_and_pose() -> None:
    assert CALL.fps == pytest.approx(29.97, abs=0.001) and CALL.exact_fps * 1001 == 30000
    assert (CALL.camera.width, CALL.camera.height, CALL.camera.focal_px) == (640, 480, 612.5)
    pose = replace(MODEL, reference_rotation=(1e-4, 1.0, 0.0, 0.0)).reference_pose
    assert pose.rotation == pytest.approx(FRONTAL, abs=2e-4)
    assert pose.translation_mm.tolist() == [10.5, -20.25, 600.0]


def test_only_an_end_packet_is_an_end() -> None:
    assert is_end(serialise(ControlPacket(63, ControlKind.END, 1)))
    assert not is_end(serialise(ControlPacket(0, ControlKind.FACE_LOST, 1)))
    assert not is_end(serialise(FramePacket(0, b"\0\0")))
    assert not is_end(b"\x80")


codes = st.integers(-127, 127)
floats = st.floats(-1000, 1000)
images = st.binary(max_size=40)


@given(
    st.builds(
        ModelPacket,
        call=st.builds(
            CallParameters,
            st.sampled_from(["thesis", "default"]),
            st.integers(1, 8192),
            st.integers(1, 8192),
            st.integers(1, 1000),
            st.integers(1, 1000).filter(bool),
            st.floats(1, 1e5),
            st.integers(1, 64),
            st.integers(0, 2**32 - 1),
            st.integers(1, 255),
            colour_matrix=st.sampled_from(COLOUR_MATRICES),
        )
        | st.builds(replace, st.just(CALL), has_eyelids=st.booleans()),
        aau=st.tuples(*[codes] * len(AAUS)),
        reference_rotation=st.just((0.6, 0.0, 0.8, 0.0)),
        reference_translation_mm=st.tuples(floats, floats, st.floats(1, 1e5)),
        reference_eau=st.tuples(*[codes] * len(EAUS)),
        background=images,
        texture=images,
        residual=st.lists(st.tuples(codes, codes, codes), max_size=5).map(
            lambda points: tuple(code for point in points for code in point)
        ),
        profile_data=images,
        version_count=st.just(64),
        version=st.integers(0, 63),
        sequence=st.integers(0, 63),
        progressive=st.booleans(),
        extensible=st.booleans(),
    )
    | st.builds(FramePacket, st.integers(0, 63), st.binary(max_size=64))
    | st.builds(
        LayerPacket, st.integers(0, 63), st.integers(0, 4095), st.binary(min_size=1, max_size=64)
    )
    | st.builds(
        ControlPacket,
        st.integers(0, 63),
        st.sampled_from([kind for kind in ControlKind if kind is not ControlKind.TIMES]),
        st.integers(0, 2**32 - 1),
    )
)
def test_every_packet_survives_the_wire(packet: Packet) -> None:
    assert parse_packet(serialise(packet)) == packet


@given(st.integers(0, 2**32 - 1), st.binary(max_size=3))
def test_varint_round_trip(value: int, rest: bytes) -> None:
    data = encode_varint(value)
    assert decode_varint(data + rest) == (value, len(data))
