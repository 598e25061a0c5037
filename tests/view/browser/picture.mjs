// Draws the pictures of the view in README and docs from a real session: an expert's curve with forces, and a simulated
// trainee who walks through a tunnel around it.
//   HAPTRACE_COMMAND=build/release/cli/haptrace node build/release/tests/view/browser/picture.mjs docs
// Writes view.png and, with ImageMagick's convert, the animated view.gif.
import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { launch } from "./chromium.mjs";
import { open, rowAt, run, start } from "./support.mjs";

const out = process.argv[2];
if (out === undefined) throw new Error("Name the folder for the pictures, for example docs.");
const folder = mkdtempSync(join(tmpdir(), "haptrace-picture-"));
const undo = [];
const t = { after: (action) => undo.unshift(action) };

// A curve in space with the rhythm of a minimum-jerk movement, and a force across it.
function expert() {
  const seconds = 6;
  const rows = ["t,x,y,z,fx,fy,fz"];
  for (let i = 0; i <= 200 * seconds; ++i) {
    const s = i / (200 * seconds);
    const p = s * s * s * (10 - 15 * s + 6 * s * s);
    const place = [-0.045 + 0.09 * p, 0.02 * Math.sin(5.2 * p), 0.018 * Math.sin(7 * p) * (0.4 + p)];
    const force = [0, 0.8 * Math.sin(9 * p), 0.5 * Math.cos(6 * p)];
    rows.push([i / 200, ...place, ...force].map((value) => value.toFixed(6)).join(","));
  }
  writeFileSync(join(folder, "expert.csv"), `${rows.join("\n")}\n`);
}

try {
  expert();
  writeFileSync(join(folder, "radius.json"), JSON.stringify({ s: [0, 0.03, 0.06, 0.09, 0.13], radius: [8e-3, 5e-3, 7e-3, 4e-3, 7e-3] }));
  const file = join(folder, "guided.h5");
  await run("guide", join(folder, "expert.csv"), "-d", `sim:preset=falcon,hand=relaxed,seed=4,intent=${join(folder, "expert.csv")}`,
    "--radius", join(folder, "radius.json"), "--record", file, "--title", "Guided along an expert's curve");
  const view = await start(t, "view", file, "--no-browser");
  const browser = await launch();
  t.after(() => browser.close());
  const page = await open(t, browser, view.address, { colorScheme: "light" });
  await page.locator(".notice button, .banner button").first().click({ timeout: 2000 }).catch(() => {});
  await page.evaluate(() => window.haptraceTest.span(8));
  const { values } = await rowAt(page, 4.2);
  if (!(values.force > 0)) throw new Error("The picture would show no force. Is the recording complete?");
  await page.waitForTimeout(500);
  await page.screenshot({ path: join(out, "view.png") });

  const frames = [];
  for (let i = 0; i < 18; ++i) {
    await rowAt(page, 0.5 + i / 4.25);
    const name = join(folder, `frame-${String(i).padStart(3, "0")}.png`);
    await page.screenshot({ path: name });
    frames.push(name);
  }
  execFileSync("convert", ["-delay", "24", "-loop", "0", ...frames, "-resize", "800x", "+dither", "-colors", "96", "-layers", "OptimizeTransparency", join(out, "view.gif")]);
} finally {
  for (const action of undo) await Promise.resolve(action()).catch(() => {});
  rmSync(folder, { recursive: true, force: true });
}
