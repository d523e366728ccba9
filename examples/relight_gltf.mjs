// Reading and relighting a .glb that `isolume relight --transfer` wrote. Plain numbers, no browser needed.

const COMPONENTS = { 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/** Parses a GLB of one mesh: positions, indices, baked colours, and the transfer, if there is any. */
export function readGlb(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (view.getUint32(0, true) !== 0x46546c67) throw new Error("not a .glb file");
  const length = view.getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + length)));
  const start = 20 + length + 8;
  const numbers = (index) => {
    const accessor = json.accessors[index], buffer = json.bufferViews[accessor.bufferView];
    const Type = COMPONENTS[accessor.componentType];
    const at = start + (buffer.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
    const size = accessor.count * WIDTHS[accessor.type] * Type.BYTES_PER_ELEMENT;
    return new Type(bytes.slice(at, at + size).buffer);
  };
  const mesh = json.meshes[0], { attributes, indices } = mesh.primitives[0];
  const node = json.nodes.find((n) => n.mesh === 0);
  const transfer = mesh.extras?.isolume_transfer ?? null;
  const planes = [];
  transfer?.bands.forEach((bands, k) => {
    for (let l = 0; l < bands; l++) {
      for (let n = 0; n <= 2 * l; n++) planes.push(numbers(attributes[`_T${k}_SH_DEGREE_${l}_COEF_${n}`]));
    }
  });
  return {
    positions: numbers(attributes.POSITION),
    colours: numbers(attributes.COLOR_0),
    radiance: attributes._RADIANCE === undefined ? null : numbers(attributes._RADIANCE),
    indices: Uint32Array.from(numbers(indices)),
    gltfFromWorld: matrixFromQuaternion(node.rotation ?? [0, 0, 0, 1]),
    transfer,
    planes,
  };
}

/** Row-major. */
function matrixFromQuaternion([x, y, z, w]) {
  return [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)];
}

/**
 * Linear radiance of each vertex, Σ_k ρ^(k+1) ⟨T_k, L⟩ and the tail beyond the last layer. `light`: coefficients in
 * world, red, green and blue side by side; `withTail` false leaves out what comes beyond the last layer.
 */
export function relight({ positions, planes, transfer }, light, albedo, withTail = true) {
  const count = positions.length / 3, { bands } = transfer, last = bands.length - 1;
  const radiance = new Float32Array(3 * count), layer = new Float32Array(3 * count);
  const escapes = [];
  let at = 0;
  bands.forEach((b, k) => {
    layer.fill(0);
    escapes.push(planes[at].map((t) => Math.sqrt(4 * Math.PI) * t));
    for (let i = 0; i < b * b; i++, at++) {
      const weights = [0, 1, 2].map((c) => albedo[c] ** (k + 1) * light[3 * i + c]);
      const plane = planes[at];
      for (let v = 0; v < count; v++) for (let c = 0; c < 3; c++) layer[3 * v + c] += weights[c] * plane[v];
    }
    for (let i = 0; i < layer.length; i++) radiance[i] += layer[i];
  });
  if (last === 0 || !withTail) return radiance;
  for (let v = 0; v < count; v++) {
    const [before, final] = [escapes[last - 1][v], escapes[last][v]];
    const survival = Math.max(0, 1 - escapes.reduce((sum, a) => sum + a[v], 0));
    if (!(before > 0 && final > 0)) continue;
    const ratio = Math.min(final / before, survival / (survival + final));
    for (let c = 0; c < 3; c++) radiance[3 * v + c] += (layer[3 * v + c] * albedo[c] * ratio) / (1 - albedo[c] * ratio);
  }
  return radiance;
}
