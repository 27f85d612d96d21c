// What `python -m benchmarks fuzz` does to the program, done to the player: changed bytes give typed
// errors or something to show, soon, and take bounded memory.
import assert from "node:assert/strict";
import { test } from "node:test";
import { ModelDecoder } from "../../player/draw/model_decoder.js";
import { packetsOf } from "../../player/format/call_file.js";
import { FormatError } from "../../player/format/errors.js";
import { kindOf, parsePacket } from "../../player/format/packets.js";
import { ResidualPictures } from "../../player/format/residual/inverse_transform.js";
import { parseTiles } from "../../player/format/residual/tile_decoder.js";
import { DeliveryReceiver } from "../../player/link/delivery_receiver.js";
import { parseMessage } from "../../player/link/messages.js";
import { readCall } from "../../player/playout/call.js";
import { codedPictures } from "../../player/playout/models_of_call.js";
import { Receiver } from "../../player/playout/receiver.js";
import { choice, mutated, random } from "./mutation.js";
import { DATA, hex } from "./vectors.js";

/** What one try may take on a slow machine, and all tries of a reader together. */
const MOST_S = 3;
const MOST_MB = 400;
/** Payloads of an end of a link before another one takes its place. */
const PAYLOADS = 200;
const CALLS = ["call_default", "call_layers", "call_residual", "call_thesis"];
const PACKETS = CALLS.flatMap((name) => [...packetsOf(hex(`${name}.hex`), () => {})]);
const MODELS = CALLS.map((name) => readCall(hex(`${name}.hex`)).frames[0].received);
const MESSAGES = ["bye", "hello", "piece", "report"].map((name) => hex(`link_${name}.hex`));

/**
 * Give changed bytes to what reads them.
 * @param {Uint8Array[]} samples
 * @param {number} tries
 * @param {(data: Uint8Array, next: () => number) => unknown} read
 */
async function fuzz(samples, tries, read) {
  let taken = 0;
  for (let seed = 0; seed < tries; seed++) {
    const next = random(seed);
    const data = mutated(next, samples);
    const began = process.cpuUsage();
    try {
      await read(data, next);
      taken++;
    } catch (error) {
      const told = `seed ${seed}: ${/** @type {Error} */ (error).stack}`;
      assert.ok(error instanceof FormatError, told);
    }
    const { user, system } = process.cpuUsage(began);
    assert.ok(user + system < 1e6 * MOST_S, `seed ${seed} took ${user + system} us`);
  }
  const { maxRSS } = process.resourceUsage();
  assert.ok(maxRSS < 1024 * MOST_MB, `${maxRSS} kB of memory`);
  assert.ok(taken > 0 && taken < tries, `${taken} of ${tries} were taken`);
}

test("packets", () => fuzz(PACKETS, 20000, parsePacket));

test("messages of a link", () => fuzz(MESSAGES, 10000, parseMessage));

test("the end of a link", () => {
  const session = Uint8Array.from("decoder1", (character) => character.charCodeAt(0));
  const guard = {
    session,
    protect: (/** @type {Uint8Array} */ data) => data,
    unprotect: (/** @type {Uint8Array} */ data) => data,
    onPeer: () => {},
  };
  let nowS = 0;
  let count = 0;
  let end = new DeliveryReceiver(guard);
  const receiver = new Receiver();
  const frames = PACKETS.filter((packet) => kindOf(packet) === 0);
  return fuzz([...MESSAGES, ...MESSAGES, ...frames], 10000, (data) => {
    nowS += 0.05;
    if (count++ % PAYLOADS === 0) {
      end = new DeliveryReceiver(guard);
      end.receive(hex("link_hello.hex"), nowS);
    }
    try {
      for (const arrival of end.receive(data, nowS)) receiver.receive(arrival, nowS);
    } finally {
      end.payloads(nowS);
      receiver.poll(nowS);
    }
  });
});

test("packets of a link in any order, with any numbers", () => {
  let nowS = 0;
  let receiver = new Receiver();
  const isCall = (/** @type {Uint8Array} */ packet) => kindOf(packet) !== 1;
  return fuzz(PACKETS.filter(isCall), 4000, (data, next) => {
    nowS += next();
    if (next() < 0.05) {
      receiver = new Receiver();
      const model = choice(
        next,
        PACKETS.filter((packet) => !isCall(packet)),
      );
      receiver.receive({ packet: model, number: 0, session: 0 }, nowS);
    }
    const number = choice(next, [null, Math.floor(70 * next()), Math.floor(2 ** 31 * next())]);
    const before = receiver.damages;
    const frames = receiver.receive({ packet: data, number, session: next() < 0.01 ? 1 : 0 }, nowS);
    for (const { face } of frames) assert.ok(face.pose.translation.every(Number.isFinite));
    if (receiver.damages > before) throw new FormatError("refused");
  });
});

test("call files", () => {
  const files = CALLS.map((name) => hex(`${name}.hex`));
  return fuzz(files, 300, (data) => {
    const { frames, damages } = readCall(data);
    assert.ok(frames.length, damages[0]);
  });
});

/**
 * Decode the pictures of a model of which one is changed.
 * @param {"texture" | "background"} name
 * @param {Uint8Array} data
 * @param {() => number} next
 */
async function decodeWith(name, data, next) {
  const received = choice(next, MODELS);
  const noWebp = async () => {
    throw new FormatError("no WebP here");
  };
  const coded = { ...codedPictures(received), [name]: data };
  for await (const step of (await ModelDecoder.load(DATA, noWebp)).decode(coded)) assert.ok(step);
}

for (const name of /** @type {const} */ (["texture", "background"])) {
  test(`the ${name} of a model`, () => {
    const samples = MODELS.map(({ model }) => model[name]);
    return fuzz(samples, 60, (data, next) => decodeWith(name, data, next));
  });
}

test("picture residuals", () => {
  const { frames } = readCall(hex("call_residual.hex"));
  const samples = frames.flatMap(({ residual }) => (residual ? [residual.data] : []));
  return fuzz(samples, 300, (data, next) => {
    const [width, height, count] = choice(next, [
      [64, 48, 4],
      [320, 240, 9],
      [640, 480, 2],
    ]);
    const tiles = parseTiles(data, width, height, count);
    const { coarse } = new ResidualPictures(tiles).planes(0);
    assert.ok(coarse.every((plane) => Number.isFinite(plane[0])));
  });
});
