"""Compiles the encoder's loops at once, for an image or a machine that will encode."""

from concurrent.futures import ProcessPoolExecutor
from fractions import Fraction
from multiprocessing import get_context
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from encoder.capture.video_source import open_source
from encoder.coding.gop import gop_for_fps
from encoder.live_model.warm_up import BYTES, GREY, load_layer_loops, warm_up
from encoder.picture_coding.image_budget import encode_background_within
from encoder.residual.residual_encoder import ResidualEncoder
from protocol.pictures.foreground_mask import decode_mask
from protocol.pictures.picture_codec import decode_picture
from shared_model.arrays import Picture
from shared_model.surround import head_with_surround

# Height and width of the picture that loops are compiled with.
COMPILE_SIZE = (240, 320)
# The same of a picture residual, its frame rate and its bits a second.
RESIDUAL_SIZE, RESIDUAL_FPS, RESIDUAL_BPS = (16, 32), Fraction(30), 20000.0


def compile_loops() -> None:
    """Compile the loops of all profiles, or load them where that has been done.

    Those of pictures take half of the time: a process of their own compiles them meanwhile.
    """
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as other:
        written = other.submit(_write_picture)
        _compile_residual_loops()
        load_layer_loops()
        picture = written.result()
        read = other.submit(_read_pictures, picture)
        _warm_up()
        read.result()
    # Loads here what was compiled there.
    _read_pictures(picture)


def _write_picture() -> bytes:
    """A picture of a model: noise."""
    return encode_background_within(_noise(np.random.default_rng(0)), BYTES)


def _read_pictures(picture: bytes) -> None:
    decode_picture("noise", picture)
    decode_mask(b"")


def _warm_up() -> None:
    rng = np.random.default_rng(0)
    with TemporaryDirectory() as folder:
        # Lossless: the noise of each pixel stays.
        cv2.imwrite(f"{folder}/0.png", _noise(rng))
        with open_source(f"{folder}/%d.png") as capture:
            gop = gop_for_fps(capture.fps, None)
            warm_up(head_with_surround(), capture.format, gop)


def _compile_residual_loops() -> None:
    rng, (height, width) = np.random.default_rng(0), RESIDUAL_SIZE
    frames = gop_for_fps(RESIDUAL_FPS, None).frames_per_packet
    differences = list(rng.normal(0, 9, (frames, height, width, 3)).astype(np.float32))
    # Of both kinds of tiles: in a face, and around it.
    face = np.zeros(RESIDUAL_SIZE, np.float32)
    face[: height // 2] = 1
    faces = [face] * frames
    ResidualEncoder(RESIDUAL_BPS, width, height).encode(differences, faces, 1.0, 0.0)


def _noise(rng: np.random.Generator) -> Picture:
    return rng.integers(*GREY, (*COMPILE_SIZE, 3), np.uint8)
