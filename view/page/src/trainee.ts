// The training screen: the scene above, large words below, sounds, one Start click. It shows no reason and no blame, and
// no number while the hand moves.
import type { Client } from "./client";
import { setStopIdle } from "./dom";
import { openFullScreen } from "./fullscreen";
import type { Model } from "./model";
import type { SceneView } from "./scene/scene";
import { createSection, type Section } from "./section";
import { Sounds } from "./sounds";
import { canPause, hasScore, lookOf, pauseState, screenState, soundOf, wordsOf, type ScreenState, type Words } from "./training";

// Without a word of the server for this long, the connection counts as lost [ms]: its status comes each 250 ms.
const SILENCE = 1500;
// The rest ends with a tick this long before the next repetition [s].
const TICK = 3;
const MOST_DOTS = 12;
// A score stays at least this long, also if the rest begins at once [ms].
const SCORE_TIME = 4000;

export interface Trainee {
  // Updates words and scene. Called once a frame before the scene draws, with performance.now() [ms].
  draw(now: number): void;
  readonly state: ScreenState;
  dispose(): void;
}

export function createTrainee(host: HTMLElement, model: Model, client: Client, scene: SceneView): Trainee {
  return new TraineeScreen(host, model, client, scene);
}

class TraineeScreen implements Trainee {
  state: ScreenState = "none";
  private readonly sounds = new Sounds();
  private readonly root = part("section", "training");
  private readonly exercise = part("h1", "training-exercise");
  private readonly count = part("span", "training-count");
  private readonly dots = part("span", "training-dots");
  private readonly stop = part("button", "training-stop");
  private readonly stopWord = part("span", "training-stop-word");
  private readonly band = part("div", "training-band");
  private readonly live = part("div", "training-words");
  private readonly line = part("p", "training-line");
  private readonly word = part("strong", "training-word");
  private readonly beside = part("span", "training-beside");
  private readonly sentence = part("p", "training-sentence");
  private readonly figures = part("div", "training-figures");
  private readonly best = part("p", "training-best");
  private readonly start = part("div", "training-start");
  private readonly startButton = part("button", "training-start-button");
  private readonly disc = part("canvas", "training-section");
  private readonly section: Section;
  private readonly abort = new AbortController();
  private started = false;
  private hadConnection = false;
  private restEnds = NaN;
  private ticked = false;
  private key = "";
  private headKey = "";
  private lookKey = "";
  private frame = 0;
  // Go or done, painted by the last frame: it is reported when the next one begins.
  private painted: { what: "go" | "done"; trial: number; frame: number; time: number } | null = null;
  private reported = "";
  private scoreTrial = NaN;
  private scoreUntil = -Infinity;
  private restLasts = NaN;
  private wakeLock: { release(): Promise<void> } | null = null;

  constructor(
    host: HTMLElement,
    private readonly model: Model,
    private readonly client: Client,
    private readonly scene: SceneView,
  ) {
    const head = part("header", "training-head");
    const title = part("div", "training-title");
    const steps = part("div", "training-steps");
    this.root.setAttribute("aria-label", "Training");
    this.dots.setAttribute("aria-hidden", "true");
    this.live.setAttribute("role", "status");
    this.live.setAttribute("aria-atomic", "true");
    this.beside.setAttribute("aria-hidden", "true");
    this.stop.type = "button";
    const octagon = part("span", "training-octagon");
    octagon.setAttribute("aria-hidden", "true");
    this.stop.append(octagon, this.stopWord);
    this.startButton.type = "button";
    this.startButton.textContent = "Start";
    const about = part("p", "training-about");
    about.textContent = "Opens sound and full screen";
    this.start.append(this.startButton, about);
    steps.append(this.count, this.dots);
    title.append(this.exercise, steps);
    head.append(title, this.stop);
    this.line.append(this.word, this.beside);
    this.live.append(this.line, this.figures, this.best, this.sentence);
    this.band.append(this.live, this.disc, this.start);
    this.root.append(head, this.band);
    host.append(this.root);
    this.section = createSection(this.disc, model, scene, { words: false });
    this.listen();
    this.takeTraining();
    this.draw(performance.now());
  }

  dispose(): void {
    this.abort.abort();
    this.section.dispose();
    this.sounds.close();
    void this.wakeLock?.release().catch(() => undefined);
    this.scene.setTraining(null);
    this.root.remove();
  }

  draw(now: number): void {
    this.report();
    this.frame++;
    if (this.model.connected) this.hadConnection = true;
    const training = this.model.training;
    const status = this.model.status;
    const state = screenState({
      training,
      heard: this.model.connected && (!Number.isFinite(this.model.statusAt) || now - this.model.statusAt < SILENCE),
      hadConnection: this.hadConnection,
      ended: status?.ended === true,
      finished: status?.reason === "finished",
      verb: status === null ? "" : (this.model.recording?.verb ?? ""),
    });
    const entered = state !== this.state;
    this.state = state;
    const rest = (this.restEnds - now) / 1000;
    const read = this.readState(state, rest, now);
    const words = wordsOf(read, training, rest, status?.zero_force ?? "");
    this.say(words, state);
    this.head();
    setStopIdle(this.stop, this.stopWord, this.model.over);
    const look = lookOf(state, training?.show ?? null);
    const lookKey = JSON.stringify(look);
    if (lookKey !== this.lookKey) {
      this.lookKey = lookKey;
      this.scene.setTraining(look);
    }
    const sound = entered ? soundOf(state) : null;
    if (sound !== null) this.sounds.play(sound);
    if (state === "rest" && !this.ticked && rest <= TICK && rest > 0) {
      this.ticked = true;
      this.sounds.play("tick");
    }
    // One report for each trial and state, also if the message comes again.
    const report = `${state} ${training?.trial ?? 0}`;
    if ((state === "go" || state === "done") && report !== this.reported) {
      this.reported = report;
      this.painted = { what: state, trial: training?.trial ?? 0, frame: this.frame, time: this.newest() };
    }
    this.disc.hidden = read !== "moving" || training?.show?.tunnel !== true || training.show.tool !== true;
    if (!this.disc.hidden) this.section.draw(now);
  }

  // State whose words are shown: a score that came just now is read before the rest, and a pause has words of its own.
  private readState(state: ScreenState, rest: number, now: number): ScreenState {
    const training = this.model.training;
    if (state === "lost" && this.client.stopWaits) return "unstopped";
    if (canPause(state) && pauseState(this.model.status, this.model.programme !== null, training?.state) === "paused") return "paused";
    if ((state !== "done" && state !== "rest" && state !== "finished") || training === null || !hasScore(training)) return state;
    if (training.trial !== this.scoreTrial) {
      this.scoreTrial = training.trial;
      this.scoreUntil = now + SCORE_TIME;
      this.restLasts = NaN;
    }
    if (state === "rest" && !Number.isFinite(this.restLasts)) this.restLasts = rest;
    // A short rest is for the score, too: its last part tells that the next repetition comes.
    const soon = Math.min(TICK, 0.3 * this.restLasts);
    return now < this.scoreUntil && !(rest <= soon) ? "done" : state;
  }

  // The frame after the one that painted the word: only now it was handed to the screen.
  private report(): void {
    const painted = this.painted;
    if (painted === null) return;
    this.painted = null;
    this.client.shown(painted.what, painted.trial, painted.frame, painted.time);
  }

  // Session time of the newest row that this frame shows [s].
  private newest(): number {
    const row = this.model.shownRowTime;
    return Number.isFinite(row) ? row : (this.model.status?.time ?? 0);
  }

  private takeTraining(): void {
    const training = this.model.training;
    const rests = training?.state === "rest" && training.rest_s !== null;
    this.restEnds = rests ? performance.now() + 1000 * training!.rest_s! : NaN;
    if (!rests) this.ticked = false;
  }

  private say(words: Words, state: ScreenState): void {
    const key = JSON.stringify([words, this.started]);
    if (key === this.key) return;
    this.key = key;
    this.root.dataset.state = state;
    this.band.dataset.tone = words.tone;
    setText(this.word, words.word);
    setText(this.beside, words.beside);
    setText(this.sentence, words.sentence);
    setText(this.best, words.best);
    this.line.hidden = words.word === "";
    this.figures.replaceChildren(
      ...words.figures.map((figure) => {
        const box = part("div", "training-figure");
        const value = part("strong", "training-figure-value");
        const unit = part("span", "training-figure-unit");
        const label = part("span", "training-figure-label");
        value.textContent = figure.value;
        unit.textContent = ` ${figure.unit}`;
        label.textContent = figure.label;
        const numbers = part("span", "training-figure-numbers");
        numbers.append(value, unit);
        box.append(numbers, label);
        return box;
      }),
    );
    // The invitation stands beside what the person does first, and never takes the place of a word.
    this.start.hidden = this.started || !["none", "waiting", "played", "recorded"].includes(state);
  }

  private head(): void {
    const t = this.model.training;
    const key = t === null ? "" : [t.exercise, t.repetition, t.repetitions, t.state].join("|");
    if (key === this.headKey) return;
    this.headKey = key;
    setText(this.exercise, t?.exercise ?? "");
    const many = t?.repetitions ?? 0;
    const done = t?.state === "done" || t?.state === "rest" || t?.state === "skipped" || t?.state === "finished";
    setText(this.count, t !== null && many > 1 ? `${t.repetition} of ${many}` : "");
    const dots = t === null || many < 2 || many > MOST_DOTS ? 0 : many;
    this.dots.replaceChildren(
      ...Array.from({ length: dots }, (_, i) => {
        const number = i + 1;
        const now = number === t!.repetition;
        const past = number < t!.repetition || (now && done);
        return part("span", `training-dot${now ? " training-dot-now" : past ? " training-dot-past" : ""}`);
      }),
    );
  }

  private listen(): void {
    const signal = this.abort.signal;
    const end = this.model.on("training", () => this.takeTraining());
    signal.addEventListener("abort", end);
    // Stop waits for no release of the button and for no frame.
    this.stop.addEventListener("pointerdown", (event) => {
      if (event.button === 0) this.client.stop();
    }, { signal });
    // From the keyboard or a screen reader a click comes without a press of the pointer.
    this.stop.addEventListener("click", (event) => {
      if (event.detail === 0) this.client.stop();
    }, { signal });
    this.startButton.addEventListener("click", () => this.open(), { signal });
    document.addEventListener("visibilitychange", () => {
      if (this.started && document.visibilityState === "visible") this.keepAwake();
    }, { signal });
  }

  private open(): void {
    this.started = true;
    this.sounds.open();
    openFullScreen();
    this.keepAwake();
    this.key = "";
    this.startButton.blur();
  }

  private keepAwake(): void {
    const lock = (navigator as { wakeLock?: { request(type: "screen"): Promise<{ release(): Promise<void> }> } }).wakeLock;
    void lock?.request("screen").then(
      (held) => (this.wakeLock = held),
      () => undefined,
    );
  }
}

function part<K extends keyof HTMLElementTagNameMap>(tag: K, name: string): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  made.className = name;
  return made;
}

function setText(target: HTMLElement, text: string): void {
  if (target.textContent !== text) target.textContent = text;
}
