// Maths of axes: round ticks, ranges that only grow, the lanes' window, the timeline's zoom.

// Returns 1, 2 or 5 times a power of ten that is at least `least`.
export function roundStep(least: number): number {
  if (!(least > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(least) + 1e-9);
  for (const m of [1, 2, 5, 10]) if (m * power >= least * (1 - 1e-9)) return m * power;
  return 10 * power;
}

// Returns round values in [low, high], at most `most` of them.
export function ticks(low: number, high: number, most: number): number[] {
  if (!(high > low) || most < 1) return [];
  const step = roundStep((high - low) / most);
  const out: number[] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++) out.push(k === 0 ? 0 : k * step);
  return out;
}

const TIME_STEPS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400];

// Returns the distance of the ticks of a time axis that shows `span` seconds with at most `most` of them.
export function timeStep(span: number, most: number): number {
  for (const step of TIME_STEPS) if (span / step <= most) return step;
  return 86400;
}

export interface Range {
  low: number;
  high: number;
}

// Returns `range` grown to hold [low, high], in round steps: a range that jumps with each sample cannot be read. `floor`
// is the least distance of low and high.
export function growRange(range: Range | null, low: number, high: number, floor: number): Range {
  if (range !== null && low >= range.low && high <= range.high) return range;
  const from = Math.min(low, range?.low ?? low);
  const to = Math.max(high, range?.high ?? high);
  const middle = (from + to) / 2;
  const half = Math.max((to - from) / 2, floor / 2);
  // A margin of 6 %, then the next round step outward. Zero stays zero: a force or a deviation has no less.
  const step = roundStep(half / 4);
  const grownLow = from >= 0 && from < 0.25 * to ? 0 : Math.floor((middle - half * 1.06) / step) * step;
  const grownHigh = Math.ceil((middle + half * 1.06) / step) * step;
  return { low: Math.min(grownLow, range?.low ?? grownLow), high: Math.max(grownHigh, range?.high ?? grownHigh) };
}

export interface Span {
  t0: number;
  t1: number;
}

export const PLAYHEAD = 0.65;
export const SPAN_LEAST = 0.05; // [s]
export const SPAN_MOST = 7 * 86400; // [s]

// Returns the window of the lanes. Live: it ends at the shown time. Playing: the playhead runs to 65 % of the window and
// stays there. At rest: the window stays where it is as long as it holds the shown time.
export function follow(window: Span, shown: number, start: number, end: number, mode: "live" | "playing" | "rest"): Span {
  const span = window.t1 - window.t0;
  if (mode === "live") return { t0: shown - span, t1: shown };
  let t0 = window.t0;
  const inside = shown >= window.t0 - 1e-9 && shown <= window.t1 + 1e-9;
  if (mode === "playing" ? !inside || shown > window.t0 + PLAYHEAD * span : !inside) t0 = shown - PLAYHEAD * span;
  // Nothing is beyond the ends of a recording.
  t0 = Math.max(start, Math.min(t0, end - span));
  return { t0, t1: t0 + span };
}

// Returns a window zoomed by `factor` (below 1: closer) about `time`, within [start, end] if it is shorter than that.
export function zoomAbout(window: Span, time: number, factor: number, least: number, most: number): Span {
  const span = window.t1 - window.t0;
  const next = Math.min(most, Math.max(least, span * factor));
  const share = span > 0 ? Math.min(1, Math.max(0, (time - window.t0) / span)) : 0.5;
  const t0 = time - share * next;
  return { t0, t1: t0 + next };
}

// Returns a window moved and, if need be, shortened to lie within [start, end].
export function within(window: Span, start: number, end: number): Span {
  const span = Math.min(window.t1 - window.t0, end - start);
  const t0 = Math.max(start, Math.min(window.t0, end - span));
  return { t0, t1: t0 + span };
}

// Returns how fast the view of the timeline scrolls when the pointer is at `x` of [0, width] while it drags [views/s].
export function edgeScroll(x: number, width: number, edge: number): number {
  if (x < edge) return -Math.min(1, (edge - x) / edge);
  if (x > width - edge) return Math.min(1, (x - width + edge) / edge);
  return 0;
}
