// Opens the stage: a scene with a synthetic session, in a browser, without a server.
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const page = join(here, "../../../view/page");
const { build } = createRequire(join(page, "package.json"))("esbuild");

async function bundle(entry) {
  const options = { entryPoints: [entry], bundle: true, format: "iife", write: false, logLevel: "warning" };
  // stage.ts lies outside the folder that has three.
  const { outputFiles } = await build({ ...options, nodePaths: [join(page, "node_modules")] });
  return outputFiles[0].text;
}

let bundles = null;

// Returns a page that shows the stage, and the errors that it met.
export async function openStage(browser, { width = 800, height = 600, options = {}, dark = false, contextOptions = {} } = {}) {
  bundles ??= Promise.all([bundle(join(here, "stage.ts")), bundle(join(page, "app.css"))]);
  const [script, style] = await bundles;
  const context = await browser.newContext({ viewport: { width, height }, colorScheme: dark ? "dark" : "light", ...contextOptions });
  const tab = await context.newPage();
  const errors = [];
  tab.on("pageerror", (error) => errors.push(error.message));
  tab.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) errors.push(message.text());
  });
  // An origin of its own, as the real page has: storage and raw pointer events need one. Nothing leaves the browser.
  const html = `<!doctype html><html data-theme="${dark ? "dark" : "light"}"><title>stage</title><style>${style} #stage { position: fixed; inset: 0; }</style><div><div id="stage"></div></div>`;
  await context.route("**/*", (route) => route.fulfill({ contentType: "text/html; charset=utf-8", body: html }));
  await tab.goto("http://localhost/");
  await tab.addScriptTag({ content: script });
  await tab.evaluate((o) => globalThis.stage.start(o), options);
  await frames(tab, 3);
  return { tab, errors, close: () => context.close() };
}

// Waits until the page has drawn `count` more frames.
export function frames(tab, count) {
  return tab.evaluate(
    (n) => new Promise((done) => {
      const next = (left) => (left === 0 ? done() : requestAnimationFrame(() => next(left - 1)));
      next(n);
    }),
    count,
  );
}
