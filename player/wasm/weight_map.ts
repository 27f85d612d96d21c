const SIDE: i32 = 12;
/** The weights (12, 12) of a weight map, float32, row by row, which have to be written. */
export const cells: usize = memory.data(4 * SIDE * SIDE);

/** Write the weights (height, width), float32, between those of the map. */
export function writeWeights(to: usize, height: i32, width: i32): void {
  for (let i = 0; i < height; i++) {
    const row = placeOf(i, height);
    const top = cells + ((<i32>row * SIDE) << 2);
    const bottom = cells + ((min(<i32>row + 1, SIDE - 1) * SIDE) << 2);
    const down = <f32>(row - floor<f64>(row));
    for (let j = 0; j < width; j++, to += 4) {
      const column = placeOf(j, width);
      const left = (<i32>column) << 2;
      const right = min(<i32>column + 1, SIDE - 1) << 2;
      const across = <f32>(column - floor<f64>(column));
      const upper = mixed(load<f32>(top + left), load<f32>(top + right), across);
      const lower = mixed(load<f32>(bottom + left), load<f32>(bottom + right), across);
      store<f32>(to, mixed(upper, lower, down));
    }
  }
}

/** Where in a line of the map the middle of a sample of `count` ones is. */
function placeOf(sample: i32, count: i32): f64 {
  const at = ((<f64>sample + 0.5) * <f64>SIDE) / <f64>count - 0.5;
  return min(max(at, 0), <f64>(SIDE - 1));
}

function mixed(a: f32, b: f32, share: f32): f32 {
  return (1 - share) * a + share * b;
}
