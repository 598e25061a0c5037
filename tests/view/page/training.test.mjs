import assert from "node:assert/strict";
import test from "node:test";
import { load } from "./load.mjs";

const { screenState, wordsOf, lookOf, soundOf, pauseState, canPause, describe, describeScene, nice, round } = await load("training", "section", "scene/scene");

const STATES = ["waiting", "approach", "go", "moving", "done", "rest", "question", "skipped", "stopped", "finished"];
const SHOW = { tool: true, path: true, tunnel: true, trail: true, score: true };
const message = (state, changes = {}) => ({
  type: "training", state, exercise: "Curve", mode: "tunnel", trial: 3, of: 8, repetition: 3, repetitions: 8, show: SHOW,
  rest_s: 12, next: "curve, repetition 4 of 8", score: { time_in_tunnel: 0.934, time_s: 6.24, best: true }, ...changes,
});
const all = (w) => [w.word, w.beside, w.sentence, w.best, ...w.figures.flatMap((f) => [f.value, f.unit, f.label])].join(" ");
const situation = (changes) => ({ training: message("moving"), heard: true, hadConnection: true, ended: false, finished: false, verb: "run", ...changes });

test("Each state has its words", () => {
  const words = Object.fromEntries(STATES.map((s) => [s, wordsOf(s, message(s), 11.2, "confirmed")]));
  assert.equal(words.waiting.word, "Hold the handle");
  assert.deepEqual([words.approach.word, words.approach.sentence], ["The device moves you", "Let your hand follow"]);
  // In a free exercise no force leads the hand.
  assert.equal(wordsOf("approach", { mode: "free" }, NaN).word, "Move to the ring");
  // Modes with a cue begin with a hold in the start.
  for (const mode of ["reach", "range", "press", "track", "weigh"])
    assert.equal(wordsOf("approach", { mode }, NaN).sentence, "Hold still there and wait for Go");
  assert.deepEqual([words.question.word, words.question.sentence], ["Which was farther?", "Say first or second"]);
  assert.deepEqual([words.go.word, words.go.tone], ["Go", "go"]);
  assert.deepEqual([words.rest.word, words.rest.beside], ["Rest", "12 s"]);
  assert.equal(words.rest.sentence, "Next: curve, repetition 4 of 8");
  assert.deepEqual([words.finished.word, words.finished.sentence], ["Finished", "Thank you"]);
  assert.deepEqual([words.stopped.word, words.stopped.sentence, words.stopped.tone], ["Stopped", "The force is off. Please wait", "stop"]);
  assert.deepEqual([wordsOf("lost", null, NaN).word, wordsOf("lost", null, NaN).tone], ["One moment", "warning"]);
  assert.deepEqual([wordsOf("unstopped", null, NaN).word, wordsOf("unstopped", null, NaN).tone], ["Stop did not arrive", "stop"]);
});

test("The screen says that the force is off only where the device confirmed it", () => {
  const sentence = (zeroForce) => wordsOf("stopped", message("stopped"), NaN, zeroForce).sentence;
  assert.match(sentence("confirmed"), /force is off/);
  assert.equal(sentence("failed"), "Let go of the handle");
  for (const zeroForce of ["", "sent"]) assert.equal(sentence(zeroForce), "Please wait");
});

test("No word and no number is shown while the hand moves", () => {
  assert.equal(all(wordsOf("moving", message("moving"), 3)).trim(), "");
});

test("The score has at most two numbers, and praise only for the best", () => {
  const best = wordsOf("done", message("done"), NaN);
  assert.deepEqual(best.figures.map((f) => `${f.value} ${f.unit}`), ["93 %", "6.2 s"]);
  assert.equal(best.best, "Your best so far");
  const plain = wordsOf("done", message("done", { score: { time_in_tunnel: 0.5, time_s: 7, best: false } }), NaN);
  assert.equal(plain.best, "");
  const partly = wordsOf("done", message("done", { score: { time_in_tunnel: null, time_s: 7, best: false } }), NaN);
  assert.deepEqual(partly.figures.map((f) => f.value), ["7.0"]);
});

test("A hidden or missing score says that the repetition is done, and nothing else", () => {
  for (const changes of [{ show: { ...SHOW, score: false } }, { score: null }]) {
    const words = wordsOf("done", message("done", changes), NaN);
    assert.equal(words.word, "Done");
    assert.ok(!/\d|best/.test(all(words)), all(words));
  }
});

test("The trainee reads no reason and no blame", () => {
  for (const state of [...STATES, "lost", "none"]) {
    const text = all(wordsOf(state, message(state, { reason: "deviation_limit" }), 3));
    assert.ok(!/limit|error|wrong|fail|slow|bad|because|deviation/i.test(text), text);
  }
});

test("A lost connection shows after there was one, and an end stays on the screen", () => {
  assert.equal(screenState(situation({})), "moving");
  assert.equal(screenState(situation({ heard: false })), "lost");
  assert.equal(screenState(situation({ heard: false, hadConnection: false, training: null })), "none");
  assert.equal(screenState(situation({ heard: false, training: message("finished") })), "finished");
  assert.equal(screenState(situation({ heard: false, training: message("stopped") })), "stopped");
});

test("A session that ends during a movement is stopped, after a repetition it is finished", () => {
  for (const state of ["waiting", "approach", "go", "moving"]) {
    assert.equal(screenState(situation({ ended: true, training: message(state) })), "stopped");
  }
  for (const state of ["done", "rest"]) assert.equal(screenState(situation({ ended: true, training: message(state) })), "finished");
});

test("A playback and a recording have words while they run, and an end of their own", () => {
  const bare = (verb, changes = {}) => screenState(situation({ training: null, verb, ...changes }));
  assert.deepEqual([bare("play"), bare("record"), bare("")], ["played", "recorded", "none"]);
  assert.equal(wordsOf("played", null, NaN).word, "The device moves you");
  assert.equal(wordsOf("recorded", null, NaN).word, "You may move");
  assert.equal(bare("play", { ended: true, finished: true }), "finished");
  assert.equal(bare("play", { ended: true }), "stopped");
  assert.equal(bare("play", { heard: false }), "lost");
  for (const state of ["played", "recorded"]) assert.deepEqual([lookOf(state, null).trail, lookOf(state, null).moving], [true, true]);
});

test("A skipped repetition is skipped and not stopped, with neither a sound nor a colour of Stop", () => {
  const words = wordsOf("skipped", message("skipped"), NaN, "confirmed");
  assert.deepEqual([words.word, words.tone], ["Skipped", "plain"]);
  assert.equal(soundOf("skipped"), null);
  assert.equal(screenState(situation({ ended: true, training: message("skipped") })), "finished");
});

test("A programme pauses after its repetition, any other session at once", () => {
  const paused = { paused: true, ended: false };
  assert.equal(pauseState(null, false, undefined), "");
  assert.equal(pauseState({ paused: false, ended: false }, true, "moving"), "");
  assert.equal(pauseState({ paused: true, ended: true }, false, "moving"), "");
  for (const state of ["approach", "go", "moving"]) {
    assert.equal(pauseState(paused, true, state), "pausing");
    assert.equal(pauseState(paused, false, state), "paused");
  }
  assert.equal(pauseState(paused, true, "waiting"), "paused");
  assert.equal(pauseState(paused, false, undefined), "paused");
  assert.equal(wordsOf("paused", null, NaN).word, "Paused");
  assert.deepEqual(["stopped", "finished", "done", "lost", "question"].filter(canPause), []);
});

test("The camera is held in every state, and the programme's switches hide what they name", () => {
  for (const state of [...STATES, "lost", "none"]) {
    assert.equal(lookOf(state, SHOW).hold, true);
    for (const part of ["tool", "path", "tunnel", "trail"]) {
      assert.equal(lookOf(state, { ...SHOW, [part]: false })[part], false, `${part} in ${state}`);
    }
    assert.equal(lookOf(state, { ...SHOW, trail: false }).movement, false, "no trail, no movement afterwards");
  }
  assert.equal(lookOf("done", SHOW).movement, true);
  assert.equal(lookOf("moving", SHOW).movement, false);
  assert.equal(lookOf("moving", SHOW).done, true);
  assert.equal(lookOf("moving", { ...SHOW, path: false }).done, false);
  assert.deepEqual(["waiting", "approach", "go", "moving"].map((s) => lookOf(s, SHOW).start), ["waiting", "approach", "go", null]);
});

test("Go, done, stop and a lost connection have a sound", () => {
  assert.deepEqual(["go", "done", "stopped", "lost", "moving", "rest", "waiting"].map(soundOf),
    ["go", "done", "stopped", "lost", null, null, null]);
});

test("The section says in words where the tool is", () => {
  assert.equal(describe(0.0061, [0.0016, 0.0012]),
    "Section of the tunnel. Its radius is 6.1 mm. The tool is 1.2 mm above and 1.6 mm to the right of the middle, inside the tunnel.");
  assert.match(describe(0.003, [-0.004, 0]), /4\.0 mm to the left of the middle, outside/);
  assert.match(describe(0.003, [0, 0]), /in the middle, inside/);
  assert.match(describe(0.003, [NaN, 0]), /not known/);
});

test("The scene has a summary in words", () => {
  assert.equal(
    describeScene([0.0311, -0.0072, -0.0325], true, 0.002, 0.0061, 1.13),
    "The movement in three dimensions. The tool is at x 31.1, y −7.2, z −32.5 mm. " +
      "It is 2.0 mm from the path, inside the tunnel of 6.1 mm. The force is 1.1 N.",
  );
  assert.match(describeScene([0, 0, 0], true, 0.007, 0.006, 0), /7\.0 mm from the path, outside the tunnel.*There is no force/);
  assert.match(describeScene([NaN, 0, 0], false, NaN, NaN, NaN), /not known\. There is no path\.$/);
});

test("Scale bars have lengths of 1, 2 or 5; ranges of colours have round ends that are not below the data", () => {
  assert.deepEqual([0.0034, 0.9, 1, 4.99, 5, 23, 180].map(nice), [0.002, 0.5, 1, 2, 5, 20, 100]);
  assert.deepEqual([0.0031, 0.9, 1, 2.2, 7, 81].map(round), [0.004, 1, 1, 3, 8, 100]);
  assert.deepEqual([nice(0), round(NaN)], [0, 0]);
});
