import assert from "node:assert/strict";
import test from "node:test";
import { load } from "./load.mjs";

const { edgeScroll, follow, growRange, RangeRest, roundStep, ticks, timeStep, within, zoomAbout } = await load("scale");

const near = (a, b) => assert.ok(Math.abs(a - b) < 1e-9, `${a} is not ${b}`);

test("steps are 1, 2 or 5 times a power of ten", () => {
  for (const [least, step] of [[0.0013, 0.002], [0.7, 1], [1, 1], [1.1, 2], [3, 5], [51, 100]]) near(roundStep(least), step);
});

test("ticks are round, within the range and no more than asked", () => {
  assert.deepEqual(ticks(-55, 60, 3), [-50, 0, 50]);
  assert.deepEqual(ticks(0, 6.4, 4), [0, 2, 4, 6]);
  assert.deepEqual(ticks(1, 1, 4), []);
  for (let i = 1; i < 200; i++) assert.ok(ticks(-i / 7, i / 3, 5).length <= 6);
});

test("the ticks of a time axis fit", () => {
  assert.equal(timeStep(10, 5), 2);
  assert.equal(timeStep(36000, 10), 3600);
  assert.equal(timeStep(0.05, 5), 0.01);
});

test("a range grows to hold the data and never shrinks", () => {
  let range = null;
  let before = { low: Infinity, high: -Infinity };
  for (const [low, high] of [[1, 2], [1.2, 1.4], [-3, 2.5], [0, 40], [0, 1]]) {
    range = growRange(range, low, high, 0.5);
    assert.ok(range.low <= low && range.high >= high);
    assert.ok(range.low <= before.low && range.high >= before.high);
    before = range;
  }
});

test("a range does not change while the data stay within it", () => {
  const range = growRange(null, -51, 48, 10);
  assert.equal(growRange(range, -40, 40, 10), range);
});

test("a range shrinks ten seconds after a peak has left, once, and not while the hand moves", () => {
  const rest = new RangeRest();
  const wide = growRange(null, 0, 40, 0.5);
  const at = (now, still, high = 3) => rest.shrink(wide, 0, high, 0.5, now, still);
  assert.equal(at(0, true, 40), wide, "the peak is still in the window");
  assert.equal(at(1, true), wide);
  assert.equal(at(10.9, true), wide);
  assert.equal(at(12, false), wide, "the hand moves");
  const narrow = at(13, true);
  assert.ok(narrow.high >= 3 && narrow.high < 5, `${narrow.high}`);
  assert.equal(at(13.1, true), wide, "the ten seconds start again");
  at(30, true, 35);
  assert.equal(at(39, true), wide, "a peak in between starts them again");
});

test("values that are never negative have no negative end, however little they vary", () => {
  for (const [low, high] of [[0, 0], [0, 0.1], [2, 2.1], [180, 180]]) assert.ok(growRange(null, low, high, 10).low >= 0);
  assert.ok(growRange(growRange(null, 0, 0, 10), 0, 180, 10).low === 0);
});

test("a range of values from zero keeps zero as its end", () => {
  assert.equal(growRange(null, 0, 3.1, 0.5).low, 0);
});

test("at rest the window stays as long as it holds the shown time", () => {
  const w = { t0: 10, t1: 20 };
  assert.deepEqual(follow(w, 12, 0, 100, "rest"), w);
  assert.deepEqual(follow(w, 19.9, 0, 100, "rest"), w);
  const moved = follow(w, 40, 0, 100, "rest");
  near(moved.t0, 33.5);
  near(moved.t1, 43.5);
});

test("while it plays the playhead runs to 65 % of the window and stays there", () => {
  let w = { t0: 0, t1: 10 };
  for (let t = 0; t < 30; t += 0.016) {
    w = follow(w, t, 0, 100, "playing");
    near(w.t1 - w.t0, 10);
    assert.ok(t >= w.t0 && t <= w.t0 + 6.5 + 1e-9);
    if (t > 7) near(t, w.t0 + 6.5);
  }
});

test("nothing is beyond the ends of a recording", () => {
  near(follow({ t0: 80, t1: 90 }, 99.9, 0, 100, "playing").t1, 100);
  near(follow({ t0: 80, t1: 90 }, 0.1, 0, 100, "rest").t0, 0);
});

test("a live window ends at the shown time", () => {
  assert.deepEqual(follow({ t0: 0, t1: 10 }, 33, 0, 33.04, "live"), { t0: 23, t1: 33 });
});

test("zooming keeps the time under the pointer in its place", () => {
  const w = zoomAbout({ t0: 10, t1: 20 }, 12, 0.5, 0.01, 1000);
  near(w.t1 - w.t0, 5);
  near((12 - w.t0) / (w.t1 - w.t0), 0.2);
  near(zoomAbout({ t0: 10, t1: 20 }, 12, 1e-9, 0.05, 1000).t1 - zoomAbout({ t0: 10, t1: 20 }, 12, 1e-9, 0.05, 1000).t0, 0.05);
});

test("a view stays within the session", () => {
  assert.deepEqual(within({ t0: -5, t1: 5 }, 0, 100), { t0: 0, t1: 10 });
  assert.deepEqual(within({ t0: 95, t1: 115 }, 0, 100), { t0: 80, t1: 100 });
  assert.deepEqual(within({ t0: -50, t1: 150 }, 0, 100), { t0: 0, t1: 100 });
});

test("dragging scrolls at the edges only, faster further out", () => {
  assert.equal(edgeScroll(300, 600, 24), 0);
  assert.equal(edgeScroll(12, 600, 24), -0.5);
  assert.equal(edgeScroll(-200, 600, 24), -1);
  assert.equal(edgeScroll(588, 600, 24), 0.5);
});
