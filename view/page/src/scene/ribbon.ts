// Geometry of a ribbon that faces the camera, written into arrays that are allocated once.

/** Arrays of a ribbon of at most `points` points: two corners a point. */
export interface RibbonArrays {
  readonly points: number;
  readonly position: Float32Array;
  /** Opacity of each corner, 0 to 1. */
  readonly alpha: Float32Array;
  readonly index: Uint16Array;
  indices: number;
}

export function createRibbon(points: number): RibbonArrays {
  const index = new Uint16Array(6 * Math.max(0, points - 1));
  for (let i = 0; i + 1 < points; i++) {
    const a = 2 * i;
    index.set([a, a + 1, a + 2, a + 2, a + 1, a + 3], 6 * i);
  }
  return {
    points,
    position: new Float32Array(6 * points),
    alpha: new Float32Array(2 * points),
    index,
    indices: 0,
  };
}

/**
 * Fills the ribbon along `xyz` (oldest point first). Each point has an age from 0 (now) to 1 (fades out); width and
 * opacity fall to zero with the age. The opacity falls rather than the colour, so that the ribbon leaves no gap in what
 * lies behind it.
 *
 * @param half half of the width at age 0 [m]
 */
export function fillRibbon(
  xyz: Float32Array,
  age: Float32Array,
  count: number,
  eye: readonly [number, number, number],
  half: number,
  out: RibbonArrays,
): void {
  const n = Math.min(count, out.points);
  const first = count - n;
  let sideX = 0;
  let sideY = 0;
  let sideZ = 0;
  for (let i = 0; i < n; i++) {
    const at = 3 * (first + i);
    const a = 3 * (first + Math.max(0, i - 1));
    const b = 3 * (first + Math.min(n - 1, i + 1));
    const x = xyz[at]!;
    const y = xyz[at + 1]!;
    const z = xyz[at + 2]!;
    const dx = xyz[b]! - xyz[a]!;
    const dy = xyz[b + 1]! - xyz[a + 1]!;
    const dz = xyz[b + 2]! - xyz[a + 2]!;
    const ex = eye[0] - x;
    const ey = eye[1] - y;
    const ez = eye[2] - z;
    const cx = dy * ez - dz * ey;
    const cy = dz * ex - dx * ez;
    const cz = dx * ey - dy * ex;
    const size = Math.hypot(cx, cy, cz);
    // A tool at rest, or a movement towards the eye, has no side: the last one is kept.
    if (size > 1e-12) {
      sideX = cx / size;
      sideY = cy / size;
      sideZ = cz / size;
    }
    const fresh = Math.min(1, Math.max(0, 1 - age[first + i]!));
    const w = half * fresh;
    const k = 6 * i;
    out.position[k] = x + w * sideX;
    out.position[k + 1] = y + w * sideY;
    out.position[k + 2] = z + w * sideZ;
    out.position[k + 3] = x - w * sideX;
    out.position[k + 4] = y - w * sideY;
    out.position[k + 5] = z - w * sideZ;
    out.alpha[2 * i] = fresh;
    out.alpha[2 * i + 1] = fresh;
  }
  out.indices = n > 1 ? 6 * (n - 1) : 0;
}
