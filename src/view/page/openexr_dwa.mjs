// DWAA and DWAB, the lossy compressions of OpenEXR: colours as cosines of squares of 8 × 8 pixels, in a curve near that of eyes and as
// luminance and two differences; alpha as runs; other channels as they are. The layout is that of OpenEXR's ImfDwaCompressor; the
// order of numbers in a square is that of JPEG.

import { halfFromNumber, inflate, numberFromHalf, unfilter, unpackHuffman, unpackRuns } from "./openexr_codes.mjs";

const HEADER = 88, AS_IT_IS = 0, COSINES = 1, RUNS = 2;

/** For each half in the curve of the cosines that of linear light: a power up to 1, an exponential beyond. */
const linearOfHalf = () => (linearOfHalf.table ??= Uint16Array.from({ length: 65536 }, (_, bits) => {
  const value = numberFromHalf(bits), size = Math.abs(value);
  if (!Number.isFinite(value)) return 0;
  return halfFromNumber(Math.sign(value) * (size <= 1 ? size ** 2.2 : Math.exp(2.2 * (size - 1))));
}));

/** Where the numbers of a square stand in its rows: along diagonals, to and fro. */
const DIAGONALS = Array.from({ length: 64 }, (_, i) => i).sort((a, b) => {
  const [i, j] = [a, b].map((k) => [(k >> 3) + (k & 7), k >> 3]);
  return i[0] - j[0] || (i[0] % 2 === 1 ? i[1] - j[1] : j[1] - i[1]);
});

/** Row u has the cosine of u half turns along eight pixels; the rows are orthonormal. */
const WAVES = Array.from({ length: 64 }, (_, i) => (i < 8 ? Math.SQRT1_2 : 1) * 0.5 * Math.cos(((2 * (i & 7) + 1) * (i >> 3) * Math.PI) / 16));

/** Cosines of a square to its pixels, in place. */
function inverseCosines(square, between) {
  for (let v = 0; v < 8; v++) {
    for (let x = 0; x < 8; x++) {
      let sum = 0;
      for (let u = 0; u < 8; u++) sum += square[8 * v + u] * WAVES[8 * u + x];
      between[8 * v + x] = sum;
    }
  }
  for (let y = 0; y < 8; y++) {
    for (let x = 0; x < 8; x++) {
      let sum = 0;
      for (let v = 0; v < 8; v++) sum += between[8 * v + x] * WAVES[8 * v + y];
      square[8 * y + x] = sum;
    }
  }
}

/** How each channel is stored: { scheme, set }, set 0, 1 or 2 of luminance and differences, or -1; by the rules of the block. */
function classify(bytes, view, channels) {
  if (bytes.length < HEADER + 2) throw new Error("damaged DWA: its rules");
  const end = HEADER + view.getUint16(HEADER, true);
  if (end < HEADER + 2 || end > bytes.length) throw new Error("damaged DWA: its rules");
  const rules = [];
  for (let at = HEADER + 2; at < end; ) {
    let name = "";
    while (at < end && bytes[at] !== 0) name += String.fromCharCode(bytes[at++]);
    if (at + 3 > end) throw new Error("damaged DWA: its rules");
    const value = bytes[at + 1], type = bytes[at + 2];
    const anyCase = (value & 1) === 1;
    rules.push({ name: anyCase ? name.toLowerCase() : name, type, set: (value >> 4) - 1, scheme: (value >> 2) & 3, anyCase });
    at += 3;
  }
  const found = channels.map(({ name, type }) => {
    const suffix = name.slice(name.lastIndexOf(".") + 1), lower = suffix.toLowerCase();
    const fits = (rule) => rule.name === (rule.anyCase ? lower : suffix) && rule.type === type;
    return rules.find(fits) ?? { scheme: AS_IT_IS, set: -1 };
  });
  if (found.some(({ scheme, set }) => scheme > RUNS || set > 2)) throw new Error("damaged DWA: its rules");
  return { found, end };
}

/** Undoes DWAA or DWAB of a block: the bytes of its rows, channel by channel. */
export async function unpackDwa(bytes, width, rows, channels) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < HEADER) throw new Error("damaged DWA: its sizes");
  const [version, plainSize, plainPacked, acPacked, dcPacked, runsPacked, runsSize, rawSize, acCount, dcCount, acCode] =
    Array.from({ length: 11 }, (_, i) => Number(view.getBigUint64(8 * i, true)));
  if (version > 2) throw new Error(`DWA compression of version ${version} is not known`);
  if (version < 2) throw new Error("DWA compression of version 1 is not read in the page; convert it: isolume env convert X.exr -o X.hdr");
  const { found, end } = classify(bytes, view, channels);
  const pixels = width * rows, across = Math.ceil(width / 8), down = Math.ceil(rows / 8);
  const sizeOf = (scheme) => channels.reduce((sum, c, i) => sum + (found[i].scheme === scheme ? c.bytes * pixels : 0), 0);
  const squares = across * down * found.filter((f) => f.scheme === COSINES).length;
  if (plainSize !== sizeOf(AS_IT_IS) || rawSize !== sizeOf(RUNS) || dcCount !== squares || acCount > 64 * squares || acCode > 1 || runsSize > 2 * rawSize) {
    throw new Error("damaged DWA: its sizes");
  }
  let at = end;
  const part = (size) => {
    if (at + size > bytes.length) throw new Error("damaged DWA: it ends early");
    return bytes.subarray(at, (at += size));
  };
  const [plainPart, acPart, dcPart, runsPart] = [plainPacked, acPacked, dcPacked, runsPacked].map(part);
  const whole = (data, size) => {
    if (data.length !== size) throw new Error("damaged DWA: a part has another size");
    return data;
  };
  const plain = plainSize > 0 ? whole(await inflate(plainPart, plainSize), plainSize) : plainPart;
  const halves = (data) => {
    const from = new DataView(data.buffer, data.byteOffset, data.byteLength);
    return Uint16Array.from({ length: data.length >> 1 }, (_, i) => from.getUint16(2 * i, true));
  };
  let ac = new Uint16Array(0);
  if (acCount > 0) ac = acCode === 0 ? unpackHuffman(acPart, acCount) : halves(whole(await inflate(acPart, 2 * acCount), 2 * acCount));
  const dc = dcCount > 0 ? halves(whole(unfilter(await inflate(dcPart, 2 * dcCount)), 2 * dcCount)) : ac;
  const raw = rawSize > 0 ? whole(unpackRuns(whole(await inflate(runsPart, runsSize), runsSize), rawSize), rawSize) : runsPart;

  // Three of one prefix, in the order of their sets, are luminance and differences; then the others, in the order of the file.
  const prefixes = new Map();
  channels.forEach(({ name }, i) => {
    if (found[i].scheme !== COSINES || found[i].set < 0) return;
    const prefix = name.slice(0, name.lastIndexOf(".") + 1);
    prefixes.set(prefix, (prefixes.get(prefix) ?? []).concat(i));
  });
  const groups = [...prefixes.keys()].sort().map((prefix) => [0, 1, 2].map((set) => prefixes.get(prefix).find((i) => found[i].set === set)));
  const triples = groups.filter((group) => group.every((i) => i !== undefined));
  const inTriples = new Set(triples.flat());
  const singles = channels.map((_, i) => i).filter((i) => found[i].scheme === COSINES && !inTriples.has(i)).map((i) => [i]);

  const rowBytes = width * channels.reduce((sum, c) => sum + c.bytes, 0);
  const out = new Uint8Array(rowBytes * rows), to = new DataView(out.buffer);
  let start = 0;
  const starts = channels.map((c) => [start, (start += width * c.bytes)][0]);
  const next = { ac: 0, dc: 0 };
  for (const group of [...triples, ...singles]) {
    unpackSquares(group.map((i) => ({ ...channels[i], start: starts[i] })), { ac, dc, next, width, rows, across, down, to, rowBytes });
  }
  if (next.ac !== acCount) throw new Error("damaged DWA: too many numbers");
  let [plainAt, rawAt] = [0, 0];
  channels.forEach(({ bytes: size }, i) => {
    if (found[i].scheme === COSINES) return;
    for (let y = 0, n = 0; y < rows; y++) {
      for (let x = 0, place = rowBytes * y + starts[i]; x < width; x++, n++) {
        // Runs of all first bytes, then of all second ones.
        for (let b = 0; b < size; b++) out[place++] = found[i].scheme === RUNS ? raw[rawAt + pixels * b + n] : plain[plainAt + size * n + b];
      }
    }
    if (found[i].scheme === RUNS) rawAt += pixels * size;
    else plainAt += pixels * size;
  });
  return out;
}

/** The squares of one channel, or of three as luminance and differences. */
function unpackSquares(group, { ac, dc, next, width, rows, across, down, to, rowBytes }) {
  const table = linearOfHalf();
  const squares = group.map(() => new Float64Array(64)), between = new Float64Array(64);
  const first = next.dc;
  for (let by = 0, block = 0; by < down; by++) {
    for (let bx = 0; bx < across; bx++, block++) {
      group.forEach((_, k) => {
        const square = squares[k].fill(0);
        square[0] = numberFromHalf(dc[first + across * down * k + block]);
        let last = 0;
        for (let i = 1; i < 64; ) {
          if (next.ac >= ac.length) throw new Error("damaged DWA: too few numbers");
          const bits = ac[next.ac++];
          // 0xff00 ends the square, 0xffNN leaves out NN of its numbers.
          if (bits === 0xff00) break;
          if (bits >> 8 === 0xff) i += bits & 255;
          else square[DIAGONALS[(last = i++)]] = numberFromHalf(bits);
        }
        if (last === 0) square.fill(square[0] / 8);
        else inverseCosines(square, between);
      });
      if (group.length === 3) {
        for (let i = 0; i < 64; i++) {
          const [y, b, r] = squares.map((square) => square[i]);
          (squares[0][i] = y + 1.5747 * r), (squares[1][i] = y - 0.1873 * b - 0.4682 * r), (squares[2][i] = y + 1.8556 * b);
        }
      }
      group.forEach((channel, k) => {
        for (let y = 8 * by; y < Math.min(8 * by + 8, rows); y++) {
          for (let x = 8 * bx; x < Math.min(8 * bx + 8, width); x++) {
            const curved = halfFromNumber(squares[k][8 * (y & 7) + (x & 7)]);
            const half = channel.isLinear ? curved : table[curved];
            const place = rowBytes * y + channel.start + channel.bytes * x;
            if (channel.bytes === 2) to.setUint16(place, half, true);
            else to.setFloat32(place, numberFromHalf(half), true);
          }
        }
      });
    }
  }
  next.dc += across * down * group.length;
}
