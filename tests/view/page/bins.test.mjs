import assert from "node:assert/strict";
import test from "node:test";
import { binsFrame, samplesFrame } from "./frames.mjs";
import { load } from "./load.mjs";

const { binOf, binWidth, drawBins, FrameBins, LiveBins, rangeOf, RowRing, decodeFrame } = await load("bins", "rows", "protocol");

// Rows at k * period with the values of a function, in a ring.
function ringOf(values, period = 0.001, start = 0, capacity = 4096) {
  const ring = new RowRing(1, capacity);
  push(ring, values, period, start);
  return ring;
}
function push(ring, values, period, start) {
  ring.push({ header: { t0: start }, time: Float32Array.from(values, (_, i) => i * period), planes: [Float32Array.from(values)] });
}
const plain = (a) => [...a].map((v) => Math.round(v * 1e6) / 1e6);

test("the bin width is a power of two times the row period", () => {
  assert.equal(binWidth(10, 500, 0.001), 0.032);
  assert.equal(binWidth(0.2, 500, 0.001), 0.001);
  assert.equal(binWidth(36000, 600, 0.001), 0.001 * 2 ** 16);
});

test("a time at the start of a bin belongs to that bin, also when rounded", () => {
  for (let k = 0; k < 12000; k++) assert.equal(binOf(3600 + Math.fround(k * 0.001), 0.001), 3600000 + k);
  assert.equal(binOf(0.00199, 0.001), 1);
});

test("live bins keep first, least, largest and last value and which came first", () => {
  const live = new LiveBins(["x"], [0], 64);
  live.update(ringOf([3, 9, 1, 4, /**/ 5, 2, 8, 7]), 0.004);
  const c = live.channel("x");
  assert.deepEqual([live.k0, live.k1], [0, 2]);
  assert.deepEqual(plain(c.first.slice(0, 2)), [3, 5]);
  assert.deepEqual(plain(c.min.slice(0, 2)), [1, 2]);
  assert.deepEqual(plain(c.max.slice(0, 2)), [9, 8]);
  assert.deepEqual(plain(c.last.slice(0, 2)), [4, 7]);
  assert.deepEqual([...c.order.slice(0, 2)], [0, 1]);
});

test("rows that come one by one give the same bins as rows that come at once", () => {
  const values = Array.from({ length: 700 }, (_, i) => Math.sin(i * 0.7) * (i % 13));
  const whole = new LiveBins(["x"], [0], 1024);
  whole.update(ringOf(values), 0.008);
  const parts = new LiveBins(["x"], [0], 1024);
  const ring = new RowRing(1, 4096);
  for (let i = 0; i < values.length; i += 7) {
    push(ring, values.slice(i, i + 7), 0.001, i * 0.001);
    parts.update(ring, 0.008);
  }
  for (const plane of ["first", "min", "max", "last", "order"]) assert.deepEqual([...parts.channel("x")[plane]], [...whole.channel("x")[plane]]);
});

test("a peak of one sample is in the bins of every width", () => {
  const values = new Array(4000).fill(0);
  values[2345] = 5;
  values[2346] = -3;
  const ring = ringOf(values);
  for (let width = 0.001; width < 5; width *= 2) {
    const live = new LiveBins(["x"], [0], 8192);
    live.update(ring, width);
    assert.deepEqual(rangeOf(live, live.channel("x"), 0, 8192), [-3, 5], `width ${width}`);
  }
});

test("values that were not measured leave a bin without a value", () => {
  const live = new LiveBins(["x"], [0], 64);
  live.update(ringOf([1, NaN, NaN, NaN, 6, NaN, NaN, 8]), 0.002);
  const c = live.channel("x");
  assert.deepEqual(plain(c.first.slice(0, 4)), [1, NaN, 6, 8]);
  assert.deepEqual(plain(c.max.slice(0, 4)), [1, NaN, 6, 8]);
  assert.deepEqual(plain(c.last.slice(0, 4)), [1, NaN, 6, 8]);
});

test("a ring of bins forgets the oldest and stays anchored in time", () => {
  const live = new LiveBins(["x"], [0], 16);
  const ring = new RowRing(1, 4096);
  for (let i = 0; i < 200; i++) {
    push(ring, [i], 0.001, i * 0.001);
    live.update(ring, 0.002);
  }
  assert.deepEqual([live.k0, live.k1], [84, 100]);
  assert.equal(live.channel("x").first[90 & live.mask], 180);
  assert.equal(live.channel("x").last[90 & live.mask], 181);
});

test("another width begins anew from the rows that are still there", () => {
  const live = new LiveBins(["x"], [0], 64);
  const ring = ringOf(Array.from({ length: 100 }, (_, i) => i), 0.001, 0, 64);
  live.update(ring, 0.001);
  live.update(ring, 0.016);
  assert.deepEqual([live.k0, live.k1], [2, 7]);
  assert.equal(live.channel("x").first[3], 48);
});

class Pen {
  points = [];
  moveTo(x, y) {
    this.points.push(["m", Math.round(x * 1000) / 1000, Math.round(y * 1000) / 1000]);
  }
  lineTo(x, y) {
    this.points.push(["l", Math.round(x * 1000) / 1000, Math.round(y * 1000) / 1000]);
  }
}

function viewOf(width, bins, t0 = 0) {
  const pick = (i) => bins.map((b) => b[i]);
  return new FrameBins(decodeFrame(binsFrame(width, [{ first: pick(0), min: pick(1), max: pick(2), last: pick(3), order: pick(4) }], { t0 })), ["x"]);
}

test("a bin is drawn first, then its extremes in the order of their times, then last", () => {
  const view = viewOf(1, [[2, 0, 9, 3, 1], [4, 1, 8, 5, 0]]);
  const pen = new Pen();
  drawBins(pen, view, view.channel("x"), 0, 2, 0, 4, 0, 1);
  assert.deepEqual(pen.points, [["m", 0, 2], ["l", 1, 0], ["l", 2, 9], ["l", 3, 3], ["l", 4, 4], ["l", 5, 8], ["l", 6, 1], ["l", 7, 5]]);
});

test("a long gap breaks the line, a short one does not", () => {
  const nan = [NaN, NaN, NaN, NaN, 0];
  const view = (gap) => viewOf(0.001, [[1, 1, 1, 1, 1], ...new Array(gap).fill(nan), [2, 2, 2, 2, 1]]);
  for (const [gap, moves] of [[10, 1], [19, 1], [20, 2], [60, 2]]) {
    const pen = new Pen();
    const v = view(gap);
    drawBins(pen, v, v.channel("x"), 0, 100, 0, 1000, 0, 1);
    assert.equal(pen.points.filter((p) => p[0] === "m").length, moves, `gap of ${gap} ms`);
  }
});

test("bins are drawn at the same places whatever part of them is asked for", () => {
  const bins = Array.from({ length: 50 }, (_, i) => [i, i - 1, i + 1, i, i % 2]);
  const all = viewOf(0.25, bins, 0);
  const late = viewOf(0.25, bins.slice(20), 5);
  const draw = (v) => {
    const pen = new Pen();
    drawBins(pen, v, v.channel("x"), 30, 40, -7, 3, 2, -1);
    return pen.points;
  };
  assert.deepEqual(draw(late), draw(all));
});

test("after a hole the bins start again, and say from where they are whole", () => {
  const ring = new RowRing(1, 4096);
  const push = (t0, count, flags = 0) => {
    const time = Array.from({ length: count }, (_, i) => i / 1000);
    ring.push(decodeFrame(samplesFrame([time, time.map(() => 1)], { t0, flags })));
  };
  const live = new LiveBins(["x"], [0], 64);
  push(0, 1000);
  live.update(ring, 0.256, 0);
  assert.equal(live.full, 0, "the session begins here");
  push(1, 500);
  live.update(ring, 0.256, 0);
  assert.equal(live.full, 0, "rows without a hole");
  push(1.6, 400, 1);
  live.update(ring, 0.256, 0);
  assert.ok(Math.abs(live.full - 1.792) < 1e-9, `the bin from 1.536 lacks rows: ${live.full}`);
  assert.ok(Math.abs(ring.oldest - 1.6) < 1e-6);
  push(10, 300);
  live.update(ring, 0.256, 0);
  assert.ok(Math.abs(live.full - 10.24) < 1e-9, `a hidden tab came back: ${live.full}`);
  const late = new LiveBins(["x"], [0], 64);
  late.update(ring, 0.256, 0);
  assert.ok(Math.abs(late.full - 10.24) < 1e-9, "a page that came late has no whole bin of its first row");
});
