import assert from "node:assert/strict";
import test from "node:test";
import { load } from "./load.mjs";

const { roomBeside, bytesOf, lengthWords, readToken } = await load("dialogs", "client");

test("a dialog gets the largest part of the window that leaves Stop free", () => {
  const header = { left: 256, top: 4, right: 352, bottom: 64 };
  assert.deepEqual(roomBeside(header, 360, 640), { left: 8, top: 72, right: 352, bottom: 632 });
  const lower = { left: 0, top: 563, right: 360, bottom: 640 };
  assert.deepEqual(roomBeside(lower, 360, 640), { left: 8, top: 8, right: 352, bottom: 555 });
  const corner = { left: 0, top: 0, right: 400, bottom: 200 };
  assert.deepEqual(roomBeside(corner, 1280, 240), { left: 408, top: 8, right: 1272, bottom: 232 });
});

test("without a Stop in the window a dialog may use all of it", () => {
  const all = { left: 8, top: 8, right: 352, bottom: 632 };
  assert.deepEqual(roomBeside(null, 360, 640), all);
  assert.deepEqual(roomBeside({ left: 10, top: 700, right: 80, bottom: 760 }, 360, 640), all);
});

test("the length of a text counts in bytes, as the session counts it", () => {
  assert.equal(bytesOf("müde"), 5);
  assert.equal(lengthWords("tired", 120), "");
  assert.equal(lengthWords("a".repeat(119), 120), "1 byte left");
  assert.equal(lengthWords("ü".repeat(60), 120), "0 bytes left");
  assert.match(lengthWords("ü".repeat(61), 120), /too long by 2 bytes.*at most 120/);
});

test("the page takes every token that the server takes", () => {
  const hex = "0123456789abcdef0123456789abcdef";
  assert.deepEqual(readToken(`#${hex}`), { token: hex, test: false });
  assert.deepEqual(readToken(`#${hex}&test`), { token: hex, test: true });
  for (const token of ["Sixteen0letters0", "z".repeat(128)]) assert.equal(readToken(`#${token}`)?.token, token);
  for (const hash of ["", "#", "#short", `#${"z".repeat(129)}`, `#${hex}-`, `#${hex}&other`]) assert.equal(readToken(hash), null, hash);
});
