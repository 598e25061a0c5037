// The page fits every window, in both themes: nothing overflows, no text is too small, and texts have contrast.
import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";
import { browser, open, rowAt, run, scratch, start } from "./support.mjs";

const SIZES = [[360, 640], [390, 844], [640, 400], [1280, 800], [1920, 1080]];

// What is wrong with the page as it is laid out; run in the page.
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
      assert.deepEqual(page.errors, []);
      await page.context().close();
    }
  });
}
