import { check } from "../format/errors.js";

const ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ";
const CHARACTERS = 28;
const CHECKSUM_BITS = 12n;
const KEY_BITS = 128;
const POLYNOMIAL = 0x180fn;

/**
 * The key of an invitation, 16 bytes.  Throws `FormatError` if it was copied wrongly.
 * @param {string} text
 */
export function parseKey(text) {
  const characters = text
    .toUpperCase()
    .replaceAll("-", "")
    .replace(/[IL]/g, "1")
    .replaceAll("O", "0");
  check(characters.length === CHARACTERS, "the key in the address is not whole");
  let code = 0n;
  for (const character of characters) {
    const value = ALPHABET.indexOf(character);
    check(value >= 0, "the key in the address was copied wrongly");
    code = (code << 5n) | BigInt(value);
  }
  const bits = code >> CHECKSUM_BITS;
  check(
    checksum(bits) === (code & ((1n << CHECKSUM_BITS) - 1n)),
    "the key in the address was copied wrongly",
  );
  return Uint8Array.from({ length: 16 }, (_, i) => Number((bits >> BigInt(8 * (15 - i))) & 0xffn));
}

/** @param {bigint} bits */
function checksum(bits) {
  let rest = bits << CHECKSUM_BITS;
  for (let shift = KEY_BITS - 1; shift >= 0; shift--) {
    if ((rest >> (BigInt(shift) + CHECKSUM_BITS)) & 1n) rest ^= POLYNOMIAL << BigInt(shift);
  }
  return rest;
}
