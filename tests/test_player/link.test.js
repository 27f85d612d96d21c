import assert from "node:assert/strict";
import { test } from "node:test";
import { packetsOf } from "../../player/format/call_file.js";
import { FormatError } from "../../player/format/errors.js";
import { EVENTS } from "../../player/format/packets.js";
import { FrameNumbers } from "../../player/link/frame_numbers.js";
import { parseKey } from "../../player/link/invitation.js";
import { ItemAssembly } from "../../player/link/item_assembly.js";
import { helloOf, parseMessage, reportOf } from "../../player/link/messages.js";
import { PlainProtection } from "../../player/link/protection.js";
import {
  baseKey,
  derivedKey,
  protect,
  ReplayWindow,
  sessionKey,
  unprotect,
} from "../../player/link/sframe.js";
import { Presenter } from "../../player/playout/presenter.js";
import { Receiver } from "../../player/playout/receiver.js";
import { bytesOf, hex } from "./vectors.js";

const KEY = Uint8Array.from({ length: 16 }, (_, i) => i);
const SESSION = Uint8Array.from("session!", (character) => character.charCodeAt(0));
const NOTHING = new Uint8Array(0);

/** @param {Uint8Array | null} bytes */
function digits(bytes) {
  return Buffer.from(bytes ?? NOTHING).toString("hex");
}

test("packets are protected as the program protects them", () => {
  const expected = {
    encoder: ["51579d6d1fb5787ec6f4a916bd3161fc", "19012c4be2fd8fe3e33a4a9833b50883381473392c"],
    decoder: ["7d037bd93b849551b380008a4863b68e", "19012c6e8d704db6f4d741a9844ed526f425d84c85"],
  };
  const text = Uint8Array.from("a frame packet", (character) => character.charCodeAt(0));
  const metadata = Uint8Array.from("metadata", (character) => character.charCodeAt(0));
  for (const [sender, [base, packet]] of Object.entries(expected)) {
    const own = baseKey(KEY, /** @type {"encoder" | "decoder"} */ (sender), "anna");
    assert.equal(digits(own), base);
    const key = sessionKey(own, SESSION);
    assert.equal(digits(protect(key, 300n, text, metadata)), packet);
    assert.deepEqual(unprotect(key, bytesOf(packet), metadata), text);
    assert.equal(unprotect(key, bytesOf(packet), NOTHING), null);
    const changed = bytesOf(packet);
    changed[5] ^= 1;
    assert.equal(unprotect(key, changed, metadata), null);
  }
  const hello = "0f73657373696f6e21bcaf6767925d7e0786a48cdea9";
  const plain = unprotect(derivedKey(bytesOf(expected.encoder[0]), 0), bytesOf(hello), NOTHING);
  assert.equal(digits(plain), "0000000068656c6c6f");
});

test("the key of an invitation, and one that was copied wrongly", () => {
  assert.deepEqual(parseKey("000g-40R4-0M30-E209-185G-R38E-1W0H"), KEY);
  assert.throws(() => parseKey("000G-40R4-0M30-E209-185G-R38E-1W0J"), /copied wrongly/);
  assert.throws(() => parseKey("000G"), /not whole/);
});

test("a checksum without keys is that of the program", () => {
  const guard = new PlainProtection(SESSION);
  guard.onPeer(Uint8Array.from("encoder1", (character) => character.charCodeAt(0)));
  assert.equal(digits(guard.protect(bytesOf("010203"))), "0102034cfa");
  assert.deepEqual(guard.unprotect(bytesOf("0102034cfa")), bytesOf("010203"));
  assert.equal(guard.unprotect(bytesOf("0102034cfb")), null);
});

test("a counter is taken once, and not from before", () => {
  const window = new ReplayWindow(5);
  assert.deepEqual(
    [5n, 7n, 6n, 7n, 2000n, 900n, 2n ** 30n].map((each) => window.take(each)),
    [false, true, true, false, true, false, false],
  );
});

test("messages of the vectors", () => {
  const hello = parseMessage(hex("link_hello.hex"));
  assert.ok(hello.kind === "hello" && hello.asks);
  assert.deepEqual([hello.nonce, hello.answers, hello.frames], [7, 3, 300]);
  assert.deepEqual(hello.spans, [
    { first: 2, end: 3 },
    { first: 0, end: 5 },
  ]);
  const piece = parseMessage(hex("link_piece.hex"));
  assert.ok(piece.kind === "piece");
  assert.deepEqual(
    [piece.channel, piece.item, piece.number, piece.total, piece.index],
    [1, 4, 310, 515, 1],
  );
  const report = reportOf(
    Uint8Array.from("decoder1", (character) => character.charCodeAt(0)),
    {
      loss: 13 / 255,
      frames: 300,
      below: [3, 4],
      missing: [295, 297],
      holdings: [{ channel: 1, item: 4, pieces: [0, 2] }],
    },
  );
  assert.equal(digits(report), digits(hex("link_report.hex")));
  const own = parseMessage(helloOf(SESSION, hello.session, { asks: true, nonce: 9, answers: 7 }));
  assert.ok(own.kind === "hello" && own.asks && own.answers === 7);
});

test("messages in another than their one encoding are refused", () => {
  const hello = hex("link_hello.hex");
  const bye = hex("link_bye.hex").subarray(0, 5);
  const piece = hex("link_piece.hex");
  const index = piece.length - 4;
  assert.deepEqual(parseMessage(bye), { kind: "bye", role: 1 });
  assert.deepEqual(parseMessage(Uint8Array.from([...hello, 0, 0])), parseMessage(hello));
  for (const wrong of [
    Uint8Array.from([...hello, 1]),
    Uint8Array.from([...hello, ...new Uint8Array(513)]),
    changed(hello, 0, 0x81),
    changed(hello, 2, 3),
    changed(hello, 2, 16),
    Uint8Array.from([...bye, 0]),
    changed(bye, 2, 3),
    changed(piece, index, 2),
    changed(piece.subarray(0, -3), index, 2),
  ]) {
    assert.throws(() => parseMessage(wrong), FormatError);
  }
});

/**
 * @param {Uint8Array} data
 * @param {number} at
 * @param {number} byte
 */
function changed(data, at, byte) {
  const copy = data.slice();
  copy[at] = byte;
  return copy;
}

test("items are put together in any order, and reported", () => {
  const items = new ItemAssembly();
  items.begin([
    { first: 0, end: 0 },
    { first: 3, end: 4 },
  ]);
  const data = Uint8Array.from({ length: 600 }, (_, i) => i % 251);
  const piece = (/** @type {number} */ index) => ({
    kind: /** @type {const} */ ("piece"),
    channel: 1,
    item: 3,
    number: 8,
    total: 600,
    index,
    data: data.subarray(512 * index, 512 * index + 512),
  });
  assert.deepEqual(items.add(piece(1)), []);
  assert.deepEqual(items.holdings(), [{ channel: 1, item: 3, pieces: [1] }]);
  assert.deepEqual(items.add(piece(1)), []);
  assert.deepEqual(items.add(piece(0)), [{ number: 8, packet: data }]);
  assert.deepEqual(items.below, [0, 4]);
  assert.deepEqual(items.add(piece(0)), []);
});

test("frame packets get their numbers, and missing ones are asked for", () => {
  const frames = new FrameNumbers(100);
  assert.equal(frames.take(100 % 64, 0), 100);
  assert.equal(frames.take(103 % 64, 0.1), 103);
  assert.equal(frames.take(103 % 64, 0.1), null);
  assert.deepEqual(frames.toAsk(0.11), []);
  assert.deepEqual(frames.toAsk(0.14), [101, 102]);
  assert.deepEqual(frames.toAsk(0.15), []);
  assert.equal(frames.take(101 % 64, 0.2), 101);
  assert.deepEqual(frames.toAsk(0.4), [102]);
  assert.deepEqual(frames.toAsk(3), []);
  assert.equal(frames.take(99 % 64, 3), null);
});

/** The packets of a call with their numbers, as a link delivers them. */
function arrivals() {
  let number = 61;
  return [...packetsOf(hex("call_default.hex"), () => {})].map((packet) => {
    const kind = packet[0] >> 6;
    if (kind === 0) number += ((packet[0] % 64) - number + 6400) % 64 || 64;
    const own =
      kind === 3
        ? null
        : kind === 1
          ? number + 1 + (((packet[0] % 64) - number - 1 + 6400) % 64)
          : kind === 2
            ? number + 1
            : number;
    return { packet, number: own, session: 0 };
  });
}

test("a live call shows every frame, also out of order", () => {
  const all = arrivals();
  const inOrder = new Receiver();
  const expected = all.flatMap((arrival) => inOrder.receive(arrival, 0)).map(({ index }) => index);
  assert.ok(expected.length > 10 && inOrder.ended);
  const swapped = all.slice();
  const at = swapped.findIndex(
    (each, i) => each.packet[0] >> 6 === 0 && swapped[i + 1]?.packet[0] >> 6 === 0 && i > 3,
  );
  [swapped[at], swapped[at + 1]] = [swapped[at + 1], swapped[at]];
  /** @type {Error[]} */
  const damages = [];
  const other = new Receiver((error) => damages.push(error));
  const shown = swapped.flatMap((arrival) => other.receive(arrival, 0)).map(({ index }) => index);
  assert.deepEqual(shown, expected);
  assert.deepEqual(damages, []);
});

test("a packet that never comes is bridged once its time is over", () => {
  const all = arrivals();
  const lost = all.findIndex(({ packet }, i) => packet[0] >> 6 === 0 && i > 3);
  const receiver = new Receiver();
  const frames = all
    .filter((_, i) => i !== lost)
    .flatMap((arrival) => receiver.receive(arrival, 0));
  frames.push(...receiver.poll(0.4), ...receiver.poll(5));
  const indices = frames.map(({ index }) => index);
  assert.deepEqual(
    indices,
    indices.map((_, i) => i),
  );
  assert.ok(frames.some(({ isLost }) => isLost) && receiver.ended);
  assert.ok(EVENTS.END === 0);
});

test("a call that begins again a day later is not filled from end to end", () => {
  const all = arrivals();
  const receiver = new Receiver();
  const before = all.flatMap((arrival) => receiver.receive(arrival, 0));
  const again = all.map((arrival) => ({ ...arrival, session: 1 }));
  const after = again.flatMap((arrival) => receiver.receive(arrival, 86400));
  const { index, isLost, timeS } = after[after.length - 1];
  assert.ok(index > 2e6 && timeS > 86000 && !isLost && receiver.ended);
  assert.ok(after.length > before.length && after.length < 20000);
  assert.deepEqual(
    after.map((frame) => frame.index),
    after.map((_, i) => index - after.length + 1 + i),
  );
});

test("frames are shown at their distances, as late as the latest needs", () => {
  /** @type {Presenter<{timeS: number}>} */
  const presenter = new Presenter();
  presenter.push(
    [0, 0.04, 0.08].map((timeS) => ({ timeS })),
    1,
  );
  assert.equal(presenter.due(0.9), null);
  assert.deepEqual(presenter.due(1.02), { timeS: 0 });
  assert.deepEqual(presenter.due(1.1), { timeS: 0.08 });
  presenter.push([{ timeS: 0.12 }], 1.5);
  assert.equal(presenter.due(1.5), null);
  assert.deepEqual(presenter.due(1.52), { timeS: 0.12 });
});
