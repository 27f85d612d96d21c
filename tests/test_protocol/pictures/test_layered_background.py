"""Layered backgrounds: what is parsed is what was serialised, and nothing damaged gets through."""

from dataclasses import replace

import numpy as np
import pytest

from encoder.picture_coding.picture_encoder import encode_mode
from protocol.entropy.varint import encode_varint
from protocol.errors import ProtocolError
from protocol.limits import MAX_IMAGE_BYTES
from protocol.pictures.foreground_mask import FINE_MASK_SIDE, MASK_SIDE, MAX_MASK_BYTES, encode_mask
from protocol.pictures.layered_background import (
    MAX_CHANGES,
    MAX_FIELD_BYTES,
    MAX_FIELD_CODE,
    MAX_FIELDS,
    TAG,
    LayeredBackground,
    background_pictures,
    change_codec,
    change_shape,
    decode_changes,
    decode_fields,
    encode_fields,
    field_shape,
    is_layered,
    parse_layers,
    serialise_layers,
)

SIZE = 64, 48


def background() -> LayeredBackground:
    y, x = np.mgrid[:MASK_SIDE, :MASK_SIDE] / MASK_SIDE - 0.5
    rows, columns = field_shape(*SIZE)
    down, across = np.mgrid[:rows, :columns]
    fields = np.stack([9 * down - 5 * across, down * across - 40], -1)
    return LayeredBackground(
        mask=x**2 / 0.04 + y**2 / 0.08 < 1,
        person=b"S person",
        scene=b"S scene",
        fields=np.stack([fields, -fields]),
        changes=(b"first", b"second change"),
    )


def damaged(*parts: bytes) -> bytes:
    """A layered background of these parts, each after its length."""
    return TAG + b"".join(encode_varint(len(part)) + part for part in parts)


def test_all_parts_arrive() -> None:
    sent = background()
    data = serialise_layers(sent)
    found = parse_layers(data, *SIZE)
    assert is_layered(data) and not is_layered(b"S picture")
    assert np.array_equal(found.mask, sent.mask) and np.array_equal(found.fields, sent.fields)
    assert (found.person, found.scene, found.changes) == (sent.person, sent.scene, sent.changes)
    assert found.coefficients == 4
    assert serialise_layers(found) == data
    assert background_pictures(data, *SIZE) == (sent.person, sent.scene)
    assert background_pictures(b"S picture", *SIZE) == (b"S picture",)


@pytest.mark.parametrize("side", [MASK_SIDE, FINE_MASK_SIDE])
@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("light", [False, True])
def test_a_scene_that_moves_light_and_a_fine_mask_arrive(
    side: int, moves: bool, light: bool
) -> None:
    mask = np.repeat(np.repeat(background().mask, side // MASK_SIDE, 0), side // MASK_SIDE, 1)
    sent = replace(background(), mask=mask, scene_moves=moves, light_changes=light)
    data = serialise_layers(sent)
    found = parse_layers(data, *SIZE)
    assert is_layered(data) and serialise_layers(found) == data
    assert np.array_equal(found.mask, mask)
    assert (found.scene_moves, found.light_changes) == (moves, light)
    assert found.coefficients == 4 + 4 * moves + 2 * light


@pytest.mark.parametrize("flags", [0, 8, 255])
def test_unknown_flags_are_refused(flags: int) -> None:
    data = serialise_layers(replace(background(), scene_moves=True))
    with pytest.raises(ProtocolError, match="flags"):
        parse_layers(data[:1] + bytes([flags]) + data[2:], *SIZE)
    with pytest.raises(ProtocolError, match="flags"):
        parse_layers(data[:1], *SIZE)


def test_there_need_be_neither_fields_nor_changes() -> None:
    sent = replace(background(), fields=background().fields[:0], changes=())
    found = parse_layers(serialise_layers(sent), *SIZE)
    assert found.coefficients == 0 and found.fields.shape == sent.fields.shape


@pytest.mark.parametrize("seed", range(3))
def test_any_codes_of_a_field_arrive(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fields = rng.integers(-MAX_FIELD_CODE, MAX_FIELD_CODE + 1, (2, 5, 4, 2))
    assert np.array_equal(decode_fields(encode_fields(fields), fields.shape), fields)


def test_codes_beyond_the_largest_are_refused() -> None:
    fields = np.zeros((1, 3, 3, 2), np.int64)
    fields[0, 1, 1, 0] = MAX_FIELD_CODE + 1
    with pytest.raises(ValueError, match="limit 127"):
        encode_fields(fields)
    far = np.zeros((1, 2, 2, 2), np.int64)
    far[0, 0, 0, 0] = far[0, 0, 1, 0] = far[0, 1, 0, 0] = MAX_FIELD_CODE
    coded = encode_fields(far)
    with pytest.raises(ProtocolError, match="motion fields"):
        decode_fields(coded + bytes(20), far.shape)


def test_a_bit_that_leads_beyond_the_largest_code_is_refused() -> None:
    data, refused = encode_fields(np.full((1, 4, 4, 2), MAX_FIELD_CODE)), 0
    for place in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        try:
            found = decode_fields(bytes(flipped), (1, 4, 4, 2))
        except ProtocolError:
            refused += 1
        else:
            assert np.abs(found).max() <= MAX_FIELD_CODE
    assert refused


@pytest.mark.parametrize(
    "data",
    [
        TAG,
        TAG + b"\x80",
        damaged(b"") + encode_varint(5) + b"abc",
        damaged(bytes(MAX_MASK_BYTES + 1)),
        damaged(b"", b"person", b""),
        damaged(b"", b"person", bytes([MAX_FIELDS + 1])),
        damaged(b"", b"person", bytes(MAX_FIELD_BYTES + 1)),
        damaged(b"", b"person", bytes([0])),
        damaged(b"", b"person", bytes([0])) + bytes([MAX_CHANGES + 1]),
        damaged(b"", b"person", bytes([0])) + bytes([1]) + encode_varint(MAX_IMAGE_BYTES + 1),
    ],
    ids=[
        "no parts",
        "half a length",
        "too short",
        "mask too long",
        "no number of fields",
        "too many fields",
        "fields too long",
        "no number of changes",
        "too many changes",
        "change too long",
    ],
)
def test_damaged_parts_are_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError, match="background"):
        parse_layers(data, *SIZE)


@pytest.mark.no_cover
def test_truncations_and_a_flipped_bit_of_each_byte_give_layers_or_are_refused() -> None:
    data = serialise_layers(background())
    flipped = [bytearray(data) for _ in data]
    for place, each in enumerate(flipped):
        each[place] ^= 1 << place % 7
    for bad in (*(data[:end] for end in range(1, len(data), 3)), *map(bytes, flipped[1:])):
        try:
            found = parse_layers(bad, *SIZE)
        except ProtocolError:
            continue
        assert found.fields.shape[1:] == (*field_shape(*SIZE), 2)


@pytest.mark.parametrize(
    ("size", "field", "change"),
    [
        ((640, 480), (10, 13), (72, 96)),
        ((1080, 1920), (13, 8), (96, 54)),
        ((8192, 1), (2, 13), (2, 96)),
    ],
)
def test_fields_and_changes_have_the_shape_of_the_picture(
    size: tuple[int, int], field: tuple[int, int], change: tuple[int, int]
) -> None:
    assert field_shape(*size) == field
    assert change_shape(*size) == change


def test_changes_are_coded_one_after_the_other() -> None:
    codec, rows = change_codec(*SIZE), change_shape(*SIZE)
    rng = np.random.default_rng(4)
    planes = np.zeros((2, *rows, 3), np.float32)
    planes[..., 0] = 30 * rng.normal(0, 1, (2, 1, 1)) + 4 * rng.normal(0, 1, (2, *rows))
    modes = [encode_mode(codec, each, 8) for each in planes]
    found = decode_changes(tuple(mode.serialise() for mode in modes), *SIZE)
    assert found.shape == (2, *rows, 3)
    for image, mode in zip(found, modes, strict=True):
        np.testing.assert_allclose(image, mode.decoded, atol=1e-4)
    assert np.abs(found.mean(-1) - planes[..., 0]).max() < 4
    assert decode_changes((), *SIZE).shape == (0, *rows, 3)
    with pytest.raises(ProtocolError):
        decode_changes((b"",), *SIZE)


def test_a_mask_alone_is_as_in_a_background_with_one_picture() -> None:
    mask = background().mask
    assert serialise_layers(background())[1:].startswith(
        encode_varint(len(encode_mask(mask))) + encode_mask(mask)
    )
