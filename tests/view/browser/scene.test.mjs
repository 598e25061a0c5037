import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch } from "./chromium.mjs";
import { ballMesh, boxMesh, meshFrame, sceneOf } from "../page/frames.mjs";
import { frames, openStage } from "./stage.mjs";

let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

async function withStage(settings, check) {
  const stage = await openStage(browser, settings);
  try {
    await check(stage.tab, stage);
    // SwiftShader announces slow reads of pixels; anything else is a fault.
    const faults = stage.errors.filter((text) => !/ReadPixels|GPU stall|software WebGL/i.test(text));
    assert.deepEqual(faults, []);
  } finally {
    await stage.close();
  }
}

const near = (a, b, most) => a.every((x, i) => Math.abs(x - b[i]) <= most);
const tool = (tab) =>
  tab.evaluate(() => {
    const p = globalThis.stage.scene.picture;
    const { x, y } = globalThis.stage.scene.place(...p.tool);
    return { x, y, colour: p.theme.actual, background: p.theme.background };
  });
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

for (const flat of [false, true]) {
  for (const dark of [false, true]) {
    const name = `${flat ? "2-D canvas" : "WebGL"}, ${dark ? "dark" : "light"}`;
    test(`The tool is drawn where the data have it, in the colour of its role (${name})`, () =>
      withStage({ options: { flat }, dark }, async (tab) => {
        const { x, y, colour, background } = await tool(tab);
        const pixel = await tab.evaluate(([px, py]) => globalThis.stage.pixel(px, py), [x, y]);
        assert.ok(near(pixel, rgb(colour), 3), `${pixel} for ${colour}`);
        const corner = await tab.evaluate(() => globalThis.stage.pixel(3, 200));
        assert.ok(near(corner, rgb(background), 40), `${corner} for ${background}`);
        assert.equal(await tab.evaluate(() => globalThis.stage.scene.painter.kind), flat ? "flat" : "webgl");
      }));
  }
}

test("Replacing the path keeps the numbers of geometries and textures, whatever its size", () =>
  withStage({}, async (tab) => {
    const memory = () => tab.evaluate(() => globalThis.stage.scene.painter.memory());
    await frames(tab, 3);
    const first = await memory();
    for (let i = 0; i < 30; i++) {
      await tab.evaluate((n) => globalThis.stage.path(n + 2, [2, 50, 400, 4000][n % 4], 0.3 + 0.02 * n), i);
      await frames(tab, 1);
    }
    await frames(tab, 2);
    assert.deepEqual(await memory(), first);
    assert.ok(first.geometries > 3);
  }));

test("A longer path that replaces a shorter one is drawn to its end", () =>
  withStage({}, async (tab) => {
    const end = () =>
      tab.evaluate(() => {
        const { path } = globalThis.stage.scene.picture;
        const k = 3 * (path.count - 3);
        const { x, y } = globalThis.stage.scene.place(path.xyz[k], path.xyz[k + 1], path.xyz[k + 2]);
        return globalThis.stage.pixel(x, y);
      });
    await tab.evaluate(() => globalThis.stage.path(2, 20, 0.1));
    await frames(tab, 2);
    await tab.evaluate(() => globalThis.stage.path(3, 2000, 0.6));
    await frames(tab, 2);
    const path = await tab.evaluate(() => globalThis.stage.scene.picture.theme.path);
    assert.ok(near(await end(), rgb(path), 60), `${await end()} for ${path}`);
  }));

// A box of 40 mm left of the path and a ball of 30 mm right of it, as a server sends them.
const OBJECTS = [
  { name: "box", mesh: boxMesh(0.02, 0.02, 0.02), position: [-0.05, 0, 0], colour: "#2E8B57" },
  { name: "ball", kind: "sphere", mesh: ballMesh(0.015), position: [0.05, 0, 0] },
];
const objectMessages = (id, objects = OBJECTS) => [
  JSON.stringify(sceneOf(id, objects)),
  ...objects.map(({ mesh }, i) => [...new Uint8Array(meshFrame(i, mesh.vertices, mesh.triangles, { request: id }))]),
];
const pixelAt = (tab, place) =>
  tab.evaluate((p) => {
    const { x, y } = globalThis.stage.scene.place(...p);
    return globalThis.stage.pixel(x, y);
  }, place);
const apart = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));

for (const flat of [false, true]) {
  for (const dark of [false, true]) {
    test(`Objects are drawn at their places, the touched one stands out, and the tool shows in front (${flat ? "2-D canvas" : "WebGL"}, ${dark ? "dark" : "light"})`, () =>
      withStage({ options: { flat }, dark }, async (tab) => {
        await tab.evaluate(() => globalThis.stage.touch([-0.05, 0, 0.017], NaN, [NaN, NaN, NaN], [NaN, NaN, NaN]));
        await tab.evaluate(() => globalThis.stage.path(2, 2, 0));
        await frames(tab, 2);
        const inBox = [-0.042, -0.02, -0.006];
        const inBall = [0.053, -0.014, -0.003];
        const before = [await pixelAt(tab, inBox), await pixelAt(tab, inBall)];
        await tab.evaluate((m) => globalThis.stage.take(m), objectMessages(1));
        await frames(tab, 3);
        const shown = [await pixelAt(tab, inBox), await pixelAt(tab, inBall)];
        for (const i of [0, 1]) assert.ok(apart(before[i], shown[i]) > 25, `${before[i]} became ${shown[i]}`);
        assert.ok(shown[0][1] > shown[0][0] + 10 && shown[0][1] > shown[0][2] + 5, `the box is green: ${shown[0]}`);
        // Pressed 3 mm into the top of the box.
        await tab.evaluate(() => globalThis.stage.touch([-0.05, 0, 0.017], 0, [-0.05, 0, 0.02], [0, 0, 1]));
        await tab.evaluate((m) => globalThis.stage.take(m), objectMessages(2));
        await frames(tab, 3);
        const touched = [await pixelAt(tab, inBox), await pixelAt(tab, inBall)];
        assert.ok(apart(touched[0], shown[0]) > 12, `the touched box: ${shown[0]} became ${touched[0]}`);
        assert.ok(apart(touched[1], shown[1]) < 6, `the ball stays: ${shown[1]} became ${touched[1]}`);
        const { colour, text, toolPixel, ring } = await tab.evaluate(() => {
          const { scene } = globalThis.stage;
          const { theme, toolSize, tool, proxy } = scene.picture;
          const at = scene.place(...tool);
          const p = scene.place(...proxy.at);
          // The ring's line is about 0.64 of the tool's radius from its middle; left of it nothing else is.
          const ring = [0.55, 0.6, 0.65, 0.7].map((r) => globalThis.stage.pixel(p.x - r * toolSize, p.y));
          return { colour: theme.actual, text: theme.text, toolPixel: globalThis.stage.pixel(at.x, at.y + 0.5 * toolSize), ring };
        });
        assert.ok(near(toolPixel, rgb(colour), 6), `${toolPixel} for the tool's ${colour}`);
        assert.ok(ring.some((pixel) => near(pixel, rgb(text), 60)), `${JSON.stringify(ring)} for the proxy's ${text}`);
        assert.match(await tab.getAttribute(".scene-target", "aria-label"), /movement/);
      }));
  }
}

test("Scenes that replace each other keep the number of geometries, and an empty one removes the objects", () =>
  withStage({}, async (tab) => {
    const memory = () => tab.evaluate(() => globalThis.stage.scene.painter.memory());
    await frames(tab, 3);
    const without = await memory();
    const counts = [];
    for (let id = 1; id <= 10; id++) {
      await tab.evaluate((m) => globalThis.stage.take(m), objectMessages(id));
      await frames(tab, 2);
      counts.push((await memory()).geometries);
    }
    assert.deepEqual(new Set(counts), new Set([without.geometries + 2]));
    await tab.evaluate((m) => globalThis.stage.take(m), objectMessages(11, []));
    await frames(tab, 2);
    assert.deepEqual(await memory(), without);
  }));

test("Without a path the camera fits the objects when their meshes come", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => globalThis.stage.path(2, 1, 0));
    await tab.evaluate(() => globalThis.stage.scene.fit());
    await frames(tab, 2);
    const camera = () => tab.evaluate(() => globalThis.stage.scene.camera.distance);
    const before = await camera();
    await tab.evaluate((m) => globalThis.stage.take(m), objectMessages(1));
    await frames(tab, 2);
    assert.ok((await camera()) < 0.8 * before, "nearer than the workspace asks");
  }));

test("The scene draws only when something changes", () =>
  withStage({}, async (tab) => {
    const drawn = () => tab.evaluate(() => globalThis.stage.drawn);
    await tab.evaluate(() => globalThis.stage.model.pause());
    await frames(tab, 5);
    const before = await drawn();
    await frames(tab, 20);
    assert.equal(await drawn(), before);
    await tab.mouse.move(300, 500);
    await tab.mouse.down();
    await tab.mouse.move(340, 480, { steps: 4 });
    await tab.mouse.up();
    await frames(tab, 2);
    assert.ok((await drawn()) > before, "a drag turns the camera");
  }));

test("A lost WebGL context is said in words, and the picture returns with the context", () =>
  withStage({}, async (tab, stage) => {
    await tab.evaluate(() => {
      const gl = globalThis.stage.scene.canvas.getContext("webgl2");
      globalThis.loser = gl.getExtension("WEBGL_lose_context");
      globalThis.loser.loseContext();
    });
    await tab.waitForFunction(() => document.querySelector(".scene-notice").textContent !== "");
    assert.match(await tab.textContent(".scene-notice"), /graphics were lost/);
    await tab.evaluate(() => globalThis.loser.restoreContext());
    await tab.waitForFunction(() => document.querySelector(".scene-notice").textContent === "");
    await frames(tab, 3);
    const { x, y, colour } = await tool(tab);
    const pixel = await tab.evaluate(([px, py]) => globalThis.stage.pixel(px, py), [x, y]);
    assert.ok(near(pixel, rgb(colour), 3), `${pixel} for ${colour}`);
    stage.errors.length = 0;
  }));

test("Without WebGL the scene is drawn flat and says so", async () => {
  const without = await launch(["--disable-gpu", "--disable-3d-apis"]);
  try {
    const stage = await openStage(without);
    assert.equal(await stage.tab.evaluate(() => globalThis.stage.scene.painter.kind), "flat");
    assert.match(await stage.tab.textContent(".scene-notice"), /no WebGL/);
    const { x, y, colour } = await tool(stage.tab);
    const pixel = await stage.tab.evaluate(([px, py]) => globalThis.stage.pixel(px, py), [x, y]);
    assert.ok(near(pixel, rgb(colour), 3), `${pixel} for ${colour}`);
  } finally {
    await without.close();
  }
});

test("The axes are buttons of 24 px that a keyboard reaches, and turn the camera", () =>
  withStage({}, async (tab) => {
    const boxes = await tab.locator(".scene-axis").evaluateAll((all) => all.map((b) => ({ width: b.offsetWidth, height: b.offsetHeight })));
    assert.equal(boxes.length, 6);
    for (const box of boxes) assert.ok(box.width >= 24 && box.height >= 24);
    await tab.getByRole("button", { name: "From above, along z" }).focus();
    await tab.keyboard.press("Enter");
    await frames(tab, 2);
    assert.ok((await tab.evaluate(() => globalThis.stage.scene.axes().back[2])) > 0.99);
  }));

test("Pressing the tool holds it; the intention follows the pointer and lets go with it", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => globalThis.stage.steer());
    await frames(tab, 2);
    const { x, y } = await tool(tab);
    await tab.mouse.move(x + 2, y + 1);
    await tab.mouse.down();
    for (let i = 1; i <= 30; i++) await tab.mouse.move(x + 2 - i, y + 1 - i / 3);
    await frames(tab, 3);
    const moved = await tab.evaluate(() => globalThis.stage.sent.length);
    // The server lets go after 0.3 s of silence: a pointer at rest goes on sending.
    await tab.waitForFunction((n) => globalThis.stage.sent.length >= n + 4, moved);
    const held = await tab.evaluate(() => globalThis.stage.sent.filter((e) => e[0] === "intention"));
    assert.ok(held.every((e) => e[2].grip === 1 && e[2].input === 1 && e[2].depth === 1));
    const gaps = held.slice(1).map((e, i) => e[1] - held[i][1]);
    assert.ok(Math.min(...gaps) >= 7.9, `a message after ${Math.min(...gaps)} ms`);
    const shown = await tab.evaluate(() => {
      const p = globalThis.stage.scene.picture;
      return { ring: p.intention.visible, place: globalThis.stage.scene.place(...p.intention.at) };
    });
    assert.ok(shown.ring && Math.hypot(shown.place.x - (x - 30), shown.place.y - (y - 10)) < 1, JSON.stringify(shown));
    await tab.mouse.up();
    const last = await tab.evaluate(() => globalThis.stage.sent.at(-1)[2]);
    assert.equal(last.grip, 0);
    await frames(tab, 2);
    assert.equal(await tab.evaluate(() => globalThis.stage.scene.picture.intention.visible), false);
  }));

test("A press beside the tool turns the camera and holds nothing", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => globalThis.stage.steer());
    await frames(tab, 2);
    const { x, y } = await tool(tab);
    await tab.mouse.move(x + 60, y);
    await tab.mouse.down();
    await tab.mouse.move(x + 90, y + 20, { steps: 3 });
    await tab.mouse.up();
    assert.deepEqual(await tab.evaluate(() => globalThis.stage.sent), []);
  }));

for (const [what, lose] of [
  ["the window loses the focus", () => window.dispatchEvent(new Event("blur"))],
  ["the connection is lost", () => globalThis.stage.model.setConnected(false)],
]) {
  test(`The hand lets go when ${what}`, () =>
    withStage({}, async (tab) => {
      await tab.evaluate(() => globalThis.stage.steer());
      await frames(tab, 2);
      const { x, y } = await tool(tab);
      await tab.mouse.move(x, y);
      await tab.mouse.down();
      await tab.mouse.move(x + 5, y);
      await tab.evaluate(lose);
      assert.equal(await tab.evaluate(() => globalThis.stage.sent.at(-1)[2].grip), 0);
      const count = await tab.evaluate(() => globalThis.stage.sent.length);
      await tab.mouse.move(x + 25, y);
      await tab.waitForTimeout(200);
      assert.equal(await tab.evaluate(() => globalThis.stage.sent.length), count, "it sends nothing more");
      await tab.mouse.up();
    }));
}

test("H takes the hand by keyboard: arrows move it along the path, H lets go", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => globalThis.stage.steer());
    await frames(tab, 2);
    await tab.keyboard.press("h");
    await tab.keyboard.down("ArrowLeft");
    // A slow machine draws few frames between the messages that keep the hold.
    await tab.waitForFunction(() => {
      const sent = globalThis.stage.sent.map((e) => e[2]);
      return sent.length > 8 && Math.hypot(sent.at(-1).x - sent[0].x, sent.at(-1).y - sent[0].y) > 0.0005;
    });
    await tab.keyboard.up("ArrowLeft");
    const sent = await tab.evaluate(() => globalThis.stage.sent.map((e) => e[2]));
    assert.ok(sent.every((e) => e.input === 5 && e.grip === 1));
    await tab.keyboard.press("h");
    assert.equal(await tab.evaluate(() => globalThis.stage.sent.at(-1)[2].grip), 0);
  }));

const pointer = (tab, type, x, y, init = {}) =>
  tab.evaluate(([t, px, py, rest]) => {
    const { target } = globalThis.stage.scene;
    // A synthetic pointer cannot be captured.
    target.setPointerCapture = () => undefined;
    const event = { pointerId: 7, bubbles: true, cancelable: true, clientX: px, clientY: py, buttons: 1, isPrimary: true, ...rest };
    target.dispatchEvent(new PointerEvent(t, event));
  }, [type, x, y, init]);
const intentions = (tab) => tab.evaluate(() => globalThis.stage.sent.filter((e) => e[0] === "intention").map((e) => e[2]));

test("The pressure of a pen is the firmness of the hold", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => globalThis.stage.steer());
    await frames(tab, 2);
    const { x, y } = await tool(tab);
    await pointer(tab, "pointerdown", x, y, { pointerType: "pen", pressure: 0.5 });
    await pointer(tab, "pointerrawupdate", x + 1, y, { pointerType: "pen", pressure: 1 });
    await pointer(tab, "pointermove", x + 1, y, { pointerType: "pen", pressure: 1 });
    await tab.waitForFunction(() => globalThis.stage.sent.some((e) => e[2].grip === 1));
    await pointer(tab, "pointercancel", x, y, { pointerType: "pen" });
    const sent = await intentions(tab);
    assert.ok(sent.every((e) => e.input === 2));
    assert.ok(Math.abs(sent[0].grip - 0.6) < 1e-9, `${sent[0].grip}`);
    assert.equal(sent.at(-1).grip, 0, "a cancelled pointer lets go");
  }));

test("A finger on the tool holds it, a finger elsewhere turns, two fingers zoom", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => globalThis.stage.steer());
    await frames(tab, 2);
    const { x, y } = await tool(tab);
    const camera = () => tab.evaluate(() => ({ ...globalThis.stage.scene.camera }));
    const touch = { pointerType: "touch", pressure: 0.5 };
    const before = await camera();
    await pointer(tab, "pointerdown", x + 24, y, touch);
    await pointer(tab, "pointermove", x + 36, y, touch);
    await pointer(tab, "pointerup", x + 36, y, { ...touch, buttons: 0 });
    assert.deepEqual(await camera(), before, "the camera stays while the hand is held");
    const sent = await intentions(tab);
    assert.ok(sent.length >= 2 && sent.every((e) => e.input === 3) && sent.at(-1).grip === 0);

    await pointer(tab, "pointerdown", 100, 500, touch);
    await pointer(tab, "pointermove", 150, 500, touch);
    const turned = await camera();
    assert.notEqual(turned.azimuth, before.azimuth);
    await pointer(tab, "pointerdown", 300, 500, { ...touch, pointerId: 8 });
    await pointer(tab, "pointermove", 400, 500, { ...touch, pointerId: 8 });
    const zoomed = await camera();
    assert.ok(Math.abs(zoomed.distance / turned.distance - 150 / 250) < 0.01, "fingers that part bring the scene nearer");
    assert.equal(zoomed.azimuth, turned.azimuth);
    assert.equal((await intentions(tab)).length, sent.length);
  }));

test("A gamepad holds by its trigger, moves by its sticks and stops by its button B", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => {
      const button = () => ({ pressed: false, value: 0 });
      globalThis.pad = { connected: true, axes: [0, 0, 0, 0], buttons: Array.from({ length: 16 }, button) };
      navigator.getGamepads = () => [null, globalThis.pad];
      globalThis.stage.steer();
    });
    await frames(tab, 3);
    assert.deepEqual(await intentions(tab), [], "sticks without a grip hold nothing");
    await tab.evaluate(() => {
      globalThis.pad.buttons[7].value = 0.7;
      globalThis.pad.axes = [0.05, 0, 0, -0.5];
    });
    await tab.waitForFunction(() => {
      const sent = globalThis.stage.sent.map((e) => e[2]);
      const moved = (k) => sent.at(-1)[k] - sent[0][k];
      return sent.length > 6 && Math.hypot(moved("x"), moved("y"), moved("z")) > 0.0004;
    });
    const sent = await intentions(tab);
    assert.ok(sent.every((e) => e.input === 4 && e.depth === 0 && Math.abs(e.grip - 0.7) < 1e-9));
    const back = await tab.evaluate(() => globalThis.stage.scene.axes().back);
    const moved = ["x", "y", "z"].map((k) => sent.at(-1)[k] - sent[0][k]);
    const away = -moved.reduce((sum, m, k) => sum + m * back[k], 0);
    assert.ok(away > 0.0003 && Math.abs(Math.hypot(...moved) - away) < 1e-6, "straight away: 0.05 is in the dead zone");
    await tab.evaluate(() => {
      globalThis.pad.buttons[1].pressed = true;
    });
    await frames(tab, 4);
    const all = await tab.evaluate(() => globalThis.stage.sent.map((e) => (e[0] === "stop" ? "stop" : e[2].grip)));
    assert.deepEqual(all.slice(-2), [0, "stop"], "one stop for one press, after letting go");
  }));

test("A session that nobody may steer sends no intention", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => {
      globalThis.stage.model.hello.steer = false;
      globalThis.stage.steer();
    });
    await frames(tab, 2);
    const { x, y } = await tool(tab);
    await tab.mouse.move(x, y);
    await tab.mouse.down();
    await tab.mouse.move(x + 20, y);
    await tab.mouse.up();
    await tab.keyboard.press("h");
    assert.deepEqual(await intentions(tab), []);
    assert.equal(await tab.isVisible(".scene-hint"), false);
  }));

test("Without a path the hand moves in a sheet, which the wheel and Q and E move by 1 mm", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => {
      globalThis.stage.path(2, 2, 0);
      globalThis.stage.steer();
    });
    await frames(tab, 2);
    const { x, y } = await tool(tab);
    const place = () => tab.evaluate(() => [...globalThis.stage.scene.picture.intention.at]);
    await tab.mouse.move(x, y);
    await tab.mouse.down();
    await tab.mouse.move(x + 40, y - 10, { steps: 5 });
    await frames(tab, 2);
    const sheet = await tab.evaluate(() => globalThis.stage.scene.picture.sheet);
    assert.ok(sheet.visible && sheet.axis === 1);
    const first = await place();
    await tab.mouse.wheel(0, -100);
    await frames(tab, 2);
    const second = await place();
    assert.ok(Math.abs(second[1] - first[1] - 0.001) < 1e-9, `${second[1] - first[1]}`);
    await tab.keyboard.press("q");
    await frames(tab, 2);
    assert.ok(Math.abs((await place())[1] - first[1]) < 1e-9);
    await tab.mouse.up();
    assert.ok((await intentions(tab)).every((e) => e.depth === 0));
  }));

const SHOW = { tool: true, path: true, tunnel: true, trail: true, score: true };
const training = (state, changes = {}) => ({
  type: "training", state, exercise: "Curve", mode: "tunnel", trial: 3, of: 8, repetition: 3, repetitions: 8, show: SHOW,
  rest_s: 12, next: "curve, repetition 4 of 8", score: { time_in_tunnel: 0.93, time_s: 6.2, best: true }, ...changes,
});
const STATES = ["waiting", "approach", "go", "moving", "done", "rest", "stopped", "finished"];

test("The training screen's camera and scale are the same in every state", () =>
  withStage({}, async (tab) => {
    await tab.evaluate((m) => globalThis.stage.train(m), training("waiting"));
    await frames(tab, 3);
    const camera = () => tab.evaluate(() => JSON.stringify(globalThis.stage.scene.camera));
    const first = await camera();
    for (const state of STATES) {
      await tab.evaluate((m) => globalThis.stage.training(m), training(state));
      await tab.mouse.move(200, 300);
      await tab.mouse.down();
      await tab.mouse.move(260, 330);
      await tab.mouse.up();
      await tab.mouse.wheel(0, 200);
      await frames(tab, 2);
      assert.equal(await camera(), first, state);
    }
  }));

test("A path of another exercise is fitted after the movement, never during it", () =>
  withStage({}, async (tab) => {
    await tab.evaluate((m) => globalThis.stage.train(m), training("moving"));
    await frames(tab, 3);
    const camera = () => tab.evaluate(() => JSON.stringify(globalThis.stage.scene.camera));
    const first = await camera();
    await tab.evaluate(() => globalThis.stage.path(2, 400));
    await frames(tab, 2);
    await tab.evaluate((m) => globalThis.stage.training(m), training("done"));
    await frames(tab, 2);
    assert.equal(await camera(), first, "the same path again");
    await tab.evaluate((m) => globalThis.stage.training(m), training("moving"));
    await tab.evaluate(() => globalThis.stage.path(3, 400, 0.5, 0.2));
    await frames(tab, 3);
    assert.equal(await camera(), first, "during the movement");
    await tab.evaluate((m) => globalThis.stage.training(m), training("rest"));
    await frames(tab, 3);
    assert.notEqual(await camera(), first, "after it");
  }));

test("A camera that a person turned stays for the next repetition of the same path", () =>
  withStage({}, async (tab) => {
    await tab.mouse.move(200, 500);
    await tab.mouse.down();
    await tab.mouse.move(300, 520, { steps: 3 });
    await tab.mouse.up();
    await frames(tab, 2);
    const camera = () => tab.evaluate(() => JSON.stringify(globalThis.stage.scene.camera));
    const turned = await camera();
    await tab.evaluate(() => {
      globalThis.stage.model.take({ ...globalThis.stage.model.recording, session: "next" });
      globalThis.stage.path(2, 400);
    });
    await frames(tab, 3);
    assert.equal(await camera(), turned);
    await tab.evaluate(() => globalThis.stage.path(3, 400, 1, 0.3));
    await frames(tab, 3);
    assert.notEqual(await camera(), turned, "a path elsewhere is fitted");
    assert.equal(JSON.parse(await camera()).azimuth, JSON.parse(turned).azimuth, "in the same direction of view");
  }));

for (const [width, height] of [[360, 640], [390, 844], [640, 360], [1280, 800], [1920, 1080]]) {
  test(`Every state's words and the Stop button fit into ${width} x ${height}`, () =>
    withStage({ width, height }, async (tab) => {
      await tab.evaluate((m) => globalThis.stage.train(m), training("waiting"));
      await frames(tab, 2);
      for (const started of [false, true]) {
        if (started) await tab.evaluate(() => document.querySelector(".training-start-button").click());
        for (const state of STATES) {
          await tab.evaluate((m) => globalThis.stage.training(m), training(state));
          await frames(tab, 2);
          const { band, parts, stop } = await tab.evaluate(() => {
            const box = (e) => e.getBoundingClientRect().toJSON();
            const all = [...document.querySelectorAll(".training-band *")].filter((e) => e.getClientRects().length > 0);
            return { band: box(document.querySelector(".training-band")), parts: all.map(box), stop: box(document.querySelector(".training-stop")) };
          });
          assert.ok(Math.abs(band.height - 0.27 * height) < 1, "the words have 27 % of the height");
          for (const p of parts) {
            assert.ok(p.top >= band.top - 1 && p.bottom <= height + 1 && p.left >= -1 && p.right <= width + 1,
              `${state}: ${JSON.stringify(p)} in ${JSON.stringify(band)}`);
          }
          assert.ok(stop.height >= 60 && stop.left >= 0 && stop.right <= width && stop.top >= 0 && stop.bottom <= height);
        }
      }
    }));
}

test("Go is shown also to those who did not click Start, and Start never takes the place of a word", () =>
  withStage({}, async (tab) => {
    await tab.evaluate((m) => globalThis.stage.train(m), training("waiting"));
    await frames(tab, 2);
    assert.ok(await tab.isVisible(".training-start-button"));
    assert.ok(await tab.getByText("Hold the handle").isVisible());
    await tab.evaluate((m) => globalThis.stage.training(m), training("go"));
    await frames(tab, 2);
    assert.ok(await tab.getByText("Go", { exact: true }).isVisible());
    assert.equal(await tab.isVisible(".training-start-button"), false);
  }));

test("A score is read before the rest that begins at once", () =>
  withStage({}, async (tab) => {
    await tab.evaluate((m) => globalThis.stage.train(m), training("moving"));
    await tab.evaluate((m) => globalThis.stage.training(m), training("done", { score: null }));
    await frames(tab, 2);
    assert.ok(await tab.getByText("Done", { exact: true }).isVisible());
    await tab.evaluate((m) => globalThis.stage.training(m), training("rest"));
    await frames(tab, 2);
    assert.ok(await tab.getByText("93", { exact: true }).isVisible());
    await tab.getByText("Rest", { exact: true }).waitFor();
    assert.equal(await tab.getByText("93", { exact: true }).isVisible(), false);
    // The words of the next frame but one, read in the page: on a busy machine a question takes longer than the score.
    const next = (message) => tab.evaluate(async (m) => {
      globalThis.stage.training(m);
      for (let i = 0; i < 2; i++) await new Promise((done) => requestAnimationFrame(done));
      return document.querySelector(".training-words").innerText;
    }, message);
    assert.match(await next(training("rest", { trial: 4, rest_s: 2.9 })), /93/, "a short rest is for the score, too");
    await tab.getByText("Rest", { exact: true }).waitFor();
    assert.match(await next(training("finished", { trial: 5 })), /93/, "and so is the end of a session");
    await tab.getByText("Finished", { exact: true }).waitFor();
  }));

test("Go is reported once, with the frame that showed it, after that frame", () =>
  withStage({}, async (tab) => {
    await tab.evaluate((m) => globalThis.stage.train(m), training("waiting"));
    await frames(tab, 3);
    assert.deepEqual(await tab.evaluate(() => globalThis.stage.sent), []);
    const same = await tab.evaluate(async (m) => {
      const next = () => new Promise((done) => requestAnimationFrame(done));
      globalThis.stage.training(m);
      globalThis.stage.training(m);
      await next();
      // Callbacks of one frame run in the order of their requests: this one ran after the scene's.
      const painted = { word: document.querySelector(".training-word").textContent, sent: globalThis.stage.sent.length };
      await next();
      await next();
      return { painted, sent: globalThis.stage.sent };
    }, training("go"));
    assert.equal(same.painted.word, "Go");
    assert.equal(same.painted.sent, 0, "not before the next frame");
    assert.equal(same.sent.length, 1);
    const [kind, what, trial, frame, time] = same.sent[0];
    assert.deepEqual([kind, what, trial], ["shown", "go", 3]);
    assert.ok(frame > 3 && Math.abs(time - 2.999) < 0.01, `${frame}, ${time}`);
  }));

test("Stop on the training screen is sent when it is pressed, not when it is released", () =>
  withStage({}, async (tab) => {
    await tab.evaluate((m) => globalThis.stage.train(m), training("moving"));
    await frames(tab, 2);
    const box = await tab.locator(".training-stop").boundingBox();
    await tab.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await tab.mouse.down();
    assert.deepEqual(await tab.evaluate(() => globalThis.stage.sent), [["stop"]]);
    await tab.mouse.up();
    await tab.focus(".training-stop");
    await tab.keyboard.press("Enter");
    assert.deepEqual(await tab.evaluate(() => globalThis.stage.sent), [["stop"], ["stop"]], "the keyboard stops too");
  }));

test("The section describes the place of the tool in words", () =>
  withStage({}, async (tab) => {
    await tab.evaluate(() => globalThis.stage.section());
    await frames(tab, 2);
    const label = await tab.getAttribute(".section", "aria-label");
    assert.match(label, /radius is 5\.0 mm.*inside the tunnel/);
  }));
