import { allocate } from "./memory";

/** Triangles with less area have no texels, squared texels. */
const LEAST_AREA: f64 = 1e-12;
/** How far beyond an edge a texel still is on it, as a weight of a corner. */
const EDGE: f64 = 1e-9;
const BYTES_OF_CORNERS: i32 = 48;

let corners: usize = 0;
let triangles: i32 = 0;
let size: i32 = 0;
let owner: usize = 0;
let weights: usize = 0;

/** Where corners (count, 3, 2), column and row from 0 to 1, of an atlas of `ofSize` texels a side have to be written, float64. */
export function place(count: i32, ofSize: i32): usize {
  triangles = count;
  size = ofSize;
  corners = allocate(count * BYTES_OF_CORNERS);
  return corners;
}

/** Address of the triangle (size, size) int32 at each texel, -1: none; the weights (size, size, 2) float32 of its second and third corner follow. */
export function cover(): usize {
  const texels = size * size;
  owner = allocate((3 * texels) << 2);
  weights = owner + (texels << 2);
  memory.fill(owner, 0xff, texels << 2);
  memory.fill(weights, 0, (2 * texels) << 2);
  for (let t = 0; t < triangles; t++) coverTriangle(t);
  return owner;
}

function coordinate(triangle: i32, index: i32): f64 {
  return load<f64>(corners + triangle * BYTES_OF_CORNERS + (index << 3)) * <f64>size - 0.5;
}

function coverTriangle(t: i32): void {
  const ax = coordinate(t, 0);
  const ay = coordinate(t, 1);
  const bx = coordinate(t, 2) - ax;
  const by = coordinate(t, 3) - ay;
  const cx = coordinate(t, 4) - ax;
  const cy = coordinate(t, 5) - ay;
  const area = bx * cy - by * cx;
  if (abs<f64>(area) < LEAST_AREA) return;
  const last = <f64>(size - 1);
  const left = <i32>max(ceil<f64>(ax + min<f64>(0, min<f64>(bx, cx))), 0);
  const right = <i32>min(floor<f64>(ax + max<f64>(0, max<f64>(bx, cx))), last);
  const top = <i32>max(ceil<f64>(ay + min<f64>(0, min<f64>(by, cy))), 0);
  const bottom = <i32>min(floor<f64>(ay + max<f64>(0, max<f64>(by, cy))), last);
  for (let y = top; y <= bottom; y++) {
    for (let x = left; x <= right; x++) {
      const wb = ((<f64>x - ax) * cy - (<f64>y - ay) * cx) / area;
      const wc = (bx * (<f64>y - ay) - by * (<f64>x - ax)) / area;
      if (wb < -EDGE || wc < -EDGE || wb + wc > 1 + EDGE) continue;
      const at = (y * size + x) << 2;
      store<i32>(owner + at, t);
      store<f32>(weights + 2 * at, <f32>wb);
      store<f32>(weights + 2 * at + 4, <f32>wc);
    }
  }
}
