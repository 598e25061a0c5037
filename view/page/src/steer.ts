// Mouse, pen, touch, gamepad and keys as a hand: a person's intention for a simulated hand. The device answers by itself;
// a ring shows the intention apart from the tool.
import type { Client } from "./client";
import { lettersOn } from "./keys";
import type { Model } from "./model";
import { Depth, Input } from "./protocol";
import { clampTo, gripOf, Hand, stick } from "./scene/hand";
import type { Triple } from "./scene/nearest";
import type { SceneView } from "./scene/scene";

// Least and largest time between two messages while the hand is held [ms].
const LEAST_GAP = 8;
const LARGEST_GAP = 90;
// A press this far from the tool's edge still holds it [CSS px].
const MARGIN = 8;
const TOUCH_RADIUS = 26;
const STICK_SPEED = 0.15; // [m/s]
const KEY_SPEED = 0.04; // [m/s]
const SLOW_KEY_SPEED = 0.01; // [m/s]
const PLANE_STEP = 0.001; // [m]

const GAMEPAD_STOP = 1;
const GAMEPAD_TRIGGER = 7;

const NAMES: Record<Input, string> = {
  [Input.mouse]: "mouse",
  [Input.pen]: "pen",
  [Input.touch]: "touch",
  [Input.gamepad]: "gamepad",
  [Input.keys]: "keys",
};

export interface Steering {
  // The session has a simulated hand that this page may steer.
  readonly available: boolean;
  // Input that holds the hand now, as words; "" if none does.
  readonly holding: string;
  // Reads the gamepad and the keys. Called once a frame, with performance.now() [ms].
  frame(now: number): void;
  // Lets go at once.
  release(): void;
  dispose(): void;
}

export function createSteering(scene: SceneView, model: Model, client: Client): Steering {
  return new SteeringOfScene(scene, model, client);
}

interface Grasp {
  input: Input;
  hand: Hand;
  grip: number;
  // Pointer that holds; -1 for gamepad and keys.
  pointer: number;
  // From the pointer to the tool's place on the screen at the press [CSS px]: the ball does not jump to the pointer.
  offsetX: number;
  offsetY: number;
  lastX: number;
  lastY: number;
  lastTime: number;
}

class SteeringOfScene implements Steering {
  private grasp: Grasp | null = null;
  private lastSent = -Infinity;
  private waiting = 0;
  private readonly timer: number;
  private readonly keys = new Set<string>();
  private slow = false;
  private lastFrame = NaN;
  private stopWasDown = false;
  private everHeld = false;
  private readonly hint = document.createElement("div");
  private readonly hintText = document.createElement("span");
  private readonly hintButton = document.createElement("button");
  private readonly abort = new AbortController();
  private readonly raw: boolean;

  constructor(
    private readonly scene: SceneView,
    private readonly model: Model,
    private readonly client: Client,
  ) {
    const signal = this.abort.signal;
    scene.claim = (event) => this.press(event);
    scene.claimWheel = (event) => {
      if (this.grasp === null || this.grasp.hand.fromPath) return false;
      this.shift(event.deltaY < 0 ? 1 : -1);
      return true;
    };
    const { target } = scene;
    this.raw = "onpointerrawupdate" in target && window.isSecureContext;
    if (this.raw) target.addEventListener("pointerrawupdate", (event) => this.drag(event as PointerEvent), { signal });
    target.addEventListener(
      "pointermove",
      (event) => {
        if (!this.raw) this.drag(event);
        if (this.grasp === null) this.hover(event);
      },
      { signal },
    );
    for (const type of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
      target.addEventListener(type, (event) => {
        if (this.grasp?.pointer === event.pointerId) this.release();
      }, { signal });
    }
    window.addEventListener("blur", () => this.release(), { signal });
    window.addEventListener("pagehide", () => this.release(), { signal });
    document.addEventListener("visibilitychange", () => {
      if (document.visibilityState === "hidden") this.release();
    }, { signal });
    // In the capture phase: while the keys hold the hand, the arrows do not seek.
    window.addEventListener("keydown", (event) => this.keyDown(event), { signal, capture: true });
    window.addEventListener("keyup", (event) => this.keys.delete(keyOf(event)), { signal, capture: true });
    this.timer = window.setInterval(() => this.again(), 30);
    const stop = model.on("connection", () => {
      if (!model.connected) this.release();
    });
    signal.addEventListener("abort", stop);
    this.hint.className = "scene-hint";
    this.hintText.setAttribute("role", "status");
    this.hintButton.type = "button";
    this.hintButton.className = "scene-hint-button";
    this.hintButton.addEventListener("click", () => this.toggleKeys(), { signal });
    this.hint.append(this.hintText, this.hintButton);
    scene.host.append(this.hint);
  }

  get available(): boolean {
    return this.model.hello?.steer === true && this.model.live;
  }

  get holding(): string {
    return this.grasp === null ? "" : NAMES[this.grasp.input];
  }

  frame(now: number): void {
    const dt = Number.isFinite(this.lastFrame) ? Math.min(0.1, Math.max(0, (now - this.lastFrame) / 1000)) : 0;
    this.lastFrame = now;
    this.readGamepad(dt);
    const grasp = this.grasp;
    if (grasp !== null && grasp.input === Input.keys) this.moveByKeys(grasp, dt);
    if (grasp !== null && !this.available) this.release();
    this.say();
  }

  release(): void {
    const grasp = this.grasp;
    this.keys.clear();
    if (grasp === null) return;
    this.grasp = null;
    window.clearTimeout(this.waiting);
    this.waiting = 0;
    const [x, y, z] = grasp.hand.at;
    const depth = grasp.hand.fromPath ? Depth.path : Depth.plane;
    this.client.intention({ x, y, z, grip: 0, input: grasp.input, depth });
    this.lastSent = performance.now();
    this.scene.target.style.cursor = "";
    this.show();
  }

  dispose(): void {
    this.release();
    this.abort.abort();
    window.clearInterval(this.timer);
    this.scene.claim = null;
    this.scene.claimWheel = null;
    this.hint.remove();
  }

  // --- pointer ----------------------------------------------------------------------------------------------------------

  private press(event: PointerEvent): boolean {
    // A second finger or button neither holds nor turns while a pointer holds.
    if (this.grasp !== null && this.grasp.pointer >= 0) return true;
    if (!this.available || event.button !== 0 || !this.near(event)) return false;
    const input = event.pointerType === "pen" ? Input.pen : event.pointerType === "touch" ? Input.touch : Input.mouse;
    const tool = this.tool();
    const place = tool === null ? null : this.scene.place(...tool);
    if (tool === null || place === null) return false;
    this.release();
    this.scene.target.setPointerCapture(event.pointerId);
    const grasp = this.take(input, tool, event.pointerId);
    grasp.offsetX = place.x - event.clientX;
    grasp.offsetY = place.y - event.clientY;
    grasp.lastX = event.clientX;
    grasp.lastY = event.clientY;
    grasp.lastTime = event.timeStamp;
    grasp.grip = input === Input.pen ? gripOf(event.pressure) : 1;
    this.scene.target.style.cursor = "grabbing";
    this.send();
    return true;
  }

  private drag(event: PointerEvent): void {
    const grasp = this.grasp;
    if (grasp === null || event.pointerId !== grasp.pointer) return;
    const all = event.getCoalescedEvents?.() ?? [];
    for (const step of all.length > 0 ? all : [event]) {
      if (grasp.input === Input.pen) grasp.grip = gripOf(step.pressure);
      const dt = (step.timeStamp - grasp.lastTime) / 1000;
      grasp.lastX = step.clientX;
      grasp.lastY = step.clientY;
      grasp.lastTime = step.timeStamp;
      grasp.hand.move(this.scene.ray(step.clientX + grasp.offsetX, step.clientY + grasp.offsetY), dt);
    }
    this.send();
  }

  private hover(event: PointerEvent): void {
    const over = this.available && event.buttons === 0 && this.near(event);
    const cursor = over ? "grab" : "";
    if (this.scene.target.style.cursor !== cursor) this.scene.target.style.cursor = cursor;
  }

  private near(event: PointerEvent): boolean {
    const tool = this.tool();
    const place = tool === null ? null : this.scene.place(...tool);
    if (place === null) return false;
    const reach = Math.max(this.scene.picture.toolSize + MARGIN, event.pointerType === "touch" ? TOUCH_RADIUS : 0);
    return Math.hypot(event.clientX - place.x, event.clientY - place.y) <= reach;
  }

  private tool(): Triple | null {
    const tool: Triple = [this.model.value("x"), this.model.value("y"), this.model.value("z")];
    return Number.isFinite(tool[0] + tool[1] + tool[2]) ? tool : null;
  }

  private take(input: Input, tool: Triple, pointer: number): Grasp {
    const place = this.scene.place(...tool) ?? { x: 0, y: 0 };
    // Sticks give all three coordinates.
    const path = input === Input.gamepad ? null : this.scene.picture.path;
    const hand = new Hand(path, tool, this.scene.ray(place.x, place.y), this.view());
    this.grasp = {
      input,
      hand,
      grip: 1,
      pointer,
      offsetX: 0,
      offsetY: 0,
      lastX: place.x,
      lastY: place.y,
      lastTime: performance.now(),
    };
    this.everHeld = true;
    return this.grasp;
  }

  private view(): Triple {
    const { back } = this.scene.axes();
    return [-back[0], -back[1], -back[2]];
  }

  // Moves the drawing plane by notches, away from the eye if positive.
  private shift(notches: number): void {
    const grasp = this.grasp;
    if (grasp === null) return;
    grasp.hand.shiftPlane(notches * PLANE_STEP, this.view());
    if (grasp.pointer >= 0) {
      grasp.hand.move(this.scene.ray(grasp.lastX + grasp.offsetX, grasp.lastY + grasp.offsetY), 0);
    }
    this.send();
  }

  // --- keys -------------------------------------------------------------------------------------------------------------

  private keyDown(event: KeyboardEvent): void {
    if (event.ctrlKey || event.altKey || event.metaKey || isTyping(event.target)) return;
    const key = keyOf(event);
    this.slow = event.shiftKey;
    const letters = lettersOn();
    if (key === "h" && letters && this.available && !event.repeat) {
      this.toggleKeys();
    } else if (this.grasp === null) {
      return;
    } else if (letters && (key === "q" || key === "e")) {
      if (this.grasp.hand.fromPath) return;
      this.shift(key === "e" ? 1 : -1);
    } else if (this.grasp.input === Input.keys && key.startsWith("arrow")) {
      this.keys.add(key);
    } else {
      return;
    }
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  private toggleKeys(): void {
    if (this.grasp?.input === Input.keys) {
      this.release();
      return;
    }
    const tool = this.tool();
    if (tool === null) return;
    this.release();
    this.take(Input.keys, tool, -1);
    this.send();
  }

  private moveByKeys(grasp: Grasp, dt: number): void {
    const down = (name: string): number => (this.keys.has(name) ? 1 : 0);
    const x = down("arrowright") - down("arrowleft");
    const y = down("arrowup") - down("arrowdown");
    if (x === 0 && y === 0) return;
    const speed = (this.slow ? SLOW_KEY_SPEED : KEY_SPEED) / Math.hypot(x, y);
    this.slide(grasp, x * speed * dt, y * speed * dt, dt);
  }

  // Moves the intention across the screen by metres at its depth; the depth follows as for a pointer.
  private slide(grasp: Grasp, right: number, up: number, dt: number): void {
    const axes = this.scene.axes();
    const at = grasp.hand.at;
    const wish = [0, 1, 2].map((k) => at[k]! + right * axes.right[k]! + up * axes.up[k]!) as Triple;
    const place = this.scene.place(...wish);
    if (place === null) return;
    grasp.hand.move(this.scene.ray(place.x, place.y), dt);
    this.send();
  }

  // --- gamepad ----------------------------------------------------------------------------------------------------------

  private readGamepad(dt: number): void {
    const pads = typeof navigator.getGamepads === "function" ? navigator.getGamepads() : [];
    const pad = [...pads].find((p) => p !== null && p.connected && p.axes.length >= 2) ?? null;
    if (pad === null) {
      if (this.grasp?.input === Input.gamepad) this.release();
      return;
    }
    const stopDown = pad.buttons[GAMEPAD_STOP]?.pressed === true;
    if (stopDown && !this.stopWasDown && this.model.hello?.live === true) {
      this.release();
      this.client.stop();
    }
    this.stopWasDown = stopDown;
    const grip = pad.buttons[GAMEPAD_TRIGGER]?.value ?? 0;
    if (grip < 0.05 || !this.available || stopDown) {
      if (this.grasp?.input === Input.gamepad) this.release();
      return;
    }
    let grasp = this.grasp;
    if (grasp === null) {
      const tool = this.tool();
      if (tool === null) return;
      grasp = this.take(Input.gamepad, tool, -1);
    }
    if (grasp.input !== Input.gamepad) return;
    grasp.grip = grip;
    const right = stick(pad.axes[0] ?? 0, STICK_SPEED) * dt;
    const up = -stick(pad.axes[1] ?? 0, STICK_SPEED) * dt;
    const away = -stick(pad.axes[3] ?? 0, STICK_SPEED) * dt;
    grasp.hand.slide(this.scene.axes(), right, up, away);
    this.send();
  }

  // --- sending ----------------------------------------------------------------------------------------------------------

  // Sends the intention now, or as soon as the last message is 8 ms old.
  private send(): void {
    this.show();
    if (this.waiting !== 0) return;
    const wait = this.lastSent + LEAST_GAP - performance.now();
    if (wait <= 0) {
      this.sendNow();
      return;
    }
    this.waiting = window.setTimeout(() => {
      this.waiting = 0;
      this.sendNow();
    }, Math.ceil(wait));
  }

  private sendNow(): void {
    const grasp = this.grasp;
    if (grasp === null) return;
    const [x, y, z] = this.bounded(grasp.hand.at);
    const depth = grasp.hand.fromPath ? Depth.path : Depth.plane;
    this.client.intention({ x, y, z, grip: grasp.grip, input: grasp.input, depth });
    this.lastSent = performance.now();
  }

  // A pointer at rest sends no events; the server lets go after 0.3 s of silence.
  private again(): void {
    if (this.grasp !== null && performance.now() - this.lastSent >= LARGEST_GAP - 30) this.sendNow();
  }

  private bounded(at: Triple): Triple {
    const box = this.model.recording?.device.workspace;
    return box === undefined ? at : clampTo(at, box.min, box.max);
  }

  private show(): void {
    const p = this.scene.picture;
    const grasp = this.grasp;
    p.intention.visible = grasp !== null;
    const sheet = grasp === null || grasp.input === Input.gamepad ? null : grasp.hand.sheet;
    p.sheet.visible = sheet !== null;
    if (grasp !== null) p.intention.at = this.bounded(grasp.hand.at);
    if (sheet !== null) {
      // The sheet spans the workspace; without one, the surroundings of the hand.
      const box = this.model.recording?.device.workspace;
      p.sheet.axis = sheet.axis;
      for (const k of [0, 1, 2] as const) {
        p.sheet.at[k] = box === undefined || k === sheet.axis ? grasp!.hand.at[k] : (box.min[k] + box.max[k]) / 2;
        p.sheet.half[k] = box === undefined ? 0.05 : (box.max[k] - box.min[k]) / 2;
      }
    }
    this.scene.invalidate();
  }

  private say(): void {
    const grasp = this.grasp;
    const ready = this.available && this.tool() !== null;
    let text = "";
    if (grasp !== null) {
      const depth =
        grasp.input === Input.gamepad
          ? "right stick: depth"
          : grasp.hand.fromPath
            ? "depth from the path"
            : "wheel or Q and E: depth";
      text = grasp.input === Input.keys ? `Arrow keys move the hand, ${depth}.` : `Held by ${this.holding}, ${depth}.`;
    } else if (ready && !this.everHeld) {
      text = "Press the ball and move it.";
    }
    // Also where letters are no keys, the hand can be taken without a pointer.
    const button = grasp?.input === Input.keys ? "Let go (H)" : "Hold by keys (H)";
    this.hint.hidden = !ready;
    this.hintButton.hidden = grasp !== null && grasp.input !== Input.keys;
    if (this.hintText.textContent !== text) this.hintText.textContent = text;
    if (this.hintButton.textContent !== button) this.hintButton.textContent = button;
  }
}

function keyOf(event: KeyboardEvent): string {
  return event.key.toLowerCase();
}

function isTyping(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && (target.isContentEditable || /^(input|textarea|select)$/i.test(target.tagName));
}
