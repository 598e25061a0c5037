// Min-max bins: what the lanes draw. A bin keeps the first, least, largest and last value of its rows, so that a peak of
// one sample is seen at every zoom. Bins are anchored in absolute time: bin k covers [k w, (k + 1) w).
import type { BinChannel, BinsFrame } from "./protocol";
import type { RowRing, RowSource } from "./rows";

// A stretch of bins of several channels. Bin k is at index (k - base) & mask of the arrays.
export interface BinView {
  readonly width: number;
  readonly k0: number; // first bin
  readonly k1: number; // one past the last bin
  readonly base: number;
  readonly mask: number;
  channel(name: string): BinChannel | null;
}

// Returns the narrowest width that shows `span` seconds in at most `pixels` bins: a power of two times the row period.
export function binWidth(span: number, pixels: number, period: number): number {
  let width = period;
  while (span / width > Math.max(1, pixels)) width *= 2;
  return width;
}

// Times come as float32 after the start of their batch: up to 12 s of them are rounded by less than this [s].
export const ROUNDING = 1e-6;

// Returns the bin that holds `time`. A time that is a bin's start up to rounding belongs to that bin.
export function binOf(time: number, width: number): number {
  return Math.floor((time + ROUNDING) / width);
}

// Shows bins of the server as a view.
export class FrameBins implements BinView {
  readonly width: number;
  readonly k0: number;
  readonly k1: number;
  readonly base: number;
  readonly mask = -1;
  private readonly channels: Map<string, BinChannel>;

  constructor(frame: BinsFrame, names: readonly string[]) {
    this.width = frame.width;
    this.k0 = binOf(frame.header.t0, frame.width);
    this.k1 = this.k0 + frame.header.rows;
    this.base = this.k0;
    this.channels = new Map(names.map((name, i) => [name, frame.channels[i]!]));
  }

  channel(name: string): BinChannel | null {
    return this.channels.get(name) ?? null;
  }
}

// The first row of a session comes within this time of its start [s].
const FIRST_ROW = 0.02;

// Keeps bins of the newest rows, bin by bin as rows arrive. Memory is allocated once.
export class LiveBins implements BinView {
  width = 0;
  k0 = 0;
  k1 = 0;
  readonly base = 0;
  readonly mask: number;
  private readonly names: readonly string[];
  private readonly columns: readonly number[];
  private readonly data: BinChannel[];
  // The first bin that has all its rows begins here [s].
  full = -Infinity;
  private nextRow = 0;
  private stretch = 0;

  // `capacity` bins, rounded up to a power of two.
  constructor(names: readonly string[], columns: readonly number[], capacity: number) {
    const size = 2 ** Math.ceil(Math.log2(Math.max(2, capacity)));
    this.mask = size - 1;
    this.names = names;
    this.columns = columns;
    const plane = (): Float32Array => new Float32Array(size);
    this.data = names.map(() => ({ first: plane(), min: plane(), max: plane(), last: plane(), order: new Uint8Array(size) }));
  }

  channel(name: string): BinChannel | null {
    const i = this.names.indexOf(name);
    return i < 0 ? null : this.data[i]!;
  }

  // Adds the rows of `source` that came since the last call. Starts again after another width, or after a hole.
  // `start` is the time before which the session has no rows [s].
  update(source: RowRing, width: number, start: number): void {
    if (width !== this.width || source.stretch !== this.stretch || this.nextRow < source.first || this.nextRow > source.end) {
      this.width = width;
      this.stretch = source.stretch;
      this.k0 = this.k1 = 0;
      this.nextRow = source.first;
      // Rows older than the capacity have no bin.
      const newest = source.end - 1;
      if (newest >= source.first) {
        const oldest = (binOf(source.timeOf(newest), width) - this.mask) * width;
        while (this.nextRow < source.end && source.timeOf(this.nextRow) < oldest) this.nextRow++;
      }
    }
    for (; this.nextRow < source.end; this.nextRow++) this.add(source, this.nextRow, start);
  }

  private add(source: RowSource, row: number, start: number): void {
    const k = binOf(source.timeOf(row), this.width);
    if (this.k1 === this.k0) {
      this.k0 = k;
      this.k1 = k;
      this.full = source.timeOf(row) - start < FIRST_ROW ? k * this.width : (k + 1) * this.width;
    }
    if (k < this.k1 - 1) return; // a row of the past
    const size = this.mask + 1;
    if (k >= this.k1 + size) {
      // A gap longer than all that is kept.
      this.k0 = this.k1 = k;
      this.full = (k + 1) * this.width;
    }
    for (; this.k1 <= k; this.k1++) {
      const i = this.k1 & this.mask;
      for (const c of this.data) {
        c.first[i] = c.min[i] = c.max[i] = c.last[i] = NaN;
        c.order[i] = 0;
      }
    }
    if (this.k1 - this.k0 > size) {
      this.k0 = this.k1 - size;
      this.full = Math.max(this.full, this.k0 * this.width);
    }
    const i = k & this.mask;
    for (let n = 0; n < this.columns.length; n++) {
      const value = source.value(this.columns[n]!, row);
      if (value !== value) continue;
      const c = this.data[n]!;
      if (c.first[i] !== c.first[i]) {
        c.first[i] = c.min[i] = c.max[i] = c.last[i] = value;
        c.order[i] = 1;
        continue;
      }
      c.last[i] = value;
      if (value < c.min[i]!) {
        c.min[i] = value;
        c.order[i] = 0; // the minimum is now the later one
      }
      if (value > c.max[i]!) {
        c.max[i] = value;
        c.order[i] = 1;
      }
    }
  }
}

export interface Pen {
  moveTo(x: number, y: number): void;
  lineTo(x: number, y: number): void;
}

// Shorter gaps than this do not break a line [s].
export const GAP = 0.02;

// Draws the bins of [k0, k1) as one line: first, min, max, last of each in the order of their times (M4). `xOf(t)` is
// ax + bx t, `yOf(v)` is ay + by v. Returns the number of bins drawn.
export function drawBins(pen: Pen, view: BinView, channel: BinChannel, k0: number, k1: number, ax: number, bx: number, ay: number, by: number): number {
  const { width, base, mask } = view;
  const from = Math.max(k0, view.k0);
  const to = Math.min(k1, view.k1);
  const apart = Math.max(3, Math.ceil(GAP / width));
  const quarter = (bx * width) / 4;
  let last = -Infinity;
  let drawn = 0;
  for (let k = from; k < to; k++) {
    const i = (k - base) & mask;
    const first = channel.first[i]!;
    if (first !== first) continue;
    drawn++;
    const x = ax + bx * k * width;
    const low = channel.min[i]!;
    const high = channel.max[i]!;
    const yFirst = ay + by * first;
    if (k - last > apart) pen.moveTo(x, yFirst);
    else pen.lineTo(x, yFirst);
    last = k;
    if (low !== high) {
      const minFirst = channel.order[i] === 1;
      pen.lineTo(x + quarter, ay + by * (minFirst ? low : high));
      pen.lineTo(x + 2 * quarter, ay + by * (minFirst ? high : low));
      pen.lineTo(x + 3 * quarter, ay + by * channel.last[i]!);
    } else if (k === from || drawn === 1) {
      // A single point is seen too.
      pen.lineTo(x + 0.5, yFirst);
    }
  }
  return drawn;
}

// Returns the least and largest value of a channel in [k0, k1); null if there is none.
export function rangeOf(view: BinView, channel: BinChannel, k0: number, k1: number): [number, number] | null {
  let low = Infinity;
  let high = -Infinity;
  for (let k = Math.max(k0, view.k0); k < Math.min(k1, view.k1); k++) {
    const i = (k - view.base) & view.mask;
    if (channel.min[i]! < low) low = channel.min[i]!;
    if (channel.max[i]! > high) high = channel.max[i]!;
  }
  return low <= high ? [low, high] : null;
}
