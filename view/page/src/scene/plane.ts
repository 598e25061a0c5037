// The plane across the path, with up and right as the camera has them.
import type { Axes } from "./camera";

type Triple = [number, number, number];

export interface SectionAxes {
  readonly right: Triple;
  readonly up: Triple;
}

/** Below this cosine, a camera axis lies too much along the path to say which way an axis of the section points. */
const CLEAR = 0.35;

/**
 * Returns two unit vectors across a direction of the path: right and up of an observer who looks along it. They agree
 * with the camera's right and up; for a path that leads towards the camera they are turned round. Where a path runs
 * across the view, the axes of the last call decide, so that the section does not flip while the path turns.
 */
export function sectionAxes(tangent: readonly number[], camera: Axes, last: SectionAxes | null): SectionAxes {
  const alongRight = Math.abs(dot(tangent, camera.right));
  const alongUp = Math.abs(dot(tangent, camera.up));
  if (alongUp <= alongRight || alongUp < 0.8) {
    const up = across(camera.up, tangent);
    return { up, right: sided(cross(tangent, up), camera.right, last?.right) };
  }
  const right = across(camera.right, tangent);
  return { right, up: sided(cross(right, tangent), camera.up, last?.up) };
}

/** Writes the offset of a point from a place in the axes of a section: right, up [m]. */
export function rightOf(axes: SectionAxes, point: readonly number[], place: readonly number[]): [number, number] {
  const d: Triple = [point[0]! - place[0]!, point[1]! - place[1]!, point[2]! - place[2]!];
  return [dot(d, axes.right), dot(d, axes.up)];
}

/** Turns `v` to the side of `wish` if it is clear which that is; else as it was; else leaves it. */
function sided(v: Triple, wish: Triple, last: Triple | undefined): Triple {
  const clear = dot(v, wish);
  let sign = 1;
  if (Math.abs(clear) >= CLEAR) sign = clear;
  else if (last !== undefined && Math.abs(dot(v, last)) > 0.5) sign = dot(v, last);
  return sign < 0 ? [-v[0], -v[1], -v[2]] : v;
}

/** Part of `v` across a unit direction, as a unit vector. */
function across(v: Triple, direction: readonly number[]): Triple {
  const along = dot(v, direction);
  const out: Triple = [v[0] - along * direction[0]!, v[1] - along * direction[1]!, v[2] - along * direction[2]!];
  const size = Math.hypot(...out);
  return size > 1e-9 ? [out[0] / size, out[1] / size, out[2] / size] : [0, 0, 1];
}

function dot(a: readonly number[], b: readonly number[]): number {
  return a[0]! * b[0]! + a[1]! * b[1]! + a[2]! * b[2]!;
}

function cross(a: readonly number[], b: readonly number[]): Triple {
  return [a[1]! * b[2]! - a[2]! * b[1]!, a[2]! * b[0]! - a[0]! * b[2]!, a[0]! * b[1]! - a[1]! * b[0]!];
}
