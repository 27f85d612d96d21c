/** @typedef {import("./background_pictures.js").Bitmap} Bitmap */

const CLEAR = 0;
const BLENDED = 1;
const SOLID = 2;
/** A grey level of a change that stands for no change. */
export const NO_CHANGE = 128;

/**
 * The cells of a mesh in the order in which they are drawn: a layer's colours are changed only in
 * those that a change reaches, which are few, as that takes a third of a layer's time in software.
 */
export class LayerCells {
  /**
   * @param {number} rows of the mesh's points
   * @param {number} columns
   * @param {Float32Array} coordinates (rows, columns, 2) 0..1
   * @param {Bitmap} person the picture of the layer in front
   */
  constructor(rows, columns, coordinates, person) {
    this.rows = rows - 1;
    this.columns = columns - 1;
    this.kinds = Uint8Array.from({ length: this.rows * this.columns }, (_, cell) => {
      const first = this.#corner(cell);
      return kindOf(person, coordinates, first, first + columns + 1);
    });
    this.isChanged = new Uint8Array(this.kinds.length);
    /** corners of triangles: of the solid person, of the blended one, of the scene; see `order` */
    this.indices = new Uint32Array(12 * this.kinds.length);
  }

  /** @param {number} cell */
  #corner(cell) {
    return cell + Math.floor(cell / this.columns);
  }

  /**
   * Write the indices of a frame; returns where of each kind those end that no change reaches, and
   * the others.
   * @param {Uint8ClampedArray | null} change (rows, columns, 4), see `changeOf`
   * @param {{rows: number, columns: number}} size of the change
   */
  order(change, size) {
    this.isChanged.fill(0);
    if (change) this.#mark(change, size);
    const ends = [];
    let end = 0;
    for (const kind of [SOLID, BLENDED, null]) {
      for (const isChanged of [0, 1]) {
        for (let cell = 0; cell < this.kinds.length; cell++) {
          if (this.isChanged[cell] !== isChanged) continue;
          if (kind !== null && this.kinds[cell] !== kind) continue;
          const a = this.#corner(cell);
          // The scene does not bend: as much of a row as is alike at once.
          if (kind === null) cell = this.#lastAlike(cell);
          const c = this.#corner(cell) + 1;
          const below = this.columns + 1;
          this.indices.set([a, a + below, c, c, a + below, c + below], end);
          end += 6;
        }
        ends.push(end);
      }
    }
    return ends;
  }

  /**
   * The last cell of a row up to which a change reaches all or none.
   * @param {number} cell
   */
  #lastAlike(cell) {
    const end = (Math.floor(cell / this.columns) + 1) * this.columns;
    let last = cell;
    while (last + 1 < end && this.isChanged[last + 1] === this.isChanged[cell]) last++;
    return last;
  }

  /**
   * Find the cells that a change reaches: each of its values reaches to the next ones' middles.
   * @param {Uint8ClampedArray} change
   * @param {{rows: number, columns: number}} size
   */
  #mark(change, { rows, columns }) {
    for (let at = 0; at < rows * columns; at++) {
      const p = 4 * at;
      const isNone =
        change[p] === NO_CHANGE && change[p + 1] === NO_CHANGE && change[p + 2] === NO_CHANGE;
      if (isNone) continue;
      const [top, bottom] = reached(Math.floor(at / columns), rows, this.rows);
      const [left, right] = reached(at % columns, columns, this.columns);
      for (let i = top; i <= bottom; i++)
        this.isChanged.fill(1, i * this.columns + left, i * this.columns + right + 1);
    }
  }
}

/**
 * The first and the last cell that a value reaches.
 * @param {number} place of the value
 * @param {number} values
 * @param {number} cells
 */
function reached(place, values, cells) {
  const first = Math.floor(((place - 0.5) / values) * cells);
  const last = Math.floor(((place + 1.5) / values) * cells);
  return [Math.max(first, 0), Math.min(last, cells - 1)];
}

/**
 * Whether a picture is opaque, transparent, or neither between two corners and a little beyond.
 * @param {Bitmap} picture
 * @param {Float32Array} coordinates
 * @param {number} first
 * @param {number} last
 */
function kindOf({ width, height, values }, coordinates, first, last) {
  const left = Math.max(Math.floor(coordinates[2 * first] * width) - 2, 0);
  const top = Math.max(Math.floor(coordinates[2 * first + 1] * height) - 2, 0);
  const right = Math.min(Math.ceil(coordinates[2 * last] * width) + 2, width);
  const bottom = Math.min(Math.ceil(coordinates[2 * last + 1] * height) + 2, height);
  let isSolid = true;
  let isClear = true;
  for (let y = top; y < bottom; y++) {
    for (let x = left; x < right; x++) {
      const alpha = values[4 * (y * width + x) + 3];
      isSolid &&= alpha === 255;
      isClear &&= alpha === 0;
    }
  }
  return isSolid ? SOLID : isClear ? CLEAR : BLENDED;
}
