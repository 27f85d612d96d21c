import { FormatError } from "../format/errors.js";
import { hasWebAssembly } from "../format/pictures/picture_codec.js";
import { runDecodeWorker } from "../page/decode_worker.js";
import { element, fullScreenSwitch } from "../page/elements.js";
import { CallPlayer } from "./call_player.js";
import { PlayClock } from "./clock.js";

/**
 * What the page has in it; sound: a WebM file, or nothing.
 * @typedef {{script: string, data: ArrayBuffer, call: Uint8Array, sound: Uint8Array<ArrayBuffer>}} Contents
 */

/** Seconds by which the arrow keys go on. */
const KEY_STEP_S = 2;

/** @param {number} seconds */
function clockTime(seconds) {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** @param {number} bytes */
function size(bytes) {
  return bytes < 1e3 ? `${bytes} bytes` : `${(bytes / 1e3).toFixed(bytes < 1e5 ? 1 : 0)} kB`;
}

/** The page of a letter: a call with buttons below it. */
class LetterPage {
  /**
   * @param {CallPlayer} player
   * @param {HTMLAudioElement | null} sound
   */
  constructor(player, sound) {
    this.player = player;
    this.sound = sound;
    this.clock = new PlayClock(player.durationS, sound);
    this.drawn = -1;
    this.play = element("play", HTMLButtonElement);
    this.place = element("place", HTMLInputElement);
    this.time = element("time", HTMLOutputElement);
    this.message = element("message", HTMLParagraphElement);
    this.place.max = String(player.durationS);
    const { call, frames } = player;
    const { width, height } = frames[0].received.model.call;
    const length = `${player.durationS.toFixed(1)} s of ${width}x${height}`;
    element("about", HTMLParagraphElement).textContent = `${length} in ${size(call.bytes)}`;
    player.faces.onStep = () => {
      this.drawn = -1;
    };
    this.#listen();
  }

  #listen() {
    const { clock } = this;
    this.play.onclick = () => this.#toggle();
    element("picture", HTMLCanvasElement).onclick = () => this.#toggle();
    this.place.oninput = () => clock.seek(Number(this.place.value));
    const speed = element("speed", HTMLSelectElement);
    speed.onchange = () => clock.setSpeed(Number(speed.value));
    const loop = element("loop", HTMLButtonElement);
    loop.onclick = () => {
      clock.loops = !clock.loops;
      loop.setAttribute("aria-pressed", String(clock.loops));
    };
    const toggleFullScreen = fullScreenSwitch();
    document.addEventListener("keydown", (event) => this.#key(event, toggleFullScreen));
  }

  /**
   * @param {KeyboardEvent} event
   * @param {() => void} toggleFullScreen
   */
  #key(event, toggleFullScreen) {
    const { clock } = this;
    if (event.target instanceof HTMLSelectElement || event.ctrlKey || event.metaKey) return;
    const isButton = event.target instanceof HTMLButtonElement;
    if (event.key === " " && !isButton) this.#toggle();
    else if (event.key === "ArrowLeft") clock.seek(clock.timeS - KEY_STEP_S);
    else if (event.key === "ArrowRight") clock.seek(clock.timeS + KEY_STEP_S);
    else if (event.key === "f" || event.key === "F") toggleFullScreen();
    else return;
    event.preventDefault();
  }

  #toggle() {
    if (this.clock.isPlaying) this.clock.pause();
    else this.clock.play();
  }

  /** Show the frame whose time it is, and so on. */
  run() {
    const { clock, player } = this;
    clock.turnAround();
    const { timeS } = clock;
    const index = player.frameAt(timeS);
    if (index !== this.drawn && player.draw(index)) this.drawn = index;
    this.place.value = String(timeS);
    this.time.textContent = `${clockTime(timeS)} / ${clockTime(player.durationS)}`;
    const label = clock.isPlaying ? "Pause" : "Play";
    if (this.play.title !== label) {
      this.play.title = label;
      this.play.setAttribute("aria-label", label);
      this.play.classList.toggle("playing", clock.isPlaying);
    }
    this.message.textContent = this.drawn === index ? player.damage : "One moment ...";
    requestAnimationFrame(() => this.run());
  }
}

/**
 * What plays a WebM file.
 * @param {Uint8Array<ArrayBuffer>} file
 */
function voiceOf(file) {
  const audio = new Audio(URL.createObjectURL(new Blob([file], { type: "audio/webm" })));
  audio.preload = "auto";
  return audio;
}

/**
 * Show a letter on the page.
 * @param {Contents} contents
 */
function openLetter({ script, data, call, sound }) {
  const message = element("message", HTMLParagraphElement);
  if (!hasWebAssembly()) {
    message.textContent = "This browser cannot decode the letter: it has no WebAssembly.";
    return;
  }
  try {
    const worker = new Worker(script);
    const canvas = element("picture", HTMLCanvasElement);
    const player = new CallPlayer(canvas, call, data, worker);
    if (!player.faces.gl) {
      message.textContent = "This browser cannot draw the letter: it has no WebGL 2.";
      return;
    }
    const page = new LetterPage(player, sound.length ? voiceOf(sound) : null);
    Object.assign(window, { letter: page });
    page.run();
  } catch (error) {
    if (!(error instanceof FormatError)) throw error;
    message.textContent = `This letter cannot be shown: ${error.message}`;
  }
}

if (typeof document === "undefined") runDecodeWorker();
else Object.assign(window, { openLetter });
