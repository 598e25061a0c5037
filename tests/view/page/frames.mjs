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
