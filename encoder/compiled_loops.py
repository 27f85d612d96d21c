"""Compiles the encoder's loops at once, for an image or a machine that will encode."""

from tempfile import TemporaryDirectory

import cv2
import numpy as np

from encoder.capture.video_source import open_source
from encoder.coding.gop import gop_for_fps
from encoder.live_model.warm_up import BYTES, GREY, warm_up
from encoder.picture_coding.image_budget import encode_background_within
from encoder.residual.residual_encoder import ResidualEncoder
from encoder.thesis.outlier_rejection import robust_residuals
from protocol.pictures.foreground_mask import decode_mask
from protocol.pictures.picture_codec import decode_picture
from shared_model.surround import head_with_surround

# Height and width of the picture that loops are compiled with.
COMPILE_SIZE = (240, 320)
# The same of a picture residual, and its bits a second.
RESIDUAL_SIZE, RESIDUAL_BPS = (16, 32), 20000.0


def compile_loops() -> None:
    """Compile the loops of all profiles, or load them where that has been done."""
    rng = np.random.default_rng(0)
    with TemporaryDirectory() as folder:
        # Lossless: the noise of each pixel stays.
        noise = rng.integers(*GREY, (*COMPILE_SIZE, 3), np.uint8)
        cv2.imwrite(f"{folder}/0.png", noise)
        with open_source(f"{folder}/%d.png") as capture:
            gop = gop_for_fps(capture.fps, None)
            warm_up(head_with_surround(), capture.format, gop, rng)
    height, width = RESIDUAL_SIZE
    differences = list(
        rng.normal(0, 9, (gop.frames_per_packet, height, width, 3)).astype(np.float32)
    )
    faces = [np.zeros(RESIDUAL_SIZE, np.float32)] * gop.frames_per_packet
    ResidualEncoder(RESIDUAL_BPS, width, height).encode(differences, faces, 1.0, 0.0)
    # What the decoder reads with.
    decode_picture("noise", encode_background_within(noise, BYTES))
    decode_mask(b"")
    # Of the thesis profile's filter; the other loops are those of the default one.
    points, state = 4, 7
    jacobian = np.zeros((2 * points, 2 * state))[:, :state]
    pixels, visible = np.zeros(2 * points), np.ones(points, bool)
    robust_residuals(np.eye(state), np.zeros(state), jacobian, pixels, pixels + 1, visible)
