// What the player makes of calls, in integers: `node played_integers.js FILE ...` writes a line of
// JSON for each call file (.rzo) and each list of a link's events (.json), `tests/played_integers.py`
// says what is in it; for each list of packets (.hex) what is in each of them.
import { readFileSync } from "node:fs";
import { crc32 } from "../../player/format/checksums.js";
import { check } from "../../player/format/errors.js";
import {
  changeSize,
  isLayered,
  parseBackground,
  parseLayers,
} from "../../player/format/pictures/background.js";
import {
  isPicture,
  modeDecoder,
  PictureSequence,
  parsePictureHeader,
} from "../../player/format/pictures/picture.js";
import { parseTiles } from "../../player/format/residual/tile_decoder.js";
import { playCall } from "../../player/playout/call.js";
import { SPEECH_RATE_HZ } from "../../player/playout/frame_decoder.js";
import { Receiver } from "../../player/playout/receiver.js";
import {
  COARSE,
  FINE,
  fieldIntegers,
  guarded,
  OF_EAU,
  onGrid,
  packetsIntegers,
} from "./packet_integers.js";
import { bytesOf, CODEC } from "./vectors.js";

/** @typedef {import("../../player/playout/playout.js").PlayoutFrame} PlayoutFrame */
/** @typedef {import("../../player/playout/received_models.js").ReceivedModel} ReceivedModel */
/** A frame and the event at which it was shown. @typedef {{event: number, frame: PlayoutFrame}} Shown */

const MAX_SIDE_PX = 1024;

/**
 * CRC-32 of 32-bit integers, little-endian.
 * @param {Iterable<number>[]} parts
 */
function crcOf(parts) {
  return crc32(
    parts.map((part) => {
      const values = Int32Array.from(part);
      return new Uint8Array(values.buffer);
    }),
  );
}

/** @param {Uint8Array} file */
function playedFile(file) {
  let damages = 0;
  const { frames, isComplete } = playCall(file, () => damages++);
  const states = new Map(frames.map(({ received }) => [received.model.version, received]));
  const pictures = [...states.values()].map(pictureCrcs);
  const shown = frames.map((frame) => ({ event: 0, frame }));
  return { ...played(shown), pictures, spoken: [], damages, ended: isComplete };
}

/** @param {[number, number, number | null, string][]} events */
function playedLink(events) {
  let damages = 0;
  /** @type {number[][]} */
  const spoken = [];
  const receiver = new Receiver(() => damages++);
  const shown = events.flatMap(([atS, session, number, digits], event) => {
    const frames =
      digits === undefined
        ? receiver.poll(atS)
        : receiver.receive({ packet: bytesOf(digits), number, session }, atS);
    for (const { timeS, data } of receiver.takeSpeech())
      spoken.push([Math.round(SPEECH_RATE_HZ * timeS), crc32([data])]);
    return frames.map((frame) => ({ event, frame }));
  });
  return { ...played(shown), pictures: [], spoken, damages, ended: receiver.ended };
}

/** @param {Shown[]} shown */
function played(shown) {
  /** @type {Map<string, number>} */
  const models = new Map();
  /** @type {Map<string, number>} */
  const residuals = new Map();
  const frames = shown.map(({ event, frame }) => {
    const { received, residual } = frame;
    const model = JSON.stringify(modelIntegers(received));
    if (!models.has(model)) models.set(model, models.size);
    if (residual) {
      const key = Buffer.from(residual.data).toString("hex");
      if (!residuals.has(key)) residuals.set(key, guarded([], () => [tilesCrc(frame)])[0]);
    }
    return [event, ...frameIntegers(frame, models.get(model) ?? 0)];
  });
  return {
    frames,
    models: [...models.keys()].map((text) => JSON.parse(text)),
    residuals: [...residuals.values()],
  };
}

/**
 * @param {PlayoutFrame} frame
 * @param {number} model
 */
function frameIntegers({ index, timeS, isFrozen, isLost, presence, face, residual }, model) {
  return [
    index,
    ...onGrid([timeS], FINE),
    Number(isFrozen),
    Number(isLost),
    ...onGrid([presence], OF_EAU),
    model,
    ...onGrid(face.pose.rotation, FINE),
    ...onGrid(face.pose.translation, COARSE),
    ...onGrid(face.eau, OF_EAU),
    face.layers.length,
    ...onGrid(face.layers, COARSE),
    face.modes.length,
    ...onGrid(face.modes, COARSE),
    ...(residual ? [residual.first, residual.frames, crc32([residual.data])] : [-1, 0, 0]),
  ];
}

/** @param {PlayoutFrame} frame */
function tilesCrc({ residual, received }) {
  if (!residual) return 0;
  const { width, height } = received.model.call;
  const tiles = parseTiles(residual.data, width, height, residual.frames);
  const values = [...tiles.values].sort(([a], [b]) => a - b).map(([, own]) => own);
  return crcOf([[tiles.stepCode], tiles.flags, ...values]);
}

/** @param {ReceivedModel} received */
function modelIntegers({ model, modes, decoder }) {
  const { transform } = decoder;
  const values = fieldIntegers(model);
  if (!transform) return values;
  return [
    ...values,
    transform.layers,
    transform.reservedModes,
    modes.length,
    ...modes.map((mode) => crc32([mode])),
    ...transform.scaleCodes,
    ...onGrid(transform.mean, COARSE),
    ...onGrid(transform.matrix, COARSE),
  ];
}

/** @param {ReceivedModel} received */
function pictureCrcs(received) {
  const ofBackground = guarded([], () => backgroundCrcs(received.model));
  return guarded(ofBackground, () => textureCrcs(received));
}

/** @param {ReceivedModel} received */
function textureCrcs({ model, modes }) {
  const found = [pictureCrc(model.texture)];
  if (model.call.isThesis || !isPicture(model.texture)) return found;
  const { height, width, weightMap } = parsePictureHeader(model.texture, "texture");
  const decoder = modeDecoder(CODEC, height, width, weightMap);
  const missing = modes.findIndex((mode) => !mode.length);
  return closing(decoder, () => {
    for (const mode of missing < 0 ? modes : modes.slice(0, missing)) {
      found.push(modeCrc(decoder, mode));
    }
    return found;
  });
}

/** @param {import("../../player/format/model_packet.js").ModelPacket} model */
function backgroundCrcs({ background, call: { width, height } }) {
  if (!isLayered(background)) {
    const { mask, picture } = parseBackground(CODEC, background);
    return [mask ? crc32([mask]) : 0, pictureCrc(picture)];
  }
  const layers = parseLayers(CODEC, background, width, height);
  const { rows, columns } = changeSize(width, height);
  const decoder = modeDecoder(CODEC, rows, columns, new Uint8Array(0));
  return closing(decoder, () => [
    crc32([layers.mask]),
    pictureCrc(layers.person),
    pictureCrc(layers.scene),
    crcOf([layers.fields.codes]),
    ...layers.changes.map((change) => modeCrc(decoder, change)),
    Number(layers.sceneMoves),
    Number(layers.lightChanges),
  ]);
}

/**
 * What is found with a decoder, which is closed then.
 * @template T
 * @param {PictureSequence} decoder
 * @param {() => T} find
 */
function closing(decoder, find) {
  try {
    return find();
  } finally {
    decoder.close();
  }
}

/** @param {Uint8Array} data */
function pictureCrc(data) {
  if (!isPicture(data)) return -1;
  const { kind, width, height, coefficients } = parsePictureHeader(data, "picture");
  check(Math.max(width, height) <= MAX_SIDE_PX, "a picture is too large");
  const decoder = new PictureSequence(CODEC, kind, height, width, null);
  return closing(decoder, () => modeCrc(decoder, coefficients));
}

/**
 * @param {PictureSequence} decoder
 * @param {Uint8Array} data
 */
function modeCrc(decoder, data) {
  decoder.decode(data, "picture");
  const places = [0, 1, 2].flatMap((plane) => [
    [plane, 0, 0],
    ...[1, 2, 3, 4, 5].flatMap((level) => [0, 1, 2].map((band) => [plane, level, band])),
  ]);
  return crcOf(
    places.map(([plane, level, band]) => decoder.compiled.coefficients(plane, level, band)),
  );
}

/** @param {string} path */
function resultOf(path) {
  const data = readFileSync(path);
  if (path.endsWith(".hex")) return packetsIntegers(data.toString());
  if (path.endsWith(".json")) return playedLink(JSON.parse(data.toString()));
  return playedFile(new Uint8Array(data));
}

for (const path of process.argv.slice(2)) console.log(JSON.stringify(resultOf(path)));
