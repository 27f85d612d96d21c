"""The viewer: a real server, the real renderer, and a real browser where there is one."""

import json
import signal
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from http.client import HTTPConnection
from pathlib import Path
from threading import Thread
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from call_files import call_file
from conftest import PROGRAM, ROOT, Start
from processes import LIMIT_S, one_line, until

from benchmarks.browser import Browser
from risorius.animation.animate import open_actor
from risorius.animation.animation_script import AnimationState, parse_script
from risorius.cli import main
from risorius.view.server import STUDIO, RenderRequest, RequestQueue, serve
from risorius.view.view_state import page_description, state_from_query
from shared_model.anatomy.expressions import EMOTIONS
from shared_model.anatomy.muscle_fields import MUSCLE_NAMES
from shared_model.arrays import Picture
from shared_model.errors import UserError
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, clip_eau


class Server:
    """A running `risorius view`."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self.url, self.port, self._folder = url, parts.port, parts.path

    def get(self, path: str, **headers: str) -> tuple[int, bytes]:
        """Status and body of one request below the page's address."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=LIMIT_S)
        try:
            connection.request("GET", self._folder + path, headers=headers)
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def picture(self, query: str = "") -> Picture:
        """The picture of a query, (h, w, 3) uint8 BGR."""
        status, body = self.get(f"picture.jpg?{query}")
        assert status == 200, body
        picture = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        return np.asarray(picture, dtype=np.uint8)


def started(process: "subprocess.Popen[str]") -> Server:
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("http://127.0.0.1:"), process.communicate()
    return Server(line.strip())


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with subprocess.Popen(
        [*PROGRAM, "view"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        yield started(process)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=LIMIT_S)
        assert (process.returncode, stderr) == (0, "")


@pytest.fixture
def browser(tmp_path: Path, chromium: str) -> Iterator[Browser]:
    with Browser(chromium, tmp_path) as opened:
        yield opened


def difference(a: Picture, b: Picture) -> float:
    """Mean absolute difference, grey levels."""
    return float(np.abs(a.astype(float) - b).mean())


def test_the_page_needs_nothing_from_elsewhere(server: Server) -> None:
    status, body = server.get("")
    assert status == 200 and b"<title>Risorius</title>" in body
    assert b"http://" not in body and b"https://" not in body


def test_every_actuator_moves_the_picture(server: Server) -> None:
    rest = server.picture()
    for query in [f"{eau.name}={eau.high}" for eau in EAUS] + [f"{name}=1" for name in AAUS]:
        assert difference(rest, server.picture(query)) > 0.03, query
    for name in MUSCLE_NAMES:
        assert difference(rest, server.picture(f"{name}=1")) > 0.03, name
    assert difference(rest, server.picture("yaw=30")) > 2
    assert difference(rest, server.picture("brightness=0.5")) > 5


def test_the_head_turns_towards_the_side_that_is_asked_for(server: Server) -> None:
    head = server.picture("yaw=60").max(2) > 60
    profile = [np.flatnonzero(row) for row in head[300:560]]
    # The nose of a head that looks to the picture's right is its rightmost point.
    tip = max(range(len(profile)), key=lambda i: profile[i][-1])
    assert 0.2 < tip / len(profile) < 0.9


def test_the_description_has_all_that_the_sliders_show(server: Server) -> None:
    model = json.loads(server.get("model.json")[1])
    assert [eau["name"] for eau in model["eaus"]] == [eau.name for eau in EAUS]
    assert [aau["name"] for aau in model["aaus"]] == list(AAUS)
    assert [n for muscle in model["muscles"] for n in muscle["sides"]] == list(MUSCLE_NAMES)
    assert {muscle["region"] for muscle in model["muscles"]} == {"Brows", "Eyes", "Nose", "Mouth"}
    assert {e["name"] for e in model["emotions"]} == {e.name for e in EMOTIONS}
    assert model == page_description(model["width"], model["height"], None)
    assert all(eau["au"].startswith("AU") and eau["works_up"] for eau in model["eaus"])


@pytest.mark.parametrize("query", ["grin=1", "jaw_drop=2", "jaw_drop=wide", "yaw=nan", "away=-950"])
def test_what_cannot_be_drawn_is_told_and_the_server_goes_on(server: Server, query: str) -> None:
    status, body = server.get(f"picture.jpg?{query}")
    assert status == 400 and len(body.splitlines()) == 1
    assert server.picture().shape[2] == 3


def test_other_paths_and_other_hosts_get_nothing(server: Server) -> None:
    assert server.get("view.py")[0] == 404
    assert server.get("picture.jpg", Host="elsewhere.example")[0] == 403
    assert server.get("picture.jpg", Origin="http://elsewhere.example")[0] == 403
    for wrong in ("", "wrong/"):
        assert Server(f"http://127.0.0.1:{server.port}/{wrong}").get("picture.jpg")[0] == 403


def test_a_query_adds_emotions_to_actuators() -> None:
    state = state_from_query("happiness=1&jaw_drop=0.2&zoom=2")
    assert state.eau[EAU_INDEX["mouth_corners"]] == pytest.approx(0.9)
    assert state.eau[EAU_INDEX["jaw_drop"]] == pytest.approx(0.7)
    assert state.zoom == 2 and state.pose["yaw"] == 0


def test_of_one_page_only_the_newest_request_is_drawn_and_pages_take_turns() -> None:
    requests, answers = RequestQueue(), dict[str, bytes | None]()
    states = {
        name: state_from_query(f"jaw_drop={i / 10}") for i, name in enumerate(["a1", "a2", "b1"])
    }

    def request(name: str, state: AnimationState) -> None:
        answers[name] = requests.ask(name[0], state).result()

    first = Thread(target=request, args=("a1", states["a1"]))
    first.start()
    until(lambda: "a" in requests.pages())
    others = [Thread(target=request, args=(name, states[name])) for name in ("a2", "b1")]
    for thread in others:
        thread.start()
    until(lambda: "a1" in answers and requests.pages() == {"a", "b"})
    for _ in range(2):
        taken = requests.take()
        taken.picture.set_result(str(taken.state.eau[0]).encode())
    for thread in [first, *others]:
        thread.join(LIMIT_S)
    assert answers == {"a1": None, "a2": b"0.1", "b1": b"0.2"}


def test_a_picture_that_fails_fails_for_whoever_asked() -> None:
    requests = RequestQueue()
    asked = Thread(target=lambda: requests.take().picture.set_exception(UserError("no")))
    asked.start()
    with pytest.raises(UserError, match="no"):
        requests.ask("a", state_from_query("")).result()
    asked.join(LIMIT_S)


def test_a_caller_is_shown_in_their_own_picture_and_may_be_reshaped(
    tmp_path: Path, start: Start
) -> None:
    server = started(start("view", "--call", call_file(tmp_path / "call.rzo")))
    assert json.loads(server.get("model.json")[1])["caller"] == "call.rzo"
    rest = server.picture()
    assert rest.shape == (120, 160, 3)
    # Their green face before their blue wall.
    assert rest[60, 80].argmax() == 1 and rest[3, 3].argmax() == 0
    assert difference(rest, server.picture("cranial_width=1")) > 0.5


def test_a_caller_with_all_sliders_at_rest_has_the_face_of_their_typical_picture(
    call: Path,
) -> None:
    studio = parse_script(STUDIO, Path())
    actor = open_actor(studio, call)
    try:
        rest, request = studio.at(0), RenderRequest(studio.at(0))
        serve(request, actor)
        shown = replace(rest, eau=clip_eau(actor.rest_eau))
        expected = actor.draw(shown, actor.geometry(shown))
        jpeg = request.picture.result()
        assert jpeg is not None
        drawn = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR))
        assert np.abs(drawn.astype(float) - expected).mean() < 3
        assert np.abs(actor.rest_eau).max() > 0 and actor.rest_eau[EAU_INDEX["jaw_drop"]] <= 0.1
    finally:
        actor.close()


def test_a_port_in_use_is_one_line_and_exit_code_4(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert main(["view", "--port", str(taken.getsockname()[1])]) == 4
    said = capsys.readouterr()
    assert not said.out and "another --port" in one_line(said.err)


def test_moving_a_slider_and_dragging_the_face_change_what_the_browser_shows(
    server: Server, browser: Browser
) -> None:
    browser.call("Page.navigate", url=server.url)
    browser.wait("document.querySelectorAll('input[type=range]').length == 51")
    left, top, width, height = map(int, browser.box("#picture"))

    def shown(after: int) -> Picture:
        """The face once a picture later than `after` is there and no other is under way."""
        browser.wait(f"+(picture.dataset.shown || 0) > {after} && !busy && !stale")
        return browser.screenshot()[top : top + height, left : left + width]

    def count() -> int:
        return int(browser.value("+(picture.dataset.shown || 0)"))

    rest, before = shown(0), count()
    assert rest.std() > 20
    browser.click("#jaw_drop", across=0.9)
    opened, before = shown(before), count()
    assert float(browser.value("values.jaw_drop")) == pytest.approx(0.9, abs=0.05)
    assert browser.value("rows.get('jaw_drop').output.textContent").startswith("+0.")
    assert difference(rest, opened) > 1
    x, y = left + width / 2, top + height / 2
    browser.mouse("mousePressed", x, y)
    for step in range(1, 5):
        browser.mouse("mouseMoved", x + 25 * step, y)
    browser.mouse("mouseReleased", x + 100, y)
    turned, before = shown(before), count()
    assert float(browser.value("values.yaw")) > 20
    assert difference(opened, turned) > 3
    browser.click("#reset")
    browser.wait("!values.jaw_drop && !values.yaw")
    assert difference(rest, shown(before)) < 0.5
    browser.click("#emotions button")
    browser.wait("values.mouth_corners == 0.9")
    assert browser.value("document.querySelector('#emotions button').ariaPressed") == "true"


def test_one_muscle_of_one_side_is_moved_by_its_own_slider(
    server: Server, browser: Browser
) -> None:
    browser.call("Page.navigate", url=server.url)
    browser.wait("document.querySelectorAll('input[type=range]').length == 51")
    browser.wait("+(picture.dataset.shown || 0) > 0 && !busy && !stale")
    assert browser.value("el('muscles').hidden")
    browser.click("#choose-muscles")
    assert browser.value("el('sliders').hidden") and not browser.value("el('muscles').hidden")
    left, top, width, height = map(int, browser.box("#picture"))
    rest = browser.screenshot()[top : top + height, left : left + width]
    before = browser.value("picture.dataset.shown")
    browser.click("#frontalis_outer_right", across=0.95)
    browser.wait(f"picture.dataset.shown != '{before}' && !busy && !stale")
    raised = browser.screenshot()[top : top + height, left : left + width]
    # The subject's right is on the picture's left.
    half = width // 2
    assert difference(rest[:, :half], raised[:, :half]) > 0.1
    assert difference(rest[:, half:], raised[:, half:]) < 0.05
    browser.click("#reset")
    browser.wait("!values.frontalis_outer_right")


def test_the_face_blinks_by_itself_where_asked(server: Server, browser: Browser) -> None:
    browser.call("Page.navigate", url=server.url)
    browser.wait("+(picture.dataset.shown || 0) > 0 && !busy && !stale")
    closing = "[0, 90, 110, 130, 1000].map(closureAt).join()"
    assert browser.value(closing) == "0,1,1,1,0"
    assert browser.value("JSON.stringify(withBlink({lid_left: 0.2}))") == '{"lid_left":0.2}'
    browser.click("#blink")
    browser.wait("blinkClosure > 0 && withBlink({lid_left: -0.5}).lid_left === blinkClosure")
    browser.wait("blinkClosure === 0")
    browser.click("#blink")
    assert browser.value("blinkTimer") == 0
    assert not browser.value("values.lid_left")
