import assert from "node:assert/strict";
import test from "node:test";
import { helloOf, pathFrame, recordingOf, samplesFrame } from "./frames.mjs";
import { load } from "./load.mjs";

const { Model, decodeFrame, Latest, ClockOffset, RowRing, LIVE_DELAY, rowAt, nearestRow, BlockCache, seekRepetition, SignOfLife, Pace } = await load("life", "pace", "model", "protocol", "latest", "client", "rows", "keys");

// Rows at 1 kHz from `t0` on; x is the row's number since time 0.
function rows(t0, count, options = {}) {
  const first = Math.round(t0 * 1000);
  const time = Array.from({ length: count }, (_, i) => i / 1000);
  return decodeFrame(samplesFrame([time, time.map((_, i) => first + i), time.map(() => 0.5)], { t0, ...options }));
}

// A recording of 10 s whose rows and bins come when asked.
function recorded(options = {}) {
  const asked = [];
  const model = new Model();
  model.setSource({
    async requestRows(t0, t1) {
      asked.push([t0, t1]);
      const end = Math.min(t1, 10);
      return rows(t0, Math.round((end - t0) * 1000));
    },
    async requestBins() {
      return null;
    },
  });
  model.take(helloOf(false));
  model.setConnected(true);
  model.take(recordingOf(["x", "deviation"], options));
  return { model, asked };
}
const settle = () => new Promise((resolve) => setImmediate(resolve));

function live() {
  const model = new Model();
  model.take(helloOf(true));
  model.setConnected(true);
  model.take(recordingOf(["x", "deviation"], { end: 0 }));
  return model;
}

test("the shown row is the row nearest to the shown time", async () => {
  const { model } = recorded();
  model.seek(3.2);
  model.need();
  await settle();
  model.tick(1);
  assert.equal(model.value("x"), 3200);
  assert.ok(Math.abs(model.shownRowTime - 3.2) < 1e-6);
  assert.equal(model.value("deviation"), 0.5);
  assert.ok(Number.isNaN(model.value("force")));
});

test("after the end of a session the force is zero only where the device confirmed it, and no old force", () => {
  for (const [zero_force, expected] of [["confirmed", 0], ["sent", NaN], ["failed", NaN], ["", NaN]]) {
    const model = new Model();
    model.take(helloOf(true));
    model.setConnected(true);
    model.take(recordingOf(["x", "fx", "force"], { end: 0 }));
    const time = Array.from({ length: 1000 }, (_, i) => i / 1000);
    model.takeRows(decodeFrame(samplesFrame([time, time, time.map(() => 1.5), time.map(() => 1.5)])));
    model.tick(1);
    assert.equal(model.value("force"), 1.5);
    assert.equal(model.over, false);
    model.take({ type: "status", time: 1, phase: "stopped", ended: true, reason: "finished", zero_force, lost_rows: 0 });
    model.tick(1.1);
    assert.deepEqual([model.value("fx"), model.value("force")], [expected, expected], zero_force);
    assert.ok(Number.isFinite(model.value("x")), "the place is still known");
    assert.equal(model.over, true);
    model.seek(0.2);
    model.tick(1.2);
    assert.equal(model.value("force"), 1.5, "earlier forces are shown as they were");
  }
});

test("without rows at the shown time there is no value, rather than an old one", async () => {
  const { model } = recorded();
  model.seek(1);
  model.need();
  await settle();
  model.tick(1);
  assert.equal(model.value("x"), 1000);
  model.seek(9);
  model.tick(2);
  assert.ok(Number.isNaN(model.value("x")));
});

test("sixty seeks a second leave one question outstanding and ask for the newest place last", async () => {
  const { model, asked } = recorded({ end: 4000 });
  for (let i = 0; i < 60; i++) {
    model.seek(i * 60);
    model.need();
  }
  await settle();
  await settle();
  assert.equal(asked.length, 2);
  assert.ok(asked[1][0] <= 59 * 60 && asked[1][1] > 59 * 60);
});

test("a step moves by one sample, also from between two samples", async () => {
  const { model } = recorded();
  model.seek(2.0004);
  model.need();
  await settle();
  model.tick(1);
  model.step(1);
  model.tick(2);
  assert.equal(model.value("x"), 2001);
  model.step(-1);
  model.step(-1);
  model.tick(3);
  assert.equal(model.value("x"), 1999);
  assert.equal(model.playing, false);
});

test("playing moves the shown time by the clock times the speed, and stops at the end", () => {
  const { model } = recorded();
  model.seek(1);
  model.setSpeed(2);
  model.play();
  model.tick(100);
  model.tick(100.1);
  assert.ok(Math.abs(model.shown - 1.2) < 1e-9);
  model.seek(9.95);
  model.play();
  model.tick(100.2);
  assert.equal(model.shown, 10);
  assert.equal(model.playing, false);
  model.play();
  assert.equal(model.shown, 0);
});

test("a loop jumps back to its start", () => {
  const { model } = recorded();
  model.setLoop({ t0: 2, t1: 3 });
  model.seek(2.9);
  model.play();
  model.tick(5);
  model.tick(5.2);
  assert.ok(Math.abs(model.shown - 2.1) < 1e-9, String(model.shown));
});

test("a tab that slept does not jump: one frame moves the time by a quarter of a second at most", () => {
  const { model } = recorded();
  model.play();
  model.tick(5);
  model.tick(500);
  assert.ok(model.shown <= 0.25 + 1e-9);
});

test("a live picture is 35 ms behind the newest row by one's own clock and never beyond it", () => {
  const model = live();
  model.takeRows(rows(0, 1000));
  model.clockOffset = 0.999 - 50; // the newest row came at 50 s of the page's clock
  model.tick(50.01);
  assert.ok(Math.abs(model.shown - (0.999 + 0.01 - LIVE_DELAY)) < 1e-9);
  model.tick(50.2);
  assert.equal(model.shown, model.ring.newest);
});

test("a live picture whose rows stopped shows no values after half a second", () => {
  const model = live();
  model.takeRows(rows(0, 1000));
  model.clockOffset = 0.999 - 50;
  model.tick(50.3);
  assert.equal(model.value("x"), 999);
  model.tick(50.8); // this page was busy: rows may be waiting
  assert.equal(model.value("x"), 999);
  for (let t = 50.8; t < 51; t += 0.016) model.tick(t);
  assert.ok(Number.isNaN(model.value("x")));
  model.takeRows(rows(1, 1000));
  model.tick(51.01);
  assert.equal(model.value("x"), 1974);
});

test("freezing keeps the shown time while rows come, and the lag grows; going live ends that", () => {
  const model = live();
  model.takeRows(rows(0, 1000));
  model.clockOffset = -49;
  model.tick(50);
  model.pause();
  const frozen = model.shown;
  model.takeRows(rows(1, 2000));
  model.tick(52);
  assert.equal(model.shown, frozen);
  assert.ok(model.lag > 1.9);
  model.goLive();
  model.tick(52.02);
  assert.ok(model.lag < 0.1);
});

test("a reconnection leaves a frozen picture frozen", () => {
  const model = live();
  model.takeRows(rows(0, 1000));
  model.seek(0.5);
  model.pause();
  model.take(helloOf(true));
  model.take(recordingOf(["x", "deviation"], { end: 1.2 }));
  assert.equal(model.following, false);
  assert.equal(model.ring.end, 1000);
});

test("rows that come twice are kept once, and an older clock begins anew", () => {
  const model = live();
  model.takeRows(rows(5, 1000));
  model.takeRows(rows(5.5, 1000, { flags: 2 }));
  assert.equal(model.ring.end, 1500);
  assert.ok(Math.abs(model.ring.newest - 6.499) < 1e-6);
  model.takeRows(rows(0, 100));
  assert.equal(model.ring.end, 100);
});

test("the ring keeps its size for hours and finds its rows", () => {
  const ring = new RowRing(1, 1000);
  const before = ring.capacity;
  for (let k = 0; k < 500; k++) ring.push({ header: { t0: k * 0.1 }, time: Float32Array.from({ length: 100 }, (_, i) => i / 1000), planes: [new Float32Array(100).fill(k)] });
  assert.equal(ring.capacity, before);
  assert.equal(ring.end - ring.first, 1024);
  assert.equal(ring.value(0, nearestRow(ring, 49.05, 0.001)), 490);
  assert.equal(rowAt(ring, 1e9), ring.end - 1);
  assert.equal(nearestRow(ring, 3, 0.02), -1);
});

test("a cache of blocks forgets the one that was not used for longest", () => {
  const cache = new BlockCache(4, 2);
  cache.put(0, rows(0, 10));
  cache.put(1, rows(4, 10));
  cache.get(0);
  cache.put(2, rows(8, 10));
  assert.ok(cache.has(0) && cache.has(2) && !cache.has(1));
});

test("the trail's points are the same rows in every frame", async () => {
  const { model } = recorded();
  model.seek(2);
  model.need();
  await settle();
  const points = (t) => {
    const out = [];
    model.seek(t);
    model.eachRow(t - 0.3, t, 0.01, (source, row) => out.push(source.value(0, row)));
    return out.slice(0, -1); // the last one is the shown row itself
  };
  const a = points(2);
  const b = points(2.0037);
  assert.ok(a.length >= 29);
  assert.deepEqual(b.filter((v) => v > 1710 && v < 1990), a.filter((v) => v > 1710 && v < 1990));
  assert.ok(a.every((v) => v % 10 === 0 || v === 1700), String(a));
});

test("rows across two blocks are walked once each", async () => {
  const { model } = recorded();
  for (const t of [3.9, 4.1]) {
    model.seek(t);
    model.need();
    await settle();
  }
  const seen = [];
  model.eachRow(3.99, 4.01, 0.001, (source, row) => seen.push(source.value(0, row)));
  assert.deepEqual(seen, Array.from({ length: 21 }, (_, i) => 3990 + i));
});

test("repetitions are the stretches along the path; the phase that is on reaches to the newest row", () => {
  const model = live();
  const status = (phase) => model.take({ type: "status", time: 2, phase, ended: false, lost_rows: 0 });
  model.take({ type: "phases", reset: true, done: false, list: [[0, 1, "approach"]] });
  status("run");
  model.takeRows(rows(0, 2000));
  model.tick(50);
  assert.deepEqual(model.repetitions.map((r) => [r.number, r.t0]), [[1, 1]]);
  assert.equal(model.repetitionAt(1.9)?.number, 1);
  assert.equal(model.phaseAt(0.5), "approach");
  model.takeRows(rows(2, 1000));
  model.tick(51);
  assert.ok(Math.abs(model.repetitions[0].t1 - 2.999) < 1e-6);

  // The repetition ended, but the status does not know it yet: it is not a second one.
  model.take({ type: "phases", reset: false, done: false, list: [[1, 3, "run"]] });
  model.takeRows(rows(3, 200));
  model.tick(51.2);
  assert.equal(model.repetitions.length, 1);
  status("hold");
  model.tick(51.3);
  assert.deepEqual(model.phases.map((p) => p[2]), ["approach", "run", "hold"]);
  assert.equal(model.repetitions[0].t1, 3);
});

test("an older path does not replace a newer one", () => {
  const model = live();
  const path = (id, x) => decodeFrame(pathFrame([[0], [x], [0], [0], [NaN], [0]], { request: id }));
  model.takePath(path(4, 1));
  model.takePath(path(3, 2));
  assert.equal(model.path.x[0], 1);
  model.takePath(path(5, 3));
  assert.equal(model.path.x[0], 3);
});

test("a session that ended is no live session: the picture stops and the past can be seen", () => {
  const model = live();
  model.takeRows(rows(0, 1000));
  model.take({ type: "status", time: 1, phase: "stopped", ended: true, reason: "stopped from the page", zero_force: "confirmed", lost_rows: 0 });
  assert.equal(model.live, false);
  assert.equal(model.following, false);
  model.seek(0.5);
  model.tick(60);
  assert.equal(model.value("x"), 500);
});

test("the end of a session shows the newest row, also one that was still on its way, unless a person looks elsewhere", () => {
  const end = (model) => model.take({ type: "status", time: 2, phase: "idle", ended: true, reason: "", zero_force: "confirmed", lost_rows: 0 });
  const model = live();
  model.takeRows(rows(0, 1000));
  model.tick(1);
  end(model);
  model.takeRows(rows(1, 1000));
  model.tick(60);
  assert.equal(model.value("x"), 1999);
  assert.equal(model.atEnd, true);
  model.seek(0.5);
  model.takeRows(rows(2, 10));
  assert.equal(model.shown, 0.5);
  model.goLive();
  model.tick(61);
  assert.deepEqual([model.value("x"), model.following, model.playing], [2009, false, false]);

  const frozen = live();
  frozen.takeRows(rows(0, 1000));
  frozen.seek(0.2);
  end(frozen);
  assert.equal(frozen.shown, 0.2);
});

test("a newer question replaces the one that waits, and an answer that fails frees the place", async () => {
  const asked = [];
  const got = [];
  const waiting = [];
  let goOn;
  const ask = (q) => {
    asked.push(q);
    return new Promise((resolve, reject) => waiting.push({ resolve, reject }));
  };
  const latest = new Latest(ask, (q, a) => got.push([q, a]), () => new Promise((resolve) => (goOn = resolve)));
  for (const q of [1, 2, 3, 4]) latest.request(q);
  assert.deepEqual(asked, [1]);
  waiting[0].reject(new Error("lost"));
  await settle();
  latest.request(5); // not asked at once: the server just refused
  assert.deepEqual(asked, [1]);
  goOn();
  await settle();
  assert.deepEqual(asked, [1, 5]);
  waiting[1].resolve("a");
  await settle();
  assert.deepEqual(got, [[5, "a"]]);
  assert.equal(latest.busy, false);
});

test("the clock's offset is that of the row that came with the least delay", () => {
  const clock = new ClockOffset();
  clock.add(10, 100.02);
  clock.add(10.016, 100.021); // less delay
  clock.add(10.032, 100.09); // late
  assert.ok(Math.abs(clock.value - (10.016 - 100.021)) < 1e-3);
  clock.add(50, 100.1); // the session's clock jumped
  assert.ok(Math.abs(clock.value + 50.1) < 1e-9);
});

test("the next repetition of a live session begins anew and is followed, although its clock restarts", () => {
  const model = live();
  model.takeRows(rows(0, 5000));
  model.take({ type: "phases", reset: true, done: true, list: [[1, 4, "run"]] });
  model.take({ type: "status", time: 5, phase: "stopped", ended: true, reason: "", zero_force: "confirmed", lost_rows: 0 });
  model.seek(2);
  model.take(recordingOf(["x", "deviation"], { end: 0, trial: 2 }));
  model.takeRows(rows(0, 100));
  assert.equal(model.ring.end, 100);
  assert.equal(model.live, true);
  assert.equal(model.following, true);
  assert.equal(model.repetitions.length, 0);
});

test("between repetitions the last one that began is the one to show, before all the first", () => {
  const { model } = recorded();
  model.take({ type: "phases", reset: true, done: true, list: [[1, 2, "run"], [2, 3, "idle"], [3, 4, "run"]] });
  assert.equal(model.repetitionAt(2.5), null);
  assert.equal(model.repetitionBefore(2.5).number, 1);
  assert.equal(model.repetitionBefore(9).number, 2);
  assert.equal(model.repetitionBefore(0).number, 1);
});

test("a screen that is replaced leaves no listener behind", () => {
  const { model } = recorded();
  let calls = 0;
  const end = model.collect(() => {
    model.on("play", () => calls++);
    model.on("data", () => calls++);
  });
  model.on("play", () => calls++);
  model.pause();
  assert.equal(calls, 2);
  end();
  model.pause();
  assert.equal(calls, 3);
});

test("presses of a key in quick succession add up, however far the picture plays between two frames", () => {
  const { model } = recorded();
  model.take({ type: "phases", reset: true, list: [[0, 1, "approach"], [1, 3, "run"], [3, 4, "hold"], [4, 6, "run"], [7, 9, "run"]], done: true });
  model.tick(0);
  model.setSpeed(8);
  model.play();
  model.seek(8);
  // Each frame takes 250 ms and plays 2 s: from the start of a repetition back beyond its end.
  for (const [i, expected] of [7, 4, 1, 0].entries()) {
    seekRepetition(model, -1, 1000 + 200 * i);
    assert.equal(model.shown, expected);
    model.tick(0.25 * (i + 1));
  }
  model.seek(2);
  for (let i = 0; i < 3; i++) {
    model.seekByKey(3000 + 100 * i, (from) => from + 1);
    model.tick(2 + 0.25 * i);
  }
  model.pause();
  assert.ok(model.shown >= 5 && model.shown <= 7, `${model.shown} after three seconds on from 2`);
  model.seekByKey(9000, (from) => from - 1);
  const later = model.shown;
  model.seekByKey(9100, (from) => from - 1);
  assert.ok(Math.abs(later - 1 - model.shown) < 1e-9);
});

test("the sign of life is sent only while the main thread runs, and a silent server is given up", () => {
  const life = new SignOfLife();
  assert.equal(life.pings(0), false, "the main thread has not run yet");
  life.mainRan(10);
  life.serverSpoke(10);
  assert.equal(life.pings(11.9), true, "a frame of 1.9 s");
  assert.equal(life.pings(12.1), false, "a main thread that hangs takes no Stop");
  assert.equal(life.serverLost(12.9), false);
  assert.equal(life.serverLost(13.1), true);
});

test("a machine is slow if half of its frames are late, not if one is", () => {
  const judge = (frames) => {
    const pace = new Pace();
    let now = 0;
    return frames.map((passed) => pace.slow((now += passed))).some((slow) => slow);
  };
  assert.equal(judge(Array(200).fill(16.7)), false);
  assert.equal(judge(Array(60).fill(80)), true);
  assert.equal(judge([...Array(20).fill(16.7), 5000, ...Array(200).fill(16.7)]), false, "the machine slept");
  assert.equal(judge([3000, 3000, 3000, 3000, 3000, 3000]), true, "one frame in three seconds is slow too");
  assert.equal(judge(Array(10).fill(80)), false, "it judges after 1.5 s");
});

test("rows that the page missed are asked for, and rows that the session no longer keeps are named", async () => {
  const asked = [];
  const model = new Model();
  let cut = false;
  model.setSource({
    async requestRows(t0, t1) {
      asked.push(t0);
      return cut ? decodeFrame(samplesFrame([[], [], []], { t0, flags: 4 })) : rows(t0, Math.round((t1 - t0) * 1000));
    },
    async requestBins() {
      return null;
    },
  });
  model.take(helloOf(true));
  model.setConnected(true);
  model.take(recordingOf(["x", "deviation"], { end: 0 }));
  model.takeRows(rows(0, 1000));
  model.takeRows(rows(40, 1000)); // the tab was hidden
  model.seek(0.5);
  model.need();
  await settle();
  model.tick(1);
  assert.deepEqual(asked, [0]);
  assert.equal(model.value("x"), 500);
  assert.equal(model.thinned, false);
  cut = true;
  model.seek(20.5);
  model.need();
  await settle();
  model.tick(1.1);
  assert.ok(Number.isNaN(model.value("x")));
  assert.equal(model.thinned, true);
});
