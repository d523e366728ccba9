// Radiance .hdr (Ward 1991, "Real Pixels"): RGBE, plain or run-length encoded, rows from the top (-Y N +X M).

/** Decodes the bytes of a .hdr file: { width, height, rgb }. */
export function decodeRadiance(bytes) {
  let at = 0;
  const line = () => {
    let text = "";
    while (at < bytes.length && bytes[at] !== 10) text += String.fromCharCode(bytes[at++]);
    at++;
    return text;
  };
  if (!line().startsWith("#?")) throw new Error("not a Radiance picture: the first line does not begin with #?");
  let exposure = 1;
  for (let text = line(); text !== ""; text = line()) {
    if (at >= bytes.length) throw new Error("the header has no end");
    if (text.startsWith("FORMAT=") && text !== "FORMAT=32-bit_rle_rgbe") throw new Error(`${text}: only RGBE is read`);
    if (text.startsWith("EXPOSURE=")) exposure *= parseFloat(text.slice(9)) || 1;
  }
  const size = line().match(/^-Y (\d+) \+X (\d+)$/);
  if (!size) throw new Error("the rows must run from the top left (-Y height +X width)");
  const [height, width] = [Number(size[1]), Number(size[2])];
  if (!(width * height > 0 && width * height <= 1 << 26)) throw new Error(`${width} × ${height} pixels are too many`);
  const rgb = new Float32Array(3 * width * height);
  const scanline = new Uint8Array(4 * width);
  for (let y = 0; y < height; y++) {
    at = readScanline(bytes, at, width, scanline);
    for (let x = 0; x < width; x++) {
      const exponent = scanline[x + 3 * width];
      // Mantissas of 8 bits under one exponent; exponent 0 is black.
      const scale = exponent > 0 ? 2 ** (exponent - 136) / exposure : 0;
      for (let c = 0; c < 3; c++) rgb[3 * (x + width * y) + c] = scanline[x + c * width] * scale;
    }
  }
  return { width, height, rgb };
}

/** Reads one row as four planes; returns where the next begins. */
function readScanline(bytes, at, width, planes) {
  const need = (n) => {
    if (at + n > bytes.length) throw new Error("the file ends in the middle of a row");
  };
  need(4);
  const isRunLength = bytes[at] === 2 && bytes[at + 1] === 2 && bytes[at + 2] * 256 + bytes[at + 3] === width;
  if (!isRunLength) {
    need(4 * width);
    for (let x = 0; x < width; x++) for (let c = 0; c < 4; c++) planes[x + c * width] = bytes[at++];
    return at;
  }
  at += 4;
  for (let c = 0; c < 4; c++) {
    for (let x = 0; x < width; ) {
      need(2);
      const count = bytes[at++];
      const [repeat, n] = count > 128 ? [true, count - 128] : [false, count];
      if (n === 0 || x + n > width) throw new Error("a run goes beyond its row");
      if (!repeat) need(n);
      for (let i = 0; i < n; i++) planes[c * width + x++] = repeat ? bytes[at] : bytes[at++];
      if (repeat) at++;
    }
  }
  return at;
}
