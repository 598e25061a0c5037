// Starts haptrace and a browser for a test. HAPTRACE_COMMAND is the haptrace to test.
import { execFile, spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { promisify } from "node:util";

export const haptrace = process.env.HAPTRACE_COMMAND ?? "";
if (haptrace === "") throw new Error("HAPTRACE_COMMAND is not set. Set it to the haptrace command to test.");

// A folder for the files of a test; removed with `after`.
export function scratch(t) {
  const folder = mkdtempSync(join(tmpdir(), "haptrace-view-"));
  t.after(() => rmSync(folder, { recursive: true, force: true }));
  return folder;
}

// Runs haptrace to its end.
export async function run(...args) {
  return promisify(execFile)(haptrace, args, { maxBuffer: 1 << 28 });
}

// A busy machine is slow; a test that fails takes this long [ms].
export const PATIENCE = 300000;

const ADDRESS = /http:\/\/127\.0\.0\.1:(\d+)\/#([0-9a-f]{32})/;

// Starts haptrace with a view and waits for its addresses. `end` asks it to end and gives its exit code and output.
export async function start(t, ...args) {
  const child = spawn(haptrace, args, { stdio: ["ignore", "pipe", "pipe"] });
  let output = "";
  let wake = () => {};
  const more = (data) => {
    output += data;
    wake();
  };
  child.stdout.on("data", more);
  child.stderr.on("data", more);
  const ended = new Promise((resolve) => child.on("close", (code) => {
    resolve(code);
    wake();
  }));
  t.after(async () => {
    if (child.exitCode === null && child.signalCode === null) child.kill("SIGINT");
    const patience = setTimeout(() => child.kill("SIGKILL"), 10000);
    await ended;
    clearTimeout(patience);
  });
  // Each address comes in a line of its own, which may come in parts. Waits for the first that `wanted` takes.
  const address = async (wanted) => {
    for (;;) {
      const lines = output.split("\n").slice(0, -1).filter((line) => ADDRESS.test(line) && wanted(line));
      if (lines.length > 0) return ADDRESS.exec(lines[0])[0];
      if (child.exitCode !== null || child.signalCode !== null) throw new Error(`haptrace ${args.join(" ")} ended without this view:\n${output}`);
      await new Promise((resolve) => (wake = resolve));
    }
  };
  return {
    child,
    ended,
    output: () => output,
    address: await address(() => true),
    trainee: () => address((line) => /trainee/.test(line)),
    end: async () => {
      child.kill("SIGINT");
      return { code: await ended, output };
    },
  };
}

// Opens the address in a page with the test hook and waits until it shows a session. Errors of the page fail the test.
export async function open(t, opened, address, options = {}) {
  const context = await opened.newContext({ viewport: { width: 1280, height: 800 }, ...options });
  t.after(() => context.close());
  const page = await context.newPage();
  page.setDefaultTimeout(PATIENCE);
  // A browser without a GPU gives a page no frame for many seconds if the machine is busy. So the page draws by hand
  // before each look at a condition, and the clock says when to look.
  const wait = page.waitForFunction.bind(page);
  page.waitForFunction = (condition, argument, more = {}) => {
    const drawn = new Function("argument", `window.haptraceTest?.frame(); return (${condition})(argument);`);
    return wait(drawn, argument, { polling: 100, ...more });
  };
  page.errors = [];
  page.on("pageerror", (error) => page.errors.push(String(error.stack ?? error)));
  page.on("console", (message) => {
    if (message.type() === "error" || /Content Security Policy/i.test(message.text())) page.errors.push(message.text());
  });
  await page.goto(`${address}&test`);
  await page.waitForFunction(() => window.haptraceTest?.state().connected === true && window.haptraceTest.frames() > 3);
  return page;
}

export const state = (page) => page.evaluate(() => window.haptraceTest.state());
export const shown = (page) => page.evaluate(() => window.haptraceTest.shown());

// Waits until the row at the shown time is here, and gives it.
export async function rowAt(page, time) {
  await page.evaluate((t) => window.haptraceTest.seek(t), time);
  await page.waitForFunction((t) => {
    const s = window.haptraceTest.shown();
    return Math.abs(s.time - t) < 1e-6 && Math.abs(s.rowTime - t) < 0.002 && Number.isFinite(s.values.x);
  }, time);
  return shown(page);
}

// Reads the samples of a recording: an object of arrays, one for each column of its CSV.
export async function samplesOf(file, folder) {
  const csv = join(folder, "samples.csv");
  await run("convert", file, "-o", csv, "--overwrite");
  const lines = readFileSync(csv, "utf8").split("\n").filter((line) => line !== "" && !line.startsWith("#"));
  const names = lines[0].split(",");
  const out = Object.fromEntries(names.map((name) => [name, []]));
  for (const line of lines.slice(1)) line.split(",").forEach((value, i) => out[names[i]].push(value === "" ? NaN : Number(value)));
  return out;
}
