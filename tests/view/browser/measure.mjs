// Measures the page in a browser without a GPU: the time to the first picture, the script time of a frame, frames a
// second, and the growth of the heap. tests/bench/view_page runs it.
//   measure.mjs [SECONDS]      seconds of the live session that is watched, default 30
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { launch } from "./chromium.mjs";
import { open, run, start } from "./support.mjs";

const seconds = Number(process.argv[2] ?? 30);
const RUNS = 5;

// Clean-up that support.mjs registers, newest first.
const endings = [];
const t = { after: (end) => endings.unshift(end) };
const sorted = (values) => [...values].sort((a, b) => a - b);
const quantile = (values, q) => sorted(values)[Math.min(values.length - 1, Math.floor(q * values.length))];

// Time from the navigation until a frame has drawn rows [ms].
async function firstPicture(opened, address) {
  const context = await opened.newContext({ viewport: { width: 1280, height: 800 } });
  const page = await context.newPage();
  await page.addInitScript(() => {
    const look = () => {
      const hook = window.haptraceTest;
      if (hook && hook.frames() > 0 && hook.state().end > 0 && hook.drawn("x").length > 0) window.firstPicture = performance.now();
      else requestAnimationFrame(look);
    };
    look();
  });
  await page.goto(`${address}&test`);
  await page.waitForFunction(() => window.firstPicture !== undefined, undefined, { polling: 20 });
  const time = await page.evaluate(() => window.firstPicture);
  await context.close();
  return time;
}

async function watch(page, forSeconds) {
  await page.evaluate(() => window.haptraceTest.resetTimes());
  const [frames, began] = await page.evaluate(() => [window.haptraceTest.frames(), performance.now()]);
  await page.waitForTimeout(1000 * forSeconds);
  const [later, ended, times] = await page.evaluate(() => [window.haptraceTest.frames(), performance.now(), window.haptraceTest.times()]);
  return { rate: (1000 * (later - frames)) / (ended - began), times };
}

const folder = mkdtempSync(join(tmpdir(), "haptrace-measure-"));
try {
  const path = join(folder, "square.h5"), file = join(folder, "played.h5");
  await run("shape", "square", "--size", "60mm", "--duration", "4", "-o", path);
  await run("play", path, "-d", "sim:preset=falcon,hand=relaxed", "--repeat", "3", "--record", file);
  const opened = await launch();
  endings.unshift(() => opened.close());

  const recording = await start(t, "view", file, "--no-browser");
  const firsts = [];
  for (let i = 0; i < RUNS; ++i) firsts.push(await firstPicture(opened, recording.address));
  console.log(`first picture of a recording: ${firsts.map((v) => v.toFixed(0)).join(", ")} ms; median ${quantile(firsts, 0.5).toFixed(0)} ms`);

  const session = await start(t, "play", path, "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--repeat", "10000", "--view", "--no-browser");
  const page = await open(t, opened, session.address);
  await page.waitForTimeout(12000); // until the charts show ten seconds
  const heap = () => page.evaluate(() => { window.gc?.(); return performance.memory.usedJSHeapSize / 1048576; });
  const before = await heap();
  const { rate, times } = await watch(page, seconds);
  const after = await heap();
  const { painter, renderer } = await page.evaluate(() => window.haptraceTest.state());
  console.log(`live at 1 kHz, ten seconds in the charts, 1280 x 800, ${painter}, ${renderer}:`);
  console.log(`  script a frame: p50 ${quantile(times, 0.5).toFixed(2)}, p99 ${quantile(times, 0.99).toFixed(2)}, max ${Math.max(...times).toFixed(2)} ms over ${times.length} frames`);
  console.log(`  ${rate.toFixed(1)} frames a second; heap ${before.toFixed(1)} MiB before, ${after.toFixed(1)} MiB after ${seconds} s`);
} finally {
  for (const end of endings) await end();
  rmSync(folder, { recursive: true, force: true });
}
