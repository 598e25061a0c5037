import assert from "node:assert/strict";
import test from "node:test";
import { load } from "./load.mjs";
import { distance, noise, paths, planes } from "./shapes.mjs";

const page = await load(
  "scene/polyline", "scene/tube", "scene/ribbon", "scene/nearest", "scene/camera", "scene/plane", "scene/theme",
);
const { createPolyline, fillPolyline, createFrames, fillFrames, createTube, fillTube } = page;

function prepared(points, capacity = 4096) {
  const line = createPolyline(capacity);
  fillPolyline(planes(points), line);
  return line;
}

const at = (array, i) => [...array.slice(3 * i, 3 * i + 3)];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

test("A polyline drops points that are not finite or that repeat the one before", () => {
  const line = prepared([[0, 0, 0], [0, 0, 0], [NaN, 0, 0], [0.01, 0, 0], [0.01, Infinity, 0], [0.01, 0.02, 0]]);
  assert.equal(line.count, 3);
  assert.ok(Math.abs(line.length[2] - 0.03) < 1e-8);
});

test("A path of more points than fit keeps its ends, its length and equal steps", () => {
  const points = paths()["figure eight"];
  const full = prepared(points);
  const line = prepared(points, 200);
  assert.equal(line.count, 200);
  assert.ok(distance(at(line.xyz, 0), points[0]) < 1e-7);
  assert.ok(distance(at(line.xyz, 199), points.at(-1)) < 1e-7);
  assert.ok(Math.abs(line.length[199] - full.length[full.count - 1]) < 1e-6);
  for (let i = 1; i < 200; i++) {
    const chord = distance(at(line.xyz, i), at(line.xyz, i - 1));
    const step = line.length[i] - line.length[i - 1];
    assert.ok(chord > 0.98 * step && chord < 1.001 * step, `step ${i}: ${chord} of ${step}`);
  }
});

test("A polyline of one point or of none has no length and no crash", () => {
  for (const points of [[], [[1, 2, 3]]]) {
    const line = prepared(points);
    const frames = createFrames(4);
    fillFrames(line, frames);
    const tube = createTube(4, 6);
    fillTube(line, frames, tube);
    assert.equal(tube.indices, 0);
    assert.ok(Number.isNaN(page.nearestToPoint(line, [0, 0, 0], -1, 1)));
  }
});

for (const [name, points] of Object.entries(paths())) {
  test(`Frames along the ${name} are orthonormal and do not twist about the path`, () => {
    const line = prepared(points, 640);
    const f = createFrames(640);
    fillFrames(line, f);
    for (let i = 0; i < line.count; i++) {
      const [t, u, v] = [at(f.tangent, i), at(f.u, i), at(f.v, i)];
      for (const x of [t, u, v]) assert.ok(Math.abs(Math.hypot(...x) - 1) < 1e-4);
      assert.ok(Math.abs(dot(t, u)) < 1e-4 && Math.abs(dot(t, v)) < 1e-4 && Math.abs(dot(u, v)) < 1e-4);
      if (i === 0) continue;
      // Without twist u turns by no more than the tangent does.
      const turned = Math.acos(Math.min(1, dot(u, at(f.u, i - 1))));
      const bent = Math.acos(Math.min(1, dot(t, at(f.tangent, i - 1))));
      assert.ok(turned <= bent + 0.01, `point ${i}: u turns by ${turned}, the path by ${bent}`);
    }
  });
}

test("Frames along a coarse helix turn against its torsion, as exact rotation-minimising frames do", () => {
  const [r, pitch, turns, n] = [0.03, 0.01, 2, 160];
  const angle = (i) => (2 * Math.PI * turns * i) / (n - 1);
  const line = prepared(Array.from({ length: n }, (_, i) => [r * Math.cos(angle(i)), r * Math.sin(angle(i)), pitch * angle(i)]));
  const f = createFrames(n);
  fillFrames(line, f);
  // Angle of u in the plane of the helix's normal (towards the axis) and binormal.
  const against = (i) => {
    const normal = [-Math.cos(angle(i)), -Math.sin(angle(i)), 0];
    const t = at(f.tangent, i);
    const b = [t[1] * normal[2] - t[2] * normal[1], t[2] * normal[0] - t[0] * normal[2], t[0] * normal[1] - t[1] * normal[0]];
    return Math.atan2(dot(at(f.u, i), b), dot(at(f.u, i), normal));
  };
  const size = Math.hypot(r, pitch);
  const torsion = pitch / size ** 2;
  const expected = -torsion * size * (angle(n - 5) - angle(4));
  const turned = against(n - 5) - against(4) - expected;
  const wrapped = turned - 2 * Math.PI * Math.round(turned / (2 * Math.PI));
  assert.ok(Math.abs(wrapped) < 0.002, `${wrapped} rad off after two turns`);
});

test("Every point of the tube lies at its radius from the path, and its normal points out", () => {
  const line = prepared(paths().circle, 256);
  for (let i = 0; i < line.count; i++) line.radius[i] = 0.004 + 0.001 * Math.sin(i / 20);
  const frames = createFrames(256);
  const tube = createTube(256, 12);
  fillFrames(line, frames);
  fillTube(line, frames, tube);
  for (let i = 0; i < line.count; i++) {
    for (let s = 0; s <= 12; s++) {
      const p = at(tube.position, 13 * i + s);
      const centre = at(line.xyz, i);
      assert.ok(Math.abs(distance(p, centre) - line.radius[i]) < 1e-6);
      const out = p.map((x, k) => (x - centre[k]) / line.radius[i]);
      const n = at(tube.normal, 13 * i + s);
      assert.ok(dot(out, n) > 0.95 && Math.abs(Math.hypot(...n) - 1) < 1e-5);
    }
  }
  assert.equal(tube.indices, 6 * 12 * (line.count - 1));
});

test("A stretch without a radius leaves the tube open", () => {
  const line = prepared(paths().circle, 256);
  for (let i = 100; i < 120; i++) line.radius[i] = NaN;
  const frames = createFrames(256);
  const tube = createTube(256, 8);
  fillFrames(line, frames);
  fillTube(line, frames, tube);
  assert.equal(tube.indices, 6 * 8 * (line.count - 1 - 21));
  for (let i = 0; i < tube.indices; i++) {
    const ring = Math.floor(tube.index[i] / 9);
    assert.ok(ring < 100 || ring >= 120);
  }
  assert.ok(tube.position.slice(0, 3 * 9 * line.count).every(Number.isFinite), "a hidden ring is finite too");
});

test("The ribbon faces the eye, tapers and fades with the age", () => {
  const n = 40;
  const xyz = new Float32Array(3 * n);
  const age = new Float32Array(n);
  for (let i = 0; i < n; i++) {
    xyz.set([0.001 * i, 0.01 * Math.sin(i / 8), 0], 3 * i);
    age[i] = 1 - i / (n - 1);
  }
  const ribbon = page.createRibbon(n);
  const eye = [0, -0.3, 0.2];
  page.fillRibbon(xyz, age, n, eye, 0.002, ribbon);
  assert.equal(ribbon.indices, 6 * (n - 1));
  for (let i = 1; i < n - 1; i++) {
    const a = at(ribbon.position, 2 * i);
    const b = at(ribbon.position, 2 * i + 1);
    const side = a.map((x, k) => x - b[k]);
    const towards = eye.map((x, k) => x - xyz[3 * i + k]);
    const along = [0, 1, 2].map((k) => xyz[3 * i + 3 + k] - xyz[3 * i - 3 + k]);
    assert.ok(Math.abs(Math.hypot(...side) - 0.004 * (1 - age[i])) < 1e-6);
    assert.ok(Math.abs(dot(side, towards)) < 1e-6 && Math.abs(dot(side, along)) < 1e-6);
    assert.ok(Math.abs(ribbon.alpha[2 * i] - (1 - age[i])) < 1e-6);
  }
});

test("The nearest place of a ray is the one that a dense search finds", () => {
  const random = noise(3);
  const line = prepared(paths()["figure eight"]);
  const found = { length: 0, depth: 0, distance: 0 };
  const spot = [0, 0, 0];
  for (let trial = 0; trial < 60; trial++) {
    const origin = [random(), random(), random()].map((x) => 0.3 * x);
    const aim = [random(), random(), random()].map((x) => 0.03 * x);
    const span = distance(aim, origin);
    const direction = aim.map((x, k) => (x - origin[k]) / span);
    assert.ok(page.nearestToRay(line, { origin, direction }, -Infinity, Infinity, found));
    let best = Infinity;
    for (let s = 0; s <= line.length[line.count - 1]; s += 1e-5) {
      page.pointAt(line, s, spot);
      const t = Math.max(0, dot(spot.map((x, k) => x - origin[k]), direction));
      best = Math.min(best, distance(spot, origin.map((x, k) => x + t * direction[k])));
    }
    assert.ok(Math.abs(found.distance - best) < 2e-5, `${found.distance} against ${best}`);
    page.pointAt(line, found.length, spot);
    const there = origin.map((x, k) => x + found.depth * direction[k]);
    assert.ok(Math.abs(distance(spot, there) - found.distance) < 1e-6, "place, depth and distance belong together");
  }
});

test("The nearest place stays in the stretch that is searched, also within a segment", () => {
  const line = prepared([[0, 0, 0], [0.1, 0, 0]]);
  const found = { length: 0, depth: 0, distance: 0 };
  const ray = { origin: [0.09, 0, 1], direction: [0, 0, -1] };
  page.nearestToRay(line, ray, 0.02, 0.05, found);
  assert.ok(Math.abs(found.length - 0.05) < 1e-7);
  assert.equal(page.nearestToRay(line, ray, 0.2, 0.3, found), false);
});

function camera(changes = {}) {
  return Object.assign(page.createCamera(), { width: 800, height: 600 }, changes);
}

test("A ray through the place of a point goes through the point", () => {
  const c = camera({ azimuth: 0.7, elevation: -0.3, shiftX: 0.02, shiftY: -0.01, centre: [0.01, 0.02, 0.03] });
  const spot = [0, 0, 0];
  for (const p of [[0, 0, 0], [0.05, -0.02, 0.04], [-0.1, 0.1, -0.1]]) {
    page.project(c, ...p, spot);
    const { origin, direction } = page.rayThrough(c, spot[0], spot[1]);
    const t = dot(p.map((x, k) => x - origin[k]), direction);
    assert.ok(distance(p, origin.map((x, k) => x + t * direction[k])) < 1e-9);
    assert.ok(spot[2] > 0);
  }
});

test("Zooming keeps the place under the pointer", () => {
  const c = camera({ azimuth: 0.4, elevation: 0.5 });
  const axes = page.axesOf(c);
  const p = [0, 1, 2].map((k) => c.centre[k] + 0.03 * axes.right[k] - 0.02 * axes.up[k]);
  const spot = [0, 0, 0];
  page.project(c, ...p, spot);
  const [x, y] = spot;
  for (const factor of [0.5, 0.8, 3]) page.zoom(c, factor, x, y, 0.01, 10);
  page.project(c, ...p, spot);
  assert.ok(Math.abs(spot[0] - x) < 1e-6 && Math.abs(spot[1] - y) < 1e-6);
  assert.ok(Math.abs(c.distance - 0.5 * 1.2) < 1e-9);
  page.zoom(c, 1e-9, x, y, 0.01, 10);
  assert.equal(c.distance, 0.01);
});

test("A drag turns about the fitted centre: the centre keeps its place, also after a pan", () => {
  const c = camera({ centre: [0.02, 0.01, -0.03] });
  page.pan(c, 90, -40);
  const spot = [0, 0, 0];
  page.project(c, ...c.centre, spot);
  const [x, y] = spot;
  page.turn(c, 130, 77);
  page.project(c, ...c.centre, spot);
  assert.ok(Math.abs(spot[0] - x) < 1e-9 && Math.abs(spot[1] - y) < 1e-9);
  assert.ok(Math.abs(x - 490) < 1e-9 && Math.abs(y - 260) < 1e-9, "a pan moves the picture with the pointer");
});

test("z stays up and the elevation stops before the poles", () => {
  const c = camera();
  for (const dy of [1e4, -1e4]) {
    page.turn(c, 0, dy);
    assert.ok(page.axesOf(c).up[2] > 0);
  }
});

for (const [name, points] of Object.entries(paths())) {
  for (const [width, height] of [[1280, 700], [360, 640], [800, 300]]) {
    test(`A fit shows the whole ${name} in the free part of ${width} x ${height}, and fills it`, () => {
      const c = camera({ width, height });
      const spheres = points.flatMap((p) => [...p, 0.005]);
      const insets = { left: 0.1, right: 0.05, top: 0.08, bottom: 0.27 };
      page.fit(c, spheres, insets);
      const spot = [0, 0, 0];
      let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
      for (const p of points) {
        page.project(c, ...p, spot);
        const r = 0.005 / page.metresPerPixel(c, spot[2]);
        [x0, x1] = [Math.min(x0, spot[0] - r), Math.max(x1, spot[0] + r)];
        [y0, y1] = [Math.min(y0, spot[1] - r), Math.max(y1, spot[1] + r)];
      }
      assert.ok(x0 >= 0.1 * width - 1.5 && x1 <= 0.95 * width + 1.5, `${x0} to ${x1}`);
      assert.ok(y0 >= 0.08 * height - 1.5 && y1 <= 0.73 * height + 1.5, `${y0} to ${y1}`);
      const fills = Math.max((x1 - x0) / (0.85 * width), (y1 - y0) / (0.65 * height));
      assert.ok(fills > 0.93, `fills ${fills}`);
    });
  }
}

test("The axis views look along an axis with x to the right from the front", () => {
  const c = camera();
  page.lookAlong(c, 1);
  assert.deepEqual(page.axesOf(c).right.map(Math.round), [1, 0, 0]);
  page.lookAlong(c, 2);
  assert.ok(page.axesOf(c).back[2] > 0.99 && page.axesOf(c).right[0] > 0.99);
  page.lookAlong(c, 0);
  assert.ok(page.axesOf(c).back[0] > 0.99);
  page.lookAlong(c, 0, true);
  assert.ok(page.axesOf(c).back[0] < -0.99);
});

test("The section's axes lie across the path and agree with the camera", () => {
  const axes = page.axesOf(camera());
  const far = axes.back.map((b) => -b);
  const { right, up } = page.sectionAxes(far, axes, null);
  assert.ok(dot(right, axes.right) > 0.999 && dot(up, axes.up) > 0.999, "a path that leads away");
  const beside = page.sectionAxes(axes.right, axes, null);
  assert.ok(dot(beside.up, axes.up) > 0.999);
  assert.ok(dot(beside.right, axes.back) > 0.999, "of a path to the right, the right side is near the camera");
  const rising = page.sectionAxes(axes.up, axes, null);
  assert.ok(dot(rising.right, axes.right) > 0.999);
  assert.ok(dot(rising.up, axes.back) > 0.999, "of a path upwards, the upper side is near the camera");
  const towards = page.sectionAxes(axes.back, axes, null);
  assert.ok(dot(towards.right, axes.right) > 0.999 && dot(towards.up, axes.up) > 0.999, "a path that comes nearer");
});

test("The section does not flip while the path turns", () => {
  const axes = page.axesOf(camera());
  const sweep = (from, to, last) => {
    let flips = 0;
    for (let i = 0; i <= 400; i++) {
      // Angle from "to the right" over "away" to "to the left".
      const angle = from + ((to - from) * i) / 400;
      const t = [0, 1, 2].map((k) => Math.cos(angle) * axes.right[k] - Math.sin(angle) * axes.back[k] + 0.1 * axes.up[k]);
      const size = Math.hypot(...t);
      const now = page.sectionAxes(t.map((x) => x / size), axes, last);
      assert.ok(Math.abs(dot(now.right, t)) < 1e-6 && Math.abs(dot(now.up, t)) < 1e-6, "across the path");
      if (last !== null && dot(now.right, last.right) < 0) flips++;
      last = now;
    }
    return { flips, last };
  };
  assert.equal(sweep(0, Math.PI, null).flips, 0, "from right over away to left");
  let { last } = sweep(-Math.PI / 2, -0.5, null);
  for (let i = 0; i < 3; i++) {
    for (const [from, to] of [[-0.3, 0.3], [0.3, -0.3]]) {
      const swept = sweep(from, to, last);
      assert.equal(swept.flips, 0, "a path that wavers about the right");
      last = swept.last;
    }
  }
});

test("Cividis uses the part of its range that stands out from the background of each theme", () => {
  const luminance = (c) => page.luminance(page.cssColour(c));
  const contrast = (a, b) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  for (const [dark, background] of [[false, "#FAFBFC"], [true, "#11161B"]]) {
    for (const share of [0, 0.25, 0.5, 0.75, 1]) {
      const c = contrast(luminance(page.cividis(share, dark)), page.luminance(background));
      assert.ok(c > 1.7, `${background} ${share}: ${c}`);
    }
    // The end that is left out does not stand out.
    const end = luminance(page.parseColour(dark ? page.CIVIDIS[0] : page.CIVIDIS[9]));
    assert.ok(contrast(end, page.luminance(background)) < 1.3);
    const bright = [0, 0.5, 1].map((share) => luminance(page.cividis(share, dark)));
    assert.ok(bright[0] < bright[1] && bright[1] < bright[2], "brighter means more");
  }
});
