// Computes the contrast of every role's colour from the styles, in both themes (WCAG 2.2: 4.5 for text, 3 for large text,
// lines that carry meaning, and borders of controls).
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";

const css = readFileSync(new URL("../../../view/page/app.css", import.meta.url), "utf8");

function block(selector) {
  const at = css.indexOf(selector + " {");
  assert.ok(at >= 0, `app.css has no ${selector}`);
  const text = css.slice(at, css.indexOf("}", at));
  return Object.fromEntries([...text.matchAll(/(--[\w-]+):\s*(#[0-9A-Fa-f]{6});/g)].map((m) => [m[1], m[2]]));
}
const light = block(":root");
const dark = { ...light, ...block(':root[data-theme="dark"]') };

function luminance(hex) {
  const [r, g, b] = [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}
export function contrast(a, b) {
  const [high, low] = [luminance(a), luminance(b)].sort((x, y) => y - x);
  return (high + 0.05) / (low + 0.05);
}

// colour, on, least contrast
const TEXT = 4.5;
const LARGE = 3;
const pairs = [
  ...["--background", "--surface", "--raised", "--chosen"].flatMap((on) => [["--text", on, TEXT], ["--text-second", on, TEXT]]),
  ...["--background", "--surface"].flatMap((on) => [
    ["--role-actual", on, TEXT],
    ["--role-go", on, TEXT],
    ["--role-stop", on, TEXT],
    ["--role-force", on, LARGE], // digits of 19 px bold and more, arrows, lines
    ["--role-path", on, LARGE], // lines
    ["--role-expert", on, LARGE], // lines and marks
    ["--border", on, LARGE],
    ["--focus", on, LARGE],
  ]),
  ["--role-go", "--raised", TEXT],
  ["--role-stop", "--raised", TEXT],
  ["--role-warning", "--warning-surface", TEXT],
  ["--role-stop", "--stop-surface", TEXT],
  ["--stop-button-text", "--stop-button", TEXT],
  ["--role-actual", "--outside", LARGE],
  ["--role-actual", "--run", LARGE],
  ["--role-stop", "--run", LARGE],
];

for (const [theme, colours] of [["light", light], ["dark", dark]]) {
  for (const [colour, on, least] of pairs) {
    test(`${theme}: ${colour} on ${on} has a contrast of at least ${least}`, () => {
      assert.ok(colours[colour] !== undefined && colours[on] !== undefined, "app.css does not set the colour");
      const c = contrast(colours[colour], colours[on]);
      assert.ok(c >= least, `${colours[colour]} on ${colours[on]}: ${c.toFixed(2)}`);
    });
  }
}

test("the dark theme sets every colour that the light theme sets", () => {
  const own = block(':root[data-theme="dark"]');
  for (const name of Object.keys(light)) assert.ok(name in own, `${name} has no dark colour`);
});

test("every role has a colour, and no two roles have the same", () => {
  for (const [theme, colours] of [["light", light], ["dark", dark]]) {
    const roles = Object.entries(colours).filter(([name]) => name.startsWith("--role-"));
    assert.ok(roles.length >= 7, theme);
    assert.equal(new Set(roles.map(([, value]) => value)).size, roles.length, theme);
  }
});

test("colours outside the two themes come from custom properties", () => {
  const rest = css.replace(block.toString(), "").split(/:root[^{]*\{[^}]*\}/).join("");
  assert.deepEqual(rest.match(/#[0-9A-Fa-f]{3,8}\b/g) ?? [], []);
});
