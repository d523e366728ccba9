// The live page in headless Chromium, against the program's own pictures of the same view.
//
//   node tests/browser/view.mjs ISOLUME STORE... [--scenes STORE...]
//
// ISOLUME is the program, STORE what `isolume bake` made: of volumes alone (all isovalues), and of scenes. Needs Chromium ($CHROMIUM, default
// /usr/bin/chromium) and playwright-core (in $ISOLUME_NPM, default target/npm). Draws in software, so it needs no GPU.
// Screenshots go to target/browser/. Exit code 0: everything holds; 1: something does not, and says what.

import { execFileSync, spawn } from "node:child_process";
import { existsSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
import { basename, join } from "node:path";
import { pathToFileURL } from "node:url";
import { check, dropFile, finish, launch, out, root } from "./common.mjs";

const [program, ...given] = process.argv.slice(2);
const end = given.indexOf("--scenes");
const [stores, scenes] = end < 0 ? [given, []] : [given.slice(0, end), given.slice(end + 1)];
const SIZE = [480, 360];
const MOST_DIFFERENCE = 2; // of 255, mean over covered pixels outside silhouettes

/** Serves a store; gives the address and how to end it. */
async function serve(store, ...options) {
  const server = spawn(program, ["view", store, ...options], { stdio: ["ignore", "pipe", "inherit"] });
  const address = await new Promise((found, failed) => {
    let text = "";
    server.stdout.on("data", (d) => {
      text += d;
      const match = text.match(/http:\/\/127\.0\.0\.1:\d+\/\w+\//);
      if (match) found(match[0]);
    });
    server.on("exit", (code) => failed(new Error(`isolume view ended with ${code}`)));
  });
  return { address, end: () => server.kill() };
}

/** The program's picture of a view, as RGBA bytes read back in the page. */
function pictureOfProgram(store, name, { isovalue, env, rotation, albedo, exposure, azimuth, elevation, more = [] }) {
  const file = join(out, `${name}-program.png`);
  const options = ["relight", store, "-q", "--isovalue", isovalue, "--env", env, "--env-rotate", rotation, "--exposure", exposure,
    "--view", `${azimuth},${elevation}`, "--frame", "box", "--size", SIZE.join("x"), "--background", "transparent", "--sun-split", "off", "-o", file, ...more];
  execFileSync(program, (more.length ? options : [...options, "--albedo", albedo]).map(String), { stdio: ["ignore", "ignore", "inherit"] });
  return `data:image/png;base64,${readFileSync(file).toString("base64")}`;
}

/** In the page: sets a state, draws, and compares with a picture; without cut faces if so asked for. */
async function difference(page, change, picture, withoutCuts = false) {
  return page.evaluate(async ([change, picture, size, withoutCuts]) => {
    const { isolume } = window;
    isolume.update({ ...change, background: "black", fixedSize: size, autoExposure: false });
    isolume.draw();
    const [width, height] = size;
    const pixels = async (source) => {
      const canvas = new OffscreenCanvas(width, height);
      const pen = canvas.getContext("2d", { willReadFrequently: true });
      pen.drawImage(source, 0, 0);
      return pen.getImageData(0, 0, width, height).data;
    };
    const image = new Image();
    image.src = picture;
    await image.decode();
    const ours = await pixels(isolume.renderer.canvas), theirs = await pixels(image);
    const depth = isolume.renderer.read(isolume.view(), width, height, 2);
    // In the view of lookups cut faces alone are grey.
    const lookup = isolume.renderer.read(isolume.view(), width, height, 4);
    const isLeftOut = (i) => withoutCuts && lookup[i] === lookup[i + 1];
    const rays = isolume.renderer.lastRays;
    const pixelsDeep = (Math.hypot(...rays.direction) / rays.unitsPerPixelHeight) * height;
    const at = (x, y) => depth[4 * (x + width * (height - 1 - y))] * pixelsDeep;
    const isCovered = (x, y) => depth[4 * (x + width * (height - 1 - y)) + 2] > 0 && theirs[4 * (x + width * y) + 3] === 255;
    let sum = 0, count = 0, covered = 0, disagree = 0, worst = 0;
    for (let y = 2; y < height - 2; y++) {
      for (let x = 2; x < width - 2; x++) {
        const both = [depth[4 * (x + width * (height - 1 - y)) + 2] > 0, theirs[4 * (x + width * y) + 3] > 127];
        if (both[0] !== both[1]) disagree++;
        if (!isCovered(x, y) || isLeftOut(4 * (x + width * (height - 1 - y)))) continue;
        covered++;
        // A silhouette: within two pixels of an edge, or of a jump in depth steeper than 81 degrees.
        let isInside = true;
        for (let j = -2; j <= 2 && isInside; j++)
          for (let i = -2; i <= 2 && isInside; i++)
            isInside = isCovered(x + i, y + j) && (i === 2 || (isCovered(x + i + 1, y + j) && Math.abs(at(x + i + 1, y + j) - at(x + i, y + j)) < 6))
              && (j === 2 || (isCovered(x + i, y + j + 1) && Math.abs(at(x + i, y + j + 1) - at(x + i, y + j)) < 6));
        if (!isInside) continue;
        for (let c = 0; c < 3; c++) {
          const d = Math.abs(ours[4 * (x + width * y) + c] - theirs[4 * (x + width * y) + c]);
          sum += d;
          worst = Math.max(worst, d);
        }
        count++;
      }
    }
    return { mean: sum / (3 * count), worst, count, covered, disagree };
  }, [change, picture, SIZE, withoutCuts]);
}

/** Drops a file onto the page, as a hand would. */
async function drop(page, path) {
  const before = await page.evaluate(() => document.getElementById("environment").options.length);
  await dropFile(page, path);
  await page.waitForFunction((n) => document.getElementById("environment").options.length > n || !document.getElementById("message").hidden, before);
}

const counters = (page) => page.evaluate(() => ({ ...window.isolume.counters }));

const browser = await launch();

async function open(address, viewport = { width: 1100, height: 720 }) {
  const page = await browser.newPage({ viewport });
  page.requests = [];
  page.on("request", (r) => { if (!/^(data|blob):/.test(r.url())) page.requests.push(r.url()); });
  page.on("pageerror", (e) => check(false, `no error in the page: ${e.message}`));
  // 415 is the program's answer to a file that is no environment.
  page.on("console", (m) => { if (m.type() === "error" && !/status of 415/.test(m.text())) check(false, `no error on the console: ${m.text()}`); });
  await page.goto(address);
  await page.waitForFunction(() => window.isolume || !document.getElementById("message").hidden, null, { timeout: 180000 });
  return page;
}

const DROPPED = join(root, "probes/light/sunset.hdr");

for (const store of stores) {
  const name = basename(store).replace(/\..*/, "");
  console.log(`\n${store}`);
  const { address, end } = await serve(store);
  const page = await open(address);
  const [low, high] = await page.evaluate(() => window.isolume.header.volume.range);
  const first = low + 0.36 * (high - low), second = low + 0.63 * (high - low);
  const loaded = await counters(page);
  const requested = page.requests.length;
  const common = { azimuth: 35, elevation: 25, albedo: 0.7, exposure: -0.5, rotation: 0 };
  const environment = (env) => page.evaluate((env) => window.isolume.header.probes.findIndex((p) => p.name === env), env);
  const compare = async (label, expected, change) => {
    const picture = pictureOfProgram(store, `${name}-${label}`, expected);
    const found = await difference(page, change, picture);
    await page.locator("#canvas").screenshot({ path: join(out, `${name}-${label}-page.png`) }).catch(() => {});
    check(found.mean <= MOST_DIFFERENCE && found.count > 0.3 * found.covered && found.disagree < 0.01 * found.covered + 20,
      `${label}: mean difference ${found.mean.toFixed(3)} of 255 (largest ${found.worst}) over ${found.count} of ${found.covered} covered pixels; ${found.disagree} disagree on coverage`);
  };

  // The isovalue by the slider itself, with the keyboard; then exactly.
  await page.focus("#isovalue");
  const before = await page.evaluate(() => window.isolume.state.isovalue);
  await page.keyboard.press("ArrowRight");
  check((await page.evaluate(() => window.isolume.state.isovalue)) > before, "the arrow key moves the isovalue slider");

  for (const [label, isovalue] of [["first", first], ["second", second]]) {
    await compare(label, { ...common, isovalue, env: "courtyard" }, { ...common, isovalue, environment: await environment("courtyard") });
  }
  const turned = { ...common, rotation: 75, azimuth: -60, elevation: 10, isovalue: second };
  await compare("turned", { ...turned, env: "studio" }, { ...turned, environment: await environment("studio") });
  const mapped = { ...common, isovalue: first, rotation: -120 };
  await compare("mapped", { ...mapped, env: "courtyard", more: ["--colormap", "viridis"] },
    { ...mapped, colour: "viridis", environment: await environment("courtyard") });
  const glowing = { ...common, isovalue: second, albedo: 0.8, emission: 0.3 };
  await compare("glowing", { ...glowing, env: "courtyard", more: ["--albedo", 0.8, "--emission", 0.3] },
    { ...glowing, colour: "", environment: await environment("courtyard") });
  await page.evaluate(() => window.isolume.update({ colour: "", albedo: 0.7, emission: 0 }));

  await drop(page, DROPPED);
  const dropped = await page.evaluate(() => window.isolume.state.environment);
  await compare("dropped", { ...common, isovalue: first, rotation: 30, env: DROPPED }, { ...common, isovalue: first, rotation: 30, environment: dropped });

  if (store === stores[0]) await underTheHand(page);

  await page.evaluate(() => window.isolume.draw());

  // Everything so far was light and view: no request, no texel through the CPU.
  const now = await counters(page);
  check(now.requests === loaded.requests && page.requests.length === requested,
    `no request after loading (${requested} while loading), neither counted by the page nor seen by the browser`);
  check(now.texelsTouched === loaded.texelsTouched && now.texelsTouched > 0, `no texel recomputed on the CPU (${now.texelsTouched} at loading)`);
  check(now.coefficientUpdates > loaded.coefficientUpdates && now.contractions > loaded.contractions,
    `${now.coefficientUpdates - loaded.coefficientUpdates} changes of coefficients, ${now.contractions - loaded.contractions} contractions on the GPU`);

  // Exposure alone does not even contract.
  await page.evaluate(() => { window.isolume.update({ exposure: 1, autoExposure: false }); window.isolume.draw(); });
  check((await counters(page)).contractions === now.contractions, "exposure needs no contraction");

  // What the page cannot read by itself it asks the program for.
  await drop(page, join(root, "probes/light/studio.exr"));
  const last = await page.evaluate(() => [document.getElementById("environment").selectedOptions[0].textContent, document.getElementById("message").textContent]);
  check(last[0] === "studio", `a dropped .exr becomes an environment (${last.join("; ")})`);
  const error = await page.evaluate(() => {
    const { isolume } = window;
    const given = isolume.coefficientsInWorld(undefined, 33);
    const index = isolume.header.probes.findIndex((p) => p.name === "studio");
    const expected = isolume.coefficientsInWorld({ coefficients: Float64Array.from(isolume.header.probes[index].coefficients) }, 33);
    return Math.max(...expected.map((v, i) => Math.abs(v - given[i]))) / Math.abs(expected[0]);
  });
  check(error < 1e-4, `its coefficients are the program's, within ${error.toExponential(1)} of the first`);

  if (store === stores[0]) await otherFiles(page);
  await shown(page);

  await page.evaluate(() => { window.isolume.update({ fixedSize: null, autoExposure: true, background: "theme", zoom: 1.25 }); window.isolume.draw(); });
  const speed = await page.evaluate(() => window.isolume.measure());
  console.log(`     ${speed.fetchesPerPixel.toFixed(1)} texture fetches a pixel (${speed.fetchesPerCoveredPixel.toFixed(1)} on the surface), ` +
    `${(speed.fetchesPerFrame / 1e6).toFixed(2)} million a frame of ${speed.pixels.join(" x ")}; ${speed.milliseconds.toFixed(0)} ms, ` +
    `${speed.contraction.toFixed(0)} ms to change the light, in ${speed.renderer}`);
  for (const light of [false, true]) {
    await page.evaluate((light) => { window.isolume.setTheme(light); window.isolume.draw(); }, light);
    await page.screenshot({ path: join(out, `${name}-${light ? "light" : "dark"}.png`) });
  }
  if (store === stores[0]) await accessible(page);
  await page.close();
  end();

  // The page in one file, from disk.
  const file = join(out, `${name}.html`);
  execFileSync(program, ["view", store, "-q", "--html", file], { stdio: ["ignore", "ignore", "inherit"] });
  const alone = await open(pathToFileURL(file).href);
  check(alone.requests.length === 1, `the page in one file (${(statSync(file).size / 1e6).toFixed(1)} MB) opens from disk and asks for nothing`);
  const picture = pictureOfProgram(store, `${name}-alone`, { ...common, isovalue: first, env: "courtyard" });
  const found = await difference(alone, { ...common, isovalue: first }, picture);
  check(found.mean <= MOST_DIFFERENCE, `one file: mean difference ${found.mean.toFixed(3)} of 255 to the program's picture of the whole store`);
  await alone.screenshot({ path: join(out, `${name}-alone.png`) });
  await alone.close();
}

for (const store of scenes) await inScene(store);

/** A store of a scene: light of environment, luminaires and surface, each volume of several, and the page in one file. */
async function inScene(store) {
  const name = basename(store).replace(/\..*/, "");
  console.log(`\n${store}`);
  const held = JSON.parse(execFileSync(program, ["info", store, "--json"]).toString()).volumes;
  const volumes = held.length > 1 ? held : [null];
  for (const volume of volumes) {
    const { address, end } = await serve(store, ...(volume ? ["--volume", volume] : []));
    const page = await open(address);
    const { scene, isovalues, probes } = await page.evaluate(() => window.isolume.header);
    const isovalue = isovalues[1] ?? isovalues[0];
    // The program shades cut faces of a volume alone without the factor on its albedo.
    const isTinted = scene.tint.some((factor) => factor !== 1);
    const loaded = await counters(page);
    const label = volume ?? name;
    const view = { azimuth: 35, elevation: 25, albedo: 0.7, rotation: 0, isovalue };
    // An exposure that shows what is there.
    const exposed = async (change) => page.evaluate((change) => {
      window.isolume.update({ ...change, autoExposure: true });
      window.isolume.draw();
      return Math.round(10 * window.isolume.state.exposure) / 10 - 0.3;
    }, change);
    const compare = async (what, change, env, ...more) => {
      const state = { ...view, emission: 0, powers: scene.luminaires.map(() => 1), strength: 1, ...change };
      const exposure = await exposed(state);
      const options = ["--albedo", state.albedo, ...(volume ? ["--volume", volume] : []), ...more];
      const picture = pictureOfProgram(store, `${label}-${what}`, { ...state, exposure, env, more: options });
      const found = await difference(page, { ...state, exposure }, picture, isTinted);
      await page.screenshot({ path: join(out, `${label}-${what}-page.png`) });
      check(found.mean <= MOST_DIFFERENCE && found.count > 0.3 * found.covered && found.disagree < 0.01 * found.covered + 20,
        `${label}, ${what}: mean difference ${found.mean.toFixed(3)} of 255 (largest ${found.worst}) over ${found.count} of ${found.covered} covered pixels`);
    };
    const index = (env) => probes.findIndex((p) => p.name === env);
    if (scene.luminaires.length > 0) {
      const begun = await page.evaluate(() => [document.getElementById("environment").selectedOptions[0].textContent, window.isolume.state.powers]);
      check(begun[0] === "none (dark)" && begun[1].every((p) => p === 1), `begins in the light of its luminaires alone (${begun[0]})`);
      const lamp = scene.luminaires[0].name;
      await compare("luminaires", { environment: 0 }, "constant:0");
      await compare("dimmed", { environment: 0, powers: scene.luminaires.map((_, i) => (i === 0 ? 0.4 : 1)), albedo: 0.9 }, "constant:0", "--luminaire", `${lamp}=0.4`);
      await page.focus("#power0");
      await page.keyboard.press("Home");
      const off = await page.evaluate(() => [window.isolume.state.powers[0], document.getElementById("powerText0").textContent]);
      check(off[0] === 0 && off[1] === "× 0.00", `the slider of ${lamp} switches it off (${off[1]})`);
    } else {
      const standing = await page.textContent("#standing");
      check(scene.partners.every((p) => standing.includes(`${p.name} at isovalue`)), `says what else stands there: ${standing}`);
    }
    await compare("glowing", { environment: index("courtyard"), rotation: 60, emission: 2 }, "courtyard", "--emission", 2);
    await compare("environment", { environment: index("studio"), rotation: -30 }, "studio");
    const now = await counters(page);
    check(now.requests === loaded.requests && now.texelsTouched === loaded.texelsTouched && now.contractions > loaded.contractions,
      `${now.contractions - loaded.contractions} contractions on the GPU, no request and no texel through the CPU`);
    await page.close();
    end();
    if (volume !== volumes[0]) continue;

    const file = join(out, `${name}.html`);
    execFileSync(program, ["view", store, "-q", "--html", file], { stdio: ["ignore", "ignore", "inherit"] });
    const alone = await open(pathToFileURL(file).href);
    const state = { ...view, environment: 0, rotation: 0 };
    const env = (await alone.evaluate(() => window.isolume.header.probes[0].name));
    const exposure = await alone.evaluate((state) => { window.isolume.update({ ...state, autoExposure: true }); window.isolume.draw(); return Math.round(10 * window.isolume.state.exposure) / 10; }, state);
    const picture = pictureOfProgram(store, `${name}-alone`, { ...state, exposure, env, more: ["--albedo", 0.7, ...(volume ? ["--volume", volume] : [])] });
    const found = await difference(alone, { ...state, exposure }, picture);
    check(found.mean <= MOST_DIFFERENCE, `one file: mean difference ${found.mean.toFixed(3)} of 255 to the program's picture of the whole store`);
    await alone.close();
  }
}

/** Drag, drag with Shift, wheel. */
async function underTheHand(page) {
  const box = await page.locator("#canvas").boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  const state = () => page.evaluate(() => ({ ...window.isolume.state }));
  const drag = async () => {
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x + 40, y + 10, { steps: 2 });
    await page.mouse.up();
  };
  const before = await state();
  await drag();
  const turned = await state();
  await page.keyboard.down("Shift");
  await drag();
  await page.keyboard.up("Shift");
  const lit = await state();
  await page.mouse.wheel(0, -200);
  await page.waitForFunction((zoom) => window.isolume.state.zoom > zoom, lit.zoom);
  check(turned.azimuth !== before.azimuth && turned.elevation !== before.elevation && turned.rotation === before.rotation, "a drag turns the view");
  check(lit.rotation !== turned.rotation && lit.azimuth === turned.azimuth, "a drag with Shift turns the light; the wheel zooms");
}

/** Environments of other kinds, if there are any beside the repository, and a file that is none. */
async function otherFiles(page) {
  await drop(page, join(root, "README.md"));
  const text = await page.textContent("#message");
  check(text.startsWith("README.md: "), `a file that is no environment is refused: ${text.slice(0, 90)}`);
  await page.evaluate(() => { document.getElementById("message").hidden = true; });
  const folder = join(process.env.ISOLUME_DATA || join(root, "../shared/data"), "probes");
  for (const [name, requests] of [["courtyard_256x128_none.exr", 0], ["courtyard_256x128_piz_half.exr", 0]]) {
    if (!existsSync(join(folder, name))) {
      console.log(`     skipped: no ${name} in ${folder}`);
      continue;
    }
    const before = await counters(page);
    await drop(page, join(folder, name));
    const error = await page.evaluate(() => {
      const { isolume } = window;
      const expected = isolume.header.probes.find((p) => p.name === "courtyard").coefficients;
      const given = isolume.coefficientsInWorld();
      return Math.abs(given[0] - isolume.coefficientsInWorld({ coefficients: Float64Array.from(expected) })[0]) / Math.abs(given[0]);
    });
    const asked = (await counters(page)).requests - before.requests;
    check(asked === requests && error < 0.01, `${name}: ${asked ? "read by the program" : "read in the page"}, mean light within ${error.toExponential(1)} of the embedded courtyard`);
  }
}

/** Exposure, silhouettes, and an isovalue that no surface has. */
async function shown(page) {
  await page.evaluate(() => window.isolume.update({ fixedSize: null, autoExposure: true, background: "black", environment: 0 }));
  for (const rotation of [0, 120]) {
    const found = await page.evaluate((rotation) => {
      const { isolume } = window;
      isolume.update({ rotation });
      isolume.draw();
      const [width, height] = [330, 216];
      const numbers = isolume.renderer.read(isolume.view(), width, height, 6, 4);
      const white = 1 / (isolume.renderer.norm * 2 ** isolume.state.exposure);
      let covered = 0, clipped = 0;
      const levels = new Set();
      for (let i = 0; i < numbers.length; i += 4) {
        if (numbers[i + 3] > 0) covered++;
        if (numbers[i + 3] > 0 && Math.max(numbers[i], numbers[i + 1], numbers[i + 2]) > white) clipped++;
        levels.add(Math.round(16 * numbers[i + 3]));
      }
      return { share: clipped / covered, levels: levels.size };
    }, rotation);
    check(found.share <= 0.01, `automatic exposure cuts off ${(100 * found.share).toFixed(2)} % of what it shows, light turned by ${rotation}°`);
    check(found.levels > 10, `silhouettes have ${found.levels} of 17 levels of coverage`);
  }
  const [high, before] = await page.evaluate(() => [window.isolume.header.volume.range[1], window.isolume.state.isovalue]);
  await page.fill("#isovalueNumber", String(2 * Math.abs(high) + 1));
  await page.press("#isovalueNumber", "Enter");
  const message = await page.textContent("#message");
  check(message.startsWith("no surface at ") && message.includes("the range is"), `an isovalue out of range: ${message}`);
  check((await page.evaluate(() => window.isolume.state.isovalue)) === before, "what was shown stays");
  await page.evaluate((isovalue) => window.isolume.update({ isovalue }), before);
  check((await page.textContent("#message")) === "", "the message goes with the next surface");
}

/** Names, keyboard and contrast. */
async function accessible(page) {
  const controls = await page.evaluate(() => {
    document.querySelectorAll("details").forEach((d) => (d.open = true));
    const all = [...document.querySelectorAll("input:not([hidden]), select, button, summary, canvas[tabindex]")];
    const name = (e) => e.getAttribute("aria-label") || e.labels?.[0]?.textContent.trim() || document.getElementById(e.getAttribute("aria-labelledby"))?.textContent || (e.matches("button, summary") ? e.textContent.trim() : "");
    return all.map((e) => [e.id || e.parentElement.textContent.trim(), name(e), e.tabIndex]);
  });
  const nameless = controls.filter(([, name]) => !name);
  check(nameless.length === 0, `each of ${controls.length} controls has a name ${nameless.join("; ")}`);
  check(controls.every(([, , index]) => index >= 0), "each is in the order of Tab");
  await page.focus("#canvas");
  const before = await page.evaluate(() => ({ ...window.isolume.state }));
  for (const key of ["ArrowLeft", "ArrowUp", "+", "]", "Shift+ArrowRight"]) await page.keyboard.press(key);
  const after = await page.evaluate(() => ({ ...window.isolume.state }));
  const moved = ["azimuth", "elevation", "zoom", "isovalue", "rotation"].filter((k) => before[k] !== after[k]);
  check(moved.length === 5, `keys in the view change ${moved.join(", ")}`);
  for (const light of [false, true]) {
    const worst = await page.evaluate((light) => {
      window.isolume.setTheme(light);
      const style = getComputedStyle(document.documentElement);
      const luminance = (name) => {
        const hex = style.getPropertyValue(name).trim().slice(1);
        const [r, g, b] = [0, 2, 4].map((o) => parseInt(hex.slice(o, o + 2), 16) / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
      };
      const contrast = (a, b) => (Math.max(luminance(a), luminance(b)) + 0.05) / (Math.min(luminance(a), luminance(b)) + 0.05);
      const pairs = [["--text", "--panel"], ["--soft", "--panel"], ["--text", "--stage"], ["--soft", "--stage"], ["--warn", "--panel"], ["--text", "--button"]];
      return Math.min(...pairs.map(([a, b]) => contrast(a, b)));
    }, light);
    check(worst >= 4.5, `contrast of text is at least 4.5 (${worst.toFixed(1)}, ${light ? "light" : "dark"})`);
  }
}

await watched();

/** A model that is saved is shown again from the same side; while it is broken, what was shown stays, with the reason. */
async function watched() {
  const model = (radius, turn = 0) => `[probe]\nname = "courtyard"\nrotation = ${turn}\n[[luminaires]]\nshape = "point"\nposition = [3, 3, 3]\npower = 100\n[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\nsamples = 16\n[model.point.p]\ncentre = [0, 0, 0]\nradius = ${radius}\n`;
  const file = join(out, "watched.toml");
  const save = (radius, turn) => writeFileSync(file, model(radius, turn));
  save("1");
  const server = await serve(file, "--watch", "--layers", "1", "--rays", "4");
  const page = await open(server.address);
  const covered = () => page.evaluate(() => {
    const { renderer, view } = window.isolume;
    const numbers = renderer.read(view(), 96, 72, 6);
    let count = 0;
    for (let i = 3; i < numbers.length; i += 4) count += numbers[i] > 0 ? 1 : 0;
    return count;
  });
  await page.evaluate(() => window.isolume.update({ azimuth: 77 }));
  const before = await covered();
  save('"wide"');
  await page.waitForFunction(() => /watched\.toml:13/.test(document.getElementById("message").textContent), null, { timeout: 60_000 });
  check(await covered() === before, "a broken model keeps what was shown, and its line is told");
  await page.screenshot({ path: join(out, "watched-broken.png") });
  save("0.6");
  await page.waitForFunction(() => window.isolume?.header.watched === 1, null, { timeout: 60_000 });
  const state = await page.evaluate(() => ({ azimuth: window.isolume.state.azimuth, hidden: document.getElementById("message").hidden }));
  const after = await covered();
  check(state.azimuth === 77 && state.hidden, "a saved model is shown from the same side, without the message");
  check(after > 0 && after < 0.6 * before, `the model is as it was saved: ${after} pixels after ${before}`);
  await page.screenshot({ path: join(out, "watched.png") });
  // What the file says anew holds; what was changed on the page stays, and nowhere else.
  save("0.6", 90);
  await page.waitForFunction(() => window.isolume?.header.watched === 2, null, { timeout: 60_000 });
  const turned = await page.evaluate(() => ({ ...window.isolume.state, stored: sessionStorage.length }));
  check(turned.rotation === 90 && turned.azimuth === 77 && turned.stored === 0, `the light is turned by the file (${turned.rotation}°)`);
  await page.close();
  // Neither a request that fails nor a page that cannot start is the end, and none loads itself without need.
  const other = await browser.newPage({ viewport: { width: 800, height: 600 } });
  let loads = 0;
  other.on("load", () => loads++);
  const says = (pattern) => other.waitForFunction((p) => new RegExp(p).test(document.getElementById("message").textContent), pattern, { timeout: 60_000 });
  await other.goto(server.address);
  await other.waitForFunction(() => window.isolume?.header.watched === 2, null, { timeout: 60_000 });
  await other.route("**/watched.json", (route) => route.abort());
  await says("does not answer");
  await other.unroute("**/watched.json");
  await says("^$");
  await other.route("**/payload.bin", (route) => route.fulfill({ body: "" }));
  await other.reload();
  await says("."); // why it cannot start
  await other.waitForTimeout(2500);
  check(loads === 2, `a page that cannot start waits (${loads} loads)`);
  await other.unroute("**/payload.bin");
  save("0.8");
  await other.waitForFunction(() => window.isolume?.header.watched === 3, null, { timeout: 60_000 });
  check(loads === 3, "what it waited for is shown");
  await other.close();
  server.end();
}

await lazy();

/** A volume without a store: a draft at once, then the finished texture in its place, and what was set on the page stays. */
async function lazy() {
  const cache = join(out, "lazy-cache");
  rmSync(cache, { recursive: true, force: true });
  const server = await serve("gyroid:36", "--cache", cache, "--rays", "2048", "--layers", "2");
  const page = await open(server.address);
  const first = await page.evaluate(() => ({ draft: window.isolume.header.draft, error: window.isolume.header.constant_error }));
  check(first.draft === true, "a draft is shown before the bake is done");
  await page.waitForFunction(() => /^draft · a finer texture is being baked · \d+ %/.test(document.getElementById("progress").textContent), null, { timeout: 60_000 });
  await page.screenshot({ path: join(out, "lazy-draft.png") });
  await drop(page, DROPPED);
  const set = { isovalue: 0.31, azimuth: 77, elevation: 11, zoom: 1.4, rotation: 40, albedo: 0.5, colour: "magma", mode: "light", background: "black", exposure: -0.25, autoExposure: false };
  await page.evaluate((set) => { window.marked = true; window.isolume.update(set); }, set);
  const state = () => page.evaluate(() => {
    const { layers, bands, powers, ...rest } = window.isolume.state;
    return JSON.stringify({ ...rest, layers, bands, probes: document.getElementById("environment").options.length });
  });
  const before = await state();
  await page.waitForFunction(() => window.isolume.header.watched === undefined, null, { timeout: 600_000 });
  const after = await page.evaluate(() => ({
    marked: window.marked, error: window.isolume.header.constant_error, about: document.getElementById("about").textContent,
    progress: document.getElementById("progress").hidden, message: document.getElementById("message").hidden, texels: window.isolume.header.texture.texels[0],
  }));
  check(after.marked && await state() === before, "the finished texture takes its place; all that was set, and the dropped environment, stay");
  check(after.error < 0.5 * first.error && after.texels === 36, `its error is smaller (${after.error.toExponential(1)} after ${first.error.toExponential(1)})`);
  check(after.progress && after.message && after.about.includes("2048 rays a texel"), "nothing says draft any more");
  await page.screenshot({ path: join(out, "lazy.png") });
  const requests = page.requests.length;
  // What took the place draws the same as a page that began with it.
  const light = { ...set, environment: 0 };
  const picture = async (page) => page.evaluate((change) => {
    window.isolume.update({ ...change, fixedSize: [240, 180] });
    window.isolume.draw();
    return window.isolume.renderer.canvas.toDataURL();
  }, light);
  const other = await open(server.address);
  check(await picture(page) === await picture(other), "it draws what a page draws that began with it");
  await page.waitForTimeout(1500);
  check(page.requests.length === requests, "and asks for nothing more");
  await other.close();
  await page.close();
  server.end();
  // What is in the cache needs no draft.
  const again = await serve("gyroid:36", "--cache", cache, "--rays", "2048", "--layers", "2");
  const found = await open(again.address);
  check(await found.evaluate(() => window.isolume.header.watched === undefined), "a store of the cache is shown without a draft");
  await found.close();
  again.end();
}

await browser.close();
finish("the page");
