"""The residual keeps to the bits that faces leave, and is the finer the more there are."""

import numpy as np
import pytest

from encoder.residual.forward_transform import forward_transform
from encoder.residual.residual_encoder import (
    MOST_PRICE,
    ResidualEncoder,
    faces_bitrate,
    has_residual,
    price_around,
)
from protocol.picture_residual.inverse_transform import ResidualPictures
from protocol.picture_residual.residual_block import parse_tiles, tile_side
from protocol.pictures.picture_codec import to_luma

WIDTH, HEIGHT, FRAMES = 160, 128, 8
SECONDS = FRAMES / 25
AREA, NOWHERE = np.zeros((2, HEIGHT, WIDTH), np.float32)
AREA[30:100, 40:120] = 1
FACE, NO_FACE = [AREA] * FRAMES, [NOWHERE] * FRAMES


def differences(seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    coarse = rng.normal(0, 25, (HEIGHT // 16, WIDTH // 16, 3))
    grown = np.kron(coarse, np.ones((16, 16, 1)))
    return [(grown + rng.normal(0, 4, grown.shape)).astype(np.float32) for _ in range(FRAMES)]


def error(data: bytes, wanted: list[np.ndarray]) -> float:
    """Mean squared error of luma that is left."""
    drawn = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    if not data:
        return float(np.mean(to_luma(np.array(wanted)) ** 2))
    pictures = ResidualPictures.from_tiles(parse_tiles(data, WIDTH, HEIGHT, FRAMES))
    left = [
        pictures.add_to(drawn, i, NOWHERE).astype(np.float32) - 128 - d
        for i, d in enumerate(wanted)
    ]
    return float(np.mean(to_luma(np.array(left)) ** 2))


@pytest.mark.parametrize("bitrate", [2000, 5000, 16000])
def test_a_call_keeps_to_its_rate(bitrate: int) -> None:
    encoder, faces_bits, spent = ResidualEncoder(bitrate, WIDTH, HEIGHT), 200, 0
    for number in range(12):
        data = encoder.encode(differences(number), FACE, SECONDS, faces_bits)
        spent += 8 * (len(data) + 1) + faces_bits
    assert 0.6 * bitrate < spent / (12 * SECONDS) <= 1.02 * bitrate


def test_more_bits_leave_less_error() -> None:
    errors = []
    for bitrate in (1500, 4000, 16000, 60000):
        encoder = ResidualEncoder(bitrate, WIDTH, HEIGHT)
        encoder.encode(differences(0), NO_FACE, SECONDS, 300)
        errors.append(error(encoder.encode(differences(1), NO_FACE, SECONDS, 300), differences(1)))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.5 * errors[0]


def test_the_face_is_finer_than_what_is_around_it() -> None:
    encoder = ResidualEncoder(30000, WIDTH, HEIGHT)
    encoder.encode(differences(0), FACE, SECONDS, 0)
    data = encoder.encode(differences(1), FACE, SECONDS, 0)
    flags = parse_tiles(data, WIDTH, HEIGHT, FRAMES).flags
    assert (flags[6:10, 7:13] == 2).all() and not (flags[:, -1] == 2).any()


def test_what_is_before_a_face_gets_the_bits_of_what_is_around_it() -> None:
    # The same around the face, ever more in it.
    rng, shares, prices = np.random.default_rng(2), list[float](), list[float]()
    around = rng.normal(0, 30, (HEIGHT // 16, WIDTH // 16, 1)) * np.ones((1, 1, 3))
    grown = np.kron(around, np.ones((16, 16, 1))) * (1 - AREA[..., None])
    hand = np.zeros_like(grown)
    hand[60:100, 60:100] = 1
    for level in (2, 12, 60):
        wanted = [(grown + level * hand).astype(np.float32)] * FRAMES
        values = forward_transform(wanted, tile_side(WIDTH, HEIGHT))
        is_fine = np.zeros(values.shape[:2], np.bool_)
        is_fine[6:10, 7:13] = True
        prices.append(price_around(values, is_fine))
        data = ResidualEncoder(6000, WIDTH, HEIGHT).encode(wanted, FACE, SECONDS, 0)
        flags = parse_tiles(data, WIDTH, HEIGHT, FRAMES).flags
        shares.append(float((flags == 2).sum() / (flags > 0).sum()))
    assert prices[0] == 1 and 1 < prices[1] < prices[2] == MOST_PRICE
    assert shares == sorted(shares) and shares[2] > shares[0] + 0.2


def test_without_bits_there_is_none() -> None:
    encoder = ResidualEncoder(800, WIDTH, HEIGHT)
    assert encoder.encode(differences(0), FACE, SECONDS, 800) == b""


def test_which_calls_have_one() -> None:
    assert not has_residual(800, (640, 480), 8) and has_residual(2000, (640, 480), 8)
    assert not has_residual(30000, (8192, 8192), 8)
    assert faces_bitrate(800) == 800 and 1200 < faces_bitrate(5000) < 5000
