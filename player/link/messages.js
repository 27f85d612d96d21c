// The messages of a link, see docs/format.md, Links.
import { ByteReader } from "../format/bytes.js";
import { check, FormatError } from "../format/errors.js";
import { MAX_PACKET_BYTES } from "../format/packets.js";

export const SESSION_BYTES = 8;
export const PIECE_BYTES = 512;
export const ROLES = { ENCODER: 0, DECODER: 1, RELAY: 2 };
export const CHANNELS = { ORDERED: 0, UNORDERED: 1 };
const HEAD = 0x80;
const KINDS = { HELLO: 16, REPORT: 17, PIECE_ORDERED: 18, PIECE_UNORDERED: 19, BYE: 20 };
const MAX_NUMBER = 2 ** 31 - 1;
const MAX_ITEM_BYTES = Math.max(...MAX_PACKET_BYTES);
const MAX_PADDING_BYTES = 512;
/** Of a session, in a BYE. */
const PEER_BYTES = 2;
/** In a HELLO: after byte 0, the kind, the flags and two nonces. */
const SESSION_START = 5;

/** Items of a channel that a decoder needs. @typedef {{first: number, end: number}} Span */
/**
 * @typedef {object} Hello
 * @property {"hello"} kind
 * @property {number} role
 * @property {boolean} asks
 * @property {number} nonce
 * @property {number} answers
 * @property {Uint8Array} session
 * @property {Uint8Array} echo
 * @property {number} frames number of the next frame packet
 * @property {Span[]} spans of the ordered and of the unordered channel
 */
/**
 * @typedef {object} Piece
 * @property {"piece"} kind
 * @property {number} channel
 * @property {number} item
 * @property {number} number of a frame packet, see docs/format.md
 * @property {number} total bytes of the packet
 * @property {number} index
 * @property {Uint8Array} data
 */
/** @typedef {Hello | Piece | {kind: "bye", role: number} | {kind: "report"}} Message */
/** Which pieces of an item are there. @typedef {{channel: number, item: number, pieces: number[]}} Holding */

/**
 * Whether a payload is a message, and no frame packet.
 * @param {Uint8Array} data
 */
export function isMessage(data) {
  return data.length > 1 && data[0] === HEAD && data[1] >= KINDS.HELLO;
}

/**
 * The session that a HELLO names; null if the bytes are none.
 * @param {Uint8Array} data
 */
export function sessionInHello(data) {
  const isHello = isMessage(data) && data[1] === KINDS.HELLO;
  const session = data.slice(SESSION_START, SESSION_START + SESSION_BYTES);
  return isHello && session.length === SESSION_BYTES ? session : null;
}

/**
 * The message in a payload; reports, which are not for a decoder, are not looked into.  Throws
 * `FormatError` if it is none.
 * @param {Uint8Array} data
 * @returns {Message}
 */
export function parseMessage(data) {
  check(isMessage(data), "not a message of the link");
  const reader = new ByteReader(data.subarray(2), "message of the link");
  switch (data[1]) {
    case KINDS.HELLO:
      return parseHello(reader);
    case KINDS.PIECE_ORDERED:
    case KINDS.PIECE_UNORDERED:
      return parsePiece(reader, data[1] - KINDS.PIECE_ORDERED);
    case KINDS.BYE:
      return parseBye(reader);
    case KINDS.REPORT:
      return { kind: "report" };
  }
  throw new FormatError(`message of the link of unknown kind ${data[1]}`);
}

/**
 * @param {ByteReader} reader
 * @returns {Message}
 */
function parseBye(reader) {
  const role = roleOf(reader.byte());
  reader.take(PEER_BYTES);
  check(!reader.left, "message of the link is too long");
  return { kind: "bye", role };
}

/** @param {number} role */
function roleOf(role) {
  check(role <= ROLES.RELAY, `message of the link: unknown role ${role}`);
  return role;
}

/**
 * @param {ByteReader} reader
 * @returns {Hello}
 */
function parseHello(reader) {
  const [flags, nonce, answers] = reader.take(3);
  const session = reader.take(SESSION_BYTES).slice();
  const echo = reader.take(SESSION_BYTES).slice();
  const frames = number(reader);
  const spans = [0, 1].map(() => {
    const first = number(reader);
    const end = first + number(reader);
    check(end <= MAX_NUMBER, `message of the link: ${end} is too large`);
    return { first, end };
  });
  const padding = reader.rest();
  const isPadding = padding.length <= MAX_PADDING_BYTES && padding.every((byte) => !byte);
  check(isPadding && flags < 16, "message of the link: wrong padding or flags");
  const asks = (flags & 4) > 0;
  return {
    kind: "hello",
    role: roleOf(flags % 4),
    asks,
    nonce,
    answers,
    session,
    echo,
    frames,
    spans,
  };
}

/**
 * @param {ByteReader} reader
 * @param {number} channel
 * @returns {Piece}
 */
function parsePiece(reader, channel) {
  const item = number(reader);
  const frame = number(reader);
  const total = reader.varint();
  const index = reader.varint();
  const data = reader.rest().slice();
  check(total <= MAX_ITEM_BYTES, `a packet of ${total} bytes is too long`);
  check(index < Math.max(1, pieceCount(total)), `piece ${index} of a packet of ${total} bytes`);
  const expected = Math.min(total - index * PIECE_BYTES, PIECE_BYTES);
  check(data.length === expected, `a piece of ${data.length} bytes, expected ${expected}`);
  return { kind: "piece", channel, item, number: frame, total, index, data };
}

/** @param {ByteReader} reader */
function number(reader) {
  const value = reader.varint();
  check(value <= MAX_NUMBER, `message of the link: ${value} is too large`);
  return value;
}

/**
 * How many pieces a packet takes.
 * @param {number} total
 */
export function pieceCount(total) {
  return Math.ceil(total / PIECE_BYTES);
}

/** @param {number} value */
function varint(value) {
  const bytes = [];
  let rest = value;
  for (; rest >= 128; rest = Math.floor(rest / 128)) bytes.push((rest % 128) + 128);
  return [...bytes, rest];
}

/**
 * A HELLO of a decoder.
 * @param {Uint8Array} session
 * @param {Uint8Array} echo
 * @param {{asks: boolean, nonce: number, answers: number}} more
 */
export function helloOf(session, echo, { asks, nonce, answers }) {
  const flags = ROLES.DECODER + (asks ? 4 : 0);
  return Uint8Array.from([
    HEAD,
    KINDS.HELLO,
    flags,
    nonce,
    answers,
    ...session,
    ...echo,
    0,
    0,
    0,
    0,
    0,
  ]);
}

/**
 * A report of a decoder.
 * @param {Uint8Array} session
 * @param {object} state
 * @param {number} state.loss 0 to 1
 * @param {number} state.frames number of the newest frame packet and one
 * @param {number[]} state.below items below which all are there, by channel
 * @param {number[]} state.missing frame packets to send again, ascending
 * @param {Holding[]} state.holdings
 */
export function reportOf(session, { loss, frames, below, missing, holdings }) {
  const steps = missing.map((each, i) => each - (i ? missing[i - 1] : 0));
  const numbers = [frames, ...below, missing.length, ...steps].flatMap(varint);
  const held = holdings.flatMap(({ channel, item, pieces }) => {
    const bits = new Uint8Array(Math.floor(Math.max(...pieces) / 8) + 1);
    for (const piece of pieces) bits[piece >> 3] |= 1 << (piece & 7);
    return [...varint(2 * item + channel), ...varint(bits.length), ...bits];
  });
  const share = Math.round(255 * loss);
  return Uint8Array.from([HEAD, KINDS.REPORT, session[0], session[1], share, ...numbers, ...held]);
}

/**
 * What a decoder says when it leaves.
 * @param {Uint8Array} session
 */
export function byeOf(session) {
  return Uint8Array.from([HEAD, KINDS.BYE, ROLES.DECODER, session[0], session[1]]);
}
