// The camera as plain numbers: it turns about the fitted centre, pans, zooms to the pointer and fits the view.
import type { Ray, Triple } from "./nearest";

/** Vertical angle of view [deg]: narrow, so that sizes at different depths compare. */
export const FIELD_OF_VIEW = 28;
const TANGENT = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
/** Elevation stops just short of the poles, where "up" has no direction. */
const STEEPEST = (89.5 * Math.PI) / 180;

/** Part of the picture that a fit may use, as fractions from the edges (0: up to the edge). */
export interface Insets {
  left: number;
  right: number;
  top: number;
  bottom: number;
}

export interface Camera {
  /** Centre of the turning [m]. */
  centre: Triple;
  /** Angle of the eye about z [rad]; 0 looks along +y, x to the right. */
  azimuth: number;
  /** Angle of the eye above the horizontal [rad]. */
  elevation: number;
  /** Distance of the eye plane from the centre [m]. */
  distance: number;
  /** Shift of the eye to the right and up, at the depth of the centre [m]. */
  shiftX: number;
  shiftY: number;
  /** Size of the picture [CSS px]. */
  width: number;
  height: number;
}

export function createCamera(): Camera {
  return {
    centre: [0, 0, 0],
    azimuth: (16 * Math.PI) / 180,
    elevation: (24 * Math.PI) / 180,
    distance: 0.5,
    shiftX: 0,
    shiftY: 0,
    width: 1,
    height: 1,
  };
}

/** Axes of the camera in W: right, up, and back (from the centre to the eye). */
export interface Axes {
  readonly right: Triple;
  readonly up: Triple;
  readonly back: Triple;
}

export function axesOf(c: Camera): Axes {
  const ca = Math.cos(c.azimuth);
  const sa = Math.sin(c.azimuth);
  const ce = Math.cos(c.elevation);
  const se = Math.sin(c.elevation);
  return { right: [ca, sa, 0], up: [-sa * se, ca * se, ce], back: [sa * ce, -ca * ce, se] };
}

export function eyeOf(c: Camera, axes = axesOf(c)): Triple {
  const at = (k: 0 | 1 | 2): number =>
    c.centre[k] + c.shiftX * axes.right[k] + c.shiftY * axes.up[k] + c.distance * axes.back[k];
  return [at(0), at(1), at(2)];
}

/** Ray from the eye through a place of the picture [CSS px from the upper left corner]. */
export function rayThrough(c: Camera, px: number, py: number): Ray {
  const axes = axesOf(c);
  const x = ((2 * px) / c.width - 1) * TANGENT * (c.width / c.height);
  const y = (1 - (2 * py) / c.height) * TANGENT;
  const d: Triple = [0, 0, 0];
  for (const k of [0, 1, 2] as const) d[k] = x * axes.right[k] + y * axes.up[k] - axes.back[k];
  const size = Math.hypot(d[0], d[1], d[2]);
  return { origin: eyeOf(c, axes), direction: [d[0] / size, d[1] / size, d[2] / size] };
}

/** Writes px, py [CSS px] and the depth [m] of a place into `out`; the depth is not positive behind the eye. */
export function project(c: Camera, x: number, y: number, z: number, out: Float32Array | number[]): void {
  const axes = axesOf(c);
  projectWith(c, axes, x, y, z, out);
}

export function projectWith(
  c: Camera,
  axes: Axes,
  x: number,
  y: number,
  z: number,
  out: Float32Array | number[],
): void {
  const dx = x - c.centre[0];
  const dy = y - c.centre[1];
  const dz = z - c.centre[2];
  const right = dx * axes.right[0] + dy * axes.right[1] + dz * axes.right[2] - c.shiftX;
  const up = dx * axes.up[0] + dy * axes.up[1] + dz * axes.up[2] - c.shiftY;
  const depth = c.distance - (dx * axes.back[0] + dy * axes.back[1] + dz * axes.back[2]);
  const scale = c.height / (2 * TANGENT * Math.max(1e-9, depth));
  out[0] = c.width / 2 + right * scale;
  out[1] = c.height / 2 - up * scale;
  out[2] = depth;
}

/** Metres that one CSS pixel covers at a depth [m]. */
export function metresPerPixel(c: Camera, depth: number): number {
  return (2 * TANGENT * Math.max(0, depth)) / c.height;
}

/** Turns by a drag of `dx`, `dy` [CSS px]. */
export function turn(c: Camera, dx: number, dy: number): void {
  const angle = Math.PI / Math.max(200, Math.min(c.width, c.height));
  c.azimuth = wrap(c.azimuth - dx * angle);
  c.elevation = Math.min(STEEPEST, Math.max(-STEEPEST, c.elevation + dy * angle));
}

/** Shifts the picture by `dx`, `dy` [CSS px]. */
export function pan(c: Camera, dx: number, dy: number): void {
  const size = metresPerPixel(c, c.distance);
  c.shiftX -= dx * size;
  c.shiftY += dy * size;
}

/** Zooms by a factor on the distance; the place under (px, py) stays where it is. */
export function zoom(c: Camera, factor: number, px: number, py: number, least: number, largest: number): void {
  const distance = Math.min(largest, Math.max(least, c.distance * factor));
  const change = c.distance - distance;
  c.shiftX += ((2 * px) / c.width - 1) * TANGENT * (c.width / c.height) * change;
  c.shiftY += (1 - (2 * py) / c.height) * TANGENT * change;
  c.distance = distance;
}

/** Looks along a base axis: 0, 1, 2 from +x, -y (x to the right) and +z; negative from the other side. */
export function lookAlong(c: Camera, axis: 0 | 1 | 2, fromOtherSide = false): void {
  c.shiftX = 0;
  c.shiftY = 0;
  if (axis === 0) {
    c.azimuth = fromOtherSide ? -Math.PI / 2 : Math.PI / 2;
    c.elevation = 0;
  } else if (axis === 1) {
    c.azimuth = fromOtherSide ? Math.PI : 0;
    c.elevation = 0;
  } else {
    c.azimuth = 0;
    c.elevation = fromOtherSide ? -STEEPEST : STEEPEST;
  }
}

/**
 * Places the camera so that spheres around the given points fill the free part of the picture. The direction of view
 * stays. Points: x, y, z, radius after each other.
 */
export function fit(c: Camera, spheres: ArrayLike<number>, insets: Insets): void {
  const count = Math.floor(spheres.length / 4);
  if (count === 0 || c.width < 2 || c.height < 2) return;
  const axes = axesOf(c);
  const low: Triple = [Infinity, Infinity, Infinity];
  const high: Triple = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < count; i++) {
    for (const k of [0, 1, 2] as const) {
      low[k] = Math.min(low[k], spheres[4 * i + k]!);
      high[k] = Math.max(high[k], spheres[4 * i + k]!);
    }
  }
  for (const k of [0, 1, 2] as const) c.centre[k] = (low[k] + high[k]) / 2;
  const tx = TANGENT * (c.width / c.height);
  const ty = TANGENT;
  // The free part of the picture, in tangents of the angle of view.
  const free = {
    left: (2 * insets.left - 1) * tx,
    right: (1 - 2 * insets.right) * tx,
    bottom: (2 * insets.bottom - 1) * ty,
    top: (1 - 2 * insets.top) * ty,
  };
  const wide = Math.max(0.05 * tx, free.right - free.left);
  const tall = Math.max(0.05 * ty, free.top - free.bottom);
  const size = Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
  c.distance = Math.max(1e-3, size / Math.min(wide, tall));
  c.shiftX = 0;
  c.shiftY = 0;
  // Size and middle depend on each other by perspective: some rounds bring both below a tenth of a pixel.
  for (let round = 0; round < 12; round++) {
    let [left, right, bottom, top, deepest] = [Infinity, -Infinity, Infinity, -Infinity, -Infinity];
    for (let i = 0; i < count; i++) {
      const dx = spheres[4 * i]! - c.centre[0];
      const dy = spheres[4 * i + 1]! - c.centre[1];
      const dz = spheres[4 * i + 2]! - c.centre[2];
      const radius = Math.max(0, spheres[4 * i + 3]!);
      const x = dx * axes.right[0] + dy * axes.right[1] + dz * axes.right[2] - c.shiftX;
      const y = dx * axes.up[0] + dy * axes.up[1] + dz * axes.up[2] - c.shiftY;
      const z = dx * axes.back[0] + dy * axes.back[1] + dz * axes.back[2];
      const depth = Math.max(0.05 * c.distance, c.distance - z);
      deepest = Math.max(deepest, z + radius);
      left = Math.min(left, (x - radius) / depth);
      right = Math.max(right, (x + radius) / depth);
      bottom = Math.min(bottom, (y - radius) / depth);
      top = Math.max(top, (y + radius) / depth);
    }
    c.shiftX += ((left + right - free.left - free.right) / 2) * c.distance;
    c.shiftY += ((bottom + top - free.bottom - free.top) / 2) * c.distance;
    const scale = Math.max((right - left) / wide, (top - bottom) / tall);
    c.distance = Math.max(1e-3, c.distance * scale, 1.1 * deepest);
  }
}

function wrap(angle: number): number {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
