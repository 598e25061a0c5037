// A mouse as the hand of a simulated device, in a real session.
import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";
import { browser } from "./browser.mjs";
import { open, run, samplesOf, scratch, start } from "./support.mjs";

const HAND = "sim:preset=falcon,hand=firm,intent=view";
const RADIUS = 0.005;
const STEP = 0.003; // [m]

// Normal numbers that are the same in every run.
function noise() {
  let state = 7;
  const uniform = () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return (state + 0.5) / 2 ** 32;
  };
  return () => Math.sqrt(-2 * Math.log(uniform())) * Math.cos(2 * Math.PI * uniform());
}

// Presses the tool, leads it to the path and traces the path to its end with `pixels` of noise: 3 mm a step, and no step
// before the tool has followed the last one, however slow the machine is.
async function trace(page, length, pixels) {
  const random = noise();
  const places = await page.evaluate(() => window.haptraceTest.path());
  const tool = await page.evaluate(() => window.haptraceTest.tool());
  await page.mouse.move(tool.x, tool.y);
  await page.mouse.down();
  const steps = Math.ceil(length / STEP);
  const line = Array.from({ length: steps + 1 }, (_, i) => places[Math.round((i * (places.length - 1)) / steps)]);
  const lead = [0.25, 0.5, 0.75].map((w) => ({ x: tool.x + w * (line[0].x - tool.x), y: tool.y + w * (line[0].y - tool.y) }));
  for (const place of [...lead, ...line]) {
    await page.mouse.move(place.x + pixels * random(), place.y + pixels * random());
    await page.waitForFunction(({ x, y }) => {
      const now = window.haptraceTest.tool();
      return window.haptraceTest.state().ended || (now !== null && Math.hypot(now.x - x, now.y - y) < 30);
    }, place);
  }
  await page.mouse.up();
}

// Length of the path in a file [m].
async function lengthOf(path, folder) {
  const { x, y, z } = await samplesOf(path, folder);
  return x.reduce((sum, _, i) => (i === 0 ? 0 : sum + Math.hypot(x[i] - x[i - 1], y[i] - y[i - 1], z[i] - z[i - 1])), 0);
}

for (const shape of ["square", "circle", "figure8"]) {
  test(`a mouse with 2 px of noise walks the tunnel of the ${shape}`, async (t) => {
    const folder = scratch(t);
    const path = join(folder, "path.h5");
    const file = join(folder, "walked.h5");
    await run("shape", shape, "--size", "40mm", "--duration", "6", "-o", path);
    const length = await lengthOf(path, folder);
    const session = await start(t, "guide", path, "-d", HAND, "--radius", "5mm", "--record", file, "--view", "--no-browser");
    const page = await open(t, await browser(t), session.address, { viewport: { width: 800, height: 600 } });
    await page.waitForFunction(() => window.haptraceTest.shown().values.phase === 2 && window.haptraceTest.tool() !== null);
    await trace(page, length, 2);
    await session.end();
    const samples = await samplesOf(file, folder);
    const off = [];
    samples.t.forEach((_, i) => {
      if (samples.phase[i] !== 2 || Number.isNaN(samples.rx[i])) return;
      off.push(Math.hypot(samples.x[i] - samples.rx[i], samples.y[i] - samples.ry[i], samples.z[i] - samples.rz[i]));
    });
    // Before the press nobody held the handle: the walk begins where the tool comes into the tunnel.
    const walk = off.slice(off.findIndex((d) => d < 0.5 * RADIUS));
    assert.ok(walk.length > 1000, `${walk.length} samples`);
    const inside = walk.filter((d) => d <= RADIUS).length / walk.length;
    assert.ok(inside > 0.99, `${100 * inside} % inside the tunnel, at most ${1000 * Math.max(...walk)} mm off`);
    const travelled = Math.max(...samples.progress.filter(Number.isFinite));
    assert.ok(travelled > 0.9 * length, `${travelled} m of ${length} m`);
  });
}

test("a movement that was made by mouse is recorded as such", async (t) => {
  const folder = scratch(t);
  const file = join(folder, "drawn.h5");
  const session = await start(t, "record", file, "-d", HAND, "--view", "--no-browser");
  const page = await open(t, await browser(t), session.address, { viewport: { width: 800, height: 600 } });
  await page.waitForFunction(() => window.haptraceTest.tool() !== null);
  const tool = await page.evaluate(() => window.haptraceTest.tool());
  await page.mouse.move(tool.x, tool.y);
  await page.mouse.down();
  for (let i = 1; i <= 10; i++) {
    await page.mouse.move(tool.x + 8 * i, tool.y - 4 * i);
    await page.waitForFunction(({ x, y }) => {
      const now = window.haptraceTest.tool();
      return now !== null && Math.hypot(now.x - x, now.y - y) < 40;
    }, { x: tool.x + 8 * i, y: tool.y - 4 * i });
  }
  await page.mouse.up();
  const { output } = await session.end();
  const { stdout } = await run("info", file);
  const samples = await samplesOf(file, folder);
  assert.ok(Math.max(...samples.x) - Math.min(...samples.x) > 0.005, "the device followed the mouse");
  assert.match(stdout, /mouse, depth from/, output);
});
