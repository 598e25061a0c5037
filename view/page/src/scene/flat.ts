// Draws a picture on a 2-D canvas where the browser has no WebGL: path, tunnel as a band, movement, trail, tool, force.
import { axesOf, metresPerPixel, projectWith } from "./camera";
import { ARROW_SCALE, GAP, NORMAL_LENGTH, OBJECT_ALPHA, objectColour, UNKNOWN, type Painter, type Picture } from "./picture";
import { cividis, cssColour, mix, parseColour } from "./theme";

export function createFlatPainter(canvas: HTMLCanvasElement): Painter {
  // Without a GPU a canvas that the processor reads is several times faster to draw.
  const context = canvas.getContext("2d", { willReadFrequently: true, alpha: false });
  if (context === null) throw new Error("This browser draws neither WebGL nor a 2-D canvas.");
  let width = 1;
  let height = 1;
  let ratio = 1;
  const spot = [0, 0, 0];
  const objects = new Layer();
  const band = new Layer();

  const draw = (p: Picture): void => {
    const c = context;
    const axes = axesOf(p.camera);
    const t = p.theme;
    const at = (x: number, y: number, z: number): boolean => {
      projectWith(p.camera, axes, x, y, z, spot);
      return spot[2]! > 0 && Number.isFinite(spot[0]! + spot[1]!);
    };
    const line = (xyz: ArrayLike<number>, from: number, to: number): void => {
      c.beginPath();
      for (let i = from, started = false; i < to; i++) {
        if (!at(xyz[3 * i]!, xyz[3 * i + 1]!, xyz[3 * i + 2]!)) continue;
        if (started) c.lineTo(spot[0]!, spot[1]!);
        else c.moveTo(spot[0]!, spot[1]!);
        started = true;
      }
    };
    const stroke = (colour: string, size: number, alpha = 1): void => {
      c.globalAlpha = alpha;
      c.strokeStyle = colour;
      c.lineWidth = size;
      c.stroke();
      c.globalAlpha = 1;
    };
    const circle = (at3: readonly [number, number, number], radius: number): boolean => {
      if (!at(at3[0], at3[1], at3[2])) return false;
      c.beginPath();
      c.arc(spot[0]!, spot[1]!, radius, 0, 2 * Math.PI);
      return true;
    };

    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.lineJoin = "round";
    c.lineCap = "round";
    c.fillStyle = t.background;
    c.fillRect(0, 0, width, height);

    const f = p.floor;
    if (f.visible) {
      c.beginPath();
      const edge = (x0: number, y0: number, x1: number, y1: number): void => {
        if (!at(x0, y0, f.z)) return;
        c.moveTo(spot[0]!, spot[1]!);
        if (at(x1, y1, f.z)) c.lineTo(spot[0]!, spot[1]!);
      };
      for (let i = Math.round(f.x0 / f.step); i * f.step <= f.x1 + 1e-9; i++) edge(i * f.step, f.y0, i * f.step, f.y1);
      for (let i = Math.round(f.y0 / f.step); i * f.step <= f.y1 + 1e-9; i++) edge(f.x0, i * f.step, f.x1, i * f.step);
      stroke(t.path, 1, 0.3);
    }
    if (p.scene !== null && p.scene.objects.some((o) => o.shape !== null)) {
      objects.draw(c, p, ratio, `${p.scene.version} ${p.touched} ${p.theme.object}`, OBJECT_ALPHA + 0.1, (layer) => paintObjects(layer, p));
    }
    const path = p.path;
    if (p.showTunnel && path.count > 1) band.draw(c, p, ratio, String(p.pathVersion), 0.6, (layer) => tunnel(layer, p, at, spot));
    if (p.showPath && path.count > 1) {
      line(path.xyz, 0, path.count);
      stroke(t.path, 2);
      if (p.done > 0) {
        let end = 0;
        while (end < path.count && path.length[end]! <= p.done) end++;
        line(path.xyz, 0, end);
        stroke(t.actual, 2.6);
      }
    }
    const m = p.movement;
    if (p.showMovement && m.count > 1) {
      if (p.colour.mode === "one") {
        for (let from = 0, i = 0; i < m.count; i++) {
          if (i + 1 < m.count && m.value[i] !== GAP) continue;
          line(m.xyz, from, i + 1);
          stroke(mix(t.actual, t.background, 0.35), 1.7);
          from = i + 1;
        }
      } else {
        for (let i = 0; i + 1 < m.count; i++) {
          if (m.value[i] === GAP) continue;
          line(m.xyz, i, i + 2);
          const share = (m.value[i]! - p.colour.low) / Math.max(1e-12, p.colour.high - p.colour.low);
          const known = m.value[i] !== UNKNOWN;
          stroke(known ? cssColour(cividis(share, t.dark)) : mix(t.actual, t.background, 0.35), 1.7);
        }
      }
    }
    const tool = p.showTool && at(p.tool[0], p.tool[1], p.tool[2]);
    if (tool && f.visible) {
      line([...p.tool, p.tool[0], p.tool[1], f.z], 0, 2);
      stroke(t.path, 1, 0.7);
    }
    if (tool && p.showTrail) {
      for (let i = 0; i + 1 < p.trail.count; i++) {
        line(p.trail.xyz, i, i + 2);
        const fresh = Math.max(0, 1 - p.trail.age[i + 1]!);
        stroke(t.actual, 1.2 * p.toolSize * fresh, 0.5 * fresh);
      }
    }
    for (const ring of [p.goal, p.start]) {
      if (ring.visible && circle(ring.at, 1.6 * p.toolSize)) stroke(ring.colour, 0.5 * p.toolSize);
    }
    if (tool && p.deviation.visible) {
      line([...p.tool, ...p.reference], 0, 2);
      stroke(p.deviation.outside ? t.stop : t.second, p.deviation.outside ? 2.6 : 1.5);
    }
    if (tool && p.proxy.visible) proxy(c, p, at, spot);
    if (tool && p.arrow.visible) arrow(c, p, at, spot);
    if (tool && circle(p.tool, p.toolSize)) {
      c.fillStyle = t.actual;
      c.fill();
    }
    if (p.showReference && at(...p.reference)) {
      const r = 0.9 * p.toolSize;
      c.beginPath();
      for (const [dx, dy] of [[0, -r], [r, 0], [0, r], [-r, 0]] as const) c.lineTo(spot[0]! + dx, spot[1]! + dy);
      c.closePath();
      c.fillStyle = t.expert;
      c.fill();
    }
    if (p.intention.visible && circle(p.intention.at, 1.5 * p.toolSize)) stroke(t.text, 2);
    if (p.sheet.visible) sheet(c, p, at, spot);
  };

  return {
    kind: "flat",
    canvas,
    lost: false,
    resize(w, h, r) {
      width = w;
      height = h;
      ratio = r;
      canvas.width = Math.round(w * r);
      canvas.height = Math.round(h * r);
    },
    draw,
    memory: () => ({ geometries: 0, textures: 0 }),
    dispose: () => undefined,
  };
}

type At = (x: number, y: number, z: number) => boolean;

/** Draws the contact: a line from the tool to the surface, a ring there, and the normal. */
function proxy(c: CanvasRenderingContext2D, p: Picture, at: At, spot: number[]): void {
  const { at: place, normal } = p.proxy;
  if (!at(...place)) return;
  const [x, y, depth] = [spot[0]!, spot[1]!, spot[2]!];
  if (p.proxy.showNormal) {
    const length = NORMAL_LENGTH * p.toolSize * metresPerPixel(p.camera, depth);
    if (at(place[0] + length * normal[0], place[1] + length * normal[1], place[2] + length * normal[2])) {
      segment(c, x, y, spot[0]!, spot[1]!, p.theme.second, 2.5);
    }
  }
  if (at(...p.tool)) segment(c, spot[0]!, spot[1]!, x, y, p.theme.text, 2);
  c.beginPath();
  c.arc(x, y, 0.65 * p.toolSize, 0, 2 * Math.PI);
  c.strokeStyle = p.theme.text;
  c.lineWidth = 0.25 * p.toolSize;
  c.stroke();
}

function segment(c: CanvasRenderingContext2D, x0: number, y0: number, x1: number, y1: number, colour: string, width: number): void {
  c.beginPath();
  c.moveTo(x0, y0);
  c.lineTo(x1, y1);
  c.strokeStyle = colour;
  c.lineWidth = width;
  c.stroke();
}

/** More triangles than this are thinned: a canvas draws about this many in a frame. */
const MOST_TRIANGLES = 20000;

/**
 * Part of the picture that is kept until its key, the camera or the theme changes. It is drawn as one translucent picture,
 * so that what overlaps in it does not add up.
 */
class Layer {
  private readonly canvas = document.createElement("canvas");
  private key = "";

  draw(c: CanvasRenderingContext2D, p: Picture, ratio: number, own: string, alpha: number, paint: (c: CanvasRenderingContext2D) => void): void {
    const { centre, azimuth, elevation, distance, shiftX, shiftY, width, height } = p.camera;
    const key = [own, ...centre, azimuth, elevation, distance, shiftX, shiftY, width, height, ratio, p.theme.background, p.theme.path].join();
    if (key !== this.key) {
      this.key = key;
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
      const context = this.canvas.getContext("2d", { willReadFrequently: true });
      if (context === null) return;
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      context.lineJoin = "round";
      context.lineCap = "round";
      paint(context);
    }
    c.globalAlpha = alpha;
    c.drawImage(this.canvas, 0, 0, width, height);
    c.globalAlpha = 1;
  }
}

/** Fills the triangles of all objects, the farthest first. */
function paintObjects(c: CanvasRenderingContext2D, p: Picture): void {
  const axes = axesOf(p.camera);
  const spot = [0, 0, 0];
  const drawn: { depth: number; places: number[]; colour: string }[] = [];
  const all = p.scene!.objects.reduce((sum, o) => sum + (o.shape?.count ?? 0), 0);
  const step = Math.max(1, Math.ceil(all / MOST_TRIANGLES));
  p.scene!.objects.forEach(({ shape }, index) => {
    if (shape === null) return;
    const base = parseColour(objectColour(p, index));
    for (let t = 0; t < shape.count; t += step) {
      const places: number[] = [];
      let depth = 0;
      let behind = false;
      for (let j = 0; j < 3; j++) {
        const k = 9 * t + 3 * j;
        projectWith(p.camera, axes, shape.position[k]!, shape.position[k + 1]!, shape.position[k + 2]!, spot);
        behind ||= !(spot[2]! > 0);
        depth += spot[2]!;
        places.push(spot[0]!, spot[1]!);
      }
      if (behind) continue;
      const n = shape.face.subarray(3 * t, 3 * t + 3);
      const seen = (a: readonly number[]): number => n[0]! * a[0]! + n[1]! * a[1]! + n[2]! * a[2]!;
      const light = 0.66 + 0.34 * Math.abs(-0.4 * seen(axes.right) + 0.75 * seen(axes.up) + 0.53 * seen(axes.back));
      drawn.push({ depth, places, colour: cssColour([base[0] * light, base[1] * light, base[2] * light]) });
    }
  });
  drawn.sort((a, b) => b.depth - a.depth);
  c.lineWidth = 0.7;
  for (const { places, colour } of drawn) {
    c.beginPath();
    c.moveTo(places[0]!, places[1]!);
    c.lineTo(places[2]!, places[3]!);
    c.lineTo(places[4]!, places[5]!);
    c.closePath();
    c.fillStyle = c.strokeStyle = colour;
    c.fill();
    // Closes the fine gaps between neighbours.
    c.stroke();
  }
}

/** Stretches of a tunnel whose widths on the screen differ by less than this factor are drawn as one line. */
const EVEN = 1.08;

/** Draws the tunnel as a band as wide as it is, with an edge: on a flat canvas it takes the place of the glass. */
function tunnel(c: CanvasRenderingContext2D, p: Picture, at: At, spot: number[]): void {
  const { path, theme } = p;
  const step = Math.max(1, Math.floor(path.count / 400));
  const steps = Math.ceil((path.count - 1) / step);
  for (const [more, share] of [[2.5, 0.2], [0, 0.7]] as const) {
    c.strokeStyle = mix(theme.path, theme.background, share);
    let width = NaN;
    const end = (): void => {
      if (width === width) c.stroke();
      width = NaN;
    };
    for (let n = 0; n <= steps; n++) {
      const i = Math.min(n * step, path.count - 1);
      const k = 3 * i;
      const radius = path.radius[i]!;
      if (!(radius > 0) || !at(path.xyz[k]!, path.xyz[k + 1]!, path.xyz[k + 2]!)) {
        end();
        continue;
      }
      const [x, y] = [spot[0]!, spot[1]!];
      const size = (2 * radius) / metresPerPixel(p.camera, spot[2]!);
      if (width === width) c.lineTo(x, y);
      if (width === width && size < width * EVEN && size * EVEN > width) continue;
      const joins = width === width;
      end();
      c.beginPath();
      if (joins) {
        const b = 3 * (n - 1) * step;
        at(path.xyz[b]!, path.xyz[b + 1]!, path.xyz[b + 2]!);
        c.moveTo(spot[0]!, spot[1]!);
        c.lineTo(x, y);
      } else {
        c.moveTo(x, y);
      }
      width = size;
      c.lineWidth = size + more;
    }
    end();
  }
}

function arrow(c: CanvasRenderingContext2D, p: Picture, at: At, spot: number[]): void {
  const [fx, fy, fz] = p.arrow.force;
  if (!at(...p.tool)) return;
  const [x0, y0] = [spot[0]!, spot[1]!];
  if (!at(p.tool[0] + ARROW_SCALE * fx, p.tool[1] + ARROW_SCALE * fy, p.tool[2] + ARROW_SCALE * fz)) return;
  const [x1, y1] = [spot[0]!, spot[1]!];
  const run = Math.hypot(x1 - x0, y1 - y0);
  if (run < 1) return;
  const [ux, uy] = [(x1 - x0) / run, (y1 - y0) / run];
  const head = Math.min(18, 0.6 * run);
  c.strokeStyle = c.fillStyle = p.theme.force;
  c.lineWidth = 5;
  c.lineCap = "butt";
  c.beginPath();
  c.moveTo(x0, y0);
  c.lineTo(x1 - head * ux, y1 - head * uy);
  c.stroke();
  c.beginPath();
  c.moveTo(x1, y1);
  c.lineTo(x1 - head * ux - 0.4 * head * uy, y1 - head * uy + 0.4 * head * ux);
  c.lineTo(x1 - head * ux + 0.4 * head * uy, y1 - head * uy - 0.4 * head * ux);
  c.closePath();
  c.fill();
  c.lineCap = "round";
}

function sheet(c: CanvasRenderingContext2D, p: Picture, at: At, spot: number[]): void {
  const { axis, half } = p.sheet;
  c.beginPath();
  for (const [a, b] of [[-1, -1], [1, -1], [1, 1], [-1, 1]] as const) {
    const corner: [number, number, number] = [...p.sheet.at];
    corner[(axis + 1) % 3]! += a * half[(axis + 1) % 3]!;
    corner[(axis + 2) % 3]! += b * half[(axis + 2) % 3]!;
    if (at(...corner)) c.lineTo(spot[0]!, spot[1]!);
  }
  c.closePath();
  c.globalAlpha = 0.07;
  c.fillStyle = p.theme.actual;
  c.fill();
  c.globalAlpha = 0.5;
  c.strokeStyle = p.theme.second;
  c.lineWidth = 1;
  c.stroke();
  c.globalAlpha = 1;
}
