/**
 * A table of what one byte does to a checksum.
 * @param {(value: number) => number} step
 * @param {number} shift of the byte in the checksum
 */
function table(step, shift = 0) {
  return Array.from({ length: 256 }, (_, byte) => {
    let value = byte << shift;
    for (let bit = 0; bit < 8; bit++) value = step(value);
    return value;
  });
}

const CRC8 = table((value) => ((value << 1) ^ (value & 0x80 ? 0x107 : 0)) & 0xff);
const CRC16 = table((value) => ((value << 1) ^ (value & 0x8000 ? 0x1021 : 0)) & 0xffff, 8);
const CRC32 = table((value) => (value >>> 1) ^ (value & 1 ? 0xedb88320 : 0));

/**
 * CRC-8 of polynomial x^8 + x^2 + x + 1.
 * @param {Uint8Array[]} parts
 */
export function crc8(parts) {
  let value = 0;
  for (const part of parts) for (const byte of part) value = CRC8[value ^ byte];
  return value;
}

/**
 * CRC-16 of polynomial 0x1021, from 0xffff on.
 * @param {Uint8Array[]} parts
 */
export function crc16(parts) {
  let value = 0xffff;
  for (const part of parts) {
    for (const byte of part) value = ((value << 8) & 0xffff) ^ CRC16[(value >> 8) ^ byte];
  }
  return value;
}

/**
 * CRC-32 (ISO-HDLC).
 * @param {Uint8Array[]} parts
 */
export function crc32(parts) {
  let value = -1;
  for (const part of parts) {
    for (const byte of part) value = (value >>> 8) ^ CRC32[(value ^ byte) & 0xff];
  }
  return ~value >>> 0;
}
