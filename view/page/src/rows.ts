// Rows of a session as the page keeps them: a ring of fixed size for live rows, blocks for stretches of a recording.
import { FLAG_CUT, FLAG_GAP, type RowsFrame } from "./protocol";

export interface RowSource {
  // First and one past the last row that is still there.
  readonly first: number;
  readonly end: number;
  timeOf(row: number): number;
  value(column: number, row: number): number;
}

// Returns the last row whose time is <= time, or source.first - 1 if there is none.
export function rowAt(source: RowSource, time: number): number {
  let low = source.first - 1;
  let high = source.end;
  while (high - low > 1) {
    const middle = Math.floor((low + high) / 2);
    if (source.timeOf(middle) <= time) low = middle;
    else high = middle;
  }
  return low;
}

// Returns the row nearest to time, or -1 if there is none within `tolerance` [s].
export function nearestRow(source: RowSource, time: number, tolerance: number): number {
  const before = rowAt(source, time);
  let best = -1;
  let distance = tolerance;
  for (let row = before; row <= before + 1; row++) {
    if (row < source.first || row >= source.end) continue;
    const d = Math.abs(source.timeOf(row) - time);
    if (d <= distance) {
      best = row;
      distance = d;
    }
  }
  return best;
}

// A step of time longer than this is a hole: a hidden tab, a lost connection [s].
const HOLE = 0.25;

// Keeps the newest rows of a live session, without holes: after a hole it starts again, since the server has what is
// missing. Memory is allocated once; the oldest row makes place for the newest.
export class RowRing implements RowSource {
  readonly capacity: number;
  readonly columns: number;
  end = 0;
  // Counts the holes: each starts a new stretch of rows.
  stretch = 0;
  private start = 0;
  private readonly mask: number;
  private readonly times: Float64Array;
  private readonly data: Float32Array[];

  // `capacity` is rounded up to a power of two.
  constructor(columns: number, capacity: number) {
    this.capacity = 2 ** Math.ceil(Math.log2(Math.max(2, capacity)));
    this.mask = this.capacity - 1;
    this.columns = columns;
    this.times = new Float64Array(this.capacity);
    this.data = Array.from({ length: columns }, () => new Float32Array(this.capacity));
  }

  get first(): number {
    return Math.max(this.start, this.end - this.capacity);
  }

  get newest(): number {
    return this.end > 0 ? this.times[(this.end - 1) & this.mask]! : NaN;
  }

  get oldest(): number {
    return this.end > 0 ? this.times[this.first & this.mask]! : NaN;
  }

  timeOf(row: number): number {
    return this.times[row & this.mask]!;
  }

  value(column: number, row: number): number {
    return this.data[column]![row & this.mask]!;
  }

  clear(): void {
    this.end = this.start = 0;
    this.stretch++;
  }

  // Appends the rows of a frame that are newer than the newest row. Returns how many those were.
  push(frame: RowsFrame): number {
    const t0 = frame.header.t0;
    const known = this.newest;
    let added = 0;
    const planes = Math.min(this.columns, frame.planes.length);
    for (let i = 0; i < frame.time.length; i++) {
      const time = t0 + frame.time[i]!;
      if (time <= known) continue;
      if (added === 0 && this.end > this.start && ((frame.header.flags & FLAG_GAP) !== 0 || time - known > HOLE)) {
        this.start = this.end;
        this.stretch++;
      }
      const at = this.end & this.mask;
      this.times[at] = time;
      for (let c = 0; c < planes; c++) this.data[c]![at] = frame.planes[c]![i]!;
      for (let c = planes; c < this.columns; c++) this.data[c]![at] = NaN;
      this.end++;
      added++;
    }
    return added;
  }
}

// Holds the rows of one stretch of a recording, as they came.
export class RowBlock implements RowSource {
  readonly first = 0;
  readonly end: number;
  // The stretch that this block answers for [s].
  readonly t0: number;
  readonly t1: number;
  // The server no longer keeps some of these rows.
  readonly cut: boolean;
  // A live session went on after this block was asked for: it is asked for again from this time on [ms].
  readonly again: number;
  private readonly frame: RowsFrame;

  constructor(frame: RowsFrame, t0: number, t1: number, again = Infinity) {
    this.cut = (frame.header.flags & FLAG_CUT) !== 0;
    this.again = again;
    this.frame = frame;
    this.end = frame.time.length;
    this.t0 = t0;
    this.t1 = t1;
  }

  timeOf(row: number): number {
    return this.frame.header.t0 + this.frame.time[row]!;
  }

  value(column: number, row: number): number {
    const plane = this.frame.planes[column];
    return plane === undefined ? NaN : plane[row]!;
  }
}

// Keeps the last used blocks of a recording. A block covers [k, k + 1) times `span`.
export class BlockCache {
  readonly span: number;
  private readonly most: number;
  private readonly blocks = new Map<number, RowBlock>();

  constructor(span: number, most: number) {
    this.span = span;
    this.most = most;
  }

  indexOf(time: number): number {
    return Math.floor(time / this.span);
  }

  at(time: number): RowBlock | null {
    return this.get(this.indexOf(time));
  }

  get(index: number): RowBlock | null {
    const block = this.blocks.get(index);
    if (block === undefined) return null;
    // A map keeps the order of insertion: the first key is the one that was not used for longest.
    this.blocks.delete(index);
    this.blocks.set(index, block);
    return block;
  }

  // `now`: performance.now() [ms].
  has(index: number, now = 0): boolean {
    const block = this.blocks.get(index);
    return block !== undefined && now < block.again;
  }

  put(index: number, frame: RowsFrame, again = Infinity): void {
    this.blocks.delete(index);
    this.blocks.set(index, new RowBlock(frame, index * this.span, (index + 1) * this.span, again));
    while (this.blocks.size > this.most) this.blocks.delete(this.blocks.keys().next().value as number);
  }

  drop(index: number): void {
    this.blocks.delete(index);
  }

  clear(): void {
    this.blocks.clear();
  }

  get size(): number {
    return this.blocks.size;
  }
}
