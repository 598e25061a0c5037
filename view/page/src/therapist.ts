// The therapist's parts: the programme, the trend of the repetitions, the controls and actions of the session.
import type { Client } from "./client";
import { button, el, icon, returnFocus, setAttribute, setClass, setHidden, setIcon, setText, type Icon } from "./dom";
import { clock, decimals, shownAs } from "./format";
import { FONT, FONT_BOLD, readColours, Surface, type Colours } from "./graphics";
import type { Model } from "./model";
import type { Control, Exercise, TrialResult } from "./protocol";
import { roundStep, ticks } from "./scale";

// --- programme --------------------------------------------------------------------------------------------------------

// Returns the state of an exercise in the list: "skipped" if it is over and no repetition ended by itself.
export function exerciseState(exercise: Exercise, current: boolean): "current" | "done" | "skipped" | "" {
  if (current) return "current";
  if (exercise.done + exercise.skipped < exercise.repetitions) return "";
  return exercise.done > 0 ? "done" : "skipped";
}

// Scrolls `box`, and nothing around it, until `item` is in it.
function keepWithin(box: HTMLElement, item: Element): void {
  const a = box.getBoundingClientRect();
  const b = item.getBoundingClientRect();
  if (box.scrollHeight > box.clientHeight) box.scrollTop += Math.min(0, b.top - a.top) || Math.max(0, b.bottom - a.bottom);
  if (box.scrollWidth > box.clientWidth) box.scrollLeft += Math.min(0, b.left - a.left) || Math.max(0, b.right - a.right);
}

export function createProgramme(host: HTMLElement, model: Model): void {
  let shown = NaN;
  let shownIn = NaN;
  const list = el("ol", { class: "exercises" });
  const title = el("h2", {}, "Programme");
  host.append(title, list);
  const show = (): void => {
    const p = model.programme;
    if (p === null) return;
    setText(title, p.title === "" ? "Programme" : p.title);
    list.replaceChildren(
      ...p.exercises.map((e, i) => {
        const state = exerciseState(e, i === p.current);
        const words = [e.skipped > 0 ? `${e.skipped} skipped` : "", e.mode, e.settings, e.test ? "test" : ""].filter((w) => w !== "").join(" · ");
        const mark: Icon = state === "current" ? "play" : state === "done" ? "tick" : state === "skipped" ? "skip" : "dot";
        const item = el("li", { class: `exercise ${state}`, "aria-current": state === "current" ? "step" : undefined });
        item.append(icon(mark), el("b", {}, e.name), el("span", {}, `${e.done} / ${e.repetitions}`), el("small", {}, words));
        return item;
      }),
    );
    // Only what moves within the programme: the page itself stays where the person has scrolled it.
    const current = list.querySelector(".current");
    if (current === null || (shown === p.current && shownIn === p.exercises.length)) return;
    shown = p.current;
    shownIn = p.exercises.length;
    for (const box of [host, list]) keepWithin(box, current);
  };
  model.on("programme", show);
  show();
}

// --- trend ------------------------------------------------------------------------------------------------------------

// Describes the trend in words, for a screen reader.
export function trendWords(trials: readonly TrialResult[]): string {
  const known = trials.filter((t) => t.rms_m !== null || t.skipped);
  if (known.length === 0) return "No repetition is finished yet.";
  const words = known.map((t) => t.skipped ? `repetition ${t.repetition}: skipped` : `repetition ${t.repetition}: ${decimals(t.rms_m! * 1000, 1)} mm${t.help !== null ? `, help ${decimals(t.help * 100, 0)} %` : ""}${t.partial ? ", not complete" : ""}`);
  return words.join("; ") + ".";
}

export class Trend {
  private readonly model: Model;
  private readonly surface: Surface;
  private readonly title: HTMLElement;
  private readonly words = el("p", { class: "unseen", id: "trend-words" });
  private colours: Colours = readColours();
  private dirty = true;

  constructor(host: HTMLElement, title: HTMLElement, model: Model, software: boolean) {
    this.model = model;
    this.title = title;
    this.surface = new Surface(host, software, () => (this.dirty = true));
    this.surface.canvas.setAttribute("role", "img");
    this.surface.canvas.setAttribute("aria-label", "Deviation of each repetition, with the help given");
    this.surface.canvas.setAttribute("aria-describedby", "trend-words");
    host.append(this.words);
    model.on("programme", () => (this.dirty = true));
    model.on("theme", () => {
      this.colours = readColours();
      this.dirty = true;
    });
  }

  useSoftware(): void {
    this.surface.useSoftware();
  }

  draw(): boolean {
    if (!this.dirty || this.surface.width < 20) return false;
    this.dirty = false;
    const trials = this.model.programme?.trials ?? [];
    const target = [...trials].reverse().find((t) => t.target_m !== null)?.target_m ?? null;
    setText(this.title, `Deviation of each repetition (rms, mm).${target !== null ? ` Target ${decimals(target * 1000, 1)} mm` : ""}`);
    setText(this.words, trendWords(trials));
    this.paint(trials, target);
    return true;
  }

  private paint(all: readonly TrialResult[], target: number | null): void {
    const c = this.surface.begin();
    const col = this.colours;
    const { width, height } = this.surface;
    const left = 48;
    const right = 14;
    const top = 22;
    const bottom = height - 22;
    c.font = FONT;
    c.textBaseline = "middle";
    if (all.length === 0) {
      c.fillStyle = col.second;
      c.textAlign = "left";
      c.fillText("No repetition is finished yet.", left, (top + bottom) / 2);
      return;
    }
    const pitch = 46;
    const room = Math.max(1, Math.floor((width - left - right) / pitch));
    const trials = all.slice(-room);
    const most = Math.max(0.001, target ?? 0, ...trials.map((t) => (t.skipped ? 0 : (t.rms_m ?? 0)))) * 1000;
    const step = roundStep(most / 2);
    const high = Math.ceil((most * 1.02) / step) * step;
    const yOf = (mm: number): number => bottom - (mm / high) * (bottom - top);
    c.strokeStyle = col.grid;
    c.fillStyle = col.second;
    c.lineWidth = 1;
    c.textAlign = "right";
    c.beginPath();
    for (const v of ticks(0, high, 3)) {
      const y = Math.round(yOf(v)) + 0.5;
      c.moveTo(left, y);
      c.lineTo(width - right, y);
      c.fillText(decimals(v, step < 1 ? 1 : 0), left - 8, y);
    }
    c.stroke();
    const xOf = (i: number): number => left + pitch * (i + 0.5);

    // Help below the line: better with more help is no progress.
    c.fillStyle = col.run;
    const half = (bottom - top) * 0.45;
    trials.forEach((t, i) => {
      if (t.help !== null && !t.skipped) c.fillRect(xOf(i) - 15, bottom - half * Math.min(1, Math.max(0, t.help)), 30, half * Math.min(1, Math.max(0, t.help)));
    });
    if (trials.some((t) => t.help !== null)) {
      const x = xOf(trials.length - 1) + 34;
      if (x + 100 < width) {
        c.fillStyle = col.second;
        c.textAlign = "left";
        c.fillText("bars: help given", x, bottom - 10);
      }
    }
    if (target !== null) {
      c.strokeStyle = col.go;
      c.lineWidth = 2;
      c.setLineDash([6, 4]);
      c.beginPath();
      c.moveTo(left, yOf(target * 1000));
      c.lineTo(width - right, yOf(target * 1000));
      c.stroke();
      c.setLineDash([]);
    }
    c.strokeStyle = col.actual;
    c.lineWidth = 1.7;
    c.beginPath();
    let exercise = -1;
    trials.forEach((t, i) => {
      if (t.rms_m === null || t.skipped) return;
      if (t.exercise === exercise) c.lineTo(xOf(i), yOf(t.rms_m * 1000));
      else c.moveTo(xOf(i), yOf(t.rms_m * 1000));
      exercise = t.exercise;
    });
    c.stroke();
    trials.forEach((t, i) => {
      const x = xOf(i);
      c.textAlign = "center";
      c.font = FONT;
      c.fillStyle = col.second;
      c.fillText(String(t.repetition), x, bottom + 12);
      if (t.skipped) {
        c.fillText("skipped", x, bottom - 10);
        return;
      }
      if (t.rms_m === null) return;
      const y = yOf(t.rms_m * 1000);
      c.beginPath();
      c.arc(x, y, 6, 0, 2 * Math.PI);
      c.fillStyle = t.partial ? col.surface : col.actual;
      c.fill();
      c.lineWidth = 2.5;
      c.strokeStyle = col.actual;
      c.stroke();
      c.font = FONT_BOLD;
      c.fillStyle = col.text;
      c.fillText(decimals(t.rms_m * 1000, 1), x, Math.max(8, y - 15));
    });
  }
}

// --- controls ---------------------------------------------------------------------------------------------------------

// The value of a control as it is shown. A control without a unit from 0 to about 1 is a share.
export function controlText(control: Pick<Control, "unit" | "kind" | "least" | "largest" | "step">, value: number): string {
  if (control.kind === "switch") return value >= 0.5 ? "on" : "off";
  if (control.unit === "") return `${decimals(value * 100, 0)} %`;
  const how = shownAs("", control.unit);
  const step = control.step * how.factor;
  const digits = step > 0 ? Math.min(4, Math.max(0, Math.ceil(-Math.log10(step) - 1e-9))) : how.digits;
  return `${decimals(value * how.factor, digits)} ${how.unit}`;
}

// Returns the largest value of a control with the name of that limit: "180 N/m (stability limit of this device)".
export function limitText(control: Control): string {
  const value = controlText(control, control.largest);
  return control.because === "" ? value : `${value} (${control.because})`;
}

// The line that sets a control.
export function controlLine(name: string, value: number): string {
  return `${name} ${Number(value.toPrecision(6))}`;
}

// Returns `value` moved by one step, at a multiple of the step if it was near one, within the range.
// Controls with a ratio are multiplied or divided by it.
export function stepped(control: Pick<Control, "least" | "largest" | "step"> & { ratio?: number }, value: number, direction: 1 | -1): number {
  const ratio = control.ratio ?? 0;
  if (ratio > 1 && value > 0) return Math.min(control.largest, Math.max(control.least, direction > 0 ? value * ratio : value / ratio));
  const step = control.step > 0 ? control.step : (control.largest - control.least) / 20;
  const moved = value + direction * step;
  const snapped = Math.round(moved / step) * step;
  const next = Math.abs(snapped - moved) < step * 0.01 ? snapped : moved;
  return Math.min(control.largest, Math.max(control.least, next));
}

interface Row {
  root: HTMLElement;
  update(control: Control): void;
}

// `long` stands in place of `text` where there is room.
const ACTIONS: { name: string; text: string; icon: Icon; long?: string; about?: string }[] = [
  { name: "repeat", text: "Repeat", icon: "repeat", about: "Repeat: once more after this repetition" },
  { name: "skip", text: "Skip", icon: "skip", long: "Skip: end it now", about: "Skip: end it now, this repetition" },
  { name: "mark", text: "Mark", icon: "mark" },
  { name: "note", text: "Note", icon: "note" },
  { name: "first", text: "First was farther", icon: "tick" },
  { name: "second", text: "Second was farther", icon: "tick" },
];

// Words that follow a press.
const DONE: Record<string, string> = {
  repeat: "Once more after this repetition",
  skip: "This repetition ends now",
  first: "Answer: first",
  second: "Answer: second",
};

export interface PauseWords {
  pause: string;
  paused: string;
  resume: string;
  // What happens at once after a resume, which therefore takes two presses; "" if nothing moves.
  then: string;
  resumed: string;
}

// Returns the words of pause and resume. Only a programme, whose repetition runs, waits for its end.
export function pauseWords(verb: string, runs: boolean): PauseWords {
  const words: PauseWords = { pause: "Pause the session", paused: "The session is paused", resume: "Resume the session", then: "the device will move", resumed: "The session resumes" };
  if (verb === "run" && runs) return { ...words, pause: "Pause after this repetition", paused: "The session pauses after this repetition" };
  if (verb === "play") return { ...words, paused: "Paused: the reference stands still" };
  if (verb === "guide") return { ...words, paused: "Paused: the force fades to zero", then: "the force returns" };
  if (verb === "record") return { pause: "Pause the recording", paused: "Paused: no samples are recorded", resume: "Resume the recording", then: "", resumed: "The recording resumes" };
  return words;
}

const ARMED_FOR = 5000; // [ms]

export interface ControlsHost {
  mark(withText: boolean): void;
}

export class Controls {
  readonly root = el("div", { class: "controls" });
  private readonly model: Model;
  private readonly client: Client;
  private readonly pause: HTMLButtonElement;
  // Its words, and one word where there is little room.
  private readonly pauseLong = el("span", { class: "long" });
  private readonly pauseShort = el("span", { class: "short", "aria-hidden": "true" });
  private readonly actions = new Map<string, HTMLButtonElement>();
  private readonly rows = new Map<string, Row>();
  private readonly list = el("div", { class: "control-list" });
  private readonly undoButton: HTMLButtonElement;
  private readonly messages = el("div", { class: "messages", "aria-live": "polite" });
  private readonly answer = el("p", { class: "message", role: "status", hidden: true });
  private undone: { name: string; label: string; value: number } | null = null;
  private armed = -Infinity;
  private answerTimer = 0;

  constructor(host: HTMLElement, model: Model, client: Client, page: ControlsHost) {
    this.model = model;
    this.client = client;
    this.pause = button("Pause", { icon: "pause", class: "button first" }, () => this.pauseOrResume());
    this.pause.append(this.pauseLong, this.pauseShort);
    const grid = el("div", { class: "actions", role: "group", "aria-label": "Session" }, this.pause);
    for (const a of ACTIONS) {
      const b = button(a.about ?? a.text, { icon: a.icon, text: a.long === undefined ? a.text : undefined }, () => {
        if (a.name === "mark") page.mark(false);
        else if (a.name === "note") page.mark(true);
        else void this.send(a.name, DONE[a.name]);
      });
      if (a.long !== undefined) b.append(el("span", { class: "long" }, a.long), el("span", { class: "short", "aria-hidden": "true" }, a.text));
      this.actions.set(a.name, b);
      grid.append(b);
    }
    this.undoButton = button("Undo the last change", { icon: "repeat", text: "Undo", class: "button undo" }, () => void this.undo());
    this.undoButton.hidden = true;
    grid.append(this.answer);
    this.root.append(grid, this.undoButton, this.list, this.messages);
    host.append(this.root);
    model.on("controls", () => this.show());
    model.on("programme", () => this.showActions());
    model.on("status", () => this.showActions());
    model.on("connection", () => this.showActions());
    model.on("warning", () => this.showWarnings());
    this.show();
    this.showWarnings();
  }

  // Sends a line and shows its answer in words if it is not just "ok".
  async send(line: string, done = ""): Promise<string> {
    const text = await this.client.command(line);
    this.say(text, done);
    return text;
  }

  say(answer: string, done = ""): void {
    window.clearTimeout(this.answerTimer);
    const error = answer.startsWith("error");
    const clamped = /clamped/.test(answer);
    const words = error ? answer.replace(/^error:?\s*/, "Not done: ") : clamped ? answer.replace(/^ok\s*/, "") : done;
    setHidden(this.answer, words === "");
    setText(this.answer, words);
    setClass(this.answer, "problem", error);
    this.answerTimer = window.setTimeout(() => setHidden(this.answer, true), error || clamped ? 10000 : 4000);
  }

  // From the pause to the resume, whether or not a programme waits for the end of its repetition.
  private get paused(): boolean {
    return this.model.controls?.actions.includes("resume") ?? this.model.status?.paused === true;
  }

  private get words(): PauseWords {
    const { controls, recording } = this.model;
    return pauseWords(recording?.verb ?? "", controls?.actions.includes("skip") === true);
  }

  private can(action: string): boolean {
    return this.model.connected && this.model.status?.ended !== true && (this.model.controls?.actions.includes(action) ?? false);
  }

  // Pausing takes one press; going on takes two where the device will move.
  private pauseOrResume(): void {
    const words = this.words;
    if (!this.paused) {
      void this.send("pause", words.paused);
      return;
    }
    if (words.then === "" || performance.now() - this.armed < ARMED_FOR) {
      this.armed = -Infinity;
      void this.send("resume", words.resumed);
    } else {
      this.armed = performance.now();
      this.say("", `Press Resume again: ${words.then}`);
      window.setTimeout(() => this.showActions(), ARMED_FOR + 50);
    }
    this.showActions();
  }

  private showActions(): void {
    const paused = this.paused;
    // A session that ended meanwhile resumes no more.
    if (performance.now() - this.armed < ARMED_FOR && !this.can("resume")) {
      this.armed = -Infinity;
      this.say("");
    }
    const armed = paused && performance.now() - this.armed < ARMED_FOR;
    const words = this.words;
    const text = armed ? `Resume: press again, ${words.then}` : paused ? words.resume : words.pause;
    setText(this.pauseLong, text);
    setText(this.pauseShort, paused ? "Resume" : "Pause");
    setAttribute(this.pause, "aria-label", text);
    setIcon(this.pause, armed ? "triangle" : paused ? "play" : "pause");
    setAttribute(this.pause, "title", text);
    setClass(this.pause, "armed", armed);
    this.pause.disabled = !this.can(paused ? "resume" : "pause");
    setHidden(this.pause, !this.known("pause") && !this.known("resume"));
    for (const [name, b] of this.actions) {
      b.disabled = !this.can(name);
      setHidden(b, !this.known(name));
    }
  }

  // Actions that this session has had at any time: a button that comes and goes is looked for.
  private readonly seen = new Set<string>();
  private known(action: string): boolean {
    for (const a of this.model.controls?.actions ?? []) this.seen.add(a);
    return this.seen.has(action);
  }

  private show(): void {
    const list = this.model.controls?.list ?? [];
    const names = list.map((c) => `${c.name} ${c.kind}`);
    if (names.join() !== [...this.rows.keys()].join()) {
      this.rows.clear();
      for (const c of list) this.rows.set(`${c.name} ${c.kind}`, c.kind === "switch" ? this.switchRow(c) : c.kind === "factor" ? this.factorRow(c) : this.numberRow(c));
      this.list.replaceChildren(...[...this.rows.values()].map((r) => r.root));
    }
    for (const c of list) this.rows.get(`${c.name} ${c.kind}`)?.update(c);
    this.showActions();
  }

  private async set(control: Control, value: number): Promise<void> {
    if (value === control.value) return;
    const before = { name: control.name, label: control.label, value: control.value };
    const text = await this.client.command(controlLine(control.name, value));
    this.say(text);
    if (text.startsWith("error")) {
      this.rows.get(`${control.name} ${control.kind}`)?.update(control);
      return;
    }
    this.undone = before;
    setText(this.undoButton.querySelector("span")!, `Undo: ${before.label} ${controlText(control, before.value)}`);
    setHidden(this.undoButton, false);
  }

  private async undo(): Promise<void> {
    const u = this.undone;
    if (u === null) return;
    this.undone = null;
    setHidden(this.undoButton, true);
    this.say(await this.client.command(controlLine(u.name, u.value)));
  }

  private numberRow(first: Control): Row {
    let control = first;
    let held = false;
    const value = el("span", {});
    const head = el("div", { class: "control-head" }, el("span", {}, first.label), value);
    const slider = el("input", { type: "range", "aria-label": first.label });
    const least = el("span", {});
    const largest = el("span", {});
    const less = button(`Less: ${first.label}`, { text: "−" }, () => void this.set(control, stepped(control, control.value, -1)));
    const more = button(`More: ${first.label}`, { text: "+" }, () => void this.set(control, stepped(control, control.value, 1)));
    const root = el("div", { class: "control", role: "group", "aria-label": first.label }, head, less, slider, more, el("div", { class: "control-range" }, least, largest));
    const say = (v: number): void => {
      setText(value, controlText(control, v));
      setAttribute(slider, "aria-valuetext", controlText(control, v));
    };
    slider.addEventListener("pointerdown", () => (held = true));
    for (const end of ["pointerup", "pointercancel", "blur"]) slider.addEventListener(end, () => (held = false));
    slider.addEventListener("input", () => say(Number(slider.value)));
    // A slider whose control is multiplied has no steps of its own.
    slider.addEventListener("change", () => void this.set(control, control.ratio > 1 ? Number(Number(slider.value).toPrecision(3)) : Number(slider.value)));
    slider.addEventListener("keydown", (event) => {
      const direction = /^Arrow(Right|Up)$/.test(event.key) ? 1 : /^Arrow(Left|Down)$/.test(event.key) ? -1 : 0;
      if (direction === 0 || !(control.ratio > 1)) return;
      event.preventDefault();
      void this.set(control, stepped(control, control.value, direction));
    });
    returnFocus(slider);
    const update = (c: Control): void => {
      control = c;
      slider.min = String(c.least);
      slider.max = String(c.largest);
      slider.step = String(c.step > 0 && !(c.ratio > 1) ? c.step : "any");
      setText(least, controlText(c, c.least));
      setText(largest, limitText(c));
      less.disabled = c.value <= c.least;
      more.disabled = c.value >= c.largest;
      if (held) return;
      slider.value = String(c.value);
      say(c.value);
    };
    return { root, update };
  }

  // A quantity that no single number sets: its values, the reason, and buttons that multiply or divide it.
  private factorRow(first: Control): Row {
    const { name, label, ratio } = first;
    const value = el("span", {});
    const reason = el("span", {});
    const less = button(`Less: ${label}`, { text: "−" }, () => void this.send(`${name} / ${ratio}`));
    const more = button(`More: ${label}`, { text: "+" }, () => void this.send(`${name} * ${ratio}`));
    const root = el("div", { class: "control", role: "group", "aria-label": label }, el("div", { class: "control-head" }, el("span", {}, label)), less, value, more, el("div", { class: "control-range" }, reason));
    return {
      root,
      update: (c) => {
        setText(value, c.text);
        setText(reason, `No single number sets them: ${c.because}. − and + change all of them by ${decimals((ratio - 1) * 100, 0)} %.`);
      },
    };
  }

  private switchRow(first: Control): Row {
    let control = first;
    const box = el("input", { type: "checkbox" });
    const value = el("span", { class: "quiet" });
    const root = el("label", { class: "check" }, box, el("span", {}, first.label), value);
    box.addEventListener("change", () => void this.set(control, box.checked ? 1 : 0));
    returnFocus(box);
    return {
      root,
      update: (c) => {
        control = c;
        box.checked = c.value >= 0.5;
        setText(value, c.because);
      },
    };
  }

  private showWarnings(): void {
    const last = this.model.warnings.filter((w) => w.severity === "warning" || w.severity === "problem").slice(-3);
    this.messages.replaceChildren(
      ...last.map((w) => el("p", { class: w.severity === "problem" ? "message problem" : "message" }, `${w.time !== null ? `${clock(w.time, 0)} ` : ""}${w.text}`)),
    );
  }
}
