/** @typedef {import("../playout/playout_delay.js").PlayoutDelay} PlayoutDelay */
/** A frame of 40 ms and when it is heard, seconds from the start of the source. @typedef {{timeS: number, data: Uint8Array}} Speech */
/** What `opus.js` opens. @typedef {{decodeFrame: (data: Uint8Array) => {channelData: Float32Array[], samplesDecoded: number}}} OpusDecoder */

const SCRIPT = "/opus.js";
const RATE_HZ = 48000;
const FRAME_S = 0.04;
const FRAME_SAMPLES = FRAME_S * RATE_HZ;
/** From the moment at which a frame is handed over until it can be heard, beside the sound card's latency. */
const MARGIN_S = 0.02;
/** Speech so much off the time of the pictures jumps there, so much it goes this part faster or slower. */
const JUMP_S = 0.06;
const OFF_S = 0.005;
const BEND = 0.02;
/** Speech after a silence fades in over so many samples. */
const FADE_IN = 240;

/** Plays a voice in Opus at the times of the pictures of its call. */
export class VoicePlayer {
  /** @param {PlayoutDelay} delay of the pictures, which wait for the voice as it does for them */
  constructor(delay) {
    this.delay = delay;
    /** @type {OpusDecoder | null} null until it has been loaded */
    this.decoder = null;
    // At the rate of the voice: pieces of another one would not join.
    this.context = new AudioContext({ latencyHint: "interactive", sampleRate: RATE_HZ });
    this.sound = this.context.createGain();
    this.sound.connect(this.context.destination);
    /** frames that have been played, and that were too late or damaged */
    this.played = 0;
    this.left = 0;
    /** by how much the newest frame was off the time of the pictures, seconds */
    this.offS = 0;
    /** time in the source and in the sound at which the newest frame ends */
    this.endS = -Infinity;
    this.nextS = 0;
  }

  /** Load what decodes. */
  async open() {
    const script = document.createElement("script");
    script.src = SCRIPT;
    await new Promise((resolve, reject) => {
      script.onload = resolve;
      script.onerror = () => reject(new Error("what decodes it has not come"));
      document.head.append(script);
    });
    this.decoder = await /** @type {any} */ (window).openOpusDecoder();
  }

  /** Whether it is heard: a browser plays nothing before somebody has touched the page. */
  get isHeard() {
    return this.context.state === "running";
  }

  /** Be heard from now on; to be called when somebody touches the page. */
  resume() {
    this.context.resume();
  }

  /**
   * Play frames that have come, in order.
   * @param {Speech[]} speech
   * @param {number} nowS
   */
  push(speech, nowS) {
    const latencyS = this.isHeard ? (this.context.outputLatency || 0) + MARGIN_S : 0;
    for (const { timeS, data } of speech) {
      this.delay.arrived(timeS, nowS, latencyS);
      const samples = this.#decoded(data);
      if (samples && this.isHeard) this.#play(samples, timeS, nowS);
      else this.left++;
    }
  }

  /** @param {Uint8Array} data */
  #decoded(data) {
    if (!this.decoder) return null;
    const { channelData, samplesDecoded } = this.decoder.decodeFrame(data);
    return samplesDecoded === FRAME_SAMPLES ? channelData[0] : null;
  }

  /**
   * The time in the sound at which a time of the source is due.
   * @param {number} timeS
   * @param {number} nowS
   */
  #dueS(timeS, nowS) {
    const { contextTime = 0, performanceTime = 0 } = this.context.getOutputTimestamp();
    const pageS = timeS + (this.delay.offset ?? 0);
    if (performanceTime > 0) return contextTime + pageS - performanceTime / 1000;
    return this.context.currentTime + pageS - nowS;
  }

  /**
   * @param {Float32Array} samples
   * @param {number} timeS
   * @param {number} nowS
   */
  #play(samples, timeS, nowS) {
    const dueS = this.#dueS(timeS, nowS);
    const follows = Math.abs(timeS - this.endS) < 1e-3;
    this.offS = follows ? this.nextS - dueS : 0;
    const goesOn = follows && Math.abs(this.offS) < JUMP_S;
    const startS = goesOn ? this.nextS : dueS;
    this.endS = timeS + FRAME_S;
    const bend = Math.abs(this.offS) < OFF_S ? 0 : BEND * Math.sign(this.offS);
    const speed = goesOn ? 1 + bend : 1;
    this.nextS = startS + FRAME_S / speed;
    if (startS < this.context.currentTime) {
      this.left++;
      return;
    }
    const buffer = this.context.createBuffer(1, FRAME_SAMPLES, RATE_HZ);
    const own = buffer.getChannelData(0);
    own.set(samples);
    if (!goesOn) for (let i = 0; i < FADE_IN; i++) own[i] *= i / FADE_IN;
    const source = this.context.createBufferSource();
    source.buffer = buffer;
    source.playbackRate.value = speed;
    source.connect(this.sound);
    source.start(startS);
    this.played++;
  }
}
