// The page: its three screens, the header, figures, Stop, transport, warnings, and the loop that draws.
import { Client } from "./client";
import { askText, openValues, toggleHelp } from "./dialogs";
import { button, el, icon, returnFocus, setAttribute, setClass, setHidden, setIcon, setStopIdle, setText, type Icon } from "./dom";
import { clock, decimals, lagWord, phaseWord, recordingWord, UNKNOWN } from "./format";
import { findRenderer } from "./graphics";
import { listenToKeys, loopRepetition, seekRepetition } from "./keys";
import { Lanes, NARROW } from "./lanes";
import { Pace, SLOW, SLOW_SOFTWARE } from "./pace";
import { SPEEDS, type Model } from "./model";
import type { Role } from "./protocol";
import { toggleFullScreen, watchFullScreen } from "./fullscreen";
import { createScene, type ColourMode, type SceneView } from "./scene/scene";
import { createSection } from "./section";
import { createSteering, type Steering } from "./steer";
import { Controls, createProgramme, Trend } from "./therapist";
import { Timeline } from "./timeline";
import { createTrainee, type Trainee } from "./trainee";
import { pauseState } from "./training";

const THEME_KEY = "haptrace-theme";
const COLOURS: { mode: ColourMode; text: string }[] = [
  { mode: "one", text: "one" },
  { mode: "deviation", text: "deviation" },
  { mode: "speed", text: "speed" },
  { mode: "force", text: "force" },
];
// Without an answer for this long after Stop, the page says so [ms].
const STOP_PATIENCE = 1000;
const SOFTWARE = "Drawn without a graphics processor: at most 30 frames a second, no smooth edges.";
const FLAT = "This computer draws slowly, so the scene is drawn flat. Load the page again to try the full picture.";
const THINNED = "The session no longer keeps the samples of this moment. The charts show their least and largest values.";
const STATUS_STALE = 1500; // [ms]
// Texts of marks: as the session keeps them, and in this browser [bytes].
const LONGEST_NOTE = 120;
const LONGEST_OWN_MARK = 200;

export class Shell {
  readonly model: Model;
  readonly client: Client;
  scene: SceneView | null = null;
  lanes: Lanes | null = null;
  timeline: Timeline | null = null;
  // Script time of the last frames [ms], newest last.
  readonly times: number[] = [];
  frames = 0;
  software: boolean;
  private readonly app: HTMLElement;
  private role: Role | null = null;
  private built = "";
  private trend: Trend | null = null;
  private controls: Controls | null = null;
  private steering: Steering | null = null;
  private trainee: Trainee | null = null;
  private endListening: () => void = () => undefined;
  private drawers: ((now: number) => void)[] = [];
  private colour = 0;
  private colourSelect: HTMLSelectElement | null = null;
  private readonly banners = new Map<string, HTMLElement>();
  private readonly bannerHost = el("div", { class: "banners" });
  // Draws the scene on a 2-D canvas: frames of WebGL came too slowly.
  flat = false;
  private readonly pace = new Pace();
  private lastDrawn = -Infinity;
  private stopSent = NaN;
  private readonly renderer: string;

  constructor(app: HTMLElement, model: Model, client: Client) {
    this.app = app;
    this.model = model;
    this.client = client;
    const found = findRenderer();
    this.software = found.software;
    this.pace.most = found.software ? SLOW_SOFTWARE : SLOW;
    this.renderer = found.name;
    this.applyTheme();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.applyTheme());
    model.on("hello", () => this.build());
    model.on("recording", () => {
      this.build();
      this.showTitle();
      this.loadMarks();
      // The end of the last repetition is no news any more.
      if (model.hello?.live === true && model.status === null) this.banner("stop", "note", "");
    });
    model.on("programme", () => this.build());
    model.on("connection", () => this.showConnection());
    model.on("status", () => this.showStop());
    model.on("warning", () => this.showWarnings());
    document.addEventListener("visibilitychange", () => this.showVisibility());
    // In full screen the browser takes the Esc that stops a session.
    watchFullScreen(() => {
      if (model.live) this.stop();
    });
    listenToKeys(model, {
      stop: () => this.stop(),
      mark: (withText) => void this.mark(withText),
      axisView: (axis) => this.scene?.axisView(axis),
      fit: () => this.scene?.fit(),
      colour: () => this.setColour((this.colour + 1) % COLOURS.length),
      fullScreen: () => toggleFullScreen(),
      theme: () => this.toggleTheme(),
      help: () => toggleHelp(model.hello?.live === true),
      command: (line) => void this.command(line),
      say: (text) => this.note(text),
      get control() {
        return model.hello?.control === true && model.hello.role === "therapist";
      },
    });
    this.notice("Connecting", "The page is connecting to haptrace.");
    const frame = (now: number): void => {
      requestAnimationFrame(frame);
      this.draw(now);
    };
    requestAnimationFrame(frame);
  }

  // --- screens ----------------------------------------------------------------------------------------------------------

  private notice(title: string, text: string): void {
    this.app.replaceChildren(el("main", { class: "centre-note" }, el("h1", {}, title), el("p", {}, text)));
  }

  // Builds the screen of the role once; again only if a programme begins or ends.
  private build(): void {
    const m = this.model;
    if (m.hello === null || m.recording === null) {
      if (m.hello !== null && this.built === "") this.notice("Waiting", "The session has not begun yet.");
      return;
    }
    const kind = `${m.hello.role} ${m.programme !== null} ${m.hello.live} ${m.hello.control}`;
    if (kind === this.built) return;
    this.built = kind;
    this.role = m.hello.role;
    this.scene?.dispose();
    this.trainee?.dispose();
    this.steering?.dispose();
    this.drawers = [];
    this.scene = this.lanes = this.timeline = this.trend = this.controls = null;
    this.steering = this.trainee = null;
    this.endListening();
    const { control } = m.hello;
    this.endListening = m.collect(() => {
      if (this.role === "trainee") this.buildTrainee();
      else if (this.role === "therapist" && (m.programme !== null || control)) this.buildTherapist();
      else this.buildView();
    });
    this.client.want(this.role === "trainee" ? "state" : "samples");
    this.showTitle();
    this.showConnection();
    this.showWarnings();
    this.showSoftware();
    this.showStop();
    m.emit("theme");
  }

  private buildScene(host: HTMLElement, training: boolean): SceneView {
    const panel = el("div", { class: "scene-host" });
    host.append(panel);
    const scene = createScene(panel, this.model, { software: this.software, flat: this.flat, training });
    this.scene = scene;
    if (this.model.hello?.steer === true) this.steering = createSteering(scene, this.model, this.client);
    return scene;
  }

  private buildTrainee(): void {
    const root = el("main", { class: "training-page" });
    const panel = el("div", { class: "scene-panel" });
    root.append(panel);
    this.app.replaceChildren(root);
    const scene = this.buildScene(panel, true);
    this.trainee = createTrainee(root, this.model, this.client, scene);
  }

  private buildView(): void {
    const screen = el("div", { class: this.model.hello?.live === true ? "screen view live" : "screen view" });
    const main = el("main", { class: "main" });
    const panel = el("section", { class: "scene-panel", "aria-label": "Scene" });
    main.append(panel);
    screen.append(this.buildHeader(true), this.bannerHost, main);
    this.app.replaceChildren(screen);
    this.buildScene(panel, false);
    this.buildFigures(panel);
    this.lanes = new Lanes(main, this.model, this.client, { software: this.software });
    screen.append(this.buildFooter());
  }

  private buildTherapist(): void {
    const m = this.model;
    const has = m.programme !== null;
    const screen = el("div", { class: has ? "screen therapist" : "screen therapist no-programme" });
    const main = el("main", { class: "main" });
    const panel = el("section", { class: "scene-panel", "aria-label": "Scene" });
    const lower = el("section", { class: "lower" });
    const title = el("h2", {}, "Charts");
    const head = el("div", { class: "lower-head" }, title);
    const trendHost = el("div", { class: "trend" });
    const chartsHost = el("div", { class: "trend" });
    const centre = el("div", { class: "centre" }, panel, lower);
    lower.append(head, trendHost, chartsHost);
    screen.append(this.buildHeader(false), this.bannerHost, main);
    this.app.replaceChildren(screen);
    if (has) {
      const programme = el("nav", { class: "programme", "aria-label": "Programme" });
      main.append(programme);
      createProgramme(programme, m);
    }
    main.append(centre);
    this.buildScene(panel, false);
    this.buildFigures(panel);
    this.lanes = new Lanes(chartsHost, m, this.client, { software: this.software });
    this.lanes.root.classList.add("fill");
    const show = (charts: boolean): void => {
      setHidden(trendHost, charts);
      setHidden(chartsHost, !charts);
      setHidden(head, !has);
      setClass(centre, "charts", charts);
      if (charts) setText(title, "Charts");
      toggle?.setAttribute("aria-pressed", String(charts));
      if (!charts) m.emit("programme");
    };
    let toggle: HTMLButtonElement | null = null;
    if (has) {
      this.trend = new Trend(trendHost, title, m, this.software);
      toggle = button("Charts", { text: "Charts", class: "button" }, () => show(trendHost.hidden === false));
      head.append(toggle);
    }
    const side = el("aside", { class: "side", "aria-label": "Control of the session" });
    this.controls = new Controls(side, m, this.client, { mark: (withText) => void this.mark(withText) });
    side.append(el("div", { class: "side-stop" }, this.stopButton()));
    main.append(side);
    screen.append(this.buildFooter());
    show(!has);
  }

  private buildHeader(withStop: boolean): HTMLElement {
    const m = this.model;
    const live = m.hello?.live === true;
    const title = el("span", { class: "title", id: "title" });
    const liveWord = el("span", {});
    const livePill = el("span", { class: "pill live" }, icon("dot"), liveWord);
    const narrow = matchMedia(NARROW);
    const phaseWordNode = el("span", { role: "status" });
    const phaseIcon = el("span", { class: "pill-icon" });
    const phase = el("span", { class: "pill go" }, phaseIcon, phaseWordNode);
    const facts = el("span", { class: "pill wide" });
    const missed = el("span", { class: "pill wide" });
    const softened = el("span", { class: "pill warning", role: "status", hidden: true });
    const input = el("span", { class: "pill wide" });
    const simple = el("span", { class: "pill wide", hidden: true, title: FLAT }, "Simple graphics");
    const clockPill = el("span", { class: "pill wide" });
    const warnings = el("button", { type: "button", class: "pill warning", title: "Events and warnings" }, icon("triangle"), el("span", {}, ""));
    warnings.addEventListener("click", () => this.openValues());
    returnFocus(warnings);
    const header = el("header", { class: "header" }, el("h1", { class: "unseen", id: "heading" }, "haptrace"), el("span", { class: "brand", "aria-hidden": "true" }, "haptrace"));
    const recordings = m.hello?.recordings ?? [];
    if (recordings.length > 1) {
      const select = el("select", { class: "select", "aria-label": "Recording" });
      recordings.forEach((r, i) => select.append(el("option", { value: i }, `${r.name} (${clock(r.duration, 0)})`)));
      select.addEventListener("change", () => {
        this.client.open(Number(select.value));
        select.blur();
      });
      header.append(select);
      this.drawers.push(() => {
        const index = String(m.recording?.index ?? 0);
        if (select.value !== index && document.activeElement !== select) select.value = index;
      });
    } else {
      header.append(title);
    }
    const pills = el("div", { class: "pills" });
    if (live) pills.append(livePill);
    pills.append(phase, softened, warnings);
    const timed = m.hello?.role === "therapist" && m.programme !== null;
    if (!timed) pills.append(facts, missed, input);
    pills.append(simple);
    header.append(pills, el("span", { class: "space" }));
    if (timed) header.append(clockPill);
    header.append(button("Table of values", { icon: "table", class: "button plain" }, () => this.openValues()));
    header.append(button("Keys and help", { text: "?", class: "button plain" }, () => toggleHelp(live)));
    if (live && withStop) header.append(this.stopButton());

    let phaseShown: Icon | "" = "";
    let due = 0;
    this.drawers.push((now) => {
      if (now < due) return;
      due = now + 100;
      const s = m.status;
      const old = live && (!m.connected || now - m.statusAt > STATUS_STALE);
      if (live) {
        const pause = pauseState(s, m.programme !== null, m.training?.state);
        setText(liveWord, m.over ? "Ended" : old ? "No news" : pause === "paused" ? "Paused" : pause === "pausing" ? "Pauses soon" : m.following ? "Live" : m.playing ? "Replay" : "Frozen");
      }
      const name = live && m.following && s !== null ? s.phase : m.phaseAt(m.shown);
      const rep = m.repetitionAt(m.shown);
      const words = (live && m.following && name === "idle" ? recordingWord(s?.recording) : phaseWord(name)) + (rep !== null && !(live && narrow.matches) ? ` · rep ${rep.number}` : "");
      // The last phase is no present phase after the end, or without news.
      setHidden(phase, name === "" || m.atEnd || old);
      setText(phaseWordNode, words);
      setClass(phase, "go", name === "run");
      const wanted: Icon | "" = name === "run" ? "square" : name === "stopped" ? "stop" : name === "hold" ? "pause" : "dot";
      if (wanted !== phaseShown) {
        phaseShown = wanted;
        phaseIcon.replaceChildren(icon(wanted));
      }
      const r = m.recording;
      const rate = live && s !== null ? s.rate : (r?.rate_hz ?? NaN);
      const virtual = r?.virtual_time === true ? "virtual time · " : "";
      setText(facts, live ? `${virtual}${decimals(rate, 0)} Hz` : `${m.end - m.start < 100 ? `${decimals(m.end - m.start, 1)} s` : clock(m.end - m.start, 0)} · ${decimals(rate, 0)} Hz`);
      // Fewer fresh samples than asked for, and softened forces, are seen without opening a table.
      setClass(facts, "warning", live && s !== null && !s.ended && s.rate < 0.9 * s.asked_rate);
      const soft = live && s !== null && !s.ended && s.share < 0.995;
      setHidden(softened, !soft);
      if (soft) setText(softened, `Forces softened to ${decimals(s.share * 100, 0)} %`);
      setHidden(simple, !this.flat);
      setHidden(missed, s === null);
      setText(missed, `${decimals(s?.overruns ?? NaN, 0)} late`);
      setHidden(input, (r?.input ?? "") === "");
      setText(input, `Input: ${r?.input ?? ""}`);
      const p = m.programme;
      setHidden(clockPill, p === null || p.elapsed_s === null);
      if (p !== null && p.elapsed_s !== null) setText(clockPill, p.limit_s !== null ? `${clock(p.elapsed_s, 0)} of ${decimals(p.limit_s / 60, 0)} min` : clock(p.elapsed_s, 0));
      const bad = m.warnings.filter((w) => w.severity === "warning" || w.severity === "problem");
      setHidden(warnings, bad.length === 0);
      setClass(warnings, "problem", bad.some((w) => w.severity === "problem"));
      setText(warnings.lastElementChild!, String(bad.length));
      setAttribute(warnings, "aria-label", `${bad.length} ${bad.length === 1 ? "warning" : "warnings"}`);
    });
    return header;
  }

  private buildFigures(panel: HTMLElement): void {
    const m = this.model;
    const figure = (column: string, name: string, digits: number, factor: number, unit: string, force: boolean): HTMLElement => {
      const value = document.createTextNode(UNKNOWN);
      const root = el("div", { class: force ? "figure force" : "figure" }, el("span", { class: "figure-value" }, value, el("small", {}, unit)), el("span", { class: "figure-name" }, name));
      let due = 0;
      this.drawers.push((now) => {
        if ((m.playing || m.following) && now < due) return;
        due = now + 66;
        const v = m.value(column);
        const text = decimals(v * factor, m.stepped && unit === "mm" ? 3 : digits);
        if (value.data !== text) value.data = text;
        // The speed stands in for the deviation of a session without a path.
        setHidden(root, !m.has(column) || (column === "speed" && m.has("deviation")));
        if (column === "deviation") setClass(root, "outside", v > m.value("radius"));
      });
      return root;
    };
    const figures = el("div", { class: "figures", role: "group", "aria-label": "Present values" });
    figures.append(figure("deviation", "deviation", 1, 1000, "mm", false));
    figures.append(figure("speed", "speed", 0, 1000, "mm/s", false));
    figures.append(figure("force", "force", 1, 1, "N", true));
    panel.append(figures);
    const canvas = el("canvas", {});
    const section = el("div", { class: "section-panel" }, canvas);
    panel.append(section);
    const disc = createSection(canvas, m, this.scene!);
    this.drawers.push((now) => {
      setHidden(section, !(m.value("radius") > 0));
      disc.draw(now);
    });
  }

  private buildFooter(): HTMLElement {
    const m = this.model;
    const live = m.hello?.live === true;
    const time = el("span", { class: "time" });
    const now = document.createTextNode("");
    const total = el("small", { class: live ? "" : "wide" });
    time.append(now, total);
    const play = button("Play", { icon: "play" }, () => m.toggle());
    const previous = button("Previous repetition", { icon: "previous", class: "button wide" }, () => seekRepetition(m, -1));
    const next = button("Next repetition", { icon: "next", class: "button wide" }, () => seekRepetition(m, 1));
    const edge = button("Go to the live edge", { text: "Go live", class: "button live-edge" }, () => m.goLive());
    const speed = el("select", { class: "select", "aria-label": "Speed" });
    for (const s of SPEEDS) speed.append(el("option", { value: s }, `${s}×`));
    speed.addEventListener("change", () => {
      m.setSpeed(Number(speed.value));
      speed.blur();
    });
    const colour = el("select", { class: "select wide", "aria-label": "Colour of the movement" });
    COLOURS.forEach((c, i) => colour.append(el("option", { value: i }, `Colour: ${c.text}`)));
    colour.addEventListener("change", () => {
      this.setColour(Number(colour.value));
      colour.blur();
    });
    colour.value = String(this.colour);
    this.colourSelect = colour;
    const loop = button("Loop", { icon: "loop", class: "button wide" }, () => {
      if (m.loop === null) loopRepetition(m);
      else m.setLoop(m.loop, !m.loopOn);
    });
    const mark = button("Mark", { icon: "mark", text: "Mark", class: live ? "button narrow-icon" : "button" }, () => void this.mark(false));
    const full = button("Full screen", { icon: "full", class: "button wide" }, () => toggleFullScreen());
    const transport = el("div", { class: "transport", role: "group", "aria-label": "Playback" }, previous, play, next, time);
    if (live) transport.append(edge);
    transport.append(el("span", { class: "space" }), speed, colour, loop, mark, full);
    transport.append(
      button("Table of values", { icon: "table", class: "button narrow-only" }, () => this.openValues()),
      button("Keys and help", { text: "?", class: "button narrow-only" }, () => toggleHelp(live)),
    );
    const narrow = matchMedia(NARROW);
    const footer = el("footer", { class: "footer" }, transport);
    this.timeline = new Timeline(footer, m, this.client, this.lanes, this.software);
    let due = 0;
    this.drawers.push((t) => {
      if (t < due && (m.playing || m.following)) return;
      due = t + 33;
      this.banner("thinned", "note", m.thinned ? THINNED : "");
      const text = clock(m.shown, m.following ? 1 : 3);
      if (now.data !== text) now.data = text;
      setText(total, live ? "" : ` / ${clock(m.end)}`);
      const label = live ? (m.playing ? "Freeze the picture" : "Play the picture") : m.playing ? "Pause" : "Play";
      setIcon(play, m.playing ? "pause" : "play");
      setAttribute(play, "aria-label", label);
      setAttribute(play, "title", label);
      setAttribute(loop, "aria-pressed", String(m.loopOn));
      if (document.activeElement !== speed && Number(speed.value) !== m.speed) speed.value = String(m.speed);
      if (live) {
        const ended = m.status?.ended === true;
        setHidden(edge, ended);
        edge.disabled = m.following;
        setClass(transport, "at-edge", m.following);
        const words = m.following ? "Live" : narrow.matches ? `Go live ${lagWord(m.lag)}` : `Go live · ${lagWord(m.lag)} behind`;
        const span = edge.lastElementChild;
        if (span !== null) setText(span, words);
        setAttribute(edge, "aria-label", m.following ? "Live" : `Go live, ${lagWord(m.lag)} behind`);
      }
    });
    return footer;
  }

  private stopButton(): HTMLButtonElement {
    const word = el("span", {}, "Stop");
    const stop = el("button", { type: "button", class: "stop", "data-stop": true }, icon("stop"), word);
    const show = (): void => setStopIdle(stop, word, this.model.over);
    for (const event of ["status", "recording", "connection"] as const) this.model.on(event, show);
    show();
    stop.addEventListener("pointerdown", (event) => {
      if (event.button === 0) this.stop();
    });
    // From the keyboard or a screen reader a click comes without a press of the pointer.
    stop.addEventListener("click", (event) => {
      if (event.detail === 0) this.stop();
    });
    return stop;
  }

  // --- actions ----------------------------------------------------------------------------------------------------------

  // Asks for zero force. Waits for nothing.
  stop(): void {
    const sent = this.client.stop();
    const now = performance.now();
    this.steering?.release();
    // Nothing runs: there is no end to wait for.
    if (this.model.over) return;
    if (sent) {
      this.stopSent = now;
      this.banner("stop", "problem", "Stop was sent.", true);
    } else {
      this.banner("stop", "problem", "Stop did not reach the session: there is no connection. Stop it in the terminal (Ctrl+C) or switch the device off.", true);
    }
  }

  private async mark(withText: boolean): Promise<void> {
    const m = this.model;
    const time = m.shown;
    const writes = m.live && m.hello?.control === true && m.hello.role === "therapist";
    const title = writes ? "Mark with a text" : "Mark with a text, in this page";
    let text = "";
    let reason = "";
    for (;;) {
      if (withText) {
        const asked = await askText(title, "Text", writes ? LONGEST_NOTE : LONGEST_OWN_MARK, text, reason);
        if (asked === null) return;
        text = asked;
      }
      if (!writes) break;
      const answer = await this.client.command(text === "" ? "mark" : `${m.controls?.actions.includes("note") ? "note" : "mark"} ${text}`);
      const failed = answer.startsWith("error");
      if (this.controls !== null) this.controls.say(answer, "Marked");
      else this.passing(failed ? answer : "Marked");
      // A text that was not taken is not lost: it is asked for again.
      if (!failed || text === "") return;
      reason = answer.replace(/^error:?\s*/, "Not done: ");
    }
    m.addOwnMark(time, text);
    this.saveMarks();
    this.passing(`Marked ${clock(time, 1)} in this browser. The recording does not change.`);
  }

  private openValues(): void {
    openValues(this.model, this.flat ? FLAT : this.software ? SOFTWARE : this.renderer);
  }

  private get marksKey(): string {
    const r = this.model.recording;
    return `haptrace-marks ${r?.session ?? ""} ${r?.name ?? ""}`;
  }

  private saveMarks(): void {
    try {
      localStorage.setItem(this.marksKey, JSON.stringify(this.model.ownMarks.slice(-200).map((e) => [e.time, e.text])));
    } catch {
      // A full or forbidden store: the marks last as long as the page.
    }
  }

  private loadMarks(): void {
    const m = this.model;
    if (m.hello?.live === true || m.ownMarks.length > 0 || (m.recording?.session ?? "") === "") return;
    try {
      const list: unknown = JSON.parse(localStorage.getItem(this.marksKey) ?? "[]");
      if (!Array.isArray(list)) return;
      for (const entry of list) if (Array.isArray(entry) && typeof entry[0] === "number") m.addOwnMark(entry[0], String(entry[1] ?? ""));
    } catch {
      // Marks that cannot be read are no marks.
    }
  }

  private async command(line: string): Promise<void> {
    const answer = await this.client.command(line);
    if (this.controls !== null) this.controls.say(answer, answer.replace(/^ok\s*/, ""));
    else this.passing(answer);
  }

  private note(text: string): void {
    if (this.controls !== null) this.controls.say("", text);
    else this.passing(text);
  }

  private setColour(index: number): void {
    this.colour = index;
    this.scene?.setColour(COLOURS[index]!.mode);
    if (this.colourSelect !== null) this.colourSelect.value = String(index);
  }

  private applyTheme(): void {
    const chosen = localStorage.getItem(THEME_KEY);
    const dark = chosen === null ? matchMedia("(prefers-color-scheme: dark)").matches : chosen === "dark";
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    this.model.emit("theme");
  }

  private toggleTheme(): void {
    const dark = document.documentElement.dataset.theme === "dark";
    localStorage.setItem(THEME_KEY, dark ? "light" : "dark");
    this.applyTheme();
  }

  // --- messages ---------------------------------------------------------------------------------------------------------

  // Shows, changes or (with an empty text) removes a banner.
  private banner(key: string, kind: "note" | "warning" | "problem", text: string, alert = false, close = false): void {
    let node = this.banners.get(key);
    if (text === "") {
      node?.remove();
      this.banners.delete(key);
      return;
    }
    if (node === undefined) {
      node = el("div", { class: "banner", role: alert ? "alert" : "status" }, icon(kind === "problem" ? "stop" : "triangle"), el("span", {}));
      if (close) {
        const mine = node;
        mine.append(
          button("Close this message", { text: "×", class: "button plain" }, () => {
            mine.remove();
            this.banners.delete(key);
          }),
        );
      }
      this.banners.set(key, node);
      this.bannerHost.append(node);
    }
    setClass(node, "problem", kind === "problem");
    setClass(node, "note", kind === "note");
    setText(node.querySelector("span")!, text);
  }

  private passingTimer = 0;
  private softwareSaid = "";

  // Shows a message for a few seconds.
  private passing(text: string, time = 4000): void {
    window.clearTimeout(this.passingTimer);
    this.banner("passing", "note", text);
    this.passingTimer = window.setTimeout(() => this.banner("passing", "note", ""), time);
  }

  private showTitle(): void {
    const r = this.model.recording;
    if (r === null) return;
    const p = this.model.programme;
    const name = [r.subject, p !== null && p.title !== "" ? p.title : r.title || r.name || [r.verb, r.mode].filter((w) => w !== "").join(", ")].filter((w) => w !== "");
    const shown = this.model.hello?.live === true ? name.join(" · ") : r.name || name.join(" · ");
    const node = document.getElementById("title");
    if (node !== null) {
      setText(node, shown);
      setAttribute(node, "title", name.join(" · "));
    }
    const heading = document.getElementById("heading");
    if (heading !== null) setText(heading, `haptrace ${shown}`);
    document.title = shown === "" ? "haptrace" : `${shown} · haptrace`;
  }

  private showConnection(): void {
    const m = this.model;
    if (m.connected) {
      this.banner("connection", "warning", "");
      if (this.client.stopWaits) this.stop();
      this.showVisibility();
      return;
    }
    const refused = m.refused !== "" && m.refused !== "over";
    if (this.built === "") {
      if (refused) this.notice("This address is not valid", "The server refused this page. Open the address that haptrace printed in the terminal.");
      return;
    }
    if (m.refused === "over") {
      const what = m.hello?.live === true ? "The session is over." : "haptrace view has ended.";
      this.banner("connection", "note", `${what} The page keeps what it received.`);
    }
    else if (refused) this.banner("connection", "problem", `The server refused this page: ${m.refused}. Open the address that haptrace printed in the terminal.`, true);
    else if (m.hello?.live === true) this.banner("connection", "warning", "No connection. The page connects again by itself; the figures are not current.", true);
    else this.banner("connection", "warning", "No connection. The page connects again by itself.");
  }

  // Says how a Stop went, in words.
  private showStop(): void {
    const m = this.model;
    const s = m.status;
    if (m.hello?.live !== true || s === null || !s.ended) return;
    const force = s.zero_force === "" ? "" : /confirm/i.test(s.zero_force) ? " Zero force is confirmed." : ` Zero force: ${s.zero_force}.`;
    const reason = s.reason === "" ? "" : `: ${s.reason}`;
    this.stopSent = NaN;
    const usual = s.reason === "" || s.reason === "finished";
    this.banner("stop", usual ? "note" : "problem", `The session ended${reason}.${force}`, !usual);
  }

  private showWarnings(): void {
    const last = [...this.model.warnings].reverse().find((w) => w.severity === "problem" || w.severity === "warning");
    if (last === undefined || this.controls !== null) return;
    const more = this.model.warnings.filter((w) => w.severity === "problem" || w.severity === "warning").length - 1;
    this.banner("warning", last.severity === "problem" ? "problem" : "warning", last.text + (more > 0 ? ` (and ${more} more)` : ""), false, true);
  }

  private showSoftware(): void {
    const words = this.flat ? FLAT : this.software ? SOFTWARE : "";
    if (words === "" || this.role === "trainee" || words === this.softwareSaid) return;
    this.softwareSaid = words;
    this.passing(words, 12000);
  }

  // A hidden tab wants no rows; when it is seen again it wants the newest.
  private showVisibility(): void {
    const wanted = this.role === "trainee" ? "state" : "samples";
    this.client.want(document.visibilityState === "hidden" ? "none" : wanted);
    this.pace.reset();
  }

  // --- drawing ----------------------------------------------------------------------------------------------------------

  // Draws a frame. Without a GPU, only each 33 ms, unless `always`.
  draw(now: number, always = false): void {
    if (this.software && !always && now - this.lastDrawn < 30) return;
    this.lastDrawn = now;
    this.watchSpeed(now);
    const began = performance.now();
    const m = this.model;
    if (Number.isFinite(this.stopSent) && began - this.stopSent > STOP_PATIENCE && m.status?.ended !== true) {
      this.stopSent = NaN;
      this.banner("stop", "problem", "Stop was sent, but the session has not answered. Switch the device off, or stop it in the terminal (Ctrl+C).", true);
    }
    m.tick(began / 1000);
    if (this.built === "") return;
    m.need();
    m.refreshMovement(began / 1000);
    this.steering?.frame(began);
    this.trainee?.draw(began);
    this.scene?.draw(began);
    for (const draw of this.drawers) draw(began);
    this.lanes?.draw(began);
    this.timeline?.draw(began);
    this.trend?.draw();
    this.frames++;
    this.times.push(performance.now() - began);
    if (this.times.length > 4096) this.times.splice(0, 2048);
  }

  // Draws more cheaply where frames come slowly, by their measured times: first charts on the CPU, then the scene too.
  private watchSpeed(now: number): void {
    if (this.flat || document.visibilityState === "hidden" || !(this.model.playing || this.model.following)) {
      this.pace.reset();
      return;
    }
    if (!this.pace.slow(now)) return;
    if (this.software) {
      this.flat = true;
      this.scene?.useFlat();
    } else {
      this.software = true;
      this.pace.most = SLOW_SOFTWARE;
      this.scene?.useSoftware();
      this.lanes?.useSoftware();
      this.timeline?.useSoftware();
      this.trend?.useSoftware();
    }
    this.showSoftware();
  }

  // The input that holds the simulated hand; empty if none does.
  get holding(): string {
    return this.steering?.holding ?? "";
  }

  get rendererName(): string {
    return this.renderer;
  }
}
