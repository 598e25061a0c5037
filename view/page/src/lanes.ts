// The lanes: charts of position, deviation, force and progress under one time axis, each with its present value.
import { binOf, binWidth, drawBins, FrameBins, LiveBins, rangeOf, type BinView } from "./bins";
import { el, setAttribute, setClass, setHidden, setText } from "./dom";
import { clock, decimals, shownAs, UNKNOWN } from "./format";
import { FONT, FONT_BOLD, readColours, Surface, type Colours } from "./graphics";
import { Latest } from "./latest";
import type { Client } from "./client";
import type { Model } from "./model";
import { FLAG_COARSE, type BinsFrame } from "./protocol";
import { follow, growRange, RangeRest, SPAN_LEAST, SPAN_MOST, ticks, timeStep, zoomAbout, type Range, type Span } from "./scale";

interface LaneKind {
  column: string;
  label: string;
  short: string;
  // Drawn under the actual: the path of a position.
  reference?: string;
  // Above this the lane is shaded: the tunnel's radius.
  limit?: string;
  role: "actual" | "force";
  second: string;
  tall: boolean;
  // Least height of the range, in the column's unit.
  floor: number;
}

const LABEL_HEIGHT = 14; // [px]
const KINDS: LaneKind[] = [
  { column: "x", label: "x", short: "x", reference: "rx", role: "actual", second: "path", tall: false, floor: 0.01 },
  { column: "y", label: "y", short: "y", reference: "ry", role: "actual", second: "path", tall: false, floor: 0.01 },
  { column: "z", label: "z", short: "z", reference: "rz", role: "actual", second: "path", tall: false, floor: 0.01 },
  { column: "deviation", label: "Deviation", short: "Dev.", limit: "radius", role: "actual", second: "radius", tall: true, floor: 0.002 },
  { column: "force", label: "Force", short: "Force", role: "force", second: "", tall: true, floor: 0.5 },
  { column: "progress", label: "Progress", short: "Progress", role: "actual", second: "", tall: false, floor: 0.01 },
  { column: "speed", label: "Speed", short: "Speed", role: "actual", second: "", tall: false, floor: 0.005 },
];

// In a narrow window the lane that says most comes first.
const NARROW_ORDER = ["deviation", "force", "x", "y", "z", "progress", "speed"];

interface Lane {
  kind: LaneKind;
  column: number;
  factor: number;
  unit: string;
  digits: number;
  row: HTMLElement;
  tab: HTMLButtonElement;
  value: Text;
  second: HTMLElement;
  range: Range | null;
  rest: RangeRest;
  top: number;
  height: number;
}

interface Question {
  t0: number;
  t1: number;
  width: number;
  generation: number;
}

export const NARROW = "(max-width: 759px)";
const AXIS = 29; // [px]
const VALUES_EVERY = 66; // [ms]: digits that change faster cannot be read
const LIVE_BINS = 8192;
// A coarse answer is asked for again after this time [ms].
export const ASK_AGAIN = 400;
// New data of a live session are asked for this often [ms].
const ASK_LIVE = 1000;

export interface LanesOptions {
  software: boolean;
}

export class Lanes {
  // The stretch of time that the lanes show.
  window: Span = { t0: 0, t1: 10 };
  // Left and right of the plot [px].
  left = 84;
  right = 122;
  readonly root: HTMLElement;
  private readonly model: Model;
  private readonly surface: Surface;
  private readonly tabs = el("div", { class: "lane-tabs", role: "tablist", "aria-label": "Chart" });
  private readonly rows = el("div", { class: "lane-rows" });
  private readonly plot: HTMLElement;
  private readonly summary = el("p", { class: "unseen", id: "lanes-summary" });
  private readonly narrow = matchMedia(NARROW);
  private lanes: Lane[] = [];
  private names: string[] = [];
  private selected = "";
  private colours: Colours = readColours();
  private stored: FrameBins | null = null;
  private storedAt = 0;
  private coarse = false;
  private storedWidth = 0;
  private storedSpan: Span = { t0: 0, t1: 0 };
  // End of the whole bins that are stored [s].
  private storedEnd = -Infinity;
  private askedAt = -Infinity;
  private live: LiveBins | null = null;
  private generation = 0;
  private readonly requests: Latest<Question, BinsFrame>;
  private key = "";
  private valuesDue = 0;
  private valuesKey = "";
  private summaryDue = 0;
  private askedRanges = false;
  private span = 10;
  private layoutDue = true;

  constructor(host: HTMLElement, model: Model, client: Client, options: LanesOptions) {
    this.model = model;
    this.plot = el("div", { class: "lanes-plot", title: "" });
    this.root = el("section", { class: "lanes", "aria-label": "Charts" }, this.tabs, this.plot, this.summary);
    this.plot.removeAttribute("title");
    this.plot.append(this.rows);
    host.append(this.root);
    this.surface = new Surface(this.plot, options.software, () => (this.layoutDue = true));
    this.surface.canvas.setAttribute("role", "img");
    this.surface.canvas.setAttribute("aria-label", "Charts of the movement over time");
    this.surface.canvas.setAttribute("aria-describedby", "lanes-summary");
    this.requests = new Latest(
      (q) => {
        const pixels = Math.ceil((q.t1 - q.t0) / q.width) + 1;
        return client.requestBins(q.t0, q.t1, pixels, this.names);
      },
      (q, frame) => {
        if (q.generation !== this.generation) return;
        this.coarse = (frame.header.flags & FLAG_COARSE) !== 0;
        this.storedAt = performance.now();
        this.stored = new FrameBins(frame, this.names);
        this.storedWidth = q.width;
        this.storedSpan = { t0: q.t0, t1: q.t1 };
        // Live, the last bin of the answer was not over.
        this.storedEnd = model.live ? binOf(q.t1, frame.width) * frame.width : q.t1;
        this.key = "";
      },
    );
    this.askRanges = async () => {
      const generation = this.generation;
      const names = this.names.slice();
      const frame = await client.requestBins(model.start, model.end, 64, names);
      if (generation !== this.generation) return;
      if (frame === null) {
        window.setTimeout(() => (this.askedRanges = false), 1000);
        return;
      }
      const view = new FrameBins(frame, names);
      for (const lane of this.lanes) {
        const r = this.extent(lane, view, view.k0, view.k1);
        if (r !== null) lane.range = growRange(lane.range, ...r, lane.kind.floor * lane.factor);
        // A recording's column without a value is no lane: a path has no force.
        const empty = lane.range === null && model.hello?.live !== true && (frame.header.flags & FLAG_COARSE) === 0;
        setHidden(lane.row, empty);
        setHidden(lane.tab, empty);
        if (empty) this.layoutDue = true;
      }
      this.key = "";
    };
    this.narrow.addEventListener("change", () => (this.layoutDue = true));
    model.on("recording", () => this.takeRecording());
    model.on("connection", () => {
      if (model.connected) this.askedRanges = false;
    });
    model.on("theme", () => {
      this.colours = readColours();
      this.key = "";
    });
    this.listen();
    if (model.recording !== null) this.takeRecording();
  }

  private readonly askRanges: () => Promise<void>;

  useSoftware(): void {
    this.surface.useSoftware();
    this.layoutDue = true;
  }

  // Sets how many seconds the lanes show.
  setSpan(span: number, about = this.model.shown): void {
    const most = Math.min(SPAN_MOST, Math.max(1, this.model.end - this.model.start));
    const next = Math.min(Math.max(SPAN_LEAST, span), this.model.live ? SPAN_MOST : most);
    this.window = zoomAbout(this.window, about, next / (this.window.t1 - this.window.t0), SPAN_LEAST, SPAN_MOST);
    this.span = next;
    this.key = "";
  }

  get plotWidth(): number {
    return Math.max(10, this.surface.width - this.left - this.right);
  }

  // The lanes have room on the screen.
  get visible(): boolean {
    return this.surface.width >= 20 && this.surface.height >= 20;
  }

  timeAt(clientX: number): number {
    const box = this.plot.getBoundingClientRect();
    return this.window.t0 + ((clientX - box.left - this.left) / this.plotWidth) * (this.window.t1 - this.window.t0);
  }

  // Returns the value that a lane shows at this moment, in SI, and its text. For tests.
  shownValues(): { name: string; value: number; text: string }[] {
    return this.lanes.map((l) => ({ name: l.kind.column, value: this.model.value(l.kind.column), text: l.value.data }));
  }

  // Returns the bins of a lane as they are drawn: start, width, least and largest value in SI. For tests.
  drawnBins(column: string): { t: number; width: number; min: number; max: number }[] {
    const out: { t: number; width: number; min: number; max: number }[] = [];
    for (const { view, k0, k1 } of this.views()) {
      const channel = view.channel(column);
      if (channel === null) continue;
      for (let k = Math.max(k0, view.k0); k < Math.min(k1, view.k1); k++) {
        const i = (k - view.base) & view.mask;
        if (channel.min[i] === channel.min[i]) out.push({ t: k * view.width, width: view.width, min: channel.min[i]!, max: channel.max[i]! });
      }
    }
    return out;
  }

  // Draws if something changed. `now` is performance.now() [ms].
  draw(now: number): boolean {
    const m = this.model;
    if (m.recording === null || !this.visible) return false;
    if (this.layoutDue) this.layout();
    const mode = m.following ? "live" : m.playing ? "playing" : "rest";
    let window = this.window;
    const span = m.live ? this.span : Math.min(this.span, Math.max(SPAN_LEAST, m.end - m.start));
    if (Math.abs(window.t1 - window.t0 - span) > 1e-9) window = { t0: window.t0, t1: window.t0 + span };
    this.window = follow(window, m.shown, m.start, Math.max(m.end, m.start + span), mode);
    this.fetch(now);
    this.drawValues(now);
    const key = `${this.window.t0} ${this.window.t1} ${m.shown} ${m.dataVersion} ${m.loopOn} ${m.loop?.t0} ${m.loop?.t1} ${m.following}`;
    if (key === this.key) return false;
    this.key = key;
    this.paint();
    return true;
  }

  private takeRecording(): void {
    const m = this.model;
    const names = new Set<string>();
    const kinds = KINDS.filter((k) => m.has(k.column) && (k.column !== "speed" || !m.has("deviation")));
    for (const k of kinds) for (const n of [k.column, k.reference, k.limit]) if (n !== undefined && m.has(n)) names.add(n);
    const next = [...names];
    this.generation++;
    this.stored = null;
    this.askedRanges = false;
    this.key = "";
    if (next.join() !== this.names.join() || this.lanes.length !== kinds.length) {
      this.names = next;
      this.build(kinds);
    } else {
      for (const lane of this.lanes) {
        lane.column = m.column(lane.kind.column);
        setHidden(lane.row, false);
        setHidden(lane.tab, false);
        if (!m.live) lane.range = null;
      }
      this.layoutDue = true;
    }
    this.live = m.hello?.live === true ? new LiveBins(this.names, this.names.map((n) => m.column(n)), LIVE_BINS) : null;
    if (!m.live) {
      this.span = Math.min(10, Math.max(SPAN_LEAST, m.end - m.start));
      this.window = { t0: m.start, t1: m.start + this.span };
    }
  }

  private build(kinds: LaneKind[]): void {
    const m = this.model;
    this.rows.replaceChildren();
    this.tabs.replaceChildren();
    this.lanes = kinds.map((kind) => {
      const unit = m.recording!.columns[m.column(kind.column)]!.unit;
      const how = shownAs(kind.column, unit);
      const value = document.createTextNode(UNKNOWN);
      const second = el("div", { class: "lane-second" });
      const figures = el("div", { class: "lane-figures" }, el("div", { class: "lane-value" }, value, el("small", {}, how.unit)), second);
      const row = el("div", { class: `lane ${kind.role}${kind.tall ? " tall" : ""}` }, el("div", { class: "lane-name" }, kind.label), figures);
      const tab = el("button", { type: "button", class: "lane-tab", role: "tab" }, kind.label);
      tab.addEventListener("click", () => this.select(kind.column));
      this.rows.append(row);
      return { kind, column: m.column(kind.column), factor: how.factor, unit: how.unit, digits: how.digits, row, tab, value, second, range: null, rest: new RangeRest(), top: 0, height: 0 };
    });
    const order = [...this.lanes].sort((a, b) => NARROW_ORDER.indexOf(a.kind.column) - NARROW_ORDER.indexOf(b.kind.column));
    this.tabs.append(...order.map((l) => l.tab));
    this.tabs.addEventListener("keydown", (event) => {
      if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
      const at = order.findIndex((l) => l.kind.column === this.selected);
      const to = order[(at + (event.key === "ArrowRight" ? 1 : order.length - 1)) % order.length];
      if (to === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      this.select(to.kind.column);
      to.tab.focus();
    });
    this.select(order.some((l) => l.kind.column === this.selected) ? this.selected : (order[0]?.kind.column ?? ""));
    this.valuesKey = "";
  }

  private select(column: string): void {
    this.selected = column;
    for (const lane of this.lanes) {
      const on = lane.kind.column === column;
      setClass(lane.row, "selected", on);
      setAttribute(lane.tab, "aria-selected", String(on));
      lane.tab.tabIndex = on ? 0 : -1;
    }
    this.layoutDue = true;
  }

  private layout(): void {
    this.layoutDue = false;
    this.left = this.narrow.matches ? 50 : 84;
    this.right = this.narrow.matches ? 76 : 122;
    for (const lane of this.lanes) {
      lane.top = lane.row.offsetTop;
      lane.height = lane.row.offsetHeight;
      setClass(lane.row, "short", lane.height > 0 && lane.height < 64);
    }
    this.key = "";
  }

  private get width(): number {
    // A bin of one pixel, and of no less than one row.
    return binWidth(this.window.t1 - this.window.t0, Math.max(64, Math.round(this.plotWidth)), this.model.period);
  }

  // Asks for what is missing. The picture stays as it is until the answer comes.
  private fetch(now: number): void {
    const m = this.model;
    const w = this.window;
    const width = this.width;
    if (this.live !== null && m.ring.end > 0) this.live.update(m.ring, width, m.start);
    if (!m.connected) return;
    if (!this.askedRanges && m.end > m.start && (m.hello?.live !== true || now > 0)) {
      this.askedRanges = true;
      void this.askRanges();
    }
    const span = w.t1 - w.t0;
    const t0 = Math.max(w.t0, m.start);
    const t1 = this.neededEnd(width);
    if (t0 >= t1) return;
    const left = this.stored !== null && this.storedWidth === width && this.storedSpan.t0 <= t0 + 1e-9;
    const again = this.coarse && now - this.storedAt > ASK_AGAIN;
    if (left && !again) {
      const ahead = m.playing && !m.following ? Math.min(m.end, w.t1 + span * 0.5) : t1;
      if (this.storedEnd >= Math.max(t1, m.live ? t1 : ahead) - 1e-9) return;
      // A live session grows in each frame.
      if (m.live && now - this.askedAt < ASK_LIVE) return;
    }
    const q: Question = { t0: Math.max(m.start, w.t0 - span), t1: Math.min(m.end, w.t1 + span), width, generation: this.generation };
    const asked = this.requests.outstanding;
    if (asked !== null && asked.width === q.width && asked.generation === q.generation && asked.t0 <= t0 && asked.t1 >= t1) return;
    if (!(q.t1 > q.t0)) return;
    this.askedAt = now;
    this.requests.request(q);
  }

  // End of what the lanes need from the server [s]: live, of the last whole bin that the page does not have itself.
  private neededEnd(width: number): number {
    const m = this.model;
    const end = Math.min((binOf(this.window.t1, width) + 1) * width, m.end);
    const own = this.ownBins();
    if (own === null) return m.live ? binOf(end, width) * width : Math.min(this.window.t1, m.end);
    return binOf(Math.min(end, own.full), width) * width;
  }

  private ownBins(): LiveBins | null {
    return this.live !== null && this.live.k1 > this.live.k0 ? this.live : null;
  }

  // The bins to draw, oldest first: the server's, then those of the live rows.
  private views(): { view: BinView; k0: number; k1: number }[] {
    const w = this.window;
    const out: { view: BinView; k0: number; k1: number }[] = [];
    const live = this.ownBins();
    const s = this.stored;
    // A bin that is not whole, here or there, gives way to one that is.
    const split = live === null ? Infinity : s === null ? -Infinity : Math.max(live.k0 * live.width, Math.min(live.full, this.storedEnd));
    if (s !== null && w.t0 < split) {
      out.push({ view: s, k0: binOf(w.t0, s.width) - 1, k1: Math.min(binOf(w.t1, s.width) + 2, Number.isFinite(split) ? binOf(split, s.width) : Infinity) });
    }
    if (live !== null && w.t1 > split) out.push({ view: live, k0: Math.max(binOf(w.t0, live.width) - 1, Number.isFinite(split) ? binOf(split, live.width) : live.k0), k1: binOf(w.t1, live.width) + 2 });
    return out;
  }

  // Fits the range of a lane to bins. Live, it shrinks long after a peak, but not while the hand moves.
  private fitRange(lane: Lane, views: { view: BinView; k0: number; k1: number }[]): void {
    let low = Infinity;
    let high = -Infinity;
    for (const { view, k0, k1 } of views) {
      const r = this.extent(lane, view, k0, k1);
      if (r === null) continue;
      low = Math.min(low, r[0]);
      high = Math.max(high, r[1]);
    }
    if (!(low <= high)) return;
    const floor = lane.kind.floor * lane.factor;
    lane.range = growRange(lane.range, low, high, floor);
    const m = this.model;
    if (!m.live || !m.following) return;
    const still = m.status?.phase !== "run" || m.recording?.verb === "record";
    lane.range = lane.rest.shrink(lane.range, low, high, floor, performance.now() / 1000, still);
  }

  // Least and largest value of a lane in bins, in the unit that is shown, so that round ends are round there.
  private extent(lane: Lane, view: BinView, k0: number, k1: number): [number, number] | null {
    let low = Infinity;
    let high = -Infinity;
    for (const name of [lane.kind.column, lane.kind.reference, lane.kind.limit]) {
      const channel = name === undefined ? null : view.channel(name);
      const r = channel === null ? null : rangeOf(view, channel, k0, k1);
      if (r === null) continue;
      low = Math.min(low, r[0]);
      high = Math.max(high, r[1]);
    }
    if (!(low <= high)) return null;
    const f = lane.factor;
    if (lane.kind.column === "deviation" || lane.kind.column === "force") low = Math.min(low, 0);
    return [low * f, high * f];
  }

  private paint(): void {
    const c = this.surface.begin();
    const col = this.colours;
    const m = this.model;
    const w = this.window;
    const views = this.views();
    const width = this.plotWidth;
    const left = this.left;
    const bx = width / (w.t1 - w.t0);
    const ax = left - w.t0 * bx;
    const bottom = this.surface.height - AXIS;
    c.font = FONT;
    c.textBaseline = "middle";
    c.lineJoin = "round";

    const step = timeStep(w.t1 - w.t0, Math.max(2, Math.floor(width / 68)));
    c.strokeStyle = col.grid;
    c.lineWidth = 1;
    c.beginPath();
    const tickTimes: number[] = [];
    const origin = m.following ? w.t1 : 0;
    for (let k = Math.ceil((w.t0 - origin) / step - 1e-9); k * step + origin <= w.t1 + 1e-9; k++) tickTimes.push(k * step + origin);
    for (const t of tickTimes) {
      const x = Math.round(ax + bx * t) + 0.5;
      c.moveTo(x, 0);
      c.lineTo(x, bottom);
    }
    c.stroke();

    for (const lane of this.lanes) {
      if (lane.height <= 0) continue;
      this.fitRange(lane, views);
      this.paintLane(c, lane, views, ax, bx);
    }

    if (m.loop !== null) {
      const x0 = Math.max(left, ax + bx * m.loop.t0);
      const x1 = Math.min(left + width, ax + bx * m.loop.t1);
      if (x1 > x0) {
        c.globalAlpha = m.loopOn ? 0.12 : 0.05;
        c.fillStyle = col.text;
        c.fillRect(x0, 0, x1 - x0, bottom);
        c.globalAlpha = 1;
      }
    }
    this.paintAxis(c, tickTimes, step, ax, bx, bottom, origin);
  }

  private paintLane(c: CanvasRenderingContext2D, lane: Lane, views: { view: BinView; k0: number; k1: number }[], ax: number, bx: number): void {
    const col = this.colours;
    const left = this.left;
    const width = this.plotWidth;
    const range = lane.range ?? { low: 0, high: 1 };
    const pad = 8;
    const by = -(lane.height - 2 * pad) / (range.high - range.low);
    const ay = lane.top + pad - by * range.high;
    c.save();
    c.beginPath();
    c.rect(0, lane.top, left + width, lane.height - 1);
    c.clip();

    c.strokeStyle = col.grid;
    c.fillStyle = col.second;
    c.lineWidth = 1;
    c.textAlign = "right";
    c.beginPath();
    const marks = ticks(range.low, range.high, Math.max(2, Math.min(5, Math.floor((lane.height - 2 * pad) / 22))));
    const digits = marks.length > 1 ? Math.max(0, -Math.floor(Math.log10(marks[1]! - marks[0]!) + 1e-9)) : 0;
    let written = Infinity;
    for (const v of marks) {
      const y = Math.round(ay + by * v) + 0.5;
      c.moveTo(left, y);
      c.lineTo(left + width, y);
      // The first line of a lane is its name, and in a low lane there is no place for every number.
      const place = Math.min(lane.top + lane.height - 9, Math.max(lane.top + 8, y));
      if (written - place < LABEL_HEIGHT || !(y > lane.top + 26 || (this.left > 60 && lane.kind.label.length === 1))) continue;
      c.fillText(decimals(v, digits), left - 8, place);
      written = place;
    }
    c.stroke();
    c.beginPath();
    c.rect(left, lane.top, width, lane.height - 1);
    c.clip();

    const f = lane.factor;
    const line = (name: string, colour: string, thick: number, dash: number[]): void => {
      c.strokeStyle = colour;
      c.lineWidth = thick;
      c.setLineDash(dash);
      c.beginPath();
      for (const { view, k0, k1 } of views) {
        const channel = view.channel(name);
        if (channel !== null) drawBins(c, view, channel, k0, k1, ax, bx, ay, by * f);
      }
      c.stroke();
      c.setLineDash([]);
    };
    if (lane.kind.limit !== undefined && this.model.has(lane.kind.limit)) {
      this.shade(c, lane, views, ax, bx, ay, by * f);
      line(lane.kind.limit, col.path, 1.3, [4, 3]);
    }
    if (lane.kind.reference !== undefined) line(lane.kind.reference, col.path, 2.6, []);
    line(lane.kind.column, lane.kind.role === "force" ? col.force : col.actual, 1.7, []);
    c.restore();
  }

  // Fills what is outside the tunnel.
  private shade(c: CanvasRenderingContext2D, lane: Lane, views: { view: BinView; k0: number; k1: number }[], ax: number, bx: number, ay: number, by: number): void {
    c.fillStyle = this.colours.outside;
    for (const { view, k0, k1 } of views) {
      const channel = view.channel(lane.kind.limit!);
      if (channel === null) continue;
      const from = Math.max(k0, view.k0);
      const to = Math.min(k1, view.k1);
      const apart = Math.max(3, Math.ceil(0.02 / view.width));
      let start = NaN;
      let lastX = 0;
      let lastK = 0;
      c.beginPath();
      const close = (): void => {
        if (start !== start) return;
        c.lineTo(lastX, lane.top);
        c.lineTo(start, lane.top);
        c.closePath();
        start = NaN;
      };
      for (let k = from; k < to; k++) {
        const r = channel.min[(k - view.base) & view.mask]!;
        if (r !== r) continue;
        if (start === start && k - lastK > apart) close();
        const x = ax + bx * k * view.width;
        if (start !== start) {
          start = x;
          c.moveTo(x, ay + by * r);
        } else {
          c.lineTo(x, ay + by * r);
        }
        lastX = x + bx * view.width;
        lastK = k;
        c.lineTo(lastX, ay + by * r);
      }
      close();
      c.fill();
    }
  }

  private paintAxis(c: CanvasRenderingContext2D, times: number[], step: number, ax: number, bx: number, bottom: number, origin: number): void {
    const col = this.colours;
    const m = this.model;
    const left = this.left;
    const right = left + this.plotWidth;
    const y = bottom + AXIS / 2;
    const digits = step >= 1 ? 0 : step >= 0.1 ? 1 : step >= 0.01 ? 2 : 3;
    const playhead = ax + bx * m.shown;
    const badge = clock(m.shown, 3);
    c.font = FONT_BOLD;
    const badgeWidth = c.measureText(badge).width + 14;
    const badgeX = Math.min(this.surface.width - badgeWidth - 2, Math.max(2, playhead - badgeWidth / 2));
    c.font = FONT;
    c.fillStyle = col.second;
    c.textAlign = "center";
    for (const t of times) {
      const x = ax + bx * t;
      const text = m.following ? (Math.abs(t - origin) < 1e-9 ? "now" : `${decimals(t - origin, digits)} s`) : clock(t, digits);
      const half = c.measureText(text).width / 2;
      if (!m.following && x + half > badgeX - 4 && x - half < badgeX + badgeWidth + 4) continue;
      if (x < left - 20 || x > right + 20) continue;
      c.fillText(text, x, y);
    }
    if (m.following || playhead < left - 1 || playhead > right + 1) return;
    c.strokeStyle = col.text;
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(Math.round(playhead) + 0.5, 0);
    c.lineTo(Math.round(playhead) + 0.5, bottom + 6);
    c.stroke();
    c.fillStyle = col.text;
    c.beginPath();
    if (typeof c.roundRect === "function") c.roundRect(badgeX, bottom + 4, badgeWidth, 21, 5);
    else c.rect(badgeX, bottom + 4, badgeWidth, 21);
    c.fill();
    c.fillStyle = col.surface;
    c.font = FONT_BOLD;
    c.fillText(badge, badgeX + badgeWidth / 2, y);
  }

  private drawValues(now: number): void {
    const m = this.model;
    const moving = m.playing || m.following;
    if (moving && now < this.valuesDue) return;
    // At the end of a session the force of the last row is replaced by what is known of the present one.
    const key = `${m.shown} ${m.shownRowTime} ${m.stepped} ${m.atEnd} ${m.status?.zero_force}`;
    if (key !== this.valuesKey) {
      this.valuesKey = key;
      this.valuesDue = now + VALUES_EVERY;
      for (const lane of this.lanes) {
        const digits = m.stepped && lane.unit === "mm" ? 3 : lane.digits;
        const value = m.value(lane.kind.column);
        const text = decimals(value * lane.factor, digits);
        if (lane.value.data !== text) lane.value.data = text;
        const beside = lane.kind.reference ?? lane.kind.limit;
        if (beside !== undefined && m.has(beside)) {
          const b = m.value(beside);
          setText(lane.second, Number.isFinite(b) ? `${lane.kind.second} ${decimals(b * lane.factor, digits)}` : "");
        }
        if (lane.kind.limit !== undefined) setClass(lane.row, "outside", value > m.value(lane.kind.limit));
      }
    }
    if (now >= this.summaryDue) {
      this.summaryDue = now + 1000;
      setText(this.summary, this.describe());
    }
  }

  // The lanes in words, for those who do not see them.
  describe(): string {
    const m = this.model;
    const parts = this.lanes.map((l) => {
      const value = m.value(l.kind.column);
      return `${l.kind.label} ${Number.isFinite(value) ? `${decimals(value * l.factor, l.digits)} ${l.unit}` : "not measured"}`;
    });
    return `At ${clock(m.shown, 1)}: ${parts.join(", ")}.`;
  }

  private listen(): void {
    const plot = this.plot;
    const m = this.model;
    const pointers = new Map<number, number>();
    let from = NaN;
    let mode: "" | "seek" | "loop" = "";
    let resume = false;
    let pinch = NaN;
    plot.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      pointers.set(event.pointerId, event.clientX);
      if (pointers.size === 2) {
        const [a, b] = [...pointers.values()];
        pinch = Math.abs(a! - b!);
        mode = "";
        return;
      }
      plot.setPointerCapture(event.pointerId);
      from = this.timeAt(event.clientX);
      mode = event.shiftKey ? "loop" : "seek";
      resume = m.playing && !m.following;
      if (mode === "seek") {
        m.playing = false;
        m.seek(from);
      }
    });
    plot.addEventListener("pointermove", (event) => {
      if (!pointers.has(event.pointerId)) return;
      pointers.set(event.pointerId, event.clientX);
      if (pointers.size === 2) {
        const [a, b] = [...pointers.values()];
        const distance = Math.max(10, Math.abs(a! - b!));
        if (Number.isFinite(pinch)) this.setSpan((this.span * pinch) / distance);
        pinch = distance;
        return;
      }
      const t = this.timeAt(event.clientX);
      if (mode === "seek") m.seek(t);
      if (mode === "loop" && Math.abs(t - from) > m.period) m.setLoop({ t0: Math.min(t, from), t1: Math.max(t, from) });
    });
    const end = (event: PointerEvent): void => {
      if (!pointers.delete(event.pointerId)) return;
      if (mode === "seek" && resume) m.play();
      mode = "";
      pinch = NaN;
    };
    plot.addEventListener("pointerup", end);
    plot.addEventListener("pointercancel", end);
    plot.addEventListener(
      "wheel",
      (event) => {
        // In a narrow window the wheel scrolls the page.
        if (this.narrow.matches && !event.ctrlKey) return;
        event.preventDefault();
        this.setSpan(this.span * 1.0015 ** (event.deltaMode === 1 ? event.deltaY * 16 : event.deltaY), m.following ? m.shown : this.timeAt(event.clientX));
      },
      { passive: false },
    );
  }
}
