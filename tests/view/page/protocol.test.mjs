import assert from "node:assert/strict";
import test from "node:test";
import { binsFrame, pathFrame, samplesFrame } from "./frames.mjs";
import { load } from "./load.mjs";

const { decodeFrame, encodeIntention, parseText, FLAG_GAP, FLAG_BACKFILL } = await load("protocol");

test("a frame of samples gives its header, times and planes", () => {
  const frame = decodeFrame(samplesFrame([[0, 0.001], [1, 2], [3, NaN]], { t0: 12.5, sent: 13, sequence: 7, request: 9, flags: FLAG_GAP | FLAG_BACKFILL }));
  assert.equal(frame.kind, 1);
  assert.deepEqual(frame.header, { kind: 1, version: 1, flags: 3, sequence: 7, rows: 2, request: 9, t0: 12.5, sent: 13 });
  assert.deepEqual([...frame.time], [0, Math.fround(0.001)]);
  assert.equal(frame.planes.length, 2);
  assert.deepEqual([...frame.planes[0]], [1, 2]);
  assert.deepEqual([...frame.planes[1]], [3, NaN]);
});

test("a frame of samples without rows is a frame without rows", () => {
  const frame = decodeFrame(samplesFrame([[], [], []], { request: 4 }));
  assert.equal(frame.time.length, 0);
  assert.equal(frame.header.request, 4);
});

test("a frame of bins gives each channel's planes, with the order padded to four bytes", () => {
  const channel = (k) => ({ first: [k, k, k], min: [k - 1, k - 1, k - 1], max: [k + 1, k + 1, k + 1], last: [k, k, k], order: [1, 0, 1] });
  const frame = decodeFrame(binsFrame(0.004, [channel(5), channel(8)], { t0: 2, request: 3 }));
  assert.equal(frame.width, 0.004);
  assert.equal(frame.channels.length, 2);
  assert.deepEqual([...frame.channels[1].min], [7, 7, 7]);
  assert.deepEqual([...frame.channels[1].order], [1, 0, 1]);
  assert.deepEqual([...frame.channels[0].last], [5, 5, 5]);
});

test("a frame of a path gives place, radius and length of each point", () => {
  const frame = decodeFrame(pathFrame([[0, 1], [1, 2], [3, 4], [5, 6], [0.005, NaN], [0, 0.1]], { request: 2 }));
  assert.equal(frame.kind, 4);
  assert.deepEqual([...frame.y], [3, 4]);
  assert.ok(Number.isNaN(frame.radius[1]));
  assert.deepEqual([...frame.length], [0, Math.fround(0.1)]);
});

test("frames that contradict their header, or of another version or kind, are ignored", () => {
  const good = samplesFrame([[0, 1], [2, 3]]);
  assert.notEqual(decodeFrame(good), null);
  assert.equal(decodeFrame(good.slice(0, good.byteLength - 1)), null);
  assert.equal(decodeFrame(good.slice(0, 31)), null);
  assert.equal(decodeFrame(samplesFrame([[0], [1]], { version: 2 })), null);
  assert.equal(decodeFrame(samplesFrame([[0], [1]], { kind: 5 })), null);
  const bins = binsFrame(0.001, [{ first: [1], min: [1], max: [1], last: [1], order: [1] }]);
  new DataView(bins).setUint32(32, 1000000, true); // a number of channels that the frame does not hold
  assert.equal(decodeFrame(bins), null);
  const zero = binsFrame(0, [{ first: [1], min: [1], max: [1], last: [1], order: [1] }]);
  assert.equal(decodeFrame(zero), null);
  const path = pathFrame([[0], [1], [2], [3], [4]]);
  assert.equal(decodeFrame(path), null);
});

test("random bytes never throw", () => {
  let state = 1;
  const random = () => (state = (state * 1103515245 + 12345) % 2147483648) / 2147483648;
  for (let n = 0; n < 3000; n++) {
    const bytes = Uint8Array.from({ length: Math.floor(random() * 200) }, () => Math.floor(random() * 256));
    if (bytes.length > 1) bytes[1] = 1;
    if (bytes.length > 0) bytes[0] = Math.floor(random() * 9);
    decodeFrame(bytes.buffer);
  }
});

test("an intention is 56 bytes: header, place, grip, input, depth", () => {
  const v = new DataView(encodeIntention({ x: 0.01, y: -0.02, z: 0.03, grip: 0.5, input: 2, depth: 1 }, 41));
  assert.equal(v.byteLength, 56);
  assert.equal(v.getUint8(0), 8);
  assert.equal(v.getUint8(1), 1);
  assert.equal(v.getUint32(4, true), 41);
  assert.equal(v.getUint32(8, true), 1);
  assert.equal(v.getFloat32(36, true), Math.fround(-0.02));
  assert.equal(v.getFloat32(44, true), 0.5);
  assert.equal(v.getUint32(48, true), 2);
  assert.equal(v.getUint32(52, true), 1);
});

test("a text that is no message is ignored", () => {
  for (const text of ["", "nonsense", "[]", "null", "3", '{"kind":1}', '{"type":3}']) assert.equal(parseText(text), null);
  assert.equal(parseText('{"type":"pong","id":1}').type, "pong");
});
