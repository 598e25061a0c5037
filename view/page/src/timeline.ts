// The timeline: the whole session at a glance, with repetitions, phases, peaks, marks, the lanes' window and the loop.
import { FrameBins, rangeOf } from "./bins";
import type { Client } from "./client";
import { el, setAttribute } from "./dom";
import { clock } from "./format";
import { FONT, FONT_BOLD, readColours, Surface, type Colours } from "./graphics";
import { ASK_AGAIN, type Lanes } from "./lanes";
import { Latest } from "./latest";
import type { Model } from "./model";
import { FLAG_COARSE, type BinsFrame, type EventEntry } from "./protocol";
import { edgeScroll, timeStep, within, zoomAbout, type Span } from "./scale";

const LABELS = 17; // height of the repetitions' names [px]
const TICKS = 17; // height of the times [px]
const BAR = 3; // width of a peak's bar [px]
const EDGE = 24; // [px]: dragging here scrolls
const LIVE_EVERY = 2; // [s]: a live overview is asked for this often
const LEAST_VIEW = 1; // [s]

interface Question {
  t0: number;
  t1: number;
  pixels: number;
  generation: number;
}

// Returns whether an event is a mark of a person, or a finding that a person should see.
export function isMark(event: EventEntry): boolean {
  return /mark|note|tuned/i.test(event.name);
}

export function isFlag(event: EventEntry): boolean {
  return isMark(event) || event.severity === "warning" || event.severity === "problem";
}

// Draws marks and warnings differently in form and colour. Returns the events that the timeline shows.
export function flagsOf(events: readonly EventEntry[]): EventEntry[] {
  return events.filter(isFlag);
}

export class Timeline {
  readonly root: HTMLElement;
  private readonly model: Model;
  private readonly lanes: Lanes | null;
  private readonly surface: Surface;
  private colours: Colours = readColours();
  // The stretch shown; null: all of the session.
  private zoomed: Span | null = null;
  private stored: FrameBins | null = null;
  private storedSpan: Span = { t0: 0, t1: 0 };
  private storedPixels = 0;
  private storedAt = 0;
  private coarse = false;
  private generation = 0;
  private readonly requests: Latest<Question, BinsFrame>;
  private names: string[] = [];
  private most = 0;
  private height: string | undefined;
  private key = "";
  private version = 0;
  private asked = -Infinity;
  private ariaDue = 0;
  private drag: { mode: "seek" | "loop"; from: number; resume: boolean; x: number } | null = null;
  private lastDraw = 0;

  constructor(host: HTMLElement, model: Model, client: Client, lanes: Lanes | null, software: boolean) {
    this.model = model;
    this.lanes = lanes;
    this.root = el("div", { class: "timeline", role: "slider", tabindex: 0, "aria-label": "Timeline", "aria-orientation": "horizontal" });
    host.append(this.root);
    this.surface = new Surface(this.root, software, () => (this.key = ""));
    this.requests = new Latest(
      (q) => client.requestBins(q.t0, q.t1, q.pixels, this.names),
      (q, frame) => {
        if (q.generation !== this.generation) return;
        this.coarse = (frame.header.flags & FLAG_COARSE) !== 0;
        this.storedAt = performance.now();
        this.stored = new FrameBins(frame, this.names);
        this.storedSpan = { t0: q.t0, t1: q.t1 };
        this.storedPixels = q.pixels;
        this.key = "";
      },
    );
    model.on("recording", () => this.takeRecording());
    model.on("theme", () => {
      this.colours = readColours();
      this.key = "";
    });
    for (const event of ["events", "phases", "play"] as const) model.on(event, () => this.version++);
    this.listen();
    if (model.recording !== null) this.takeRecording();
  }

  useSoftware(): void {
    this.surface.useSoftware();
  }

  // The stretch of time that the timeline shows.
  get view(): Span {
    const m = this.model;
    const all = { t0: m.start, t1: Math.max(m.end, m.start + (m.live ? 30 : 0.001)) };
    return this.zoomed === null ? all : within(this.zoomed, all.t0, all.t1);
  }

  zoom(factor: number, about = this.model.shown): void {
    const m = this.model;
    const all = Math.max(LEAST_VIEW, m.end - m.start);
    const next = within(zoomAbout(this.view, about, factor, Math.min(all, LEAST_VIEW), all), m.start, m.end);
    this.zoomed = next.t1 - next.t0 >= (m.end - m.start) * 0.999 ? null : next;
    this.key = "";
  }

  timeAt(clientX: number): number {
    const box = this.root.getBoundingClientRect();
    const view = this.view;
    return view.t0 + ((clientX - box.left) / Math.max(1, box.width)) * (view.t1 - view.t0);
  }

  draw(now: number): boolean {
    const m = this.model;
    if (m.recording === null || this.surface.width < 20) return false;
    const passed = Math.min(0.1, (now - this.lastDraw) / 1000);
    this.lastDraw = now;
    this.scrollAtEdge(passed);
    this.keepInView();
    this.fetch(now / 1000);
    const view = this.view;
    const w = this.lanes?.visible === true ? this.lanes.window : undefined;
    // A live timeline moves by less than a pixel a frame: it is drawn when a quarter of one has passed.
    const pixel = (view.t1 - view.t0) / this.surface.width / 4;
    const q = (t: number): number => Math.round(t / pixel);
    const key = `${q(m.shown)} ${q(w?.t0 ?? 0)} ${q(w?.t1 ?? 0)} ${q(view.t0)} ${q(view.t1)} ${this.version}`;
    if (now >= this.ariaDue) {
      this.ariaDue = now + 250;
      setAttribute(this.root, "aria-valuemin", m.start.toFixed(3));
      setAttribute(this.root, "aria-valuemax", m.end.toFixed(3));
      setAttribute(this.root, "aria-valuenow", m.shown.toFixed(3));
      const rep = m.repetitionAt(m.shown);
      setAttribute(this.root, "aria-valuetext", `${clock(m.shown, 1)} of ${clock(m.end, 1)}${rep !== null ? `, repetition ${rep.number}` : ""}`);
    }
    if (key === this.key) return false;
    this.key = key;
    this.paint(view);
    return true;
  }

  private takeRecording(): void {
    const m = this.model;
    this.generation++;
    this.stored = null;
    this.zoomed = null;
    this.most = 0;
    this.asked = -Infinity;
    this.names = ["deviation", "force", "speed", "radius"].filter((n) => m.has(n));
    this.key = "";
  }

  private fetch(now: number): void {
    const m = this.model;
    if (!m.connected || this.names.length === 0 || !(m.end > m.start)) return;
    const view = this.view;
    const pixels = Math.max(64, Math.ceil(this.surface.width / BAR));
    const again = this.coarse && 1000 * now - this.storedAt > ASK_AGAIN;
    const same = this.stored !== null && !again && Math.abs(this.storedSpan.t0 - view.t0) < 1e-6 && this.storedPixels === pixels;
    const done = same && (m.live ? now - this.asked < LIVE_EVERY : Math.abs(this.storedSpan.t1 - view.t1) < 1e-6);
    if (done) return;
    const asked = this.requests.outstanding;
    if (asked !== null && (m.live ? now - this.asked < LIVE_EVERY : asked.t0 === view.t0 && asked.t1 === view.t1 && asked.generation === this.generation)) return;
    // A view that grows each frame would ask each frame.
    if (m.live && this.zoomed === null && now - this.asked < LIVE_EVERY) return;
    this.asked = now;
    this.requests.request({ t0: view.t0, t1: Math.min(view.t1, m.end), pixels, generation: this.generation });
  }

  // A zoomed timeline scrolls with the shown time while it plays.
  private keepInView(): void {
    const z = this.zoomed;
    const m = this.model;
    if (z === null || this.drag !== null || !(m.playing || m.following)) return;
    const span = z.t1 - z.t0;
    if (m.shown > z.t0 && m.shown < z.t0 + 0.9 * span) return;
    const t0 = m.shown - (m.following ? 0.9 : 0.1) * span;
    this.zoomed = within({ t0, t1: t0 + span }, m.start, m.end);
  }

  private scrollAtEdge(passed: number): void {
    const d = this.drag;
    const z = this.zoomed;
    if (d === null || z === null) return;
    const box = this.root.getBoundingClientRect();
    const speed = edgeScroll(d.x - box.left, box.width, EDGE);
    if (speed === 0) return;
    const shift = speed * passed * (z.t1 - z.t0);
    this.zoomed = within({ t0: z.t0 + shift, t1: z.t1 + shift }, this.model.start, this.model.end);
    this.dragTo(d.x);
  }

  private paint(view: Span): void {
    const c = this.surface.begin();
    const col = this.colours;
    const m = this.model;
    const width = this.surface.width;
    const height = this.surface.height;
    const top = LABELS;
    const bottom = height - TICKS;
    const bx = width / (view.t1 - view.t0);
    const xOf = (t: number): number => (t - view.t0) * bx;
    c.font = FONT;
    c.textBaseline = "middle";

    c.fillStyle = col.grid;
    c.fillRect(0, top, width, bottom - top);

    for (const [t0, t1, name] of m.phases) {
      const x0 = xOf(t0);
      const x1 = xOf(t1);
      if (x1 < 0 || x0 > width) continue;
      const w = Math.max(1, x1 - x0);
      if (name === "run") {
        c.fillStyle = col.run;
        c.fillRect(x0, top, w, bottom - top);
        c.fillStyle = col.actual;
        c.fillRect(x0, top, w, 3);
      } else if (name === "approach") {
        c.fillStyle = col.path;
        c.fillRect(x0, top, w, 3);
      } else if (name === "stopped") {
        c.fillStyle = col.stop;
        c.fillRect(x0, top, w, 3);
      }
    }
    this.paintPeaks(c, xOf, top + 5, bottom);
    this.paintNames(c, xOf, width);
    this.paintLoop(c, xOf, top, bottom);
    this.paintTicks(c, view, xOf, width, bottom);
    this.paintFlags(c, xOf, width, top, bottom);

    const w = this.lanes?.visible === true ? this.lanes.window : undefined;
    if (w !== undefined) {
      const x0 = Math.max(1, xOf(Math.max(m.start, w.t0)));
      const x1 = Math.min(width - 1, xOf(Math.min(view.t1, w.t1)));
      if (x1 > 0 && x0 < width) {
        c.strokeStyle = col.text;
        c.lineWidth = 1.5;
        c.beginPath();
        const wide = Math.max(6, x1 - x0);
        if (typeof c.roundRect === "function") c.roundRect(x0, top - 2, wide, bottom - top + 3, 3);
        else c.rect(x0, top - 2, wide, bottom - top + 3);
        c.stroke();
      }
    }
    const x = xOf(m.shown);
    c.fillStyle = col.text;
    c.beginPath();
    c.moveTo(x - 6, top - 7);
    c.lineTo(x + 6, top - 7);
    c.lineTo(x, top + 1);
    c.closePath();
    c.fill();
    c.fillRect(x - 1, top - 3, 2, bottom - top + 4);
  }

  // Bars of the largest deviation, force or speed; where it left the tunnel, in the colour of what is outside.
  private paintPeaks(c: CanvasRenderingContext2D, xOf: (t: number) => number, top: number, bottom: number): void {
    const s = this.stored;
    if (s === null) return;
    // The first of these that is not always zero: the deviation, else the force, else the speed.
    const name = this.names.find((n) => n !== "radius" && (rangeOf(s, s.channel(n)!, s.k0, s.k1)?.[1] ?? 0) > 0);
    const channel = name === undefined ? null : s.channel(name);
    if (channel === null) return;
    if (name !== this.height) this.most = 0;
    this.height = name;
    const radius = name === "deviation" ? s.channel("radius") : null;
    for (let i = 0; i < s.k1 - s.k0; i++) if (channel.max[i]! > this.most) this.most = channel.max[i]!;
    if (!(this.most > 0)) return;
    const inside: number[] = [];
    const outside: number[] = [];
    for (let k = s.k0; k < s.k1; k++) {
      const i = k - s.base;
      const value = channel.max[i]!;
      if (value !== value) continue;
      (radius !== null && value > radius.min[i]! ? outside : inside).push(k, value);
    }
    const bar = Math.max(1, xOf(s.width) - xOf(0));
    const scale = (bottom - top) / this.most;
    for (const [list, colour] of [[inside, this.colours.actual], [outside, this.colours.stop]] as const) {
      c.fillStyle = colour;
      c.globalAlpha = colour === this.colours.stop ? 1 : 0.65;
      for (let n = 0; n < list.length; n += 2) {
        const h = list[n + 1]! * scale;
        c.fillRect(xOf(list[n]! * s.width), bottom - h, Math.max(1, bar - (bar > 2.5 ? 1 : 0)), h);
      }
      c.globalAlpha = 1;
    }
  }

  private paintNames(c: CanvasRenderingContext2D, xOf: (t: number) => number, width: number): void {
    const m = this.model;
    c.font = FONT_BOLD;
    c.fillStyle = this.colours.second;
    c.textAlign = "left";
    let free = -Infinity;
    for (const r of m.repetitions) {
      const x = xOf(r.t0);
      if (x < -60 || x > width || x < free) continue;
      const room = xOf(r.t1) - x;
      const long = `Rep ${r.number}`;
      const text = c.measureText(long).width < room - 4 ? long : String(r.number);
      const at = Math.max(2, x + 3);
      const wide = c.measureText(text).width;
      if (at + wide > width) continue;
      c.fillText(text, at, LABELS / 2 - 1);
      free = at + wide + 10;
    }
  }

  private paintLoop(c: CanvasRenderingContext2D, xOf: (t: number) => number, top: number, bottom: number): void {
    const loop = this.model.loop;
    if (loop === null) return;
    const x0 = xOf(loop.t0);
    const x1 = xOf(loop.t1);
    c.fillStyle = this.colours.text;
    c.globalAlpha = this.model.loopOn ? 0.18 : 0.07;
    c.fillRect(x0, top, x1 - x0, bottom - top);
    c.globalAlpha = this.model.loopOn ? 1 : 0.5;
    // Brackets at both ends: the form says loop without the colour.
    for (const [x, side] of [[x0, 1], [x1, -1]] as const) {
      c.fillRect(side > 0 ? x : x - 2, top, 2, bottom - top);
      c.fillRect(side > 0 ? x : x - 7, top, 7, 2);
      c.fillRect(side > 0 ? x : x - 7, bottom - 2, 7, 2);
    }
    c.globalAlpha = 1;
  }

  private paintTicks(c: CanvasRenderingContext2D, view: Span, xOf: (t: number) => number, width: number, bottom: number): void {
    c.font = FONT;
    c.textAlign = "center";
    c.fillStyle = this.colours.second;
    const m = this.model;
    const origin = m.following ? m.shown : 0;
    const step = timeStep(view.t1 - view.t0, Math.max(2, Math.floor(width / 110)));
    const digits = step >= 1 ? 0 : step >= 0.1 ? 1 : step >= 0.01 ? 2 : 3;
    for (let k = Math.ceil((view.t0 - origin) / step); k * step + origin <= view.t1; k++) {
      const t = k * step;
      const text = m.following && t === 0 ? "now" : clock(t, digits);
      const x = xOf(t + origin);
      const half = c.measureText(text).width / 2;
      const at = Math.min(width - half - 1, Math.max(half + 1, x));
      if (Math.abs(at - x) > half) continue;
      c.fillText(text, at, bottom + TICKS / 2 + 1);
    }
  }

  private paintFlags(c: CanvasRenderingContext2D, xOf: (t: number) => number, width: number, top: number, bottom: number): void {
    for (const event of flagsOf(this.model.events)) {
      const x = xOf(event.time);
      if (x < -2 || x > width + 2) continue;
      const bad = event.severity === "warning" || event.severity === "problem";
      c.fillStyle = bad ? this.colours.stop : this.colours.text;
      c.fillRect(x - 0.75, top - 14, 1.5, bottom - top + 14);
      c.beginPath();
      if (bad) {
        // A triangle that stands: a warning. A flag: a mark.
        c.moveTo(x + 1, top - 5);
        c.lineTo(x + 6, top - 15);
        c.lineTo(x + 11, top - 5);
      } else {
        c.moveTo(x, top - 15);
        c.lineTo(x + 9, top - 11);
        c.lineTo(x, top - 7);
      }
      c.closePath();
      c.fill();
    }
  }

  // --- pointer ----------------------------------------------------------------------------------------------------------

  private dragTo(clientX: number): void {
    const d = this.drag;
    if (d === null) return;
    d.x = clientX;
    const t = Math.min(this.model.end, Math.max(this.model.start, this.timeAt(clientX)));
    if (d.mode === "seek") this.model.seek(t);
    else if (Math.abs(t - d.from) > this.model.period) this.model.setLoop({ t0: Math.min(t, d.from), t1: Math.max(t, d.from) });
  }

  private listen(): void {
    const root = this.root;
    const m = this.model;
    root.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !event.isPrimary) return;
      root.setPointerCapture(event.pointerId);
      const from = this.timeAt(event.clientX);
      this.drag = { mode: event.shiftKey ? "loop" : "seek", from, resume: m.playing && !m.following, x: event.clientX };
      if (this.drag.mode === "seek") {
        // Playback holds while a person drags.
        m.playing = false;
        m.seek(from);
      }
      event.preventDefault();
    });
    root.addEventListener("pointermove", (event) => {
      if (this.drag !== null) {
        if (event.isPrimary) this.dragTo(event.clientX);
        return;
      }
      this.tip(event);
    });
    const end = (event: PointerEvent): void => {
      const d = this.drag;
      if (d === null || !event.isPrimary) return;
      this.drag = null;
      if (d.mode === "seek" && d.resume) m.play();
    };
    root.addEventListener("pointerup", end);
    root.addEventListener("pointercancel", end);
    root.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        const delta = event.deltaMode === 1 ? event.deltaY * 16 : event.deltaY;
        this.zoom(1.0015 ** delta, this.timeAt(event.clientX));
      },
      { passive: false },
    );
  }

  // Says what is under the pointer: the nearest flag's text, or the time.
  private tip(event: PointerEvent): void {
    const view = this.view;
    const near = ((view.t1 - view.t0) / Math.max(1, this.surface.width)) * 10;
    const t = this.timeAt(event.clientX);
    let best: EventEntry | null = null;
    for (const e of flagsOf(this.model.events)) if (Math.abs(e.time - t) < near && (best === null || Math.abs(e.time - t) < Math.abs(best.time - t))) best = e;
    const text = best === null ? clock(t, 1) : `${clock(best.time, 1)} ${best.text || best.name}`;
    setAttribute(this.root, "title", text);
  }
}
