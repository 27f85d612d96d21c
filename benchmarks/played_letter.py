"""A letter as headless Chromium plays it, frame by frame."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from benchmarks.browser import Browser
from benchmarks.measured_process import wait_until_idle
from shared_model.arrays import Picture

# Chromium draws in software where there is no graphics card.
SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
# How long a letter may take to be decoded.
DECODED_S = 60.0
# How long a call may take to be played.
PLAYED_S = 120.0
# How long a browser may take to start.
STARTED_S = 10.0
# Emulated conditions of a network.
OFFLINE: dict[str, Any] = {
    "offline": True,
    **dict.fromkeys(("latency", "downloadThroughput", "uploadThroughput"), 0),
}
GRAB = """
window.grab = (index) => {
  letter.player.draw(index);
  const pixels = letter.player.faces.scene.read();
  let text = "";
  for (let k = 0; k < pixels.length; k += 32768)
    text += String.fromCharCode(...pixels.subarray(k, k + 32768));
  return btoa(text);
};
window.time_frames = (count) => {
  const player = letter.player;
  player.draw(0);
  player.faces.scene.read();
  const start = performance.now();
  for (let i = 0; i < count; i++) player.draw(i);
  player.faces.scene.read();
  return (performance.now() - start) / count;
};
"""
# Plays a call once, and counts the frames that are not drawn.  Models come meanwhile as in a live
# call: those of the call in turn, turned by less than can be seen, so that all of them is new.
PLAY_THROUGH = """
window.play_through = (updates_s) => {
  const { player, clock } = letter;
  const last = new Map(player.frames.map(({ received }) => [received.model.version, received]));
  const models = [...last.values()];
  player.faces.kept = Infinity;
  const drawn = new Set();
  const draw = player.draw;
  player.draw = (index) => {
    const is_drawn = draw.call(player, index);
    if (is_drawn) drawn.add(index);
    return is_drawn;
  };
  let count = 0;
  const update = () => {
    const { model, modes } = models[count++ % models.length];
    const rotation = model.rotation.map((value) => value + 1e-9 * count);
    player.faces.addModel({ model: { ...model, rotation }, modes });
  };
  const timer = updates_s ? setInterval(update, 1000 * updates_s) : 0;
  window.played = null;
  clock.seek(0);
  clock.play();
  const look = () => {
    if (clock.isPlaying) return requestAnimationFrame(look);
    clearInterval(timer);
    player.draw = draw;
    const frames = player.frames.length;
    window.played = { frames, not_drawn: frames - drawn.size, models: count };
  };
  requestAnimationFrame(look);
};
"""
OPENED = """
window.shown_ms = window.decoded_ms = window.model_ms = null;
window.errors = [];
window.onerror = (message, source, line, column, error) => errors.push(String(error));
window.onunhandledrejection = (event) => errors.push(String(event.reason));
const look = () => {
  if (window.letter) {
    if (shown_ms === null && letter.player.faces.scene) shown_ms = performance.now();
    if (decoded_ms === null && letter.player.faces.isDecoded) decoded_ms = performance.now();
  }
  if (shown_ms === null || decoded_ms === null) requestAnimationFrame(look);
};
requestAnimationFrame(look);
// The letter's script, in its worker, says with each answer how long its order had been there.
const timed = `if (typeof document === "undefined") {
  let began = null;
  addEventListener("message", ({ data }) => { if (data.texture) began ??= performance.now(); });
  const post = postMessage;
  postMessage = (answer, options) =>
    post({ ...answer, after_ms: performance.now() - began }, options);
}
`;
const createURL = URL.createObjectURL;
URL.createObjectURL = (blob) =>
  createURL(blob.type === "text/javascript" ? new Blob([timed, blob], { type: blob.type }) : blob);
const post = Worker.prototype.postMessage;
window.orders = [];
Worker.prototype.postMessage = function (order) {
  if (orders.length < 2) orders.push(order);
  return post.call(this, order);
};
window.decode_again = () => {
  window.again_ms = null;
  const worker = new Worker(worker_script);
  worker.onmessage = ({ data }) => {
    if (data.isLast) again_ms = data.after_ms;
  };
  for (const order of orders) worker.postMessage(order);
};
const setHandler = Object.getOwnPropertyDescriptor(Worker.prototype, "onmessage").set;
Object.defineProperty(Worker.prototype, "onmessage", {
  set(handler) {
    setHandler.call(this, (message) => {
      if (message.data.isLast) model_ms ??= message.data.after_ms;
      handler(message);
    });
  },
});
window.Worker = class extends Worker {
  constructor(script) {
    super(script);
    window.worker_script = script;
  }
};
"""


@dataclass(frozen=True)
class PlayedCall:
    """Counts of a call that was played: its frames, those not drawn, models that came meanwhile."""

    frames: int
    not_drawn: int
    models: int


class PlayedLetter:
    """A letter in a browser that has no network; a context manager.

    program: path of Chromium.  folder: for its profile.  letter: the HTML file.
    is_running: whether the browser has had time to start before the letter is opened.
    """

    def __init__(
        self,
        program: str,
        folder: Path,
        letter: Path,
        width: int = 1280,
        height: int = 800,
        is_running: bool = False,
    ) -> None:
        self.browser = Browser(program, folder, width, height, *SOFTWARE_GL)
        if is_running:
            wait_until_idle(STARTED_S)
        self.browser.call("Network.enable")
        self.browser.call("Network.emulateNetworkConditions", **OFFLINE)
        self.browser.call("Page.enable")
        self.browser.call("Page.addScriptToEvaluateOnNewDocument", source=OPENED)
        self.browser.call("Page.navigate", url=letter.absolute().as_uri())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.browser.__exit__(*exception)

    def wait_until_decoded(self) -> None:
        """Wait until the letter is there with all its models."""
        self.browser.wait("shown_ms !== null && decoded_ms !== null", DECODED_S)
        self.browser.value(GRAB + PLAY_THROUGH)

    @property
    def message(self) -> str:
        """What the page says below the picture."""
        return str(self.browser.value("document.getElementById('message').textContent"))

    @property
    def errors(self) -> Sequence[str]:
        """Errors of the page's scripts that nobody has caught."""
        return list(self.browser.value("errors"))

    @property
    def requests(self) -> Sequence[str]:
        """Addresses that the page has asked for."""
        entries = "performance.getEntriesByType('resource')"
        return list(self.browser.value(f"{entries}.map((entry) => entry.name)"))

    @property
    def frames(self) -> int:
        """Number of frames of the call."""
        return int(self.browser.value("letter.player.frames.length"))

    @property
    def shown_ms(self) -> float:
        """When the first picture was there, ms from when the page was asked for."""
        return float(self.browser.value("shown_ms"))

    @property
    def decoded_ms(self) -> float:
        """When all models had been decoded, ms from when the page was asked for."""
        return float(self.browser.value("decoded_ms"))

    @property
    def model_ms(self) -> float:
        """How long the first model took its worker, all its modes included, ms."""
        return float(self.browser.value("model_ms"))

    def decode_again_ms(self) -> float:
        """The same in another worker now that the page has nothing else to do, ms."""
        self.browser.value("decode_again()")
        self.browser.wait("again_ms !== null", DECODED_S)
        return float(self.browser.value("again_ms"))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures, pixels."""
        canvas = "letter.player.faces.canvas"
        width, height = self.browser.value(f"[{canvas}.width, {canvas}.height]")
        return width, height

    def picture(self, index: int) -> Picture:
        """A frame as the page draws it, (height, width, 3) uint8 BGR."""
        data = base64.b64decode(self.browser.value(f"grab({index})"))
        width, height = self.size
        pixels = np.frombuffer(data, np.uint8).reshape(height, width, 4)
        return np.ascontiguousarray(pixels[..., 2::-1])

    def frame_ms(self, count: int) -> float:
        """Mean time of drawing the first frames, ms."""
        return float(self.browser.value(f"time_frames({count})"))

    def play_through(self, updates_s: float) -> PlayedCall:
        """Play the call once, at its speed.

        updates_s: seconds after which another model comes, again and again; 0: none does.
        """
        self.browser.value(f"play_through({updates_s})")
        self.browser.wait("played !== null", PLAYED_S)
        return PlayedCall(**self.browser.value("played"))
