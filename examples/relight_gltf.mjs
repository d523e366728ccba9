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
  const planes = transfer === null ? [] : planeNames(transfer).map((name) => numbers(attributes[name]));
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

/**
 * The attributes in the order of the planes: layers, in a scene red, green and blue of each, degrees, orders; then, in a
 * scene, one number a layer and channel of the emission and of each luminaire.
 */
export function planeNames({ bands, channels, luminaires }) {
  const names = [], colours = channels === 3 ? ["_R", "_G", "_B"] : [""];
  bands.forEach((b, k) => {
    for (const c of colours) for (let l = 0; l < b; l++) for (let n = 0; n <= 2 * l; n++) names.push(`_T${k}${c}_SH_DEGREE_${l}_COEF_${n}`);
  });
  if (channels !== 3) return names;
  bands.forEach((_, k) => names.push(...colours.map((c) => `_G${k}_EMISSION${c}`)));
  luminaires.forEach((_, i) => bands.forEach((_, k) => names.push(...colours.map((c) => `_LUMINAIRE_${i}_G${k}${c}`))));
  return names;
}

/** Row-major. */
function matrixFromQuaternion([x, y, z, w]) {
  return [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)];
}

/**
 * Linear radiance of each vertex, Σ_k ρ^(k+1) ⟨T_k, L⟩ and the tail beyond the last layer. `light`: coefficients in
 * world, red, green and blue side by side; `withTail` false leaves out what comes beyond the last layer. In a scene its
 * luminaires shine too, by the factors that the file names, and the surface itself, as the file says.
 */
export function relight(model, light, albedo, withTail = true) {
  if (model.transfer.channels === 3) return relightScene(model, light, albedo, withTail);
  const { positions, planes, transfer } = model;
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
    const final = escapes[last][v];
    const survival = Math.max(0, 1 - escapes.reduce((sum, a) => sum + a[v], 0));
    if (!(final > 0)) continue;
    // ρ r/(1 − ρ r) with r = S/(S + max(a_K, S/512)).
    const falls = Math.max(final, survival / 512);
    const gain = albedo.map((rho) => (rho * survival) / ((1 - rho) * survival + falls));
    for (let c = 0; c < 3; c++) radiance[3 * v + c] += layer[3 * v + c] * gain[c];
  }
  return radiance;
}

/** Σ_k ρ^(k+1) (⟨T_k, L⟩ + e E_k + Σ_i s_i G_k,i) + e and the tail, channel by channel. */
function relightScene({ positions, planes, transfer }, light, albedo, withTail) {
  const count = positions.length / 3, { bands, luminaires, emission } = transfer, layers = bands.length;
  const coefficients = bands.reduce((sum, b) => sum + 3 * b * b, 0);
  // Of emission (0) and luminaires (1 + i).
  const group = (g, k, c) => planes[coefficients + 3 * (g * layers + k) + c];
  const factors = [emission, ...luminaires.map((l) => l.factor)];
  const radiance = new Float32Array(3 * count), brought = new Float32Array(count);
  for (let c = 0; c < 3; c++) {
    let first = 0;
    for (let v = 0; v < count; v++) radiance[3 * v + c] = emission[c];
    bands.forEach((b, k) => {
      const power = albedo[c] ** (k + 1);
      const add = (plane, weight) => { for (let v = 0; v < count; v++) brought[v] += weight * plane[v]; };
      brought.fill(0);
      for (let i = 0; i < b * b; i++) add(planes[first + c * b * b + i], power * light[3 * i + c]);
      factors.forEach((factor, g) => add(group(g, k, c), power * factor[c]));
      for (let v = 0; v < count; v++) radiance[3 * v + c] += brought[v];
      first += 3 * b * b;
    });
    if (layers === 1 || !withTail) continue;
    const [before, last] = [group(0, layers - 2, c), group(0, layers - 1, c)];
    for (let v = 0; v < count; v++) {
      const x = before[v] > 0 ? albedo[c] * Math.min(1, last[v] / before[v]) : 0;
      if (x < 1) radiance[3 * v + c] += (brought[v] * x) / (1 - x);
    }
  }
  return radiance;
}
