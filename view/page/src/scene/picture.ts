// Describes one frame of the scene. The scene fills it from the model; a painter draws it, by WebGL or on a 2-D canvas.
import type { Camera } from "./camera";
import type { VirtualScene } from "./objects";
import type { Polyline } from "./polyline";
import { mix, type Theme } from "./theme";

/** Colour of the recorded movement. */
export type ColourMode = "one" | "deviation" | "speed" | "force";

/** Points of a movement in the order of time. Capacity is fixed. */
export interface Movement {
  readonly capacity: number;
  count: number;
  /** x, y, z of each point [m]. */
  readonly xyz: Float32Array;
  /** Value that colours the point; GAP if no line leads from this point to the next. */
  readonly value: Float32Array;
  /** Counts changes, so that a painter uploads new data only. */
  version: number;
}

/** Value of a point after which the line has a gap. */
export const GAP = -1e30;

/** Value of a point where nothing was measured: it keeps the colour of the tool's role. */
export const UNKNOWN = -1;

export interface Ring {
  readonly at: [number, number, number];
  visible: boolean;
  colour: string;
}

export interface Arrow {
  visible: boolean;
  /** Force [N]. */
  readonly force: [number, number, number];
}

export interface Picture {
  camera: Camera;
  /** Objects of a virtual scene; null: there is none. */
  scene: VirtualScene | null;
  /** Index of the touched object; -1: none. */
  touched: number;
  /** Where the surface of the touched object holds the tool back, and its unit normal there. */
  proxy: { visible: boolean; at: [number, number, number]; normal: [number, number, number]; showNormal: boolean };
  theme: Theme;
  /** Counts changes of the path. */
  pathVersion: number;
  path: Polyline;
  showPath: boolean;
  showTunnel: boolean;
  /** Arc length up to which the path is done [m]; NaN: not shown. */
  done: number;
  /** Tool, NaN while unknown [m]. */
  tool: [number, number, number];
  showTool: boolean;
  /** Radius of the ball [CSS px]. */
  toolSize: number;
  reference: [number, number, number];
  showReference: boolean;
  deviation: { visible: boolean; outside: boolean };
  arrow: Arrow;
  trail: { count: number; xyz: Float32Array; age: Float32Array };
  showTrail: boolean;
  movement: Movement;
  showMovement: boolean;
  colour: { mode: ColourMode; low: number; high: number };
  /** Floor grid: height [m], step [m] and extent [m]; hidden in the training screen. */
  floor: { visible: boolean; z: number; step: number; x0: number; x1: number; y0: number; y1: number };
  workspace: { visible: boolean; min: [number, number, number]; max: [number, number, number] };
  start: Ring;
  goal: Ring;
  /** Where the person wants the hand to be: a ring apart from the tool. */
  intention: { visible: boolean; at: [number, number, number] };
  /** Drawing plane across a base axis, as a faint sheet around `at` with half of its size along each axis [m]. */
  sheet: { visible: boolean; at: [number, number, number]; axis: 0 | 1 | 2; half: [number, number, number] };
}

/** Length of a contact's normal on the screen, in radii of the tool. */
export const NORMAL_LENGTH = 3;

/** Opacity of an object, and of the touched one: path, tool and grid stay visible. */
export const OBJECT_ALPHA = 0.55;
export const TOUCHED_ALPHA = 0.8;

/** Colour of an object: its own or that of its role; paler unless it is touched. */
export function objectColour(p: Picture, index: number): string {
  const own = p.scene?.objects[index]?.colour;
  const colour = typeof own === "string" && /^#[0-9a-f]{6}$/i.test(own) ? own : p.theme.object;
  return index === p.touched ? mix(colour, p.theme.dark ? "#FFFFFF" : colour, 0.25) : mix(colour, p.theme.background, 0.35);
}

/** Millimetres an arrow is long for each newton, in metres. */
export const ARROW_SCALE = 0.012;

export interface Painter {
  /** "webgl" or "flat" (2-D canvas). */
  readonly kind: "webgl" | "flat";
  readonly canvas: HTMLCanvasElement;
  /** True while the graphics context is lost: nothing can be drawn. */
  readonly lost: boolean;
  resize(width: number, height: number, ratio: number): void;
  draw(picture: Picture): void;
  /** Numbers of geometries and textures held; stays flat when paths are replaced. */
  memory(): { geometries: number; textures: number };
  dispose(): void;
}
