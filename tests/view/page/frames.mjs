// Writes binary frames as a server does (docs/view-protocol.md), with nothing of the page's own code.
function header(kind, { flags = 0, sequence = 0, rows, request = 0, t0 = 0, sent = 0, version = 1 }, bytes) {
  const buffer = new ArrayBuffer(32 + bytes);
  const v = new DataView(buffer);
  v.setUint8(0, kind);
  v.setUint8(1, version);
  v.setUint16(2, flags, true);
  v.setUint32(4, sequence, true);
  v.setUint32(8, rows, true);
  v.setUint32(12, request, true);
  v.setFloat64(16, t0, true);
  v.setFloat64(24, sent, true);
  return { buffer, v };
}

// Kind 1 (or 2): `planes` are arrays of one length, the first is the time after t0.
export function samplesFrame(planes, options = {}) {
  const rows = planes[0].length;
  const { buffer, v } = header(options.kind ?? 1, { ...options, rows }, 4 * rows * planes.length);
  planes.forEach((plane, p) => plane.forEach((value, i) => v.setFloat32(32 + 4 * (p * rows + i), value, true)));
  return buffer;
}

// Kind 3: `channels` are { first, min, max, last, order } of one length.
export function binsFrame(width, channels, options = {}) {
  const rows = channels[0]?.first.length ?? 0;
  const order = 4 * Math.ceil(rows / 4);
  const { buffer, v } = header(3, { ...options, rows }, 16 + channels.length * (16 * rows + order));
  v.setUint32(32, channels.length, true);
  v.setUint32(36, rows, true);
  v.setFloat64(40, width, true);
  channels.forEach((c, n) => {
    const at = 48 + n * (16 * rows + order);
    ["first", "min", "max", "last"].forEach((name, p) => c[name].forEach((value, i) => v.setFloat32(at + 4 * (p * rows + i), value, true)));
    c.order.forEach((value, i) => v.setUint8(at + 16 * rows + i, value));
  });
  return buffer;
}

// Kind 4: six planes: time, x, y, z, radius, length.
export function pathFrame(planes, options = {}) {
  return samplesFrame(planes, { ...options, kind: 4 });
}

// Kind 5: the mesh of an object. `vertices` are [x, y, z], `triangles` [i, j, k].
export function meshFrame(object, vertices, triangles, options = {}) {
  const { buffer, v } = header(5, { ...options, rows: vertices.length }, 8 + 12 * vertices.length + 12 * triangles.length);
  v.setUint32(32, object, true);
  v.setUint32(36, triangles.length, true);
  vertices.flat().forEach((x, i) => v.setFloat32(40 + 4 * i, x, true));
  triangles.flat().forEach((index, i) => v.setUint32(40 + 12 * vertices.length + 4 * i, index, true));
  return buffer;
}

// A box about the origin with half sides [m]: 8 vertices, 12 triangles, counter-clockwise from outside.
export function boxMesh(x, y, z) {
  const vertices = Array.from({ length: 8 }, (_, i) => [i & 1 ? x : -x, i & 2 ? y : -y, i & 4 ? z : -z]);
  const faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
  return { vertices, triangles: faces.flatMap(([a, b, c, d]) => [[a, b, c], [a, c, d]]) };
}

// A ball about the origin, by latitude and longitude; the seam and the poles repeat their vertices.
export function ballMesh(radius, sides = 24) {
  const vertices = [];
  const triangles = [];
  for (let i = 0; i <= sides / 2; i++) {
    for (let j = 0; j <= sides; j++) {
      const [a, b] = [(2 * Math.PI * i) / sides, (2 * Math.PI * (j % sides)) / sides];
      vertices.push([radius * Math.sin(a) * Math.cos(b), radius * Math.sin(a) * Math.sin(b), radius * Math.cos(a)]);
      if (i === 0 || j === 0) continue;
      const k = i * (sides + 1) + j;
      triangles.push([k - sides - 2, k - 1, k], [k - sides - 2, k, k - sides - 1]);
    }
  }
  return { vertices, triangles };
}

// The message that announces objects with these meshes.
export function sceneOf(id, objects) {
  return {
    type: "scene", id,
    objects: objects.map(({ mesh, ...rest }) => ({
      kind: "box", position: [0, 0, 0], rotation: [1, 0, 0, 0], ...rest,
      mesh: mesh === null ? null : { vertices: mesh.vertices.length, triangles: mesh.triangles.length },
    })),
  };
}

// Messages of a recording with these columns.
export function recordingOf(columns, options = {}) {
  return {
    type: "recording", index: 0, name: "a.h5", title: "", subject: "", session: "s", verb: "guide", mode: "tunnel", rate_hz: 1000, start: 0, end: 10,
    device: { name: "sim", model: "sim" }, columns: columns.map((name) => ({ name, unit: "m" })), limits: {}, input: "", virtual_time: false, ...options,
  };
}

export function helloOf(live) {
  return { type: "hello", version: 1, role: "viewer", software: "", live, control: false, steer: false, on_page_lost: "", recordings: [] };
}
