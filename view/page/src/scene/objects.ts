// The objects of a virtual scene: their triangles in W with normals, ready to draw.
import type { SceneObject, Vec3 } from "../protocol";

/** Triangles of an object in W, three corners each. */
export interface Shape {
  /** Number of triangles. */
  readonly count: number;
  /** x y z of each corner [m]. */
  readonly position: Float32Array;
  /** Unit normal of each corner: smooth, except at edges. */
  readonly normal: Float32Array;
  /** Unit normal of each triangle. */
  readonly face: Float32Array;
  readonly min: Vec3;
  readonly max: Vec3;
}

export interface VirtualObject extends SceneObject {
  /** Null until its mesh comes, and for an object without one. */
  shape: Shape | null;
}

export interface VirtualScene {
  readonly id: number;
  /** Grows with each change. */
  version: number;
  readonly objects: VirtualObject[];
}

/** Faces that meet at a larger angle than this have an edge between them: its cosine, for 35 degrees. */
const EDGE = Math.cos((35 * Math.PI) / 180);

export function objectOf(object: SceneObject): VirtualObject {
  return { ...object, shape: null };
}

/** Rotates a vector by a unit quaternion w x y z. */
export function rotate([w, x, y, z]: readonly [number, number, number, number], v: readonly number[], out: number[]): void {
  const [a, b, c] = [v[0]!, v[1]!, v[2]!];
  const tx = 2 * (y * c - z * b);
  const ty = 2 * (z * a - x * c);
  const tz = 2 * (x * b - y * a);
  out[0] = a + w * tx + y * tz - z * ty;
  out[1] = b + w * ty + z * tx - x * tz;
  out[2] = c + w * tz + x * ty - y * tx;
}

/**
 * Prepares a mesh of an object's own frame. The normal of a corner is the mean of those faces around its place, weighted
 * by their areas, that meet its own face at less than 35 degrees: a ball is smooth, a box has edges. Triangles that have
 * no area, or a place that is not finite, are left out. Returns null if nothing remains, or if the pose is invalid.
 */
export function shapeOf(
  vertices: ArrayLike<number>,
  triangles: ArrayLike<number>,
  position: Vec3,
  rotation: readonly [number, number, number, number],
): Shape | null {
  const size = Math.hypot(...rotation);
  if (!(size > 1e-6) || !Number.isFinite(size + position[0] + position[1] + position[2])) return null;
  const turn = rotation.map((q) => q / size) as [number, number, number, number];
  const points = vertices.length / 3;
  const placed = new Float32Array(3 * points);
  const spot = [0, 0, 0];
  for (let i = 0; i < points; i++) {
    rotate(turn, [vertices[3 * i]!, vertices[3 * i + 1]!, vertices[3 * i + 2]!], spot);
    for (let k = 0; k < 3; k++) placed[3 * i + k] = spot[k]! + position[k]!;
  }
  const most = triangles.length / 3;
  const corner = new Uint32Array(3 * most);
  const area = new Float32Array(3 * most); // normal of each face times twice its area
  const face = new Float32Array(3 * most);
  let count = 0;
  for (let t = 0; t < most; t++) {
    const [a, b, c] = [3 * triangles[3 * t]!, 3 * triangles[3 * t + 1]!, 3 * triangles[3 * t + 2]!];
    const [ux, uy, uz] = [placed[b]! - placed[a]!, placed[b + 1]! - placed[a + 1]!, placed[b + 2]! - placed[a + 2]!];
    const [vx, vy, vz] = [placed[c]! - placed[a]!, placed[c + 1]! - placed[a + 1]!, placed[c + 2]! - placed[a + 2]!];
    const n = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    const length = Math.hypot(n[0]!, n[1]!, n[2]!);
    if (!(length > 0) || length === Infinity) continue;
    corner.set([triangles[3 * t]!, triangles[3 * t + 1]!, triangles[3 * t + 2]!], 3 * count);
    area.set(n, 3 * count);
    face.set(n.map((x) => x / length), 3 * count);
    count++;
  }
  if (count === 0) return null;
  // Vertices at one place are one: a mesh may repeat them along its seams.
  const place = placesOf(placed);
  const around = facesAround(place, corner, count);
  const out = { position: new Float32Array(9 * count), normal: new Float32Array(9 * count) };
  const min: Vec3 = [Infinity, Infinity, Infinity];
  const max: Vec3 = [-Infinity, -Infinity, -Infinity];
  for (let t = 0; t < count; t++) {
    for (let j = 0; j < 3; j++) {
      const vertex = corner[3 * t + j]!;
      const at = 9 * t + 3 * j;
      let [nx, ny, nz] = [0, 0, 0];
      for (let f = around.first[place[vertex]!]!; f < around.first[place[vertex]! + 1]!; f++) {
        const o = 3 * around.faces[f]!;
        if (face[o]! * face[3 * t]! + face[o + 1]! * face[3 * t + 1]! + face[o + 2]! * face[3 * t + 2]! < EDGE) continue;
        nx += area[o]!;
        ny += area[o + 1]!;
        nz += area[o + 2]!;
      }
      const length = Math.hypot(nx, ny, nz) || 1;
      out.normal.set([nx / length, ny / length, nz / length], at);
      for (let k = 0; k < 3; k++) {
        const x = placed[3 * vertex + k]!;
        out.position[at + k] = x;
        min[k] = Math.min(min[k]!, x);
        max[k] = Math.max(max[k]!, x);
      }
    }
  }
  return { count, ...out, face: face.subarray(0, 3 * count), min, max };
}

/** Numbers the places of vertices. Those that differ by rounding only, as at a seam or a pole, have one number. */
function placesOf(vertices: Float32Array): Uint32Array {
  let size = 0;
  for (const x of vertices) if (Math.abs(x) > size && x < Infinity) size = Math.abs(x);
  const grain = Math.max(1e-9, 1e-5 * size);
  const cell = (i: number): number => Math.round(vertices[i]! / grain);
  const known = new Map<string, number>();
  const out = new Uint32Array(vertices.length / 3);
  for (let i = 0; i < out.length; i++) {
    const key = `${cell(3 * i)} ${cell(3 * i + 1)} ${cell(3 * i + 2)}`;
    let number = known.get(key);
    if (number === undefined) known.set(key, (number = known.size));
    out[i] = number;
  }
  return out;
}

/** Lists the faces at each place: those of place p are faces[first[p]] to faces[first[p + 1] - 1]. */
function facesAround(place: Uint32Array, corner: Uint32Array, count: number): { first: Uint32Array; faces: Uint32Array } {
  const first = new Uint32Array(place.length + 1);
  for (let i = 0; i < 3 * count; i++) first[place[corner[i]!]! + 1]!++;
  for (let p = 0; p < place.length; p++) first[p + 1]! += first[p]!;
  const next = first.slice();
  const faces = new Uint32Array(3 * count);
  for (let i = 0; i < 3 * count; i++) faces[next[place[corner[i]!]!]!++] = Math.floor(i / 3);
  return { first, faces };
}
