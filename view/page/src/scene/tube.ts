// Geometry of a tube around a polyline, written into arrays that are allocated once.
import type { Polyline } from "./polyline";

/** Arrays of a tube with at most `rings` rings of `sides` points. */
export interface TubeArrays {
  readonly rings: number;
  readonly sides: number;
  readonly position: Float32Array;
  readonly normal: Float32Array;
  readonly index: Uint32Array;
  /** Number of indices in use. */
  indices: number;
}

export function createTube(rings: number, sides: number): TubeArrays {
  const points = rings * (sides + 1);
  return {
    rings,
    sides,
    position: new Float32Array(3 * points),
    normal: new Float32Array(3 * points),
    index: new Uint32Array(6 * Math.max(0, rings - 1) * sides),
    indices: 0,
  };
}

/** Rotation-minimising frames of a polyline: unit tangent and two unit normals of each point. */
export interface Frames {
  readonly tangent: Float32Array;
  readonly u: Float32Array;
  readonly v: Float32Array;
}

export function createFrames(capacity: number): Frames {
  return {
    tangent: new Float32Array(3 * capacity),
    u: new Float32Array(3 * capacity),
    v: new Float32Array(3 * capacity),
  };
}

/**
 * Computes rotation-minimising frames by double reflection (Wang, Juettler, Zheng, Liu 2008: Computation of rotation
 * minimizing frames). A frame does not turn about the path, so that a tube shows no twist.
 */
export function fillFrames(line: Polyline, out: Frames): void {
  const n = line.count;
  const p = line.xyz;
  const { tangent, u, v } = out;
  for (let i = 0; i < n; i++) {
    const a = Math.max(0, i - 1);
    const b = Math.min(n - 1, i + 1);
    let x = (p[3 * b] ?? 0) - (p[3 * a] ?? 0);
    let y = (p[3 * b + 1] ?? 0) - (p[3 * a + 1] ?? 0);
    let z = (p[3 * b + 2] ?? 0) - (p[3 * a + 2] ?? 0);
    let size = Math.hypot(x, y, z);
    if (size < 1e-12) {
      // The path turns back on itself here: take the direction of the step that leads here.
      x = (p[3 * i] ?? 0) - (p[3 * a] ?? 0);
      y = (p[3 * i + 1] ?? 0) - (p[3 * a + 1] ?? 0);
      z = (p[3 * i + 2] ?? 0) - (p[3 * a + 2] ?? 0);
      size = Math.hypot(x, y, z);
    }
    tangent[3 * i] = size > 0 ? x / size : 1;
    tangent[3 * i + 1] = size > 0 ? y / size : 0;
    tangent[3 * i + 2] = size > 0 ? z / size : 0;
  }
  if (n === 0) return;
  firstNormal(tangent, u);
  cross(tangent, u, v, 0);
  for (let i = 0; i + 1 < n; i++) {
    const k = 3 * i;
    const m = k + 3;
    // First reflection, in the plane half way between the two points.
    const c0 = (p[m] ?? 0) - (p[k] ?? 0);
    const c1 = (p[m + 1] ?? 0) - (p[k + 1] ?? 0);
    const c2 = (p[m + 2] ?? 0) - (p[k + 2] ?? 0);
    const c = c0 * c0 + c1 * c1 + c2 * c2;
    const ru = c > 0 ? (2 / c) * (c0 * u[k]! + c1 * u[k + 1]! + c2 * u[k + 2]!) : 0;
    const rt = c > 0 ? (2 / c) * (c0 * tangent[k]! + c1 * tangent[k + 1]! + c2 * tangent[k + 2]!) : 0;
    const u0 = u[k]! - ru * c0;
    const u1 = u[k + 1]! - ru * c1;
    const u2 = u[k + 2]! - ru * c2;
    // Second reflection: takes the reflected tangent to the tangent of the next point.
    const d0 = tangent[m]! - (tangent[k]! - rt * c0);
    const d1 = tangent[m + 1]! - (tangent[k + 1]! - rt * c1);
    const d2 = tangent[m + 2]! - (tangent[k + 2]! - rt * c2);
    const d = d0 * d0 + d1 * d1 + d2 * d2;
    const s = d > 1e-18 ? (2 / d) * (d0 * u0 + d1 * u1 + d2 * u2) : 0;
    let x = u0 - s * d0;
    let y = u1 - s * d1;
    let z = u2 - s * d2;
    // Removes what rounding put along the tangent.
    const along = x * tangent[m]! + y * tangent[m + 1]! + z * tangent[m + 2]!;
    x -= along * tangent[m]!;
    y -= along * tangent[m + 1]!;
    z -= along * tangent[m + 2]!;
    const size = Math.hypot(x, y, z);
    if (size > 1e-9) {
      u[m] = x / size;
      u[m + 1] = y / size;
      u[m + 2] = z / size;
    } else {
      u[m] = u[k]!;
      u[m + 1] = u[k + 1]!;
      u[m + 2] = u[k + 2]!;
    }
    cross(tangent, u, v, m);
  }
}

/** Writes a unit normal of the first tangent: across the base axis that is most across the path. */
function firstNormal(tangent: Float32Array, u: Float32Array): void {
  const x = Math.abs(tangent[0]!);
  const y = Math.abs(tangent[1]!);
  const z = Math.abs(tangent[2]!);
  const axis = x <= y && x <= z ? 0 : y <= z ? 1 : 2;
  const along = tangent[axis]!;
  let size = 0;
  for (let k = 0; k < 3; k++) {
    u[k] = (k === axis ? 1 : 0) - along * tangent[k]!;
    size += u[k]! * u[k]!;
  }
  size = Math.sqrt(size);
  for (let k = 0; k < 3; k++) u[k] = u[k]! / size;
}

function cross(a: Float32Array, b: Float32Array, out: Float32Array, k: number): void {
  const a0 = a[k]!;
  const a1 = a[k + 1]!;
  const a2 = a[k + 2]!;
  const b0 = b[k]!;
  const b1 = b[k + 1]!;
  const b2 = b[k + 2]!;
  out[k] = a1 * b2 - a2 * b1;
  out[k + 1] = a2 * b0 - a0 * b2;
  out[k + 2] = a0 * b1 - a1 * b0;
}

/**
 * Fills the tube around `line`. Stretches without a radius stay open. Normals lean with the slope of the radius.
 * The line must not have more points than the tube has rings.
 */
export function fillTube(line: Polyline, frames: Frames, tube: TubeArrays): void {
  const n = Math.min(line.count, tube.rings);
  const { sides, position, normal, index } = tube;
  for (let i = 0; i < n; i++) {
    const radius = line.radius[i]!;
    const a = Math.max(0, i - 1);
    const b = Math.min(n - 1, i + 1);
    const run = line.length[b]! - line.length[a]!;
    const rise = line.radius[b]! - line.radius[a]!;
    const slope = run > 0 && Number.isFinite(rise) ? rise / run : 0;
    const lean = 1 / Math.hypot(1, slope);
    for (let s = 0; s <= sides; s++) {
      const angle = (2 * Math.PI * s) / sides;
      const cos = Math.cos(angle);
      const sin = Math.sin(angle);
      const out = 3 * (i * (sides + 1) + s);
      for (let k = 0; k < 3; k++) {
        const side = cos * frames.u[3 * i + k]! + sin * frames.v[3 * i + k]!;
        position[out + k] = line.xyz[3 * i + k]! + (radius > 0 ? radius : 0) * side;
        normal[out + k] = lean * (side - slope * frames.tangent[3 * i + k]!);
      }
    }
  }
  let at = 0;
  for (let i = 0; i + 1 < n; i++) {
    if (!(line.radius[i]! > 0) || !(line.radius[i + 1]! > 0)) continue;
    for (let s = 0; s < sides; s++) {
      const a = i * (sides + 1) + s;
      const b = a + sides + 1;
      index[at++] = a;
      index[at++] = b;
      index[at++] = a + 1;
      index[at++] = a + 1;
      index[at++] = b;
      index[at++] = b + 1;
    }
  }
  tube.indices = at;
}
