// Chooses the words and the picture of the training screen in each state. Pure: no page, no clock of its own.
import type { Score, Show, StatusMessage, TrainingMessage, TrainingState } from "./protocol";
import type { TrainingLook } from "./scene/scene";
import type { SoundName } from "./sounds";

// States of the screen: those of the session, and some of the page itself. Sessions without an exercise are "played" or
// "recorded"; "paused" and "unstopped", a Stop that found no connection, have words only.
export type ScreenState = TrainingState | "lost" | "none" | "played" | "recorded" | "paused" | "unstopped";

export interface Figure {
  value: string;
  unit: string;
  label: string;
}

export interface Words {
  // Large word; "" if nothing is to be read.
  word: string;
  // Follows the word in lighter type, such as the seconds of a rest.
  beside: string;
  sentence: string;
  figures: Figure[];
  // Praise below the figures; "" unless it is the best so far.
  best: string;
  tone: "plain" | "go" | "stop" | "warning";
}

// Facts that decide the state, besides the session's own message.
export interface Situation {
  training: TrainingMessage | null;
  // The page has a connection and hears from the server.
  heard: boolean;
  // The page had a connection before.
  hadConnection: boolean;
  // The session is over.
  ended: boolean;
  // It came to its end by itself.
  finished: boolean;
  // Verb of a session that runs; "" before.
  verb: string;
}

// Returns whether a session is paused. A programme comes to the end of its repetition first, and is "pausing" until then.
export function pauseState(status: Pick<StatusMessage, "paused" | "ended"> | null, programme: boolean, state: TrainingState | undefined): "" | "pausing" | "paused" {
  if (status === null || !status.paused || status.ended) return "";
  return programme && (state === "approach" || state === "go" || state === "moving") ? "pausing" : "paused";
}

// Returns true for the states in which a pause has words of its own.
export function canPause(state: ScreenState): boolean {
  return state === "none" || state === "waiting" || state === "approach" || state === "go" || state === "moving" || state === "played" || state === "recorded";
}

export function screenState(s: Situation): ScreenState {
  const state = s.training?.state ?? (s.verb === "play" ? "played" : s.verb === "record" ? "recorded" : "none");
  // A final state stays on the screen: the server goes away after it.
  if (state === "finished" || state === "stopped") return state;
  if (s.ended) return state === "done" || state === "rest" || state === "skipped" || (s.training === null && s.finished) ? "finished" : "stopped";
  if (!s.heard && s.hadConnection) return "lost";
  return state;
}

// Words of a state. `rest` is what remains of a rest [s]; `zeroForce` is how the request of zero force ended: "confirmed",
// "sent", "failed", or "" while that is not known. The screen says that the force is off only where the device confirmed it.
export function wordsOf(state: ScreenState, training: TrainingMessage | null, rest: number, zeroForce = ""): Words {
  const words: Words = { word: "", beside: "", sentence: "", figures: [], best: "", tone: "plain" };
  switch (state) {
    case "none":
      words.word = "Please wait";
      break;
    case "played":
      words.word = "The device moves you";
      words.sentence = "Let your hand follow";
      break;
    case "recorded":
      words.word = "You may move";
      words.sentence = "The device follows your hand";
      break;
    case "paused":
      words.word = "Paused";
      words.sentence = "Please wait";
      break;
    case "skipped":
      words.word = "Skipped";
      words.sentence = "Please wait";
      break;
    case "waiting":
      words.word = "Hold the handle";
      break;
    case "approach":
      // In a free exercise no force leads the hand. A reach has a hold in the start, until the cue.
      if (training?.mode === "free") {
        words.word = "Move to the ring";
      } else if (["reach", "range", "press", "track", "weigh"].includes(training?.mode ?? "")) {
        words.word = "Move to the ring";
        words.sentence = "Hold still there and wait for Go";
      } else {
        words.word = "The device moves you";
        words.sentence = "Let your hand follow";
      }
      break;
    case "go":
      words.word = "Go";
      words.tone = "go";
      break;
    case "moving":
      break;
    case "done": {
      words.figures = figuresOf(training?.show, training?.score ?? null);
      if (words.figures.length === 0) words.word = "Done";
      else if (training?.score?.best === true) words.best = "Your best so far";
      break;
    }
    case "rest":
      words.word = "Rest";
      words.beside = Number.isFinite(rest) ? `${Math.max(1, Math.ceil(rest - 1e-6))} s` : "";
      words.sentence = training?.next ? `Next: ${training.next}` : "";
      break;
    case "question":
      words.word = "Which was farther?";
      words.sentence = "Say first or second";
      break;
    case "finished":
      words.word = "Finished";
      words.sentence = "Thank you";
      break;
    case "stopped":
      words.word = "Stopped";
      words.sentence =
        zeroForce === "confirmed" ? "The force is off. Please wait" : zeroForce === "failed" ? "Let go of the handle" : "Please wait";
      words.tone = "stop";
      break;
    case "lost":
      words.word = "One moment";
      words.sentence = "No connection. Please hold still";
      words.tone = "warning";
      break;
    case "unstopped":
      words.word = "Stop did not arrive";
      words.sentence = "Let go of the handle";
      words.tone = "stop";
      break;
  }
  return words;
}

export function hasScore(training: TrainingMessage): boolean {
  return figuresOf(training.show, training.score).length > 0;
}

// At most two numbers, and only if the programme shows the score.
function figuresOf(show: Show | undefined, score: Score | null): Figure[] {
  if (show?.score !== true || score === null) return [];
  const out: Figure[] = [];
  if (score.time_in_tunnel !== null && Number.isFinite(score.time_in_tunnel)) {
    const share = Math.round(100 * Math.min(1, Math.max(0, score.time_in_tunnel)));
    out.push({ value: String(share), unit: "%", label: "of the time in the tunnel" });
  }
  if (score.time_s !== null && Number.isFinite(score.time_s)) {
    out.push({ value: score.time_s.toFixed(1), unit: "s", label: "time" });
  }
  return out;
}

export function lookOf(state: ScreenState, show: Show | null): TrainingLook {
  const shows: Show = show ?? { tool: true, path: true, tunnel: true, trail: true, score: false };
  const after = state === "done" || state === "rest" || state === "finished";
  const moving = state === "moving" || state === "played" || state === "recorded";
  const before = state === "waiting" || state === "approach" || state === "go";
  return {
    tool: shows.tool,
    path: shows.path,
    tunnel: shows.tunnel,
    trail: shows.trail && !after,
    // The movement over the path tells more than the trail did: without a trail it stays hidden.
    movement: after && shows.trail && shows.path,
    done: moving && shows.path && shows.tool,
    start: before ? (state as "waiting" | "approach" | "go") : null,
    goal: before || moving,
    hold: true,
    moving: state === "go" || moving,
  };
}

export function soundOf(state: ScreenState): SoundName | null {
  return state === "go" || state === "done" || state === "stopped" || state === "lost" ? state : null;
}
