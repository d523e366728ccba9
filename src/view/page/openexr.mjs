// OpenEXR, the part that a browser can decode by itself: one part, scan lines, channels R, G, B (or Y) of 16 or 32-bit
// floats, uncompressed or ZIP (zlib). Everything else is left to the program; see the message.

const COMPRESSIONS = ["NONE", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"];
const ROWS_OF_A_BLOCK = { NONE: 1, ZIPS: 1, ZIP: 16 };

/** A half float as a number. */
export function numberFromHalf(bits) {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31, mantissa = bits & 1023;
  if (exponent === 0) return sign * mantissa * 2 ** -24;
  if (exponent === 31) return mantissa ? NaN : sign * Infinity;
  return sign * (1024 + mantissa) * 2 ** (exponent - 25);
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

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
  const compression = COMPRESSIONS[bytes[attributes.compression]];
  if (!(compression in ROWS_OF_A_BLOCK)) {
    throw new Error(`${compression ?? "unknown"} compression is not read in the page; save as ZIP, or as .hdr`);
  }
  const [left, top, right, bottom] = [0, 4, 8, 12].map((o) => view.getInt32(attributes.dataWindow + o, true));
  const [width, height] = [right - left + 1, bottom - top + 1];
  if (!(width > 0 && height > 0 && width * height <= 1 << 26)) throw new Error(`${width} × ${height} pixels`);
  const channels = readChannels(bytes, view, attributes.channels);
  const rowBytes = width * channels.reduce((sum, c) => sum + c.bytes, 0);
  const rows = ROWS_OF_A_BLOCK[compression];
  const rgb = new Float32Array(3 * width * height);
  for (let block = 0; block < Math.ceil(height / rows); block++) {
    const start = Number(view.getBigUint64(at + 8 * block, true));
    const first = view.getInt32(start, true) - top;
    const size = view.getUint32(start + 4, true);
    const count = Math.min(rows, height - first);
    let data = bytes.subarray(start + 8, start + 8 + size);
    if (compression !== "NONE" && size < rowBytes * count) data = unfilter(await inflate(data));
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
    while (bytes[at] !== 0) name += String.fromCharCode(bytes[at++]);
    at++;
    const type = view.getUint32(at, true); // 0 integer, 1 half, 2 float
    if (view.getUint32(at + 8, true) !== 1 || view.getUint32(at + 12, true) !== 1) {
      throw new Error("subsampled channels are not read");
    }
    at += 16;
    const targets = { R: [0], G: [1], B: [2], Y: [0, 1, 2] }[name] ?? [];
    if (targets.length > 0 && type === 0) throw new Error(`channel ${name} holds integers`);
    channels.push({ targets, bytes: type === 1 ? 2 : 4 });
  }
  if (!channels.some((c) => c.targets.length > 0)) throw new Error("no channel R, G, B or Y");
  return channels;
}

/** Undoes the differences and the split into halves that OpenEXR makes before zlib. */
function unfilter(bytes) {
  for (let i = 1; i < bytes.length; i++) bytes[i] = (bytes[i - 1] + bytes[i] - 128) & 255;
  const out = new Uint8Array(bytes.length);
  const half = (bytes.length + 1) >> 1;
  for (let i = 0; i < bytes.length; i++) out[i] = bytes[i & 1 ? half + (i >> 1) : i >> 1];
  return out;
}
