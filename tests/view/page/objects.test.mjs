// The objects of a virtual scene: from the bytes of the server to triangles with normals.
import assert from "node:assert/strict";
import test from "node:test";
import { ballMesh, boxMesh, helloOf, meshFrame, recordingOf, sceneOf } from "./frames.mjs";
import { load } from "./load.mjs";

const { Model, decodeFrame, describeScene, shapeOf } = await load("model", "protocol", "scene/objects", "scene/scene");

const near = (a, b, most = 1e-6) => a.length === b.length && a.every((x, i) => Math.abs(x - b[i]) <= most);
const box = boxMesh(0.02, 0.01, 0.005);
const shape = (mesh, position = [0, 0, 0], rotation = [1, 0, 0, 0]) => shapeOf(mesh.vertices.flat(), mesh.triangles.flat(), position, rotation);

function model() {
  const m = new Model();
  m.take(helloOf(true));
  m.setConnected(true);
  m.take(recordingOf(["x", "proxy_x", "contact"], { end: 0 }));
  return m;
}

test("a mesh is read from its frame", () => {
  const frame = decodeFrame(meshFrame(3, box.vertices, box.triangles, { request: 7 }));
  assert.equal(frame.object, 3);
  assert.equal(frame.header.request, 7);
  assert.ok(near([...frame.vertices], box.vertices.flat(), 1e-8));
  assert.deepEqual([...frame.triangles], box.triangles.flat());
});

test("a mesh whose length or indices contradict its header is ignored", () => {
  const whole = meshFrame(0, box.vertices, box.triangles);
  assert.equal(decodeFrame(whole.slice(0, whole.byteLength - 4)), null);
  assert.equal(decodeFrame(whole.slice(0, 36)), null);
  assert.equal(decodeFrame(meshFrame(0, box.vertices, [[0, 1, 8]])), null, "a vertex that does not exist");
});

test("the meshes of a scene reach their objects, and those of another scene do not", () => {
  const m = model();
  const changes = [];
  m.on("scene", () => changes.push(m.scene?.version));
  m.take(sceneOf(4, [{ name: "plane", kind: "plane", mesh: null }, { name: "box", mesh: box, position: [0.1, 0, 0] }]));
  assert.equal(m.scene.objects[1].shape, null, "its mesh is not here yet");
  const take = (object, id, mesh = box) => m.takeMesh(decodeFrame(meshFrame(object, mesh.vertices, mesh.triangles, { request: id })));
  take(1, 3);
  take(0, 4);
  take(2, 4);
  take(1, 4, ballMesh(0.01));
  assert.equal(m.scene.objects[1].shape, null);
  take(1, 4);
  assert.equal(m.scene.objects[1].shape.count, 12);
  assert.ok(near([...m.scene.objects[1].shape.min], [0.08, -0.01, -0.005]) && near([...m.scene.objects[1].shape.max], [0.12, 0.01, 0.005]));
  assert.equal(changes.length, 2);
  m.take(recordingOf(["x"], { end: 0, trial: 2 }));
  assert.equal(m.scene, null, "another session has another scene");
});

test("a mesh is turned and moved to the pose of its object", () => {
  // A quarter turn about z: x becomes y.
  const s = shape(box, [0, 0, 0.1], [Math.SQRT1_2, 0, 0, Math.SQRT1_2]);
  assert.ok(near([...s.min], [-0.01, -0.02, 0.095]) && near([...s.max], [0.01, 0.02, 0.105]), `${s.min} ${s.max}`);
  const long = shape(box, [0, 0, 0], [2, 0, 0, 2]);
  assert.ok(near([...long.max], [0.01, 0.02, 0.005]), "a quaternion of another length means the same");
  assert.equal(shape(box, [0, 0, 0], [0, 0, 0, 0]), null);
  assert.equal(shape(box, [NaN, 0, 0]), null);
});

test("a ball is smooth also along its seam and at its poles, and a box keeps its edges", () => {
  const ball = shape(ballMesh(0.02));
  for (let i = 0; i < 3 * ball.count; i++) {
    const [p, n] = [ball.position, ball.normal].map((a) => [...a.slice(3 * i, 3 * i + 3)]);
    const cosine = p.reduce((sum, x, k) => sum + (x / 0.02) * n[k], 0);
    assert.ok(cosine > 0.995, `${cosine} at ${p}`);
  }
  const edged = shape(box);
  for (let i = 0; i < 3 * edged.count; i++) {
    const n = [...edged.normal.slice(3 * i, 3 * i + 3)];
    assert.ok(near(n.map(Math.abs).sort(), [0, 0, 1]), `${n}`);
    const p = edged.position.slice(3 * i, 3 * i + 3);
    assert.ok(n.reduce((sum, x, k) => sum + x * p[k], 0) > 0, "out of the box");
  }
});

test("triangles without an area and vertices that are not finite are left out", () => {
  const broken = { vertices: [...box.vertices, [NaN, 0, 0]], triangles: [...box.triangles, [0, 0, 1], [0, 1, 8]] };
  assert.equal(shape(broken).count, 12);
  assert.equal(shape({ vertices: box.vertices, triangles: [[1, 1, 1]] }), null);
});

test("the summary of the scene names the touched object", () => {
  assert.match(describeScene([0, 0, 0], false, NaN, NaN, 1, "left wall"), /It touches left wall\./);
  assert.doesNotMatch(describeScene([0, 0, 0], false, NaN, NaN, 1), /touches/);
});
