"""The bench of curves: what is measured, that nothing is measured twice, the page."""

import json
from pathlib import Path

import pytest
from conftest import without_layers

from benchmarks.browser import Browser
from loopback.curves.contenders import LADDER, Rung, call_path, look_interval
from loopback.curves.curve_bench import CurveSettings, bench_curves, open_pool, shown_rung
from risorius.cli import main
from shared_model.errors import UserError

pytest.importorskip("plotly", reason="needs plotly: pip install '.[report]'")

pytestmark = pytest.mark.usefixtures("without_judge")
FRAMES = 20


@pytest.fixture(scope="module")
def folder(without_judge: None, carphone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bench of one clip against one rival."""
    folder = tmp_path_factory.mktemp("curves")
    options = ["--max-frames", str(FRAMES), "--out", str(folder), "--against", "x264"]
    with without_layers():
        assert main(["bench", str(carphone), *options, "--sweep", "300,900"]) == 0
    return folder


def test_every_point_is_measured(carphone: Path, folder: Path) -> None:
    report = json.loads((folder / "report.json").read_text())
    assert report["schema"] == "risorius-curves/1" and report["rung"] == "900 bit/s"
    points = report["clips"][carphone.stem]
    low, high = points["risorius"]
    assert low["steady_bps"] <= 300 < high["steady_bps"] <= 900
    assert low["start_bytes"] == high["start_bytes"] > 5000
    assert 28 < low["figures"]["face_psnr_db"] < high["figures"]["face_psnr_db"]
    seconds = FRAMES * 1001 / 30000
    bits = 8 * sum(high["figures"]["groups"].values()) / seconds
    assert bits == pytest.approx(high["steady_bps"], rel=0.15)
    assert high["figures"]["stage_ms"]["fit"] > 0
    rates = [point["steady_bps"] for point in points["x264"]]
    assert len(rates) > 5 and min(rates) < 10_000 < max(rates)
    assert {point["setting"]["frame_step"] for point in points["x264"]} == {1, 2}
    assert not list(folder.glob("*.mkv"))
    (duel,) = (
        duel
        for duel in report["duels"]
        if duel["measure"] == "full_psnr_db" and duel["duration_s"] == 60
    )
    assert duel["rival"] == "x264" and duel["their_bps"] > 2000


def test_what_is_measured_is_not_measured_again(carphone: Path, folder: Path) -> None:
    said: list[str] = []
    settings = CurveSettings((Rung(300), Rung(900)), ("x264",), max_frames=FRAMES)
    clips, _, failures = bench_curves([str(carphone)], settings, folder, said.append)
    quiet = ("the judge is", "is done")
    assert not failures and all(any(each in line for each in quiet) for line in said)
    assert [point.label for point in clips[carphone.stem]["risorius"]] == ["300 bit/s", "900 bit/s"]
    fewer = CurveSettings((Rung(300),), (), max_frames=FRAMES)
    clips, _, _ = bench_curves([str(carphone)], fewer, folder, said.append)
    assert list(clips[carphone.stem]) == ["risorius"] and len(clips[carphone.stem]["risorius"]) == 1


def test_a_pool_measures_the_same(carphone: Path, tmp_path: Path) -> None:
    """Two processes, and a folder of clips of which one fails."""
    clips = tmp_path / "clips"
    clips.mkdir()
    (clips / "a.mp4").write_bytes(carphone.read_bytes())
    (clips / "b.mp4").write_bytes(b"no video")
    (clips / "notes.txt").write_text("no clip")
    options = ["--against", "x264", "--sweep", "300", "--max-frames", "8", "--live"]
    out = tmp_path / "out"
    options += ["--jobs", "2", "--out", str(out)]
    assert main(["bench", str(clips), *options]) == 2
    (clips / "b.mp4").unlink()
    assert main(["bench", str(clips), *options]) == 0
    alone, _, _ = bench_curves(
        [str(clips / "a.mp4")],
        CurveSettings((Rung(300),), ("x264",), is_live=True, max_frames=8),
        tmp_path / "alone",
        lambda line: None,
    )
    report = json.loads((out / "report.json").read_text())
    # Ours are the same to the byte; x264's pictures may differ by a percent from run to run.
    for codec, tolerance in (("risorius", 0), ("x264", 0.05)):
        points, measured = alone["a"][codec], report["clips"]["a"][codec]
        start = [point.start_bytes for point in points]
        assert [p["start_bytes"] for p in measured] == pytest.approx(start, rel=tolerance)
        psnr = [point.figures["full_psnr_db"] for point in points]
        measured_psnr = [p["figures"]["full_psnr_db"] for p in measured]
        assert measured_psnr == pytest.approx(psnr, rel=tolerance)
    assert (out / "a-live-300.rzo").read_bytes() == (
        tmp_path / "alone" / "a-live-300.rzo"
    ).read_bytes()


def test_a_cluster_measures_a_clip(folder: Path, carphone: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="needs dask: pip install '.[cluster]'")
    settings = CurveSettings((Rung(300), Rung(900)), ("x264",), max_frames=FRAMES)
    with (
        distributed.LocalCluster(1, processes=False, dashboard_address=None) as cluster,
        open_pool(1, cluster.scheduler_address) as pool,
    ):
        clips, _, failures = bench_curves(
            [str(carphone)], settings, folder, lambda line: None, pool
        )
    assert not failures and len(clips[carphone.stem]["risorius"]) == 2


def test_a_cluster_that_does_not_answer_is_the_users_mistake(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("distributed", reason="needs dask: pip install '.[cluster]'")
    monkeypatch.setattr("loopback.curves.curve_bench.CONNECT_S", 0.3)
    with pytest.raises(UserError, match="no scheduler"), open_pool(1, "tcp://127.0.0.1:1"):
        pass


def test_the_page_shows_curves_and_pictures_without_a_network(
    folder: Path, chromium: str, tmp_path: Path
) -> None:
    html = (folder / "report.html").read_text()
    assert "cdn" not in html.split("plotly.js v")[0]
    with Browser(chromium, tmp_path, 1200, 2600) as browser:
        browser.call("Page.navigate", url=f"file://{folder / 'report.html'}")
        browser.wait("document.querySelectorAll('.subplot .scatterlayer .trace').length >= 10")
        browser.wait("document.querySelectorAll('.im').length >= 2")
        assert browser.value("document.querySelectorAll('.slider-rail-rect').length") == 1
        assert browser.value("document.body.innerText").count("kbit/s") > 4
        picture = browser.screenshot()
    assert picture.std() > 10


def test_a_clip_that_fails_does_not_cost_the_others(
    carphone: Path, noise: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--max-frames", str(FRAMES), "--out", str(folder), "--sweep", "900"]
    with without_layers():
        assert main(["bench", str(noise), str(carphone), *options]) == 3
    printed = capsys.readouterr()
    assert "no face" in printed.err and "900 bit/s" in printed.out


@pytest.mark.parametrize(
    "options, reason",
    [
        (["--sweep", "200,fast"], "--sweep"),
        (["--sweep", "200:9"], "--sweep"),
        (["--against", "theora"], "theora is no rival"),
        (["--against", "x264", "--profile", "thesis"], "leave out --profile thesis"),
        (["--sweep", "300", "--timings"], "--timings"),
        (["--sweep", "300", "--bitrate", "900"], "leave out --bitrate"),
    ],
)
def test_what_does_not_go_together_is_said(
    options: list[str],
    reason: str,
    carphone: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["bench", str(carphone), "--out", str(tmp_path / "a"), *options]) == 2
    assert reason in capsys.readouterr().err


def test_the_ladder_reaches_from_300_bits_to_30_kilobits() -> None:
    assert LADDER[0].bitrate == 300 and LADDER[-1].bitrate == 30_000
    assert shown_rung(LADDER).bitrate == 800
    sizes = [rung.model_bytes or 12_000 for rung in LADDER]
    assert sizes == sorted(sizes)
    paths = {call_path(Path("a"), rung, live) for rung in LADDER for live in (True, False)}
    assert len(paths) == 2 * len(LADDER)
    assert look_interval((352, 288)) == 10 and look_interval((1920, 1080)) > 100
