// The page: what is shown, what the controls say, and what a change makes stale.

import { OPEN_BY_DEGREE, applyBlocks, openRadiance, projectLatLong, rotateAboutZ } from "./sh.mjs";
import { decodeRadiance } from "./radiance.mjs";
import { decodeOpenExr } from "./openexr.mjs";
import { halfFromNumber } from "./openexr_codes.mjs";
import { host } from "./host.mjs";
import { counters, isSelfContained, loadPackage, request, section } from "./data.mjs";
import { MODES } from "./shaders.mjs";
import { Renderer } from "./renderer.mjs";
import { times } from "./camera.mjs";

const $ = (id) => document.getElementById(id);
const START = { azimuth: 35, elevation: 25, zoom: 1, panX: 0, panY: 0 };
const VIEWS = {
  light: ["Light", ""],
  normal: ["Normals", "The direction of the surface in world: x red, y green, z blue."],
  error: ["Error of the bake", "Relative standard error under LIGHT: black 0, blue 5 %, orange 10 %, white 20 % and more."],
  lookup: ["How light was looked up", "Green: all eight texels. Yellow: some have no level set. Orange: those around. Red: none, light without shadows."],
};
// Longest pause between a change and the fine picture, and what a frame under the hand may take, in milliseconds.
const IDLE = 160, SMOOTH = 45, PATIENT = 2500;
// Rays along a pixel's side at silhouettes, and rows that a slow GPU refines at a time.
const FINE = 4, ROWS = 24;
// Pause between looks at what is to come, in milliseconds.
const WATCH = 500;

const state = {
  ...START, isovalue: 0, perspective: false, environment: 0, rotation: 0, exposure: 0, autoExposure: true,
  albedo: 0.7, emission: 0, strength: 1, powers: [], colour: "", mode: "light", background: "theme", layers: [], bands: [], fixedSize: null,
};
let header, data, renderer, probes = [];
let begun = null; // the state that the page began with, where another may come
let lightIsStale = true, exposureIsStale = true, isExposed = false, refinement = 0, frameIsDue = false, idleTimer = 0, scale = 1, coarse = false;

/** Changes the state and lets a frame follow. */
function update(change) {
  Object.assign(state, change);
  const touches = (...names) => names.some((n) => n in change);
  const recolours = state.colour !== "" && touches("isovalue");
  if (touches("environment", "strength", "powers", "rotation", "albedo", "emission", "colour", "layers", "bands") || recolours) lightIsStale = true;
  // Of what is in view: whatever changes it, or the light on it.
  if (lightIsStale || touches("isovalue", "autoExposure", "azimuth", "elevation", "zoom", "panX", "panY", "perspective")) exposureIsStale = true;
  if (touches("isovalue")) sayIfEmpty();
  if (touches("environment")) showSky();
  showState();
  host?.tell("state", { state: sharedState() });
  if (state.fixedSize) return; // who fixes the size draws by hand
  coarse = true;
  schedule();
  clearTimeout(idleTimer);
  idleTimer = setTimeout(() => { coarse = false; schedule(); }, IDLE);
}

function schedule() {
  if (frameIsDue) return;
  frameIsDue = true;
  requestAnimationFrame(() => { frameIsDue = false; drawFrame(); });
}

/** Linear albedo of the surface shown. */
function albedoNow() {
  if (state.colour === "") return [state.albedo, state.albedo, state.albedo];
  const [low, high] = header.volume.range;
  const t = Math.min(1, Math.max(0, (state.isovalue - low) / (high - low || 1)));
  const at = 6 * Math.round(t * 255);
  const linear = (byte) => (byte <= 10 ? byte / 255 / 12.92 : ((byte / 255 + 0.055) / 1.055) ** 2.4);
  return [0, 2, 4].map((o) => state.albedo * linear(parseInt(header.colormaps[state.colour].slice(at + o, at + o + 2), 16)));
}

/** Coefficients of the light in world, red, green, blue side by side. */
function coefficientsInWorld(probe = probes[state.environment], degrees = state.rotation) {
  const most = Math.max(...header.texture.bands);
  return applyBlocks(header.world_from_upright, rotateAboutZ(probe.coefficients, most, degrees), most);
}

/** Luminaires of the scene; none of a volume alone. */
function luminaires() {
  return header.scene?.luminaires ?? [];
}

/** What the surface sends out by and large: radiance of this size is 1 on the GPU, whose numbers are 16-bit floats. */
function sizeOfLight() {
  const mean = (rgb) => (rgb[0] + rgb[1] + rgb[2]) / 3;
  const ofEnvironment = state.strength * mean(probes[state.environment].coefficients) * 0.2820948;
  const size = luminaires().reduce((sum, l, i) => sum + state.powers[i] * mean(l.factor) * l.mean, Math.max(ofEnvironment, 0)) + state.emission;
  return size > 0 ? size : 1;
}

/** What the GPU needs of the light: a few hundred numbers. */
function lightForGpu() {
  counters.coefficientUpdates++;
  const { bands, scales } = header.texture;
  const most = Math.max(...bands);
  const world = coefficientsInWorld().map((v) => v * state.strength);
  for (let l = 0; l < most; l++) if (!state.bands[l]) world.fill(0, 3 * l * l, 3 * (l + 1) * (l + 1));
  const norm = sizeOfLight();
  const albedo = albedoNow();
  const openAlbedo = albedo.map((v, c) => v * (header.scene?.tint[c] ?? 1));
  const count = bands.reduce((sum, b) => sum + b * b, 0);
  const weights = new Float32Array(4 * count);
  const channels = header.scene ? 3 : 1;
  let at = 0, first = 0; // the row of weights, and the first number of the layer in a texel
  bands.forEach((b, k) => {
    if (channels === 1) weights[4 * at + 3] = Math.sqrt(4 * Math.PI) * scales[first];
    for (let i = 0; i < b * b; i++, at++) {
      for (let c = 0; c < 3; c++) {
        const scale = scales[first + i + (channels === 3 ? c * b * b : 0)];
        weights[4 * at + c] = (albedo[c] ** (k + 1) * world[3 * i + c] * scale) / norm;
      }
    }
    first += channels * b * b;
  });
  const open = new Float32Array(75);
  for (let i = 0; i < Math.min(25, most * most); i++) {
    const factor = (state.layers[0] ? OPEN_BY_DEGREE[Math.floor(Math.sqrt(i))] : 0) / norm;
    for (let c = 0; c < 3; c++) open[3 * i + c] = factor * world[3 * i + c];
  }
  // Cut faces: half of what an open surface there would send, as the program shades them.
  const cut = [];
  const g = renderer.placement.inverse;
  for (let face = 0; face < 6; face++) {
    const row = g.slice(3 * (face >> 1), 3 * (face >> 1) + 3);
    const length = Math.hypot(...row) * (face & 1 ? 1 : -1);
    const lit = openRadiance(world, most, row.map((v) => v / length));
    for (let c = 0; c < 3; c++) cut.push(state.layers[0] ? (0.5 * openAlbedo[c] * Math.max(lit[c], 0)) / norm : 0);
  }
  const powers = luminaires().flatMap((l, i) => l.factor.map((f) => (f * state.powers[i]) / norm));
  const emitted = [0, 1, 2].map(() => state.emission / norm);
  return { weights, norm, albedo, openAlbedo, emitted, powers, shown: state.layers.map(Number), open, cut };
}

/** The exposure at which less than 1 % of what is in view is cut off at white, in its brightest channel. */
function automaticExposure() {
  const { clientWidth, clientHeight } = $("stage");
  const numbers = renderer.read(view(), 192, Math.max(1, Math.round((192 * clientHeight) / Math.max(1, clientWidth))), MODES.radiance);
  const largest = [];
  for (let i = 0; i < numbers.length; i += 4) {
    if (numbers[i + 3] > 0) largest.push(Math.max(numbers[i], numbers[i + 1], numbers[i + 2]));
  }
  largest.sort((a, b) => a - b);
  const white = largest[Math.round((largest.length - 1) * 0.995)]; // half of the 1 %: the picture has other pixels
  return white > 0 ? -Math.log2(white * renderer.norm) : state.exposure;
}

/** The state as the renderer takes it. */
function view() {
  const colours = { white: [1, 1, 1, 1], black: [0, 0, 0, 1], environment: [0, 0, 0, 0] };
  // #1b1f24 and #f6f7f9 of the style, linear.
  const theme = document.documentElement.classList.contains("light") ? [0.922, 0.93, 0.947, 1] : [0.0110, 0.0137, 0.0176, 1];
  return { ...state, background: colours[state.background] ?? theme };
}

/** Draws the fine picture from a row on, some rows to a frame, until something changes. */
function refine(number, first) {
  requestAnimationFrame(() => {
    if (number !== refinement || coarse || first >= renderer.canvas.height) return;
    renderer.show(view(), MODES[state.mode], FINE, first, ROWS);
    renderer.finish();
    refine(number, first + ROWS);
  });
}

function drawFrame() {
  const canvas = renderer.canvas;
  const start = performance.now();
  if (lightIsStale) renderer.contract(lightForGpu());
  lightIsStale = false;
  // Not under the hand, but before anything has been seen.
  if (state.autoExposure && exposureIsStale && (!coarse || !isExposed)) {
    state.exposure = automaticExposure();
    exposureIsStale = false;
    isExposed = true;
    showState();
    host?.tell("state", { state: sharedState() });
  }
  const box = $("stage").getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = state.fixedSize ?? [box.width * ratio, box.height * ratio];
  const factor = coarse && !state.fixedSize ? scale : 1;
  const size = [width, height].map((v) => Math.max(1, Math.round(v * factor)));
  if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
  // Four rays a pixel and sixteen at silhouettes: at once where that is no wait, else some rows at a time.
  const isPatient = timePerPixel * width * height * 5 < PATIENT;
  const fine = state.fixedSize ? 2 : FINE;
  renderer.show(view(), MODES[state.mode], state.fixedSize || (!coarse && isPatient) ? fine : 1);
  refinement++;
  if (!coarse && !isPatient && !state.fixedSize) refine(refinement, 0);
  if (coarse) {
    renderer.finish();
    const took = performance.now() - start;
    timePerPixel = took / (size[0] * size[1]);
    scale = Math.min(1, Math.max(0.15, scale * Math.sqrt(SMOOTH / Math.max(took, 1))));
  }
  showBar();
  showCounters();
}
let timePerPixel = 1e-3;

// --- environments ---

function showSky() {
  const probe = probes[state.environment];
  renderer.setSky(probe.size[0], probe.size[1], probe.picture);
}

/** What the page calls an environment. */
function labelOf(probe) {
  return probe.coefficients.every((v) => v === 0) ? "none (dark)" : probe.name;
}

/** Adds an environment of linear radiance (lat-long) and shows it. */
function addProbe(name, { width, height, rgb }) {
  const coefficients = projectLatLong(width, height, rgb, Math.max(...header.texture.bands));
  probes.push({ name, coefficients, ...smallPicture(width, height, rgb), relativeError: null });
  $("environment").add(new Option(name, probes.length - 1));
  $("environment").value = probes.length - 1;
  update({ environment: probes.length - 1 });
}

function smallPicture(width, height, rgb) {
  const size = [Math.min(128, width), Math.min(64, height)];
  const picture = new Uint16Array(3 * size[0] * size[1]);
  for (let y = 0; y < size[1]; y++) {
    for (let x = 0; x < size[0]; x++) {
      const from = [Math.floor((x * width) / size[0]), Math.floor((y * height) / size[1])];
      const to = [Math.floor(((x + 1) * width) / size[0]), Math.floor(((y + 1) * height) / size[1])];
      for (let c = 0; c < 3; c++) {
        let sum = 0;
        for (let j = from[1]; j < to[1]; j++) for (let i = from[0]; i < to[0]; i++) sum += Math.max(0, rgb[3 * (i + width * j) + c] || 0);
        picture[3 * (x + size[0] * y) + c] = halfFromNumber(Math.min(sum / ((to[0] - from[0]) * (to[1] - from[1])) || 0, 65000));
      }
    }
  }
  return { size, picture };
}

/** Reads a dropped file: in the page where it can be, else with the program's help. */
async function openFile(file) {
  const bytes = new Uint8Array(await file.arrayBuffer());
  const name = file.name.replace(/\.[^.]*$/, "");
  try {
    const isExr = bytes[0] === 0x76 && bytes[1] === 0x2f;
    let image;
    try {
      image = isExr ? await decodeOpenExr(bytes) : decodeRadiance(bytes);
    } catch (error) {
      if (isSelfContained()) throw error;
      if (host) return addProbe(name, await host.ask("read", { name: file.name, bytes: bytes.buffer }, [bytes.buffer]));
      const answer = await request(`probe?name=${encodeURIComponent(file.name)}`, { method: "POST", body: bytes });
      const [width, height] = answer.headers.get("x-image-size").split("x").map(Number);
      image = { width, height, rgb: new Float32Array(await answer.arrayBuffer()) };
    }
    if (Math.abs(image.width / image.height - 2) > 0.02) {
      say(`${file.name} is ${image.width} × ${image.height}; it is taken as latitude-longitude, which is 2 : 1`);
    } else say("");
    addProbe(name, image);
  } catch (error) {
    say(`${file.name}: ${error.message}`);
  }
}

// --- what the page says ---

function say(text) {
  $("message").textContent = text;
  $("message").hidden = text === "";
}

/** Says that there is no surface at an isovalue, and unsays it. */
function sayIfEmpty(value = state.isovalue) {
  const [low, high] = header.volume.range;
  const isEmpty = !(value > low && value < high);
  if (isEmpty) say(`no surface at ${short(value, 6)}: the range is ${short(low, 6)} to ${short(high, 6)}, ends not included`);
  else if ($("message").textContent.startsWith("no surface")) say("");
}

/** A number in as few digits as tell it. */
function short(value, digits = 4) {
  return String(Number(value.toPrecision(digits)));
}

function percent(value) {
  return value === null || !Number.isFinite(value) ? "unknown" : `${(100 * value).toPrecision(2)} %`;
}

function showState() {
  const probe = probes[state.environment];
  const turned = Math.round(state.rotation);
  const isDark = labelOf(probe) !== probe.name;
  const changed = luminaires().flatMap((l, i) => (state.powers[i] === 1 ? [] : [`${l.name} × ${short(state.powers[i])}`]));
  const light = [
    ...(isDark && luminaires().length > 0 ? [] : [`${labelOf(probe)}${state.strength === 1 ? "" : ` × ${short(state.strength)}`}${turned && !isDark ? ` turned ${turned}°` : ""}`]),
    ...(luminaires().length === 0 ? [] : changed.length > 0 ? changed : ["luminaires"]),
    ...(state.emission > 0 ? [`emission ${short(state.emission)}`] : []),
  ].join(" + ");
  $("shown").textContent =
    `isovalue ${short(state.isovalue)} · ${light} · ` +
    (state.colour ? state.colour : `albedo ${short(state.albedo)}`) + ` · ${state.exposure >= 0 ? "+" : "−"}${Math.abs(state.exposure).toFixed(2)} EV` +
    (state.mode === "light" ? "" : ` · ${VIEWS[state.mode][0].toLowerCase()}`);
  // Not under the hand of someone who types.
  if ($("isovalueNumber") !== document.activeElement) $("isovalueNumber").value = short(state.isovalue, 6);
  $("isovalue").value = sliderFromIsovalue(state.isovalue);
  $("isovalue").setAttribute("aria-valuetext", short(state.isovalue));
  $("albedo").value = state.albedo;
  $("rotation").value = turned;
  $("exposure").value = state.exposure;
  $("albedoText").textContent = state.albedo.toFixed(2);
  $("emission").value = state.emission;
  $("emissionText").textContent = short(state.emission, 3);
  $("strength").value = state.strength;
  $("strengthText").textContent = `× ${state.strength.toFixed(2)}`;
  state.powers.forEach((power, i) => {
    $(`power${i}`).value = power;
    $(`powerText${i}`).textContent = `× ${power.toFixed(2)}`;
  });
  $("rotationText").textContent = `${turned}°`;
  $("exposureText").textContent = `${state.exposure.toFixed(2)} EV`;
  $("autoExposure").checked = state.autoExposure;
  $("perspective").checked = state.perspective;
  $("environment").value = state.environment;
  const held = header.isovalues;
  const step = (header.volume.range[1] - header.volume.range[0]) * 1e-3;
  $("heldNote").hidden = held === null || held.some((v) => Math.abs(v - state.isovalue) <= step);
  if (held) $("heldNote").textContent = `Baked for ${held.map((v) => short(v)).join(", ")} only: elsewhere light is partly without shadows.`;
  const [under, error] = probe.relativeError === null ? [lightOfErrors(), header.constant_error]
    : [[...(isDark ? [] : [probe.name]), ...(luminaires().length > 0 ? ["the luminaires"] : [])].join(" and ") || labelOf(probe), probe.relativeError];
  $("errorNote").textContent = `Standard error of the bake under ${under} at albedo ${short(header.albedo, 2)}: ` +
    `${percent(error)} of the mean radiance (RMS over all texels).`;
  const { lamps } = probe;
  $("lampsNote").hidden = !(lamps?.count > 0);
  if (lamps?.count > 0) {
    $("lampsNote").textContent = `${lamps.count === 1 ? "A lamp" : `${lamps.count} lamps`} with ${percent(lamps.share)} of this light ` +
      "cannot cast sharp shadows here: the page multiplies, it traces no rays. Files of isolume relight have them.";
  }
  $("standing").textContent = standing();
  $("standing").hidden = !header.scene;
  $("legend").textContent = VIEWS[state.mode][1].replace("LIGHT", lightOfErrors());
  $("legend").hidden = VIEWS[state.mode][1] === "";
  $("canvas").setAttribute("aria-label", `${header.name}: ${$("shown").textContent}`);
}

/** The light of the view of errors. */
function lightOfErrors() {
  return luminaires().length > 0 ? "the luminaires" : "constant light";
}

/** What else stands in a scene. */
function standing() {
  const { partners, volume } = header.scene ?? { partners: [] };
  const with_ = partners.map((p) => `${p.name} at isovalue ${short(partnered(p.isovalues, state.isovalue))}`);
  return (with_.length > 0 ? `This is ${volume}, in the light of ${with_.join(", ")}, not drawn here. ` : "") + "Walls and luminaires, where there are any, light it and are not drawn.";
}

/** The isovalue of another volume that belongs to one of this: linear between knots, the same where there are none. */
function partnered(knots, isovalue) {
  if (knots.length === 0) return isovalue;
  const sorted = [...knots].sort((x, y) => x[0] - y[0]);
  const next = sorted.findIndex((knot) => knot[0] > isovalue);
  if (next === 0) return sorted[0][1];
  if (next < 0) return sorted[sorted.length - 1][1];
  const [[a, b], [c, d]] = [sorted[next - 1], sorted[next]];
  return b + ((isovalue - a) / (c - a)) * (d - b);
}

function showCounters() {
  $("counters").textContent =
    `Since loading: ${counters.requests} requests, ${counters.texelsTouched.toLocaleString("en")} texels through the CPU, ` +
    `${counters.coefficientUpdates} changes of light (${Math.max(...header.texture.bands) ** 2} × 3 coefficients each), ` +
    `${counters.contractions} contractions on the GPU, ${counters.frames} frames.`;
}

/** A bar of a round length in the file's unit. */
function showBar() {
  const { unit } = header.volume;
  const names = [[1e-10, "Å"], [1e-9, "nm"], [1e-6, "µm"], [1e-3, "mm"], [1e-2, "cm"], [1, "m"]];
  // The nearest unit with a name: bohr are shown in Å.
  const away = ([metres]) => Math.abs(Math.log(unit / metres));
  const [metres, name] = unit ? names.reduce((a, b) => (away(b) < away(a) ? b : a)) : [1, "units"];
  const height = renderer.lastRays.unitsPerPixelHeight * (unit ? unit / metres : 1);
  const perPixel = height / $("stage").clientHeight;
  const power = 10 ** Math.floor(Math.log10(perPixel * 140));
  const length = [5, 2, 1].map((f) => f * power).find((v) => v <= perPixel * 140) ?? power;
  $("barLine").style.width = `${length / perPixel}px`;
  $("barText").textContent = `${short(length)} ${name}`;
}

// --- the isovalue slider: by value, or by share of the volume ---

function isovalueFromSlider(position) {
  const { range, quantiles } = header.volume;
  const t = position / 1000;
  let value = range[0] + t * (range[1] - range[0]);
  if ($("byQuantile").checked) {
    const at = t * (quantiles.length - 1), i = Math.min(Math.floor(at), quantiles.length - 2);
    value = quantiles[i] + (at - i) * (quantiles[i + 1] - quantiles[i]);
  }
  return value;
}

function sliderFromIsovalue(value) {
  const { range, quantiles } = header.volume;
  if (!$("byQuantile").checked) return (1000 * (value - range[0])) / (range[1] - range[0] || 1);
  let i = quantiles.findIndex((q) => q > value);
  if (i < 0) return 1000;
  if (i === 0) return 0;
  i--;
  return (1000 * (i + (value - quantiles[i]) / (quantiles[i + 1] - quantiles[i] || 1))) / (quantiles.length - 1);
}

function clampIsovalue(value) {
  const [low, high] = header.volume.range;
  return Math.min(high, Math.max(low, value));
}

/** What the program says of the data. */
function showAbout() {
  const element = (tag, textContent) => Object.assign(document.createElement(tag), { textContent });
  $("about").replaceChildren(...header.about.flatMap(([term, text]) => [element("dt", term), element("dd", text)]));
}

/** How often values occur, on a logarithmic scale. */
function showHistogram() {
  const { range, quantiles } = header.volume;
  const canvas = $("histogram"), pen = canvas.getContext("2d");
  const bins = new Float64Array(73);
  const share = 1 / (quantiles.length - 1);
  const isQuantile = $("byQuantile").checked;
  for (let i = 0; i + 1 < quantiles.length; i++) {
    // The share between two quantiles, spread over the bins between them.
    const from = ((quantiles[i] - range[0]) / (range[1] - range[0] || 1)) * bins.length;
    const to = ((quantiles[i + 1] - range[0]) / (range[1] - range[0] || 1)) * bins.length;
    const first = Math.min(bins.length - 1, Math.floor(from)), last = Math.min(bins.length - 1, Math.floor(to));
    for (let b = first; b <= last; b++) {
      const part = to > from ? (Math.min(to, b + 1) - Math.max(from, b)) / (to - from) : 1 / (last - first + 1);
      bins[b] += share * Math.max(part, 0);
    }
  }
  const most = Math.max(...bins);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--line");
  bins.forEach((v, b) => {
    const height = isQuantile ? 0 : (canvas.height * Math.log1p(2000 * (v / most))) / Math.log1p(2000);
    pen.fillRect((b * canvas.width) / bins.length, canvas.height - height, canvas.width / bins.length - 1, height);
  });
}

// --- controls ---

function connectControls() {
  $("title").textContent = header.name;
  document.title = `${header.name} · isolume`;
  const { range } = header.volume;
  $("rangeLow").textContent = short(range[0]);
  $("rangeHigh").textContent = short(range[1]);
  $("isovalueNumber").min = range[0];
  $("isovalueNumber").max = range[1];
  probes.forEach((p, i) => $("environment").add(new Option(labelOf(p), i)));
  $("colour").add(new Option("grey", ""));
  Object.keys(header.colormaps).forEach((name) => $("colour").add(new Option(name, name)));
  Object.entries(VIEWS).forEach(([mode, [name]]) => $("mode").add(new Option(name, mode)));
  showAbout();
  const on = (id, event, act) => $(id).addEventListener(event, act);
  on("isovalue", "input", (e) => update({ isovalue: isovalueFromSlider(Number(e.target.value)) }));
  on("isovalueNumber", "change", (e) => {
    const value = e.target.valueAsNumber;
    if (!Number.isFinite(value)) return;
    const isInside = clampIsovalue(value) === value;
    if (isInside) update({ isovalue: value });
    else sayIfEmpty(value); // what was shown stays
  });
  on("byQuantile", "change", () => { showHistogram(); showState(); });
  on("colour", "change", (e) => update({ colour: e.target.value }));
  on("albedo", "input", (e) => update({ albedo: Number(e.target.value) }));
  on("emission", "input", (e) => update({ emission: Number(e.target.value) }));
  on("strength", "input", (e) => update({ strength: Number(e.target.value) }));
  on("environment", "change", (e) => update({ environment: Number(e.target.value) }));
  on("rotation", "input", (e) => update({ rotation: Number(e.target.value) }));
  on("exposure", "input", (e) => update({ exposure: Number(e.target.value), autoExposure: false }));
  on("autoExposure", "change", (e) => update({ autoExposure: e.target.checked }));
  on("mode", "change", (e) => update({ mode: e.target.value }));
  on("background", "change", (e) => update({ background: e.target.value }));
  on("perspective", "change", (e) => update({ perspective: e.target.checked }));
  on("open", "click", () => $("file").click());
  on("file", "change", (e) => [...e.target.files].forEach(openFile));
  on("theme", "click", () => setTheme(!document.documentElement.classList.contains("light")));
  on("save", "click", save);
  on("measure", "click", measure);
  const ofLayer = (k) => (header.scene ? `${k + 1}` : k === 0 ? "direct" : k === 1 ? "1 bounce" : `${k} bounces`);
  if (header.scene) $("layersLegend").textContent = "Reflections by the surface; by walls any number";
  toggles("layers", header.texture.bands.map((_, k) => ofLayer(k)).concat("beyond"));
  toggles("bands", header.world_from_upright.map((_, l) => `l = ${l}`));
  addEventListener("resize", () => update({}));
}

/** Strength of the environment, and a slider for each luminaire: a factor on the power that the scene gives it. */
function connectScene() {
  // A decade around what the surface sends out.
  const unit = 10 ** Math.round(Math.log10(sizeOfLight()));
  Object.assign($("emission"), { max: 4 * unit, step: unit / 100 });
  if (!header.scene) return;
  $("strengthRow").hidden = false;
  $("luminaires").hidden = luminaires().length === 0;
  luminaires().forEach(({ name }, i) => {
    const row = Object.assign(document.createElement("div"), { className: "row" });
    const label = Object.assign(document.createElement("label"), { htmlFor: `power${i}`, textContent: name, title: name });
    const slider = Object.assign(document.createElement("input"), { id: `power${i}`, type: "range", min: 0, max: 4, step: 0.05 });
    const output = Object.assign(document.createElement("output"), { id: `powerText${i}` });
    slider.addEventListener("input", () => update({ powers: state.powers.map((v, j) => (i === j ? Number(slider.value) : v)) }));
    row.append(label, slider, output);
    $("luminaires").append(row);
  });
}

/** A check box for each entry of a list of the state. */
function toggles(name, labels) {
  if (name === "layers" && labels.length === 2) labels.pop(); // one layer has no tail
  state[name] = labels.map(() => true);
  if (name === "layers" && header.texture.bands.length === 1) state.layers.push(true); // of emission alone
  labels.forEach((text, i) => {
    const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
    box.addEventListener("change", () => update({ [name]: state[name].map((v, j) => (i === j ? box.checked : v)) }));
    const label = document.createElement("label");
    label.append(box, ` ${text}`);
    $(name).append(label);
  });
}

function setTheme(isLight) {
  document.documentElement.classList.toggle("light", isLight);
  $("theme").textContent = isLight ? "Dark page" : "Light page";
  showHistogram();
  update({});
}

function save() {
  coarse = false;
  drawFrame();
  const link = Object.assign(document.createElement("a"), { href: renderer.canvas.toDataURL("image/png") });
  link.download = `${header.name}-${short(state.isovalue)}-${labelOf(probes[state.environment]).replace(/\W+/g, "-")}.png`;
  link.click();
}

function measure() {
  coarse = false;
  drawFrame();
  const found = renderer.measure(view(), 3);
  const start = performance.now();
  renderer.contract(lightForGpu());
  renderer.finish();
  found.contraction = performance.now() - start;
  $("speed").textContent =
    `${found.fetchesPerPixel.toFixed(1)} texture fetches a pixel (${found.fetchesPerCoveredPixel.toFixed(1)} on the surface), ` +
    `${(found.fetchesPerFrame / 1e6).toFixed(1)} million a frame; ${found.milliseconds.toFixed(1)} ms for ` +
    `${found.pixels.join(" × ")} pixels, median of 3; ${found.contraction.toFixed(1)} ms to change the light (${found.renderer}).`;
  return found;
}

/** Drag, wheel, keys and drops. */
function connectStage() {
  const canvas = $("canvas"), stage = $("stage");
  const pointers = new Map();
  let spread = 0;
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    pointers.set(e.pointerId, e);
  });
  const release = (e) => { pointers.delete(e.pointerId); spread = 0; };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointermove", (e) => {
    const before = pointers.get(e.pointerId);
    if (!before) return;
    const [dx, dy] = [e.clientX - before.clientX, e.clientY - before.clientY];
    pointers.set(e.pointerId, e);
    if (pointers.size === 2) {
      const [a, b] = [...pointers.values()];
      const now = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      if (spread > 0) zoomBy(now / spread);
      spread = now;
    } else if (e.shiftKey || e.ctrlKey || e.altKey) turnLight(dx * 0.5);
    else if (e.buttons & 6) {
      const half = stage.clientHeight / 2;
      update({ panX: state.panX + dx / half, panY: state.panY - dy / half });
    } else turnView(-dx * 0.4, dy * 0.4);
  });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoomBy(Math.exp(-e.deltaY * 0.0012)); }, { passive: false });
  canvas.addEventListener("keydown", (e) => {
    const step = (header.volume.range[1] - header.volume.range[0]) / 200;
    const acts = {
      ArrowLeft: () => (e.shiftKey ? turnLight(-5) : turnView(-5, 0)), ArrowRight: () => (e.shiftKey ? turnLight(5) : turnView(5, 0)),
      ArrowUp: () => turnView(0, 5), ArrowDown: () => turnView(0, -5), "+": () => zoomBy(1.1), "=": () => zoomBy(1.1), "-": () => zoomBy(1 / 1.1),
      "[": () => update({ isovalue: clampIsovalue(state.isovalue - step) }), "]": () => update({ isovalue: clampIsovalue(state.isovalue + step) }),
      Home: () => update({ ...START, rotation: rotationOfScene() }),
    };
    if (acts[e.key] && !e.metaKey) { e.preventDefault(); acts[e.key](); }
  });
  const isFile = (e) => [...(e.dataTransfer?.types ?? [])].includes("Files");
  addEventListener("dragover", (e) => { if (isFile(e)) { e.preventDefault(); $("drop").hidden = false; } });
  addEventListener("dragleave", (e) => { if (!e.relatedTarget) $("drop").hidden = true; });
  addEventListener("drop", (e) => {
    e.preventDefault();
    $("drop").hidden = true;
    [...e.dataTransfer.files].forEach(openFile);
  });
}

function rotationOfScene() {
  return (((header.scene?.rotation ?? 0) + 540) % 360) - 180;
}

function turnView(azimuth, elevation) {
  update({ azimuth: (state.azimuth + azimuth) % 360, elevation: Math.min(90, Math.max(-90, state.elevation + elevation)) });
}

function turnLight(degrees) {
  update({ rotation: ((state.rotation + degrees + 540) % 360) - 180 });
}

function zoomBy(factor) {
  update({ zoom: Math.min(40, Math.max(0.2, state.zoom * factor)) });
}

// --- a notebook around the page ---

/** What the page and a notebook both may change. */
function sharedState() {
  const { isovalue, rotation, albedo, emission, exposure, autoExposure } = state;
  const { azimuth, elevation, zoom, panX, panY, perspective } = state;
  return {
    isovalue, rotation, albedo, emission, exposure, autoExposure, colormap: state.colour, env: probes[state.environment].name,
    camera: { azimuth, elevation, zoom, panX, panY, perspective },
  };
}

/** Takes what the notebook says; an environment by its name. */
function takeState({ env, colormap, camera, ...rest }) {
  const change = { ...rest, ...camera };
  if (colormap !== undefined) change.colour = colormap;
  const environment = probes.findIndex((probe) => probe.name === env);
  if (environment >= 0) change.environment = environment;
  $("colour").value = change.colour ?? state.colour;
  update(change);
}

/** Asks now and then whether there is another version of what is shown: a finer texture, or what a saved file has become. Tells how far
 * it is, or why there will be none. */
async function watch(told = null) {
  let message;
  try {
    const answer = await (await request("watched.json")).json();
    if (answer.revision !== header.watched) {
      if (!header.draft || !renderer) return showAgain();
      await takeFiner();
    } else {
      message = answer.message;
      showProgress(answer);
    }
  } catch (error) {
    message = `the program does not answer: ${error.message}`; // it may again
    showProgress({ message });
  }
  if (message !== told) say(message ?? "");
  if (header.watched !== undefined) setTimeout(() => watch(message), WATCH);
}

/** Takes a finer texture of the same volume in the place of a draft: everything that was set on the page stays. */
async function takeFiner() {
  const finer = await loadPackage();
  const length = Math.max(...Object.values(finer.header.sections).map(([offset, bytes]) => offset + bytes));
  if (finer.payload.byteLength !== length) return; // header and payload are of two versions: the next look finds the later one
  try {
    renderer.takeTransfer(finer);
  } catch {
    return showAgain(); // too large for the GPU: the page says so when it begins
  }
  header = finer.header;
  header.probes.forEach((probe, i) => { probes[i].relativeError = probe.relative_error; });
  showAbout();
  showProgress({});
  update({ layers: state.layers });
}

/** Says that this is a draft, and how far the bake is of what comes. */
function showProgress({ progress, message }) {
  const parts = header.draft ? ["draft"] : [];
  if (header.draft && !message) parts.push("a finer texture is being baked");
  else if (progress) parts.push("what was saved is being baked");
  if (progress?.all > 0) {
    const share = progress.done / progress.all;
    const left = share > 0 ? progress.seconds * (1 / share - 1) : NaN;
    parts.push(`${Math.floor(100 * share)} %`);
    if (progress.seconds > 2 && Number.isFinite(left)) parts.push(left < 90 ? `${Math.ceil(left)} s left` : `${Math.ceil(left / 60)} min left`);
  }
  $("progress").textContent = parts.join(" · ");
  $("progress").hidden = parts.length === 0;
}

/** Loads the page anew. What was changed on it stays; the rest is what the file says now. */
function showAgain() {
  const changed = (now, before) => Object.fromEntries(Object.entries(now).flatMap(([name, value]) => {
    if (typeof value === "object") return [[name, changed(value, before[name])]];
    return value === before[name] ? [] : [[name, value]];
  }));
  if (begun) sessionStorage.setItem(location.pathname, JSON.stringify(changed(sharedState(), begun)));
  location.reload();
}

/** What was changed before the page was loaded anew. */
function takeStateBefore() {
  const before = sessionStorage.getItem(location.pathname);
  sessionStorage.removeItem(location.pathname);
  if (before !== null) takeState(JSON.parse(before));
}

function connectHost() {
  host.on("update", ({ state }) => takeState(state));
  host.on("probe", ({ name, ...image }) => addProbe(name, image));
  host.tell("ready", {});
}

async function start() {
  data = await loadPackage();
  header = data.header;
  probes = header.probes.map((p, i) => ({
    name: p.name, coefficients: Float64Array.from(p.coefficients), size: p.size, relativeError: p.relative_error, lamps: p.lamps,
    picture: Uint16Array.from(section(data, `picture.${i}`, Uint16Array)),
  }));
  renderer = new Renderer($("canvas"), data);
  data.payload = null; // it is on the GPU now
  state.isovalue = header.isovalue;
  state.albedo = Number(header.albedo.toPrecision(3));
  if (matchMedia("(prefers-color-scheme: light)").matches) document.documentElement.classList.add("light");
  state.rotation = rotationOfScene();
  state.powers = luminaires().map(() => 1);
  connectScene();
  connectControls();
  connectStage();
  setTheme(document.documentElement.classList.contains("light"));
  showSky();
  update({ isovalue: state.isovalue });
  if (host) connectHost();
  if (header.watched !== undefined) {
    begun = sharedState();
    takeStateBefore();
    showProgress({});
    watch();
  }
  // For tests and for the curious.
  window.isolume = {
    get header() { return header; },
    state, update, counters, renderer, view, measure, openFile, coefficientsInWorld, setTheme,
    /** Draws at once, at full quality. */
    draw() { coarse = false; drawFrame(); },
  };
}

start().catch((error) => {
  say(error.message);
  $("shown").textContent = "";
  host?.tell("failed", { reason: error.message });
  // The next version may do; so it is where header and payload are of two versions.
  if (header?.watched !== undefined) watch();
  throw error;
});
