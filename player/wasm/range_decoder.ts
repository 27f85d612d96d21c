// Reads binary decisions of given probabilities, see docs/format.md, Range decoder.

const TOP_BYTES: i32 = 6;
const LEAST_RANGE: u64 = 1 << 40;
const EVEN: u32 = 32768;
const ONE: i32 = 65536;
const MAX_COUNT: i32 = 60;
const MIN_PROBABILITY: i32 = 96;
const LONGEST: i32 = 14;
/** Of masks, more than of integers. */
const CONTEXTS: i32 = 64;

let data: usize = 0;
let length: i32 = 0;
let position: i32 = 0;
let code: u64 = 0;
let range: u64 = 0;
/** Whether a value has been larger than any that is written. */
let isDamaged: bool = false;
/** Of each context of integers the probability of a zero, and how many decisions it stands for. */
const zeros: usize = memory.data(4 * CONTEXTS);
const counts: usize = memory.data(4 * CONTEXTS);

function nextByte(): u64 {
  const byte: u64 = position < length ? load<u8>(data + position) : 0;
  position++;
  return byte;
}

/** Begin to read bytes. */
export function start(at: usize, bytes: i32): void {
  data = at;
  length = bytes;
  position = 0;
  code = 0;
  range = 1 << 48;
  isDamaged = false;
  for (let i = 0; i < TOP_BYTES; i++) code = (code << 8) | nextByte();
  for (let i = 0; i < CONTEXTS; i++) {
    store<i32>(zeros + 4 * i, ONE / 2);
    store<i32>(counts + 4 * i, 0);
  }
}

/** How many bytes are left on which no decision has depended; -1: a value was too large. */
export function unread(): i32 {
  return isDamaged ? -1 : max(length - position, 0);
}

/** The next decision; zero: its probability of being 0, in 1 / 65536. */
export function bit(zero: u32): i32 {
  const split = (range >> 16) * zero;
  const decision = code >= split ? 1 : 0;
  if (decision) {
    code -= split;
    range -= split;
  } else {
    range = split;
  }
  while (range < LEAST_RANGE) {
    code = (code << 8) | nextByte();
    range <<= 8;
  }
  return decision;
}

function bits(count: i32): i32 {
  let value = 0;
  for (let i = 0; i < count; i++) value = 2 * value + bit(EVEN);
  return value;
}

/** An integer from 0 to 2^15 - 2. */
export function expGolomb(): i32 {
  let length = 0;
  while (bit(EVEN)) {
    length++;
    if (length > LONGEST) return tooLarge();
  }
  return (1 << length) + bits(length) - 1;
}

function tooLarge(): i32 {
  isDamaged = true;
  return 0;
}

/** The next signed integer in one of two adaptive contexts. */
export function integer(context: i32): i32 {
  const first = context * (LONGEST + 1);
  let length = 0;
  while (adaptiveBit(first + length)) {
    length++;
    if (length > LONGEST) return tooLarge();
  }
  if (!length) return 0;
  const magnitude = (1 << length) + bits(length) - 1;
  return bit(EVEN) ? -magnitude : magnitude;
}

/** The next decision in an adaptive context. */
export function adaptiveBit(context: i32): i32 {
  const zero = load<i32>(zeros + 4 * context);
  const count = load<i32>(counts + 4 * context);
  const decision = bit(zero);
  const moved = zero + floorOf((decision ? 0 : ONE) - zero, count + 2);
  store<i32>(zeros + 4 * context, min(max(moved, MIN_PROBABILITY), ONE - MIN_PROBABILITY));
  if (count < MAX_COUNT) store<i32>(counts + 4 * context, count + 1);
  return decision;
}

function floorOf(dividend: i32, divisor: i32): i32 {
  const quotient = dividend / divisor;
  return dividend % divisor < 0 ? quotient - 1 : quotient;
}
