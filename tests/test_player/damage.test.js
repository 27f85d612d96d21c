import assert from "node:assert/strict";
import { test } from "node:test";
import { ModelDecoder } from "../../player/draw/model_decoder.js";
import { packetsOf } from "../../player/format/call_file.js";
import { FormatError } from "../../player/format/errors.js";
import { parsePacket } from "../../player/format/packets.js";
import { parseTiles } from "../../player/format/residual/tile_decoder.js";
import { readCall } from "../../player/playout/call.js";
import { codedPictures, modelsOf } from "../../player/playout/models_of_call.js";
import { Playout } from "../../player/playout/playout.js";
import { random } from "./mutation.js";
import { DATA, hex } from "./vectors.js";

const CALLS = ["call_default", "call_layers", "call_residual", "call_thesis"];
const ROUNDS = 60;

/**
 * Bytes of which some are changed, or the end is missing.
 * @param {Uint8Array} data
 * @param {() => number} next
 */
function damaged(data, next) {
  const cut = next() < 0.2 ? Math.floor(next() * data.length) : data.length;
  const copy = data.slice(0, cut);
  for (let n = 1 + Math.floor(next() * 4); n > 0 && copy.length; n--) {
    copy[Math.floor(next() * copy.length)] = Math.floor(next() * 256);
  }
  return copy;
}

/**
 * What a function does with damaged bytes must be a `FormatError` or nothing.
 * @param {() => void} act
 */
function survives(act) {
  try {
    act();
  } catch (error) {
    assert.ok(error instanceof FormatError, /** @type {Error} */ (error).stack);
  }
}

for (const name of CALLS) {
  test(`${name}: damaged packets give typed errors or pictures`, async () => {
    const packets = [...packetsOf(hex(`${name}.hex`), () => {})];
    for (let round = 0; round < ROUNDS; round++) {
      const next = random(round);
      const playout = new Playout();
      const hit = Math.floor(next() * packets.length);
      /** @type {import("../../player/playout/playout.js").PlayoutFrame[]} */
      const frames = [];
      for (const [i, packet] of packets.entries()) {
        const data = i === hit ? damaged(packet, next) : packet;
        survives(() => frames.push(...playout.receive(parsePacket(data))));
      }
      await drawable(frames);
    }
  });

  test(`${name}: damaged files give what can be read of them`, () => {
    const file = hex(`${name}.hex`);
    for (let round = 0; round < ROUNDS; round++) {
      survives(() => readCall(damaged(file, random(round))));
    }
  });
}

/**
 * Decode what is there to draw.
 * @param {import("../../player/playout/playout.js").PlayoutFrame[]} frames
 */
async function drawable(frames) {
  const noWebp = async () => {
    throw new FormatError("no WebP here");
  };
  for (const frame of frames) {
    const { width, height } = frame.received.model.call;
    const { residual } = frame;
    if (residual) survives(() => parseTiles(residual.data, width, height, residual.frames));
    assert.ok(frame.face.pose.translation.every(Number.isFinite));
    assert.ok(frame.face.eau.every(Number.isFinite));
  }
  const decoder = await ModelDecoder.load(DATA, noWebp);
  for (const received of modelsOf(frames)) {
    try {
      for await (const step of decoder.decode(codedPictures(received))) assert.ok(step);
    } catch (error) {
      assert.ok(error instanceof FormatError, /** @type {Error} */ (error).stack);
    }
  }
}
