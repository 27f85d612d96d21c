// Decodes Opus where it is loaded: a script of its own, which only calls with such a voice need.
import { OpusDecoder } from "opus-decoder";

Object.assign(window, {
  /** What decodes the frames of one voice, once it is ready. */
  openOpusDecoder: async () => {
    const decoder = new OpusDecoder({ sampleRate: 48000, channels: 1 });
    await decoder.ready;
    return decoder;
  },
});
