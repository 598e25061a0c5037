import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import { browser } from "./browser.mjs";
import { PATIENCE, open, run, samplesOf, scratch, start, state } from "./support.mjs";

const HAND = "sim:preset=falcon,hand=firm";

async function square(folder, duration = "4") {
  const path = join(folder, "square.h5");
  await run("shape", "square", "--size", "60mm", "--duration", duration, "-o", path);
  return path;
}

// All rows that the page has of a column, bin by bin of one row.
async function rowsOf(page, column) {
  const { start: from, end } = await state(page);
  const out = new Map();
  for (let t = from; t < end + 0.2; t += 0.2) {
    const bins = await page.evaluate(([time, name]) => {
      window.haptraceTest.seek(time);
      window.haptraceTest.span(0.3);
      window.haptraceTest.frame();
      return window.haptraceTest.drawn(name);
    }, [t, column]);
    // Only bins of the rows that came live: the server has gone, and wider bins are of before.
    for (const b of bins) if (b.width < 0.0015) out.set(Math.round(b.t * 1000), b);
  }
  return out;
}

test("the curve of a live session equals the recorded file", async (t) => {
  const folder = scratch(t);
  const file = join(folder, "live.h5");
  const session = await start(t, "play", await square(folder), "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--repeat", "200", "--record", file, "--view", "--no-browser");
  const page = await open(t, await browser(t), session.address);
  assert.equal((await state(page)).live, true);
  // However long the browser took to come up, the page has some thousand rows when the session ends.
  await page.waitForFunction(() => window.haptraceTest.state().ringRows > 4000);
  await session.end();
  await page.waitForFunction(() => window.haptraceTest.state().ended);
  const bins = await rowsOf(page, "x");
  const samples = await samplesOf(file, folder);
  // The clock is real: a millisecond may have two samples, or none. Times come as float32: neighbours may change places.
  const close = (a, b) => Math.abs(a - b) < 1e-6;
  const within = (t0, t1) => samples.x.filter((_, i) => samples.t[i] > t0 - 2e-6 && samples.t[i] < t1 + 2e-6);
  for (const [ms, bin] of bins) {
    const x = within(bin.t, bin.t + bin.width);
    assert.ok(x.some((v) => close(v, bin.min)) && x.some((v) => close(v, bin.max)), `at ${ms} ms: ${bin.min} to ${bin.max}, the file has ${x}`);
  }
  // What a busy browser did not read for a second was dropped: the rows after the last such hole are compared.
  const there = [...bins.keys()].sort((a, b) => a - b);
  const first = there.findLast((ms, i) => i === 0 || ms - there[i - 1] > 50);
  const expected = samples.t.map((time, i) => [time, samples.x[i]]).filter(([time]) => time * 1000 >= first + 1);
  for (const [time, x] of expected) {
    const ms = Math.floor(time * 1000);
    const near = [ms - 1, ms, ms + 1].map((k) => bins.get(k)).filter((b) => b !== undefined && time > b.t - 2e-6 && time < b.t + b.width + 2e-6);
    assert.ok(near.some((b) => x > b.min - 1e-6 && x < b.max + 1e-6), `the page has no row for the sample at ${time} s`);
  }
  assert.ok(expected.length > 1000, `${expected.length} samples since the page was opened`);
  assert.deepEqual(page.errors.filter((e) => !/WebSocket|ERR_CONNECTION/.test(e)), []);
});

const pressStop = async (page) => {
  const box = await page.locator("[data-stop]").boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down(); // at the press already, not at the release
};

for (const [how, press] of [
  ["the button", pressStop],
  ["the Esc key", (page) => page.keyboard.press("Escape")],
  ["the Esc key in a dialog", async (page) => {
    await page.keyboard.press("?");
    await page.waitForSelector("dialog[open]");
    await page.keyboard.press("Escape");
  }],
  ["the button beside the keys", async (page) => {
    await page.keyboard.press("?");
    await page.waitForSelector("dialog[open]");
    await pressStop(page);
  }],
  ["the button beside the values", async (page) => {
    await page.getByRole("button", { name: "Table of values" }).first().click();
    await page.waitForSelector("dialog[open]");
    await pressStop(page);
  }],
  ["the button beside the text of a mark", async (page) => {
    await page.keyboard.press("n");
    await page.waitForSelector("dialog[open]");
    await page.keyboard.type("tired");
    await pressStop(page);
  }],
  ["Tab and Enter beside the text of a mark", async (page) => {
    await page.keyboard.press("n");
    await page.waitForSelector("dialog[open]");
    for (let i = 0; i < 60 && !(await page.evaluate(() => document.activeElement?.matches("[data-stop]"))); i++) await page.keyboard.press("Tab");
    await page.keyboard.press("Enter");
  }],
]) {
  test(`Stop by ${how} ends a session without --control, with zero force, and the page says so`, async (t) => {
    const folder = scratch(t);
    const file = join(folder, "stopped.h5");
    const session = await start(t, "play", await square(folder), "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--repeat", "200", "--record", file, "--view", "--no-browser");
    const page = await open(t, await browser(t), session.address);
    await page.waitForFunction(() => Number.isFinite(window.haptraceTest.shown().values.force));
    await press(page);
    await page.getByText(/The session ended/).waitFor();
    await page.getByText(/Zero force is confirmed/).waitFor();
    await session.ended;
    const samples = await samplesOf(file, folder);
    assert.deepEqual([samples.fx.at(-1), samples.fy.at(-1), samples.fz.at(-1)].map(Math.abs), [0, 0, 0]);
    assert.deepEqual(page.errors.filter((e) => !/WebSocket|ERR_CONNECTION/.test(e)), []);
  });
}

test("freezing the picture does not pause the session, and Go live shows the newest rows", async (t) => {
  const folder = scratch(t);
  const session = await start(t, "record", join(folder, "live.h5"), "-d", HAND, "--duration", "600", "--clock", "real", "--view", "--no-browser");
  const page = await open(t, await browser(t), session.address);
  await page.waitForFunction(() => window.haptraceTest.state().ringRows > 500);
  await page.keyboard.press("Space");
  const frozen = await page.evaluate(() => window.haptraceTest.shown().time);
  await page.waitForFunction(() => window.haptraceTest.state().lag > 1.5);
  assert.equal(await page.evaluate(() => window.haptraceTest.shown().time), frozen);
  await page.getByRole("button", { name: /Go live/ }).click();
  await page.waitForFunction(() => window.haptraceTest.state().lag < 1 && window.haptraceTest.state().following);
  assert.deepEqual(page.errors, []);
});

test("a hidden tab takes no rows and shows the newest on return", async (t) => {
  const folder = scratch(t);
  const session = await start(t, "record", join(folder, "live.h5"), "-d", HAND, "--duration", "600", "--clock", "real", "--view", "--no-browser");
  const page = await open(t, await browser(t), session.address);
  await page.waitForFunction(() => window.haptraceTest.state().ringRows > 500);
  const hide = (hidden) => page.evaluate((value) => {
    Object.defineProperty(document, "visibilityState", { value: value ? "hidden" : "visible", configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
  }, hidden);
  await hide(true);
  // Messages keep their order: with a status of so much later, no row is on its way any more.
  const later = async (time) => {
    const { told } = await state(page);
    await page.waitForFunction((t) => window.haptraceTest.state().told > t, told + time);
    return (await state(page)).ringRows;
  };
  let before = (await state(page)).ringRows;
  for (let now = await later(0.5); now !== before; now = await later(0.5)) before = now;
  assert.equal(await later(1.5), before);
  await hide(false);
  await page.waitForFunction((n) => window.haptraceTest.state().ringRows > n && window.haptraceTest.state().lag < 1, before);
  // The charts get from the server what the tab missed: no bin is missing, at any zoom.
  await page.keyboard.press("Space");
  for (const span of [10, 40]) {
    await page.evaluate((s) => window.haptraceTest.span(s), span);
    await page.waitForFunction(() => {
      const bins = window.haptraceTest.drawn("x");
      const { t0, t1 } = window.haptraceTest.window();
      const whole = bins.length > 0 && bins[0].t <= Math.max(0.1, t0) && bins.at(-1).t > t1 - 0.5;
      return whole && bins.every((b, i) => i === 0 || b.t - bins[i - 1].t < bins[i - 1].width + 0.003);
    });
  }
  assert.deepEqual(page.errors, []);
});

test("with --control the page changes a gain and sets a mark; without it there is no control", async (t) => {
  const folder = scratch(t);
  const path = await square(folder);
  const arguments_ = ["play", path, "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--repeat", "200", "--view", "--no-browser"];
  const opened = await browser(t);
  const plain = await start(t, ...arguments_);
  const watched = await open(t, opened, plain.address);
  assert.equal(await watched.locator(".controls").count(), 0);
  assert.equal(await watched.locator("[data-stop]").isEnabled(), true);
  await plain.end();

  const file = join(folder, "controlled.h5");
  const session = await start(t, ...arguments_, "--control", "--record", file);
  const page = await open(t, opened, session.address);
  await page.getByRole("button", { name: /^Less/ }).first().click();
  await page.getByRole("button", { name: /^Undo/ }).waitFor();
  await page.locator(".actions").getByRole("button", { name: "Mark" }).click();
  await page.waitForFunction(() => window.haptraceTest.state().events > 0);
  assert.deepEqual(page.errors, []);
});

for (const [verb, about] of [["play", ["--repeat", "200"]], ["guide", ["--radius", "5mm", "--repeat", "200"]]]) {
  test(`the page pauses ${verb} and resumes it, and says so`, async (t) => {
    const folder = scratch(t);
    const session = await start(t, verb, await square(folder), "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", ...about, "--view", "--no-browser", "--control");
    const page = await open(t, await browser(t), session.address);
    // What the session does and what may be asked of it come in two messages.
    const says = (word, label) => page.waitForFunction(([text, name]) => {
      const button = document.querySelector(".actions .first");
      return document.querySelector(".pill.live")?.textContent === text && button?.getAttribute("aria-label") === name && !button.disabled;
    }, [word, label]);
    await says("Live", "Pause the session");
    await page.locator(".actions .first").click();
    await says("Paused", "Resume the session");
    // One press asks, a second one resumes: the device will move.
    await page.evaluate(() => {
      const resume = document.querySelector(".actions .first");
      resume.click();
      resume.click();
    });
    await says("Live", "Pause the session");
    assert.deepEqual(page.errors, []);
  });
}

test("no key freezes the trainee's picture, and the page of a playback has words for the trainee", async (t) => {
  const folder = scratch(t);
  const session = await start(t, "play", await square(folder), "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--repeat", "200", "--view", "--no-browser");
  const page = await open(t, await browser(t), await session.trainee(), { viewport: { width: 320, height: 480 } });
  await page.waitForFunction(() => document.querySelector(".training-word")?.textContent === "The device moves you");
  for (const key of ["Space", "k", "ArrowLeft", "ArrowRight", "PageUp", ",", "j", "?"]) await page.keyboard.press(key);
  assert.equal((await state(page)).following, true);
  assert.equal(await page.locator("dialog").count(), 0);
  assert.deepEqual(await page.evaluate(() => [...document.querySelectorAll(".training-words, .training-start, .training-stop")]
    .filter((e) => e.checkVisibility())
    .map((e) => e.getBoundingClientRect())
    .filter((box) => box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight).length), 0);
  assert.deepEqual(page.errors, []);
});

test("between two trials the page does not say that the session ended", async (t) => {
  const folder = scratch(t);
  const session = await start(t, "record", join(folder, "trial.h5"), "-d", HAND, "--count", "1000", "--duration", "1", "--pause", "1", "--clock", "real", "--view", "--no-browser");
  const page = await open(t, await browser(t), session.address);
  const trials = () => session.output().split(/trial \d+ of 1000/).length;
  for (const first = trials(); trials() < first + 2;) {
    assert.equal((await state(page)).ended, false, session.output());
    await page.waitForTimeout(50);
  }
  session.child.kill("SIGINT");
  await page.waitForFunction(() => window.haptraceTest.state().ended);
  await page.getByText(/The session ended/).waitFor();
});

test("a trainee whose Stop finds no connection is told to let go", async (t) => {
  const folder = scratch(t);
  const session = await start(t, "play", await square(folder), "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--repeat", "200", "--view", "--no-browser");
  const page = await open(t, await browser(t), await session.trainee());
  const says = (word) => page.waitForFunction((text) => document.querySelector(".training-word")?.textContent === text, word);
  await says("The device moves you");
  session.child.kill("SIGKILL");
  await says("One moment");
  await page.locator(".training-stop").dispatchEvent("pointerdown", { button: 0 });
  await says("Stop did not arrive");
  await page.getByText("Let go of the handle").waitFor();
});

// Keeps the main thread of the page busy `times` times for `busy` ms, with short breaks for what waits. Returns the
// longest time from break to break [ms]: what waits takes long on a machine that has other work.
const occupy = (page, busy, times) => page.evaluate(async ([ms, count]) => {
  let longest = 0;
  for (let i = 0; i < count; i++) {
    const begin = performance.now();
    while (performance.now() < begin + ms);
    await new Promise((resolve) => setTimeout(resolve, 20));
    longest = Math.max(longest, performance.now() - begin);
  }
  return longest;
}, [busy, times]);

test("a controlling page that draws less than one frame in two seconds is not lost; one whose main thread hangs is", async (t) => {
  const folder = scratch(t);
  const session = await start(t, "play", await square(folder), "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--repeat", "200", "--view", "--no-browser", "--control");
  const page = await open(t, await browser(t), session.address);
  const lost = () => page.evaluate(() => window.haptraceTest.warnings().includes("page_lost"));
  const before = await lost();
  const longest = await occupy(page, 2100, 3);
  assert.equal((await state(page)).connected, true);
  // The server waits for 2 s after the last 2 s in which the main thread ran: a page that took longer is lost rightly.
  if (before || longest > 2600) t.diagnostic(`this machine is too busy: the page drew after ${longest} ms`);
  else assert.equal(await lost(), false);
  await occupy(page, 6000, 1);
  await page.waitForFunction(() => window.haptraceTest.warnings().includes("page_lost"));
  await page.waitForFunction(() => window.haptraceTest.warnings().includes("page_back"));
  assert.deepEqual(page.errors, []);
});

test("where frames come slowly, the scene is drawn flat and the page says so", async (t) => {
  const folder = scratch(t);
  const session = await start(t, "play", await square(folder), "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--repeat", "200", "--view", "--no-browser");
  const page = await open(t, await browser(t), session.address);
  // A script that takes 60 ms of each frame stands for a slow machine: a fast one draws without a GPU at any rate. The
  // page takes its words away after some seconds, so it is read at each change.
  await page.evaluate(() => {
    window.readFlat = false;
    new MutationObserver(() => (window.readFlat ||= /the scene is drawn flat/.test(document.body.innerText)))
      .observe(document.body, { subtree: true, childList: true, characterData: true });
    const slow = () => {
      if (window.haptraceTest.state().painter !== "webgl") return;
      for (const end = performance.now() + 60; performance.now() < end;);
      requestAnimationFrame(slow);
    };
    slow();
  });
  await page.waitForFunction(() => window.haptraceTest.state().painter === "flat");
  await page.waitForFunction(() => window.readFlat);
  await page.getByText("Simple graphics").waitFor();
  assert.equal(await page.evaluate(() => document.querySelectorAll(".scene-canvas").length), 1);
  // At 1280 x 800, without a GPU; measure.mjs takes the figure that counts.
  const rate = await page.evaluate(async () => {
    const before = [performance.now(), window.haptraceTest.frames()];
    await new Promise((resolve) => setTimeout(resolve, 1000));
    return (1000 * (window.haptraceTest.frames() - before[1])) / (performance.now() - before[0]);
  });
  t.diagnostic(`${rate.toFixed(1)} frames a second`);
  // The tool is where the data have it, and pointers still turn the camera.
  await page.keyboard.press("Space");
  await page.evaluate(() => window.haptraceTest.frame());
  const { x, y } = await page.evaluate(() => window.haptraceTest.tool());
  await page.mouse.move(x + 80, y + 60);
  await page.mouse.down();
  await page.mouse.move(x + 140, y + 60);
  await page.mouse.up();
  await page.waitForFunction((before) => Math.abs(window.haptraceTest.tool().x - before) > 0.5, x);
  assert.deepEqual(page.errors, []);
});

test("a hand that a mouse moves touches the objects of a scene, which hold it back; the page shows the proxy", async (t) => {
  const folder = scratch(t);
  const file = join(folder, "felt.h5"), scene = join(folder, "walls.json");
  // Walls left and right of the tool: one of them is in the way of the mouse.
  writeFileSync(scene, JSON.stringify({ objects: [[8, -1], [-8, 1]].map(([x, n]) =>
    ({ kind: "wall", name: `wall at ${x} mm`, point: [0.001 * x, 0, 0], normal: [n, 0, 0], stiffness: 1000 })) }));
  const session = await start(t, "record", file, "-d", `${HAND},intent=view`, "--scene", scene, "--view", "--no-browser");
  const page = await open(t, await browser(t), session.address, { viewport: { width: 800, height: 600 } });
  await page.waitForFunction(() => window.haptraceTest.tool() !== null);
  // The view follows the tool until the pointer has it: a slow machine may have moved the picture before the press.
  const holds = () => page.evaluate(() => window.haptraceTest.state().holding === "mouse");
  let tool, presses = 0;
  do {
    assert.ok(++presses <= 50, "the mouse took hold of the hand");
    await page.mouse.up();
    tool = await page.evaluate(() => window.haptraceTest.tool());
    await page.mouse.move(tool.x, tool.y);
    await page.mouse.down();
  } while (!(await holds()));
  // A page that draws slowly lets go of the hand between its frames, so the pointer goes on until the wall was met.
  const touches = () => page.evaluate(() => Math.abs(Math.abs(window.haptraceTest.shown().values.proxy_x) - 0.008) < 1e-6);
  for (let i = 1; !(await touches()); i++) {
    assert.ok(i * 30 < PATIENCE, "the hand met a wall");
    await page.mouse.move(tool.x + Math.min(3 * i, 90) + (i % 2), tool.y);
    await page.waitForTimeout(30);
  }
  await page.mouse.up();
  const { output } = await session.end();
  const samples = await samplesOf(file, folder);
  const deepest = Math.max(...samples.x.map(Math.abs)) - 0.008;
  const force = Math.max(...samples.fx.map(Math.abs));
  assert.ok(deepest > 0, output);
  assert.ok(force > 0 && force < 1000 * deepest + 0.5, `${force} N at ${deepest} m`);
  assert.match(output, /wall at -?8 mm: /);
  assert.deepEqual(page.errors, []);
});
