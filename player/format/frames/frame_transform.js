import { EAUS } from "../../model/parameters.js";
import { AdaptiveIntegers } from "../entropy/adaptive_models.js";
import { RangeDecoder } from "../entropy/range_decoder.js";
import { checkShortest } from "../entropy/shortest_bytes.js";
import { check } from "../errors.js";
import { parseMap } from "../message_pack.js";

/** @typedef {import("../message_pack.js").Value} Value */
/**
 * The transform from n coefficients to d parameters, see docs/format.md, Frame transform.
 * @typedef {object} FrameTransform
 * @property {Uint8Array[]} modes encoded appearance modes; empty: not received
 * @property {number} layers layer coefficients of a frame
 * @property {number} reservedModes so many of the last modes may be empty
 * @property {number} components n
 * @property {number} parameters d
 * @property {Float64Array} mean (d) of the parameters
 * @property {Float64Array} matrix (n, d) what one unit of each component adds
 * @property {Int32Array} scaleCodes (n, `KINDS`)
 */

/** Parameters of motion, and with them the EAUs. */
export const MOTION = 6;
export const GEOMETRY = MOTION + EAUS;
/** Kinds of prediction. */
export const KINDS = 5;
const MAX_MODES = 64;
const RESERVED_UNIT_CODE = 120;
const RESERVED_SCALE_CODES = [22, 22, 18, 16, 12];

/**
 * The transform in the profile data of a default model.
 * @param {Uint8Array} data
 * @returns {FrameTransform}
 */
export function parseTransform(data) {
  const fields = parseMap(data, "frame transform");
  const order = [...fields.keys()].join("");
  check(/^mtl?s?$/.test(order), "frame transform: no map of the fields m, t, l, s");
  const modes = fields.get("m");
  const tables = fields.get("t");
  const layers = fields.get("l") ?? 0;
  check(Array.isArray(modes) && modes.length <= MAX_MODES, "frame transform: no modes");
  check(typeof layers === "number" && layers <= 16, `frame transform: ${layers} layers`);
  check(layers >= 1 || !fields.has("l"), "frame transform: no layers");
  const known = modes.map((mode) => {
    check(mode instanceof Uint8Array, "frame transform: a mode is no bytes");
    return mode;
  });
  check(tables instanceof Uint8Array, "frame transform: no tables");
  check(tables[0] >= 1 && tables[0] <= GEOMETRY + layers + MAX_MODES, "frame transform: no tables");
  const [sent, reserved] = reservedCounts(fields.get("s"), known.length);
  const own = known.length - sent;
  check(
    known.slice(own).every((mode) => mode.length),
    "frame transform: an empty mode is sent",
  );
  const base = parseTables(tables, GEOMETRY + layers + own, layers);
  const all = [...known, ...Array(reserved - sent).fill(new Uint8Array(0))];
  check(all.length <= MAX_MODES, `frame transform: ${all.length} modes, limit ${MAX_MODES}`);
  return { ...withReservedModes(base, reserved), modes: all, layers, reservedModes: reserved };
}

/**
 * @param {Value | undefined} value
 * @param {number} modes
 * @returns {[number, number]} reserved modes that are sent, and all
 */
function reservedCounts(value, modes) {
  if (value === undefined) return [0, 0];
  check(Array.isArray(value) && value.length === 2, "frame transform: s is not two numbers");
  const [sent, all] = value;
  check(typeof sent === "number" && typeof all === "number", "frame transform: s is no numbers");
  const isValid = all >= 1 && all <= MAX_MODES && sent >= 0 && sent <= Math.min(all, modes);
  check(isValid, `frame transform: ${sent} of ${all} reserved modes`);
  return [sent, all];
}

/**
 * @param {Uint8Array} tables
 * @param {number} d
 * @param {number} layers
 */
function parseTables(tables, d, layers) {
  const n = tables[0];
  const decoder = new RangeDecoder(tables.subarray(1));
  const groups = Array.from({ length: d }, (_, i) =>
    i < MOTION ? 0 : i < GEOMETRY ? 1 : i < GEOMETRY + layers ? 2 : 3,
  );
  const zeros = new Array(d).fill(0);
  const unitCodes = sums(table(decoder, 1, d, 1, zeros), 1, d);
  const meanCodes = table(decoder, 1, d, 1, zeros);
  const basis = table(decoder, n, d, 4, groups);
  const exponents = table(decoder, 1, n, 1, new Array(n).fill(0));
  const steps = table(decoder, n, KINDS, KINDS, [0, 1, 2, 3, 4]);
  const scaleCodes = sums(steps, n, KINDS).map((code) => 2 * code);
  checkShortest(decoder, "frame transform");
  check(
    unitCodes.every((code) => code >= 0 && code <= 255),
    "frame transform: a unit is too large",
  );
  check(
    basis.every((code) => Math.abs(code) <= 127),
    "frame transform: a basis is too large",
  );
  check(
    exponents.every((code) => Math.abs(code) <= 20),
    "frame transform: an exponent is too large",
  );
  check(
    scaleCodes.every((code) => code >= 0 && code <= 63),
    "frame transform: a scale is too large",
  );
  const units = Float64Array.from(unitCodes, (code) => 2 ** ((code - 128) / 8));
  const mean = units.map((unit, i) => (meanCodes[i] / 4) * unit);
  const matrix = new Float64Array(n * d);
  for (let c = 0; c < n; c++) {
    for (let i = 0; i < d; i++) {
      matrix[c * d + i] = (basis[c * d + i] / 127) * 2 ** exponents[c] * units[i];
    }
  }
  return { components: n, parameters: d, mean, matrix, scaleCodes };
}

/**
 * A table of integers, row by row.
 * @param {RangeDecoder} decoder
 * @param {number} rows
 * @param {number} columns
 * @param {number} contexts
 * @param {number[]} contextOf of each column
 */
function table(decoder, rows, columns, contexts, contextOf) {
  const integers = new AdaptiveIntegers(contexts);
  const values = new Int32Array(rows * columns);
  for (let i = 0; i < values.length; i++) {
    values[i] = integers.decode(decoder, contextOf[i % columns]);
  }
  return values;
}

/**
 * Sums of the steps in the rows and columns up to each place.
 * @param {Int32Array} steps
 * @param {number} rows
 * @param {number} columns
 */
function sums(steps, rows, columns) {
  const values = steps.slice();
  for (let i = 0; i < rows; i++) {
    for (let j = 1; j < columns; j++) values[i * columns + j] += values[i * columns + j - 1];
  }
  for (let i = columns; i < values.length; i++) values[i] += values[i - columns];
  return values;
}

/**
 * Tables with more modes, each with a component of its own.
 * @param {ReturnType<typeof parseTables>} base
 * @param {number} count
 */
function withReservedModes(base, count) {
  if (!count) return base;
  const n = base.components + count;
  const d = base.parameters + count;
  const mean = new Float64Array(d);
  mean.set(base.mean);
  const matrix = new Float64Array(n * d);
  for (let c = 0; c < base.components; c++) {
    const row = base.matrix.subarray(c * base.parameters, (c + 1) * base.parameters);
    matrix.set(row, c * d);
  }
  for (let i = 0; i < count; i++) {
    const place = (base.components + i) * d + base.parameters + i;
    matrix[place] = 2 ** ((RESERVED_UNIT_CODE - 128) / 8);
  }
  const reserved = new Array(count).fill(RESERVED_SCALE_CODES).flat();
  const scaleCodes = Int32Array.from([...base.scaleCodes, ...reserved]);
  return { components: n, parameters: d, mean, matrix, scaleCodes };
}
