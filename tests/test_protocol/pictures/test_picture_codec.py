"""The picture codec: colours, sizes, sequences of modes, damaged bytes."""

import numpy as np
import pytest

from encoder.picture_coding.picture_encoder import encode_mode, encode_picture, retained_energy
from protocol.errors import ProtocolError
from protocol.pictures.picture_codec import (
    MAX_STEP_CODE,
    ModeCodec,
    decode_picture,
    from_planes,
    parse_picture_header,
    step_size,
    to_luma,
    to_planes,
)
from protocol.pictures.probability_model import BACKGROUND, TEXTURE
from protocol.pictures.weight_map import (
    GRID_SIDE,
    RANGE_OCTAVES,
    STEP_OCTAVES,
    decode_weight_map,
    encode_weight_map,
)
from shared_model.arrays import Array, Single


def painting(height: int, width: int) -> Single:
    """(h, w, 3) BGR of a smooth gradient with a red square."""
    y, x = np.mgrid[:height, :width]
    picture = np.stack([60 + x, 90 + y, 120 + 0.5 * (x + y)], -1)
    picture[height // 4 : height // 2, width // 4 : width // 2] = (40, 50, 200)
    return np.asarray(np.clip(picture, 0, 255), np.float32)


def encode_intra(
    colours: Single, step: int, weight_map: bytes = b"", kind: int = BACKGROUND
) -> tuple[bytes, Single]:
    """The bytes of a picture (h, w, 3), and what they decode to."""
    draft = encode_picture(colours, step, weight_map, kind)
    return draft.serialise(), draft.decoded


def coded(codec: ModeCodec, mode: Single, step: int) -> tuple[bytes, Single]:
    """A mode as the next of a codec: its bytes, and what they decode to."""
    draft = encode_mode(codec, mode, step)
    data = draft.serialise()
    assert len(data) <= draft.size_bytes <= len(data) + 3
    return data, draft.decoded


def error(one: Single, other: Single) -> float:
    return float(np.square(to_luma(one) - to_luma(other)).mean())


@pytest.mark.parametrize("chroma", [0.3, 0.5, 1.0])
def test_planes_and_colours_are_each_others_inverse(chroma: float) -> None:
    colours = np.random.default_rng(1).uniform(0, 255, (9, 7, 3)).astype(np.float32)
    assert np.allclose(from_planes(to_planes(colours, chroma), chroma), colours, atol=1e-2)
    grey = np.full((2, 2, 3), 77.0, np.float32)
    assert np.allclose(to_planes(grey), [77, 0, 0], atol=1e-4) and np.allclose(to_luma(grey), 77)


def test_steps_double_every_octave() -> None:
    assert step_size(0) == 1 and step_size(16) == pytest.approx(2 * step_size(8))


@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 5), (33, 64), (97, 41), (160, 200)])
def test_a_picture_decodes_to_what_its_encoder_says(height: int, width: int) -> None:
    picture = painting(height, width)
    data, stated = encode_intra(picture, 8)
    head = parse_picture_header("still", data)
    assert (head.width, head.height, head.weight_map) == (width, height, b"")
    decoded = decode_picture("still", data)
    assert np.array_equal(decoded, stated) and decoded.shape == picture.shape
    assert error(decoded, picture) < 4


@pytest.mark.parametrize("kind", [BACKGROUND, TEXTURE])
def test_textures_and_backgrounds_have_different_kinds(kind: int) -> None:
    data, stated = encode_intra(painting(64, 64), 16, kind=kind)
    assert parse_picture_header("still", data).kind == kind
    assert np.array_equal(decode_picture("still", data), stated)


def test_coarser_pictures_are_smaller_and_worse() -> None:
    picture = painting(96, 96)
    found = [encode_intra(picture, step) for step in (0, 16, 32, 48, MAX_STEP_CODE)]
    sizes = [len(data) for data, _ in found]
    errors = [error(decoded, picture) for _, decoded in found]
    assert sizes == sorted(sizes, reverse=True) and errors == sorted(errors)


def test_modes_decode_in_their_order() -> None:
    rng = np.random.default_rng(4)
    sender, receiver = ModeCodec(48), ModeCodec(48)
    for number in range(4):
        mode = np.zeros((48, 48, 3), np.float32)
        mode[10:20, 5:40] = rng.normal(size=(10, 35, 3)) * 30
        data, stated = coded(sender, mode, 24)
        assert np.array_equal(receiver.decode(f"mode {number}", data), stated)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "no picture"),
        (b"RIFF", "no picture"),
        (b"S", "still: "),
        (b"S\x08", "still: "),
        (b"S\x00\x08\x10", "0x8"),
        (b"S\x08\x00\x10", "8x0"),
        (b"S\x08\x08", "ends in its head"),
        (b"S\x08\x08\x02\x10", "ends in its head"),
        (b"S\x08\x08\x00", "no step"),
        (b"S\x08\x08\x00\x51", "no step"),
        (b"S\x08\x08\x00\x10" + bytes(40), "too many"),
        (b"S\x08\x08\xc8" + bytes(300), "weight map"),
    ],
)
def test_a_damaged_picture_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        decode_picture("still", data)


def test_a_harsh_picture_at_the_finest_step_is_coded() -> None:
    rng = np.random.default_rng(6)
    squares = rng.integers(0, 2, (4, 4, 3)) * 255.0
    picture = np.kron(squares, np.ones((32, 32, 1))).astype(np.float32)
    data, stated = encode_intra(picture, 0)
    assert np.array_equal(decode_picture("still", data), stated)
    assert error(stated, picture) < 2


def test_a_mode_is_cheaper_after_others_with_energy_in_the_same_positions() -> None:
    rng = np.random.default_rng(8)
    codec, sizes, alone = ModeCodec(64), [], []
    for _ in range(3):
        mode = np.zeros((64, 64, 3), np.float32)
        mode[20:34, 8:56] = rng.normal(size=(14, 48, 3)) * 30
        sizes.append(len(coded(codec, mode, 28)[0]))
        alone.append(len(coded(ModeCodec(64), mode, 28)[0]))
    assert sizes[0] == alone[0] and sizes[2] < 0.95 * alone[2]


def test_a_mode_of_another_sequence_is_a_mode_or_a_protocol_error() -> None:
    rng = np.random.default_rng(9)
    modes = [rng.normal(size=(24, 24, 3)).astype(np.float32) * 30 for _ in range(4)]
    codec = ModeCodec(24)
    packets = [coded(codec, mode, 20)[0] for mode in modes]
    out_of_order = ModeCodec(24)
    for data in reversed(packets):
        try:
            decoded = out_of_order.decode("mode", data)
        except ProtocolError:
            continue
        assert decoded.shape == (24, 24, 3) and np.isfinite(decoded).all()


def test_a_damaged_mode_is_refused() -> None:
    with pytest.raises(ProtocolError, match="no step"):
        ModeCodec(16).decode("mode 0", b"")


@pytest.mark.no_cover
def test_every_truncation_and_bit_flip_is_a_picture_or_an_error() -> None:
    data, _ = encode_intra(painting(12, 14), 32, encode_weight_map(hill()))
    for place in range(len(data)):
        for damaged in (data[:place], *(flip(data, place, bit) for bit in range(8))):
            try:
                head = parse_picture_header("still", damaged)
                if head.width * head.height > 10_000:
                    continue
                assert np.isfinite(decode_picture("still", damaged)).all()
            except ProtocolError:
                pass


def test_a_weight_map_makes_the_picture_finer_where_it_is_high() -> None:
    picture = np.random.default_rng(2).uniform(0, 255, (96, 96, 3)).astype(np.float32)
    weight_map = encode_weight_map(hill())
    data, stated = encode_intra(picture, 40, weight_map)
    assert parse_picture_header("still", data).weight_map == weight_map
    assert np.array_equal(decode_picture("still", data), stated)
    middle, rim = np.s_[40:56, 40:56], np.s_[:16, :16]
    assert error(stated[middle], picture[middle]) < 0.5 * error(stated[rim], picture[rim])


def test_modes_share_the_weight_map_of_their_texture() -> None:
    mode = np.random.default_rng(3).normal(size=(48, 48, 3)).astype(np.float32) * 40
    weight_map = encode_weight_map(hill())
    data, stated = coded(ModeCodec(48, weight_map), mode, 24)
    assert np.array_equal(ModeCodec(48, weight_map).decode("mode", data), stated)
    assert not np.allclose(ModeCodec(48).decode("mode", data), stated)


def hill() -> Array:
    """A weight map with its maximum in the middle."""
    y, x = np.mgrid[:GRID_SIDE, :GRID_SIDE] - (GRID_SIDE - 1) / 2
    return np.asarray(np.exp2(1.5 - (x**2 + y**2) / 20))


def flip(data: bytes, place: int, bit: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]


@pytest.mark.parametrize(
    ("data", "message"), [(b"\xff" * 200, "texture: weight map: .* too large"), (None, "too many")]
)
def test_a_damaged_weight_map_is_refused(data: bytes | None, message: str) -> None:
    damaged = encode_weight_map(hill()) + bytes(20) if data is None else data
    with pytest.raises(ProtocolError, match=message):
        decode_weight_map("texture", damaged, 16, 16)


def test_a_weight_map_survives_within_half_a_step() -> None:
    fineness = np.exp2(np.random.default_rng(5).uniform(*RANGE_OCTAVES, (GRID_SIDE, GRID_SIDE)))
    found = np.log2(decode_weight_map("texture", encode_weight_map(fineness), GRID_SIDE, GRID_SIDE))
    assert np.abs(found - np.log2(fineness)).max() <= STEP_OCTAVES / 2 + 1e-9


def test_what_share_of_a_mode_its_picture_would_hold_is_known_before() -> None:
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:64, :64] / 64
    smooth = 12 * np.sin(7 * x) * np.cos(5 * y) + rng.normal(0, 1.5, (64, 64))
    planes = np.stack([smooth, 0.3 * smooth, -0.2 * smooth], -1).astype(np.float32)
    codec, shares = ModeCodec(64), []
    for step in (8, 20, 32, 44, MAX_STEP_CODE):
        shares.append(retained_energy(codec, planes, step))
        found = to_planes(encode_mode(codec.copy(), planes, step).decoded)
        left = float(np.square(planes - found).sum() / np.square(planes).sum())
        # Coefficients that are too unlikely for their size are left out as well.
        assert 1 - left < shares[-1] + 0.05
    assert shares == sorted(shares, reverse=True) and shares[0] > 0.95 and shares[-1] < 0.05
