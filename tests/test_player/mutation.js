// Bytes that have been changed as `benchmarks/fuzz/mutation.py` changes them.

/** @typedef {() => number} Random numbers from 0 to 1 */
/** @typedef {(next: Random, data: Uint8Array, other: Uint8Array) => Uint8Array} Change */

const MAX_FLIPS = 8;
const MAX_INSERTED = 64;
const HEADER = 8;

/**
 * Numbers from 0 to 1 that are the same in each run (Marsaglia's xorshift).
 * @param {number} seed
 * @returns {Random}
 */
export function random(seed) {
  let state = seed + 1;
  return () => {
    state ^= state << 13;
    state ^= state >>> 17;
    state ^= state << 5;
    return (state >>> 0) / 2 ** 32;
  };
}

/**
 * An integer from `low` to `high`.
 * @param {Random} next
 * @param {number} low
 * @param {number} high
 */
function integer(next, low, high) {
  return low + Math.floor(next() * (high - low + 1));
}

/**
 * One of some values.
 * @template T
 * @param {Random} next
 * @param {T[]} values
 */
export function choice(next, values) {
  return values[integer(next, 0, values.length - 1)];
}

/**
 * One of the samples, changed once or twice; other samples lend what is put in.
 * @param {Random} next
 * @param {Uint8Array[]} samples
 */
export function mutated(next, samples) {
  let data = choice(next, samples);
  for (let n = choice(next, [1, 1, 2]); n > 0; n--) {
    data = choice(next, CHANGES)(next, data, choice(next, samples));
  }
  return data;
}

/** @type {Change} */
function flip(next, data) {
  const changed = data.slice();
  for (let n = data.length ? integer(next, 1, MAX_FLIPS) : 0; n > 0; n--) {
    changed[integer(next, 0, data.length - 1)] ^= 1 << integer(next, 0, 7);
  }
  return changed;
}

/** @type {Change} */
function flipInFront(next, data, other) {
  return joined(flip(next, data.subarray(0, HEADER), other), data.subarray(HEADER));
}

/** @type {Change} */
function cut(next, data) {
  return data.slice(0, integer(next, 0, data.length));
}

/** @type {Change} */
function insert(next, data) {
  const at = integer(next, 0, data.length);
  const inserted = bytes(next, integer(next, 1, MAX_INSERTED));
  return joined(data.subarray(0, at), inserted, data.subarray(at));
}

/** @type {Change} */
function remove(next, data) {
  const begin = integer(next, 0, data.length);
  const end = begin + integer(next, 1, MAX_INSERTED);
  return joined(data.subarray(0, begin), data.subarray(end));
}

/** @type {Change} */
function repeat(next, data) {
  const begin = integer(next, 0, data.length);
  const end = begin + integer(next, 1, MAX_INSERTED);
  return joined(data.subarray(0, end), data.subarray(begin));
}

/** @type {Change} */
function splice(next, data, other) {
  const from = integer(next, 0, other.length);
  return joined(data.subarray(0, integer(next, 0, data.length)), other.subarray(from));
}

/** Largest and smallest values of fields. @type {Change} */
function fill(next, data) {
  const begin = integer(next, 0, data.length);
  return data.slice().fill(choice(next, [0, 255, 128]), begin, begin + integer(next, 1, MAX_FLIPS));
}

/** @type {Change} */
function invent(next, data) {
  return joined(data.subarray(0, 2), bytes(next, integer(next, 0, 2 * MAX_INSERTED)));
}

/** @type {Change[]} */
const CHANGES = [flip, flipInFront, cut, insert, remove, repeat, splice, fill, invent];

/**
 * @param {Random} next
 * @param {number} count
 */
function bytes(next, count) {
  return Uint8Array.from({ length: count }, () => integer(next, 0, 255));
}

/** @param {Uint8Array[]} parts */
function joined(...parts) {
  const whole = new Uint8Array(parts.reduce((length, part) => length + part.length, 0));
  let at = 0;
  for (const part of parts) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
}
