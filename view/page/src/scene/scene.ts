// The scene: fills a picture from the model, draws it, and owns the camera, the gizmo, the scale bars and the labels.
import type { Model } from "../model";
import {
  axesOf,
  createCamera,
  fit,
  lookAlong,
  metresPerPixel,
  pan,
  project,
  rayThrough,
  turn,
  zoom,
  type Axes,
  type Camera,
  type Insets,
} from "./camera";
import { createFlatPainter } from "./flat";
import { createGizmo, type Gizmo } from "./gizmo";
import { createGlPainter } from "./gl";
import type { Ray, Triple } from "./nearest";
import { ARROW_SCALE, GAP, UNKNOWN, type ColourMode, type Painter, type Picture } from "./picture";
import { createPolyline, fillPolyline, pointAt, type Polyline } from "./polyline";
import { cividis, cssColour, readTheme, sameTheme } from "./theme";

export type { ColourMode } from "./picture";

/** Length of the trail [s] and least time between two of its points [s]. */
const TRAIL_SECONDS = 0.9;
const TRAIL_STEP = 0.008;
const TRAIL_POINTS = 128;
const PATH_POINTS = 4096;
const MOVEMENT_CAPACITY = 4096;
/** Forces below this draw no arrow [N]: they are below what a hand feels. */
export const LEAST_FORCE = 0.05;
/** Two rows of a movement further apart than this are not joined [s], unless all are as far apart, as bins of hours are. */
const LONGEST_JOIN = 0.25;
const FLOOR_STEP = 0.01;
const NOTICE_TIME = 12000; // [ms]

export interface SceneOptions {
  /** The browser draws without a GPU: no antialiasing, coarser tube. */
  software?: boolean;
  /** Uses the 2-D canvas, as if there were no WebGL. */
  flat?: boolean;
  /** Shows the training screen's scene from the start: see `setTraining`. */
  training?: boolean;
}

/** Parts of the scene that the training screen shows. */
export interface TrainingLook {
  tool: boolean;
  path: boolean;
  tunnel: boolean;
  trail: boolean;
  /** Shows the movement over the path (after a repetition). */
  movement: boolean;
  /** Shows the part of the path that is done. */
  done: boolean;
  /** Colour role of the ring at the start of the path; null: no ring. */
  start: "waiting" | "approach" | "go" | null;
  goal: boolean;
  /** Keeps a person's pointer from turning the camera. */
  hold: boolean;
  /** A person moves now: nothing moves the camera. */
  moving: boolean;
}

export interface SceneView {
  readonly host: HTMLElement;
  /** Receives the pointers. The canvas in it may be replaced by another painter's. */
  readonly target: HTMLElement;
  readonly canvas: HTMLCanvasElement;
  readonly camera: Camera;
  readonly picture: Picture;
  readonly painter: Painter;
  /** Draws if something changed. `now` is performance.now() [ms]. Returns true if it drew. */
  draw(now: number): boolean;
  fit(): void;
  axisView(axis: 0 | 1 | 2, fromOtherSide?: boolean): void;
  resize(): void;
  dispose(): void;
  setColour(mode: ColourMode): void;
  /** Changes to the training screen's scene (no figures, no grid, no gizmo), or back with null. */
  setTraining(look: TrainingLook | null): void;
  /** Is asked first for a press on the scene. If it returns true, the camera leaves that pointer alone. */
  claim: ((event: PointerEvent) => boolean) | null;
  /** Is asked first for the wheel. */
  claimWheel: ((event: WheelEvent) => boolean) | null;
  /** Ray through a place of the window [CSS px], in W. */
  ray(clientX: number, clientY: number): Ray;
  /** Place of a point of W in the window [CSS px]; null behind the eye. */
  place(x: number, y: number, z: number): { x: number; y: number } | null;
  axes(): Axes;
  /** Draws fewer pixels: the browser turned out to draw without a GPU. */
  useSoftware(): void;
  /** Draws on a 2-D canvas from the next frame in which nobody trains: WebGL turned out to be too slow. */
  useFlat(): void;
  /** Asks for a frame: something outside the model changed. */
  invalidate(): void;
}

export function createScene(host: HTMLElement, model: Model, options: SceneOptions = {}): SceneView {
  return new SceneOfModel(host, model, options);
}

class SceneOfModel implements SceneView {
  readonly camera = createCamera();
  readonly picture: Picture;
  painter: Painter;
  claim: ((event: PointerEvent) => boolean) | null = null;
  claimWheel: ((event: WheelEvent) => boolean) | null = null;

  readonly target = element("div", "scene-target");
  private readonly gizmo: Gizmo;
  private readonly label = element("span", "scene-label");
  private readonly bars = element("div", "scene-bars");
  private readonly millimetres = bar("scene-bar");
  private readonly newtons = bar("scene-bar scene-bar-force");
  private readonly legend = element("div", "scene-legend");
  private readonly legendTitle = element("span", "scene-legend-title");
  private readonly legendStrip = element("span", "scene-legend-strip");
  private readonly legendLow = element("span", "scene-legend-end");
  private readonly legendHigh = element("span", "scene-legend-end");
  private readonly notice = element("p", "scene-notice");
  private readonly pointers = new Map<number, { x: number; y: number; pans: boolean }>();
  private readonly abort = new AbortController();
  private readonly observer: ResizeObserver | null;
  private software = false;
  private withoutGl = false;
  private withoutGlSince: number | null = null;
  private dirty = true;
  private touched = false;
  /** The picture shows what it should; false: the next frame fits the camera. */
  private fitted = false;
  private fitDue = false;
  private flatDue = false;
  private box: Box | null = null;
  private training: TrainingLook | null = null;
  private key = "";
  private themeDue = 0;
  private movementVersion = -1;
  private movementMode: ColourMode = "one";
  private legendKey = "";
  private summaryDue = 0;
  private noticeKey = "";
  private readonly spot = [0, 0, 0];
  private objectsFitted = 0;

  constructor(
    readonly host: HTMLElement,
    private readonly model: Model,
    options: SceneOptions,
  ) {
    this.picture = emptyPicture(this.camera, host);
    host.classList.add("scene");
    this.painter = this.createPainter(options);
    this.target.setAttribute("role", "img");
    this.target.setAttribute("aria-label", "The movement in three dimensions");
    this.showCanvas();
    this.gizmo = createGizmo((axis, otherSide) => this.axisView(axis, otherSide));
    this.bars.append(this.newtons.root, this.millimetres.root);
    this.bars.prepend(this.legend);
    this.legend.append(this.legendTitle, this.legendLow, this.legendStrip, this.legendHigh);
    this.legend.hidden = true;
    this.notice.setAttribute("role", "status");
    for (const part of [this.label, this.bars]) part.setAttribute("aria-hidden", "true");
    host.append(this.target, this.label, this.bars, this.gizmo.root, this.notice);
    this.listen(this.target);
    this.observer = typeof ResizeObserver === "undefined" ? null : new ResizeObserver(() => {
      // A canvas of a new size is black until it is drawn on: at once, before the browser shows it.
      this.resize();
      this.draw(performance.now());
    });
    this.observer?.observe(host);
    const stop = [
      model.on("path", () => this.takePath()),
      model.on("recording", () => this.takeRecording()),
      model.on("scene", () => this.takeScene()),
      model.on("theme", () => (this.themeDue = 0)),
    ];
    this.abort.signal.addEventListener("abort", () => stop.forEach((end) => end()));
    this.resize();
    this.takePath();
    this.takeScene();
  }

  get canvas(): HTMLCanvasElement {
    return this.painter.canvas;
  }

  // --- drawing ----------------------------------------------------------------------------------------------------------

  draw(now: number): boolean {
    const p = this.picture;
    if (now >= this.themeDue) {
      this.themeDue = now + 500;
      const theme = readTheme(this.host);
      if (!sameTheme(theme, p.theme)) {
        p.theme = theme;
        this.dirty = true;
        this.legendKey = "";
      }
    }
    // Another look of the scene is a surprise: not while the trainee moves.
    if (this.flatDue && this.training?.moving !== true) this.changePainter();
    const key = [this.model.shown, this.model.dataVersion, this.model.movement?.version ?? 0, this.painter.lost].join();
    if (!this.dirty && key === this.key) return false;
    this.key = key;
    this.dirty = false;
    this.read();
    if (this.fitDue && !this.moving) {
      this.fitDue = false;
      this.fitted = false;
    }
    if (!this.fitted) this.fitOnce();
    this.painter.draw(p);
    this.placeOverlays();
    return true;
  }

  invalidate(): void {
    this.dirty = true;
  }

  private read(): void {
    const p = this.picture;
    const m = this.model;
    const t = this.training;
    triple(p.tool, m.value("x"), m.value("y"), m.value("z"));
    triple(p.reference, m.value("rx"), m.value("ry"), m.value("rz"));
    triple(p.arrow.force, m.value("fx"), m.value("fy"), m.value("fz"));
    const force = Math.hypot(...p.arrow.force);
    const hasReference = Number.isFinite(p.reference[0] + p.reference[1] + p.reference[2]);
    const mode = m.recording?.mode ?? "";
    const deviation = m.value("deviation");
    const radius = m.value("radius");
    p.showTool = t === null || t.tool;
    p.showPath = t === null || t.path;
    p.showTunnel = t === null || t.tunnel;
    p.showTrail = t === null || t.trail;
    p.showMovement = t === null || t.movement;
    // In a tunnel the reference is the nearest place of the path; an expert that moves is something to follow.
    const follows = mode === "cursor" || mode === "track" || mode === "passive" || m.recording?.verb === "play";
    p.showReference = hasReference && (t === null ? follows : mode === "track" || (mode === "cursor" && t.path));
    p.arrow.visible = t === null && force >= LEAST_FORCE;
    p.deviation.visible = t === null && hasReference && deviation > 0;
    p.deviation.outside = deviation > radius;
    p.done = t !== null && t.done ? this.doneLength() : NaN;
    const object = m.value("contact");
    triple(p.proxy.at, m.value("proxy_x"), m.value("proxy_y"), m.value("proxy_z"));
    triple(p.proxy.normal, m.value("normal_x"), m.value("normal_y"), m.value("normal_z"));
    p.touched = Number.isInteger(object) ? object : -1;
    p.proxy.visible = p.touched >= 0 && p.showTool && Number.isFinite(p.proxy.at[0] + p.proxy.at[1] + p.proxy.at[2]);
    // The trainee sees where the surface is, not the vectors of it.
    p.proxy.showNormal = t === null && Number.isFinite(p.proxy.normal[0] + p.proxy.normal[1] + p.proxy.normal[2]);
    p.floor.visible = t === null;
    p.workspace.visible = t === null && m.recording?.device.workspace !== undefined;
    this.readRings();
    if (p.showTrail) this.readTrail();
    if (p.showMovement) this.readMovement();
  }

  /** Length along this page's polyline of what is done: the server's path may have more points than it sent. */
  private doneLength(): number {
    const path = this.model.path;
    const line = this.picture.path;
    if (path === null || line.count < 2) return NaN;
    const theirs = path.length[path.count - 1] ?? NaN;
    const ours = line.length[line.count - 1]!;
    const progress = this.model.value("progress");
    return theirs > 0 ? (progress / theirs) * ours : progress;
  }

  private readRings(): void {
    const p = this.picture;
    const t = this.training;
    const line = p.path;
    p.start.visible = t !== null && t.start !== null && line.count > 0;
    p.goal.visible = t !== null && t.goal && line.count > 1;
    if (t === null || line.count === 0) return;
    pointAt(line, 0, p.start.at);
    pointAt(line, line.length[line.count - 1]!, p.goal.at);
    p.start.colour = t.start === "go" ? p.theme.go : t.start === "approach" ? p.theme.actual : p.theme.path;
    p.goal.colour = p.theme.path;
  }

  private readTrail(): void {
    const m = this.model;
    const trail = this.picture.trail;
    const columns = [m.column("x"), m.column("y"), m.column("z")] as const;
    trail.count = 0;
    if (columns.some((c) => c < 0)) return;
    const shown = m.shown;
    m.eachRow(shown - TRAIL_SECONDS, shown, TRAIL_STEP, (source, row) => {
      const i = trail.count;
      if (i >= trail.age.length) return;
      const x = source.value(columns[0], row);
      const y = source.value(columns[1], row);
      const z = source.value(columns[2], row);
      if (!Number.isFinite(x + y + z)) return;
      trail.xyz[3 * i] = x;
      trail.xyz[3 * i + 1] = y;
      trail.xyz[3 * i + 2] = z;
      trail.age[i] = Math.min(1, (shown - source.timeOf(row)) / TRAIL_SECONDS);
      trail.count = i + 1;
    });
  }

  private readMovement(): void {
    const from = this.model.movement;
    const to = this.picture.movement;
    const colour = this.picture.colour;
    if (from === null) {
      if (to.count > 0) {
        to.count = 0;
        to.version++;
      }
      this.movementVersion = -1;
      return;
    }
    if (from.version === this.movementVersion && colour.mode === this.movementMode) return;
    this.movementVersion = from.version;
    this.movementMode = colour.mode;
    const values = colour.mode === "one" ? null : from[colour.mode];
    const usual = from.count > 1 ? (from.time[from.count - 1]! - from.time[0]!) / (from.count - 1) : 0;
    const longestJoin = Math.max(LONGEST_JOIN, 2.5 * usual);
    let most = 0;
    let n = 0;
    for (let i = 0; i < from.count && n < to.capacity; i++) {
      const x = from.x[i]!;
      const y = from.y[i]!;
      const z = from.z[i]!;
      if (!Number.isFinite(x + y + z)) continue;
      if (n > 0 && from.time[i]! - from.time[i - 1]! > longestJoin) to.value[n - 1] = GAP;
      to.xyz[3 * n] = x;
      to.xyz[3 * n + 1] = y;
      to.xyz[3 * n + 2] = z;
      const value = values === null ? 0 : Math.abs(values[i]!);
      to.value[n] = Number.isFinite(value) ? value : UNKNOWN;
      if (Number.isFinite(value)) most = Math.max(most, value);
      n++;
    }
    to.count = n;
    to.version++;
    // The range is round and only grows, so that a colour keeps its meaning while one watches.
    colour.low = 0;
    if (colour.mode !== "one") colour.high = Math.max(colour.high, round(most));
  }

  // --- camera -----------------------------------------------------------------------------------------------------------

  fit(): void {
    this.touched = false;
    this.fitted = false;
    this.dirty = true;
  }

  axisView(axis: 0 | 1 | 2, fromOtherSide = false): void {
    if (this.held) return;
    lookAlong(this.camera, axis, fromOtherSide);
    fit(this.camera, this.contents(), this.insets());
    this.touched = true;
    this.dirty = true;
  }

  setColour(mode: ColourMode): void {
    if (mode !== this.picture.colour.mode) {
      this.picture.colour.mode = mode;
      this.picture.colour.high = 0;
    }
    this.dirty = true;
  }

  setTraining(look: TrainingLook | null): void {
    const changes = (look === null) !== (this.training === null);
    this.training = look;
    this.host.classList.toggle("scene-training", look !== null);
    if (changes) {
      this.sizeTool();
      this.fit();
    }
    this.dirty = true;
  }

  private get held(): boolean {
    return this.training !== null && this.training.hold;
  }

  private takeRecording(): void {
    if (this.model.hello?.live !== true) {
      this.touched = false;
      this.fitted = false;
    } else if (!this.touched && this.picture.path.count < 2) {
      this.fitted = false;
    }
    this.dirty = true;
  }

  private takePath(): void {
    const path = this.model.path;
    const line = this.picture.path;
    const had = line.count > 1;
    if (path === null) line.count = 0;
    else fillPolyline(path, line);
    this.picture.pathVersion++;
    this.dirty = true;
    if (line.count < 2) return;
    const box = boundsOf(line);
    const elsewhere = !alike(box, this.box);
    this.box = box;
    // A first path is fitted at once. A later one is fitted after the movement, and keeps the camera of a person who
    // turned it, unless the path is somewhere else.
    if (!had) this.fitted = false;
    else if (elsewhere || !this.touched) this.fitDue = true;
  }

  private takeScene(): void {
    this.picture.scene = this.model.scene;
    this.dirty = true;
    // Meshes come one by one: the picture is fitted when one is here that was not.
    const shapes = this.model.scene?.objects.filter((o) => o.shape !== null).length ?? 0;
    const grown = shapes > this.objectsFitted;
    this.objectsFitted = shapes;
    if (grown && !this.touched && this.picture.path.count < 2 && !this.moving) this.fitted = false;
  }

  /** A person moves now: the camera stays, whatever arrives. */
  private get moving(): boolean {
    if (this.training !== null) return this.training.moving;
    return this.model.live && this.model.phaseAt(this.model.shown) === "run";
  }

  /** Box of the objects of a scene, within the workspace if that is known; null without any. */
  private objectsBox(workspace: { min: Triple; max: Triple } | undefined): { min: Triple; max: Triple } | null {
    const shapes = this.model.scene?.objects.flatMap((o) => (o.shape === null ? [] : [o.shape])) ?? [];
    if (shapes.length === 0) return null;
    const side = (k: 0 | 1 | 2): [number, number] => {
      const low = Math.min(...shapes.map((s) => s.min[k]));
      const high = Math.max(...shapes.map((s) => s.max[k]));
      if (workspace === undefined) return [low, high];
      // The tool comes to all of its workspace, and a plane reaches far beyond it.
      return [Math.max(low, workspace.min[k]), Math.min(high, workspace.max[k])];
    };
    const [x, y, z] = [side(0), side(1), side(2)];
    if (x[0] > x[1] || y[0] > y[1] || z[0] > z[1]) return null;
    return { min: [x[0], y[0], z[0]], max: [x[1], y[1], z[1]] };
  }

  /** Spheres (x, y, z, radius) that a fit shows: the path, else the movement, else objects, else the workspace. */
  private contents(): number[] {
    const out: number[] = [];
    const { path, movement } = this.picture;
    if (path.count > 1) {
      const step = Math.max(1, Math.floor(path.count / 300));
      for (let i = 0; i < path.count; i += step) {
        out.push(path.xyz[3 * i]!, path.xyz[3 * i + 1]!, path.xyz[3 * i + 2]!, Math.max(0.003, path.radius[i]! || 0));
      }
      return out;
    }
    const box = this.model.recording?.device.workspace;
    if (movement.count > 1 && this.model.hello?.live !== true) {
      const step = Math.max(1, Math.floor(movement.count / 300));
      for (let i = 0; i < movement.count; i += step) {
        out.push(movement.xyz[3 * i]!, movement.xyz[3 * i + 1]!, movement.xyz[3 * i + 2]!, 0.003);
      }
      return out;
    }
    const objects = this.objectsBox(box);
    const low = objects?.min ?? box?.min ?? [-0.05, -0.05, -0.05];
    const high = objects?.max ?? box?.max ?? [0.05, 0.05, 0.05];
    for (let i = 0; i < 8; i++) {
      out.push(i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2], 0);
    }
    return out;
  }

  private insets(): Insets {
    const { width, height } = this.camera;
    const share = (px: number, of: number): number => Math.min(0.3, px / Math.max(1, of));
    if (this.training !== null) {
      // The lower 27 % belongs to the words in every state, so that the scene never moves.
      return { left: share(32, width), right: share(32, width), top: share(80, height), bottom: 0.27 + share(12, height) };
    }
    const narrow = width < 500;
    return {
      left: share(20, width),
      right: share(narrow ? 20 : 28, width),
      top: share(narrow ? 92 : 84, height),
      bottom: share(narrow ? 70 : 90, height),
    };
  }

  private fitOnce(): void {
    const line = this.picture.path;
    if (this.camera.width < 2) return;
    const turned = createCamera();
    if (!this.touched) {
      this.camera.azimuth = turned.azimuth;
      this.camera.elevation = turned.elevation;
    }
    const contents = this.contents();
    fit(this.camera, contents, this.insets());
    this.placeFloor(contents);
    // A recording without a path is fitted once more when its movement is here.
    const waits = !this.touched && line.count < 2 && this.picture.movement.count < 2 && this.model.hello?.live !== true;
    this.fitted = !waits;
  }

  private placeFloor(contents: number[]): void {
    let [x0, x1, y0, y1, z] = [Infinity, -Infinity, Infinity, -Infinity, Infinity];
    for (let i = 0; i + 3 < contents.length; i += 4) {
      const r = contents[i + 3]!;
      x0 = Math.min(x0, contents[i]! - r);
      x1 = Math.max(x1, contents[i]! + r);
      y0 = Math.min(y0, contents[i + 1]! - r);
      y1 = Math.max(y1, contents[i + 1]! + r);
      z = Math.min(z, contents[i + 2]! - r);
    }
    const f = this.picture.floor;
    const span = Math.max(x1 - x0, y1 - y0, 0.02);
    // A grid of 10 mm; of 100 mm where that would be hundreds of lines.
    f.step = span > 1.5 ? 10 * FLOOR_STEP : FLOOR_STEP;
    const margin = Math.max(2 * f.step, 0.35 * span);
    const down = (value: number): number => Math.floor(value / f.step) * f.step;
    f.x0 = down(x0 - margin);
    f.x1 = down(x1 + margin) + f.step;
    f.y0 = down(y0 - margin);
    f.y1 = down(y1 + margin) + f.step;
    f.z = z - Math.max(0.004, 0.06 * span);
    const box = this.model.recording?.device.workspace;
    if (box) {
      triple(this.picture.workspace.min, ...box.min);
      triple(this.picture.workspace.max, ...box.max);
      // Without a path the floor is the floor of the workspace.
      if (this.picture.path.count < 2 && this.picture.movement.count < 2) f.z = box.min[2];
    }
  }

  // --- pointer ----------------------------------------------------------------------------------------------------------

  ray(clientX: number, clientY: number): Ray {
    const box = this.target.getBoundingClientRect();
    return rayThrough(this.camera, clientX - box.left, clientY - box.top);
  }

  place(x: number, y: number, z: number): { x: number; y: number } | null {
    project(this.camera, x, y, z, this.spot);
    if (!(this.spot[2]! > 0)) return null;
    const box = this.target.getBoundingClientRect();
    return { x: this.spot[0]! + box.left, y: this.spot[1]! + box.top };
  }

  axes(): Axes {
    return axesOf(this.camera);
  }

  private listen(target: HTMLElement): void {
    const signal = this.abort.signal;
    const on = <K extends keyof HTMLElementEventMap>(type: K, handler: (event: HTMLElementEventMap[K]) => void): void =>
      target.addEventListener(type, handler, { signal, passive: false });
    on("contextmenu", (event) => event.preventDefault());
    let claimed = false;
    on("pointerdown", (event) => {
      claimed = this.claim?.(event) === true;
      if (claimed) {
        event.preventDefault();
        return;
      }
      if (this.held || event.button > 2) return;
      target.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, {
        x: event.clientX,
        y: event.clientY,
        pans: event.button !== 0 || event.shiftKey,
      });
    });
    on("pointermove", (event) => this.movePointer(event));
    for (const type of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
      on(type, (event) => this.pointers.delete(event.pointerId));
    }
    on("wheel", (event) => {
      event.preventDefault();
      if (this.claimWheel?.(event) || this.held) return;
      const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
      this.zoomAt(Math.exp(0.0015 * lines * event.deltaY), event.clientX, event.clientY);
    });
    on("dblclick", () => {
      if (!this.held && !claimed) this.fit();
    });
  }

  private movePointer(event: PointerEvent): void {
    const pointer = this.pointers.get(event.pointerId);
    if (pointer === undefined || this.held) return;
    const dx = event.clientX - pointer.x;
    const dy = event.clientY - pointer.y;
    if (dx === 0 && dy === 0) return;
    if (this.pointers.size >= 2) {
      const other = [...this.pointers.entries()].find(([id]) => id !== event.pointerId)![1];
      const before = Math.hypot(pointer.x - other.x, pointer.y - other.y);
      const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      // Each finger carries half of the picture.
      pan(this.camera, dx / 2, dy / 2);
      if (before > 8 && after > 8) {
        this.zoomAt(before / after, (event.clientX + other.x) / 2, (event.clientY + other.y) / 2);
      }
    } else if (pointer.pans) {
      pan(this.camera, dx, dy);
    } else {
      turn(this.camera, dx, dy);
    }
    pointer.x = event.clientX;
    pointer.y = event.clientY;
    this.touched = true;
    this.dirty = true;
  }

  private zoomAt(factor: number, clientX: number, clientY: number): void {
    const box = this.target.getBoundingClientRect();
    zoom(this.camera, factor, clientX - box.left, clientY - box.top, 0.02, 20);
    this.touched = true;
    this.dirty = true;
  }

  // --- overlays ---------------------------------------------------------------------------------------------------------

  private placeOverlays(): void {
    const p = this.picture;
    const overlays = this.training === null;
    this.gizmo.root.hidden = !overlays;
    this.bars.hidden = !overlays;
    if (overlays) {
      this.gizmo.draw(axesOf(this.camera), p.theme);
      this.placeBars();
    }
    const known = Number.isFinite(p.tool[0] + p.tool[1] + p.tool[2]);
    const force = Math.hypot(...p.arrow.force);
    const arrow = known && p.arrow.visible && p.showTool;
    this.label.hidden = !arrow;
    if (arrow) {
      const from = this.projected(p.tool[0], p.tool[1], p.tool[2]);
      const tip = this.projected(
        p.tool[0] + ARROW_SCALE * p.arrow.force[0],
        p.tool[1] + ARROW_SCALE * p.arrow.force[1],
        p.tool[2] + ARROW_SCALE * p.arrow.force[2],
      );
      const dx = tip[0] - from[0];
      const dy = tip[1] - from[1];
      const run = Math.hypot(dx, dy);
      const ux = run > 4 ? dx / run : 0;
      const uy = run > 4 ? dy / run : -1;
      const text = `${decimal(force, 1)} N`;
      if (this.label.textContent !== text) this.label.textContent = text;
      // The label's edge is 6 px beyond the tip, and clear of the ball if the arrow points at the eye.
      const half = 3.7 * text.length + 5;
      const reach = Math.min(half / Math.max(0.01, Math.abs(ux)), 11 / Math.max(0.01, Math.abs(uy)));
      const off = reach + 6 + Math.max(0, p.toolSize + 6 - run);
      const x = Math.min(this.camera.width - half, Math.max(half, tip[0] + off * ux));
      const y = Math.min(this.camera.height - 12, Math.max(12, tip[1] + off * uy));
      this.label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
    }
    this.placeLegend();
    this.placeNotice();
    this.summarise(performance.now());
  }

  /** Says in words what the canvas shows, once a second: a screen reader could not follow more. */
  private summarise(now: number): void {
    if (now < this.summaryDue) return;
    this.summaryDue = now + 1000;
    const p = this.picture;
    const m = this.model;
    // The trainee gets no numbers while the hand moves.
    const text =
      this.training !== null
        ? "The movement in three dimensions"
        : describeScene(p.tool, p.path.count > 1, m.value("deviation"), m.value("radius"), Math.hypot(...p.arrow.force), p.scene?.objects[p.touched]?.name);
    if (this.target.getAttribute("aria-label") !== text) this.target.setAttribute("aria-label", text);
  }

  private projected(x: number, y: number, z: number): [number, number] {
    project(this.camera, x, y, z, this.spot);
    return [this.spot[0]!, this.spot[1]!];
  }

  /** Scale bars at the depth of the tool, or of the centre without one. */
  private placeBars(): void {
    const p = this.picture;
    const [x, y, z] = Number.isFinite(p.tool[0]) && p.showTool ? p.tool : this.camera.centre;
    project(this.camera, x, y, z, this.spot);
    const pixel = metresPerPixel(this.camera, this.spot[2]! > 0 ? this.spot[2]! : this.camera.distance);
    const most = Math.min(90, 0.22 * this.camera.width);
    const mm = nice((most * pixel) / 0.001);
    setBar(this.millimetres, `${mm} mm`, (mm * 0.001) / pixel);
    const newton = nice((most * pixel) / ARROW_SCALE);
    setBar(this.newtons, `${newton} N`, (newton * ARROW_SCALE) / pixel);
    this.newtons.root.hidden = !this.model.has("fx");
  }

  private placeLegend(): void {
    const { mode, high } = this.picture.colour;
    const shown = this.training === null && mode !== "one" && high > 0;
    const key = shown ? `${mode} ${high} ${this.picture.theme.dark}` : "";
    if (key === this.legendKey) return;
    this.legendKey = key;
    this.legend.hidden = !shown;
    if (!shown) return;
    const unit = { one: "", deviation: "mm", speed: "mm/s", force: "N" }[mode];
    const scale = mode === "force" ? 1 : 1000;
    this.legendTitle.textContent = { one: "", deviation: "Deviation", speed: "Speed", force: "Force" }[mode];
    this.legendLow.textContent = "0";
    this.legendHigh.textContent = `${plain(high * scale)} ${unit}`;
    const dark = this.picture.theme.dark;
    const stops = Array.from({ length: 8 }, (_, i) => cssColour(cividis(i / 7, dark)));
    this.legendStrip.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
  }

  private placeNotice(): void {
    // A person reads this notice once. Then it no longer covers the scene.
    if (this.withoutGl && this.withoutGlSince === null) {
      this.withoutGlSince = performance.now();
      window.setTimeout(() => this.invalidate(), NOTICE_TIME + 50);
    }
    const fresh = performance.now() - (this.withoutGlSince ?? 0) < NOTICE_TIME;
    const text = this.painter.lost
      ? "The graphics were lost. The scene returns when the browser gives them back."
      : this.withoutGl && fresh && this.training === null
        ? "This browser has no WebGL. The scene is drawn flat."
        : "";
    if (text === this.noticeKey) return;
    this.noticeKey = text;
    this.notice.textContent = text;
    this.notice.hidden = text === "";
  }

  // --- size and life ----------------------------------------------------------------------------------------------------

  resize(): void {
    const width = Math.max(1, this.host.clientWidth);
    const height = Math.max(1, this.host.clientHeight);
    const changed = width !== this.camera.width || height !== this.camera.height;
    this.camera.width = width;
    this.camera.height = height;
    this.sizeTool();
    this.painter.resize(width, height, this.ratio());
    if (changed && (!this.touched || this.training !== null)) this.fitted = false;
    this.dirty = true;
  }

  /** The trainee may sit far from the screen: the tool is larger there. */
  private sizeTool(): void {
    const size = Math.min(this.camera.width, this.camera.height);
    this.picture.toolSize = this.training !== null ? Math.max(9, 0.028 * size) : Math.max(8, Math.min(12, 0.02 * size));
  }

  private ratio(): number {
    // Two device pixels for each CSS pixel are as fine as the eye asks for; a software renderer draws one.
    return this.software ? 1 : Math.min(2, window.devicePixelRatio || 1);
  }

  useSoftware(): void {
    this.software = true;
    this.resize();
  }

  useFlat(): void {
    this.software = true;
    this.flatDue = this.painter.kind !== "flat";
    this.dirty = true;
  }

  private changePainter(): void {
    this.flatDue = false;
    const old = this.painter;
    this.painter = createFlatPainter(document.createElement("canvas"));
    old.dispose();
    this.showCanvas();
    this.resize();
  }

  private showCanvas(): void {
    this.canvas.className = "scene-canvas";
    this.target.replaceChildren(this.canvas);
  }

  dispose(): void {
    this.abort.abort();
    this.observer?.disconnect();
    this.painter.dispose();
    for (const part of [this.target, this.label, this.bars, this.gizmo.root, this.notice]) part.remove();
    this.host.classList.remove("scene", "scene-training");
  }

  private createPainter(options: SceneOptions): Painter {
    this.software = options.software === true;
    const changed = (): void => this.invalidate();
    if (options.flat !== true) {
      try {
        return createGlPainter(document.createElement("canvas"), this.picture, this.software, changed);
      } catch {
        // No WebGL here: the 2-D canvas below shows path, tool and trail.
        this.withoutGl = true;
      }
    }
    return createFlatPainter(document.createElement("canvas"));
  }
}

function emptyPicture(camera: Camera, host: Element): Picture {
  return {
    camera,
    scene: null,
    touched: -1,
    proxy: { visible: false, at: [NaN, NaN, NaN], normal: [NaN, NaN, NaN], showNormal: false },
    theme: readTheme(host),
    pathVersion: 0,
    path: createPolyline(PATH_POINTS),
    showPath: true,
    showTunnel: true,
    done: NaN,
    tool: [NaN, NaN, NaN],
    showTool: true,
    toolSize: 11,
    reference: [NaN, NaN, NaN],
    showReference: false,
    deviation: { visible: false, outside: false },
    arrow: { visible: false, force: [0, 0, 0] },
    trail: { count: 0, xyz: new Float32Array(3 * TRAIL_POINTS), age: new Float32Array(TRAIL_POINTS) },
    showTrail: true,
    movement: {
      capacity: MOVEMENT_CAPACITY,
      count: 0,
      xyz: new Float32Array(3 * MOVEMENT_CAPACITY),
      value: new Float32Array(MOVEMENT_CAPACITY),
      version: 0,
    },
    showMovement: true,
    colour: { mode: "one", low: 0, high: 0 },
    floor: { visible: true, z: 0, step: FLOOR_STEP, x0: -0.1, x1: 0.1, y0: -0.1, y1: 0.1 },
    workspace: { visible: false, min: [0, 0, 0], max: [0, 0, 0] },
    start: { at: [0, 0, 0], visible: false, colour: "" },
    goal: { at: [0, 0, 0], visible: false, colour: "" },
    intention: { visible: false, at: [0, 0, 0] },
    sheet: { visible: false, at: [0, 0, 0], axis: 1, half: [0.05, 0.05, 0.05] },
  };
}

type Box = readonly number[];

/** Least and largest x, y, z of a path [m]. */
function boundsOf(line: Polyline): Box {
  const box = [Infinity, Infinity, Infinity, -Infinity, -Infinity, -Infinity];
  for (let i = 0; i < line.count; i++) {
    for (let k = 0; k < 3; k++) {
      box[k] = Math.min(box[k]!, line.xyz[3 * i + k]!);
      box[k + 3] = Math.max(box[k + 3]!, line.xyz[3 * i + k]!);
    }
  }
  return box;
}

/** Whether two paths fill about the same space. */
function alike(a: Box, b: Box | null): boolean {
  if (b === null) return false;
  const size = Math.hypot(a[3]! - a[0]!, a[4]! - a[1]!, a[5]! - a[2]!);
  return a.every((value, i) => Math.abs(value - b[i]!) < 0.2 * size);
}

function triple(out: Triple, x: number, y: number, z: number): void {
  out[0] = x;
  out[1] = y;
  out[2] = z;
}

/** Summary of the scene in words; lengths in m, force in N, NaN: not known. `touched`: name of the touched object. */
export function describeScene(tool: readonly number[], hasPath: boolean, deviation: number, radius: number, force: number, touched?: string): string {
  const mm = (value: number): string => decimal(1000 * value, 1);
  const parts = ["The movement in three dimensions."];
  if (tool.every(Number.isFinite)) {
    parts.push(`The tool is at x ${mm(tool[0]!)}, y ${mm(tool[1]!)}, z ${mm(tool[2]!)} mm.`);
    if (deviation >= 0) {
      const where = radius > 0 ? `, ${deviation > radius ? "outside" : "inside"} the tunnel of ${mm(radius)} mm` : "";
      parts.push(`It is ${mm(deviation)} mm from the path${where}.`);
    }
  } else {
    parts.push("The place of the tool is not known.");
  }
  if (touched !== undefined) parts.push(`It touches ${touched}.`);
  if (!hasPath) parts.push("There is no path.");
  if (Number.isFinite(force)) parts.push(force < LEAST_FORCE ? "There is no force." : `The force is ${decimal(force, 1)} N.`);
  return parts.join(" ");
}

/** Largest of 1, 2, 5 times a power of ten that is not above `value`. */
export function nice(value: number): number {
  if (!(value > 0)) return 0;
  const power = 10 ** Math.floor(Math.log10(value));
  const digit = value / power;
  const size = digit >= 5 ? 5 : digit >= 2 ? 2 : 1;
  return Number((size * power).toPrecision(1));
}

/** Least of 1, 2, 3, 4, 5, 6, 8 times a power of ten that is not below `value`. */
export function round(value: number): number {
  if (!(value > 0)) return 0;
  const power = 10 ** Math.floor(Math.log10(value));
  const size = [1, 2, 3, 4, 5, 6, 8, 10].find((s) => s * power >= value * (1 - 1e-9)) ?? 10;
  return Number((size * power).toPrecision(2));
}

export function decimal(value: number, digits: number): string {
  if (!Number.isFinite(value)) return "–";
  return value.toFixed(digits).replace(/^-/, "−");
}

function plain(value: number): string {
  return String(Number(value.toPrecision(3)));
}

function element<K extends keyof HTMLElementTagNameMap>(tag: K, name: string): HTMLElementTagNameMap[K] {
  const created = document.createElement(tag);
  created.className = name;
  return created;
}

interface Bar {
  root: HTMLElement;
  text: HTMLElement;
  line: HTMLElement;
}

function bar(name: string): Bar {
  const root = element("div", name);
  const text = element("span", "scene-bar-text");
  const line = element("span", "scene-bar-line");
  root.append(text, line);
  return { root, text, line };
}

function setBar(b: Bar, text: string, width: number): void {
  if (b.text.textContent !== text) b.text.textContent = text;
  const size = `${width.toFixed(1)}px`;
  if (b.line.style.width !== size) b.line.style.width = size;
}
