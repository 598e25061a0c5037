// The wire protocol of the live view: types of the text messages, binary frames in both directions.
// docs/view-protocol.md is the contract. Numbers are SI; times are seconds of the session's clock.

export const PROTOCOL_VERSION = 1;
export const HEADER_BYTES = 32;

export const enum Kind {
  samples = 1,
  state = 2,
  bins = 3,
  path = 4,
  mesh = 5,
  intention = 8,
}

export const FLAG_GAP = 1;
export const FLAG_BACKFILL = 2;
export const FLAG_CUT = 4;
// Bins of a recording that is not read yet: an exact answer needs another question.
export const FLAG_COARSE = 8;

export type Role = "viewer" | "therapist" | "trainee";
export type Vec3 = [number, number, number];
export type Severity = "" | "note" | "warning" | "problem";

export interface RecordingEntry {
  name: string;
  title: string;
  duration: number;
}

export interface HelloMessage {
  type: "hello";
  version: number;
  role: Role;
  software: string;
  live: boolean;
  control: boolean;
  steer: boolean;
  on_page_lost: string;
  recordings: RecordingEntry[];
}

export interface Column {
  name: string;
  unit: string;
}

export interface RecordingMessage {
  type: "recording";
  index: number;
  // Live: counts the repetitions of this server.
  trial?: number;
  name: string;
  title: string;
  subject: string;
  session: string;
  verb: string;
  mode: string;
  rate_hz: number;
  start: number;
  end: number;
  device: {
    name: string;
    model: string;
    workspace?: { min: Vec3; max: Vec3 };
    max_force?: number;
    position_resolution?: number;
  };
  columns: Column[];
  limits: { max_force?: number; max_deviation?: number; max_speed?: number };
  input: string;
  virtual_time: boolean;
}

export interface StatusMessage {
  type: "status";
  time: number;
  phase: string;
  rate: number;
  asked_rate: number;
  overruns: number;
  force: number | null;
  deviation: number | null;
  speed: number | null;
  share: number;
  // State of the recording: "" without one, "armed" before its trigger, "paused" or "on".
  recording?: string;
  paused: boolean;
  ended: boolean;
  reason: string;
  zero_force: string;
  pages: number;
  lost_rows: number;
}

export interface EventEntry {
  time: number;
  code: string;
  name: string;
  text: string;
  severity: Severity;
}

export interface EventsMessage {
  type: "events";
  reset: boolean;
  list: EventEntry[];
}

export interface WarningMessage {
  type: "warning";
  severity: Severity;
  code: string;
  time: number | null;
  text: string;
}

export type PhaseEntry = [number, number, string];

export interface PhasesMessage {
  type: "phases";
  reset: boolean;
  list: PhaseEntry[];
  done: boolean;
}

export interface Control {
  name: string;
  label: string;
  unit: string;
  value: number;
  least: number;
  largest: number;
  because: string;
  // A factor changes by "NAME * F" and "NAME / F" only.
  kind: "number" | "switch" | "factor";
  step: number;
  // By which a button multiplies or divides the value; 0: it adds `step`.
  ratio: number;
  // Present values of a factor.
  text: string;
}

export interface ControlsMessage {
  type: "controls";
  list: Control[];
  actions: string[];
}

export interface AnswerMessage {
  type: "answer";
  id: number;
  text: string;
}

export interface Exercise {
  name: string;
  mode: string;
  settings: string;
  repetitions: number;
  // Repetitions that ended by themselves, and those that a command skipped.
  done: number;
  skipped: number;
  test: boolean;
}

export interface TrialResult {
  exercise: number;
  repetition: number;
  rms_m: number | null;
  help: number | null;
  target_m: number | null;
  time_in_tunnel: number | null;
  partial: boolean;
  skipped: boolean;
}

export interface ProgrammeMessage {
  type: "programme";
  title: string;
  subject: string;
  limit_s: number | null;
  elapsed_s: number | null;
  paused: boolean;
  exercises: Exercise[];
  current: number;
  trials: TrialResult[];
}

export interface SceneObject {
  name: string;
  kind: string;
  // Pose of the object in W: position [m], rotation as a quaternion w x y z.
  position: Vec3;
  rotation: [number, number, number, number];
  // "#rrggbb"; absent: the page chooses.
  colour?: string | null;
  // Numbers of the mesh that follows; null: the object is not drawn.
  mesh: { vertices: number; triangles: number } | null;
}

export interface SceneMessage {
  type: "scene";
  id: number;
  objects: SceneObject[];
}

export type TrainingState = "waiting" | "approach" | "go" | "moving" | "done" | "rest" | "question" | "skipped" | "stopped" | "finished";

export interface Show {
  tool: boolean;
  path: boolean;
  tunnel: boolean;
  trail: boolean;
  score: boolean;
}

export interface Score {
  time_in_tunnel: number | null;
  time_s: number | null;
  best: boolean;
}

export interface TrainingMessage {
  type: "training";
  state: TrainingState;
  exercise: string;
  mode: string;
  trial: number;
  of: number;
  repetition: number;
  repetitions: number;
  show: Show;
  rest_s: number | null;
  next: string;
  score: Score | null;
}

export interface PongMessage {
  type: "pong";
  id: number;
  sent: number;
  time: number;
}

export interface ErrorMessage {
  type: "error";
  id?: number;
  text: string;
}

export type ServerMessage =
  | HelloMessage
  | RecordingMessage
  | StatusMessage
  | EventsMessage
  | WarningMessage
  | PhasesMessage
  | ControlsMessage
  | AnswerMessage
  | ProgrammeMessage
  | TrainingMessage
  | SceneMessage
  | PongMessage
  | ErrorMessage;

export type Want = "samples" | "state" | "none";

export type PageMessage =
  | { type: "hello"; version: number; token: string; last?: number }
  | { type: "want"; data: Want }
  | { type: "bins"; id: number; t0: number; t1: number; pixels: number; channels: string[] }
  | { type: "rows"; id: number; t0: number; t1: number }
  | { type: "open"; id: number; recording: number }
  | { type: "command"; id: number; line: string }
  | { type: "stop" }
  | { type: "shown"; what: "go" | "done"; trial: number; frame: number; time: number }
  | { type: "ping"; id: number; sent: number };

// Reads a text message. Returns null if it is not a JSON object with a `type`: such a message is ignored.
export function parseText(text: string): ServerMessage | null {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch {
    return null;
  }
  if (typeof value !== "object" || value === null || typeof (value as { type?: unknown }).type !== "string") return null;
  return value as ServerMessage;
}

export interface Header {
  kind: number;
  version: number;
  flags: number;
  sequence: number;
  rows: number;
  request: number;
  t0: number;
  sent: number;
}

export interface RowsFrame {
  kind: Kind.samples | Kind.state;
  header: Header;
  // Time of each row after header.t0 [s].
  time: Float32Array;
  // One plane per column of the recording, in that order.
  planes: Float32Array[];
}

export interface BinChannel {
  first: Float32Array;
  min: Float32Array;
  max: Float32Array;
  last: Float32Array;
  // 1 where the minimum comes before the maximum.
  order: Uint8Array;
}

export interface BinsFrame {
  kind: Kind.bins;
  header: Header;
  // Bin width [s].
  width: number;
  channels: BinChannel[];
}

export interface PathFrame {
  kind: Kind.path;
  header: Header;
  time: Float32Array;
  x: Float32Array;
  y: Float32Array;
  z: Float32Array;
  // Tunnel radius at each point [m]; NaN where there is no tunnel.
  radius: Float32Array;
  // Arc length from the start of the path [m].
  length: Float32Array;
}

export interface MeshFrame {
  kind: Kind.mesh;
  header: Header;
  // Index of the object in the scene.
  object: number;
  // x y z of each vertex in the frame of the object [m].
  vertices: Float32Array;
  // Three indices of vertices for each triangle, counter-clockwise as seen from outside.
  triangles: Uint32Array;
}

export type Frame = RowsFrame | BinsFrame | PathFrame | MeshFrame;

const littleEndian = new Uint8Array(new Uint16Array([1]).buffer)[0] === 1;

function plane(buffer: ArrayBuffer, byte: number, rows: number): Float32Array {
  if (littleEndian) return new Float32Array(buffer, byte, rows);
  const view = new DataView(buffer);
  const out = new Float32Array(rows);
  for (let i = 0; i < rows; i++) out[i] = view.getFloat32(byte + 4 * i, true);
  return out;
}

function indices(buffer: ArrayBuffer, byte: number, count: number): Uint32Array {
  if (littleEndian) return new Uint32Array(buffer, byte, count);
  const view = new DataView(buffer);
  return Uint32Array.from({ length: count }, (_, i) => view.getUint32(byte + 4 * i, true));
}

// Reads the header of a binary frame. Returns null if the frame is too short or of another version.
export function decodeHeader(buffer: ArrayBuffer): Header | null {
  if (buffer.byteLength < HEADER_BYTES) return null;
  const v = new DataView(buffer);
  const header: Header = {
    kind: v.getUint8(0),
    version: v.getUint8(1),
    flags: v.getUint16(2, true),
    sequence: v.getUint32(4, true),
    rows: v.getUint32(8, true),
    request: v.getUint32(12, true),
    t0: v.getFloat64(16, true),
    sent: v.getFloat64(24, true),
  };
  return header.version === PROTOCOL_VERSION ? header : null;
}

// Reads a binary frame. The planes are views of `buffer`. Returns null for kinds this page does not know and for
// frames whose length contradicts their header.
export function decodeFrame(buffer: ArrayBuffer): Frame | null {
  const header = decodeHeader(buffer);
  if (header === null) return null;
  const rows = header.rows;
  const body = buffer.byteLength - HEADER_BYTES;
  switch (header.kind) {
    case Kind.samples:
    case Kind.state: {
      if (rows === 0) {
        return { kind: header.kind, header, time: new Float32Array(0), planes: [] };
      }
      if (body % (4 * rows) !== 0 || body === 0) return null;
      const count = body / (4 * rows);
      const planes: Float32Array[] = [];
      for (let p = 1; p < count; p++) planes.push(plane(buffer, HEADER_BYTES + 4 * rows * p, rows));
      return { kind: header.kind, header, time: plane(buffer, HEADER_BYTES, rows), planes };
    }
    case Kind.bins: {
      if (body < 16) return null;
      const v = new DataView(buffer);
      const count = v.getUint32(HEADER_BYTES, true);
      if (v.getUint32(HEADER_BYTES + 4, true) !== rows) return null;
      const width = v.getFloat64(HEADER_BYTES + 8, true);
      const orderBytes = 4 * Math.ceil(rows / 4);
      const channelBytes = 16 * rows + orderBytes;
      if (body !== 16 + count * channelBytes || !(width > 0)) return null;
      const channels: BinChannel[] = [];
      for (let c = 0; c < count; c++) {
        const at = HEADER_BYTES + 16 + c * channelBytes;
        channels.push({
          first: plane(buffer, at, rows),
          min: plane(buffer, at + 4 * rows, rows),
          max: plane(buffer, at + 8 * rows, rows),
          last: plane(buffer, at + 12 * rows, rows),
          order: new Uint8Array(buffer, at + 16 * rows, rows),
        });
      }
      return { kind: Kind.bins, header, width, channels };
    }
    case Kind.path: {
      if (body !== 24 * rows) return null;
      const p = (i: number): Float32Array => plane(buffer, HEADER_BYTES + 4 * rows * i, rows);
      return { kind: Kind.path, header, time: p(0), x: p(1), y: p(2), z: p(3), radius: p(4), length: p(5) };
    }
    case Kind.mesh: {
      if (body < 8) return null;
      const v = new DataView(buffer);
      const count = v.getUint32(HEADER_BYTES + 4, true);
      if (body !== 8 + 12 * rows + 12 * count) return null;
      const triangles = indices(buffer, HEADER_BYTES + 8 + 12 * rows, 3 * count);
      if (triangles.some((index) => index >= rows)) return null;
      return { kind: Kind.mesh, header, object: v.getUint32(HEADER_BYTES, true), vertices: plane(buffer, HEADER_BYTES + 8, 3 * rows), triangles };
    }
    default:
      return null;
  }
}

export const enum Input {
  mouse = 1,
  pen = 2,
  touch = 3,
  gamepad = 4,
  keys = 5,
}

export const enum Depth {
  plane = 0,
  path = 1,
}

export interface Intention {
  x: number; // [m], world
  y: number;
  z: number;
  grip: number; // 0 lets go, 1 holds
  input: Input;
  depth: Depth;
}

// Encodes an intention of the hand (kind 8), with the number of this page's binary message.
export function encodeIntention(intention: Intention, sequence: number): ArrayBuffer {
  const buffer = new ArrayBuffer(HEADER_BYTES + 24);
  const v = new DataView(buffer);
  v.setUint8(0, Kind.intention);
  v.setUint8(1, PROTOCOL_VERSION);
  v.setUint32(4, sequence >>> 0, true);
  v.setUint32(8, 1, true);
  v.setFloat32(HEADER_BYTES, intention.x, true);
  v.setFloat32(HEADER_BYTES + 4, intention.y, true);
  v.setFloat32(HEADER_BYTES + 8, intention.z, true);
  v.setFloat32(HEADER_BYTES + 12, intention.grip, true);
  v.setUint32(HEADER_BYTES + 16, intention.input, true);
  v.setUint32(HEADER_BYTES + 20, intention.depth, true);
  return buffer;
}
