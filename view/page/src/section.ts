// The section of the tunnel: a disc seen along the path, with a dot where the tool is. It shows the error in depth that a
// flat picture of the scene hides.
import type { Model } from "./model";
import { nearestToPoint } from "./scene/nearest";
import { directionAt } from "./scene/polyline";
import type { SceneView } from "./scene/scene";
import { readTheme, mix, type Theme } from "./scene/theme";
import { rightOf, sectionAxes, type SectionAxes } from "./scene/plane";

const TRAIL_SECONDS = 0.9;
const TRAIL_STEP = 0.012;
// The disc takes this share of the picture; a dot outside the tunnel has the rest.
const DISC = 0.66;

export interface SectionOptions {
  // Writes the radius below the disc. The training screen shows no numbers while the hand moves.
  words?: boolean;
}

export interface Section {
  draw(now: number): void;
  dispose(): void;
}

export function createSection(canvas: HTMLCanvasElement, model: Model, scene: SceneView, options: SectionOptions = {}): Section {
  const words = options.words !== false;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  canvas.setAttribute("role", "img");
  canvas.classList.add("section");
  let key = "";
  let axes: SectionAxes | null = null;
  let theme: Theme = readTheme(canvas);
  let themeDue = 0;
  let textDue = 0;
  const tangent = [0, 0, 0];

  function draw(now: number): void {
    if (context === null) return;
    const line = scene.picture.path;
    const radius = model.value("radius");
    const place = [model.value("rx"), model.value("ry"), model.value("rz")];
    const tool = [model.value("x"), model.value("y"), model.value("z")];
    const known = line.count > 1 && radius > 0 && Number.isFinite(place[0]! + place[1]! + place[2]!);
    if (now >= themeDue) {
      themeDue = now + 500;
      theme = readTheme(canvas);
    }
    const box = canvas.getBoundingClientRect();
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const width = Math.round(box.width * ratio);
    const height = Math.round(box.height * ratio);
    const camera = scene.camera;
    const next = [model.shown, model.dataVersion, width, height, camera.azimuth, camera.elevation, theme.background, known].join();
    if (next === key || width < 8 || height < 8) return;
    key = next;
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, box.width, box.height);
    canvas.classList.toggle("section-empty", !known);
    if (!known) {
      if (now >= textDue) {
        textDue = now + 1000;
        canvas.setAttribute("aria-label", "Section of the tunnel. There is no tunnel here.");
      }
      return;
    }
    const progress = model.value("progress");
    // Near the known place first: a path that crosses itself has two places that are equally near.
    const from = Number.isFinite(progress) ? progress - 0.02 : -Infinity;
    let at = nearestToPoint(line, place, from, Number.isFinite(progress) ? progress + 0.02 : Infinity);
    if (!Number.isFinite(at)) at = nearestToPoint(line, place, -Infinity, Infinity);
    directionAt(line, at, tangent);
    axes = sectionAxes(tangent, scene.axes(), axes);
    paint(context, box.width, box.height, radius, tool, place, axes);
    if (now >= textDue) {
      textDue = now + 1000;
      canvas.setAttribute("aria-label", describe(radius, rightOf(axes, tool, place)));
    }
  }

  function paint(
    c: CanvasRenderingContext2D,
    width: number,
    height: number,
    radius: number,
    tool: number[],
    place: number[],
    a: SectionAxes,
  ): void {
    const text = words ? 22 : 0;
    const cx = width / 2;
    const cy = (height - text) / 2;
    const disc = DISC * Math.min(cx, cy);
    const scale = disc / radius;
    const [dx, dy] = rightOf(a, tool, place);
    const off = Math.hypot(dx, dy);
    const outside = off > radius;
    // Beyond the edge of the picture the dot stays at the edge: the bar still says which way.
    const most = Math.min(cx, cy) - 8;
    const held = off > 0 ? Math.min(1, most / (off * scale)) : 1;
    const x = cx + dx * scale * held;
    const y = cy - dy * scale * held;

    c.lineWidth = 2;
    c.beginPath();
    c.arc(cx, cy, disc, 0, 2 * Math.PI);
    c.fillStyle = mix(theme.path, theme.background, 0.87);
    c.fill();
    c.strokeStyle = outside ? theme.stop : theme.path;
    c.stroke();
    c.lineWidth = 1;
    c.strokeStyle = theme.path;
    c.beginPath();
    c.arc(cx, cy, disc / 2, 0, 2 * Math.PI);
    c.stroke();
    c.strokeStyle = theme.second;
    c.beginPath();
    c.moveTo(cx - 4, cy);
    c.lineTo(cx + 4, cy);
    c.moveTo(cx, cy - 4);
    c.lineTo(cx, cy + 4);
    c.stroke();

    trail(c, cx, cy, scale, most, a);
    if (outside) {
      c.strokeStyle = theme.stop;
      c.lineWidth = 3;
      c.beginPath();
      c.moveTo(cx + (dx / off) * disc, cy - (dy / off) * disc);
      c.lineTo(x, y);
      c.stroke();
    }
    if (Number.isFinite(x + y)) {
      c.beginPath();
      c.arc(x, y, 6.5, 0, 2 * Math.PI);
      c.fillStyle = outside ? theme.stop : theme.actual;
      c.fill();
      c.strokeStyle = theme.background;
      c.lineWidth = 1.5;
      c.stroke();
    }
    if (words) {
      c.font = "13px system-ui, sans-serif";
      c.textAlign = "center";
      c.textBaseline = "alphabetic";
      c.fillStyle = theme.second;
      c.fillText(`tunnel ${(1000 * radius).toFixed(1)} mm`, cx, height - 6);
    }
  }

  function trail(c: CanvasRenderingContext2D, cx: number, cy: number, scale: number, most: number, a: SectionAxes): void {
    const columns = ["x", "y", "z", "rx", "ry", "rz"].map((name) => model.column(name));
    if (columns.some((column) => column < 0)) return;
    const shown = model.shown;
    let lastX = NaN;
    let lastY = NaN;
    c.strokeStyle = theme.actual;
    c.lineCap = "butt";
    const p = [0, 0, 0];
    const r = [0, 0, 0];
    model.eachRow(shown - TRAIL_SECONDS, shown, TRAIL_STEP, (source, row) => {
      for (let k = 0; k < 3; k++) {
        p[k] = source.value(columns[k]!, row);
        r[k] = source.value(columns[k + 3]!, row);
      }
      const [dx, dy] = rightOf(a, p, r);
      const held = Math.min(1, most / Math.max(1e-9, Math.hypot(dx, dy) * scale));
      const x = cx + dx * scale * held;
      const y = cy - dy * scale * held;
      if (Number.isFinite(lastX + x + y)) {
        const fresh = Math.max(0, 1 - (shown - source.timeOf(row)) / TRAIL_SECONDS);
        c.globalAlpha = 0.6 * fresh;
        c.lineWidth = 1 + 2.5 * fresh;
        c.beginPath();
        c.moveTo(lastX, lastY);
        c.lineTo(x, y);
        c.stroke();
      }
      lastX = x;
      lastY = y;
    });
    c.globalAlpha = 1;
  }

  return {
    draw,
    dispose() {
      canvas.classList.remove("section", "section-empty");
    },
  };
}

// Says in words where the tool is in the section.
export function describe(radius: number, [right, up]: readonly [number, number]): string {
  const off = Math.hypot(right, up);
  const mm = (value: number): string => `${(1000 * Math.abs(value)).toFixed(1)} mm`;
  const start = `Section of the tunnel. Its radius is ${mm(radius)}.`;
  if (!Number.isFinite(off)) return `${start} The place of the tool is not known.`;
  const parts = [];
  if (Math.abs(up) >= 5e-5) parts.push(`${mm(up)} ${up > 0 ? "above" : "below"}`);
  if (Math.abs(right) >= 5e-5) parts.push(`${mm(right)} to the ${right > 0 ? "right" : "left"}`);
  const where = parts.length > 0 ? `The tool is ${parts.join(" and ")} of the middle` : "The tool is in the middle";
  return `${start} ${where}, ${off > radius ? "outside" : "inside"} the tunnel.`;
}
