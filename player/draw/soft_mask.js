// The opacity of the person in a picture, from their mask.
import { blurred, emptyRaster, gaussian, resized } from "./image_filters.js";

/** Of a background with layers, see `shared_model/layers/soft_mask.py`. */
const FEATHER_SIGMA = 1.5;
const FEATHER_REACH = 4;
const OPACITY_RANGE = [0.45, 0.9];
/** Of a background with a mask alone, see `decoder/scene/background_layers.py`. */
const ALPHA_RANGE = [0.02, 0.3];

/**
 * @param {Uint8Array} mask (side, side)
 * @param {number} side
 * @returns {import("./image_filters.js").Raster}
 */
function rasterOf(mask, side) {
  return { ...emptyRaster(side, side, 1), values: Float32Array.from(mask) };
}

/**
 * The opacity (height, width), 0..1, of the person of a background with layers.
 * @param {Uint8Array} mask
 * @param {number} side
 * @param {number} height
 * @param {number} width
 */
export function layerOpacity(mask, side, height, width) {
  const soft = feathered(mask, side);
  const [low, high] = OPACITY_RANGE;
  return resized(soft, height, width).values.map((value) =>
    Math.min(Math.max((value - low) / (high - low), 0), 1),
  );
}

/**
 * A mask blurred by a short kernel; beyond the ends the last value is repeated.
 * @param {Uint8Array} mask
 * @param {number} side
 */
function feathered(mask, side) {
  const weights = gaussian(FEATHER_SIGMA, FEATHER_REACH);
  let raster = rasterOf(mask, side);
  for (const step of [side, 1]) {
    const { values } = raster;
    const result = emptyRaster(side, side, 1);
    for (let at = 0; at < side * side; at++) {
      const place = step === 1 ? at % side : Math.floor(at / side);
      let sum = 0;
      for (let i = 0; i < weights.length; i++) {
        const other = Math.min(Math.max(place + i - FEATHER_REACH, 0), side - 1);
        sum += weights[i] * values[at + (other - place) * step];
      }
      result.values[at] = sum;
    }
    raster = result;
  }
  return raster;
}

/**
 * Of a background with a mask alone: the opacity (height, width), 0..1, of what moves with the
 * head, and where nothing of it is.
 * @param {Uint8Array} mask
 * @param {number} side
 * @param {number} height
 * @param {number} width
 */
export function maskOpacity(mask, side, height, width) {
  const soft = resized(blurred(rasterOf(mask, side), FEATHER_SIGMA), height, width).values;
  const [low, high] = ALPHA_RANGE;
  return {
    alpha: soft.map((value) => Math.min(Math.max((value - low) / (high - low), 0), 1)),
    isClear: Uint8Array.from(soft, (value) => (value <= low ? 1 : 0)),
  };
}
