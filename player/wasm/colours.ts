// Luma and the colour differences of blue and red, of four pixels at a time.

/** Weights of blue, green and red in luma. */
const BLUE: f32 = 0.114;
const GREEN: f32 = 0.587;
const RED: f32 = 0.299;

/** The green of four pixels of which luma, blue and red are known. */
export function greenOf(y: v128, blue: v128, red: v128): v128 {
  const others = f32x4.add(f32x4.mul(f32x4.splat(BLUE), blue), f32x4.mul(f32x4.splat(RED), red));
  return f32x4.div(f32x4.sub(y, others), f32x4.splat(GREEN));
}

/** Write four pixels R, G, B float32 of which luma, blue and red are known. */
export function writeColours(to: usize, y: v128, blue: v128, red: v128): void {
  const green = greenOf(y, blue, red);
  const first = v128.shuffle<i32>(red, green, 0, 4, 1, 5);
  const last = v128.shuffle<i32>(red, green, 2, 6, 3, 7);
  const middle = v128.shuffle<i32>(first, last, 3, 4, 5, 3);
  v128.store(to, v128.shuffle<i32>(first, blue, 0, 1, 4, 2));
  v128.store(to, v128.shuffle<i32>(middle, blue, 0, 5, 1, 2), 16);
  v128.store(to, v128.shuffle<i32>(last, blue, 6, 2, 3, 7), 32);
}

/** Write luma and differences of four pixels R, G, B float32. */
export function splitColours(from: usize, luma: usize, blues: usize, reds: usize): void {
  const a = v128.load(from);
  const b = v128.load(from, 16);
  const c = v128.load(from, 32);
  const red = v128.shuffle<i32>(v128.shuffle<i32>(a, b, 0, 3, 6, 6), c, 0, 1, 2, 5);
  const green = v128.shuffle<i32>(v128.shuffle<i32>(a, b, 1, 4, 7, 7), c, 0, 1, 2, 6);
  const blue = v128.shuffle<i32>(v128.shuffle<i32>(a, b, 2, 5, 5, 5), c, 0, 1, 4, 7);
  let y = f32x4.mul(f32x4.splat(RED), red);
  y = f32x4.add(y, f32x4.mul(f32x4.splat(GREEN), green));
  y = f32x4.add(y, f32x4.mul(f32x4.splat(BLUE), blue));
  v128.store(luma, y);
  v128.store(blues, f32x4.sub(blue, y));
  v128.store(reds, f32x4.sub(red, y));
}
