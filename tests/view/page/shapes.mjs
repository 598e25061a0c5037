// Paths and noise that several tests use.
import { readFileSync } from "node:fs";

const TURN = 2 * Math.PI;

// Points [m] along four paths: square, circle, a figure eight that leaves its plane, and the sample stroke.
export function paths() {
  const along = (f, n = 1200) => Array.from({ length: n }, (_, i) => f(i / (n - 1)));
  const side = 0.06;
  const square = (u) => {
    const s = (4 * u) % 4;
    const k = Math.min(3, Math.floor(s));
    const f = u >= 1 ? 1 : s - k;
    return [
      [-0.5 + f, -0.5],
      [0.5, -0.5 + f],
      [0.5 - f, 0.5],
      [-0.5, 0.5 - f],
    ][u >= 1 ? 3 : k].map((x) => x * side);
  };
  const stroke = readFileSync(new URL("../../../samples/paths/stroke.csv", import.meta.url), "utf8")
    .trim()
    .split("\n")
    .slice(1)
    .map((line) => line.split(",").slice(1, 4).map(Number));
  return {
    square: along((u) => [...square(u), 0]),
    circle: along((u) => [0.04 * Math.cos(TURN * u), 0.04 * Math.sin(TURN * u), 0.01]),
    "figure eight": along((u) => [
      0.05 * Math.sin(TURN * u),
      0.03 * Math.sin(2 * TURN * u),
      0.02 * Math.cos(TURN * u) + 0.01 * Math.sin(3 * TURN * u),
    ]),
    stroke,
  };
}

export function planes(points) {
  return {
    count: points.length,
    x: points.map((p) => p[0]),
    y: points.map((p) => p[1]),
    z: points.map((p) => p[2]),
    radius: points.map(() => 0.005),
  };
}

// Deterministic normal numbers: a linear congruence and Box-Muller.
export function noise(seed = 1) {
  let state = seed >>> 0;
  const uniform = () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return (state + 0.5) / 2 ** 32;
  };
  return () => Math.sqrt(-2 * Math.log(uniform())) * Math.cos(TURN * uniform());
}

export const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
export const rms = (values) => Math.sqrt(values.reduce((sum, v) => sum + v * v, 0) / values.length);
