// The browser of a file of tests.
import { after } from "node:test";
import { launch } from "./chromium.mjs";

let shared = null;
after(async () => (await shared)?.close());

// Returns a browser for a test: one for all tests of a file, which open contexts of their own, or one with `args`. It
// draws without a GPU, as on a machine that has none.
export async function browser(t, options = {}) {
  if (options.args === undefined) return (shared ??= launch());
  const opened = await launch(options.args);
  t.after(() => opened.close());
  return opened;
}
