"""A source whose pixels are not square: fitted in square ones, decoded as it was."""

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from conftest import without_layers

import risorius
from decoder.pipeline import DecodeOptions, decode
from encoder.capture.video_source import open_source
from loopback.quality.video_quality import face_mask_finder, measure_quality
from protocol.summary import summarise

FRAMES = 12


@pytest.fixture(scope="module")
def squeezed(carphone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames of a face, half as wide as they are shown."""
    path = tmp_path_factory.mktemp("squeezed") / "squeezed.mp4"
    with open_source(str(carphone)) as capture, av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "5"})
        stream.width, stream.height, stream.pix_fmt = 176, 288, "yuv444p"
        stream.codec_context.sample_aspect_ratio = Fraction(2)
        for index, frame in capture:
            if index == FRAMES:
                break
            picture = np.asarray(cv2.resize(frame, (176, 288)), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode(None))
    return path


def test_a_squeezed_source_is_decoded_in_its_size_with_its_aspect_ratio(
    squeezed: Path, tmp_path: Path
) -> None:
    call = tmp_path / "call.rzo"
    with without_layers():
        sent = risorius.encode(squeezed, call, model_bytes=6000)
    assert sent.lost_frames == 0 and (sent.width, sent.height) == (176, 288)
    assert (summarise(call).width, summarise(call).height) == (176, 288)
    output = tmp_path / "decoded.mkv"
    report = decode(DecodeOptions(call, output=output), lambda *_: None, lambda: False)
    assert (report.width, report.height, report.frames) == (176, 288, FRAMES)
    with open_source(str(output)) as capture:
        assert (capture.width, capture.height, capture.sample_aspect) == (176, 288, Fraction(2))
    with risorius.open_call(call) as pictures:
        assert next(iter(pictures)).picture.shape == (288, 352, 3)
    finder = face_mask_finder(print)
    quality = measure_quality(str(squeezed), str(output), finder, lambda *_: None)
    assert quality.face_frames == FRAMES
    assert quality.face_psnr_db is not None and quality.face_psnr_db > 30
