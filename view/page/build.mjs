// Builds the page: node build.mjs [--out DIR]. Writes index.html, app.js, wire.js, app.css and icon.svg into DIR
// (default: dist). The output depends on the sources and the locked versions alone: same input, same bytes.
import { build } from "esbuild";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const outAt = process.argv.indexOf("--out");
if (outAt >= 0 && process.argv[outAt + 1] === undefined) {
  console.error("build.mjs: --out needs a folder, for example: npm run build -- --out dist");
  process.exit(2);
}
const out = outAt >= 0 ? resolve(process.argv[outAt + 1]) : join(here, "dist");

const common = { absWorkingDir: here, minify: true, legalComments: "eof", logLevel: "warning", target: ["chrome100", "firefox100", "safari15"] };
await mkdir(out, { recursive: true });
await build({ ...common, entryPoints: ["src/main.ts"], bundle: true, format: "iife", outfile: join(out, "app.js"), charset: "utf8", define: { "process.env.NODE_ENV": '"production"' } });
await build({ ...common, entryPoints: ["src/wire_worker.ts"], bundle: true, format: "iife", outfile: join(out, "wire.js"), charset: "utf8" });
await build({ ...common, entryPoints: ["app.css"], bundle: true, outfile: join(out, "app.css") });
for (const name of ["index.html", "icon.svg"]) {
  const text = await readFile(join(here, name), "utf8");
  // Indentation carries no meaning in these two files.
  await writeFile(join(out, name), text.split("\n").map((line) => line.trim()).filter((line) => line !== "").join("\n") + "\n");
}
