/** @param {DataView} view
 * @param {ArrayBuffer} data */
function receiveSound(view, data) {
  if (!first.is) return;
  const pcm = new Int16Array(data.slice(HEADER_BYTES));
  const samples = Float32Array.from(pcm, (value) => value / 32768);
  const rate = view.getUint32(4, true),
    time = view.getFloat64(8, true);
  if (tape.is) tape.sounds.push({ time, samples });
  if (tape.isTouched) return;
  voice.play(rate, time, samples).catch(() => {});
}

/** @param {ArrayBuffer} data */
function receivePicture(data) {
  const view = new DataView(data),
    kind = view.getUint8(0) & (FACE | MODEL),
    stream = view.getUint8(0) - kind,
    player = stream === OTHER || stream === SELF ? players[stream] : null;
  if (stream === VOICE) return receiveSound(view, data);
  if (!player) return;
  if (kind === MODEL) return player.drawer?.addModel(data);
  const shown =
    kind === FACE
      ? { face: faces.parse(data, HEADER_BYTES) }
      : { jpeg: new Uint8Array(data, HEADER_BYTES) };
  const picture = {
    frozen: view.getUint8(1),
    index: view.getUint32(4, true),
    time: view.getFloat64(8, true),
    made: view.getFloat64(16, true),
    waited: view.getUint16(2, true),
    came: performance.timeOrigin + performance.now(),
    ...shown,
  };
  if (tape.is && stream === OTHER) tape.add({ ...picture });
  if (!(tape.isTouched && stream === OTHER)) player.receive(picture);
}
function draw() {
  for (const player of Object.values(players)) player.tick();
  tape.tick();
  const { frozen, isSlow } = players[OTHER];
  el("note").hidden = !frozen && !isSlow;
  if (isSlow) el("note").textContent = "this computer is too slow: pictures are left out";
  else if (frozen)
    el("note").textContent = frozen === 2 ? "nothing comes" : "no face in the picture";
  const seesSelf = players[SELF].shown > 0;
  el("self").hidden = ended || !seesSelf;
  el("camera").hidden = seesSelf || !devices.camera;
  requestAnimationFrame(draw);
}
requestAnimationFrame(draw);

// Of a call both ways: since when the other one is seen, seconds.
/** @type {number | null} */
let connectedAt = null;
let isOtherMuted = false;
function showConnected() {
  if (connectedAt === null) return;
  const passed = Math.floor(now() - connectedAt),
    seconds = String(passed % 60).padStart(2, "0");
  el("state").textContent =
    `connected, ${Math.floor(passed / 60)}:${seconds}${isOtherMuted ? " · muted" : ""}`;
}
setInterval(showConnected, 500);
/** @param {{text: string, name?: string, over?: string, muted?: boolean, trouble?: boolean}} state */
function say(state) {
  isOtherMuted = !!state.muted;
  el("state").textContent = state.text;
  if (state.text || !first.setup) connectedAt = null;
  else if (connectedAt === null) connectedAt = now();
  showConnected();
  el("state").classList.toggle("trouble", !!state.trouble);
  if (state.name) {
    el("name").textContent = state.name;
    document.title = `${state.name} · Risorius`;
  }
  el("words").textContent = state.over || "";
  el("over").hidden = !state.over;
  el("invitation").hidden = !el("invitation").children.length || !/waiting/.test(state.text);
}
const MAX_DELAY_MS = 10000;
/** @param {{text: string, delay_ms?: number}} costs */
function showCosts(costs) {
  const wait = players[OTHER].wait;
  // What cannot be is not shown: a picture of another call, or of a page that was asleep.
  const isKnown = wait !== undefined && wait >= 0 && wait < MAX_DELAY_MS;
  const delay = costs.delay_ms && isKnown ? ` · delay ${Math.round(costs.delay_ms + wait)} ms` : "";
  el("costs").textContent = costs.text + delay;
}
/** @type {number | undefined} */
let newsTimer;
/** @param {{text: string}} news */
function showNews(news) {
  el("news").textContent = news.text;
  el("news").hidden = false;
  clearTimeout(newsTimer);
  newsTimer = setTimeout(() => {
    el("news").hidden = true;
  }, 8000);
}

// Two soft tones when somebody calls.
/** @type {AudioContext | null} */
let chimes = null;
function chime() {
  chimes = chimes ?? new AudioContext();
  const context = voice.context ?? chimes;
  if (context.state !== "running") return;
  [660, 880].forEach((pitch, i) => {
    const tone = new OscillatorNode(context, { frequency: pitch }),
      gain = new GainNode(context, { gain: 0 });
    const at = context.currentTime + 0.25 * i;
    gain.gain.setValueAtTime(0, at);
    gain.gain.linearRampToValueAtTime(0.15, at + 0.02);
    gain.gain.exponentialRampToValueAtTime(0.001, at + 0.5);
    tone.connect(gain).connect(context.destination);
    tone.start(at);
    tone.stop(at + 0.5);
  });
}

const SWITCHES = ["mute", "camera-off", "face", "record"];
/** @param {any} setup */
function setUp(setup) {
  const shown = {
    mute: setup.has_voice,
    "camera-off": true,
    face: setup.has_face,
    record: true,
    "hang-up": true,
  };
  for (const [name, is] of Object.entries(shown)) el(name).hidden = !is;
  const on = {
    mute: setup.mute,
    "camera-off": setup.camera_off,
    face: setup.face,
    record: setup.recording,
  };
  for (const [name, is] of Object.entries(on)) el(name).setAttribute("aria-pressed", is);
  el("mute").firstChild.textContent = setup.mute ? "Muted" : "Mute";
  el("camera-off").firstChild.textContent = setup.camera_off ? "Camera is off" : "Camera off";
  el("record").firstChild.textContent = setup.recording ? "Recording" : "Record";
  first.setup = setup;
  first.give();
}
// Of several tabs the first has camera, microphone and sound; when it is closed another one takes them over.  A window
// for other programs has the sound besides.
const first = {
  is: false,
  /** @type {any} */
  setup: null,
  give() {
    const { setup } = this;
    if (this.is && !isWindow && setup && (setup.camera || setup.microphone_hz)) devices.open(setup);
  },
  take() {
    this.is = true;
    this.give();
    return new Promise(() => {});
  },
  async ask() {
    if (isWindow) this.is = true;
    else
      await navigator.locks.request("call", { ifAvailable: true }, (lock) =>
        lock ? this.take() : this.wait(),
      );
  },
  wait() {
    showNews({
      text: "Another tab has the sound, camera and microphone of this call; this one watches and steers.",
    });
    navigator.locks.request("call", () => this.take());
  },
};
for (const name of SWITCHES)
  el(name).onclick = () => command(name, { on: el(name).getAttribute("aria-pressed") !== "true" });
el("hang-up").onclick = () => command("hang-up");
el("sound").onclick = () => voice.resume();

/** watch: what the QR code says, where it is not the text.
 * @param {{text: string, svg: string, watch?: string}} invitation */
function showInvitation({ text, svg, watch }) {
  const line = document.createElement("code"),
    copy = document.createElement("button");
  line.textContent = text;
  copy.type = "button";
  copy.append("Copy");
  copy.onclick = async () => {
    await navigator.clipboard.writeText(text);
    copy.textContent = "Copied";
  };
  el("invitation").innerHTML = svg;
  el("invitation").append(line, copy);
  if (watch) {
    const note = document.createElement("p");
    note.append("A phone that scans this watches.");
    el("invitation").append(note);
  }
}

let wasCalling = false;
/** @param {{text: string}} state */
function showState(state) {
  const calling = /is calling/.test(state.text);
  if (calling && !wasCalling) chime();
  wasCalling = calling;
  say(state);
}
function stopGiving() {
  devices.close();
  showNews({ text: "Another browser gives camera and microphone already." });
}
// A recorded call is shown: it can be stopped, gone through, and played again.
function startTape() {
  tape.is = true;
  el("tape").hidden = false;
}
// Faces come: this page draws them, where it can.
async function drawFaces() {
  const isForced = new URLSearchParams(location.search).has("draws");
  if (isWindow) return;
  if (!faces.canDraw(isForced)) {
    // Other news stay.
    if (el("news").hidden)
      showNews({
        text: "risorius draws the pictures: this browser has no WebGL 2 on a graphics card.",
      });
    return;
  }
  const answer = await fetch("player.bin");
  if (!answer.ok) return;
  const data = await answer.arrayBuffer();
  // What has come of a recorded call can be seen again.
  const kept = tape.is ? Number.MAX_SAFE_INTEGER : undefined;
  for (const player of Object.values(players)) player.drawer ??= faces.make(data, kept);
  command("draws");
}
/** @type {Record<string, (message: any) => void>} */
const receivers = {
  faces: drawFaces,
  tape: startTape,
  state: showState,
  costs: showCosts,
  setup: setUp,
  invitation: showInvitation,
  news: showNews,
  trouble: showNews,
  busy: stopGiving,
  ended: leave,
};
const isWindow = new URLSearchParams(location.search).has("window");

/** @type {WebSocket} */
let socket;
let ended = false;
// Nothing can be done any more: no live buttons, no costs of a call that is over.
function end() {
  ended = true;
  devices.close();
  el("costs").textContent = "";
  for (const id of ["missing", "own", "self", "camera"]) el(id).hidden = true;
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (
    document.querySelectorAll("nav button")
  ))
    button.hidden = button.id !== "full";
  const again = first.setup ? " To call again, start risorius again." : "";
  say({
    text: "the call has ended",
    trouble: false,
    over: tape.is ? "" : `The call has ended.${again}`,
  });
}
function leave() {
  end();
  socket.close();
}
function connect() {
  const here = new URL("ws", location.href);
  here.protocol = "ws:";
  here.search = "";
  socket = new WebSocket(here);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => {
    if (data instanceof ArrayBuffer) return receivePicture(data);
    const message = JSON.parse(data),
      receive = receivers[message.kind];
    if (receive) receive(message);
  };
  socket.onclose = (event) => {
    if (ended) return;
    if (event.code === 1001) return end();
    say({ text: "risorius does not answer, trying again", trouble: true, over: "" });
    setTimeout(connect, 1000);
  };
}
/** @param {string} name
 * @param {object} content */
function command(name, content = {}) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ kind: name, ...content }));
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else el("stage").requestFullscreen();
}
el("full").onclick = fullScreen;
/** @type {Record<string, string>} */
const keys = {
  " ": "play",
  f: "full",
  m: "mute",
  c: "camera-off",
  a: "face",
  r: "record",
  h: "hang-up",
  s: "sound",
};
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const button = el(keys[event.key.toLowerCase()]);
  // The space bar presses the button that has the focus, and plays a tape.
  const isForButton = event.key === " " && (!tape.is || event.target instanceof HTMLButtonElement);
  if (tape.is && /^Arrow(Left|Right)$/.test(event.key)) {
    event.preventDefault();
    return tape.touch(
      tape.current + (event.key === "ArrowLeft" ? -5 : 5),
      tape.isTouched ? tape.isPlaying : true,
    );
  }
  if (button && !button.hidden && !isForButton) {
    event.preventDefault();
    button.click();
  }
});
document.body.classList.toggle("window", isWindow);
first.ask();
connect();
