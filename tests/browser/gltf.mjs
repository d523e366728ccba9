// The example page that relights a .glb, in headless Chromium, against the program's own radiance.
//
//   node tests/browser/gltf.mjs BAKED.glb RELIT.glb PROBE
//
// Both from `isolume relight --transfer --radiance` of one surface, the second under the environment PROBE (a file).

import { createServer } from "node:http";
import { existsSync, readFileSync } from "node:fs";
import { basename, join, normalize } from "node:path";
import { check, dropFile, finish, launch, out, root } from "./common.mjs";
import { readGlb } from "../../examples/relight_gltf.mjs";

const [baked, relit, probe] = process.argv.slice(2);
const kinds = { html: "text/html", mjs: "text/javascript" };
const server = createServer((request, answer) => {
  const path = join(root, normalize(request.url));
  const kind = kinds[path.split(".").pop()];
  if (!kind || !existsSync(path)) return answer.writeHead(404).end();
  answer.writeHead(200, { "Content-Type": kind }).end(readFileSync(path));
});
await new Promise((done) => server.listen(0, "127.0.0.1", done));

const browser = await launch();
const page = await browser.newPage({ viewport: { width: 900, height: 640 } });
page.on("pageerror", (error) => check(false, `no error in the page: ${error.message}`));
await page.goto(`http://127.0.0.1:${server.address().port}/examples/relight_gltf.html`);
const expected = [readGlb(new Uint8Array(readFileSync(baked))), readGlb(new Uint8Array(readFileSync(relit)))];

for (const [file, index] of [[baked, 0], [probe, 1]]) {
  const before = await page.textContent("#text");
  await dropFile(page, file);
  await page.waitForFunction((before) => document.getElementById("text").textContent !== before, before);
  await page.waitForFunction(() => window.page.radiance() !== null);
  const found = await page.evaluate(() => [...window.page.radiance()]);
  const { radiance } = expected[index];
  let square = 0, mean = 0;
  for (let i = 0; i < radiance.length; i++) [square, mean] = [square + (found[i] - radiance[i]) ** 2, mean + radiance[i] / radiance.length];
  const rms = Math.sqrt(square / radiance.length) / mean;
  // All but the tail is exact (tests/readers/three_reads.mjs measures both).
  check(found.length === radiance.length && rms < 5e-3, `${basename(file)}: ${await page.textContent("#text")}; RMS to the program's radiance ${rms.toExponential(1)} of the mean`);
  await page.screenshot({ path: join(out, `gltf-${index}.png`) });
}
await page.focus("#canvas");
const first = await page.evaluate(() => window.page.radiance()[0]);
await page.keyboard.press("Shift+ArrowRight");
check((await page.evaluate(() => window.page.radiance()[0])) !== first, "a key turns the light");
await browser.close();
server.close();
finish("the example page");
