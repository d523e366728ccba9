// Codes that several compressions of OpenEXR share.

/** A half float as a number. */
export function numberFromHalf(bits) {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31, mantissa = bits & 1023;
  if (exponent === 0) return sign * mantissa * 2 ** -24;
  if (exponent === 31) return mantissa ? NaN : sign * Infinity;
  return sign * (1024 + mantissa) * 2 ** (exponent - 25);
}

/** A number as the nearest half float. */
export function halfFromNumber(value) {
  halfFromNumber.float[0] = value;
  const bits = halfFromNumber.bits[0];
  const sign = (bits >>> 16) & 0x8000, size = bits & 0x7fffffff;
  if (size > 0x7f800000) return sign | 0x7e00;
  if (size >= 0x47800000) return sign | 0x7c00;
  // Ties to even, as floats are rounded everywhere.
  if (size >= 0x38800000) return sign | ((size - 0x38000000 + 0xfff + ((size >> 13) & 1)) >> 13);
  const steps = Math.abs(value) * 2 ** 24, below = Math.floor(steps), rest = steps - below;
  return sign | (rest > 0.5 || (rest === 0.5 && below % 2 === 1) ? below + 1 : below);
}
halfFromNumber.float = new Float32Array(1);
halfFromNumber.bits = new Uint32Array(halfFromNumber.float.buffer);

/** Undoes zlib; what unpacks to more than `most` bytes is damaged. */
export async function inflate(bytes, most) {
  const reader = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate")).getReader();
  const parts = [];
  let length = 0;
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    length += part.value.length;
    if (length > most) {
      await reader.cancel();
      throw new Error("a block unpacks to more than it holds");
    }
    parts.push(part.value);
  }
  const out = new Uint8Array(length);
  let at = 0;
  for (const part of parts) {
    out.set(part, at);
    at += part.length;
  }
  return out;
}

/** Undoes the differences and the split into halves that OpenEXR makes before zlib. */
export function unfilter(bytes) {
  for (let i = 1; i < bytes.length; i++) bytes[i] = (bytes[i - 1] + bytes[i] - 128) & 255;
  const out = new Uint8Array(bytes.length);
  const half = (bytes.length + 1) >> 1;
  for (let i = 0; i < bytes.length; i++) out[i] = bytes[i & 1 ? half + (i >> 1) : i >> 1];
  return out;
}

/** Runs: a count below zero precedes so many bytes as they are, else one byte that stands count + 1 times. */
export function unpackRuns(bytes, length) {
  const out = new Uint8Array(length);
  let at = 0, end = 0;
  while (at < bytes.length) {
    const count = (bytes[at++] << 24) >> 24;
    const more = count < 0 ? -count : count + 1;
    if (end + more > length || at + (count < 0 ? more : 1) > bytes.length) throw new Error("a run goes beyond its block");
    if (count < 0) out.set(bytes.subarray(at, at + more), end);
    else out.fill(bytes[at], end, end + more);
    at += count < 0 ? more : 1;
    end += more;
  }
  if (end !== length) throw new Error("runs end before their block");
  return out;
}

const LONGEST_CODE = 58, LONG_RUN = 63, SHORT_RUN = 59, QUICK = 12;

/** Canonical Huffman code; the last symbol repeats the number before it as often as the 8 bits behind it say. */
export function unpackHuffman(bytes, total) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const [low, high, bitCount] = [0, 4, 12].map((o) => view.getUint32(o, true));
  if (low >= 65537 || high >= 65537) throw new Error("damaged Huffman code: its symbols");
  let at = 20, held = 0, count = 0;
  const bits = (n) => {
    while (count < n) {
      if (at >= bytes.length) throw new Error("damaged Huffman code: it ends early");
      held = ((held & 0xffff) << 8) | bytes[at++];
      count += 8;
    }
    count -= n;
    return (held >> count) & ((1 << n) - 1);
  };
  const lengths = new Uint8Array(65537);
  for (let i = low; i <= high; ) {
    const n = bits(6);
    if (n < SHORT_RUN) lengths[i++] = n;
    else i += n === LONG_RUN ? bits(8) + 6 : n - SHORT_RUN + 2;
  }
  // The longest codes have the smallest numbers.
  const counts = new Array(LONGEST_CODE + 1).fill(0);
  for (let i = low; i <= high; i++) counts[lengths[i]]++;
  const first = new Array(LONGEST_CODE + 2).fill(0);
  for (let n = LONGEST_CODE, code = 0; n > 0; n--) {
    first[n] = code;
    code = Math.floor((code + counts[n]) / 2);
  }
  const symbols = Array.from({ length: LONGEST_CODE + 1 }, () => []);
  for (let i = low; i <= high; i++) if (lengths[i] > 0) symbols[lengths[i]].push(i);
  // What the next bits begin with, where that is a short code: its symbol and length.
  const quick = new Int32Array(1 << QUICK);
  for (let n = 1; n <= QUICK; n++) {
    symbols[n].forEach((symbol, k) => {
      const from = (first[n] + k) << (QUICK - n);
      quick.fill((symbol << 6) | n, from, from + (1 << (QUICK - n)));
    });
  }
  (count = 0), (held = 0);
  const end = at * 8 + bitCount;
  if (end > bytes.length * 8) throw new Error("damaged Huffman code: it ends early");
  let place = at * 8;
  const peek = () => {
    const i = place >> 3;
    const three = ((bytes[i] ?? 0) << 16) | ((bytes[i + 1] ?? 0) << 8) | (bytes[i + 2] ?? 0);
    return (three >> (24 - (place & 7) - QUICK)) & ((1 << QUICK) - 1);
  };
  const out = new Uint16Array(total);
  let filled = 0;
  while (place < end) {
    const known = quick[peek()];
    let symbol = known >> 6;
    if (known > 0) {
      place += known & 63;
    } else {
      let code = 0, n = 0;
      do {
        if (++n > LONGEST_CODE || place >= end) throw new Error("damaged Huffman code: no such code");
        code = 2 * code + ((bytes[place >> 3] >> (7 - (place & 7))) & 1);
        place++;
      } while (!(code >= first[n] && code - first[n] < symbols[n].length));
      symbol = symbols[n][code - first[n]];
    }
    if (symbol !== high) {
      if (filled >= total) throw new Error("damaged Huffman code: too many numbers");
      out[filled++] = symbol;
      continue;
    }
    const i = place >> 3;
    const repeat = ((((bytes[i] ?? 0) << 8) | (bytes[i + 1] ?? 0)) >> (8 - (place & 7))) & 255;
    place += 8;
    if (filled === 0 || filled + repeat > total) throw new Error("damaged Huffman code: a run goes beyond its block");
    out.fill(out[filled - 1], filled, filled + repeat);
    filled += repeat;
  }
  if (filled !== total) throw new Error("damaged Huffman code: too few numbers");
  return out;
}
