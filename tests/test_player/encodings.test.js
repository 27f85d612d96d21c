// Of what packets hold in a range coder there is one encoding, and floats are no integers.
import assert from "node:assert/strict";
import { test } from "node:test";
import { packetsOf } from "../../player/format/call_file.js";
import { FormatError } from "../../player/format/errors.js";
import { parseTransform } from "../../player/format/frames/frame_transform.js";
import { parsePacket } from "../../player/format/packets.js";
import { parseShapeResidual } from "../../player/format/shape_residual.js";
import { readCall } from "../../player/playout/call.js";
import { bytesOf, hex } from "./vectors.js";

/**
 * Other bytes are refused, some of them because they are not the shortest, or hold something else.
 * @template T
 * @param {(data: Uint8Array) => T} read
 * @param {Uint8Array} data
 * @param {number} at the byte that is changed
 */
function checkOneEncoding(read, data, at = data.length - 1) {
  const expected = read(data);
  let longer = 0;
  for (const other of neighbours(data, at)) {
    try {
      assert.notDeepEqual(read(other), expected);
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      longer += Number(error.message.includes("shortest encoding"));
    }
  }
  assert.ok(longer > 0);
}

/**
 * Bytes with another one at a place; at the end also with one more.
 * @param {Uint8Array} data
 * @param {number} at
 */
function* neighbours(data, at) {
  for (let byte = 0; byte < 256; byte++) {
    if (byte !== data[at]) yield Uint8Array.from(data, (old, i) => (i === at ? byte : old));
    if (at === data.length - 1) yield Uint8Array.from([...data, byte]);
  }
}

test("a residual shape has one encoding", () => {
  const data = bytesOf("028bc3fa02fb87");
  assert.deepEqual([...parseShapeResidual(data)], [1, -2, 3, 127, -128, 0]);
  checkOneEncoding(parseShapeResidual, data);
});

test("the times of source frames have one encoding", () => {
  const data = hex("control_times.hex");
  const times = parsePacket(data);
  assert.deepEqual(times.kind === "control" && times.ticks, [9, 9, 9, 57, 56]);
  checkOneEncoding(parsePacket, data);
  assert.throws(() => parsePacket(bytesOf("800300ffffffff0f")), /deviation/);
});

test("the tables of a frame transform have one encoding", () => {
  const { profileData } = readCall(hex("call_layers.hex")).frames[0].received.model;
  const end = [0xa1, "l".charCodeAt(0)];
  assert.deepEqual([...profileData.slice(-3, -1)], end);
  checkOneEncoding(parseTransform, profileData, profileData.length - 4);
});

test("floats and integers of a model packet do not stand for one another", () => {
  const data = hex("model.hex");
  assert.equal(parsePacket(data).kind, "model");
  const focal = data.indexOf(0xca);
  const integer = Uint8Array.from([
    ...data.subarray(0, focal),
    ...[0xcd, 0x02, 0x64],
    ...data.subarray(focal + 5),
  ]);
  assert.throws(() => parsePacket(integer), /f is no floating-point number/);
  const size = data.indexOf(0x92) + 1;
  const float = Uint8Array.from([
    ...data.subarray(0, size),
    ...[0xca, 0x44, 0x20, 0, 0],
    ...data.subarray(size + 3),
  ]);
  assert.throws(() => parsePacket(float), FormatError);
});

test("after a record whose length is wrong the next ones are read", () => {
  const file = hex("call_thesis.hex");
  const packets = [...packetsOf(file, assert.fail)];
  const second = 580;
  for (const head of [0x18 + 2, 0x18 - 2, 0xff, 0]) {
    const changed = file.slice();
    changed[second] = head;
    /** @type {string[]} */
    const damages = [];
    const found = [...packetsOf(changed, (error) => damages.push(error.message))];
    assert.deepEqual(found, [packets[0], ...packets.slice(2)]);
    assert.equal(damages.length, 1);
  }
  const cut = [...packetsOf(file.subarray(0, -2), () => {})];
  assert.deepEqual(cut, packets.slice(0, -1));
});
