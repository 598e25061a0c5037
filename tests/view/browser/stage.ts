// A scene with a synthetic session, without a server: what the tests of the scene open in a browser.
import { Model } from "../../../view/page/src/model";
import { decodeFrame, type MeshFrame, type PathFrame, type RowsFrame, type ServerMessage } from "../../../view/page/src/protocol";
import { createScene, type SceneOptions, type SceneView } from "../../../view/page/src/scene/scene";
import { createSection } from "../../../view/page/src/section";
import { createSteering } from "../../../view/page/src/steer";
import { createTrainee } from "../../../view/page/src/trainee";

const COLUMNS = ["x", "y", "z", "rx", "ry", "rz", "fx", "fy", "fz", "progress", "radius", "deviation", "force", "speed"];
const RATE = 1000;
const SIZE = 0.04;

function place(time: number): [number, number, number] {
  const angle = 0.5 * time;
  return [SIZE * Math.cos(angle), SIZE * Math.sin(angle), 0.01 * Math.sin(3 * angle)];
}

function row(time: number): number[] {
  const r = place(time);
  const p = [r[0] + 0.002 * Math.sin(5 * time), r[1], r[2] + 0.002 * Math.cos(4 * time)];
  const force = [-1.2, 0.4, 0.6];
  const deviation = Math.hypot(p[0]! - r[0], p[2]! - r[2]);
  return [...p, ...r, ...force, 0.5 * SIZE * time, 0.005, deviation, Math.hypot(...force), 0.02];
}

function rows(from: number, to: number): RowsFrame {
  const count = Math.round((to - from) * RATE);
  const planes = COLUMNS.map(() => new Float32Array(count));
  const time = new Float32Array(count);
  for (let i = 0; i < count; i++) {
    time[i] = i / RATE;
    row(from + i / RATE).forEach((value, c) => (planes[c]![i] = value));
  }
  const header = { kind: 1, version: 1, flags: 0, sequence: 0, rows: count, request: 0, t0: from, sent: 0 };
  return { kind: 1, header, time, planes } as RowsFrame;
}

// A path of `points` points along the first `share` of the circle; `shift` moves it [m].
function path(id: number, points: number, share = 1, shift = 0): PathFrame {
  const plane = (f: (u: number) => number): Float32Array => Float32Array.from({ length: points }, (_, i) => f((share * i) / (points - 1)));
  const end = 4 * Math.PI;
  return {
    kind: 4,
    header: { kind: 4, version: 1, flags: 0, sequence: 0, rows: points, request: id, t0: 0, sent: 0 },
    time: plane((u) => u * end),
    x: plane((u) => place(u * end)[0] + shift),
    y: plane((u) => place(u * end)[1]),
    z: plane((u) => place(u * end)[2]),
    radius: plane(() => 0.005),
    length: plane((u) => 0.5 * SIZE * u * end),
  } as PathFrame;
}

class Stage {
  readonly model = new Model();
  readonly sent: unknown[] = [];
  readonly client = {
    stop: () => this.note(["stop"]),
    shown: (...values: unknown[]) => this.note(["shown", ...values]),
    intention: (value: unknown) => this.note(["intention", performance.now(), value]),
  };
  scene!: SceneView;
  readonly times: number[] = [];
  drawn = 0;
  newest = 0;
  private readonly before: ((now: number) => void)[] = [];
  private readonly after: ((now: number) => void)[] = [];

  start(options: SceneOptions & { live?: boolean; columns?: boolean } = {}): void {
    const take = (message: unknown): void => this.model.take(message as ServerMessage);
    take({ type: "hello", version: 1, role: "viewer", software: "", live: true, control: false, steer: true, on_page_lost: "", recordings: [] });
    take({
      type: "recording", index: 0, name: "stage", title: "", subject: "", session: "", verb: "guide", mode: "tunnel", rate_hz: RATE,
      start: 0, end: 0, device: { name: "sim", model: "", workspace: { min: [-0.1, -0.1, -0.1], max: [0.1, 0.1, 0.1] } },
      columns: COLUMNS.map((name) => ({ name, unit: "" })), limits: {}, input: "", virtual_time: true,
    });
    this.model.setConnected(true);
    this.path(1, 400);
    this.rows(3);
    this.scene = createScene(document.querySelector<HTMLElement>("#stage")!, this.model, options);
    const frame = (now: number): void => {
      const began = performance.now();
      this.model.tick(now / 1000);
      this.model.refreshMovement(now / 1000);
      for (const step of this.before) step(now);
      if (this.scene.draw(now)) this.drawn++;
      for (const step of this.after) step(now);
      this.times.push(performance.now() - began);
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  steer(): void {
    const steering = createSteering(this.scene, this.model, this.client as never);
    this.before.push((now) => steering.frame(now));
  }

  train(message: unknown): void {
    this.training(message);
    const trainee = createTrainee(this.scene.host.parentElement!, this.model, this.client as never, this.scene);
    this.before.push((now) => trainee.draw(now));
  }

  training(message: unknown): void {
    this.model.take(message as ServerMessage);
  }

  section(): void {
    const canvas = document.createElement("canvas");
    canvas.style.cssText = "position: absolute; width: 130px; height: 150px";
    this.scene.host.append(canvas);
    const section = createSection(canvas, this.model, this.scene);
    this.after.push((now) => section.draw(now));
  }

  path(id: number, points: number, share = 1, shift = 0): void {
    this.model.takePath(path(id, points, share, shift));
  }

  // Takes the messages of a scene as they come from a server: text, and bytes of meshes.
  take(messages: (string | number[])[]): void {
    for (const message of messages) {
      if (typeof message === "string") this.model.take(JSON.parse(message) as ServerMessage);
      else this.model.takeMesh(decodeFrame(new Uint8Array(message).buffer) as MeshFrame);
    }
  }

  // Shows the tool pressed into the object of a scene; its surface holds the tool back at the proxy.
  touch(tool: number[], object: number, proxy: number[], normal: number[]): void {
    const columns = ["x", "y", "z", "fx", "fy", "fz", "contact", "proxy_x", "proxy_y", "proxy_z", "normal_x", "normal_y", "normal_z"];
    this.model.take({ ...this.model.recording!, columns: columns.map((name) => ({ name, unit: "" })), session: `touch ${this.newest}` });
    const values = [...tool, ...normal.map((n) => 2 * n), object, ...proxy, ...normal];
    const header = { kind: 1, version: 1, flags: 0, sequence: 0, rows: 100, request: 0, t0: this.newest, sent: 0 };
    const time = Float32Array.from({ length: 100 }, (_, i) => i / RATE);
    this.model.takeRows({ kind: 1, header, time, planes: values.map((value) => new Float32Array(100).fill(value)) } as RowsFrame);
  }

  // Adds rows until `time` [s].
  rows(time: number): void {
    this.model.takeRows(rows(this.newest, time));
    this.newest = time;
  }

  // Colour of the canvas at a place of the picture, drawn anew.
  pixel(x: number, y: number): number[] {
    this.scene.invalidate();
    this.scene.draw(performance.now());
    const copy = document.createElement("canvas");
    copy.width = copy.height = 1;
    const context = copy.getContext("2d")!;
    const ratio = this.scene.canvas.width / this.scene.camera.width;
    context.drawImage(this.scene.canvas, Math.round(x * ratio), Math.round(y * ratio), 1, 1, 0, 0, 1, 1);
    return [...context.getImageData(0, 0, 1, 1).data].slice(0, 3);
  }

  private note(entry: unknown): true {
    this.sent.push(entry);
    return true;
  }
}

(window as unknown as { stage: Stage }).stage = new Stage();
