// The same image lights an exported file from the same side as in three.js.
//
//   node tests/browser/orientation.mjs ISOLUME
//
// A sphere and a ball in a NIfTI file are lit by lat-long images with one bright pixel. three.js draws each .glb twice from
// six sides, as it is and as a white diffuse surface under the image: the mean normals, weighted by radiance, must agree.
// Files stay in target/orientation, for tests/readers/blender_reads.py.

import { execFileSync } from "node:child_process";
import { createServer } from "node:http";
import { existsSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join, normalize, resolve } from "node:path";
import { check, finish, launch, root } from "./common.mjs";

const isolume = resolve(process.argv[2]);
const folder = join(root, "target/orientation");
mkdirSync(folder, { recursive: true });
const npm = resolve(process.env.ISOLUME_NPM || join(root, "target/npm"));

/** A Radiance file, black but for the pixel at (u, v) of the image, v from the top. */
function onePixel(u, v, width = 64, height = 32) {
  const pixels = new Uint8Array(4 * width * height);
  pixels.set([128, 128, 128, 128 + 10], 4 * (Math.floor(u * width) + width * Math.floor(v * height))); // 2^9
  return Buffer.concat([Buffer.from(`#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y ${height} +X ${width}\n`), pixels]);
}

/** A ball in 40³ voxels of 2 mm as NIfTI-1, its x axis towards the patient's left, sform code 1. */
function ball(n = 40, radius = 14) {
  const header = Buffer.alloc(352), samples = Buffer.alloc(n ** 3);
  header.writeInt32LE(348, 0);
  [3, n, n, n, 1, 1, 1, 1].forEach((d, i) => header.writeInt16LE(d, 40 + 2 * i));
  header.writeInt16LE(2, 70); // unsigned bytes
  header.writeInt16LE(8, 72);
  [1, 2, 2, 2].forEach((d, i) => header.writeFloatLE(d, 76 + 4 * i));
  header.writeFloatLE(352, 108);
  header[123] = 2; // mm
  header.writeInt16LE(1, 254);
  [[-2, 0, 0, 40], [0, 2, 0, -40], [0, 0, 2, -40]].flat().forEach((a, i) => header.writeFloatLE(a, 280 + 4 * i));
  header.write("n+1\0", 344, "latin1");
  const middle = (n - 1) / 2;
  for (let i = 0; i < n ** 3; i++) {
    const [x, y, z] = [i % n, Math.floor(i / n) % n, Math.floor(i / n / n)].map((v) => v - middle);
    samples[i] = Math.min(255, Math.max(0, 128 + 8 * (radius - Math.hypot(x, y, z))));
  }
  return Buffer.concat([header, samples]);
}

const images = { centre: [0.5, 0.5], quarter: [0.75, 0.5], between: [0.6, 0.3] };
for (const [name, [u, v]] of Object.entries(images)) writeFileSync(join(folder, `${name}.hdr`), onePixel(u, v));
writeFileSync(join(folder, "ball.nii"), ball());
const surfaces = { sphere: ["sphere:40", "-0.6"], ball: [join(folder, "ball.nii"), "128"] };
const pairs = [];
for (const [name, [input, isovalue]] of Object.entries(surfaces)) {
  for (const image of Object.keys(images)) {
    const file = join(folder, `${name}-${image}.glb`);
    execFileSync(isolume, ["relight", input, "-q", "--isovalue", isovalue, "--env", join(folder, `${image}.hdr`), "--rays", "64", "--sun-split", "off",
      "--exposure=-2", "--cache", join(folder, "cache"), "-o", file]);
    pairs.push([`${name}-${image}.glb`, `${image}.hdr`]);
  }
}

const kinds = { html: "text/html", js: "text/javascript", glb: "model/gltf-binary", hdr: "application/octet-stream" };
const document = `<script type="importmap">{ "imports": {
  "three": "/npm/three/build/three.module.js", "three/addons/": "/npm/three/examples/jsm/" } }</script>
<script type="module" src="/page.js"></script>`;
const script = `
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { HDRLoader } from "three/addons/loaders/HDRLoader.js";
const SIDE = 128;
const renderer = new THREE.WebGLRenderer();
renderer.toneMapping = THREE.NoToneMapping;
const target = new THREE.WebGLRenderTarget(SIDE, SIDE, { type: THREE.FloatType, colorSpace: THREE.LinearSRGBColorSpace });
const sides = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
function draw(scene, mesh, material, camera) {
  mesh.material = material;
  renderer.setRenderTarget(target);
  renderer.setClearColor(0, 0);
  renderer.clear();
  renderer.render(scene, camera);
  const pixels = new Float32Array(4 * SIDE * SIDE);
  renderer.readRenderTargetPixels(target, 0, 0, SIDE, SIDE, pixels);
  return pixels;
}
// Over the six sides a point counts with the sum of (n·v)² = 1: every part of the surface by its area.
function meanNormal(scene, mesh, material) {
  const box = new THREE.Box3().setFromObject(mesh), centre = box.getCenter(new THREE.Vector3());
  const reach = 0.6 * box.getSize(new THREE.Vector3()).length();
  const sum = new THREE.Vector3();
  for (const side of sides) {
    const towards = new THREE.Vector3(...side);
    const camera = new THREE.OrthographicCamera(-reach, reach, reach, -reach, 0.01 * reach, 4 * reach);
    camera.up.set(...(side[1] ? [0, 0, 1] : [0, 1, 0]));
    camera.position.copy(centre).addScaledVector(towards, 2 * reach);
    camera.lookAt(centre);
    camera.updateMatrixWorld();
    const colour = draw(scene, mesh, material, camera);
    const normals = draw(scene, mesh, new THREE.MeshNormalMaterial(), camera);
    for (let i = 0; i < SIDE * SIDE; i++) {
      if (normals[4 * i + 3] < 0.5) continue;
      const n = new THREE.Vector3(...[0, 1, 2].map((c) => 2 * normals[4 * i + c] - 1)).normalize();
      n.transformDirection(camera.matrixWorld);
      sum.addScaledVector(n, Math.max(0, n.dot(towards)) * colour[4 * i + 1]);
    }
  }
  return sum.normalize().toArray();
}
window.directions = async (glb, hdr) => {
  const gltf = await new GLTFLoader().loadAsync(glb), image = await new HDRLoader().setDataType(THREE.FloatType).loadAsync(hdr);
  image.mapping = THREE.EquirectangularReflectionMapping;
  let mesh = null;
  gltf.scene.traverse((o) => { if (o.isMesh) mesh = o; });
  const scene = new THREE.Scene();
  scene.add(gltf.scene);
  scene.updateMatrixWorld(true);
  const baked = meanNormal(scene, mesh, mesh.material);
  scene.environment = new THREE.PMREMGenerator(renderer).fromEquirectangular(image).texture;
  const lit = meanNormal(scene, mesh, new THREE.MeshStandardMaterial({ color: 0xffffff, roughness: 1, metalness: 0 }));
  return [baked, lit];
};
window.ready = true;`;
const server = createServer((request, answer) => {
  const url = normalize(request.url);
  const kind = kinds[url.split(".").pop()] ?? "text/html";
  const send = (body) => answer.writeHead(200, { "Content-Type": kind }).end(body);
  if (url === "/") return send(document);
  if (url === "/page.js") return send(script);
  const path = url.startsWith("/npm/") ? join(npm, "node_modules", url.slice(5)) : join(folder, url);
  return existsSync(path) ? send(readFileSync(path)) : answer.writeHead(404).end();
});
await new Promise((done) => server.listen(0, "127.0.0.1", done));
const browser = await launch();
const page = await browser.newPage();
page.on("pageerror", (error) => check(false, `no error in the page: ${error.message}`));
await page.goto(`http://127.0.0.1:${server.address().port}/`);
await page.waitForFunction(() => window.ready);

const degrees = (a, b) => (180 / Math.PI) * Math.acos(Math.min(1, a.reduce((sum, v, i) => sum + v * b[i], 0)));
for (const [glb, hdr] of pairs) {
  const [u, v] = images[hdr.replace(".hdr", "")];
  // The middle of the pixel, from the definition: u = atan2(z, x)/2π + ½.
  const [turn, height] = [2 * Math.PI * ((Math.floor(u * 64) + 0.5) / 64 - 0.5), Math.PI * (0.5 - (Math.floor(v * 32) + 0.5) / 32)];
  const expected = [Math.cos(turn) * Math.cos(height), Math.sin(height), Math.sin(turn) * Math.cos(height)];
  const [baked, lit] = await page.evaluate(([a, b]) => window.directions(a, b), [`/${glb}`, `/${hdr}`]);
  const [apart, off] = [degrees(baked, lit), degrees(baked, expected)];
  check(apart < 2 && off < 2, `${glb}: ${apart.toFixed(2)}° from three.js, ${off.toFixed(2)}° from the definition`);
}
await browser.close();
server.close();
finish("the orientation in three.js");
