import { allocateZeros } from "./memory";
import { adaptiveBit } from "./range_decoder";

/** Zeros around the cells, so that those of a context need no test. */
const PAD: i32 = 2;

/** Address of the mask (side, side), uint8, of a person, that is read from the range decoder. */
export function readMask(side: i32): usize {
  const across = side + 2 * PAD;
  const cells = allocateZeros((side + PAD) * across);
  const mask = allocateZeros(side * side);
  let to = mask;
  for (let i = 0; i < side; i++) {
    let at = cells + (i + PAD) * across + PAD;
    for (let j = 0; j < side; j++, at++, to++) {
      const above = at - across;
      let context: i32 = load<u8>(at - 1);
      context = (context << 1) | load<u8>(above - 1);
      context = (context << 1) | load<u8>(above);
      context = (context << 1) | load<u8>(above + 1);
      context = (context << 1) | load<u8>(at - 2);
      context = (context << 1) | load<u8>(above - across);
      const cell = adaptiveBit(context);
      store<u8>(at, cell);
      store<u8>(to, cell);
    }
  }
  return mask;
}
