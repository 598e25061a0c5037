import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";
import { browser } from "./browser.mjs";
import { open, rowAt, run, samplesOf, scratch, shown, start, state } from "./support.mjs";

// A square walked four times by a simulated device, in virtual time.
async function played(folder) {
  const path = join(folder, "square.h5");
  const file = join(folder, "played.h5");
  await run("shape", "square", "--size", "60mm", "--duration", "3", "-o", path);
  await run("play", path, "-d", "sim:preset=falcon,hand=relaxed", "--repeat", "4", "--record", file);
  return file;
}

test("a recording opens, seeks, plays and shows the values of the file", async (t) => {
  const folder = scratch(t);
  const file = await played(folder);
  const samples = await samplesOf(file, folder);
  const view = await start(t, "view", file, "--no-browser");
  const page = await open(t, await browser(t), view.address);

  const before = await state(page);
  assert.equal(before.live, false);
  assert.equal(before.repetitions, 4);
  assert.ok(Math.abs(before.end - samples.t.at(-1)) < 0.0015, `${before.end} is not ${samples.t.at(-1)}`);

  for (const share of [0.9, 0.1, 0.5, 0.25]) {
    const row = Math.round(share * samples.t.length);
    const s = await rowAt(page, samples.t[row]);
    for (const name of ["x", "y", "z", "rx", "fx", "fy"]) assert.ok(Math.abs(s.values[name] - samples[name][row]) < 1e-6, `${name} at ${samples.t[row]}: ${s.values[name]}, the file has ${samples[name][row]}`);
    const expected = Math.hypot(...["x", "y", "z"].map((c) => samples[c][row] - samples["r" + c][row]));
    assert.ok(Math.abs(s.values.deviation - expected) < 1e-6);
  }

  // Steps of one sample.
  const row = Math.round(samples.t.length / 3);
  await rowAt(page, samples.t[row]);
  for (const [key, step] of [[".", 1], [".", 2], [",", 1]]) {
    await page.keyboard.press(key);
    await page.waitForFunction((time) => Math.abs(window.haptraceTest.shown().rowTime - time) < 1e-5, samples.t[row + step]);
    assert.ok(Math.abs((await shown(page)).values.x - samples.x[row + step]) < 1e-6);
  }

  // A click on the timeline seeks.
  const box = await page.locator(".timeline").boundingBox();
  await page.mouse.click(box.x + box.width * 0.75, box.y + box.height / 2);
  assert.ok(Math.abs((await shown(page)).time - before.end * 0.75) < before.end / box.width);

  // Space plays and pauses.
  await page.keyboard.press("Home");
  await page.evaluate(() => window.haptraceTest.seek(1));
  await page.keyboard.press("Space");
  await page.waitForFunction(() => window.haptraceTest.shown().time > 1.5);
  assert.equal((await state(page)).playing, true);
  await page.keyboard.press("Space");
  assert.equal((await state(page)).playing, false);
  assert.deepEqual(page.errors, []);
});

test("the curve that is drawn holds every sample of the file, and no peak is lost at any zoom", async (t) => {
  const folder = scratch(t);
  const file = await played(folder);
  const samples = await samplesOf(file, folder);
  const force = samples.t.map((_, i) => Math.hypot(samples.fx[i], samples.fy[i], samples.fz[i]));
  const view = await start(t, "view", file, "--no-browser");
  const page = await open(t, await browser(t), view.address);
  const most = force.reduce((a, b) => Math.max(a, b), 0);
  const at = samples.t[force.indexOf(most)];
  for (const span of [samples.t.at(-1), 5, 0.5, 0.1]) {
    await page.evaluate(([time, seconds]) => {
      window.haptraceTest.seek(time);
      window.haptraceTest.span(seconds);
    }, [at, span]);
    // The old picture stays until the bins of the new window are here.
    await page.waitForFunction(([time, peak]) => {
      const w = window.haptraceTest.window();
      const bins = window.haptraceTest.drawn("force");
      const inside = bins.filter((b) => b.t >= w.t0 && b.t <= w.t1);
      return w.t0 <= time && time <= w.t1 && inside.length > 20 && Math.abs(Math.max(...bins.map((b) => b.max)) - peak) < 1e-5;
    }, [at, most]);
    const { bins, window } = await page.evaluate(() => ({ bins: window.haptraceTest.drawn("x"), window: window.haptraceTest.window() }));
    const width = Math.min(...bins.slice(1).map((b, i) => b.t - bins[i].t));
    for (const bin of bins.filter((b) => b.t >= window.t0 && b.t + width <= window.t1)) {
      let low = Infinity;
      let high = -Infinity;
      for (let i = 0; i < samples.t.length; i++) {
        if (samples.t[i] < bin.t - 1e-6 || samples.t[i] >= bin.t + width - 1e-6) continue;
        low = Math.min(low, samples.x[i]);
        high = Math.max(high, samples.x[i]);
      }
      assert.ok(Math.abs(bin.min - low) < 1e-6 && Math.abs(bin.max - high) < 1e-6, `bin at ${bin.t} of ${width} s: ${bin.min} to ${bin.max}, the file has ${low} to ${high}`);
    }
  }
  assert.deepEqual(page.errors, []);
});

test("sixty seeks a second end at the last one", async (t) => {
  const folder = scratch(t);
  const file = await played(folder);
  const view = await start(t, "view", file, "--no-browser");
  const page = await open(t, await browser(t), view.address);
  const { end } = await state(page);
  await page.evaluate(async (until) => {
    for (let i = 0; i < 120; i++) {
      window.haptraceTest.seek((until * ((i * 37) % 120)) / 120);
      window.haptraceTest.frame();
      await new Promise((resolve) => setTimeout(resolve, 16));
    }
  }, end);
  const last = await rowAt(page, Math.floor(end * 500) / 1000);
  assert.ok(Number.isFinite(last.values.x));
  assert.equal((await state(page)).connected, true);
  assert.deepEqual(page.errors, []);
});

test("a reload keeps the view: the token is in the tab, not in the address", async (t) => {
  const folder = scratch(t);
  const file = await played(folder);
  const view = await start(t, "view", file, "--no-browser");
  const page = await open(t, await browser(t), view.address);
  assert.equal(new URL(page.url()).hash, "");
  await page.reload();
  await page.waitForFunction(() => window.haptraceTest?.state().connected === true);
  assert.deepEqual(page.errors, []);
});

test("a lost graphics context comes back, or the page says that it is lost", async (t) => {
  const folder = scratch(t);
  const file = await played(folder);
  const view = await start(t, "view", file, "--no-browser");
  const page = await open(t, await browser(t), view.address);
  await rowAt(page, 2);
  const lost = await page.evaluate(() => {
    const canvas = document.querySelector(".scene-canvas");
    const gl = canvas.getContext("webgl2") ?? canvas.getContext("webgl");
    const extension = gl?.getExtension("WEBGL_lose_context");
    if (!extension) return false;
    extension.loseContext();
    window.restore = () => extension.restoreContext();
    return true;
  });
  if (!lost) return t.skip("this browser draws the scene without WebGL");
  await page.waitForFunction(() => !document.querySelector(".scene-notice").hidden && document.querySelector(".scene-notice").textContent !== "");
  await rowAt(page, 4); // charts and figures go on
  await page.evaluate(() => window.restore());
  await page.waitForFunction(() => document.querySelector(".scene-notice").hidden || document.querySelector(".scene-notice").textContent === "");
  assert.deepEqual(page.errors.filter((e) => !/context lost/i.test(e)), []);
});
