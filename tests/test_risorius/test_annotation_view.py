"""The page of annotations: a real server, real files, and a real browser where there is one."""

import json
import shutil
import signal
import subprocess
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from aam_faces import JAW_DROP, POSE, known_face, landmarks_of, write_csv, write_picture
from conftest import PROGRAM, ROOT, Start
from processes import LIMIT_S

from aam.annotation.annotation_file import read_annotation
from aam.shape_space import SHAPE_NAMES
from benchmarks.browser import Browser
from risorius.cli import main
from risorius.view.annotation_residual import MeanResidual
from risorius.view.annotation_state import AnnotationFolder, description, shown
from shared_model.errors import UserError
from shared_model.parameters import EAUS

NOSE_TIP = 4
TOO_MUCH = b" " * 70000
NOTHING: dict[str, Any] = {"landmarks": {}, "shape": {}, "pose": None, "weight": 8}


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two annotated pictures: `in` holds these, `out` the annotations."""
    folder = tmp_path_factory.mktemp("view")
    (folder / "in").mkdir()
    points = landmarks_of(*known_face(), POSE)
    rest = landmarks_of(np.zeros(11), np.zeros(len(EAUS)), POSE)
    for number, name in enumerate(("a.png", "b c.png")):
        write_picture(folder / "in" / name, number)
    write_csv(folder / "given.csv", {"a.png": points, "b c.png": rest})
    where = ("-o", str(folder / "out"), "--landmarks", str(folder / "given.csv"))
    assert main(["annotate", str(folder / "in"), *where, "-q"]) == 0
    return folder


@pytest.fixture
def folder(template: Path, tmp_path: Path) -> Path:
    """A copy of the annotations; their pictures are where they were."""
    return Path(shutil.copytree(template / "out", tmp_path / "out"))


class Page:
    """A running `risorius view --annotation`."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("http://127.0.0.1:"), process.communicate()
        self.url = line.strip()
        self._port, self._path = urlsplit(self.url).port, urlsplit(self.url).path

    def ask(self, what: str, body: Any = None, **headers: str) -> tuple[int, bytes]:
        """Status and body of a request below the page's address, or from /; with a body: POST."""
        path = what if what.startswith("/") else self._path + what
        connection = HTTPConnection("127.0.0.1", self._port, timeout=LIMIT_S)
        try:
            method = "GET" if body is None else "POST"
            data = body if body is None or isinstance(body, bytes) else json.dumps(body)
            connection.request(method, path, data, headers)
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def values(self, what: str, body: Any = None) -> Any:
        """The JSON that answers a request."""
        status, data = self.ask(what, body)
        assert status == 200, data
        return json.loads(data)


@pytest.fixture(scope="module")
def page(template: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    out = shutil.copytree(template / "out", tmp_path_factory.mktemp("served") / "out")
    command = [*PROGRAM, "view", "--annotation", str(out)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        yield Page(process)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=LIMIT_S)
        assert (process.returncode, stderr) == (0, "")


def test_what_is_stored_is_shown_and_an_empty_correction_is_the_same(page: Page) -> None:
    described = page.values("annotations.json")
    errors = described["annotations"]
    assert set(errors) == {"a", "b c"} and list(errors.values()) == sorted(errors.values())[::-1]
    assert [each["name"] for each in described["controls"]] == list(SHAPE_NAMES)
    stored = page.values("annotation.json?name=b%20c")
    assert len(stored["landmarks"]) == len(stored["model"]) > 400
    assert stored["unexplained"] > 0 and stored["texture"].startswith("data:image/jpeg;base64,")
    assert page.values("fit?name=b%20c", NOTHING) == stored
    status, data = page.ask("picture.jpg?name=b%20c")
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert status == 200 and picture is not None and picture.shape[0] == stored["side"]


def test_what_is_set_is_fitted_and_nothing_is_written_before_it_is_saved(page: Page) -> None:
    stored = page.values("annotation.json?name=a")
    place = dict((i, (x, y)) for i, x, y in stored["landmarks"])[NOSE_TIP]
    put = [place[0] + 4, place[1]]
    moved = page.values("fit?name=a", NOTHING | {"landmarks": {str(NOSE_TIP): put}})
    at = {i: (x, y) for i, x, y in moved["model"]}[NOSE_TIP]
    assert at[0] > place[0] + 1.5
    assert dict((i, [x, y]) for i, x, y in moved["landmarks"])[NOSE_TIP] == pytest.approx(put)
    assert moved["texture"] != stored["texture"] and moved["residual"] != stored["residual"]
    pose = stored["pose"] | {"yaw_deg": stored["pose"]["yaw_deg"] + 10}
    held = page.values("fit?name=a", NOTHING | {"pose": pose, "shape": {"jaw_drop": 0.25}})
    assert held["pose"] == pytest.approx(pose) and held["shape"]["jaw_drop"] == 0.25
    assert held["correction"]["pose"] == pytest.approx(pose)
    assert page.values("annotation.json?name=a") == stored


@pytest.mark.parametrize(
    ("what", "body"),
    [
        ("fit?name=a", {"shape": {"grin": 1}}),
        ("fit?name=a", {"pose": {"yaw_deg": 1}}),
        ("fit?name=a", [1]),
        ("fit?name=a", b"{"),
        ("fit?name=a", TOO_MUCH),
        ("fit?name=..%2Fa", NOTHING),
        ("annotation.json?name=c", None),
        ("picture.jpg", None),
    ],
)
def test_what_cannot_be_done_is_told_in_one_line(page: Page, what: str, body: Any) -> None:
    status, data = page.ask(what, body)
    assert status == (413 if body == TOO_MUCH else 400) and len(data.splitlines()) == 1
    assert page.ask("")[0] == 200


def test_other_pages_other_hosts_and_whoever_lacks_the_secret_get_nothing(page: Page) -> None:
    assert page.ask("save?name=a", NOTHING, Origin="http://elsewhere.example")[0] == 403
    assert page.ask("save?name=a", NOTHING, Host="elsewhere.example")[0] == 403
    assert page.ask("/wrong/save?name=a", NOTHING)[0] == 403
    assert page.ask("write?name=a", NOTHING)[0] == 404
    status, body = page.ask("")
    assert status == 200 and b"http://" not in body and b"https://" not in body


def test_a_picture_that_has_gone_is_looked_for_and_another_one_is_not_taken(
    template: Path, folder: Path, tmp_path: Path
) -> None:
    values = json.loads((folder / "a.json").read_text())
    moved = tmp_path / "pictures" / "in"
    moved.mkdir(parents=True)
    values["image"] = str(tmp_path / "gone" / "in" / "a.png")
    (folder / "a.json").write_text(json.dumps(values))
    with pytest.raises(UserError, match=r"not there as it was.*--pictures"):
        AnnotationFolder(folder).open("a")
    shutil.copy(template / "in" / "b c.png", moved / "a.png")
    with pytest.raises(UserError, match="nor is it in"):
        AnnotationFolder(folder, moved.parent).open("a")
    shutil.copy(template / "in" / "a.png", moved / "a.png")
    assert AnnotationFolder(folder, moved.parent).open("a").size == (220, 200)


def test_one_annotation_alone_has_no_mean_to_be_compared_with(folder: Path) -> None:
    (folder / "b c.json").unlink()
    alone = AnnotationFolder(folder / "a.json")
    residual = MeanResidual(alone.path, alone.names)
    opened = alone.open("a")
    values = shown(opened, opened.present, residual)
    assert values["residual"] is values["unexplained"] is None
    assert list(description(alone, residual.name)["annotations"]) == ["a"]


def test_options_of_annotations_need_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", "--model", "m.npz"]) == 2
    assert main(["view", "--annotation", str(tmp_path)]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2 and "--annotation" in told[0] and "holds no annotations" in told[1]


def drag(browser: Browser, x: float, y: float) -> None:
    """Drag what is at a place of the window to the right."""
    browser.mouse("mousePressed", x, y)
    for step in range(1, 5):
        browser.mouse("mouseMoved", x + 4 * step, y)
    browser.mouse("mouseReleased", x + 16, y)
    browser.wait("!busy && !stale")


def test_a_landmark_is_dragged_a_slider_moved_and_both_saved_in_the_browser(
    folder: Path, tmp_path: Path, start: Start, chromium: str
) -> None:
    fitted = read_annotation(folder / "b c.json")
    url = Page(start("view", "--annotation", folder)).url
    with Browser(chromium, tmp_path / "profile") as browser:
        browser.call("Page.navigate", url=url)
        browser.wait("typeof moved == 'number' && moved > 0 && !busy")
        browser.value("el('names').value = 'b c', el('names').onchange()")
        browser.wait("face && face.name == 'b c' && picture.complete")
        left, top, _, _ = browser.box("#overlay")
        x, y = browser.value(f"toPage(...handles().get({NOSE_TIP}))")
        texture = browser.value("el('texture').src")
        drag(browser, left + x, top + y)
        (index,) = browser.value("Object.keys(edit.landmarks)")
        put = browser.value(f"edit.landmarks[{index}]")
        # Several landmarks are within reach of a pointer; the nearest is taken.
        assert put[0] - fitted.landmarks[int(index), 0] > 3
        assert browser.value("el('texture').src") != texture
        browser.click("#jaw_drop", across=0.9)
        browser.wait("!busy && !stale")
        value = float(browser.value("edit.shape.jaw_drop"))
        assert browser.value("document.querySelectorAll('.row.held').length") == 1
        assert "not saved" in browser.value("el('state').textContent")
        browser.click("#save")
        browser.wait("el('state').textContent.includes('as in the files')")
        stored = read_annotation(folder / "b c.json")
        assert stored.shape[JAW_DROP] == pytest.approx(value) and value > 0.5
        np.testing.assert_allclose(stored.landmarks[int(index), :2], put, atol=1e-3)
        assert read_annotation(folder / "originals" / "b c.json").shape[JAW_DROP] < 0.2
        browser.click("#release")
        browser.wait("!busy && !stale && face.shape.jaw_drop < 0.2")
        browser.click("#undo")
        browser.wait(f"!busy && !stale && face.shape.jaw_drop == {value}")
        assert browser.value("el('trouble').textContent") == ""
