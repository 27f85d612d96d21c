import assert from "node:assert/strict";
import { test } from "node:test";
import { parseFace } from "../../player/page/face_message.js";
import { bytesOf } from "./vectors.js";

/** What tests/test_call_page/test_face_message.py writes. */
const BYTES =
  "41020300fa0000000000000000002440000000000000f03f070000000000403f0200010000000000" +
  "0000803f0000000000000000000020410000a0c1000016440000000000000000000000000000000000" +
  "00000000000000000000000000000000000000000000000000000000000000000000000000803e0000" +
  "003f000080bf00000040";
const HEADER_BYTES = 24;

test("a face of the program", () => {
  const shown = parseFace(/** @type {ArrayBuffer} */ (bytesOf(BYTES).buffer), HEADER_BYTES);
  assert.deepEqual([shown.model, shown.presence], [7, 0.75]);
  assert.deepEqual(shown.face.pose, { rotation: [0, 1, 0, 0], translation: [10, -20, 600] });
  assert.deepEqual([...shown.face.eau], [...Array(13).fill(0), 0.25]);
  assert.deepEqual([...shown.face.layers], [0.5, -1]);
  assert.deepEqual([...shown.face.modes], [2]);
});
