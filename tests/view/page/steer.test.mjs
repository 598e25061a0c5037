import assert from "node:assert/strict";
import test from "node:test";
import { load } from "./load.mjs";
import { distance, noise, paths, planes, rms } from "./shapes.mjs";

const page = await load("scene/hand", "scene/camera", "scene/polyline", "scene/nearest");
const { Hand, createCamera, rayThrough, project, fit, axesOf, createPolyline, fillPolyline, pointAt } = page;

function prepared(points) {
  const line = createPolyline(4096);
  fillPolyline(planes(points), line);
  return line;
}

function cameraOn(line, azimuth, elevation) {
  const camera = createCamera();
  Object.assign(camera, { width: 900, height: 700, azimuth, elevation });
  const spheres = [];
  for (let i = 0; i < line.count; i += 10) spheres.push(...line.xyz.slice(3 * i, 3 * i + 3), 0.005);
  fit(camera, spheres, { left: 0.05, right: 0.05, top: 0.1, bottom: 0.1 });
  return camera;
}

const CAMERAS = { "as fitted": [0.28, 0.42], "from the side": [-1.0, 0.7] };

// Traces a path on the screen with `pixels` of noise. Returns distances to the path and to the traced point [m].
function trace(line, camera, pixels, rate = 125, speed = 0.06, rounds = 1) {
  const total = rounds * line.length[line.count - 1];
  const random = noise(7);
  const spot = [0, 0, 0];
  const truth = [0, 0, 0];
  pointAt(line, 0, truth);
  const start = [...truth];
  project(camera, ...start, spot);
  const view = axesOf(camera).back.map((b) => -b);
  const hand = new Hand(line, start, rayThrough(camera, spot[0], spot[1]), view);
  const off = [];
  const late = [];
  for (let i = 1; (i * speed) / rate < total; i++) {
    pointAt(line, ((i * speed) / rate) % line.length[line.count - 1], truth);
    project(camera, ...truth, spot);
    const at = hand.move(rayThrough(camera, spot[0] + pixels * random(), spot[1] + pixels * random()), 1 / rate);
    off.push(nearest(line, at));
    late.push(distance(at, truth));
  }
  return { off: rms(off), late: rms(late), worst: Math.max(...off) };
}

function nearest(line, p) {
  const spot = [0, 0, 0];
  pointAt(line, page.nearestToPoint(line, p, -Infinity, Infinity), spot);
  return distance(spot, p);
}

for (const [name, points] of Object.entries(paths())) {
  for (const [where, angles] of Object.entries(CAMERAS)) {
    test(`A tracer with 2 px of noise stays within 1 mm rms of the ${name}, seen ${where}`, () => {
      const line = prepared(points);
      const { off, worst } = trace(line, cameraOn(line, ...angles), 2);
      assert.ok(off > 0.00001, `the noise must show: ${off}`);
      assert.ok(off < 0.001, `${1000 * off} mm rms`);
      assert.ok(worst < 0.005, `${1000 * worst} mm at worst: outside a tunnel of 5 mm`);
    });
  }
}

test("The depth follows a fast tracer without a lag", () => {
  const line = prepared(paths().circle);
  const { late } = trace(line, cameraOn(line, 0.28, 0.42), 0, 125, 0.25);
  assert.ok(late < 0.0005, `${1000 * late} mm behind the tracer`);
});

test("A tracer goes round a closed path several times", () => {
  for (const name of ["circle", "square", "figure eight"]) {
    const line = prepared(paths()[name]);
    const { late } = trace(line, cameraOn(line, 0.28, 0.42), 2, 125, 0.06, 3);
    assert.ok(late < 0.001, `${name}: ${1000 * late} mm rms from the tracer`);
  }
});

test("A press beside the path starts at the tool, not at the path", () => {
  const line = prepared(paths().circle);
  const camera = cameraOn(line, 0.28, 0.42);
  const axes = axesOf(camera);
  const tool = [0.04, 0, 0.01].map((x, k) => x + 0.004 * axes.back[k]);
  const spot = [0, 0, 0];
  project(camera, ...tool, spot);
  const ray = rayThrough(camera, spot[0], spot[1]);
  const hand = new Hand(line, tool, ray, axes.back.map((b) => -b));
  const first = hand.move(ray, 0.001);
  assert.ok(distance(first, tool) < 0.0003, `jumps by ${1000 * distance(first, tool)} mm`);
  let at = first;
  for (let i = 0; i < 200; i++) at = hand.move(ray, 0.01);
  const best = { length: 0, depth: 0, distance: 0 };
  page.nearestToRay(line, ray, -Infinity, Infinity, best);
  assert.ok(nearest(line, at) < best.distance + 0.0001, "the difference in depth fades");
});

test("A jump of the pointer far along the path moves the hand at a bounded speed", () => {
  const line = prepared(paths().circle);
  const camera = cameraOn(line, 0.28, 0.42);
  const spot = [0, 0, 0];
  const start = [0.04, 0, 0.01];
  project(camera, ...start, spot);
  const hand = new Hand(line, start, rayThrough(camera, spot[0], spot[1]), axesOf(camera).back.map((b) => -b));
  const before = hand.length;
  pointAt(line, 0.02, spot);
  project(camera, ...spot, spot);
  hand.move(rayThrough(camera, spot[0], spot[1]), 0.008);
  assert.ok(hand.length - before > 0.001 && hand.length - before < 0.006, `${1000 * (hand.length - before)} mm in 8 ms`);
});

test("Without a path the hand stays in the plane across the nearest base axis", () => {
  const camera = createCamera();
  Object.assign(camera, { width: 900, height: 700, azimuth: 0.2, elevation: 0.3, distance: 0.4 });
  const view = axesOf(camera).back.map((b) => -b);
  const spot = [0, 0, 0];
  const tool = [0.01, 0.02, 0.03];
  project(camera, ...tool, spot);
  const hand = new Hand(createPolyline(8), tool, rayThrough(camera, spot[0], spot[1]), view);
  assert.equal(hand.fromPath, false);
  const at = hand.move(rayThrough(camera, spot[0] + 120, spot[1] - 40), 0.01);
  assert.ok(Math.abs(at[1] - 0.02) < 1e-9, "y is the axis nearest to this view");
  assert.ok(Math.abs(at[0] - 0.01) > 0.01);
  hand.shiftPlane(0.001, view);
  assert.ok(Math.abs(hand.at[1] - 0.021) < 1e-9, "one notch moves the plane 1 mm away");
  const after = hand.move(rayThrough(camera, spot[0] + 100, spot[1]), 0.01);
  assert.ok(Math.abs(after[1] - 0.021) < 1e-9);
});

test("A ray along the drawing plane leaves the hand where it was", () => {
  const camera = createCamera();
  Object.assign(camera, { width: 900, height: 700, azimuth: 0, elevation: 0, distance: 0.4 });
  const hand = new Hand(null, [0, 0, 0], rayThrough(camera, 450, 350), [0, 0, -1]);
  // Along the plane, and almost along it: the cut would be metres away.
  camera.centre = [0, 0, 0.001];
  for (const [x, y] of [[600, 350], [600, 353]]) {
    const at = hand.move(rayThrough(camera, x, y), 0.01);
    assert.deepEqual([...at], [0, 0, 0]);
  }
});

test("A stick has a dead zone of 0.12 and is cubic beyond it", () => {
  assert.equal(page.stick(0.12, 0.15), 0);
  assert.equal(page.stick(-0.1, 0.15), -0);
  assert.equal(page.stick(1, 0.15), 0.15);
  assert.equal(page.stick(-1, 0.15), -0.15);
  assert.ok(Math.abs(page.stick(0.56, 0.15) - 0.15 / 8) < 1e-12);
});

test("A pen holds with 0.2 at the lightest touch and 1 at full pressure", () => {
  assert.ok(Math.abs(page.gripOf(0) - 0.2) < 1e-12);
  assert.equal(page.gripOf(1), 1);
  assert.equal(page.gripOf(3), 1);
});

test("A place outside the workspace is held at its edge", () => {
  assert.deepEqual(page.clampTo([2, -3, 0.5], [-1, -1, -1], [1, 1, 1]), [1, -1, 0.5]);
});
