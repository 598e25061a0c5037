// Another site in the same browser, and anybody without the token, gets nothing.
import assert from "node:assert/strict";
import { createServer, request } from "node:http";
import { randomBytes } from "node:crypto";
import { join } from "node:path";
import test from "node:test";
import { browser } from "./browser.mjs";
import { open, run, scratch, start } from "./support.mjs";

async function viewed(t) {
  const folder = scratch(t);
  const path = join(folder, "square.h5");
  await run("shape", "square", "--size", "60mm", "--duration", "2", "-o", path);
  const view = await start(t, "view", path, "--no-browser");
  const url = new URL(view.address);
  return { view, port: Number(url.port), token: url.hash.slice(1) };
}

// Sends a request and gives its status and headers; 101 if a WebSocket was opened.
function ask(port, path, headers, method = "GET") {
  return new Promise((resolve, reject) => {
    const r = request({ host: "127.0.0.1", port, path, method, headers });
    r.on("response", (response) => {
      response.resume();
      resolve({ status: response.statusCode, headers: response.headers });
    });
    r.on("upgrade", (response, socket) => {
      socket.destroy();
      resolve({ status: 101, headers: response.headers });
    });
    r.on("error", (error) => (error.code === "ECONNRESET" ? resolve({ status: 0, headers: {} }) : reject(error)));
    r.end();
  });
}

const upgrade = (host, origin) => ({
  Host: host,
  ...(origin === undefined ? {} : { Origin: origin }),
  Connection: "Upgrade",
  Upgrade: "websocket",
  "Sec-WebSocket-Version": "13",
  "Sec-WebSocket-Key": randomBytes(16).toString("base64"),
});

test("the page comes with a strict policy and without leave for other sites", async (t) => {
  const { port } = await viewed(t);
  for (const path of ["/", "/app.js", "/wire.js", "/app.css", "/icon.svg"]) {
    const { status, headers } = await ask(port, path, { Host: `127.0.0.1:${port}` });
    assert.equal(status, 200, path);
    assert.match(headers["content-security-policy"], /default-src 'self'/);
    assert.match(headers["content-security-policy"], /frame-ancestors 'none'/);
    assert.doesNotMatch(headers["content-security-policy"], /unsafe/);
    assert.equal(headers["x-content-type-options"], "nosniff");
    assert.match(headers["cache-control"], /no-store/);
    assert.equal(headers["referrer-policy"], "no-referrer");
    assert.equal(headers["cross-origin-resource-policy"], "same-origin");
    assert.equal(headers["cross-origin-opener-policy"], "same-origin");
    assert.equal(headers["access-control-allow-origin"], undefined);
  }
  for (const path of ["/other", "/../etc/passwd", "/app.js/..", "/data"]) assert.equal((await ask(port, path, { Host: `127.0.0.1:${port}` })).status, 404, path);
  assert.notEqual((await ask(port, "/", { Host: `127.0.0.1:${port}` }, "POST")).status, 200);
});

test("a WebSocket of another origin is refused, also if its host and origin are equal", async (t) => {
  const { port } = await viewed(t);
  const own = `127.0.0.1:${port}`;
  assert.equal((await ask(port, "/ws", upgrade(own, `http://${own}`))).status, 101);
  for (const [host, origin] of [
    [own, "http://evil.test"],
    [own, `http://127.0.0.1:${port + 1}`],
    [own, "null"],
    [own, `https://${own}`],
    [`evil.test:${port}`, `http://evil.test:${port}`],
    [`127.0.0.1.evil.test:${port}`, `http://127.0.0.1.evil.test:${port}`],
    [`evil.test:${port}`, undefined],
  ]) {
    assert.notEqual((await ask(port, "/ws", upgrade(host, origin))).status, 101, `host ${host}, origin ${origin}`);
  }
  assert.notEqual((await ask(port, "/", { Host: `evil.test:${port}` })).status, 200);
});

test("a page with a wrong token, or without one, gets nothing and says why", async (t) => {
  const { view, token } = await viewed(t);
  const opened = await browser(t);
  const wrong = token.replace(/./g, (c) => ((parseInt(c, 16) + 1) % 16).toString(16));
  for (const address of [view.address.replace(token, wrong), view.address.replace(/#.*/, "")]) {
    const context = await opened.newContext();
    const page = await context.newPage();
    const frames = [];
    page.on("websocket", (socket) => socket.on("framereceived", (frame) => frames.push(frame.payload)));
    await page.goto(address);
    await page.getByText("This address is not valid").waitFor();
    assert.deepEqual(frames, []);
    await context.close();
  }
});

// Serves the page of another site. It tries to reach the view, even with the right token.
async function hostile(t, port, host, token) {
  const script = `
    window.result = new Promise((resolve) => {
      const socket = new WebSocket("ws://${host}:${port}/ws");
      const got = [];
      socket.binaryType = "arraybuffer";
      socket.onopen = () => { got.push("open"); socket.send(JSON.stringify({ type: "hello", version: 1, token: "${token}" })); };
      socket.onmessage = (event) => got.push(typeof event.data === "string" ? event.data : "binary");
      socket.onclose = () => resolve(got);
      setTimeout(() => resolve(got), 5000);
    });
    window.fetched = fetch("http://${host}:${port}/app.js").then((r) => r.text(), () => "");`;
  const server = createServer((_, response) => response.writeHead(200, { "Content-Type": "text/html" }).end(`<!doctype html><script>${script}</script>`));
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  t.after(() => server.close());
  return server.address().port;
}

test("another site in the same browser can neither read nor connect", async (t) => {
  const { port, token } = await viewed(t);
  const other = await hostile(t, port, "127.0.0.1", token);
  const opened = await browser(t, { args: ["--host-resolver-rules=MAP evil.test 127.0.0.1", "--disable-features=LocalNetworkAccessChecks,BlockInsecurePrivateNetworkRequests"] });
  const page = await opened.newPage();
  await page.goto(`http://evil.test:${other}/`);
  assert.deepEqual(await page.evaluate(() => window.result), []);
  assert.equal(await page.evaluate(() => window.fetched), "");
});

test("a name that was rebound to this machine gets nothing, although its origin equals its host", async (t) => {
  const { port, token } = await viewed(t);
  const opened = await browser(t, { args: ["--host-resolver-rules=MAP evil.test 127.0.0.1"] });
  const page = await opened.newPage();
  const response = await page.goto(`http://evil.test:${port}/#${token}`).catch(() => null);
  assert.ok(response === null || response.status() >= 400, `status ${response?.status()}`);
  const other = await hostile(t, port, "evil.test", token);
  await page.goto(`http://evil.test:${other}/`);
  assert.deepEqual(await page.evaluate(() => window.result), []);
});

test("texts of a recording are no markup", async (t) => {
  const folder = scratch(t);
  const path = join(folder, "square.h5");
  const file = join(folder, "played.h5");
  await run("shape", "square", "--size", "60mm", "--duration", "2", "-o", path);
  await run("play", path, "-d", "sim:preset=falcon,hand=relaxed", "--record", file, "--title", "<img src=x onerror=alert(1)><b>bold</b>");
  const view = await start(t, "view", file, "--no-browser");
  const page = await open(t, await browser(t), view.address);
  await page.getByLabel("Table of values").first().click();
  await page.getByText("<b>bold</b>").first().waitFor();
  assert.equal(await page.locator("#app b:text('bold'), dialog b").count(), 0);
  assert.deepEqual(page.errors, []);
});
