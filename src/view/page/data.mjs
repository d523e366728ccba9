// The data of the page, from beside it, from inside it or from the notebook around it, and the counters that show what the page does with them.

import { host } from "./host.mjs";

/**
 * What the page did since it was loaded. After `loadedAt` the first two must not grow by relighting: no request is
 * made, and no texel passes through JavaScript. Only coefficients do.
 */
export const counters = { requests: 0, texelsTouched: 0, coefficientUpdates: 0, contractions: 0, frames: 0 };

/** The only place that asks the server for anything. */
export async function request(address, options) {
  counters.requests++;
  const answer = await fetch(address, options);
  if (!answer.ok) throw new Error((await answer.text()).trim() || `${address}: ${answer.status}`);
  return answer;
}

/** Whether the page carries its data. */
export function isSelfContained() {
  return document.getElementById("payload") !== null;
}

/** Header and payload. */
export async function loadPackage() {
  if (host) return host.ask("package");
  if (!isSelfContained()) {
    const header = await (await request("header.json")).json();
    return { header, payload: await (await request("payload.bin")).arrayBuffer() };
  }
  const header = JSON.parse(document.getElementById("header").textContent);
  const element = document.getElementById("payload");
  const deflated = bytesFromBase64(element.textContent.trim());
  element.textContent = ""; // many megabytes that nobody needs any more
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  return { header, payload: await new Response(stream).arrayBuffer() };
}

function bytesFromBase64(text) {
  const values = new Uint8Array(128);
  const digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (let i = 0; i < 64; i++) values[digits.charCodeAt(i)] = i;
  const length = (text.length / 4) * 3 - (text.endsWith("==") ? 2 : text.endsWith("=") ? 1 : 0);
  const bytes = new Uint8Array(length);
  for (let i = 0, at = 0; i < text.length; i += 4) {
    const [a, b, c, d] = [0, 1, 2, 3].map((k) => values[text.charCodeAt(i + k)]);
    bytes[at++] = (a << 2) | (b >> 4);
    if (at < length) bytes[at++] = ((b & 15) << 4) | (c >> 2);
    if (at < length) bytes[at++] = ((c & 3) << 6) | d;
  }
  return bytes;
}

/** A section of the payload as an array of the given type. */
export function section(data, name, Type) {
  const [offset, bytes] = data.header.sections[name];
  return new Type(data.payload, offset, bytes / Type.BYTES_PER_ELEMENT);
}

/** For each texel of the lattice 1 + its number among the valid ones, or 0. */
export function texelNumbers(data) {
  const [mx, my, mz] = data.header.texture.texels;
  const bits = section(data, "valid", Uint8Array);
  const numbers = new Uint32Array(mx * my * mz);
  let next = 0;
  for (let i = 0; i < numbers.length; i++) if ((bits[i >> 3] >> (i & 7)) & 1) numbers[i] = ++next;
  counters.texelsTouched += numbers.length;
  return numbers;
}

/** Four planes of numbers of a section side by side, for one layer of a GPU's texture of `size` texels. */
export function interleave(planes, valid, group, size) {
  const out = new planes.constructor(4 * size);
  const count = planes.length / valid;
  for (let c = 0; c < 4 && 4 * group + c < count; c++) {
    const plane = planes.subarray((4 * group + c) * valid, (4 * group + c + 1) * valid);
    for (let i = 0; i < valid; i++) out[4 * i + c] = plane[i];
  }
  counters.texelsTouched += size;
  return out;
}

/** The relative standard errors on the whole lattice, 0 where there is none. */
export function errorTexture(data, numbers) {
  const errors = section(data, "error", Uint8Array);
  return Uint8Array.from(numbers, (n) => (n > 0 ? errors[n - 1] : 0));
}
