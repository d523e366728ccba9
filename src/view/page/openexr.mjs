// OpenEXR, the part that a browser can decode by itself: one part, scan lines, channels R, G, B (or Y) of 16 or 32-bit
// floats; uncompressed, RLE, ZIP (zlib), PIZ, DWAA or DWAB. Everything else is left to the program; see the message.

import { inflate, numberFromHalf, unfilter, unpackHuffman, unpackRuns } from "./openexr_codes.mjs";
import { unpackDwa } from "./openexr_dwa.mjs";

const COMPRESSIONS = ["NONE", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"];
const MOST_CHANNELS = 1024;
const ROWS_OF_A_BLOCK = { NONE: 1, RLE: 1, ZIPS: 1, ZIP: 16, PIZ: 32, DWAA: 32, DWAB: 256 };

/** Decodes the bytes of an .exr file: { width, height, rgb }. Rejects what it cannot read, with the reason. */
export async function decodeOpenExr(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 8 || view.getUint32(0, true) !== 20000630) throw new Error("not an OpenEXR file");
  const flags = view.getUint32(4, true) >> 8;
  if (flags & ~4) throw new Error("tiled, deep and multi-part files are not read in the page");
  let at = 8;
  const text = () => {
    let out = "";
    while (bytes[at] !== 0) {
      if (at >= bytes.length) throw new Error("the header has no end");
      out += String.fromCharCode(bytes[at++]);
    }
    at++;
    return out;
  };
  const attributes = {};
  while (bytes[at] !== 0) {
    const name = text();
    text(); // type
    const size = view.getUint32(at, true);
    attributes[name] = at + 4;
    at += 4 + size;
  }
  at++;
  const missing = ["channels", "compression", "dataWindow"].find((name) => attributes[name] === undefined);
  if (missing) throw new Error(`the header has no ${missing}`);
  const compression = COMPRESSIONS[bytes[attributes.compression]];
  if (!(compression in ROWS_OF_A_BLOCK)) {
    throw new Error(`${compression ?? "unknown"} compression is not read in the page; convert it: isolume env convert X.exr -o X.hdr`);
  }
  const [left, top, right, bottom] = [0, 4, 8, 12].map((o) => view.getInt32(attributes.dataWindow + o, true));
  const [width, height] = [right - left + 1, bottom - top + 1];
  if (!(width > 0 && height > 0 && width * height <= 1 << 26)) throw new Error(`${width} × ${height} pixels`);
  const channels = readChannels(bytes, view, attributes.channels);
  const rowBytes = width * channels.reduce((sum, c) => sum + c.bytes, 0);
  const rows = ROWS_OF_A_BLOCK[compression];
  if (at + 8 * Math.ceil(height / rows) > bytes.length) throw new Error("the file ends in the table of its blocks");
  const rgb = new Float32Array(3 * width * height);
  for (let block = 0; block < Math.ceil(height / rows); block++) {
    const start = Number(view.getBigUint64(at + 8 * block, true));
    const first = view.getInt32(start, true) - top;
    if (first !== block * rows) throw new Error(`block ${block} says that it begins at row ${first}`);
    const size = view.getUint32(start + 4, true);
    const count = Math.min(rows, height - first);
    let data = bytes.subarray(start + 8, start + 8 + size);
    if (compression !== "NONE" && size < rowBytes * count) {
      if (compression === "PIZ") data = unpackPiz(data, width, count, channels);
      else if (compression.startsWith("DWA")) data = await unpackDwa(data, width, count, channels);
      else data = unfilter(compression === "RLE" ? unpackRuns(data, rowBytes * count) : await inflate(data, rowBytes * count));
    }
    if (data.length < rowBytes * count) throw new Error("the file ends in the middle of a block");
    const pixels = new DataView(data.buffer, data.byteOffset, data.byteLength);
    for (let j = 0; j < count; j++) {
      let offset = rowBytes * j;
      for (const { targets, bytes: size } of channels) {
        for (let x = 0; x < width; x++, offset += size) {
          if (targets.length === 0) continue;
          const value = size === 2 ? numberFromHalf(pixels.getUint16(offset, true)) : pixels.getFloat32(offset, true);
          for (const c of targets) rgb[3 * (x + width * (first + j)) + c] = value;
        }
      }
    }
  }
  return { width, height, rgb };
}

function readChannels(bytes, view, at) {
  const channels = [];
  while (bytes[at] !== 0) {
    let name = "";
    while (bytes[at] !== 0 && at < bytes.length) name += String.fromCharCode(bytes[at++]);
    if (at >= bytes.length) throw new Error("the list of channels has no end");
    at++;
    const type = view.getUint32(at, true); // 0 integer, 1 half, 2 float
    if (type > 2) throw new Error(`channel ${name} holds numbers of the unknown type ${type}`);
    if (channels.length === MOST_CHANNELS) throw new Error(`more than ${MOST_CHANNELS} channels`);
    if (view.getUint32(at + 8, true) !== 1 || view.getUint32(at + 12, true) !== 1) {
      throw new Error("subsampled channels are not read");
    }
    const isLinear = bytes[at + 4] !== 0;
    at += 16;
    const targets = { R: [0], G: [1], B: [2], Y: [0, 1, 2] }[name] ?? [];
    if (targets.length > 0 && type === 0) throw new Error(`channel ${name} holds integers`);
    channels.push({ name, type, isLinear, targets, bytes: type === 1 ? 2 : 4 });
  }
  if (!channels.some((c) => c.targets.length > 0)) throw new Error("no channel R, G, B or Y");
  return channels;
}

// PIZ (OpenEXR, "Technical Introduction": a Haar wavelet of 16-bit numbers under a Huffman code): the numbers that occur are
// renumbered without gaps, transformed, and coded; of a float each half by itself.

function unpackPiz(bytes, width, rows, channels) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const [first, last] = [view.getUint16(0, true), view.getUint16(2, true)];
  let at = 4;
  const occurs = new Uint8Array(8192);
  if (first <= last) {
    if (last >= 8192 || at + last - first + 1 > bytes.length) throw new Error("damaged PIZ: its table of numbers");
    occurs.set(bytes.subarray(at, at + last - first + 1), first);
    at += last - first + 1;
  }
  const numbers = new Uint16Array(65536);
  let most = -1;
  for (let i = 0; i < 65536; i++) if (i === 0 || (occurs[i >> 3] >> (i & 7)) & 1) numbers[++most] = i;
  const words = channels.map((c) => c.bytes / 2);
  const length = view.getInt32(at, true);
  if (length < 20 || at + 4 + length > bytes.length) throw new Error("damaged PIZ: its length");
  const total = width * rows * words.reduce((sum, n) => sum + n, 0);
  const values = unpackHuffman(bytes.subarray(at + 4, at + 4 + length), total);
  let start = 0;
  const starts = words.map((n) => {
    for (let j = 0; j < n; j++) inverseWavelet(values, start + j, width, n, rows, width * n, most < 1 << 14);
    const own = start;
    start += width * rows * n;
    return own;
  });
  for (let i = 0; i < total; i++) values[i] = numbers[values[i]];
  // Channel by channel; wanted is row by row.
  const out = new Uint8Array(2 * total);
  const to = new DataView(out.buffer);
  for (let y = 0, place = 0; y < rows; y++) {
    words.forEach((n, c) => {
      const from = starts[c] + width * n * y;
      for (let i = 0; i < width * n; i++, place += 2) to.setUint16(place, values[from + i], true);
    });
  }
  return out;
}

/** Undoes the wavelet of a channel in place: from the coarsest level, squares of 2 × 2 means and differences. */
function inverseWavelet(values, start, nx, ox, ny, oy, isShort) {
  let a = 0, b = 0;
  // A mean and a difference as two numbers; of few numbers with signs, else modulo 2¹⁶.
  const split = (mean, difference) => {
    if (isShort) {
      const d = (difference << 16) >> 16;
      const whole = ((mean << 16) >> 16) + (d & 1) + (d >> 1);
      (a = whole & 65535), (b = (whole - d) & 65535);
    } else {
      b = (mean - (difference >> 1)) & 65535;
      a = (difference + b - 32768) & 65535;
    }
  };
  let p = 1;
  while (p <= Math.min(nx, ny)) p *= 2;
  for (let p2 = p >> 1, p1 = p >> 2; p1 >= 1; p2 = p1, p1 >>= 1) {
    const [ox1, oy1] = [ox * p1, oy * p1];
    let y = 0;
    for (; y <= ny - p2; y += p2) {
      let x = 0;
      for (; x <= nx - p2; x += p2) {
        const i = start + ox * x + oy * y;
        split(values[i], values[i + oy1]);
        const [i00, i10] = [a, b];
        split(values[i + ox1], values[i + ox1 + oy1]);
        const [i01, i11] = [a, b];
        split(i00, i01);
        (values[i] = a), (values[i + ox1] = b);
        split(i10, i11);
        (values[i + oy1] = a), (values[i + ox1 + oy1] = b);
      }
      if (nx & p1) {
        const i = start + ox * x + oy * y;
        split(values[i], values[i + oy1]);
        (values[i] = a), (values[i + oy1] = b);
      }
    }
    if (ny & p1) {
      for (let x = 0; x <= nx - p2; x += p2) {
        const i = start + ox * x + oy * y;
        split(values[i], values[i + ox1]);
        (values[i] = a), (values[i + ox1] = b);
      }
    }
  }
}
