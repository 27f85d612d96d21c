// Sound is played on the clock of the pictures: the worklet holds the samples by their time in the source, and is
// told now and then which time is to be heard when.  It goes a little faster or slower, or jumps, to get there, and
// from the rate of the voice to that of the sound card: between samples it takes a windowed sinc.
const WORKLET = "voice_worklet.js";
// From the moment at which sound is given to the worklet until it is there.
const SOUND_MARGIN_S = 0.015;

const voice = {
  rate: 0,
  /** @type {any} */
  context: null,
  /** @type {any} */
  node: null,
  /** What the worklet has told last.
   * @type {{away: number, loud: number, time: number, context: number} | null} */
  heard: null,
  /** @type {Promise<void> | null} */
  opening: null,
  /** @param {number} rate */
  async open(rate) {
    this.rate = rate;
    // At the rate of the sound card: at that of the voice it takes longer to the loudspeaker.
    this.context = new AudioContext({ latencyHint: "interactive" });
    await this.context.audioWorklet.addModule(WORKLET);
    this.node = new AudioWorkletNode(this.context, "voice", {
      numberOfInputs: 0,
      outputChannelCount: [1],
      processorOptions: { rate },
    });
    this.node.port.onmessage = ({ data }) => {
      this.heard = data;
    };
    this.node.connect(this.context.destination);
    setInterval(() => this.align(), 100);
    const show = () => {
      el("sound").hidden = this.context.state === "running";
    };
    this.context.onstatechange = show;
    show();
  },
  // A browser plays nothing before somebody has touched the page.
  resume() {
    if (this.context && this.context.state !== "running") this.context.resume();
  },
  align() {
    const { offset } = players[OTHER],
      stamp = this.context.getOutputTimestamp();
    if (offset === null || !this.context.currentTime) return;
    const known = stamp.performanceTime > 0;
    const at = known ? stamp.performanceTime / 1000 : now(),
      context = known ? stamp.contextTime : this.context.currentTime;
    this.node.port.postMessage({ anchor: { context, source: at - offset } });
  },
  /** rate: Hz.  time: of the first sample in the source, seconds.
   * @param {number} rate
   * @param {number} time
   * @param {Float32Array} samples */
  async play(rate, time, samples) {
    if (!this.opening) this.opening = this.open(rate);
    await this.opening;
    if (rate !== this.rate) return;
    const latency = (this.context.outputLatency || 0) + SOUND_MARGIN_S;
    players[OTHER].arrived(time, latency);
    this.node.port.postMessage({ time, samples });
  },
};
addEventListener("pointerdown", () => voice.resume());
addEventListener("keydown", () => voice.resume());
