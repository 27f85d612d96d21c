// What the judge's environment runs for identity: the face recognition network `faceres` of the npm package
// @vladmandic/human (after Savchenko's HSE-FaceRes), by TensorFlow.js.
//
//   NODE_PATH=MODULES node identity_program.cjs MODULES < RGB crops of 224x224 > 1024 float32 for each
"use strict";
const { readFileSync } = require("node:fs");
const path = require("node:path");
const tf = require("@tensorflow/tfjs-core");
const wasm = require("@tensorflow/tfjs-backend-wasm");
const { loadGraphModel } = require("@tensorflow/tfjs-converter");

const SIDE = 224;
const FEATURES = "global_pooling/Mean";

async function main() {
  wasm.setWasmPaths(`${path.dirname(require.resolve("@tensorflow/tfjs-backend-wasm"))}/`);
  await tf.setBackend("wasm");
  const models = path.join(process.argv[2], "@vladmandic", "human", "models");
  const description = JSON.parse(readFileSync(path.join(models, "faceres.json"), "utf8"));
  const data = readFileSync(path.join(models, "faceres.bin"));
  const network = await loadGraphModel({
    load: async () => ({
      modelTopology: description.modelTopology,
      weightSpecs: description.weightsManifest[0].weights,
      weightData: data.buffer.slice(data.byteOffset, data.byteOffset + data.length),
    }),
  });
  const crops = readFileSync(0);
  const size = SIDE * SIDE * 3;
  for (let start = 0; start + size <= crops.length; start += size) {
    const crop = tf.tensor4d(Float32Array.from(crops.subarray(start, start + size)), [
      1,
      SIDE,
      SIDE,
      3,
    ]);
    const features = network.execute(crop, FEATURES);
    process.stdout.write(Buffer.from(Float32Array.from(await features.data()).buffer));
    tf.dispose([crop, features]);
  }
}

main().catch((error) => {
  console.error(String(error.message || error));
  process.exit(1);
});
