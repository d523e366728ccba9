// A .glb of `isolume relight --transfer --radiance`, read by three.js and relit from its own attributes.
//
//   node tests/readers/three_reads.mjs FILE.glb
//
// three is looked for in $ISOLUME_NPM, default target/npm. Exit code 0: everything holds.

import { readFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { planeNames, readGlb, relight } from "../../examples/relight_gltf.mjs";

const root = dirname(dirname(dirname(fileURLToPath(import.meta.url))));
const npm = resolve(process.env.ISOLUME_NPM || join(root, "target/npm"));
globalThis.self ??= globalThis; // three expects a window
const { GLTFLoader } = await import(pathToFileURL(join(npm, "node_modules/three/examples/jsm/loaders/GLTFLoader.js")).href);

let failures = 0;
function check(holds, text) {
  console.log(`${holds ? "ok  " : "FAIL"} ${text}`);
  if (!holds) failures++;
}

const bytes = readFileSync(process.argv[2]);
const gltf = await new Promise((found, failed) => new GLTFLoader().parse(new Uint8Array(bytes).buffer, "", found, failed));
let mesh = null;
gltf.scene.traverse((o) => { if (o.isMesh) mesh = o; });
const { attributes } = mesh.geometry;
const extras = mesh.geometry.userData.isolume_transfer ?? mesh.userData.isolume_transfer ?? gltf.parser.json.meshes[0].extras.isolume_transfer;
const planes = planeNames(extras).map((name) => name.toLowerCase());
const names = Object.keys(attributes).filter((n) => /^_(t\d+(_[rgb])?_sh_degree_\d+_coef_\d+|g\d+_emission_[rgb]|luminaire_\d+_g\d+_[rgb])$/i.test(n));
check(names.length === planes.length, `three.js reads ${attributes.position.count} vertices with ${names.length} transfer attributes of ${planes.length}`);

const radiance = attributes._radiance.array, colour = attributes.color;
/** As it is shown: what has a negative channel moves towards the grey of its luminance. */
function shown([r, g, b]) {
  const least = Math.min(r, g, b), grey = 0.2126 * r + 0.7152 * g + 0.0722 * b;
  if (least >= 0) return [r, g, b];
  return grey > 0 ? [r, g, b].map((v) => grey + (grey / (grey - least)) * (v - grey)) : [0, 0, 0];
}
let worst = 0;
for (let v = 0; v < colour.count; v++) {
  for (let c = 0; c < 3; c++) {
    const expected = Math.min(1, Math.max(0, shown(radiance.slice(3 * v, 3 * v + 3))[c] * extras.exposure));
    worst = Math.max(worst, Math.abs([colour.getX(v), colour.getY(v), colour.getZ(v)][c] - expected));
  }
}
check(worst <= 1.01 / 65535, `its linear colours are exposed radiance, largest difference ${worst.toExponential(1)}`);
check(mesh.material.isMeshBasicMaterial === true && mesh.material.vertexColors === true, "its material shows the baked colours unlit");

// Relit from the attributes as three.js has them, under the light that the file names.
const model = readGlb(new Uint8Array(bytes));
model.planes = planes.map((name) => attributes[name].array);
const light = Float64Array.from(extras.light.coefficients_in_world.flat());
const [ours, layers] = [true, false].map((withTail) => relight(model, light, extras.albedo, withTail));
const rms = (a, b) => Math.sqrt(a.reduce((total, v, i) => total + (v - b[i]) ** 2, 0) / a.length);
const mean = radiance.reduce((total, v) => total + v, 0) / radiance.length;
const [difference, tail] = [rms(ours, radiance) / mean, rms(ours, layers) / mean];
// The layers are linear in the transfer, so that interpolated transfer gives the interpolated radiance, to the rounding
// of 32 bits. The tail is not: its ratio is a quotient of noisy numbers, and the two means differ by a part of the tail.
check(difference < tail && tail < 0.05, `relit from its attributes it has the baked radiance: RMS ${difference.toExponential(1)} of the mean, where the tail is ${tail.toExponential(1)}`);
console.log(failures === 0 ? "everything holds" : `${failures} checks failed`);
process.exit(failures === 0 ? 0 : 1);
