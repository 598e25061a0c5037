// The page fits every window, in both themes: nothing overflows, no text is too small, and texts have contrast.
import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import { browser } from "./browser.mjs";
import { open, rowAt, run, scratch, start } from "./support.mjs";

const SIZES = [[320, 480], [360, 640], [390, 844], [640, 400], [1280, 800], [1920, 1080]];

// Lists the faults of the page's layout; run in the page.
function problems() {
  const out = [];
  const root = document.documentElement;
  if (root.scrollWidth > innerWidth) out.push(`the page is ${root.scrollWidth} px wide in a window of ${innerWidth}`);
  const colour = (text) => (text.match(/[\d.]+/g) ?? []).map(Number);
  const luminance = ([r, g, b]) => {
    const [x, y, z] = [r, g, b].map((c) => c / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
    return 0.2126 * x + 0.7152 * y + 0.0722 * z;
  };
  const behind = (element) => {
    for (let e = element; e !== null; e = e.parentElement) {
      const c = colour(getComputedStyle(e).backgroundColor);
      if (c.length === 3 || c[3] > 0.5) return c;
    }
    return [255, 255, 255];
  };
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim();
    const e = walker.currentNode.parentElement;
    if (text === "" || !e.checkVisibility() || e.closest(".unseen, option, [hidden], noscript, script, style")) continue;
    const style = getComputedStyle(e);
    const size = parseFloat(style.fontSize);
    const word = `"${text.slice(0, 30)}" (${e.className || e.tagName})`;
    if (size < 12) out.push(`${word} has ${size} px`);
    if (e.closest(":disabled")) continue; // exempt
    const [a, b] = [luminance(colour(style.color)), luminance(behind(e))].sort((x, y) => y - x);
    const contrast = (a + 0.05) / (b + 0.05);
    const least = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700) ? 3 : 4.5;
    if (contrast < least - 0.005) out.push(`${word} has a contrast of ${contrast.toFixed(2)}`);
  }
  for (const b of document.querySelectorAll("button, select, input, [role=slider]")) {
    if (!b.checkVisibility() || b.closest("[hidden]")) continue;
    const box = b.getBoundingClientRect();
    const least = 23.99; // rounding of a transform
    if (box.width < least || box.height < least) out.push(`${b.getAttribute("aria-label") ?? b.textContent} is ${box.width} x ${box.height}`);
    if (box.left < -1 || box.right > innerWidth + 1) if (!b.closest(".lane-tabs, .exercises")) out.push(`${b.getAttribute("aria-label") ?? b.textContent} is outside the window`);
    const name = b.getAttribute("aria-label") ?? b.textContent.trim() ?? "";
    if (name === "" && b.labels?.length !== 1) out.push(`a ${b.tagName} has no name: ${b.outerHTML.slice(0, 80)}`);
  }
  return out;
}

// Opens the keys, the values and the text of a mark in turn: Stop is whole and on top beside each of them.
async function stopIsBesideDialogs(page, size) {
  for (const [what, show] of [
    ["the keys", () => page.keyboard.press("?")],
    ["the values", () => page.evaluate(() => [...document.querySelectorAll("[aria-label='Table of values']")].find((b) => b.checkVisibility()).click())],
    ["the text of a mark", () => page.keyboard.press("n")],
  ]) {
    await show();
    await page.waitForSelector("dialog[open]");
    assert.deepEqual(await page.evaluate(() => {
      const stop = document.querySelector("[data-stop]"), box = stop.getBoundingClientRect();
      const dialog = document.querySelector("dialog").getBoundingClientRect();
      const covered = [[box.left + 6, box.top + 6], [box.right - 6, box.bottom - 6], [(box.left + box.right) / 2, (box.top + box.bottom) / 2]]
        .filter(([x, y]) => !stop.contains(document.elementFromPoint(x, y)));
      return { covered: covered.length, inside: dialog.left >= 0 && dialog.top >= 0 && dialog.right <= innerWidth && dialog.bottom <= innerHeight, high: dialog.height >= 100 };
    }), { covered: 0, inside: true, high: true }, `${size}, beside ${what}`);
    await page.locator("dialog").getByRole("button", { name: "Close" }).click();
    await page.waitForFunction(() => document.querySelector("dialog") === null);
  }
}

for (const scheme of ["light", "dark"]) {
  test(`a recording fits every window, ${scheme}`, async (t) => {
    const folder = scratch(t);
    const path = join(folder, "square.h5");
    await run("shape", "square", "--size", "60mm", "--duration", "3", "-o", path);
    await run("play", path, "-d", "sim:preset=falcon,hand=relaxed", "--record", join(folder, "played.h5"));
    const view = await start(t, "view", join(folder, "played.h5"), "--no-browser");
    const opened = await browser(t);
    for (const [width, height] of SIZES) {
      const page = await open(t, opened, view.address, { viewport: { width, height }, colorScheme: scheme });
      await rowAt(page, 2);
      assert.deepEqual(await page.evaluate(problems), [], `${width} x ${height}`);
      await page.keyboard.press("?");
      await page.waitForSelector("dialog[open]");
      assert.deepEqual(await page.evaluate(problems), [], `${width} x ${height}, keys`);
      await page.keyboard.press("Escape");
      assert.deepEqual(page.errors, []);
      await page.context().close();
    }
  });

  test(`a live session fits every window and Stop is in it, ${scheme}`, async (t) => {
    const folder = scratch(t);
    const session = await start(t, "record", join(folder, "live.h5"), "-d", "sim:preset=falcon,hand=firm", "--duration", "600", "--clock", "real", "--view", "--no-browser");
    const opened = await browser(t);
    for (const [width, height] of SIZES) {
      const page = await open(t, opened, session.address, { viewport: { width, height }, colorScheme: scheme });
      await page.waitForFunction(() => window.haptraceTest.state().ringRows > 100);
      assert.deepEqual(await page.evaluate(problems), [], `${width} x ${height}`);
      for (const scroll of [0, 1e6]) {
        await page.evaluate((y) => window.scrollTo(0, y), scroll);
        const stop = await page.locator("[data-stop]").boundingBox();
        assert.ok(stop.x >= 0 && stop.y >= 0 && stop.x + stop.width <= width && stop.y + stop.height <= height, `Stop is outside ${width} x ${height}`);
        assert.ok(stop.height >= 60 && stop.width >= 60, `Stop is ${stop.width} x ${stop.height}`);
        assert.equal(await page.locator("[data-stop]").isEnabled(), true);
      }
      await stopIsBesideDialogs(page, `${width} x ${height}`);
      assert.deepEqual(page.errors, []);
      await page.context().close();
    }
  });
}

// The therapist's screens: of a playback, and of a programme. A phone has both orientations.
const PHONES = [[360, 640], [640, 360], [390, 844], [844, 390]];

// Names of the controls that are not whole in the window, or that something else covers.
function hidden() {
  const out = [];
  for (const [name, button] of [["Stop", document.querySelector("[data-stop]")], ...["Pause", "Repeat", "Skip", "Mark"].map((word) => [word, [...document.querySelectorAll(".actions button")].find((b) => b.textContent.includes(word))])]) {
    const box = button?.getBoundingClientRect();
    if (box === undefined || !button.checkVisibility()) out.push(`${name} is missing`);
    else if (box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight) out.push(`${name} is outside the window`);
    else if (Math.min(box.width, box.height) < 44) out.push(`${name} is ${box.width} x ${box.height}`);
    else if (!button.contains(document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2))) out.push(`${name} is covered`);
  }
  return out;
}

for (const [what, arguments_] of [
  ["a playback", (folder) => ["play", join(folder, "square.h5"), "--repeat", "200"]],
  ["a programme", (folder) => ["run", join(folder, "lesson.json"), "--subject", "P07", "-o", join(folder, "session")]],
]) {
  for (const scheme of ["light", "dark"]) {
    test(`the therapist of ${what} reaches Stop, Pause, Repeat, Skip and Mark without scrolling, ${scheme}`, async (t) => {
      const folder = scratch(t);
      const path = join(folder, "square.h5");
      await run("shape", "square", "--size", "60mm", "--duration", "4", "-o", path);
      const exercise = { name: "A square with a name that takes some room", path: "square.h5", mode: "tunnel", repetitions: 50, radius: 0.005 };
      writeFileSync(join(folder, "lesson.json"), JSON.stringify({ haptrace_programme: 1, title: "Monday", exercises: [exercise, { ...exercise, name: "Again" }] }));
      const session = await start(t, ...arguments_(folder), "-d", "sim:preset=falcon,hand=relaxed", "--clock", "real", "--view", "--no-browser", "--control");
      const opened = await browser(t);
      for (const [width, height] of [...PHONES, [1280, 800], [1920, 1080]]) {
        const page = await open(t, opened, session.address, { viewport: { width, height }, colorScheme: scheme });
        await page.locator(".actions").getByRole("button", { name: "Skip" }).waitFor();
        await page.waitForFunction(() => window.haptraceTest.state().ringRows > 100);
        assert.deepEqual(await page.evaluate(problems), [], `${width} x ${height}`);
        for (const scroll of [0, 1e6]) {
          // A wide and low window scrolls the actions away below; a phone keeps them.
          if (scroll > 0 && width >= 760) continue;
          await page.evaluate((y) => window.scrollTo(0, y), scroll);
          assert.deepEqual(await page.evaluate(hidden), [], `${width} x ${height}, scrolled to ${scroll}`);
        }
        await stopIsBesideDialogs(page, `${width} x ${height}`);
        assert.deepEqual(page.errors, []);
        await page.context().close();
      }
    });
  }
}
