import assert from "node:assert/strict";
import { test } from "node:test";
import { AdaptiveBits, AdaptiveIntegers } from "../../player/format/entropy/adaptive_models.js";
import { RangeDecoder } from "../../player/format/entropy/range_decoder.js";
import { FramePredictor } from "../../player/format/frames/frame_payload.js";
import { readCall } from "../../player/playout/call.js";
import { bytesOf, hex, json, text } from "./vectors.js";

test("the decisions of the table of docs/format.md", () => {
  const ones = new RangeDecoder(bytesOf("ea"));
  assert.deepEqual(
    [100, 60000, 32768, 65000].map((zero) => ones.bit(zero)),
    [1, 0, 1, 1],
  );
  assert.equal(new RangeDecoder(bytesOf("f280")).expGolomb(14), 20);
  const coder = new RangeDecoder(bytesOf("50"));
  const bits = AdaptiveBits.even(1);
  /** @type {number[]} */
  const zeros = [];
  const read = Array.from({ length: 6 }, () => {
    zeros.push(bits.zeros[0]);
    return bits.decode(coder, 0);
  });
  assert.deepEqual(read, [0, 0, 1, 0, 0, 0]);
  assert.deepEqual(zeros, [32768, 49152, 54613, 40959, 45874, 49151]);
  const integers = new AdaptiveIntegers(1);
  const more = new RangeDecoder(bytesOf("4c7d"));
  assert.deepEqual(
    [1, 2, 3, 4, 5].map(() => integers.decode(more, 0)),
    [0, 0, 0, 5, -2],
  );
});

for (const name of ["frames_default", "frames_reserved"]) {
  test(`${name}: headers, residuals and frames`, () => {
    const expected = json(`${name}.json`);
    const scales = Int32Array.from(expected.scale_codes.flat());
    const predictor = new FramePredictor(scales, expected.reserved);
    /** @type {Float64Array} */
    let anchor = new Float64Array(predictor.components);
    for (const [number, line] of text(`${name}.hex`).trim().split("\n").entries()) {
      const decoded = predictor.decode(bytesOf(line), anchor, number, expected.frames_per_packet);
      const packet = expected.packets[number];
      const { quality, intra, unused } = decoded;
      assert.deepEqual([quality, intra, unused], [packet.quality, packet.intra, packet.unused]);
      const residuals = decoded.residuals.map(({ index, values }) => [index, [...values]]);
      assert.deepEqual(residuals, packet.residuals);
      assert.deepEqual(
        decoded.frames.map((frame) => [...frame]),
        packet.frames,
      );
      anchor = decoded.frames[decoded.frames.length - 1];
    }
  });
}

for (const name of ["call_default", "call_layers", "call_residual", "call_thesis"]) {
  test(`${name}: the parameters of every source frame`, () => {
    const call = readCall(hex(`${name}.hex`));
    assert.deepEqual([call.damages, call.isComplete], [[], true]);
    const of = name === "call_residual" ? "call_layers" : name;
    const expected = json(`${of}.json`).frames;
    assert.equal(call.frames.length, expected.length);
    for (const [i, frame] of call.frames.entries()) {
      const wanted = expected[i];
      assert.equal(frame.index, wanted.frame);
      assert.equal(frame.isFrozen, wanted.frozen);
      close(frame.face.pose.rotation, wanted.rotation);
      close(frame.face.pose.translation, wanted.translation_mm);
      close(frame.face.eau, wanted.eau);
      close(frame.face.modes, wanted.modes);
      close(frame.face.layers, wanted.layers ?? []);
    }
  });
}

/**
 * @param {ArrayLike<number>} values
 * @param {number[]} expected
 */
function close(values, expected) {
  assert.equal(values.length, expected.length);
  for (const [i, value] of expected.entries()) {
    assert.ok(
      Math.abs(values[i] - value) <= 1e-9 * Math.max(1, Math.abs(value)),
      `${values[i]} ${value}`,
    );
  }
}
