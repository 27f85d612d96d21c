"""Clips, calls and processes that many tests use."""

import os

# As on a server, in every process that a test starts: no display.  No test needs two cores, and
# OpenBLAS's threads, whose number it reads when NumPy is imported, wait for each other in busy
# loops, which takes the cores from the other tests.
os.environ.pop("DISPLAY", None)
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import fcntl
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from itertools import islice
from pathlib import Path

import cv2
import hypothesis
import numpy as np
import pytest
from disc_film import make_disc_film
from shots import Shots, draw, draw_shots, talking

from benchmarks.browser import find_browser
from decoder.sinks.frame_sink import open_sink
from encoder.capture.frame_times import exact_fps
from encoder.capture.video_source import open_source
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from loopback.clip_paths import CARPHONE, clip_path
from loopback.judge.observer import ENVIRONMENT_VARIABLE
from loopback.process_pair import free_port
from risorius.cli import main
from runtime.fork_server import use_server
from shared_model.arrays import Picture
from shared_model.errors import UserError

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = (
    sys.executable,
    "-c",
    "from risorius.cli import main; exit(main())",
)
NOISE_FRAMES = 8
LIVE_MODEL_BYTES = 6000
SIDE_LIGHT = """
[[key]]
time = 1.9
light = { side = 0 }
[[key]]
time = 2.1
light = { side = 0.8 }
"""

cv2.setNumThreads(1)
# No property test fails because the machine is busy.
hypothesis.settings.register_profile(
    "unhurried", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("unhurried")

Start = Callable[..., "subprocess.Popen[str]"]
ClipFrames = Callable[[str, int], list[Picture]]
MakeOnce = Callable[[str, Callable[[Path], object]], Path]


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Stop the first of two measurements of coverage in a worker.

    pytest-cov 7.1 takes a worker of pytest-xdist 3.8 for the main process until its session starts.
    The measurement that it begins then is never saved, and each one slows Python code down.
    """
    plugin = session.config.pluginmanager.getplugin("_cov")
    if "PYTEST_XDIST_WORKER" in os.environ and plugin is not None and plugin.cov_controller:
        plugin.cov_controller.cov.stop()


@pytest.fixture(scope="session", autouse=True)
def default_signal_handlers() -> Iterator[None]:
    """Give the tests and their child processes the default handlers of SIGINT and SIGHUP, which
    a shell that runs the tests in the background ignores."""
    interrupt = signal.signal(signal.SIGINT, signal.default_int_handler)
    hang_up = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGINT, interrupt)
    signal.signal(signal.SIGHUP, hang_up)


@pytest.fixture(autouse=True)
def children_that_start_afresh() -> Iterator[None]:
    """Leave the fork server that a test has started."""
    yield
    use_server(None)


@pytest.fixture(scope="session")
def make_once(tmp_path_factory: pytest.TempPathFactory) -> MakeOnce:
    """Makes a folder once for all processes of a test run: its name, and what fills it."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def make(name: str, fill: Callable[[Path], object]) -> Path:
        folder, complete = shared / name, shared / f"{name}.complete"
        with (shared / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not complete.exists():
                folder.mkdir(exist_ok=True)
                fill(folder)
                complete.touch()
        return folder

    return make


@pytest.fixture(scope="session")
def clips() -> Path:
    """The folder of development clips, which are not part of the project."""
    folder = ROOT.parent / "shared" / "clips"
    if not folder.is_dir():
        pytest.skip(f"needs the development clips in {folder}")
    return folder


@pytest.fixture(scope="session")
def clip_frames(clips: Path) -> ClipFrames:
    """The first frames of a development clip, by its name and their number."""

    def read(name: str, count: int) -> list[Picture]:
        with open_source(str(clips / name)) as capture:
            return [frame for _, frame in islice(capture, count)]

    return read


@pytest.fixture(scope="session")
def networks() -> Path:
    """The folder of the landmark networks."""
    try:
        return find_network_folder()
    except NetworkFilesMissing as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def chromium() -> str:
    """The path of the browser."""
    program = find_browser()
    if program is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    return program


@contextmanager
def without_layers() -> Iterator[None]:
    """Calls of one picture, as where the segmentation network is not installed: layers take half of
    the learning, and many tests are of something else."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("encoder.layers.layer_learning.find_segmentation_network", lambda: None)
        yield


@pytest.fixture(scope="module")
def without_judge() -> Iterator[None]:
    """As where no judge is installed, in all processes: it costs seconds a video, and many tests
    are of something else."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(ENVIRONMENT_VARIABLE, "")
        yield


@pytest.fixture(scope="session")
def carphone(networks: Path) -> Path:
    """The demo clip: 176x144, 29.97 a second, 120 frames."""
    try:
        return clip_path(CARPHONE, Path())
    except UserError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def noise(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of a third of a second of noise, without any face."""
    path = tmp_path_factory.mktemp("noise") / "noise.mkv"
    random = np.random.default_rng(1)
    with open_sink(path, 160, 120, exact_fps(25)) as sink:
        for _ in range(NOISE_FRAMES):
            sink.write(random.integers(0, 256, (120, 160, 3), dtype=np.uint8))
    return path


@pytest.fixture(scope="session")
def call(carphone: Path, make_once: MakeOnce) -> Path:
    """The first 30 frames of the demo clip as a call file of the thesis profile."""

    def encode(folder: Path) -> None:
        options = ["--profile", "thesis", "--max-frames", "30", "-q"]
        assert main(["encode", str(carphone), "-o", str(folder / "call.rzo"), *options]) == 0

    return make_once("thesis_call", encode) / "call.rzo"


@pytest.fixture(scope="session")
def talking_clip(networks: Path, make_once: MakeOnce) -> Path:
    """A video of 75 frames of a drawn face that turns and speaks, lit from one side at last."""
    script = talking(3) + SIDE_LIGHT
    return make_once("talking", lambda folder: draw(folder / "clip.mkv", script)) / "clip.mkv"


@pytest.fixture(scope="session")
def live_call(talking_clip: Path, make_once: MakeOnce) -> Path:
    """That video as a live call."""

    def encode_live(folder: Path) -> None:
        options = EncodeOptions(
            str(talking_clip), folder / "call.rzo", live=True, model_bytes=LIVE_MODEL_BYTES
        )
        encode(options, lambda done, total: None, lambda: False)

    return make_once("live_call", encode_live) / "call.rzo"


@pytest.fixture(scope="session")
def recorded_call(talking_clip: Path, make_once: MakeOnce) -> Path:
    """Its first second as a recorded call of the default profile, with a small model."""

    def encode_recorded(folder: Path) -> None:
        options = EncodeOptions(
            str(talking_clip), folder / "call.rzo", model_bytes=3000, max_frames=25
        )
        encode(options, lambda done, total: None, lambda: False)

    return make_once("recorded_call", encode_recorded) / "call.rzo"


@pytest.fixture(scope="session")
def disc_film(carphone: Path, make_once: MakeOnce) -> Path:
    """The demo clip with a disc held before the collar, see `disc_film`."""
    return make_once("disc", lambda folder: make_disc_film(carphone, folder / "disc.mkv")) / (
        "disc.mkv"
    )


@pytest.fixture(scope="session")
def slow_clip(networks: Path, make_once: MakeOnce) -> Path:
    """A drawn face of five pictures a second, for two seconds: few frames to encode."""
    return (
        make_once("slow", lambda folder: draw(folder / "clip.mkv", talking(2, fps=5))) / "clip.mkv"
    )


@pytest.fixture(scope="session")
def demo_run(carphone: Path, make_once: MakeOnce) -> Path:
    """A folder with `out/demo`, which `risorius demo` writes, and `printed.txt`, its output.

    `out/demo/call.rzo` holds the whole demo clip in the default profile with its default sizes.
    """

    def run(folder: Path) -> None:
        with (folder / "printed.txt").open("w") as printed, redirect_stdout(printed):
            assert main(["demo", "--out", str(folder / "out" / "demo")]) == 0

    return make_once("demo", run)


@pytest.fixture(scope="session")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Shots:
    """A few pictures of the generic head with their ground truth."""
    return draw_shots(tmp_path_factory.mktemp("shots"))


@pytest.fixture
def endpoint() -> str:
    """Where nobody listens yet."""
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Closes what is entered after the test."""
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts the program with the given arguments; kills it after the test if it still runs."""
    processes: list[subprocess.Popen[str]] = []

    def start_program(*arguments: str | Path) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*PROGRAM, *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        processes.append(process)
        return process

    yield start_program
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()
