// Starts the browser of the tests. HAPTRACE_CHROMIUM names another command than chromium,
// chromium-browser or google-chrome of the PATH.
import { accessSync, constants } from "node:fs";
import { delimiter, join } from "node:path";
import { chromium } from "playwright-core";

function find() {
  if (process.env.HAPTRACE_CHROMIUM) return process.env.HAPTRACE_CHROMIUM;
  for (const folder of (process.env.PATH ?? "").split(delimiter)) {
    for (const name of ["chromium", "chromium-browser", "google-chrome"]) {
      try {
        accessSync(join(folder, name), constants.X_OK);
        return join(folder, name);
      } catch {
        // Not here: the next folder.
      }
    }
  }
  throw new Error("No Chromium found. Install the package chromium, or name its command in HAPTRACE_CHROMIUM.");
}

// WebGL without a GPU, drawn by SwiftShader; `flags` are added.
export function launch(flags = []) {
  return chromium.launch({
    executablePath: find(),
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", ...flags],
  });
}
