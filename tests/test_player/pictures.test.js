import assert from "node:assert/strict";
import { test } from "node:test";
import {
  changeSize,
  isLayered,
  parseBackground,
  parseLayers,
} from "../../player/format/pictures/background.js";
import {
  decodePicture,
  modeDecoder,
  PictureSequence,
} from "../../player/format/pictures/picture.js";
import { ResidualPictures } from "../../player/format/residual/inverse_transform.js";
import { parseTiles } from "../../player/format/residual/tile_decoder.js";
import { readCall } from "../../player/playout/call.js";
import { bytesOf, CODEC, hex, json, text } from "./vectors.js";

/** @typedef {import("../../player/format/pictures/picture.js").Image} Image */

/** Level and orientation of the subbands of a plane, in the order in which they are coded. */
const BANDS = [
  [0, 0],
  ...[1, 2, 3, 4, 5].flatMap((level) => [0, 1, 2].map((band) => [level, band])),
];

for (const name of ["call_default", "call_thesis"]) {
  test(`${name}: the pictures of its first model`, () => {
    const { model } = readCall(hex(`${name}.hex`)).frames[0].received;
    const expected = json(`${name}.json`).pictures;
    const { mask, maskSide, picture } = parseBackground(CODEC, model.background);
    checkMask(mask ?? new Uint8Array(0), maskSide, expected.mask);
    checkPicture(decodePicture(CODEC, picture, "background", 1024), expected.background);
    checkPicture(decodePicture(CODEC, model.texture, "texture", 1024), expected.texture);
  });
}

test("call_layers: person, scene, motion fields and changes", () => {
  const { model } = readCall(hex("call_layers.hex")).frames[0].received;
  const expected = json("call_layers.json").layers;
  const { width, height } = model.call;
  assert.ok(isLayered(model.background));
  const layers = parseLayers(CODEC, model.background, width, height);
  checkMask(layers.mask, layers.maskSide, expected.mask);
  assert.deepEqual([...layers.fields.codes], expected.fields.flat(3));
  const { rows, columns } = changeSize(width, height);
  const changes = modeDecoder(CODEC, rows, columns, new Uint8Array(0));
  const pictures = [
    decodePicture(CODEC, layers.person, "person", 1024),
    decodePicture(CODEC, layers.scene, "scene", 1024),
    ...layers.changes.map((change) => changes.decode(change, "change")),
  ];
  for (const [i, picture] of pictures.entries()) {
    checkRow(picture, expected.person_and_scene_and_changes[i]);
  }
});

for (const [kind, name] of ["background", "texture", "mode"].entries()) {
  test(`picture_${name}: the coefficients of pictures of 24 rows and 20 columns`, () => {
    const lines = text(`picture_${name}.txt`).trim().split("\n");
    const sequence = new PictureSequence(CODEC, kind, 24, 20, null);
    for (let at = 0; at < lines.length; at += 4) {
      sequence.decode(Uint8Array.from([0, ...bytesOf(lines[at])]), name);
      for (let plane = 0; plane < 3; plane++) {
        const found = BANDS.flatMap(([level, band]) => [
          ...sequence.compiled.coefficients(plane, level, band),
        ]);
        assert.deepEqual(found, lines[at + 1 + plane].split(",").map(Number));
      }
    }
    sequence.close();
  });
}

test("call_residual: tiles and samples", () => {
  const coded = readCall(hex("call_residual.hex")).frames.flatMap((frame) =>
    frame.residual ? [frame] : [],
  );
  const [expected] = json("call_residual.json").residuals;
  const { residual, received } = coded[0];
  assert.ok(residual);
  assert.equal(residual.first, expected.first);
  const { width, height } = received.model.call;
  const tiles = parseTiles(residual.data, width, height, residual.frames);
  assert.equal(tiles.stepCode, expected.step_code);
  assert.deepEqual([...tiles.flags], expected.flags.flat());
  const values = [...tiles.values].flatMap(([at, own]) => {
    const size = own.length / tiles.frames;
    return [...own].flatMap((value, i) =>
      value
        ? [
            [
              Math.floor(at / tiles.columns),
              at % tiles.columns,
              Math.floor(i / size),
              i % size,
              value,
            ],
          ]
        : [],
    );
  });
  assert.deepEqual(values, expected.values);
  const pictures = new ResidualPictures(tiles);
  for (let frame = 0; frame < tiles.frames; frame++) {
    const { coarse, fine } = pictures.planes(frame);
    const row = height >> 1;
    for (let x = 0; x < width; x++) {
      const luma = tiles.columns * tiles.side;
      const at = [row * luma + x, ...Array(2).fill((row >> 1) * (luma / 2) + (x >> 1))];
      // The face of the vector is to the left.
      const outside = x < width >> 1 ? 0 : 1;
      const [y, b, r] = [0, 1, 2].map((p) => outside * coarse[p][at[p]] + fine[p][at[p]]);
      const blue = y + 2 * b;
      const red = y + 2 * r;
      const wanted = expected.on_grey[frame][x];
      for (const [k, value] of [blue, (y - 0.114 * blue - 0.299 * red) / 0.587, red].entries()) {
        const shown = Math.floor(Math.min(Math.max(128 + value + 0.5, 0), 255));
        assert.ok(Math.abs(shown - wanted[k]) <= 1, `${shown} ${wanted[k]}`);
      }
    }
  }
});

/**
 * @param {Uint8Array} mask
 * @param {number} side
 * @param {string[]} rows
 */
function checkMask(mask, side, rows) {
  const drawn = rows.map((_, i) =>
    [...mask.subarray(i * side, (i + 1) * side)].map((cell) => (cell ? "#" : ".")).join(""),
  );
  assert.deepEqual(drawn, rows);
}

/**
 * @param {Image} picture
 * @param {{size: number[], bgr: number[][]}} expected
 */
function checkPicture(picture, expected) {
  assert.deepEqual([picture.width, picture.height], expected.size);
  checkRow(picture, expected.bgr);
}

/**
 * @param {Image} picture
 * @param {number[][]} bgr its middle row
 */
function checkRow({ height, width, values }, bgr) {
  const start = 3 * (height >> 1) * width;
  for (const [x, pixel] of bgr.entries()) {
    for (let k = 0; k < 3; k++) {
      assert.ok(
        Math.abs(values[start + 3 * x + 2 - k] - pixel[k]) < 0.01,
        `${values[start + 3 * x + 2 - k]} ${pixel[k]}`,
      );
    }
  }
}
