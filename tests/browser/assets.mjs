// Files for the web and with a lightmap, in three.js in headless Chromium, against the plain file of the same surface.
//
//   node tests/browser/assets.mjs PLAIN.glb WEB.glb OTHER.glb …
//
// WEB is of `isolume relight --for web`: its vertices are compared with those of PLAIN, one by one. Of all of them pictures
// are compared from four sides.

import { createServer } from "node:http";
import { existsSync, readFileSync, statSync, writeFileSync } from "node:fs";
import { basename, join, normalize, resolve } from "node:path";
import { check, finish, launch, out, root } from "./common.mjs";

const files = process.argv.slice(2);
const npm = resolve(process.env.ISOLUME_NPM || join(root, "target/npm"));
const page_text = `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<canvas id="canvas" width="512" height="512"></canvas>
<script type="importmap">{ "imports": { "three": "/three/build/three.module.js", "three/addons/": "/three/examples/jsm/" } }</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
const canvas = document.getElementById("canvas");
const renderer = new THREE.WebGLRenderer({ canvas, preserveDrawingBuffer: true });
const camera = new THREE.OrthographicCamera();
let box = null;

async function load(name) {
  const gltf = await loader.loadAsync("/file/" + name);
  gltf.scene.updateMatrixWorld(true);
  let mesh = null;
  gltf.scene.traverse((o) => { if (o.isMesh) mesh = o; });
  return { gltf, mesh };
}

/** Vertices in the world of the file, with their colours. */
function vertices({ mesh }) {
  const { position, color } = mesh.geometry.attributes, place = new THREE.Vector3(), all = [];
  for (let v = 0; v < position.count; v++) {
    place.fromBufferAttribute(position, v).applyMatrix4(mesh.matrixWorld);
    all.push([place.x, place.y, place.z, ...(color ? [color.getX(v), color.getY(v), color.getZ(v)] : [])]);
  }
  return all;
}

/** Bytes of the picture from a side; the first file decides what is in view. */
async function picture(name, azimuth) {
  const { gltf } = await load(name);
  const scene = new THREE.Scene();
  scene.add(gltf.scene);
  scene.background = new THREE.Color(0, 1, 0);
  box ??= new THREE.Box3().setFromObject(gltf.scene).getBoundingSphere(new THREE.Sphere());
  const r = box.radius;
  Object.assign(camera, { left: -r, right: r, bottom: -r, top: r, near: 0.1 * r, far: 10 * r });
  camera.position.set(Math.sin(azimuth), 0.4, Math.cos(azimuth)).normalize().multiplyScalar(4 * r).add(box.center);
  camera.lookAt(box.center);
  camera.updateProjectionMatrix();
  renderer.render(scene, camera);
  const gl = renderer.getContext(), pixels = new Uint8Array(4 * canvas.width * canvas.height);
  gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return pixels;
}

window.test = {
  async info(name) {
    const { gltf, mesh } = await load(name);
    const { map, type, vertexColors } = mesh.material;
    return { count: mesh.geometry.attributes.position.count, type, vertexColors, map: map && map.image.width, extras: gltf.parser.json.nodes[0].extras };
  },
  /** Largest distance of vertices of a file to the nearest of another, and of their colours. */
  async vertices(plain, web, reach) {
    const cells = new Map(), key = (p) => p.map((x) => Math.round(x / (4 * reach))).join();
    const expected = vertices(await load(plain)), found = vertices(await load(web));
    for (const v of expected) (cells.get(key(v.slice(0, 3))) ?? cells.set(key(v.slice(0, 3)), []).get(key(v.slice(0, 3)))).push(v);
    let far = 0, off = 0;
    for (const v of found) {
      let best = [Infinity, Infinity];
      for (let i = 0; i < 27; i++) {
        const shift = [i % 3 - 1, Math.floor(i / 3) % 3 - 1, Math.floor(i / 9) - 1];
        for (const w of cells.get(key([0, 1, 2].map((a) => v[a] + 4 * reach * shift[a]))) ?? []) {
          const pair = [Math.hypot(...[0, 1, 2].map((a) => v[a] - w[a])), Math.max(...[3, 4, 5].map((c) => Math.abs(v[c] - w[c])))];
          // Vertices may lie closer together than the rounding: of those in reach that of the nearest colour.
          if (pair[0] <= reach ? best[0] > reach || pair[1] < best[1] : pair[0] < best[0]) best = pair;
        }
      }
      far = Math.max(far, best[0]);
      off = Math.max(off, best[1]);
    }
    return { far, off, counts: [expected.length, found.length] };
  },
  /** How pictures of two files differ where both show the surface: means, RMS and share of pixels by more than 16 of 255, and of
   *  pixels where one alone does. */
  async pictures(plain, other, azimuth) {
    const a = await picture(plain, azimuth), b = await picture(other, azimuth);
    const shown = canvas.toDataURL();
    const isBackground = (p, i) => p[i] === 0 && p[i + 1] === 255 && p[i + 2] === 0;
    const sums = [0, 0];
    let both = 0, one = 0, square = 0, wide = 0;
    for (let i = 0; i < a.length; i += 4) {
      const seen = [a, b].map((p) => !isBackground(p, i));
      if (seen[0] !== seen[1]) one++;
      if (!(seen[0] && seen[1])) continue;
      both++;
      let most = 0;
      for (let c = 0; c < 3; c++) {
        sums[0] += a[i + c];
        sums[1] += b[i + c];
        square += (a[i + c] - b[i + c]) ** 2;
        most = Math.max(most, Math.abs(a[i + c] - b[i + c]));
      }
      if (most > 16) wide++;
    }
    return { both, one: one / both, means: sums.map((s) => s / (3 * both)), rms: Math.sqrt(square / (3 * both)), wide: wide / both, shown };
  },
};
window.ready = true;
</script>`;

const kinds = { js: "text/javascript", wasm: "application/wasm", glb: "model/gltf-binary" };
const server = createServer((request, answer) => {
  const url = decodeURIComponent(request.url);
  if (url === "/") return answer.writeHead(200, { "Content-Type": "text/html" }).end(page_text);
  const number = url.match(/^\/file\/(\d+)$/);
  const path = number ? files[number[1]] : url.startsWith("/three/") ? join(npm, "node_modules", normalize(url)) : null;
  if (!path || !existsSync(path)) return answer.writeHead(404).end();
  answer.writeHead(200, { "Content-Type": kinds[path.split(".").pop()] ?? "application/octet-stream" }).end(readFileSync(path));
});
await new Promise((done) => server.listen(0, "127.0.0.1", done));

const browser = await launch();
const page = await browser.newPage();
page.on("pageerror", (error) => check(false, `no error in the page: ${error.message}`));
page.on("console", (message) => message.type() === "error" && check(false, `no error on the console: ${message.text()}`));
await page.goto(`http://127.0.0.1:${server.address().port}/`);
await page.waitForFunction(() => window.ready);

const [plain, web] = files.map((file) => statSync(file).size);
check(web <= 0.25 * plain, `${basename(files[1])}: ${web} bytes of ${plain}, ${(100 * web / plain).toFixed(1)} %`);
const info = await page.evaluate(() => window.test.info("1"));
const reach = info.extras.positions.largest_error * info.extras.scale;
const same = await page.evaluate((reach) => window.test.vertices("0", "1", reach), 1.01 * reach);
check(same.counts[0] === same.counts[1] && same.far <= 1.01 * reach && same.off <= 1 / 65535,
  `its ${same.counts[1]} vertices are those of the plain file: at most ${same.far.toExponential(1)} m off, stated ${reach.toExponential(1)}, colours ${same.off.toExponential(1)}`);

for (const [number, file] of files.entries()) {
  const { count, type, vertexColors, map } = await page.evaluate((n) => window.test.info(String(n)), number);
  check(type === "MeshBasicMaterial" && vertexColors === !map, `${basename(file)}: ${count} vertices, ${type}, ${map ? `a picture of ${map} texels` : "colours at the vertices"}`);
  for (let side = 0; number > 0 && side < 4; side++) {
    const { both, one, means, rms, wide, shown } = await page.evaluate(([n, azimuth]) => window.test.pictures("0", String(n), azimuth), [number, 0.4 + side * Math.PI / 2]);
    writeFileSync(join(out, `assets-${number}-${side}.png`), Buffer.from(shown.split(",")[1], "base64"));
    const off = Math.abs(means[1] / means[0] - 1);
    check(both > 20000 && off < 0.01 && one < 0.02, `  side ${side}: mean ${means[1].toFixed(2)} of 255 where the plain file has ${means[0].toFixed(2)} (${(100 * off).toFixed(2)} %), RMS ${rms.toFixed(2)}, ${(100 * wide).toFixed(2)} % by more than 16, outline ${(100 * one).toFixed(2)} %`);
  }
}
await browser.close();
server.close();
finish("what is for the web and for engines");
