"""Images of model packets decode, or raise a `ProtocolError`."""

from contextlib import suppress

import cv2
import numpy as np
import pytest

from decoder.scene.appearance import MAX_CODED_SIDE_PX, decode_image
from encoder.picture_coding.picture_encoder import encode_picture
from protocol.entropy.varint import encode_varint
from protocol.errors import ProtocolError


def webp(width: int, height: int, quality: int = 90) -> bytes:
    ramp = np.broadcast_to(np.linspace(0, 255, width)[None, :, None], (height, width, 3))
    params = [cv2.IMWRITE_WEBP_QUALITY, quality]
    return cv2.imencode(".webp", ramp.astype(np.uint8), params)[1].tobytes()


@pytest.mark.parametrize("quality", [50, 101])
def test_lossy_and_lossless_pictures_keep_their_size(quality: int) -> None:
    picture = decode_image("texture", webp(61, 47, quality))
    assert picture.shape == (47, 61, 3) and picture.dtype == np.uint8
    assert picture[20, -1, 0] > 200 > 60 > picture[20, 0, 0]


@pytest.mark.parametrize("data", [b"", b"RIFF", b"\x89PNG" + bytes(40), b"RIFF" + bytes(60)])
def test_other_data_than_webp_is_a_protocol_error(data: bytes) -> None:
    with pytest.raises(ProtocolError, match="texture is no WebP"):
        decode_image("texture", data)


def test_size_is_bounded_before_anything_is_allocated() -> None:
    data = bytearray(webp(16, 16, 101))
    data[21:25] = (0x3FFF | 0x3FFF << 14).to_bytes(4, "little")
    with pytest.raises(ProtocolError, match="16384x16384"):
        decode_image("texture", bytes(data))


def test_a_wavelet_picture_keeps_its_size_and_colours() -> None:
    ramp = np.broadcast_to(np.linspace(-9, 270, 61)[None, :, None], (47, 61, 3))
    picture = decode_image("still", encode_picture(ramp.astype(np.float32), 16).serialise())
    assert picture.shape == (47, 61, 3) and picture.dtype == np.uint8
    # Beyond black and white colours stop, they do not wrap around.
    assert picture[20, -1].min() == 255 and picture[20, 0].max() == 0
    assert np.abs(picture[:, 5:-5] - ramp[:, 5:-5]).max() < 8


@pytest.mark.parametrize("size", [(MAX_CODED_SIDE_PX + 1, 8), (8, 1 << 28)])
def test_the_size_of_a_wavelet_picture_is_bounded(size: tuple[int, int]) -> None:
    data = b"S" + b"".join(encode_varint(side) for side in size) + bytes(21)
    with pytest.raises(ProtocolError, match=f"{size[0]}x{size[1]}, limit {MAX_CODED_SIDE_PX}"):
        decode_image("background", data)


def test_an_atlas_has_a_limit_of_its_own() -> None:
    data = encode_picture(np.zeros((40, 40, 3), np.float32), 16).serialise()
    with pytest.raises(ProtocolError, match="40x40, limit 32"):
        decode_image("texture", data, 32)


def test_every_truncation_decodes_or_is_a_protocol_error() -> None:
    data = webp(40, 30)
    for length in range(len(data)):
        with suppress(ProtocolError):
            assert decode_image("still", data[:length]).shape == (30, 40, 3)
