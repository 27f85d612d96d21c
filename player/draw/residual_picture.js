import { BLUE, GREEN, RED } from "../format/pictures/picture.js";
import { ResidualPictures } from "../format/residual/inverse_transform.js";
import { parseTiles } from "../format/residual/tile_decoder.js";

/** @typedef {import("../playout/frame_decoder.js").CodedResidual} CodedResidual */

/** Adds the picture residual of a call to drawn pictures. */
export class ResidualPicture {
  /**
   * @param {number} width of the pictures, pixels
   * @param {number} height
   */
  constructor(width, height) {
    this.width = width;
    this.height = height;
    /** @type {CodedResidual | null} */
    this.coded = null;
    /** @type {ResidualPictures | null} null: it is damaged */
    this.pictures = null;
  }

  /**
   * Add the residual of a source frame.  Throws `FormatError` if it is damaged, once.
   * @param {Uint8ClampedArray} pixels (height, width, 4), written
   * @param {CodedResidual} coded
   * @param {number} index of the source frame
   * @param {Float32Array} area (height, width) where the face is
   */
  addTo(pixels, coded, index, area) {
    if (this.coded !== coded) {
      this.coded = coded;
      this.pictures = null;
      this.pictures = new ResidualPictures(
        parseTiles(coded.data, this.width, this.height, coded.frames),
      );
    }
    const place = index - coded.first;
    if (!this.pictures || place < 0 || place >= coded.frames) return;
    const { columns, side } = this.pictures.tiles;
    const { coarse, fine } = this.pictures.planes(place);
    const across = columns * side;
    for (let y = 0; y < this.height; y++) {
      for (let x = 0; x < this.width; x++) {
        const p = y * this.width + x;
        const i = y * across + x;
        const j = (y >> 1) * (across / 2) + (x >> 1);
        const outside = 1 - area[p];
        const luma = outside * coarse[0][i] + fine[0][i];
        const blue = luma + 2 * (outside * coarse[1][j] + fine[1][j]);
        const red = luma + 2 * (outside * coarse[2][j] + fine[2][j]);
        pixels[4 * p] = Math.floor(pixels[4 * p] + red + 0.5);
        pixels[4 * p + 1] = Math.floor(
          pixels[4 * p + 1] + (luma - BLUE * blue - RED * red) / GREEN + 0.5,
        );
        pixels[4 * p + 2] = Math.floor(pixels[4 * p + 2] + blue + 0.5);
      }
    }
  }
}
