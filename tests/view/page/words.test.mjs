import assert from "node:assert/strict";
import test from "node:test";
import { load } from "./load.mjs";

const { limitText, cellText, columnWord, clock, decimals, quantity, nextSpeed, strengthLine, pauseWords, controlLine, controlText, stepped, exerciseState, trendWords, lagWord, recordingWord } = await load("format", "keys", "therapist");

test("numbers have a real minus, and an en dash for what is not known", () => {
  assert.equal(decimals(-1.25, 1), "−1.3");
  assert.equal(decimals(NaN, 1), "–");
  assert.equal(decimals(Infinity, 1), "–");
  assert.equal(decimals(-0.001, 1), "0.0");
  assert.equal(quantity(0.0072, "m"), "7.2 mm");
  assert.equal(quantity(NaN, "N"), "– N");
});

test("a session that only records says whether samples are kept", () => {
  assert.deepEqual(["on", "armed", "paused", "", undefined].map(recordingWord), ["Recording", "Waits for the trigger", "Idle", "Idle", "Idle"]);
});

test("columns and phases are named in words", () => {
  assert.equal(columnWord("rx"), "path x");
  assert.equal(columnWord("mz"), "measured force z");
  assert.equal(columnWord("force"), "force");
  assert.equal(cellText("phase", 2, ""), "Moving");
  assert.equal(cellText("phase", NaN, ""), "–");
  assert.equal(cellText("x", 0.0012345, "m"), "1.234");
});

test("times are m:ss.mmm, and carry into minutes and hours", () => {
  assert.equal(clock(5.05), "0:05.050");
  assert.equal(clock(59.9996), "1:00.000");
  assert.equal(clock(3599.99, 1), "1:00:00.0");
  assert.equal(clock(36000, 0), "10:00:00");
  assert.equal(clock(-90, 0), "−1:30");
  assert.equal(clock(-0.2, 0), "0:00");
  assert.equal(clock(NaN), "–");
  assert.equal(lagWord(3.21), "3.2 s");
  assert.equal(lagWord(75), "1:15");
});

test("speeds go from 0.05 to 8 in steps and stay within", () => {
  let s = 1;
  const up = [];
  for (let i = 0; i < 5; i++) up.push((s = nextSpeed(s, 1)));
  assert.deepEqual(up, [2, 4, 8, 8, 8]);
  const down = [];
  for (let i = 0; i < 9; i++) down.push((s = nextSpeed(s, -1)));
  assert.deepEqual(down, [4, 2, 1, 0.5, 0.25, 0.1, 0.05, 0.05, 0.05]);
});

test("a control is shown in its unit, a share in per cent, a switch in words", () => {
  const c = { kind: "number", least: 0, largest: 1, step: 0.05 };
  assert.equal(controlText({ ...c, unit: "" }, 0.6), "60 %");
  assert.equal(controlText({ ...c, unit: "m", step: 0.0005 }, 0.0072), "7.2 mm");
  assert.equal(controlText({ ...c, unit: "N/m", step: 10 }, 180), "180 N/m");
  assert.equal(controlText({ ...c, unit: "", kind: "switch" }, 1), "on");
});

test("the largest value of a control follows its reason", () => {
  const c = { kind: "number", least: 0, largest: 180, step: 10, unit: "N/m" };
  assert.equal(limitText({ ...c, because: "" }), "180 N/m");
  assert.equal(limitText({ ...c, because: "stability limit of this device" }), "180 N/m (stability limit of this device)");
});

test("the buttons of a control move it by one step and not beyond its limits", () => {
  const c = { least: 0.003, largest: 0.01, step: 0.0005 };
  assert.equal(stepped(c, 0.0072, 1).toFixed(6), "0.007700");
  assert.equal(stepped(c, 0.01, 1), 0.01);
  assert.equal(stepped(c, 0.0031, -1), 0.003);
  assert.ok(stepped({ least: 0, largest: 10, step: 0 }, 5, 1) > 5);
});

test("the buttons of a control with a ratio change it by a share of its present value, as the keys of the terminal", () => {
  const c = { least: 0, largest: 5560, step: 55.6, ratio: 1.1 };
  assert.equal(stepped(c, 556, 1).toFixed(4), "611.6000");
  assert.equal(stepped(c, 611.6, -1).toFixed(4), "556.0000");
  assert.equal(stepped(c, 5500, 1), 5560);
  assert.equal(stepped(c, 0, 1), 55.6, "a factor would leave 0 at 0");
});

test("the keys + and - send what the session has, or nothing", () => {
  const list = (...names) => names.map((name) => ({ name }));
  assert.equal(strengthLine(list("kp", "kd", "observer"), 1), "gains * 1.1");
  assert.equal(strengthLine(list("gains"), -1), "gains / 1.1");
  assert.equal(strengthLine(list("radius", "stiffness"), 1), "stiffness * 1.1");
  assert.equal(strengthLine(list("radius", "stiffness"), -1), "stiffness / 1.1");
  assert.equal(strengthLine(list("assist"), 1), "");
  assert.equal(strengthLine([], -1), "");
});

test("only a programme whose repetition runs pauses after the repetition, and only a recording resumes with one press", () => {
  for (const verb of ["play", "guide", "record"]) assert.doesNotMatch(pauseWords(verb, true).pause + pauseWords(verb, true).paused, /repetition/);
  assert.equal(pauseWords("run", true).pause, "Pause after this repetition");
  assert.doesNotMatch(pauseWords("run", false).pause, /repetition/);
  assert.deepEqual(["play", "guide", "run", "record"].filter((verb) => pauseWords(verb, true).then === ""), ["record"]);
});

test("a control's command is a name and a number in SI", () => {
  assert.equal(controlLine("radius", 0.1 + 0.2), "radius 0.3");
  assert.equal(controlLine("kp", 2000), "kp 2000");
});

test("an exercise whose repetitions were all skipped is not done", () => {
  const e = { repetitions: 3, done: 0, skipped: 0 };
  assert.equal(exerciseState(e, true), "current");
  assert.equal(exerciseState({ ...e, done: 2 }, false), "");
  assert.equal(exerciseState({ ...e, done: 2, skipped: 1 }, false), "done");
  assert.equal(exerciseState({ ...e, skipped: 3 }, false), "skipped");
});

test("the trend in words says which repetition was skipped, without its deviation", () => {
  const t = { exercise: 0, repetition: 2, rms_m: 0.004, help: 0.5, target_m: null, time_in_tunnel: null, partial: true, skipped: true };
  assert.equal(trendWords([t]), "repetition 2: skipped.");
});

test("the trend in words names what was not complete, and leaves out what was not measured", () => {
  const t = { exercise: 0, target_m: null, time_in_tunnel: null };
  assert.equal(trendWords([{ ...t, repetition: 1, rms_m: 0.0042, help: 0.9, partial: false }, { ...t, repetition: 2, rms_m: null, help: null, partial: false }, { ...t, repetition: 3, rms_m: 0.003, help: null, partial: true }]), "repetition 1: 4.2 mm, help 90 %; repetition 3: 3.0 mm, not complete.");
  assert.equal(trendWords([]), "No repetition is finished yet.");
});
