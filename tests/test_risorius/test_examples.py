"""The programs in `examples` run as they stand."""

import io
import subprocess
import sys
from importlib import util
from pathlib import Path
from types import ModuleType

import cv2
import pytest
from conftest import ROOT, without_layers

import risorius

EXAMPLES = ROOT / "examples"


def example(name: str) -> ModuleType:
    spec = util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def clip(carphone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames of a face."""
    path = tmp_path_factory.mktemp("clip") / "me.avi"
    source = cv2.VideoCapture(str(carphone))
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (176, 144))
    for _ in range(12):
        writer.write(source.read()[1])
    writer.release()
    return path


@pytest.fixture(scope="module")
def call(clip: Path) -> Path:
    path = clip.with_name("me.rzo")
    risorius.encode(clip, path, profile="thesis")
    return path


def test_encode_and_decode(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with without_layers():
        example("encode_and_decode").main(str(clip), str(tmp_path))
    assert "12 frames" in capsys.readouterr().out
    assert cv2.imread(str(tmp_path / "at_0.00_s.png")) is not None


def test_frame_loop(call: Path) -> None:
    pipe = io.BytesIO()
    example("frame_loop").main(str(call), pipe)
    assert len(pipe.getvalue()) == 12 * 176 * 144 * 3


def test_track_to_csv(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example("track_to_csv").main(str(clip), str(tmp_path / "me.csv"))
    assert "12 frames" in capsys.readouterr().out
    assert len((tmp_path / "me.csv").read_text().splitlines()) == 13


def test_face_of_another(call: Path, tmp_path: Path) -> None:
    example("face_of_another").main(str(call), str(call), str(tmp_path / "out.avi"))
    assert cv2.VideoCapture(str(tmp_path / "out.avi")).read()[0]


def test_link_of_your_own(clip: Path) -> None:
    with without_layers():
        assert example("link_of_your_own").main(str(clip), 12) == 12


def test_bench_of_a_folder(
    without_judge: None, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    (folder / "me.avi").write_bytes(clip.read_bytes())
    with without_layers():
        example("bench_of_a_folder").main(str(folder), str(tmp_path / "out"), 6)
    printed = capsys.readouterr().out
    assert "me: risorius, 300 bit/s" in printed and "me: x264, crf 51" in printed


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_each_is_short_and_says_how_it_is_called(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= 40 and f"python examples/{path.name}" in text
    assert f"def test_{path.stem}(" in Path(__file__).read_text()
    subprocess.run([sys.executable, "-m", "py_compile", str(path)], check=True)
