// Nearest places of a ray and a path: how a pointer on a flat screen gets a depth.
import type { Polyline } from "./polyline";

export type Triple = [number, number, number];

/** A half-line: origin and unit direction in W [m]. */
export interface Ray {
  readonly origin: Triple;
  readonly direction: Triple;
}

export interface NearestToRay {
  /** Arc length of the nearest place of the path [m]. */
  length: number;
  /** Distance along the ray of the point of the ray nearest to that place [m]. */
  depth: number;
  /** Distance of the two [m]. */
  distance: number;
}

/**
 * Finds where a ray and the stretch [from, to] of a path come nearest. Returns false if the stretch is empty.
 *
 * Each segment is compared with the line of the ray in closed form (the two-line problem, with the segment's parameter
 * held to the segment and the ray's to the half in front of the eye). A direction of zero length makes the ray a point.
 */
export function nearestToRay(line: Polyline, ray: Ray, from: number, to: number, out: NearestToRay): boolean {
  const [ox, oy, oz] = ray.origin;
  const [dx, dy, dz] = ray.direction;
  let best = Infinity;
  for (let i = 0; i + 1 < line.count; i++) {
    const l0 = line.length[i]!;
    const l1 = line.length[i + 1]!;
    if (l1 < from) continue;
    if (l0 > to) break;
    const k = 3 * i;
    const px = line.xyz[k]!;
    const py = line.xyz[k + 1]!;
    const pz = line.xyz[k + 2]!;
    const ex = line.xyz[k + 3]! - px;
    const ey = line.xyz[k + 4]! - py;
    const ez = line.xyz[k + 5]! - pz;
    const wx = px - ox;
    const wy = py - oy;
    const wz = pz - oz;
    const ee = ex * ex + ey * ey + ez * ez;
    const ed = ex * dx + ey * dy + ez * dz;
    const we = wx * ex + wy * ey + wz * ez;
    const wd = wx * dx + wy * dy + wz * dz;
    const span = l1 - l0;
    // The stretch may begin or end within this segment.
    const least = span > 0 ? Math.max(0, (from - l0) / span) : 0;
    const most = span > 0 ? Math.min(1, (to - l0) / span) : 1;
    const across = ee - ed * ed;
    let s = across > 1e-9 * ee ? (wd * ed - we) / across : least;
    s = Math.min(most, Math.max(least, s));
    let t = wd + s * ed;
    if (t < 0) {
      t = 0;
      s = ee > 0 ? Math.min(most, Math.max(least, -we / ee)) : 0;
    }
    const rx = wx + s * ex - t * dx;
    const ry = wy + s * ey - t * dy;
    const rz = wz + s * ez - t * dz;
    const square = rx * rx + ry * ry + rz * rz;
    if (square < best) {
      best = square;
      out.length = l0 + s * span;
      out.depth = t;
    }
  }
  out.distance = Math.sqrt(best);
  return best < Infinity;
}

const spot: NearestToRay = { length: 0, depth: 0, distance: 0 };

/** Finds the arc length of the place of the stretch [from, to] nearest to a point; NaN if the stretch is empty. */
export function nearestToPoint(line: Polyline, p: readonly number[], from: number, to: number): number {
  // A point is a ray without a direction.
  const point: Ray = { origin: [p[0]!, p[1]!, p[2]!], direction: [0, 0, 0] };
  return nearestToRay(line, point, from, to, spot) ? spot.length : NaN;
}

/** Point of a ray at a distance from its origin. */
export function along(ray: Ray, depth: number): Triple {
  return [
    ray.origin[0] + depth * ray.direction[0],
    ray.origin[1] + depth * ray.direction[1],
    ray.origin[2] + depth * ray.direction[2],
  ];
}

/** Base axis (0, 1, 2) that points most towards the eye: the normal of the drawing plane. */
export function planeAxis(direction: Triple): 0 | 1 | 2 {
  const [x, y, z] = direction.map(Math.abs) as Triple;
  return x >= y && x >= z ? 0 : y >= z ? 1 : 2;
}

/**
 * Cuts a ray with the plane through `place` across a base axis. Returns the distance along the ray, or NaN if the ray
 * runs along the plane or leads away from it.
 */
export function cutPlane(ray: Ray, place: Triple, axis: 0 | 1 | 2): number {
  const towards = ray.direction[axis];
  if (Math.abs(towards) < 0.05) return NaN;
  const depth = (place[axis] - ray.origin[axis]) / towards;
  return depth > 0 ? depth : NaN;
}
