// Maths of axes: round ticks, ranges that grow at once and shrink late, the lanes' window, the timeline's zoom.

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

// Returns a range with round ends that holds [low, high] with a margin. `floor` is the least distance of low and high.
export function roundRange(low: number, high: number, floor: number): Range {
  const middle = (low + high) / 2;
  const half = Math.max((high - low) / 2, floor / 2);
  // A margin of 6 %, then the next round step outward. A force or a deviation has no less than zero.
  const step = roundStep(half / 4);
  const from = Math.floor((middle - half * 1.06) / step) * step;
  return {
    low: low < 0 ? from : low < 0.25 * high ? 0 : Math.max(0, from),
    high: Math.ceil((middle + half * 1.06) / step) * step,
  };
}

// Returns `range` grown to hold [low, high], in round steps: a range that jumps with each sample cannot be read.
export function growRange(range: Range | null, low: number, high: number, floor: number): Range {
  if (range !== null && low >= range.low && high <= range.high) return range;
  const fresh = roundRange(low, high, floor);
  return range === null ? fresh : { low: Math.min(fresh.low, range.low), high: Math.max(fresh.high, range.high) };
}

// A range shrinks once its data have filled less than this share of it for this time [s].
const ROOMY = 0.5;
const SHRINK_AFTER = 10;

// Lets the range of a lane shrink after a peak, slowly: once for all, long after the peak has left the window.
export class RangeRest {
  private since = NaN;

  // Returns the range to use at `now` [s] for data in [low, high]. `still`: nobody reads the lane now, so it may shrink.
  shrink(range: Range, low: number, high: number, floor: number, now: number, still: boolean): Range {
    const fresh = roundRange(low, high, floor);
    if (fresh.high - fresh.low > ROOMY * (range.high - range.low)) {
      this.since = NaN;
      return range;
    }
    if (!Number.isFinite(this.since)) this.since = now;
    if (now - this.since < SHRINK_AFTER || !still) return range;
    this.since = NaN;
    return fresh;
  }
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
