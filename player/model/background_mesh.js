// How the layer of the person moves with the head; see `shared_model/layers/head_motion.py`.
import { check } from "../format/errors.js";
import {
  cameraFromHead,
  conjugate,
  matrixFromQuaternion,
  multiply,
  pixelFromCamera,
  pixelFromHead,
} from "./geometry.js";
import { PARTS } from "./head.js";
import { maxUnfoldedStep } from "./mesh_folding.js";
import { clip, smoothstep } from "./parameters.js";
import { SkinConstraints } from "./skin_constraints.js";

/** @typedef {import("./geometry.js").Camera} Camera */
/** @typedef {import("./head.js").Head} Head */
/** @typedef {import("./parameters.js").Pose} Pose */

const CELLS_PER_FACE = 10;
const MAX_CELLS = 64;
/** In face widths. */
const HAIR_MARGIN = 0.15;
const FALLOFF_WIDTH = 0.8;
const NECK_LENGTH = 0.6;
const SKIN_SIGMA = 0.08;
const MAX_STRAIN = 0.55;
const MIN_AREA = 0.05;
/** Narrower or nearer faces cannot be drawn. */
const MIN_FACE_WIDTH_PX = 4;
export const NEAR_MM = 10;

/** The mesh of a background picture in which a head has a pose. */
export class BackgroundMesh {
  /**
   * @param {Camera} camera
   * @param {Pose} reference
   * @param {Head} head
   * @param {Float64Array} vertices (n, 3) mm, of the head in the picture
   */
  constructor(camera, reference, head, vertices) {
    this.camera = camera;
    this.reference = reference;
    const pixels = pixelFromHead(camera, reference, vertices);
    this.faceWidthPx = faceWidth(head, pixels);
    checkReference(reference, vertices, this.faceWidthPx);
    const { rows, columns, gridPx } = layOut(camera, this.faceWidthPx);
    this.rows = rows;
    this.columns = columns;
    this.gridPx = gridPx;
    const cellArea = (camera.width / (columns - 1)) * (camera.height / (rows - 1));
    this.minArea = MIN_AREA * cellArea;
    const outline = selected(pixels, (v) => head.parts[v] !== PARTS.SURROUND);
    this.distancePx = this.#distances(outline);
    this.rotationWeight = this.#rotationWeights(outline);
    this.rigidMm = this.lift(this.gridPx);
    this.edges = this.#edgeFalloff();
    this.skin = new SkinConstraints(this, head, vertices);
  }

  /**
   * A mesh, found step by step: it takes long.
   * @param {Camera} camera
   * @param {Pose} reference
   * @param {Head} head
   * @param {Float64Array} vertices
   * @returns {Generator<void, BackgroundMesh>}
   */
  static *found(camera, reference, head, vertices) {
    const mesh = new BackgroundMesh(camera, reference, head, vertices);
    yield* mesh.skin.weigh(mesh, SKIN_SIGMA * mesh.faceWidthPx);
    return mesh;
  }

  /**
   * Pixels (n, 2) in the plane of the head's origin: (n, 3) mm, camera frame.
   * @param {Float64Array} pixels
   */
  lift(pixels) {
    const { width, height, focalPx } = this.camera;
    const depth = this.reference.translation[2];
    const points = new Float64Array((pixels.length / 2) * 3);
    for (let i = 0, p = 0; i < pixels.length; i += 2, p += 3) {
      points[p] = ((pixels[i] - (width - 1) / 2) * depth) / focalPx;
      points[p + 1] = ((pixels[i + 1] - (height - 1) / 2) * depth) / focalPx;
      points[p + 2] = depth;
    }
    return points;
  }

  /**
   * How far each point is from the head and its hair, pixels.
   * @param {Float64Array} outline (n, 2)
   */
  #distances(outline) {
    const distances = new Float64Array(this.rows * this.columns);
    for (let p = 0; p < distances.length; p++) {
      let least = Infinity;
      const x = this.gridPx[2 * p];
      const y = this.gridPx[2 * p + 1];
      for (let i = 0; i < outline.length; i += 2) {
        const square = (x - outline[i]) ** 2 + (y - outline[i + 1]) ** 2;
        if (square < least) least = square;
      }
      distances[p] = Math.max(Math.sqrt(least) - HAIR_MARGIN * this.faceWidthPx, 0);
    }
    return distances;
  }

  /**
   * The weight of the head's rotation: 1 down to the chin, then falling to 0 along the neck.
   * @param {Float64Array} outline
   */
  #rotationWeights(outline) {
    const m = matrixFromQuaternion(this.reference.rotation);
    const length = Math.max(Math.hypot(m[1], m[4]), 1e-9);
    const down = [-m[1] / length, -m[4] / length];
    let chin = -Infinity;
    for (let i = 0; i < outline.length; i += 2) {
      chin = Math.max(chin, outline[i] * down[0] + outline[i + 1] * down[1]);
    }
    return Float64Array.from({ length: this.rows * this.columns }, (_, p) => {
      const along = this.gridPx[2 * p] * down[0] + this.gridPx[2 * p + 1] * down[1];
      return 1 - smoothstep((along - chin) / (NECK_LENGTH * this.faceWidthPx));
    });
  }

  /**
   * The mesh (rows, columns, 2), pixels, of a frame.
   * @param {Pose} pose
   * @param {Float64Array} vertices (n, 3) mm, head frame
   * @param {Float64Array | null} ownMotion (rows, columns, 2) pixels, beside that with the head
   */
  warp(pose, vertices, ownMotion) {
    let motion = this.#rigidMotion(pose);
    this.#fade(motion);
    motion = this.#holdEdges(motion);
    const own = this.#holdEdges(this.skin.motion(this, pose, vertices));
    if (ownMotion) for (let i = 0; i < own.length; i++) own[i] += ownMotion[i];
    const grid = this.gridPx.map((value, i) => value + motion[i]);
    const step = maxUnfoldedStep(grid, own, this.rows, this.columns, this.minArea);
    return grid.map((value, i) => value + step * own[i]);
  }

  /**
   * Camera-frame points (n, 3), mm, moved with the head from the reference to a pose.
   * @param {Pose} pose
   * @param {Float64Array} points
   */
  movedWithHead(pose, points) {
    const rotation = multiply(pose.rotation, conjugate(this.reference.rotation));
    const from = this.reference.translation;
    const shifted = points.map((value, i) => value - from[i % 3]);
    return cameraFromHead({ rotation, translation: pose.translation }, shifted);
  }

  /** @param {Pose} pose */
  #rigidMotion(pose) {
    const turned = this.movedWithHead(pose, this.rigidMm);
    const from = this.reference.translation;
    const target = this.rigidMm.map((value, i) => {
      const shifted = value + pose.translation[i % 3] - from[i % 3];
      return shifted + this.rotationWeight[Math.floor(i / 3)] * (turned[i] - shifted);
    });
    return pixelFromCamera(this.camera, target).map((value, i) => value - this.gridPx[i]);
  }

  /**
   * Let a motion fall off from the head; its reach grows with it.
   * @param {Float64Array} motion (rows, columns, 2), written
   */
  #fade(motion) {
    let largest = 0;
    for (let p = 0; p < this.distancePx.length; p++) {
      if (this.distancePx[p] === 0) {
        largest = Math.max(largest, Math.hypot(motion[2 * p], motion[2 * p + 1]));
      }
    }
    const reach = Math.max(FALLOFF_WIDTH * this.faceWidthPx, (1.5 * largest) / MAX_STRAIN);
    for (let i = 0; i < motion.length; i++)
      motion[i] *= 1 - smoothstep(this.distancePx[i >> 1] / reach);
  }

  /**
   * A motion whose inward part fades towards the picture's edge, which stays in place.
   * @param {Float64Array} motion (rows, columns, 2)
   */
  #holdEdges(motion) {
    const { fromFirst, fromLast } = this.edges;
    return motion.map((value, i) => value * (value > 0 ? fromFirst[i] : fromLast[i]));
  }

  #edgeFalloff() {
    const reach = this.faceWidthPx;
    const { gridPx } = this;
    const ends = [0, 1].map((axis) => {
      let low = Infinity;
      let high = -Infinity;
      for (let p = 0; p < this.distancePx.length; p++) {
        if (this.distancePx[p] !== 0) continue;
        low = Math.min(low, gridPx[2 * p + axis]);
        high = Math.max(high, gridPx[2 * p + axis]);
      }
      const first = gridPx[axis];
      const last = gridPx[gridPx.length - 2 + axis];
      const within = (/** @type {number} */ x) => clip(x, reach / CELLS_PER_FACE, reach);
      return { first, last, before: within(low - first), after: within(last - high) };
    });
    const fromFirst = gridPx.map((x, i) =>
      smoothstep((x - ends[i & 1].first) / ends[i & 1].before),
    );
    const fromLast = gridPx.map((x, i) => smoothstep((ends[i & 1].last - x) / ends[i & 1].after));
    return { fromFirst, fromLast };
  }
}

/**
 * Points (rows, columns, 2) evenly over the picture, pixels.
 * @param {Camera} camera
 * @param {number} faceWidthPx
 */
function layOut({ width, height }, faceWidthPx) {
  const cell = Math.max(faceWidthPx / CELLS_PER_FACE, Math.max(width, height) / MAX_CELLS);
  const columns = Math.ceil(width / cell) + 1;
  const rows = Math.ceil(height / cell) + 1;
  const gridPx = new Float64Array(rows * columns * 2);
  for (let p = 0; p < rows * columns; p++) {
    gridPx[2 * p] = -0.5 + ((p % columns) * width) / (columns - 1);
    gridPx[2 * p + 1] = -0.5 + (Math.floor(p / columns) * height) / (rows - 1);
  }
  return { rows, columns, gridPx };
}

/**
 * Width of the face in the picture, without its surround.
 * @param {Head} head
 * @param {Float64Array} pixels (n, 2)
 */
function faceWidth(head, pixels) {
  const drawn = selected(pixels, (v) => head.opacity[v] > 0 && head.parts[v] !== PARTS.SURROUND);
  let low = Infinity;
  let high = -Infinity;
  for (let i = 0; i < drawn.length; i += 2) {
    low = Math.min(low, drawn[i]);
    high = Math.max(high, drawn[i]);
  }
  return high - low;
}

/**
 * @param {Pose} reference
 * @param {Float64Array} vertices
 * @param {number} widthPx
 */
function checkReference(reference, vertices, widthPx) {
  const points = cameraFromHead(reference, vertices);
  let nearest = Infinity;
  for (let i = 2; i < points.length; i += 3) nearest = Math.min(nearest, points[i]);
  check(nearest >= NEAR_MM, `the reference pose puts the head ${nearest} mm before the camera`);
  check(widthPx >= MIN_FACE_WIDTH_PX, `the reference pose makes the face ${widthPx} px wide`);
}

/**
 * The pixels (k, 2) of the vertices that are wanted.
 * @param {Float64Array} pixels
 * @param {(vertex: number) => boolean} isWanted
 */
function selected(pixels, isWanted) {
  return pixels.filter((_, i) => isWanted(i >> 1));
}
