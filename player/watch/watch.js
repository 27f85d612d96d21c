import { FormatError } from "../format/errors.js";
import { VOICES } from "../format/model_packet.js";
import { hasWebAssembly } from "../format/pictures/picture_codec.js";
import { DeliveryReceiver } from "../link/delivery_receiver.js";
import { parseKey } from "../link/invitation.js";
import { SESSION_BYTES } from "../link/messages.js";
import { PlainProtection, SFrameProtection } from "../link/protection.js";
import { runDecodeWorker } from "../page/decode_worker.js";
import { element, fullScreenSwitch } from "../page/elements.js";
import { FaceCanvas } from "../page/face_canvas.js";
import { Presenter } from "../playout/presenter.js";
import { Receiver } from "../playout/receiver.js";
import { VoicePlayer } from "./voice_player.js";
import { warmUp } from "./warm_up.js";

/** @typedef {import("../playout/playout.js").PlayoutFrame} PlayoutFrame */
/** @typedef {import("../playout/received_models.js").ReceivedModel} ReceivedModel */

const TICK_MS = 30;
/** Nothing for so long: the link is lost, or the other end is. */
const SILENT_S = 3;
const RETRY_MS = 1000;
const now = () => performance.now() / 1000;

/** Receives a call over a WebSocket and shows it. */
class Watch {
  /**
   * @param {string} call its name
   * @param {Uint8Array | null} key of the invitation
   * @param {FaceCanvas} faces
   */
  constructor(call, key, faces) {
    this.call = call;
    this.key = key;
    this.faces = faces;
    /** @type {Presenter<PlayoutFrame>} */
    this.presenter = new Presenter();
    this.receiver = new Receiver();
    this.delivery = this.#newDelivery();
    /** @type {WebSocket | null} */
    this.socket = null;
    this.shown = 0;
    /** @type {VoicePlayer | null} of a call whose voice can be played */
    this.voice = null;
    /** what is to be said of the voice; empty: nothing */
    this.voiceState = "";
    /** @type {PlayoutFrame | null} the frame to draw, which waits while its model is being decoded */
    this.due = null;
    /** @type {WeakSet<ReceivedModel>} */
    this.known = new WeakSet();
    this.cameS = -Infinity;
    this.bytes = 0;
    /** @type {Promise<boolean> | null} */
    this.warmUp = null;
    this.#connect();
    setInterval(() => this.#tick(), TICK_MS);
    addEventListener("pagehide", () => this.#send([this.delivery.bye()]));
  }

  #newDelivery() {
    const session = crypto.getRandomValues(new Uint8Array(SESSION_BYTES));
    const guard = this.key
      ? new SFrameProtection(this.key, this.call, session)
      : new PlainProtection(session);
    return new DeliveryReceiver(guard);
  }

  #connect() {
    const address = new URL(`/${this.call}/ws`, location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    address.hash = "";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => this.#receive(new Uint8Array(data));
    socket.onclose = () => setTimeout(() => this.#connect(), RETRY_MS);
    this.socket = socket;
  }

  /** @param {Uint8Array[]} payloads */
  #send(payloads) {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    for (const payload of payloads) this.socket.send(payload.slice());
  }

  /** @param {Uint8Array} payload */
  #receive(payload) {
    this.bytes += payload.length;
    try {
      for (const arrival of this.delivery.receive(payload, now())) {
        this.cameS = now();
        this.#show(this.receiver.receive(arrival, now()));
      }
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
    }
    this.#send(this.delivery.payloads(now()));
  }

  #tick() {
    this.#show(this.receiver.poll(now()));
    this.#send(this.delivery.payloads(now()));
    // Once the encoder has answered: a thin link takes seconds for its model.
    if (this.delivery.call) this.warmUp ??= warmUp(this.faces);
  }

  /** @param {PlayoutFrame[]} frames */
  #show(frames) {
    for (const received of [...this.receiver.models, ...frames.map((frame) => frame.received)]) {
      if (this.known.has(received)) continue;
      this.known.add(received);
      this.faces.addModel(received);
    }
    this.presenter.push(frames, now());
    this.#hear();
  }

  /** Play what has been said. */
  #hear() {
    const { voice } = this.receiver;
    const speech = this.receiver.takeSpeech();
    if (voice === VOICES.OFF) return;
    if (voice !== VOICES.OPUS) {
      this.voiceState = "The voice of this call (Codec2) cannot be played here.";
    } else if (this.voice) {
      this.voice.push(speech, now());
    } else if (!this.voiceState) {
      this.#openVoice();
    }
  }

  #openVoice() {
    try {
      this.voice = new VoicePlayer(this.presenter.delay);
      this.voice.open().catch((error) => this.#noVoice(error));
    } catch (error) {
      this.#noVoice(error);
    }
  }

  /** @param {unknown} error */
  #noVoice(error) {
    console.error(error);
    this.voice = null;
    this.voiceState = "The voice of this call cannot be played in this browser.";
  }

  /** Draw the frame whose turn it is, and so on. */
  run() {
    this.due = this.presenter.due(now()) ?? this.due;
    if (this.due && this.faces.draw(this.due.received, this.due)) {
      this.shown++;
      this.due = null;
    }
    requestAnimationFrame(() => this.run());
  }

  /** How it goes, in words. */
  get state() {
    if (this.receiver.ended || this.delivery.hasLeft) return "The call has ended.";
    if (!this.delivery.call) return "Waiting for the call ...";
    if (!this.shown) return "The face is coming ...";
    return now() - this.cameS > SILENT_S ? "Nothing comes." : "";
  }
}

async function start() {
  const call = decodeURIComponent(location.pathname.slice(1));
  element("name", HTMLElement).textContent = call;
  const message = element("message", HTMLParagraphElement);
  const about = element("about", HTMLParagraphElement);
  const sound = element("sound", HTMLButtonElement);
  const canvas = element("picture", HTMLCanvasElement);
  try {
    const key = location.hash.length > 1 ? parseKey(location.hash.slice(1)) : null;
    if (!hasWebAssembly()) throw new FormatError("this browser has no WebAssembly");
    const data = await (await fetch("/player.bin")).arrayBuffer();
    const script = /** @type {HTMLScriptElement} */ (document.querySelector("script[src]")).src;
    const faces = new FaceCanvas(canvas, data, new Worker(script));
    if (!faces.gl) throw new FormatError("this browser has no WebGL 2");
    const watch = new Watch(call, key, faces);
    Object.assign(window, { watch });
    watch.run();
    for (const touch of ["pointerdown", "keydown"])
      addEventListener(touch, () => watch.voice?.resume());
    setInterval(() => {
      message.textContent = watch.state || watch.voiceState;
      sound.hidden = !watch.voice || watch.voice.isHeard;
      about.textContent = watch.bytes ? `${(watch.bytes / 1e3).toFixed(1)} kB so far` : "";
    }, 250);
  } catch (error) {
    if (!(error instanceof FormatError)) throw error;
    message.textContent = `The call cannot be watched: ${error.message}.`;
  }
  fullScreenSwitch();
}

if (typeof document === "undefined") runDecodeWorker();
else start();
