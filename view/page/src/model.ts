// Holds the state of the page: the session or recording, its rows, path, events, phases, and the one time that scene,
// lanes and figures show. It draws nothing and needs no browser.
import { binOf, ROUNDING } from "./bins";
import { Latest } from "./latest";
import type {
  BinsFrame,
  ControlsMessage,
  EventEntry,
  HelloMessage,
  MeshFrame,
  PathFrame,
  PhaseEntry,
  ProgrammeMessage,
  RecordingMessage,
  RowsFrame,
  ServerMessage,
  StatusMessage,
  TrainingMessage,
  WarningMessage,
} from "./protocol";
import { FLAG_COARSE, FLAG_GAP } from "./protocol";
import { objectOf, shapeOf, type VirtualScene } from "./scene/objects";
import { BlockCache, nearestRow, RowRing, rowAt, type RowSource } from "./rows";

// Live rows are shown this much later than the newest one [s]: batches arrive each 16 ms and late ones do not stutter.
export const LIVE_DELAY = 0.035;
// A value older than this is not shown as present [s].
export const STALE = 0.25;
// After this long without a row a live session shows no values [s].
const SILENT = 0.5;
const SILENT_TICKS = 6;
export const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4, 8] as const;

export type ModelEvent =
  | "hello"
  | "recording"
  | "path"
  | "scene" // objects, or the mesh of one
  | "status"
  | "events"
  | "phases"
  | "warning"
  | "controls"
  | "programme"
  | "training"
  | "connection"
  | "play" // playing, speed, loop, frozen or live
  | "theme"
  | "data"; // rows or bins arrived: something that is shown may have changed

export interface Source {
  requestBins(t0: number, t1: number, pixels: number, channels: string[]): Promise<BinsFrame | null>;
  requestRows(t0: number, t1: number): Promise<RowsFrame | null>;
}

export interface Path {
  id: number;
  // Grows by one with each path, whatever its id.
  version: number;
  count: number;
  time: Float32Array;
  x: Float32Array;
  y: Float32Array;
  z: Float32Array;
  radius: Float32Array;
  length: Float32Array;
}

// The movement around the shown time, decimated: the repetition in a recording, the last part of a live session.
export interface Movement {
  version: number;
  count: number;
  time: Float64Array;
  x: Float32Array;
  y: Float32Array;
  z: Float32Array;
  deviation: Float32Array;
  speed: Float32Array;
  force: Float32Array;
}

export interface Repetition {
  number: number; // from 1
  t0: number;
  t1: number;
}

export const MOVEMENT_POINTS = 2000;
// A block of a live session that was not complete is asked for again after this time [ms].
const ASK_AGAIN = 1000;
// Keys that are pressed within this time of each other add up [ms].
const SUCCESSION = 800;
const RING_SECONDS = 40;
// Columns of the force that the device exerts on the hand.
const FORCES = ["fx", "fy", "fz", "force"] as const;
const MOST_EVENTS = 5000;
const MOST_WARNINGS = 100;

export class Model {
  hello: HelloMessage | null = null;
  recording: RecordingMessage | null = null;
  status: StatusMessage | null = null;
  // performance.now() when the last status came [ms].
  statusAt = -Infinity;
  controls: ControlsMessage | null = null;
  programme: ProgrammeMessage | null = null;
  training: TrainingMessage | null = null;
  path: Path | null = null;
  scene: VirtualScene | null = null;
  // Events of the session and the marks of this page, in the order of their times.
  events: EventEntry[] = [];
  phases: PhaseEntry[] = [];
  phasesDone = false;
  repetitions: Repetition[] = [];
  warnings: WarningMessage[] = [];
  // The page has a connection and the server accepted it.
  connected = false;
  // Why the server refused or ended the connection; "" otherwise.
  refused = "";

  // The time that the page shows [s]. Scene, lanes and figures read it and nothing else.
  shown = 0;
  playing = false;
  speed = 1;
  loop: { t0: number; t1: number } | null = null;
  loopOn = false;
  // Live: the picture follows the newest rows. False: the picture is frozen or plays from an earlier time.
  following = false;
  private atNewest = false; // the session is over, and the newest row is shown
  // The shown time was reached by steps of one sample: figures show more digits.
  stepped = false;
  // Session time minus performance.now()/1000 [s], as the client estimates it.
  clockOffset = NaN;

  ring: RowRing = new RowRing(0, 2);
  blocks = new BlockCache(4, 24);
  lostRows = 0;
  // Counts arrivals of data, so that a drawing knows whether it is still right.
  dataVersion = 0;

  // Values of the shown row, one for each column; NaN where nothing was measured or the row is not here yet.
  values = new Float32Array(0);
  // Time of the shown row [s]; NaN without a row.
  shownRowTime = NaN;

  private endedPhases: PhaseEntry[] = [];
  // Events of the session, and marks of this page.
  private sessionEvents: EventEntry[] = [];
  ownMarks: EventEntry[] = [];
  private columnOf = new Map<string, number>();
  private readonly listeners = new Map<ModelEvent, Set<() => void>>();
  private collected: (() => void)[] | null = null;
  private source: Source | null = null;
  private generation = 0;
  private pathVersion = 0;
  private sceneVersion = 0;
  private moved: Movement | null = null;
  private movementKey = "";
  private movementDue = 0;
  // Where the last key led, and the time of its press [ms]; null after any other seek.
  private aim: { time: number; at: number } | null = null;
  private lastTick = NaN;
  private ticksWithoutRows = 0;
  private readonly rowRequests: Latest<{ index: number; generation: number }, RowsFrame>;
  private readonly movementRequests: Latest<{ t0: number; t1: number; generation: number }, BinsFrame>;

  constructor() {
    this.rowRequests = new Latest(
      async (q) => {
        const t0 = q.index * this.blocks.span;
        return this.source === null || q.generation !== this.generation ? null : this.source.requestRows(t0, t0 + this.blocks.span);
      },
      (q, frame) => {
        if (q.generation !== this.generation) return;
        const complete = this.hello?.live !== true || this.end >= (q.index + 1) * this.blocks.span + STALE;
        this.blocks.put(q.index, frame, complete ? Infinity : performance.now() + ASK_AGAIN);
        this.changed();
      },
    );
    this.movementRequests = new Latest(
      async (q) =>
        this.source === null || q.generation !== this.generation ? null : this.source.requestBins(q.t0, q.t1, MOVEMENT_POINTS, this.movementChannels()),
      (q, frame) => {
        if (q.generation !== this.generation) return;
        // Coarse bins are boxes about the movement, not its places.
        if ((frame.header.flags & FLAG_COARSE) !== 0) {
          this.movementKey = "";
          this.movementDue = performance.now() / 1000 + 0.4;
        } else {
          this.takeMovement(frame);
        }
      },
    );
  }

  on(event: ModelEvent, listener: () => void): () => void {
    let set = this.listeners.get(event);
    if (set === undefined) this.listeners.set(event, (set = new Set()));
    set.add(listener);
    const end = (): void => void set.delete(listener);
    this.collected?.push(end);
    return end;
  }

  // Calls `build` and returns a function that ends all subscriptions that it made.
  collect(build: () => void): () => void {
    const ends: (() => void)[] = [];
    this.collected = ends;
    try {
      build();
    } finally {
      this.collected = null;
    }
    return () => ends.forEach((end) => end());
  }

  emit(event: ModelEvent): void {
    for (const listener of this.listeners.get(event) ?? []) listener();
  }

  setSource(source: Source): void {
    this.source = source;
  }

  get live(): boolean {
    return this.hello?.live === true && this.status?.ended !== true;
  }

  // Start and end of what can be shown [s]. The end of a live session grows.
  get start(): number {
    return this.recording?.start ?? 0;
  }

  get end(): number {
    const known = this.recording?.end ?? 0;
    const newest = this.ring.newest;
    return Number.isFinite(newest) ? Math.max(known, newest) : known;
  }

  get period(): number {
    const rate = this.recording?.rate_hz ?? 0;
    return rate > 0 ? 1 / rate : 0.001;
  }

  // A live session is over and the page shows its end.
  get atEnd(): boolean {
    return this.hello?.live === true && this.status?.ended === true && this.shown >= this.end - STALE;
  }

  // The server no longer keeps the rows of the shown time: only the charts have them, as least and largest values.
  get thinned(): boolean {
    return !Number.isFinite(this.shownRowTime) && this.blocks.at(this.shown)?.cut === true;
  }

  // A live session is over: Stop has nothing to stop.
  get over(): boolean {
    return this.hello?.live === true && (this.status?.ended === true || this.refused === "over");
  }

  // How far the shown time is behind the newest row [s].
  get lag(): number {
    return Math.max(0, this.end - this.shown);
  }

  // Returns the index of a column by its name, -1 if this session does not have it.
  column(name: string): number {
    return this.columnOf.get(name) ?? -1;
  }

  has(name: string): boolean {
    return this.columnOf.has(name);
  }

  // Returns the value of a column at the shown time; NaN if there is none.
  value(name: string): number {
    const c = this.columnOf.get(name);
    return c === undefined ? NaN : (this.values[c] ?? NaN);
  }

  // Takes a text message of the server.
  take(message: ServerMessage): void {
    switch (message.type) {
      case "hello":
        // A reconnection leaves a frozen picture frozen.
        if (this.hello === null) this.following = this.playing = message.live;
        this.hello = message;
        this.emit("hello");
        break;
      case "recording":
        this.takeRecording(message);
        break;
      case "status":
        if (message.ended && this.status?.ended !== true) {
          if (this.following) this.goToEnd();
          else this.pause();
        }
        this.status = message;
        this.statusAt = performance.now();
        this.lostRows = message.lost_rows;
        this.emit("status");
        break;
      case "events":
        this.sessionEvents = message.reset ? message.list.slice() : this.sessionEvents.concat(message.list);
        this.joinEvents();
        break;
      case "phases": {
        this.endedPhases = message.reset ? message.list.slice() : mergePhases(this.endedPhases, message.list);
        this.phases = this.endedPhases.map((p): PhaseEntry => [p[0], p[1], p[2]]);
        this.phasesDone = message.done;
        this.repetitions = repetitionsOf(this.phases);
        this.emit("phases");
        break;
      }
      case "warning":
        this.warnings.push(message);
        if (this.warnings.length > MOST_WARNINGS) this.warnings.shift();
        this.emit("warning");
        break;
      case "controls":
        this.controls = message;
        this.emit("controls");
        break;
      case "programme":
        this.programme = message;
        this.emit("programme");
        break;
      case "scene":
        this.scene = { id: message.id, version: ++this.sceneVersion, objects: message.objects.map(objectOf) };
        this.emit("scene");
        break;
      case "training":
        this.training = message;
        this.emit("training");
        break;
      default:
        break;
    }
  }

  takeRows(frame: RowsFrame): void {
    if ((frame.header.flags & FLAG_GAP) !== 0 && this.status === null) this.lostRows++;
    const last = frame.time.length > 0 ? frame.header.t0 + frame.time[frame.time.length - 1]! : NaN;
    // A clock that went back belongs to a new session.
    if (last < this.ring.oldest) this.ring.clear();
    if (this.ring.push(frame) > 0) {
      this.ticksWithoutRows = 0;
      if (this.atNewest) this.shown = this.end;
      this.changed();
    }
  }

  takePath(frame: PathFrame): void {
    if (this.path !== null && frame.header.request < this.path.id) return;
    this.path = {
      id: frame.header.request,
      version: ++this.pathVersion,
      count: frame.header.rows,
      time: frame.time,
      x: frame.x,
      y: frame.y,
      z: frame.z,
      radius: frame.radius,
      length: frame.length,
    };
    this.emit("path");
  }

  // Takes the mesh of an object of the present scene. One that contradicts its message is ignored.
  takeMesh(frame: MeshFrame): void {
    const scene = this.scene;
    const object = scene?.objects[frame.object];
    if (scene === null || object === undefined || frame.header.request !== scene.id) return;
    const { mesh } = object;
    if (mesh === null || mesh.vertices !== frame.header.rows || 3 * mesh.triangles !== frame.triangles.length) return;
    object.shape = shapeOf(frame.vertices, frame.triangles, object.position, object.rotation);
    scene.version = ++this.sceneVersion;
    this.emit("scene");
  }

  // Adds a mark that only this page keeps: a viewer cannot write into a recording.
  addOwnMark(time: number, text: string): void {
    this.ownMarks.push({ time, code: "page", name: "mark", text, severity: "" });
    this.joinEvents();
  }

  setConnected(connected: boolean, refused = ""): void {
    this.connected = connected;
    this.refused = refused;
    if (connected) {
      // Questions of the old connection have no answer.
      this.movementKey = "";
    }
    this.emit("connection");
  }

  // --- time -----------------------------------------------------------------------------------------------------------

  play(): void {
    if (!this.live && this.shown >= this.end - this.period / 2) this.shown = this.loopOn && this.loop ? this.loop.t0 : this.start;
    this.playing = true;
    this.atNewest = false;
    this.stepped = false;
    this.emit("play");
  }

  // Freezes the picture. A live session goes on.
  pause(): void {
    this.playing = false;
    this.following = false;
    this.emit("play");
  }

  toggle(): void {
    if (this.playing) this.pause();
    else this.play();
  }

  seek(time: number): void {
    this.aim = null;
    this.following = false;
    this.atNewest = false;
    this.stepped = false;
    this.shown = Math.min(this.end, Math.max(this.start, time));
    this.emit("play");
  }

  // Moves the shown time to where a key pressed at `now` [ms] leads from the place that the last keys aimed at. Presses in
  // quick succession add up, however few frames the page draws and however far it plays between them. `lead` gets the
  // place to start at, and whether a key led there; it returns the target, or undefined to stay.
  seekByKey(now: number, lead: (from: number, again: boolean) => number | undefined): void {
    const aim = this.aim !== null && now - this.aim.at < SUCCESSION ? this.aim : null;
    const target = lead(aim?.time ?? this.shown, aim !== null);
    if (target === undefined) return;
    this.seek(target);
    this.aim = { time: this.shown, at: now };
  }

  // Moves the shown time by whole rows and pauses. Without rows there (they are not here yet, or a gap), by the period.
  step(rows: number): void {
    this.playing = false;
    let target = this.shown + rows * this.period;
    const source = this.sourceAt(this.shown);
    if (source !== null) {
      const row = nearestRow(source, this.shown, this.period * 0.75);
      const next = row + rows;
      if (row >= 0 && next >= source.first && next < source.end) {
        const time = source.timeOf(next);
        if (Math.abs(time - this.shown) < 3 * this.period * Math.abs(rows)) target = time;
      }
    }
    this.seek(target);
    this.stepped = true;
  }

  // Shows the newest row, also of those that are still on their way.
  private goToEnd(): void {
    this.playing = false;
    this.seek(this.end);
    this.atNewest = true;
  }

  goLive(): void {
    if (this.hello?.live !== true) return;
    if (this.over) return this.goToEnd();
    this.aim = null;
    this.following = true;
    this.playing = true;
    this.stepped = false;
    this.speed = 1;
    this.emit("play");
  }

  setSpeed(speed: number): void {
    this.speed = Math.min(SPEEDS[SPEEDS.length - 1]!, Math.max(SPEEDS[0], speed));
    if (this.following && this.speed !== 1) this.following = false;
    this.emit("play");
  }

  setLoop(loop: { t0: number; t1: number } | null, on = loop !== null): void {
    this.loop = loop;
    this.loopOn = on && loop !== null;
    this.emit("play");
  }

  // Advances the shown time to `now` [s of performance.now()]. Returns true if it moved.
  tick(now: number): boolean {
    const before = this.shown;
    const passed = Number.isFinite(this.lastTick) ? Math.min(0.25, Math.max(0, now - this.lastTick)) : 0;
    this.lastTick = now;
    if (this.recording === null) return false;
    if (this.following) {
      this.shown = this.liveTime(now);
    } else if (this.playing) {
      let t = this.shown + passed * this.speed;
      const loop = this.loopOn ? this.loop : null;
      if (loop !== null && t >= loop.t1) t = loop.t0 + ((t - loop.t0) % Math.max(this.period, loop.t1 - loop.t0));
      if (t >= this.end) {
        t = this.end;
        if (this.live) {
          this.following = true;
          this.speed = 1;
        } else {
          this.playing = false;
        }
        this.emit("play");
      }
      this.shown = t;
    }
    this.growLastPhase();
    this.readShownRow(now);
    return this.shown !== before;
  }

  // --- rows -----------------------------------------------------------------------------------------------------------

  // Returns the rows that hold `time`; null if the page does not have them (they are asked for by `need`).
  sourceAt(time: number): RowSource | null {
    const ring = this.ring;
    if (ring.end > 0 && time >= ring.oldest - this.period / 2 && time <= ring.newest + STALE) return ring;
    const block = this.blocks.at(time);
    return block !== null && block.end > 0 ? block : null;
  }

  // Copies positions of the last `seconds` before the shown time into `out` (x y z each), oldest first, at most one each
  // `step` seconds. Returns how many points that are. Points of one time are the same in every frame: nothing shimmers.
  trail(seconds: number, step: number, out: Float32Array): number {
    const x = this.column("x");
    const y = this.column("y");
    const z = this.column("z");
    if (x < 0 || y < 0 || z < 0) return 0;
    const most = Math.floor(out.length / 3);
    let count = 0;
    this.eachRow(this.shown - seconds, this.shown, step, (source, row) => {
      if (count === most) return;
      const px = source.value(x, row);
      if (!Number.isFinite(px)) return;
      out[3 * count] = px;
      out[3 * count + 1] = source.value(y, row);
      out[3 * count + 2] = source.value(z, row);
      count++;
    });
    return count;
  }

  // Calls `visit` for one row of each `step` seconds, and for the last row, of [t0, t1].
  eachRow(t0: number, t1: number, step: number, visit: (source: RowSource, row: number) => void): void {
    let t = t0;
    let cell = NaN;
    let last: RowSource | null = null;
    let lastRow = -1;
    let lastVisited = true;
    while (t <= t1) {
      const source = this.sourceAt(t);
      if (source === null) {
        t = (this.blocks.indexOf(t) + 1) * this.blocks.span;
        continue;
      }
      let row = Math.max(source.first, rowAt(source, t - ROUNDING) + 1);
      let time = NaN;
      for (; row < source.end; row++) {
        time = source.timeOf(row);
        if (time > t1 + ROUNDING) break;
        const c = binOf(time, step);
        last = source;
        lastRow = row;
        lastVisited = c !== cell;
        if (lastVisited) {
          cell = c;
          visit(source, row);
        }
      }
      if (row < source.end || source === this.ring) break;
      const block = this.blocks.at(t);
      t = block !== null ? Math.max(block.t1, t + this.period) : t1 + 1;
    }
    if (!lastVisited && last !== null) visit(last, lastRow);
  }

  // Asks for the rows around the shown time, if they are not here. Called once a frame.
  need(): void {
    if (this.recording === null || !this.connected) return;
    const ring = this.ring;
    const wanted: number[] = [];
    const index = this.blocks.indexOf(this.shown);
    const inRing = (t: number): boolean => ring.end > 0 && t >= ring.oldest && t <= ring.newest + STALE;
    if (!inRing(this.shown)) wanted.push(index);
    // The trail reaches back; playback runs ahead.
    if (!inRing(this.shown - 1)) wanted.push(this.blocks.indexOf(Math.max(this.start, this.shown - 1)));
    if (this.playing && !this.following) {
      const ahead = Math.min(this.end, this.shown + Math.max(1.5, 2 * this.speed));
      for (let k = index + 1; k <= this.blocks.indexOf(ahead) && k < index + 5; k++) {
        if (!inRing(k * this.blocks.span)) wanted.push(k);
      }
    }
    for (const k of wanted) {
      if (this.blocks.has(k, performance.now()) || (k + 1) * this.blocks.span <= this.start || k * this.blocks.span > this.end) continue;
      const asked = this.rowRequests.outstanding;
      if (asked === null || asked.index !== k || asked.generation !== this.generation) this.rowRequests.request({ index: k, generation: this.generation });
      break;
    }
  }

  // --- movement ---------------------------------------------------------------------------------------------------------

  // Returns the movement around the shown time; null until there is one. Its version changes when its content does.
  get movement(): Movement | null {
    return this.moved;
  }

  // Keeps `movement` right: asks for bins of the repetition of a recording, reads the ring of a live session. `now` in s.
  refreshMovement(now: number): void {
    if (this.recording === null || !this.has("x")) return;
    if (this.following) {
      if (now < this.movementDue) return;
      this.movementDue = now + 0.1;
      const rep = this.repetitionAt(this.shown) ?? (this.repetitions.length > 0 ? this.repetitionBefore(this.shown) : null);
      const t0 = Math.max(this.ring.oldest, rep !== null ? rep.t0 : this.shown - 15);
      if (Number.isFinite(t0)) this.movementFromRing(t0, rep !== null ? Math.min(rep.t1, this.shown) : this.shown);
      this.movementKey = "";
      return;
    }
    const rep = this.repetitionAt(this.shown) ?? this.repetitionBefore(this.shown);
    const t0 = rep !== null ? rep.t0 : this.start;
    const t1 = rep !== null ? rep.t1 : this.end;
    const key = `${this.generation} ${t0} ${this.live && rep === null ? Math.floor(t1 / 5) : t1}`;
    if (key === this.movementKey || !this.connected || !(t1 > t0) || now < this.movementDue) return;
    this.movementKey = key;
    this.movementRequests.request({ t0, t1, generation: this.generation });
  }

  // Returns the repetition that holds `time`; null between repetitions.
  repetitionAt(time: number): Repetition | null {
    for (const r of this.repetitions) if (time >= r.t0 && time <= r.t1) return r;
    return null;
  }

  // Returns the last repetition that began before `time`, or the first one of all.
  repetitionBefore(time: number): Repetition | null {
    let best: Repetition | null = this.repetitions[0] ?? null;
    for (const r of this.repetitions) if (r.t0 <= time) best = r;
    return best;
  }

  // Returns the name of the phase at `time`, "" if none is known.
  phaseAt(time: number): string {
    for (let i = this.phases.length - 1; i >= 0; i--) {
      const p = this.phases[i]!;
      if (time >= p[0] && time <= p[1]) return p[2];
    }
    return "";
  }

  // --- private ----------------------------------------------------------------------------------------------------------

  private takeRecording(message: RecordingMessage): void {
    const before = this.recording;
    const columns = message.columns.map((c) => c.name);
    const sameColumns = before !== null && columns.join(" ") === before.columns.map((c) => c.name).join(" ");
    const same = sameColumns && before.index === message.index && before.trial === message.trial && before.session === message.session && before.name === message.name;
    this.recording = message;
    this.columnOf = new Map(columns.map((name, index) => [name, index]));
    if (!sameColumns) this.values = new Float32Array(columns.length).fill(NaN);
    if (this.hello?.live === true) {
      const capacity = Math.ceil(RING_SECONDS * Math.max(100, message.rate_hz || 1000));
      if (!sameColumns || this.ring.capacity < capacity) this.ring = new RowRing(columns.length, capacity);
      // The clock of the next repetition starts at zero.
      else if (!same || message.end < this.ring.newest - 0.5) this.ring.clear();
    } else if (!same) {
      this.ring = new RowRing(0, 2);
    }
    if (!same) {
      this.generation++;
      // A block is one request: at most 16 000 rows.
      let span = 4;
      while (span * message.rate_hz > 16000) span /= 2;
      this.blocks = new BlockCache(span, 24);
      this.moved = null;
      this.movementKey = "";
      this.sessionEvents = [];
      this.ownMarks = [];
      this.events = [];
      this.endedPhases = [];
      this.phases = [];
      this.repetitions = [];
      this.loop = null;
      this.loopOn = false;
      this.shown = message.start;
      this.scene = null;
      this.emit("scene");
      if (this.hello?.live === true) {
        // The next repetition is shown live, also if the last one was frozen or has ended.
        this.status = null;
        this.following = this.playing = true;
        this.atNewest = false;
      } else {
        this.playing = false;
        this.path = null;
        this.emit("path");
      }
      for (const event of ["events", "phases", "play"] as const) this.emit(event);
    }
    this.emit("recording");
    this.changed();
  }

  // The server lists the phases that have ended; the one that is on reaches from there to the newest row.
  private growLastPhase(): void {
    const newest = this.ring.newest;
    if (!this.live || this.phasesDone || this.status === null || this.status.phase === "" || !Number.isFinite(newest)) return;
    const name = this.status.phase;
    const ended = this.endedPhases;
    const last = ended[ended.length - 1];
    // A status is a quarter of a second old at most: the phase that just ended may still be in it.
    const joins = last !== undefined && last[2] === name;
    const from = joins ? last[0] : (last?.[1] ?? this.start);
    if (newest <= from) return;
    const open = this.phases[this.phases.length - 1];
    if (this.phases.length === ended.length + (joins ? 0 : 1) && open !== undefined && open[0] === from && open[2] === name) {
      open[1] = Math.max(open[1], newest);
      const rep = this.repetitions[this.repetitions.length - 1];
      if (name === "run" && rep !== undefined && rep.t0 === from) rep.t1 = open[1];
      return;
    }
    this.phases = (joins ? ended.slice(0, -1) : ended).map((p): PhaseEntry => [p[0], p[1], p[2]]);
    this.phases.push([from, newest, name]);
    this.repetitions = repetitionsOf(this.phases);
    this.emit("phases");
  }

  private joinEvents(): void {
    this.sessionEvents.sort((a, b) => a.time - b.time);
    if (this.sessionEvents.length > MOST_EVENTS) this.sessionEvents.splice(0, this.sessionEvents.length - MOST_EVENTS);
    this.events = this.sessionEvents.concat(this.ownMarks).sort((a, b) => a.time - b.time);
    this.emit("events");
  }

  private changed(): void {
    this.dataVersion++;
    this.emit("data");
  }

  private liveTime(now: number): number {
    const newest = this.ring.newest;
    if (!Number.isFinite(newest)) return this.end;
    if (this.recording?.virtual_time === true || !Number.isFinite(this.clockOffset)) return newest;
    // One's own clock moves the picture evenly; the rows bound it.
    const t = now + this.clockOffset - LIVE_DELAY;
    return Math.min(newest, Math.max(t, newest - 0.5));
  }

  private readShownRow(now: number): void {
    // The newest row of a stream that stopped is no present value.
    // A page that was busy for half a second has rows waiting: it looks a few frames later.
    this.ticksWithoutRows++;
    const silent =
      this.following && this.recording?.virtual_time !== true && this.ticksWithoutRows > SILENT_TICKS && now + this.clockOffset - this.ring.newest > SILENT;
    const source = silent ? null : this.sourceAt(this.shown);
    const tolerance = Math.max(this.period * 0.75, this.following ? STALE : 0.02);
    const row = source === null ? -1 : nearestRow(source, this.shown, tolerance);
    if (source === null || row < 0) {
      this.values.fill(NaN);
      this.shownRowTime = NaN;
      return;
    }
    for (let c = 0; c < this.values.length; c++) this.values[c] = source.value(c, row);
    this.shownRowTime = source.timeOf(row);
    if (this.atEnd) this.showFinalForce();
  }

  // After the end, the force of the last row is no present force: it is zero if the device confirmed it, else unknown.
  private showFinalForce(): void {
    const force = this.status?.zero_force === "confirmed" ? 0 : NaN;
    for (const name of FORCES) {
      const c = this.columnOf.get(name);
      if (c !== undefined) this.values[c] = force;
    }
  }

  private movementChannels(): string[] {
    return ["x", "y", "z", "deviation", "speed", "force"].filter((name) => this.has(name));
  }

  private emptyMovement(): Movement {
    const n = MOVEMENT_POINTS + 4;
    const f = (): Float32Array => new Float32Array(n);
    return { version: 0, count: 0, time: new Float64Array(n), x: f(), y: f(), z: f(), deviation: f(), speed: f(), force: f() };
  }

  private movementFromRing(t0: number, t1: number): void {
    const m = (this.moved ??= this.emptyMovement());
    const names = ["x", "y", "z", "deviation", "speed", "force"] as const;
    const columns = names.map((name) => this.column(name));
    const step = Math.max(this.period, 2 ** Math.ceil(Math.log2((t1 - t0) / (MOVEMENT_POINTS - 2) / this.period)) * this.period);
    let count = 0;
    this.eachRow(t0, t1, step, (source, row) => {
      if (count >= m.time.length) return;
      m.time[count] = source.timeOf(row);
      for (let i = 0; i < names.length; i++) m[names[i]!][count] = columns[i]! < 0 ? NaN : source.value(columns[i]!, row);
      if (Number.isFinite(m.x[count]!)) count++;
    });
    m.count = count;
    m.version++;
  }

  private takeMovement(frame: BinsFrame): void {
    const m = (this.moved ??= this.emptyMovement());
    const channels = new Map(this.movementChannels().map((name, i) => [name, frame.channels[i]]));
    const x = channels.get("x");
    const y = channels.get("y");
    const z = channels.get("z");
    if (x === undefined || y === undefined || z === undefined) return;
    let count = 0;
    for (let k = 0; k < frame.header.rows && count < m.time.length; k++) {
      if (!Number.isFinite(x.first[k]!)) continue;
      m.time[count] = frame.header.t0 + k * frame.width;
      m.x[count] = x.first[k]!;
      m.y[count] = y.first[k]!;
      m.z[count] = z.first[k]!;
      m.deviation[count] = channels.get("deviation")?.max[k] ?? NaN;
      m.speed[count] = channels.get("speed")?.max[k] ?? NaN;
      m.force[count] = channels.get("force")?.max[k] ?? NaN;
      count++;
    }
    m.count = count;
    m.version++;
    this.changed();
  }
}

// Joins phases that are known with newer ones: an entry that begins at the same time replaces the old one (it grew).
export function mergePhases(known: PhaseEntry[], added: PhaseEntry[]): PhaseEntry[] {
  const out = known.slice();
  for (const p of added) {
    const last = out[out.length - 1];
    if (last !== undefined && Math.abs(last[0] - p[0]) < 1e-9) out[out.length - 1] = p;
    else out.push(p);
  }
  return out;
}

// Numbers the stretches in which the hand moved along the path.
export function repetitionsOf(phases: PhaseEntry[]): Repetition[] {
  const out: Repetition[] = [];
  for (const p of phases) if (p[2] === "run") out.push({ number: out.length + 1, t0: p[0], t1: p[1] });
  return out;
}
