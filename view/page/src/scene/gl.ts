// Draws a picture by WebGL. Every buffer is allocated once, for the largest path and the longest movement.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  ColorManagement,
  DoubleSide,
  DynamicDrawUsage,
  InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
  LinearSRGBColorSpace,
  Mesh,
  PerspectiveCamera,
  Scene,
  ShaderMaterial,
  Vector2,
  Vector3,
  WebGLRenderer,
  type IUniform,
} from "three";
import { axesOf, eyeOf, FIELD_OF_VIEW, metresPerPixel, projectWith } from "./camera";
import { ARROW_SCALE, NORMAL_LENGTH, OBJECT_ALPHA, objectColour, TOUCHED_ALPHA, type Painter, type Picture } from "./picture";
import { createPolyline, fillPolyline, type Polyline } from "./polyline";
import { createRibbon, fillRibbon } from "./ribbon";
import { CIVIDIS, cividisRange, mix, parseColour } from "./theme";
import { createFrames, createTube, fillFrames, fillTube } from "./tube";

ColorManagement.enabled = false;

/** Objects are drawn after floor, shadows and drop line, which have the orders 0 to 4. */
const OBJECT_ORDER = 4.5;

/** Largest number of lines of the floor grid and of the workspace box. */
const GRID_LINES = 512;

const LINE_VERTEX = /* glsl */ `
  attribute vec2 corner;
  attribute vec3 from;
  attribute vec3 to;
  attribute float fromValue;
  attribute float toValue;
  uniform vec2 size;
  uniform float width;
  uniform float limit;
  uniform float flatten;
  uniform float floorZ;
  varying float vValue;
  varying float vSide;
  void main() {
    vec3 a = from;
    vec3 b = to;
    float end = toValue;
    bool hidden = fromValue < -1e29 || fromValue > limit;
    if (toValue > limit && toValue > fromValue) {
      b = mix(a, b, (limit - fromValue) / (toValue - fromValue));
      end = limit;
    }
    a.z = mix(a.z, floorZ, flatten);
    b.z = mix(b.z, floorZ, flatten);
    vec4 va = modelViewMatrix * vec4(a, 1.0);
    vec4 vb = modelViewMatrix * vec4(b, 1.0);
    // The part behind the eye is cut off: it has no place on the screen.
    float near = -1e-3;
    if (va.z > near && vb.z > near) hidden = true;
    if (va.z > near) va = mix(vb, va, (near - vb.z) / (va.z - vb.z));
    if (vb.z > near) vb = mix(va, vb, (near - va.z) / (vb.z - va.z));
    vec4 ca = projectionMatrix * va;
    vec4 cb = projectionMatrix * vb;
    vec2 sa = ca.xy / ca.w * size * 0.5;
    vec2 sb = cb.xy / cb.w * size * 0.5;
    vec2 along = sb - sa;
    float run = length(along);
    along = run > 1e-4 ? along / run : vec2(1.0, 0.0);
    vec2 across = vec2(-along.y, along.x);
    vec4 place = corner.x < 0.5 ? ca : cb;
    vec2 shift = (across * corner.y + along * (corner.x < 0.5 ? -0.35 : 0.35)) * (width + 1.0) * 0.5;
    place.xy += shift * 2.0 / size * place.w;
    vValue = corner.x < 0.5 ? fromValue : (end < -1e29 ? fromValue : end);
    vSide = corner.y * (width + 1.0) * 0.5;
    gl_Position = hidden ? vec4(2.0, 2.0, 2.0, 1.0) : place;
  }
`;

const LINE_FRAGMENT = /* glsl */ `
  uniform vec3 colour;
  uniform float alpha;
  uniform float width;
  uniform float mapped;
  uniform vec2 range;
  uniform vec2 ends;
  uniform vec3 map[10];
  varying float vValue;
  varying float vSide;
  void main() {
    vec3 shade = colour;
    if (mapped > 0.5 && vValue >= range.x - 1e-9) {
      float share = clamp((vValue - range.x) / max(range.y - range.x, 1e-12), 0.0, 1.0);
      float at = mix(ends.x, ends.y, share) * 9.0;
      int i = int(min(floor(at), 8.0));
      shade = mix(map[i], map[i + 1], at - float(i));
    }
    float edge = clamp((width + 1.0) * 0.5 - abs(vSide), 0.0, 1.0);
    gl_FragColor = vec4(shade, alpha * edge);
  }
`;

const GLASS_VERTEX = /* glsl */ `
  varying vec3 vNormal;
  varying vec3 vEye;
  void main() {
    vec4 place = modelViewMatrix * vec4(position, 1.0);
    vNormal = normalMatrix * normal;
    vEye = -place.xyz;
    gl_Position = projectionMatrix * place;
  }
`;

const GLASS_FRAGMENT = /* glsl */ `
  uniform vec3 colour;
  varying vec3 vNormal;
  varying vec3 vEye;
  void main() {
    float turned = 1.0 - abs(dot(normalize(vNormal), normalize(vEye)));
    gl_FragColor = vec4(colour, mix(0.07, 0.6, turned * turned * turned));
  }
`;

const RIBBON_VERTEX = /* glsl */ `
  attribute float fade;
  varying float vFade;
  void main() {
    vFade = fade;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }
`;

const RIBBON_FRAGMENT = /* glsl */ `
  uniform vec3 colour;
  uniform float alpha;
  varying float vFade;
  void main() { gl_FragColor = vec4(colour, alpha * vFade); }
`;

// A mark of a fixed size on the screen: disc (shape 0), ring (1) or diamond (2), with an edge in the background's
// colour, so that it stands apart from what lies behind it.
const MARK_VERTEX = /* glsl */ `
  uniform vec3 place;
  uniform vec2 size;
  uniform float radius;
  varying vec2 vAt;
  void main() {
    vec4 clip = projectionMatrix * modelViewMatrix * vec4(place, 1.0);
    vAt = position.xy * (radius + 2.0);
    clip.xy += vAt * 2.0 / size * clip.w;
    gl_Position = clip;
  }
`;

const MARK_FRAGMENT = /* glsl */ `
  uniform vec3 colour;
  uniform vec3 edge;
  uniform float radius;
  uniform float hole;
  uniform float rim;
  uniform float alpha;
  uniform int shape;
  varying vec2 vAt;
  void main() {
    float d = shape == 2 ? (abs(vAt.x) + abs(vAt.y)) * 0.7071 + radius * 0.2929 : length(vAt);
    float inside = clamp(radius + 0.5 - d, 0.0, 1.0);
    if (shape == 1) inside *= clamp(d - hole + 0.5, 0.0, 1.0);
    vec3 shade = mix(colour, edge, shape == 1 ? 0.0 : clamp(d - (radius - rim) + 0.5, 0.0, 1.0));
    gl_FragColor = vec4(shade, alpha * inside);
  }
`;

const SOLID_VERTEX = /* glsl */ `
  varying float vLight;
  void main() {
    vec3 n = normalize(normalMatrix * normal);
    vLight = 0.86 + 0.14 * dot(n, vec3(-0.4, 0.75, 0.53));
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }
`;

const SOLID_FRAGMENT = /* glsl */ `
  uniform vec3 colour;
  uniform float alpha;
  varying float vLight;
  void main() { gl_FragColor = vec4(colour * min(vLight, 1.0), alpha); }
`;

// An object's surface, lit from the eye's upper left, from both sides.
const OBJECT_VERTEX = /* glsl */ `
  varying vec3 vNormal;
  void main() {
    vNormal = normalMatrix * normal;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }
`;

const OBJECT_FRAGMENT = /* glsl */ `
  uniform vec3 colour;
  uniform float alpha;
  varying vec3 vNormal;
  void main() {
    float light = abs(dot(normalize(vNormal), vec3(-0.4, 0.75, 0.53)));
    gl_FragColor = vec4(colour * (0.66 + 0.34 * light), alpha);
  }
`;

type Uniforms = Record<string, IUniform>;

/** Uniforms that every material shares: one value for all. */
interface Shared {
  size: IUniform<Vector2>;
  floorZ: IUniform<number>;
  ends: IUniform<Vector2>;
  map: IUniform<Vector3[]>;
}

/** Data of a line: places and values of its points. Several meshes may draw the same data. */
class LineData {
  readonly geometry = new InstancedBufferGeometry();
  private readonly places: InstancedInterleavedBuffer;
  private readonly values: InstancedInterleavedBuffer;

  /** Takes points in a row, or pairs of points (`pairs`) that are lines of their own. */
  constructor(
    readonly xyz: Float32Array,
    readonly value: Float32Array,
    private readonly pairs = false,
  ) {
    this.places = new InstancedInterleavedBuffer(xyz, pairs ? 6 : 3);
    this.values = new InstancedInterleavedBuffer(value, pairs ? 2 : 1);
    this.places.setUsage(DynamicDrawUsage);
    this.values.setUsage(DynamicDrawUsage);
    const corners = new Float32Array([0, -1, 0, 1, 1, -1, 1, 1]);
    this.geometry.setAttribute("corner", new BufferAttribute(corners, 2));
    this.geometry.setIndex([0, 1, 2, 2, 1, 3]);
    this.geometry.setAttribute("from", new InterleavedBufferAttribute(this.places, 3, 0));
    this.geometry.setAttribute("to", new InterleavedBufferAttribute(this.places, 3, 3));
    this.geometry.setAttribute("fromValue", new InterleavedBufferAttribute(this.values, 1, 0));
    this.geometry.setAttribute("toValue", new InterleavedBufferAttribute(this.values, 1, 1));
    this.geometry.instanceCount = 0;
  }

  /** Uploads the first `count` points. */
  upload(count: number): void {
    this.geometry.instanceCount = this.pairs ? count >> 1 : Math.max(0, count - 1);
    if (count === 0) return;
    for (const [buffer, size] of [[this.places, 3], [this.values, 1]] as const) {
      buffer.clearUpdateRanges();
      buffer.addUpdateRange(0, size * count);
      buffer.needsUpdate = true;
    }
  }
}

class GlPainter implements Painter {
  readonly kind = "webgl";
  lost = false;
  private readonly scene = new Scene();
  private readonly eye = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.001, 100);
  private readonly materials: ShaderMaterial[] = [];
  private readonly shared: Shared = {
    size: { value: new Vector2(1, 1) },
    floorZ: { value: 0 },
    ends: { value: new Vector2(0, 1) },
    map: { value: CIVIDIS.map((c) => new Vector3(...parseColour(c))) },
  };
  private readonly tubeLine: Polyline;
  private readonly frames;
  private readonly tube;
  private readonly ribbon;
  private readonly tubeGeometry = new BufferGeometry();
  private readonly ribbonGeometry = new BufferGeometry();
  private readonly pathData: LineData;
  private readonly movementData: LineData;
  private readonly gridData = pairs(GRID_LINES);
  private readonly boxData = pairs(12);
  private readonly dropData = pairs(1);
  private readonly deviationData = pairs(1);
  private readonly sheetData = pairs(4);
  private readonly proxyData = pairs(1);
  private readonly normalData = pairs(1);
  private objects: { index: number; depth: Mesh; surface: Mesh }[] = [];
  private sceneVersion = -1;
  private readonly meshes;
  private readonly axis = new Vector3();
  private readonly up = new Vector3(0, 0, 1);
  private readonly spot = [0, 0, 0];
  private pathVersion = -1;
  private movementVersion = -1;
  private gridKey = "";
  private boxKey = "";
  private ratio = 1;
  private readonly renderer: WebGLRenderer;
  private readonly stopListening: () => void;

  constructor(canvas: HTMLCanvasElement, picture: Picture, software: boolean, changed: () => void) {
    this.renderer = new WebGLRenderer({ canvas, antialias: !software, alpha: false, powerPreference: "default" });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.renderer.sortObjects = true;
    const rings = software ? 256 : 640;
    this.tubeLine = createPolyline(rings);
    this.frames = createFrames(rings);
    this.tube = createTube(rings, software ? 18 : 28);
    this.ribbon = createRibbon(Math.max(2, picture.trail.age.length));
    this.pathData = new LineData(picture.path.xyz, picture.path.length);
    this.movementData = new LineData(picture.movement.xyz, picture.movement.value);

    const dynamic = (array: Float32Array, size: number): BufferAttribute =>
      new BufferAttribute(array, size).setUsage(DynamicDrawUsage) as BufferAttribute;
    this.tubeGeometry.setAttribute("position", dynamic(this.tube.position, 3));
    this.tubeGeometry.setAttribute("normal", dynamic(this.tube.normal, 3));
    this.tubeGeometry.setIndex(new BufferAttribute(this.tube.index, 1).setUsage(DynamicDrawUsage) as BufferAttribute);
    this.tubeGeometry.setDrawRange(0, 0);
    this.ribbonGeometry.setAttribute("position", dynamic(this.ribbon.position, 3));
    this.ribbonGeometry.setAttribute("fade", dynamic(this.ribbon.alpha, 1));
    this.ribbonGeometry.setIndex(new BufferAttribute(this.ribbon.index, 1));
    this.ribbonGeometry.setDrawRange(0, 0);

    const quad = new BufferGeometry();
    quad.setAttribute("position", new BufferAttribute(new Float32Array([-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0]), 3));
    quad.setIndex([0, 1, 2, 2, 1, 3]);
    const sheet = new BufferGeometry();
    sheet.setAttribute("position", dynamic(new Float32Array(12), 3));
    sheet.setAttribute("fade", new BufferAttribute(new Float32Array([1, 1, 1, 1]), 1));
    sheet.setIndex([0, 1, 2, 2, 1, 3]);

    // In the order of drawing. Nothing but the arrow needs a depth test: what is nearer does not hide the movement.
    // Objects are translucent, but hide each other by a depth that is written first and forgotten before the arrow.
    let order = 0;
    const line = (data: LineData): Mesh => this.add(data.geometry, this.lineMaterial(), order++);
    const mark = (): Mesh => this.add(quad, this.markMaterial(), order++);
    this.meshes = {
      box: line(this.boxData),
      grid: line(this.gridData),
      pathShadow: line(this.pathData),
      toolShadow: this.add(disc(24), this.solidMaterial(false), order++),
      drop: line(this.dropData),
      // The objects stand here: see OBJECT_ORDER.
      sheet: this.add(sheet, this.ribbonMaterial(), order++),
      sheetEdge: line(this.sheetData),
      path: line(this.pathData),
      movement: line(this.movementData),
      done: line(this.pathData),
      trail: this.add(this.ribbonGeometry, this.ribbonMaterial(), order++),
      tube: this.add(this.tubeGeometry, this.glassMaterial(), order++),
      goal: mark(),
      start: mark(),
      deviation: line(this.deviationData),
      proxyLine: line(this.proxyData),
      normal: line(this.normalData),
      arrow: this.add(arrowShape(20), this.solidMaterial(true), order++),
      head: this.add(coneShape(20), this.solidMaterial(true), order++),
      tool: mark(),
      proxy: mark(),
      reference: mark(),
      intention: mark(),
    };
    uniforms(this.meshes.pathShadow).flatten!.value = 1;
    this.meshes.arrow.onBeforeRender = () => {
      this.renderer.state.buffers.depth.setMask(true);
      this.renderer.clearDepth();
    };

    // The renderer asks for the context back, and uploads everything again when it comes.
    const lost = (): void => {
      this.lost = true;
      changed();
    };
    const restored = (): void => {
      this.lost = false;
      changed();
    };
    canvas.addEventListener("webglcontextlost", lost);
    canvas.addEventListener("webglcontextrestored", restored);
    this.stopListening = () => {
      canvas.removeEventListener("webglcontextlost", lost);
      canvas.removeEventListener("webglcontextrestored", restored);
    };
  }

  get canvas(): HTMLCanvasElement {
    return this.renderer.domElement;
  }

  resize(width: number, height: number, ratio: number): void {
    this.ratio = ratio;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.shared.size.value.set(width * ratio, height * ratio);
  }

  memory(): { geometries: number; textures: number } {
    return { geometries: this.renderer.info.memory.geometries, textures: this.renderer.info.memory.textures };
  }

  draw(p: Picture): void {
    if (this.lost) return;
    const m = this.meshes;
    const c = p.camera;
    const axes = axesOf(c);
    const eye = eyeOf(c, axes);
    const t = p.theme;
    this.renderer.setClearColor(new Color(...parseColour(t.background)), 1);
    this.eye.position.set(...eye);
    this.eye.up.set(...axes.up);
    this.eye.lookAt(eye[0] - axes.back[0], eye[1] - axes.back[1], eye[2] - axes.back[2]);
    this.eye.aspect = c.width / c.height;
    this.eye.near = Math.max(1e-4, c.distance / 1000);
    this.eye.far = c.distance * 1000;
    this.eye.updateProjectionMatrix();
    this.shared.floorZ.value = p.floor.z;
    this.shared.ends.value.set(...cividisRange(t.dark));

    if (p.pathVersion !== this.pathVersion) {
      this.pathVersion = p.pathVersion;
      this.pathData.upload(p.path.count);
      this.fillTube(p);
    }
    if (p.movement.version !== this.movementVersion) {
      this.movementVersion = p.movement.version;
      this.movementData.upload(p.movement.count);
    }
    this.placeFloor(p);
    this.placeObjects(p);

    const known = Number.isFinite(p.tool[0] + p.tool[1] + p.tool[2]);
    const tool = p.showTool && known;
    const hasPath = p.showPath && p.path.count > 1;
    this.line(m.pathShadow, hasPath && p.floor.visible, t.path, 1.5, 0.28);
    this.line(m.path, hasPath, t.path, 2, 1);
    this.line(m.done, hasPath && Number.isFinite(p.done) && p.done > 0, t.actual, 4, 1, p.done);
    m.tube.visible = p.showTunnel && this.tube.indices > 0;
    set(m.tube, t.path);
    // Paler than the tool, by colour: segments overlap, so an opacity would not be even.
    this.line(m.movement, p.showMovement && p.movement.count > 1, mix(t.actual, t.background, 0.35), p.colour.mode === "one" ? 1.7 : 2.2, 1);
    const movement = uniforms(m.movement);
    movement.mapped!.value = p.colour.mode === "one" ? 0 : 1;
    (movement.range!.value as Vector2).set(p.colour.low, p.colour.high);

    const floor = tool && p.floor.visible;
    m.toolShadow.visible = floor;
    this.line(m.drop, floor, t.path, 1, 0.7);
    if (floor) {
      const size = p.toolSize * 0.85 * metresPerPixel(c, this.depth(p, axes, p.tool[0], p.tool[1], p.floor.z));
      m.toolShadow.position.set(p.tool[0], p.tool[1], p.floor.z);
      m.toolShadow.scale.set(size, size, 1);
      set(m.toolShadow, t.path);
      uniforms(m.toolShadow).alpha!.value = 0.55;
      this.segment(this.dropData, p.tool, [p.tool[0], p.tool[1], p.floor.z]);
    }

    const outside = p.deviation.outside;
    this.line(m.deviation, tool && p.deviation.visible, outside ? t.stop : t.second, outside ? 2.6 : 1.5, 1);
    if (tool && p.deviation.visible) this.segment(this.deviationData, p.tool, p.reference);

    m.trail.visible = tool && p.showTrail && p.trail.count > 1;
    if (m.trail.visible) {
      const half = 0.6 * p.toolSize * metresPerPixel(c, this.depth(p, axes, ...p.tool));
      fillRibbon(p.trail.xyz, p.trail.age, p.trail.count, eye, half, this.ribbon);
      this.ribbonGeometry.setDrawRange(0, this.ribbon.indices);
      const corners = this.ribbon.indices / 3 + 2;
      for (const name of ["position", "fade"]) update(this.ribbonGeometry, name, corners);
      set(m.trail, t.actual);
      uniforms(m.trail).alpha!.value = 0.55;
    }
    this.placeArrow(p, axes, tool);
    this.mark(m.tool, tool, p.tool, t.actual, p.toolSize, 0, t.background);
    this.placeProxy(p, axes, tool);
    this.mark(m.reference, p.showReference, p.reference, t.expert, p.toolSize, 2, t.background);
    this.mark(m.start, p.start.visible, p.start.at, p.start.colour, 1.9 * p.toolSize, 1);
    this.mark(m.goal, p.goal.visible, p.goal.at, p.goal.colour, 1.7 * p.toolSize, 1);
    this.mark(m.intention, p.intention.visible, p.intention.at, t.text, 1.5 * p.toolSize, 1);
    uniforms(m.intention).hole!.value = (1.5 * p.toolSize - 2) * this.ratio;
    this.placeSheet(p);
    this.renderer.render(this.scene, this.eye);
  }

  dispose(): void {
    this.stopListening();
    for (const mesh of Object.values(this.meshes)) mesh.geometry.dispose();
    this.dropObjects();
    for (const material of this.materials) material.dispose();
    this.renderer.dispose();
    // Browsers keep few contexts: this one goes now, not when the collector comes.
    this.renderer.forceContextLoss();
  }

  private depth(p: Picture, axes: ReturnType<typeof axesOf>, x: number, y: number, z: number): number {
    projectWith(p.camera, axes, x, y, z, this.spot);
    return Math.max(1e-4, this.spot[2]!);
  }

  private fillTube(p: Picture): void {
    const line = p.path;
    const at = (k: number): Float32Array => {
      const plane = new Float32Array(line.count);
      for (let i = 0; i < line.count; i++) plane[i] = line.xyz[3 * i + k]!;
      return plane;
    };
    fillPolyline({ count: line.count, x: at(0), y: at(1), z: at(2), radius: line.radius }, this.tubeLine);
    fillFrames(this.tubeLine, this.frames);
    fillTube(this.tubeLine, this.frames, this.tube);
    const points = 3 * this.tubeLine.count * (this.tube.sides + 1);
    for (const name of ["position", "normal"]) update(this.tubeGeometry, name, points / 3);
    const index = this.tubeGeometry.getIndex()!;
    index.clearUpdateRanges();
    if (this.tube.indices > 0) index.addUpdateRange(0, this.tube.indices);
    index.needsUpdate = true;
    this.tubeGeometry.setDrawRange(0, this.tube.indices);
  }

  private placeFloor(p: Picture): void {
    const f = p.floor;
    const grid = this.meshes.grid;
    this.line(grid, f.visible, p.theme.path, 1, p.theme.dark ? 0.32 : 0.3);
    const key = [f.z, f.step, f.x0, f.x1, f.y0, f.y1].join();
    if (f.visible && key !== this.gridKey) {
      this.gridKey = key;
      let n = 0;
      for (let i = Math.round(f.x0 / f.step); i * f.step <= f.x1 + 1e-9 && n < GRID_LINES; i++) {
        put(this.gridData, n++, [i * f.step, f.y0, f.z], [i * f.step, f.y1, f.z]);
      }
      for (let i = Math.round(f.y0 / f.step); i * f.step <= f.y1 + 1e-9 && n < GRID_LINES; i++) {
        put(this.gridData, n++, [f.x0, i * f.step, f.z], [f.x1, i * f.step, f.z]);
      }
      this.gridData.upload(2 * n);
    }
    const w = p.workspace;
    this.line(this.meshes.box, w.visible, p.theme.path, 1, 0.45);
    const boxKey = [...w.min, ...w.max].join();
    if (w.visible && boxKey !== this.boxKey) {
      this.boxKey = boxKey;
      let n = 0;
      const corner = (i: number): [number, number, number] => [
        i & 1 ? w.max[0] : w.min[0],
        i & 2 ? w.max[1] : w.min[1],
        i & 4 ? w.max[2] : w.min[2],
      ];
      for (let i = 0; i < 8; i++) {
        for (const bit of [1, 2, 4]) if (!(i & bit)) put(this.boxData, n++, corner(i), corner(i | bit));
      }
      this.boxData.upload(2 * n);
    }
  }

  private dropObjects(): void {
    for (const { depth, surface } of this.objects) {
      this.scene.remove(depth, surface);
      surface.geometry.dispose();
      for (const mesh of [depth, surface]) (mesh.material as ShaderMaterial).dispose();
    }
    this.objects = [];
  }

  private placeObjects(p: Picture): void {
    const version = p.scene?.version ?? 0;
    if (version !== this.sceneVersion) {
      this.sceneVersion = version;
      this.dropObjects();
      p.scene?.objects.forEach(({ shape }, index) => {
        if (shape === null) return;
        const geometry = new BufferGeometry();
        geometry.setAttribute("position", new BufferAttribute(shape.position, 3));
        geometry.setAttribute("normal", new BufferAttribute(shape.normal, 3));
        const material = (): ShaderMaterial =>
          new ShaderMaterial({
            vertexShader: OBJECT_VERTEX,
            fragmentShader: OBJECT_FRAGMENT,
            uniforms: { colour: { value: new Color() }, alpha: { value: 1 } },
            transparent: true,
            side: DoubleSide,
          });
        const depth = this.add(geometry, material(), OBJECT_ORDER);
        (depth.material as ShaderMaterial).colorWrite = false;
        const surface = this.add(geometry, material(), OBJECT_ORDER + 0.1);
        (surface.material as ShaderMaterial).depthWrite = false;
        this.objects.push({ index, depth, surface });
      });
    }
    for (const { index, surface } of this.objects) {
      set(surface, objectColour(p, index));
      uniforms(surface).alpha!.value = index === p.touched ? TOUCHED_ALPHA : OBJECT_ALPHA;
    }
  }

  private placeProxy(p: Picture, axes: ReturnType<typeof axesOf>, tool: boolean): void {
    const m = this.meshes;
    const { at, normal } = p.proxy;
    const visible = tool && p.proxy.visible;
    this.mark(m.proxy, visible, at, p.theme.text, 0.75 * p.toolSize, 1);
    this.line(m.proxyLine, visible, p.theme.text, 2, 1);
    this.line(m.normal, visible && p.proxy.showNormal, p.theme.second, 2.5, 1);
    if (!visible) return;
    this.segment(this.proxyData, p.tool, at);
    const length = NORMAL_LENGTH * p.toolSize * metresPerPixel(p.camera, this.depth(p, axes, ...at));
    this.segment(this.normalData, at, [0, 1, 2].map((k) => at[k]! + length * normal[k]!));
  }

  private placeArrow(p: Picture, axes: ReturnType<typeof axesOf>, tool: boolean): void {
    const { arrow, head } = this.meshes;
    const [fx, fy, fz] = p.arrow.force;
    const size = Math.hypot(fx, fy, fz);
    arrow.visible = head.visible = tool && p.arrow.visible && size > 0;
    if (!arrow.visible) return;
    const pixel = metresPerPixel(p.camera, this.depth(p, axes, ...p.tool));
    const length = ARROW_SCALE * size;
    // The tip is where the scale says; a short arrow has a smaller head.
    const headLength = Math.min(1.7 * p.toolSize * pixel, 0.6 * length);
    const headRadius = 0.4 * headLength;
    const shaft = Math.min(0.34 * p.toolSize * pixel, 0.5 * headRadius);
    this.axis.set(fx / size, fy / size, fz / size);
    for (const mesh of [arrow, head]) {
      mesh.quaternion.setFromUnitVectors(this.up, this.axis);
      set(mesh, p.theme.force);
    }
    arrow.position.set(...p.tool);
    arrow.scale.set(shaft, shaft, Math.max(1e-6, length - headLength));
    head.position.set(...p.tool).addScaledVector(this.axis, length - headLength);
    head.scale.set(headRadius, headRadius, headLength);
  }

  private placeSheet(p: Picture): void {
    const { sheet, sheetEdge } = this.meshes;
    sheet.visible = p.sheet.visible;
    this.line(sheetEdge, p.sheet.visible, p.theme.second, 1, 0.5);
    if (!p.sheet.visible) return;
    const { axis, at, half } = p.sheet;
    const u = (axis + 1) % 3;
    const v = (axis + 2) % 3;
    const corners = [[-1, -1], [1, -1], [-1, 1], [1, 1]].map(([a, b]) => {
      const corner: [number, number, number] = [...at];
      corner[u]! += a! * half[u]!;
      corner[v]! += b! * half[v]!;
      return corner;
    });
    const places = sheet.geometry.getAttribute("position");
    corners.forEach((corner, i) => places.setXYZ(i, ...corner));
    (places as BufferAttribute).needsUpdate = true;
    set(sheet, p.theme.actual);
    uniforms(sheet).alpha!.value = 0.07;
    [[0, 1], [1, 3], [3, 2], [2, 0]].forEach(([a, b], i) => put(this.sheetData, i, corners[a!]!, corners[b!]!));
    this.sheetData.upload(8);
  }

  private segment(data: LineData, a: readonly number[], b: readonly number[]): void {
    put(data, 0, a, b);
    data.upload(2);
  }

  private line(mesh: Mesh, visible: boolean, colour: string, width: number, alpha: number, limit = 1e30): void {
    mesh.visible = visible;
    if (!visible) return;
    const u = uniforms(mesh);
    (u.colour!.value as Color).setRGB(...parseColour(colour));
    u.width!.value = width * this.ratio;
    u.alpha!.value = alpha;
    u.limit!.value = limit;
  }

  private mark(
    mesh: Mesh,
    visible: boolean,
    at: readonly [number, number, number],
    colour: string,
    radius: number,
    shape: 0 | 1 | 2,
    edge = colour,
  ): void {
    mesh.visible = visible && Number.isFinite(at[0] + at[1] + at[2]);
    if (!mesh.visible) return;
    const u = uniforms(mesh);
    (u.place!.value as Vector3).set(...at);
    (u.colour!.value as Color).setRGB(...parseColour(colour));
    (u.edge!.value as Color).setRGB(...parseColour(edge));
    u.radius!.value = radius * this.ratio;
    u.hole!.value = 0.72 * radius * this.ratio;
    u.rim!.value = edge === colour ? 0 : 1.2 * this.ratio;
    u.shape!.value = shape;
  }

  private add(geometry: BufferGeometry, material: ShaderMaterial, order: number): Mesh {
    const mesh = new Mesh(geometry, material);
    mesh.frustumCulled = false;
    mesh.renderOrder = order;
    this.scene.add(mesh);
    return mesh;
  }

  private material(vertexShader: string, fragmentShader: string, own: Uniforms, depth = false): ShaderMaterial {
    const material = new ShaderMaterial({
      vertexShader,
      fragmentShader,
      uniforms: { ...own, ...this.shared },
      transparent: true,
      side: DoubleSide,
      depthTest: depth,
      depthWrite: depth,
    });
    this.materials.push(material);
    return material;
  }

  private lineMaterial(): ShaderMaterial {
    return this.material(LINE_VERTEX, LINE_FRAGMENT, {
      colour: { value: new Color() },
      alpha: { value: 1 },
      width: { value: 1 },
      limit: { value: 1e30 },
      flatten: { value: 0 },
      mapped: { value: 0 },
      range: { value: new Vector2(0, 1) },
    });
  }

  private glassMaterial(): ShaderMaterial {
    return this.material(GLASS_VERTEX, GLASS_FRAGMENT, { colour: { value: new Color() } });
  }

  private ribbonMaterial(): ShaderMaterial {
    return this.material(RIBBON_VERTEX, RIBBON_FRAGMENT, { colour: { value: new Color() }, alpha: { value: 1 } });
  }

  private solidMaterial(depth: boolean): ShaderMaterial {
    return this.material(SOLID_VERTEX, SOLID_FRAGMENT, { colour: { value: new Color() }, alpha: { value: 1 } }, depth);
  }

  private markMaterial(): ShaderMaterial {
    return this.material(MARK_VERTEX, MARK_FRAGMENT, {
      place: { value: new Vector3() },
      colour: { value: new Color() },
      edge: { value: new Color() },
      radius: { value: 1 },
      hole: { value: 0 },
      rim: { value: 0 },
      alpha: { value: 1 },
      shape: { value: 0 },
    });
  }
}

function uniforms(mesh: Mesh): Uniforms {
  return (mesh.material as ShaderMaterial).uniforms;
}

function set(mesh: Mesh, colour: string): void {
  (uniforms(mesh).colour!.value as Color).setRGB(...parseColour(colour));
}

function update(geometry: BufferGeometry, name: string, points: number): void {
  const attribute = geometry.getAttribute(name) as BufferAttribute;
  attribute.clearUpdateRanges();
  if (points > 0) attribute.addUpdateRange(0, points * attribute.itemSize);
  attribute.needsUpdate = true;
}

function pairs(lines: number): LineData {
  return new LineData(new Float32Array(6 * lines), new Float32Array(2 * lines), true);
}

function put(data: LineData, line: number, a: readonly number[], b: readonly number[]): void {
  data.xyz.set([a[0]!, a[1]!, a[2]!, b[0]!, b[1]!, b[2]!], 6 * line);
}

/** Disc of radius 1 in the plane z = 0. */
function disc(sides: number): BufferGeometry {
  const position: number[] = [0, 0, 0];
  const normal: number[] = [0, 0, 1];
  const index: number[] = [];
  for (let s = 0; s <= sides; s++) {
    const angle = (2 * Math.PI * s) / sides;
    position.push(Math.cos(angle), Math.sin(angle), 0);
    normal.push(0, 0, 1);
    if (s > 0) index.push(0, s, s + 1);
  }
  return shape(position, normal, index);
}

/** Cylinder of radius 1 from z = 0 to z = 1, without lids. */
function arrowShape(sides: number): BufferGeometry {
  return turned(sides, [[1, 0, 0], [1, 1, 0]]);
}

/** Cone from a base of radius 1 at z = 0 to its tip at z = 1, with its base. */
function coneShape(sides: number): BufferGeometry {
  return turned(sides, [[0, 0, -1], [1, 0, -1], [1, 0, 0.4], [0, 1, 0.4]]);
}

/** Turns a profile of (radius, height, slope of the normal) about z. */
function turned(sides: number, profile: [number, number, number][]): BufferGeometry {
  const position: number[] = [];
  const normal: number[] = [];
  const index: number[] = [];
  profile.forEach(([radius, height, slope], ring) => {
    for (let s = 0; s <= sides; s++) {
      const angle = (2 * Math.PI * s) / sides;
      position.push(radius * Math.cos(angle), radius * Math.sin(angle), height);
      const across = Math.sqrt(Math.max(0, 1 - slope * slope));
      normal.push(across * Math.cos(angle), across * Math.sin(angle), slope);
      if (ring > 0 && s < sides) {
        const a = (ring - 1) * (sides + 1) + s;
        const b = a + sides + 1;
        index.push(a, b, a + 1, a + 1, b, b + 1);
      }
    }
  });
  return shape(position, normal, index);
}

function shape(position: number[], normal: number[], index: number[]): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(position), 3));
  geometry.setAttribute("normal", new BufferAttribute(new Float32Array(normal), 3));
  geometry.setIndex(index);
  return geometry;
}

/** Creates a painter on a canvas. Throws if the browser gives no WebGL. */
export function createGlPainter(
  canvas: HTMLCanvasElement,
  picture: Picture,
  software: boolean,
  changed: () => void,
): Painter {
  return new GlPainter(canvas, picture, software, changed);
}

