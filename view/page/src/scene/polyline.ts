// A path as a polyline of bounded size, prepared for drawing and for searching.

/** Polyline with one radius per point. Capacity is fixed; `count` points are in use. */
export interface Polyline {
  readonly capacity: number;
  count: number;
  /** x, y, z of each point [m]. */
  readonly xyz: Float32Array;
  /** Tunnel radius at each point [m]; NaN where there is no tunnel. */
  readonly radius: Float32Array;
  /** Arc length at each point [m], counted along the points in use. */
  readonly length: Float32Array;
}

/** Planes of a path as they arrive: one array for each coordinate. */
export interface PathPlanes {
  readonly count: number;
  readonly x: ArrayLike<number>;
  readonly y: ArrayLike<number>;
  readonly z: ArrayLike<number>;
  readonly radius?: ArrayLike<number> | undefined;
}

export function createPolyline(capacity: number): Polyline {
  return {
    capacity,
    count: 0,
    xyz: new Float32Array(3 * capacity),
    radius: new Float32Array(capacity),
    length: new Float32Array(capacity),
  };
}

/** Least distance between two stored points [m]: below it, a direction would be noise. */
export const LEAST_STEP = 1e-6;

/**
 * Copies a path into `out` without points that are not finite or that repeat the one before.
 * If more points remain than fit, it keeps points at equal distances along the path.
 */
export function fillPolyline(path: PathPlanes, out: Polyline): void {
  out.count = 0;
  if (path.count <= 0 || out.capacity < 2) return;
  const whole = walk(path, () => undefined);
  if (whole.points <= out.capacity) {
    walk(path, (x, y, z, radius, length) => append(out, x, y, z, radius, length));
    return;
  }
  // Equal steps: the first and the last point are kept, the others are interpolated.
  const step = whole.length / (out.capacity - 1);
  let lastX = 0;
  let lastY = 0;
  let lastZ = 0;
  let lastRadius = NaN;
  let lastLength = 0;
  let next = 0;
  walk(path, (x, y, z, radius, length, first) => {
    if (first) {
      append(out, x, y, z, radius, 0);
      next = step;
    } else {
      while (next <= length && out.count < out.capacity - 1) {
        const share = length > lastLength ? (next - lastLength) / (length - lastLength) : 1;
        append(
          out,
          lastX + share * (x - lastX),
          lastY + share * (y - lastY),
          lastZ + share * (z - lastZ),
          lastRadius + share * (radius - lastRadius),
          next,
        );
        next += step;
      }
    }
    lastX = x;
    lastY = y;
    lastZ = z;
    lastRadius = radius;
    lastLength = length;
  });
  append(out, lastX, lastY, lastZ, lastRadius, whole.length);
}

function append(out: Polyline, x: number, y: number, z: number, radius: number, length: number): void {
  const i = out.count;
  if (i >= out.capacity) return;
  out.xyz[3 * i] = x;
  out.xyz[3 * i + 1] = y;
  out.xyz[3 * i + 2] = z;
  out.radius[i] = radius;
  out.length[i] = length;
  out.count = i + 1;
}

type Visit = (x: number, y: number, z: number, radius: number, length: number, first: boolean) => void;

function walk(path: PathPlanes, visit: Visit): { points: number; length: number } {
  let points = 0;
  let length = 0;
  let lastX = 0;
  let lastY = 0;
  let lastZ = 0;
  for (let i = 0; i < path.count; i++) {
    const x = path.x[i] ?? NaN;
    const y = path.y[i] ?? NaN;
    const z = path.z[i] ?? NaN;
    if (!Number.isFinite(x + y + z)) continue;
    const step = points === 0 ? 0 : Math.hypot(x - lastX, y - lastY, z - lastZ);
    if (points > 0 && step < LEAST_STEP) continue;
    length += step;
    visit(x, y, z, path.radius ? (path.radius[i] ?? NaN) : NaN, length, points === 0);
    lastX = x;
    lastY = y;
    lastZ = z;
    points += 1;
  }
  return { points, length };
}

/** Index of the last point whose arc length is not beyond `length` (0 for an empty polyline). */
export function segmentAt(line: Polyline, length: number): number {
  let low = 0;
  let high = Math.max(0, line.count - 1);
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if ((line.length[middle] ?? 0) <= length) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** Writes the point at an arc length into `out`, held at the ends, and returns the tunnel's radius there. */
export function pointAt(line: Polyline, length: number, out: Float32Array | number[]): number {
  if (line.count === 0) return NaN;
  const i = Math.min(segmentAt(line, length), Math.max(0, line.count - 2));
  const j = Math.min(i + 1, line.count - 1);
  const from = line.length[i] ?? 0;
  const to = line.length[j] ?? 0;
  const share = to > from ? Math.min(1, Math.max(0, (length - from) / (to - from))) : 0;
  for (let k = 0; k < 3; k++) {
    const a = line.xyz[3 * i + k] ?? 0;
    const b = line.xyz[3 * j + k] ?? 0;
    out[k] = a + share * (b - a);
  }
  const a = line.radius[i] ?? NaN;
  const b = line.radius[j] ?? NaN;
  return a + share * (b - a);
}

/** Writes the unit direction of the path at an arc length into `out`. */
export function directionAt(line: Polyline, length: number, out: Float32Array | number[]): void {
  const i = Math.min(segmentAt(line, length), Math.max(0, line.count - 2));
  const j = Math.min(i + 1, line.count - 1);
  const x = (line.xyz[3 * j] ?? 0) - (line.xyz[3 * i] ?? 0);
  const y = (line.xyz[3 * j + 1] ?? 0) - (line.xyz[3 * i + 1] ?? 0);
  const z = (line.xyz[3 * j + 2] ?? 0) - (line.xyz[3 * i + 2] ?? 0);
  const size = Math.hypot(x, y, z);
  out[0] = size > 0 ? x / size : 1;
  out[1] = size > 0 ? y / size : 0;
  out[2] = size > 0 ? z / size : 0;
}
