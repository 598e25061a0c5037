// The keys, as in other players. One table makes both the handling and the help.
import type { Model } from "./model";
import type { Control } from "./protocol";
import { SPEEDS } from "./model";
import { flagsOf } from "./timeline";

export interface Actions {
  stop(): void;
  mark(withText: boolean): void;
  axisView(axis: 0 | 1 | 2): void;
  fit(): void;
  colour(): void;
  fullScreen(): void;
  theme(): void;
  help(): void;
  command(line: string): void;
  // Says that a key has nothing to change.
  say(text: string): void;
  readonly control: boolean;
}

const LETTERS_KEY = "haptrace-letters";

export function lettersOn(): boolean {
  return localStorage.getItem(LETTERS_KEY) !== "off";
}

export function setLetters(on: boolean): void {
  localStorage.setItem(LETTERS_KEY, on ? "on" : "off");
}

// Rows of the help table: keys, meaning. Empty keys begin a group.
export const KEY_TABLE: readonly (readonly [string[], string])[] = [
  [["Space", "K"], "play, pause; in a live session: freeze the picture"],
  [["Left", "Right"], "1 s back, 1 s on; with Shift 5 s, with Alt 0.1 s"],
  [[",", "."], "one sample back, one on"],
  [["PgUp", "PgDn"], "previous, next repetition"],
  [["[", "]"], "previous, next mark"],
  [["J", "L"], "slower, faster: 0.05 to 8 times"],
  [["I", "O", "P"], "start of the loop, end of the loop, loop on or off"],
  [["M", "N"], "mark; mark with a text"],
  [["G"], "go to the live edge"],
  [["1", "2", "3"], "view along x, y, z"],
  [["Home"], "fit the view"],
  [["C"], "colour of the movement"],
  [["F"], "full screen"],
  [["T"], "light or dark"],
  [["H"], "keyboard as hand, where the session lets a page steer"],
  [["+", "-", "R"], "with --control: gains up, down, as at the start; in guide and run the stiffness of the walls"],
  [["Esc"], "stop a live session"],
  [["?"], "this table"],
];

// Returns the command of + (1) and - (-1); "" if the session has nothing that they change.
export function strengthLine(list: readonly Pick<Control, "name">[], direction: 1 | -1): string {
  const has = (name: string): boolean => list.some((c) => c.name === name);
  const name = has("kp") || has("kd") || has("gains") ? "gains" : has("stiffness") ? "stiffness" : "";
  return name === "" ? "" : `${name} ${direction > 0 ? "*" : "/"} 1.1`;
}

// Returns the next speed up (1) or down (-1).
export function nextSpeed(speed: number, direction: 1 | -1): number {
  const list = direction > 0 ? SPEEDS.filter((s) => s > speed * 1.001) : SPEEDS.filter((s) => s < speed * 0.999).slice(-1);
  return list[0] ?? speed;
}

// Moves to the previous or next mark or warning. Without one it stays. `now` is the time of the press [ms].
export function seekFlag(model: Model, direction: 1 | -1, now = performance.now()): void {
  const times = flagsOf(model.events).map((e) => e.time);
  model.seekByKey(now, (from, again) => {
    // A press while one plays leads to the mark before the one that was just passed.
    const slack = Math.max(model.period, direction < 0 && model.playing && !again ? 0.5 : model.period) / 2;
    return direction > 0 ? times.find((t) => t > from + slack) : times.filter((t) => t < from - slack).pop();
  });
}

// Moves to the previous or next repetition. While one runs, "previous" is its start. `now` is the time of the press [ms].
export function seekRepetition(model: Model, direction: 1 | -1, now = performance.now()): void {
  const starts = model.repetitions.map((r) => r.t0);
  model.seekByKey(now, (from, again) => {
    if (direction > 0) return starts.find((t) => t > from + 0.01);
    // Where the last press led, the next one leads on, also if some of the repetition has played since.
    const slack = model.playing && !again ? 0.5 : 0.01;
    return starts.filter((t) => t < from - slack).pop() ?? model.start;
  });
}

function typing(target: EventTarget | null): boolean {
  return target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement || (target instanceof HTMLInputElement && target.type !== "checkbox");
}

// Listens to the keys of the page. Esc stops a live session wherever the focus is.
export function listenToKeys(model: Model, actions: Actions): () => void {
  const handle = (event: KeyboardEvent): void => {
    if (event.key === "Escape") {
      // Also while no repetition runs: a programme goes on after a rest.
      if (model.hello?.live === true) actions.stop();
      return;
    }
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || typing(event.target)) return;
    if (document.querySelector("dialog[open]") !== null && event.key !== "?") return;
    if (!obey(event)) return;
    event.preventDefault();
  };

  const strength = (direction: 1 | -1): void => {
    const line = strengthLine(model.controls?.list ?? [], direction);
    if (line === "") actions.say("There is no gain and no stiffness to change now.");
    else actions.command(line);
  };

  const obey = (event: KeyboardEvent): boolean => {
    const key = event.key;
    const alt = event.altKey;
    // The trainee's picture shows the present movement, always: no key freezes it or seeks.
    if (model.hello?.role === "trainee" && !/^[ft]$/i.test(key)) return false;
    switch (key) {
      case " ":
        // A button reached by Tab is pressed by Space.
        if (event.target instanceof HTMLButtonElement || event.target instanceof HTMLInputElement) return false;
        model.toggle();
        return true;
      case "ArrowLeft":
      case "ArrowRight": {
        const size = event.shiftKey ? 5 : alt ? 0.1 : 1;
        model.seekByKey(event.timeStamp, (from) => from + (key === "ArrowLeft" ? -size : size));
        return true;
      }
      case "PageUp":
        seekRepetition(model, -1, event.timeStamp);
        return true;
      case "PageDown":
        seekRepetition(model, 1, event.timeStamp);
        return true;
      case "Home":
        actions.fit();
        return true;
      default:
        break;
    }
    if (alt) return false;
    // Signs and letters can be switched off: speech input and unsteady hands press them by accident.
    if (key.length !== 1 || (key !== "?" && !lettersOn())) return false;
    switch (key.toLowerCase()) {
      case "k":
        model.toggle();
        return true;
      case "j":
        model.setSpeed(nextSpeed(model.speed, -1));
        return true;
      case "l":
        model.setSpeed(nextSpeed(model.speed, 1));
        return true;
      case ",":
        model.step(-1);
        return true;
      case ".":
        model.step(1);
        return true;
      case "[":
        seekFlag(model, -1, event.timeStamp);
        return true;
      case "]":
        seekFlag(model, 1, event.timeStamp);
        return true;
      case "i":
        model.setLoop({ t0: model.shown, t1: Math.max(model.loop?.t1 ?? model.end, model.shown + model.period) }, model.loopOn);
        return true;
      case "o":
        model.setLoop({ t0: Math.min(model.loop?.t0 ?? model.start, model.shown - model.period), t1: model.shown }, true);
        return true;
      case "p":
        if (model.loop !== null) model.setLoop(model.loop, !model.loopOn);
        else loopRepetition(model);
        return true;
      case "m":
        actions.mark(false);
        return true;
      case "n":
        actions.mark(true);
        return true;
      case "1":
      case "2":
      case "3":
        actions.axisView((Number(key) - 1) as 0 | 1 | 2);
        return true;
      case "c":
        actions.colour();
        return true;
      case "f":
        actions.fullScreen();
        return true;
      case "t":
        actions.theme();
        return true;
      case "g":
        model.goLive();
        return true;
      case "?":
        actions.help();
        return true;
      case "+":
      case "=":
        if (actions.control) strength(1);
        return actions.control;
      case "-":
        if (actions.control) strength(-1);
        return actions.control;
      case "r":
        if (actions.control && (model.controls?.list.length ?? 0) > 0) actions.command("reset");
        else if (actions.control) actions.say("There is no value to reset now.");
        return actions.control;
      default:
        return false;
    }
  };

  window.addEventListener("keydown", handle);
  return () => window.removeEventListener("keydown", handle);
}

// Loops over the repetition that is shown, or over all if there is none.
export function loopRepetition(model: Model): void {
  const rep = model.repetitionAt(model.shown) ?? model.repetitionBefore(model.shown);
  if (rep !== null) model.setLoop({ t0: rep.t0, t1: rep.t1 });
  else if (model.end > model.start) model.setLoop({ t0: model.start, t1: model.end });
}
