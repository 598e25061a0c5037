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
 * Returns two unit vectors across a direction of the path. They agree with the camera's right and up. Where the path
 * runs along one of these, the section shows the depth instead: what is far away lies to the right, or above. Between,
 * the axes of the last call decide, so that the section does not flip while the path turns.
 */
export function sectionAxes(tangent: readonly number[], camera: Axes, last: SectionAxes | null): SectionAxes {
  const alongRight = Math.abs(dot(tangent, camera.right));
  const alongUp = Math.abs(dot(tangent, camera.up));
  const far: Triple = [-camera.back[0], -camera.back[1], -camera.back[2]];
  if (alongUp <= alongRight || alongUp < 0.8) {
    const up = across(camera.up, tangent);
    const right = cross(tangent, up);
    return { up, right: sided(right, camera.right, far, last?.right) };
  }
  const right = across(camera.right, tangent);
  const up = cross(tangent, right);
  return { right, up: sided(up, camera.up, far, last?.up) };
}

/** Writes the offset of a point from a place in the axes of a section: right, up [m]. */
export function rightOf(axes: SectionAxes, point: readonly number[], place: readonly number[]): [number, number] {
  const d: Triple = [point[0]! - place[0]!, point[1]! - place[1]!, point[2]! - place[2]!];
  return [dot(d, axes.right), dot(d, axes.up)];
}

/** Turns `v` to the side of `wish` if it is clear which that is; else as it was; else to the side of `other`. */
function sided(v: Triple, wish: Triple, other: Triple, last: Triple | undefined): Triple {
  const clear = dot(v, wish);
  let sign: number;
  if (Math.abs(clear) >= CLEAR) sign = clear;
  else if (last !== undefined && Math.abs(dot(v, last)) > 0.5) sign = dot(v, last);
  else sign = dot(v, other);
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
