// In the thread of the sound: plays the voice, and listens to the microphone.
const REACH = 6,
  PHASES = 64;
class Voice extends AudioWorkletProcessor {
  constructor({ processorOptions: { rate } }) {
    super();
    this.rate = rate;
    this.kernels = [];
    for (let phase = 0; phase <= PHASES; phase++)
      this.kernels.push(
        Float32Array.from({ length: 2 * REACH }, (_, tap) => {
          const x = tap - REACH + 1 - phase / PHASES,
            edge = Math.cos((Math.PI * x) / (2 * REACH));
          return x ? (Math.sin(Math.PI * x) / (Math.PI * x)) * edge * edge : 1;
        }),
      );
    this.ring = new Float32Array(16 * rate);
    this.position = 0;
    this.anchor = null;
    this.end = -1;
    this.port.onmessage = ({ data }) => {
      if (data.anchor) {
        this.anchor = data.anchor;
        return;
      }
      const first = Math.round(data.time * rate),
        size = this.ring.length;
      for (let i = 0; i < data.samples.length; i++)
        if (first + i >= this.position) this.ring[(first + i) % size] = data.samples[i];
      this.end = first + data.samples.length;
    };
  }
  at(position, index) {
    const size = this.ring.length,
      kernel = this.kernels[Math.round(PHASES * (position - index))];
    let sum = 0;
    for (let tap = 0; tap < 2 * REACH; tap++)
      sum += kernel[tap] * this.ring[(index + tap - REACH + 1 + size) % size];
    return sum;
  }
  process(_inputs, [[output]]) {
    if (!this.anchor) return true;
    const { rate } = this,
      size = this.ring.length;
    const wanted = (this.anchor.source + currentTime - this.anchor.context) * rate;
    const away = wanted - this.position;
    let step = rate / sampleRate;
    if (Math.abs(away) > 0.035 * rate) {
      // What was played is silent by now.
      if (away < -rate || away > size / 2) this.ring.fill(0);
      else for (let i = Math.floor(this.position); i < wanted; i++) this.ring[i % size] = 0;
      this.position = Math.max(0, wanted);
    } else step *= 1 + Math.max(-0.02, Math.min(0.02, (4 * away) / rate));
    let square = 0;
    for (let i = 0; i < output.length; i++) {
      const index = Math.floor(this.position);
      output[i] = this.at(this.position, index);
      square += output[i] * output[i];
      this.position += step;
      for (let k = index; k < Math.floor(this.position); k++)
        this.ring[(k - REACH + size) % size] = 0;
    }
    this.loud = Math.max(square / output.length, 0.9 * (this.loud || 0));
    if (!this.told || currentTime - this.told > 0.1) {
      this.told = currentTime;
      this.port.postMessage({
        away: away / rate,
        loud: Math.sqrt(this.loud),
        time: this.position / rate,
        context: currentTime,
      });
    }
    return true;
  }
}
registerProcessor("voice", Voice);
class Ear extends AudioWorkletProcessor {
  constructor() {
    super();
    this.piece = new Float32Array(Math.round(sampleRate / 50));
    this.count = 0;
  }
  process([[input]]) {
    if (!input) return true;
    for (let i = 0; i < input.length; i++) {
      this.piece[this.count++] = input[i];
      if (this.count === this.piece.length) {
        const end = currentTime + (i + 1) / sampleRate;
        this.port.postMessage({
          samples: this.piece.slice(),
          context: end - this.count / sampleRate,
        });
        this.count = 0;
      }
    }
    return true;
  }
}
registerProcessor("ear", Ear);
