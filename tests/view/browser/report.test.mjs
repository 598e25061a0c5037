// The page of a report fits every window, and prints on A4 without the settings' JSON, with a name on every page.
import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import { pathToFileURL } from "node:url";
import { promisify } from "node:util";
import { browser } from "./browser.mjs";
import { run, scratch } from "./support.mjs";

// Writes a report of two participants, one of them with two recordings.
async function report(t) {
  const folder = scratch(t);
  const path = join(folder, "square.h5");
  await run("shape", "square", "--size", "60mm", "--duration", "2", "-o", path);
  const files = [];
  for (const [i, subject] of ["Ada Lovelace", "Ada Lovelace", "Bo Berg"].entries()) {
    const file = join(folder, `${i}.h5`);
    await run("play", path, "-d", "sim:preset=falcon,hand=relaxed", "--no-profile", "--repeat", "5", "--record", file,
      "--subject", subject, "--meta", "side=left");
    files.push(file);
  }
  const page = join(folder, "report.html");
  await run("report", ...files, "-o", page);
  return page;
}

// Texts that reach beyond the window, or that no scrolling shows; run in the page.
function outside() {
  const out = [];
  if (document.documentElement.scrollWidth > innerWidth)
    out.push(`the page is ${document.documentElement.scrollWidth} px wide in a window of ${innerWidth}`);
  for (const cell of document.querySelectorAll("td, tbody th, p, dd, dt, h1, h2, h3, h4, figcaption")) {
    if (!cell.checkVisibility()) continue;
    const box = cell.getBoundingClientRect();
    if (innerWidth < 640 && (box.left < -1 || box.right > innerWidth + 1))
      out.push(`"${cell.textContent.slice(0, 30)}" is from ${box.left} to ${box.right} px`);
    if (cell.scrollWidth > cell.clientWidth + 1 && getComputedStyle(cell).overflowX !== "visible")
      out.push(`"${cell.textContent.slice(0, 30)}" is cut off`);
  }
  return out;
}

test("a report fits every window and prints with names and without JSON", async (t) => {
  const file = await report(t);
  const address = pathToFileURL(file).href;
  const opened = await browser(t);
  for (const colorScheme of ["light", "dark"]) {
    for (const [width, height] of [[390, 844], [800, 600], [1280, 800]]) {
      const context = await opened.newContext({ viewport: { width, height }, colorScheme });
      const page = await context.newPage();
      await page.goto(address);
      await page.evaluate(() => document.querySelectorAll("details").forEach((d) => (d.open = true)));
      assert.deepEqual(await page.evaluate(outside), [], `${width} px, ${colorScheme}`);
      if (process.env.HAPTRACE_SCREENSHOTS)
        await page.screenshot({ path: join(process.env.HAPTRACE_SCREENSHOTS, `report-${width}-${colorScheme}.png`), fullPage: true });
      if (width === 390) {
        const labels = await page.evaluate(() => [...document.querySelectorAll("td")]
          .filter((cell) => getComputedStyle(cell, "::before").content.length < 4).length);
        assert.equal(labels, 0, "every cell of a narrow page shows the title of its column");
      }
      await context.close();
    }
  }

  const context = await opened.newContext();
  t.after(() => context.close());
  const page = await context.newPage();
  await page.goto(address);
  assert.ok((await page.evaluate(() => document.body.textContent)).includes('"max-force"'), "the settings are in the page");
  await page.emulateMedia({ media: "print" });
  const printed = await page.evaluate(() => document.body.innerText);
  assert.ok(!printed.includes('"max-force"'), "and not on paper");
  for (const text of ["Ada Lovelace", "Bo Berg", "Signature", "Over sessions"]) assert.ok(printed.includes(text), text);
  assert.deepEqual(await page.evaluate(() => [...document.querySelectorAll(".person")].map((e) => getComputedStyle(e).breakBefore)),
    ["page", "page"]);

  // As a reader does: print from the browser.
  const pdf = join(file, "..", "report.pdf");
  await promisify(execFile)(process.env.HAPTRACE_CHROMIUM ?? "chromium",
    ["--headless", "--no-sandbox", "--disable-gpu", `--user-data-dir=${join(file, "..", "profile")}`, "--no-pdf-header-footer", `--print-to-pdf=${pdf}`, address]);
  const bytes = readFileSync(pdf, "latin1");
  const pages = bytes.match(/\/Type\s*\/Page\b(?!s)/g)?.length ?? 0;
  assert.ok(pages >= 3 && pages <= 30, `${pages} pages`);
  assert.match(bytes, /\/MediaBox \[0 0 59[45][.\d]* 84[12][.\d]*\]/, "A4");
  if (process.env.HAPTRACE_SCREENSHOTS) {
    const { copyFileSync } = await import("node:fs");
    copyFileSync(pdf, join(process.env.HAPTRACE_SCREENSHOTS, "report.pdf"));
  }
});
