// Camera and microphone of this page.
/** @typedef {"camera" | "microphone"} Kind */

/** A message to the program, see `risorius/call_page/messages.py`.
 * @param {number} stream
 * @param {number} count
 * @param {number} time
 * @param {number} made
 * @param {ArrayBuffer} bytes */
function message(stream, count, time, made, bytes) {
  const data = new Uint8Array(HEADER_BYTES + bytes.byteLength),
    view = new DataView(data.buffer);
  view.setUint8(0, stream);
  view.setUint32(4, count, true);
  view.setFloat64(8, time, true);
  view.setFloat64(16, made, true);
  data.set(new Uint8Array(bytes), HEADER_BYTES);
  return data;
}
/** @param {Uint8Array<ArrayBuffer>} data */
function give(data) {
  // What waits longer is of no use any more.
  if (socket.readyState === WebSocket.OPEN && socket.bufferedAmount < 400000) socket.send(data);
}
// From the time of a sound card to that of the page.  The piece that has come most quickly tells their difference,
// which changes slowly; `rise` is by how much at most with each piece, ms.  latency: of the card, seconds.
class CardClock {
  /** @param {number} latency */
  constructor(latency) {
    this.latency = latency;
    this.difference = Infinity;
    this.rise = 0.02;
  }
  /** When the end of a piece that comes now was heard, ms since 1970; context: the same by the card, seconds.
   * @param {number} context */
  heard(context) {
    const late = performance.timeOrigin + performance.now() - 1000 * context;
    this.difference = Math.min(late, this.difference + this.rise);
    return 1000 * (context - this.latency) + this.difference;
  }
}
const CAMERA_FPS = 25,
  CAMERA_WIDTH = 640,
  CAMERA_HEIGHT = 480,
  CAMERA_QUALITY = 0.92;
const REOPEN_MS = 1000;
const KINDS = {
  camera: {
    name: "camera",
    list: "cameras",
    kind: "videoinput",
    /** @param {string} [id] */
    wanted: (id) => ({
      video: { width: CAMERA_WIDTH, height: CAMERA_HEIGHT, frameRate: CAMERA_FPS, ...chosen(id) },
    }),
  },
  microphone: {
    name: "microphone",
    list: "microphones",
    kind: "audioinput",
    /** @param {string} [id] */
    wanted: (id) => ({
      audio: {
        echoCancellation: true,
        noiseSuppression: true,
        autoGainControl: true,
        ...chosen(id),
      },
    }),
  },
};
/** @param {string} [id]
 * @returns {MediaTrackConstraints} */
const chosen = (id) => (id ? { deviceId: { exact: id } } : {});
// Camera and microphone, each by itself: one that is missing or denied does not take the other.
const devices = {
  // Their streams.
  /** @type {MediaStream | null} */
  camera: null,
  /** @type {MediaStream | null} */
  microphone: null,
  /** @type {Partial<Record<Kind, string>>} */
  reasons: {},
  /** @type {Partial<Record<Kind, boolean>>} */
  opening: {},
  /** @type {number | undefined} */
  rate: undefined,
  /** @type {Worker | null} */
  worker: null,
  /** @type {AudioContext | null} */
  ear: null,
  count: 0,
  get stream() {
    return this.camera || this.microphone;
  },
  /** @param {any} setup */
  async open(setup) {
    this.rate = setup.microphone_hz;
    const wanted = [setup.camera && "camera", setup.microphone_hz > 0 && "microphone"].filter(
      Boolean,
    );
    await Promise.all(wanted.map((kind) => this[kind] || this.openOne(kind)));
  },
  /** @param {Kind} kind
   * @param {string} [id] */
  async openOne(kind, id) {
    if (this.opening[kind] || ended) return;
    this.opening[kind] = true;
    try {
      const stream = await navigator.mediaDevices.getUserMedia(KINDS[kind].wanted(id));
      this.stop(kind);
      this[kind] = stream;
      const [track] = stream.getTracks();
      track.onended = () => this.lose(kind);
      if (kind === "camera") await this.openCamera(stream);
      else await this.openMicrophone(stream, this.rate ?? 0);
      delete this.reasons[kind];
    } catch (cause) {
      const error = /** @type {DOMException} */ (cause);
      this.reasons[kind] =
        error.name === "NotAllowedError"
          ? `The browser may not use the ${kind}: allow it.`
          : error.name === "NotFoundError"
            ? `There is no ${kind}.`
            : `The ${kind} does not open: ${error.message || error.name}.`;
    }
    this.opening[kind] = false;
    this.show();
    this.list();
  },
  // A device that was pulled out, or taken by another program.
  /** @param {Kind} kind */
  lose(kind) {
    this.stop(kind);
    this.reasons[kind] = `The ${kind} has stopped; it is opened again.`;
    this.show();
    setTimeout(() => {
      if (!this[kind]) this.openOne(kind);
    }, REOPEN_MS);
  },
  /** @param {Kind} kind */
  stop(kind) {
    const stream = this[kind];
    this[kind] = null;
    if (stream)
      for (const track of stream.getTracks()) {
        track.onended = null;
        track.stop();
      }
    if (kind === "camera" && this.worker) {
      this.worker.terminate();
      this.worker = null;
    }
    if (kind === "microphone" && this.ear) {
      this.ear.close();
      this.ear = null;
    }
  },
  close() {
    for (const kind of /** @type {Kind[]} */ (Object.keys(KINDS))) this.stop(kind);
  },
  retry() {
    for (const kind of /** @type {Kind[]} */ (Object.keys(this.reasons)))
      if (!this[kind]) this.openOne(kind);
  },
  show() {
    const reasons = Object.values(this.reasons);
    el("missing").hidden = !reasons.length;
    el("reasons").textContent = reasons.join(" ");
  },
  // The choice among several cameras and microphones; their names are known once one of them may be used.
  async list() {
    const all = await navigator.mediaDevices.enumerateDevices();
    for (const [kind, { list, kind: type }] of Object.entries(KINDS)) {
      const known = all.filter((each) => each.kind === type && each.deviceId),
        select = el(list);
      const used = this[kind]?.getTracks()[0].getSettings().deviceId;
      select.replaceChildren(
        ...known.map(
          (each) => new Option(each.label || kind, each.deviceId, false, each.deviceId === used),
        ),
      );
      select.hidden = known.length < 2;
    }
    el("level").hidden = !this.microphone;
    el("own").hidden = ["cameras", "microphones", "level"].every((id) => el(id).hidden);
  },
  /** @param {ArrayBuffer} bytes
   * @param {number} made */
  give(bytes, made) {
    if (el("camera-off").getAttribute("aria-pressed") === "true") return;
    give(message(CAMERA, this.count, this.count / CAMERA_FPS, made, bytes));
    this.count++;
  },
  /** @param {MediaStream} stream */
  async openCamera(stream) {
    const video = el("camera"),
      [track] = stream.getVideoTracks();
    video.srcObject = stream;
    video.play().catch(() => {});
    const { MediaStreamTrackProcessor } = /** @type {any} */ (window);
    if (!MediaStreamTrackProcessor) return this.takeWhileShown(video);
    const { readable } = new MediaStreamTrackProcessor({ track, maxBufferSize: 1 });
    this.worker = new Worker("camera_worker.js");
    this.worker.onmessage = ({ data }) => this.give(data.bytes, data.made);
    this.worker.postMessage({ readable, quality: CAMERA_QUALITY }, [readable]);
  },
  // For browsers without frames of a track: the camera rests while the tab is hidden.
  /** @param {any} video */
  takeWhileShown(video) {
    const canvas = document.createElement("canvas"),
      context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d")),
      { srcObject } = video;
    let busy = false;
    /** @param {number} at
     * @param {{captureTime?: number}} frame */
    const take = (at, frame) => {
      if (video.srcObject !== srcObject) return;
      video.requestVideoFrameCallback(take);
      if (busy || !video.videoWidth) return;
      busy = true;
      canvas.width = video.videoWidth;
      canvas.height = video.videoHeight;
      context.drawImage(video, 0, 0);
      const made = performance.timeOrigin + (frame.captureTime || at);
      canvas.toBlob(
        async (blob) => {
          if (blob) this.give(await blob.arrayBuffer(), made);
          busy = false;
        },
        "image/jpeg",
        CAMERA_QUALITY,
      );
    };
    video.requestVideoFrameCallback(take);
  },
  /** @param {MediaStream} stream
   * @param {number} rate */
  async openMicrophone(stream, rate) {
    const context = new AudioContext({ sampleRate: rate });
    this.ear = context;
    await context.audioWorklet.addModule(WORKLET);
    const ear = new AudioWorkletNode(context, "ear", {
      numberOfOutputs: 0,
      channelCount: 1,
      channelCountMode: "explicit",
    });
    /** @type {MediaTrackSettings & {latency?: number}} */
    const settings = stream.getAudioTracks()[0].getSettings();
    const clock = new CardClock(settings.latency ?? 0);
    ear.port.onmessage = ({ data }) => {
      const length = (1000 * data.samples.length) / rate;
      const begin = clock.heard(data.context + length / 1000) - length;
      const pcm = Int16Array.from(
        data.samples,
        (value) => Math.max(-1, Math.min(1, value)) * 32767,
      );
      const loud = Math.sqrt(
        data.samples.reduce((sum, value) => sum + value * value, 0) / data.samples.length,
      );
      el("level").value = Math.max(Math.min(1, 3 * loud), 0.8 * el("level").value);
      give(message(MICROPHONE, rate, data.context, begin, pcm.buffer));
    };
    context.createMediaStreamSource(stream).connect(ear);
    addEventListener("pointerdown", () => context.resume());
    addEventListener("keydown", () => context.resume());
  },
};
el("retry").onclick = () => devices.retry();
for (const kind of /** @type {Kind[]} */ (Object.keys(KINDS)))
  el(KINDS[kind].list).onchange = () => devices.openOne(kind, el(KINDS[kind].list).value);
if (navigator.mediaDevices)
  navigator.mediaDevices.addEventListener("devicechange", () => {
    if (devices.rate !== undefined) {
      devices.retry();
      devices.list();
    }
  });
