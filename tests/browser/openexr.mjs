// Decodes OpenEXR files with the page's decoder and compares them with pixels of the program.
//
//   node tests/browser/openexr.mjs FOLDER
//
// Beside each X.exr lies X.f32: width × height × 3 floats, little-endian; or X.refused: what the message must contain. Files of lossy
// compressions, dwa-….exr, may differ by the rounding to half floats, which the curve that colours are stored in makes up to 1 %.

import { existsSync, readFileSync, readdirSync } from "node:fs";
import { join } from "node:path";
import { decodeOpenExr } from "../../src/view/page/openexr.mjs";

const folder = process.argv[2];
let failures = 0, count = 0;
const fail = (name, text) => {
  failures++;
  console.log(`FAIL ${name}: ${text}`);
};
for (const name of readdirSync(folder).filter((n) => n.endsWith(".exr")).sort()) {
  count++;
  const path = join(folder, name.slice(0, -4));
  const bytes = new Uint8Array(readFileSync(`${path}.exr`));
  const decoded = await decodeOpenExr(bytes).catch((error) => error);
  if (existsSync(`${path}.refused`)) {
    const wanted = readFileSync(`${path}.refused`, "utf8");
    if (!(decoded instanceof Error) || !decoded.message.includes(wanted)) fail(name, `not refused with ${wanted}: ${decoded}`);
    continue;
  }
  if (decoded instanceof Error) {
    fail(name, decoded.message);
    continue;
  }
  const file = readFileSync(`${path}.f32`);
  const pixels = new Float32Array(file.buffer.slice(file.byteOffset, file.byteOffset + file.length));
  const isLossy = name.startsWith("dwa-");
  const differs = (v, i) => (isLossy ? !(Math.abs(v - decoded.rgb[i]) <= 0.01 * Math.abs(v) + 1e-4) : v !== decoded.rgb[i]);
  const at = decoded.rgb.length === pixels.length ? pixels.findIndex(differs) : -2;
  const rounded = pixels.reduce((sum, v, i) => sum + (v !== decoded.rgb[i] ? 1 : 0), 0) / pixels.length;
  if (rounded > (isLossy ? 0.05 : 0)) fail(name, `${(100 * rounded).toFixed(1)} % of the values differ`);
  if (at !== -1) fail(name, `value ${at}: ${decoded.rgb[at]}, not ${pixels[at]}`);
  // Cut and damaged files are refused or decoded, and end.
  for (let i = 1; i < 24; i++) {
    const damaged = bytes.slice(0, i % 2 ? bytes.length : (bytes.length * i) >> 5);
    for (let k = 0; k < 4; k++) damaged[(i * 7919 + k * 104729) % damaged.length] ^= 1 << ((i + k) & 7);
    await decodeOpenExr(damaged).catch((error) => error);
  }
}
console.log(`${count} files, ${failures} failures`);
process.exit(failures > 0 || count === 0 ? 1 : 0);
