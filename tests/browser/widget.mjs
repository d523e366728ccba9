// The widget of notebooks in headless Chromium, on a model that is none of a notebook's but does what one does.
//
//   python tests/browser/widget_data.py FOLDER; node tests/browser/widget.mjs FOLDER
//
// Needs what view.mjs needs. Pictures go to target/browser/.

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { check, finish, launch, out, root } from "./common.mjs";

const folder = process.argv[2];
const files = {
  "/": ["text/html", `<!doctype html><title>a notebook</title><body style="margin: 0"><div id="cell"></div>`],
  "/widget.mjs": ["text/javascript", readFileSync(join(root, "src/python/isolume/widget.mjs"))],
  "/traits.json": ["application/json", readFileSync(join(folder, "traits.json"))],
  "/payload.bin": ["application/octet-stream", readFileSync(join(folder, "payload.bin"))],
  "/still.png": ["image/png", readFileSync(join(folder, "still.png"))],
};

async function open(browser, prepare = () => {}) {
  const page = await browser.newPage({ viewport: { width: 560, height: 280 } });
  // Shaders are compiled, and every pixel is drawn, in software.
  page.setDefaultTimeout(300_000);
  const errors = [];
  page.on("pageerror", (e) => errors.push(e.message));
  page.on("console", (m) => { if (m.type() === "error") errors.push(m.text()); });
  await page.addInitScript(prepare);
  await page.route("http://notebook.test/**", (route) => {
    const [contentType, body] = files[new URL(route.request().url()).pathname] ?? ["text/plain", ""];
    return route.fulfill({ contentType, body });
  });
  await page.goto("http://notebook.test/");
  await page.evaluate(async () => {
    const bytes = async (name) => (await fetch(name)).arrayBuffer();
    const traits = await (await fetch("traits.json")).json();
    const payload = await bytes("payload.bin"), half = Math.floor(payload.byteLength / 2);
    // As notebooks hand binary traits over: views of larger buffers, in pieces.
    traits._payload = [new DataView(payload, 0, half), new DataView(payload, half)];
    traits._still = new DataView(await bytes("still.png"));
    const listeners = new Map(), on = (name) => listeners.get(name) ?? listeners.set(name, new Set()).get(name);
    window.model = {
      sent: [], saves: 0,
      get: (name) => traits[name],
      set(name, value) {
        traits[name] = value;
        on(`change:${name}`).forEach((act) => act());
      },
      on: (name, act) => on(name).add(act),
      off: (name, act) => on(name).delete(act),
      save_changes() { this.saves++; },
      send(content, _, buffers) { this.sent.push({ content, buffers }); },
      hear: (content, buffers) => on("msg:custom").forEach((act) => act(content, buffers)),
    };
    const { default: widget } = await import("/widget.mjs");
    window.end = widget.render({ model, el: document.getElementById("cell") });
  });
  return { page, errors };
}

/** The frame with the page. */
async function frameOf(page) {
  const element = await page.waitForSelector("iframe", { state: "attached" });
  return element.contentFrame();
}

/** What the frame shows: its state and the mean of its picture. */
async function shown(page) {
  const frame = await frameOf(page);
  await frame.waitForFunction(() => window.isolume && document.getElementById("shown").textContent.startsWith("isovalue"));
  return frame.evaluate(async () => {
    window.isolume.draw();
    const canvas = new OffscreenCanvas(90, 60), pen = canvas.getContext("2d");
    pen.drawImage(window.isolume.renderer.canvas, 0, 0, 90, 60);
    const data = pen.getImageData(0, 0, 90, 60).data;
    let sum = 0;
    for (let i = 0; i < data.length; i++) sum += (i % 7) * data[i];
    const { isovalue, rotation, albedo, environment, colour, autoExposure, exposure, azimuth } = window.isolume.state;
    const env = document.getElementById("environment").selectedOptions[0].textContent;
    return { isovalue, rotation, albedo, environment, env, colour, autoExposure, exposure, azimuth, sum };
  });
}

const trait = (page, name) => page.evaluate((name) => model.get(name), name);
const set = (page, name, value) => page.evaluate(([name, value]) => model.set(name, value), [name, value]);
/** After messages both ways, the pause of the widget and a frame have passed. */
const settled = async (page) => {
  await page.waitForTimeout(400);
  await (await frameOf(page)).evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  await page.waitForTimeout(200);
};

const browser = await launch();
const { page, errors } = await open(browser);
const first = await shown(page);
await settled(page);
check(first.isovalue === 47 && first.env === "courtyard" && first.rotation === 20, "it begins with the traits of the model");
check((await trait(page, "camera")).azimuth === 35, "the model hears what the page decides");
await page.screenshot({ path: join(out, "widget.png") });

let before = first;
for (const [name, value, seen] of [
  ["isovalue", 30, (s) => s.isovalue === 30], ["env", "sunset", (s) => s.env === "sunset"], ["albedo", 0.3, (s) => s.albedo === 0.3],
  ["rotate", -90, (s) => s.rotation === -90], ["colormap", "magma", (s) => s.colour === "magma"],
  ["exposure", 2, (s) => s.exposure === 2 && !s.autoExposure], ["camera", { azimuth: 100 }, (s) => s.azimuth === 100],
]) {
  await set(page, name, value);
  await settled(page);
  const now = await shown(page);
  check(seen(now) && now.sum !== before.sum, `${name} of the model changes the page and its picture`);
  before = now;
}
await set(page, "exposure", null);
await settled(page);
check((await shown(page)).autoExposure, "exposure null is the automatic one");

const frame = await frameOf(page);
await frame.evaluate(() => {
  const slider = document.getElementById("albedo");
  slider.value = 0.85;
  slider.dispatchEvent(new Event("input"));
});
await settled(page);
check((await trait(page, "albedo")) === 0.85 && (await page.evaluate(() => model.saves)) > 0, "a slider of the page changes the model, and is saved");
await frame.evaluate(() => document.getElementById("canvas").dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true })));
await settled(page);
check((await trait(page, "camera")).azimuth === 105, "a turn of the page changes the camera of the model");

await page.evaluate(() => {
  const rgb = new Float32Array(3 * 32 * 16).fill(2);
  model.hear({ kind: "probe", name: "mine", width: 32, height: 16 }, [new DataView(rgb.buffer)]);
  model.set("env", "mine");
});
await settled(page);
check((await shown(page)).env === "mine", "an environment that Python sends is shown");

// The magic of OpenEXR and nothing that the page can read.
await frame.evaluate(() => window.isolume.openFile(new File([Uint8Array.from([0x76, 0x2f, 0x31, 1, 9])], "dropped.exr")) && null);
await page.waitForFunction(() => model.sent.some(({ content }) => content.kind === "read"));
await page.evaluate(() => {
  const { content, buffers } = model.sent.find(({ content }) => content.kind === "read");
  if (content.name !== "dropped.exr" || buffers[0].byteLength !== 5) throw new Error("not the file");
  model.hear({ kind: "answer", id: content.id, name: "dropped.exr", width: 32, height: 16 }, [new DataView(new Float32Array(3 * 32 * 16).fill(1).buffer)]);
});
await settled(page);
check((await trait(page, "env")) === "dropped", "a dropped image is read by Python");
check(await page.evaluate(() => model.sent.some(({ content }) => content.kind === "added" && content.name === "dropped")), "and Python hears that the page has it");
check(errors.length === 0, `no errors${errors.length ? `: ${errors.join("; ")}` : ""}`);
await page.evaluate(() => { end(); model.set("isovalue", 20); });
check((await shown(page)).isovalue === 30, "a widget that was removed is silent");

const bare = await open(browser, () => { HTMLCanvasElement.prototype.getContext = () => null; });
await bare.page.waitForSelector("#cell img");
check((await bare.page.textContent("#cell p")).startsWith("This is a still"), "without WebGL2 there is a still, and why");
await browser.close();
finish("the widget");
