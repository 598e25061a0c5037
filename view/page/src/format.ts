// Numbers as people read them: a real minus, an en dash for what is not known, never a 0 in its place.

const MINUS = "−";
export const UNKNOWN = "–";

export function decimals(value: number, digits: number): string {
  if (!Number.isFinite(value)) return UNKNOWN;
  const text = Math.abs(value).toFixed(digits);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

// m:ss.mmm, or h:mm:ss.mmm; `digits` after the second.
export function clock(seconds: number, digits = 3): string {
  if (!Number.isFinite(seconds)) return UNKNOWN;
  const scale = 10 ** digits;
  const units = Math.round(Math.abs(seconds) * scale);
  const sign = seconds < 0 && units > 0 ? MINUS : "";
  const whole = Math.floor(units / scale);
  const rest = units % scale;
  const h = Math.floor(whole / 3600);
  const m = Math.floor((whole % 3600) / 60);
  const s = whole % 60;
  const two = (n: number): string => String(n).padStart(2, "0");
  const head = h > 0 ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
  return sign + head + (digits > 0 ? "." + String(rest).padStart(digits, "0") : "");
}

export interface Shown {
  factor: number;
  unit: string;
  digits: number;
}

// How a quantity of the protocol is shown: its factor, unit and decimals.
export function shownAs(name: string, unit: string): Shown {
  if (unit === "m") return { factor: 1000, unit: "mm", digits: 1 };
  if (unit === "m/s") return { factor: 1000, unit: "mm/s", digits: 0 };
  if (unit === "N") return { factor: 1, unit: "N", digits: 2 };
  if (name === "phase" || name === "buttons" || name === "contact") return { factor: 1, unit: "", digits: 0 };
  return { factor: 1, unit, digits: 3 };
}

export function quantity(value: number, unit: string, digits?: number): string {
  if (unit === "") return decimals(value, digits ?? 0);
  const s = shownAs("", unit);
  return `${decimals(value * s.factor, digits ?? s.digits)} ${s.unit}`;
}

const PHASES: Record<string, string> = {
  idle: "Idle",
  approach: "Approach",
  run: "Moving",
  hold: "Holding",
  release: "Releasing",
  stopped: "Stopped",
};

// The name of a phase in words.
export function phaseWord(phase: string): string {
  return PHASES[phase] ?? (phase === "" ? "" : phase[0]!.toUpperCase() + phase.slice(1));
}

// Returns the word for a session that only records, and so has no phases.
export function recordingWord(recording: string | undefined): string {
  return recording === "on" ? "Recording" : recording === "armed" ? "Waits for the trigger" : phaseWord("idle");
}

export function lagWord(seconds: number): string {
  return seconds < 10 ? `${decimals(seconds, 1)} s` : clock(seconds, 0);
}

const WORDS: Record<string, string> = {
  r: "path",
  f: "force sent",
  e: "reference force",
  m: "measured force",
  q: "orientation",
};

// The name of a column in words: "path x" for rx.
export function columnWord(name: string): string {
  const group = /^([rfemq])([xyzw])$/.exec(name);
  if (group !== null) return `${WORDS[group[1]!]} ${group[2]}`;
  const vector = /^(proxy|normal)_([xyz])$/.exec(name);
  if (vector !== null) return `${vector[1] === "proxy" ? "proxy" : "contact normal"} ${vector[2]}`;
  if (name === "contact") return "touched object";
  return name === "radius" ? "tunnel radius" : name;
}

// The phases in the order of their numbers.
const PHASE_ORDER = ["idle", "approach", "run", "hold", "release", "stopped"];

// A value as a cell of a table.
export function cellText(name: string, value: number, unit: string): string {
  if (name === "phase") return Number.isFinite(value) ? phaseWord(PHASE_ORDER[value] ?? "") || UNKNOWN : UNKNOWN;
  const how = shownAs(name, unit);
  return decimals(value * how.factor, how.unit === "mm" ? 3 : how.digits);
}
