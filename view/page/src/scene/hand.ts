// Where a pointer on a flat screen wants the hand to be: pure functions behind the steering.
import type { Axes } from "./camera";
import { along, cutPlane, nearestToPoint, nearestToRay, planeAxis, type NearestToRay, type Ray, type Triple } from "./nearest";
import { pointAt, type Polyline } from "./polyline";

/** Stretch of path on either side of the present place that is searched for the next one [m]. */
export const REACH = 0.025;
/** Fastest movement along the path [m/s]: a step to another branch is spread, a movement of a hand is not slowed. */
const FASTEST = 0.6;
/** A path whose ends are nearer than this is closed [m]. */
const CLOSED = 0.002;
/** Time in which the depth of the tool at the press gives way to the depth of the path [s]. */
const BLEND = 0.25;


/** Follows a pointer from a press to its release. */
export class Hand {
  /** Arc length of the present place [m]; NaN without a path. */
  private place = NaN;
  /** Difference of the tool's and the path's depth at the press; it fades [m]. */
  private extra = 0;
  /** Length of a closed path, whose end leads on to its start [m]; 0: it is open. */
  private round = 0;
  private readonly found: NearestToRay = { length: 0, depth: 0, distance: 0 };
  private readonly spot = [0, 0, 0];
  private plane: { through: Triple; axis: 0 | 1 | 2 };
  private now: Triple;

  /**
   * `tool` is where the tool is at the press [m]; `view` is the direction of view. Without a path, or with an empty
   * one, the depth comes from a drawing plane.
   */
  constructor(
    private readonly path: Polyline | null,
    tool: Triple,
    ray: Ray,
    view: Triple,
  ) {
    this.now = [...tool];
    this.plane = { through: [...tool], axis: planeAxis(view) };
    if (path === null || path.count < 2) return;
    const end = path.count - 1;
    const gap = Math.hypot(...[0, 1, 2].map((k) => path.xyz[3 * end + k]! - path.xyz[k]!));
    if (gap < CLOSED && path.length[end]! > 4 * REACH) this.round = path.length[end]!;
    this.place = nearestToPoint(path, tool, -Infinity, Infinity);
    if (nearestToRay(path, ray, this.place - REACH, this.place + REACH, this.found)) this.place = this.found.length;
    pointAt(path, this.place, this.spot);
    this.extra = dot(tool, this.spot, ray.direction);
  }

  get fromPath(): boolean {
    return Number.isFinite(this.place);
  }

  /** Arc length of the present place [m]; NaN without a path. */
  get length(): number {
    return this.place;
  }

  /** The drawing plane, where the depth does not come from a path. */
  get sheet(): { through: Triple; axis: 0 | 1 | 2 } | null {
    return this.fromPath ? null : this.plane;
  }

  get at(): Triple {
    return this.now;
  }

  /** Takes the ray under the pointer, `dt` seconds after the last one, and returns where the hand should be. */
  move(ray: Ray, dt: number): Triple {
    if (this.path === null || !this.fromPath) {
      const depth = cutPlane(ray, this.plane.through, this.plane.axis);
      if (Number.isFinite(depth)) this.now = along(ray, depth);
      return this.now;
    }
    const step = this.stepTo(this.path, ray);
    if (Number.isNaN(step)) return this.now;
    const most = FASTEST * Math.min(0.1, Math.max(0.001, dt));
    // Up to the fastest step the place follows at once: smoothing a hand's own movement would only delay it.
    const next = this.place + Math.min(most, Math.max(-most, step));
    this.place = this.round > 0 ? next - this.round * Math.floor(next / this.round) : next;
    pointAt(this.path, this.place, this.spot);
    this.extra *= Math.exp(-Math.max(0, dt) / BLEND);
    const depth = dot(this.spot, ray.origin, ray.direction) + this.extra;
    if (depth > 0) this.now = along(ray, depth);
    return this.now;
  }

  /** Signed length along the path to the place nearest to the ray [m]; NaN if there is none. A closed path goes on. */
  private stepTo(path: Polyline, ray: Ray): number {
    let step = NaN;
    let best = Infinity;
    for (const turns of this.round > 0 ? [0, -1, 1] : [0]) {
      const from = this.place + turns * this.round;
      if (!nearestToRay(path, ray, from - REACH, from + REACH, this.found)) continue;
      if (this.found.distance >= best) continue;
      best = this.found.distance;
      step = this.found.length - from;
    }
    return step;
  }

  /** Moves the drawing plane along its axis, away from the eye if `distance` is positive [m]. */
  shiftPlane(distance: number, view: Triple): void {
    if (this.fromPath) return;
    const { axis, through } = this.plane;
    const shift = Math.sign(view[axis] || 1) * distance;
    through[axis] += shift;
    this.now = [...this.now];
    this.now[axis] += shift;
  }

  /** Moves the hand by sticks, which give all three coordinates: metres to the right, up and away from the eye. */
  slide(axes: Axes, right: number, up: number, away: number): void {
    this.now = [0, 1, 2].map(
      (k) => this.now[k]! + right * axes.right[k]! + up * axes.up[k]! - away * axes.back[k]!,
    ) as Triple;
  }
}

/** Component of `a - b` along a unit direction. */
function dot(a: readonly number[], b: readonly number[], direction: Triple): number {
  return (a[0]! - b[0]!) * direction[0] + (a[1]! - b[1]!) * direction[1] + (a[2]! - b[2]!) * direction[2];
}

/** Dead zone of a stick, 0 to 1. */
const DEAD = 0.12;

/** Speed for the deflection of a stick (-1 to 1): nothing in the dead zone, then cubic, so that small moves are slow. */
export function stick(deflection: number, most: number): number {
  const size = Math.min(1, Math.max(0, (Math.abs(deflection) - DEAD) / (1 - DEAD)));
  return Math.sign(deflection) * most * size ** 3;
}

/** Firmness of the hold for the pressure of a pen: 0.2 at the lightest touch, 1 at full pressure. */
export function gripOf(pressure: number): number {
  return 0.2 + 0.8 * Math.min(1, Math.max(0, pressure));
}

/** Holds a place within a box. */
export function clampTo(at: Triple, min: readonly number[], max: readonly number[]): Triple {
  return [0, 1, 2].map((k) => Math.min(max[k]!, Math.max(min[k]!, at[k]!))) as Triple;
}
