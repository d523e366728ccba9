// The two GPU programs: contraction (texels × light → radiance, a slice at a time) and the picture (rays × level set).

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
precision highp sampler2DArray;
precision highp usampler3D;
`;

/** One triangle that covers everything. */
export const COVER = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }
`;

/** Assignments that read `count` numbers of a texel, four to a layer of a texture: `use(i, number)` says what is done with each. */
function reads(sampler, count, use) {
  const lines = [];
  for (let i = 0; i < count; i++) {
    if (i % 4 === 0) lines.push(`t = texelFetch(${sampler}, ivec3(place, ${i / 4}), 0);`);
    lines.push(use(i, `t.${"xyzw"[i % 4]}`));
  }
  return lines.join("\n  ");
}

/** Index of a coefficient in its layer and channel, for each number of a texel in the order of the texture. */
function coefficients(bands, channels) {
  let first = 0;
  return bands.flatMap((b, k) => {
    const of = [...Array(channels).keys()].flatMap((c) => [...Array(b * b).keys()].map((i) => ({ k, c, isFirst: i === 0, weight: first + i })));
    first += b * b;
    return of;
  });
}

/**
 * Contraction for the given bands of each layer; `luminaires` is their number in a scene, null for a volume alone.
 *
 * Alone: Σ_k ρ^(k+1) ⟨T_k, L⟩ and the tail beyond the last layer, which falls geometrically with the ratio
 * r = S/(S + max(a_K, S/512)) of the chances to escape a_k = sqrt(4π) T_k,00; and emission, Σ_k ρ^k S_k to its end.
 * In a scene, channel by channel: Σ_k ρ^(k+1) (⟨T_k, L⟩ + Σ_l s_l G_k,l + e G_k) + e, the last layer repeated with the
 * share r = min(1, G_K/G_(K−1)) of the emission's group.
 */
export function contractionShader(bands, luminaires, width) {
  const last = bands.length - 1;
  const weights = bands.reduce((sum, b) => sum + b * b, 0);
  const body = luminaires === null ? contractionAlone(bands) : contractionInScene(bands, luminaires);
  return `${HEAD}
layout(std140) uniform Light {
  vec4 weights[${weights}]; // ρ^(k+1) L_i · scale_i; in w, for the first of a layer alone, sqrt(4π) · scale_i
};
uniform usampler3D numbers;
uniform sampler2DArray transfer;
uniform int slice;
uniform vec3 albedo, emitted;
uniform float shown[${last + 2}]; // 1 for layers that are on; the last for what comes beyond them
${luminaires === null ? "" : "uniform sampler2DArray surroundings;"}
${luminaires > 0 ? `uniform vec3 powers[${luminaires}];` : ""}
out vec4 radiance;

void main() {
  uint number = texelFetch(numbers, ivec3(ivec2(gl_FragCoord.xy), slice), 0).r;
  if (number == 0u) { radiance = vec4(0.0); return; } // no level set, no weight
  int at = int(number - 1u);
  ivec2 place = ivec2(at % ${width}, at / ${width});
  vec3 layer[${last + 1}];
  for (int k = 0; k <= ${last}; k++) layer[k] = vec3(0.0);
  vec3 sum = emitted, power = vec3(1.0);
  vec4 t;
  ${body}
  radiance = vec4(sum, 1.0);
}
`;
}

function contractionAlone(bands) {
  const last = bands.length - 1;
  const all = coefficients(bands, 1);
  const use = (i, t) => {
    const { k, isFirst } = all[i];
    return `layer[${k}] += ${t} * weights[${i}].rgb;${isFirst ? ` escape[${k}] = ${t} * weights[${i}].w;` : ""}`;
  };
  return `float escape[${last + 1}];
  ${reads("transfer", all.length, use)}
  float survival = 1.0, ultimate = escape[${last}];
  bool falls = false;
  for (int k = 0; k <= ${last}; k++) {
    power *= albedo;
    survival -= escape[k];
    sum += shown[k] * (layer[k] + emitted * power * max(survival, 0.0));
  }
  survival = max(survival, 0.0);
${last > 0 ? `
  falls = ultimate > 0.0;
  // ρ r/(1 − ρ r).
  vec3 left = (1.0 - albedo) * survival + max(ultimate, survival / 512.0);
  if (falls) sum += shown[${last + 1}] * layer[${last}] * albedo * survival / left;` : ""}
  // Emission beyond: what survives escapes in ever smaller parts, or never, as far as is known, which has no end at albedo 1.
  vec3 decaying = survival * survival / max((1.0 - albedo) * survival + ultimate, 1e-12);
  vec3 forever = mix(vec3(0.0), survival / max(1.0 - albedo, 1e-6), lessThan(albedo, vec3(1.0)));
  sum += shown[${last + 1}] * emitted * power * albedo * (falls && 512.0 * ultimate >= survival ? decaying : forever);`;
}

function contractionInScene(bands, luminaires) {
  const last = bands.length - 1;
  const all = coefficients(bands, 3);
  const transfer = (i, t) => `layer[${all[i].k}].${"rgb"[all[i].c]} += ${t} * weights[${all[i].weight}].${"rgb"[all[i].c]};`;
  const number = (i) => ({ group: Math.floor(i / (3 * bands.length)), k: Math.floor(i / 3) % bands.length, c: "rgb"[i % 3] });
  const surroundings = (i, t) => {
    const { group, k, c } = number(i);
    return group === 0 ? `again[${k}].${c} = ${t};` : `layer[${k}].${c} += albedoPower[${k}].${c} * powers[${group - 1}].${c} * ${t};`;
  };
  return `vec3 again[${last + 1}], albedoPower[${last + 1}];
  for (int k = 0; k <= ${last}; k++) {
    power *= albedo;
    albedoPower[k] = power;
  }
  ${reads("transfer", all.length, transfer)}
  ${reads("surroundings", 3 * bands.length * (1 + luminaires), surroundings)}
  for (int k = 0; k <= ${last}; k++) {
    layer[k] += emitted * albedoPower[k] * again[k];
    sum += shown[k] * layer[k];
  }
${last > 0 ? `
  vec3 before = again[${last - 1}];
  vec3 x = albedo * mix(vec3(0.0), min(again[${last}] / max(before, 1e-30), 1.0), greaterThan(before, vec3(0.0)));
  sum += shown[${last + 1}] * layer[${last}] * mix(vec3(0.0), x / max(1.0 - x, 1e-6), lessThan(x, vec3(1.0)));` : ""}`;
}

/** What the picture can show besides radiance. */
export const MODES = { light: 0, normal: 1, depth: 2, error: 3, lookup: 4, fetches: 5, radiance: 6 };

/** Rays against the level set, cell by cell. */
export const PICTURE = `${HEAD}
uniform sampler3D samples;   // the volume
uniform sampler3D ranges;    // smallest and largest sample of each block of 8³ cells
uniform sampler3D radiances; // contracted light; alpha is the weight
uniform sampler3D errors;    // sqrt of the relative standard error
uniform sampler2D sky;       // the environment, lat-long
uniform vec3 cells;          // cells along each axis
uniform vec3 texels;         // texels along each axis
uniform ivec3 blocks;
uniform float level, side;   // isovalue in the texture's numbers; +1 where larger ones are solid
uniform vec3 origin, originX, originY, direction, directionX, directionY; // in cells
uniform vec3 skyRay, skyX, skyY; // in the probe's frame
uniform mat3 normalFromGradient;
uniform vec3 albedo, emitted;
uniform vec3 openLight[25];  // A_l/π times the coefficients of the light, first five bands
uniform vec3 cut[6];         // radiance of cut faces: −x, +x, −y, +y, −z, +z of the box
uniform float exposure, skyStrength;
uniform vec2 size;
uniform int supersampling, mode;
uniform vec4 background;     // linear; alpha 0: the environment
out vec4 colour;

int fetches = 0;

float field(vec3 p) {
  fetches++;
  return side * (texture(samples, (p + 0.5) / (cells + 1.0)).r - level);
}

float corner(ivec3 c) {
  fetches++;
  return side * (texelFetch(samples, c, 0).r - level);
}

// The first crossing of the trilinear field in a cell between from (outside) and to (inside), by bisection.
float crossing(vec3 start, vec3 ray, ivec3 cell, float from, float to) {
  vec4 low = vec4(corner(cell), corner(cell + ivec3(1, 0, 0)), corner(cell + ivec3(0, 1, 0)), corner(cell + ivec3(1, 1, 0)));
  vec4 high = vec4(corner(cell + ivec3(0, 0, 1)), corner(cell + ivec3(1, 0, 1)), corner(cell + ivec3(0, 1, 1)), corner(cell + ivec3(1, 1, 1)));
  for (int i = 0; i < 16; i++) {
    float middle = 0.5 * (from + to);
    vec3 q = start + ray * middle - vec3(cell);
    vec4 plane = mix(low, high, q.z);
    vec2 edge = mix(plane.xy, plane.zw, q.y);
    if (mix(edge.x, edge.y, q.x) > 0.0) to = middle; else from = middle;
  }
  return to;
}

vec3 normalAt(vec3 p) {
  vec3 e = vec3(1.0, 0.0, 0.0);
  vec3 gradient = vec3(field(p + e.xyy) - field(p - e.xyy), field(p + e.yxy) - field(p - e.yxy), field(p + e.yyx) - field(p - e.yyx));
  vec3 normal = -(normalFromGradient * gradient);
  return dot(normal, normal) > 0.0 ? normalize(normal) : vec3(0.0, 0.0, 1.0);
}

vec3 openRadiance(vec3 n) {
  float x = n.x, y = n.y, z = n.z, xx = x * x, yy = y * y, zz = z * z;
  vec3 sum = 0.2820948 * openLight[0] + 0.4886025 * (y * openLight[1] + z * openLight[2] + x * openLight[3]);
  sum += 1.0925484 * (x * y * openLight[4] + y * z * openLight[5] + x * z * openLight[7]);
  sum += 0.3153916 * (3.0 * zz - 1.0) * openLight[6] + 0.5462742 * (xx - yy) * openLight[8];
  // Degree 3 is 0 for a clamped cosine.
  sum += 2.5033430 * x * y * (xx - yy) * openLight[16] + 1.7701308 * y * z * (3.0 * xx - yy) * openLight[17];
  sum += 0.9461747 * x * y * (7.0 * zz - 1.0) * openLight[18] + 0.6690465 * y * z * (7.0 * zz - 3.0) * openLight[19];
  sum += 0.1057855 * (35.0 * zz * zz - 30.0 * zz + 3.0) * openLight[20];
  sum += 0.6690465 * x * z * (7.0 * zz - 3.0) * openLight[21] + 0.4730873 * (xx - yy) * (7.0 * zz - 1.0) * openLight[22];
  sum += 1.7701308 * x * z * (xx - 3.0 * yy) * openLight[23];
  sum += 0.6258357 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy)) * openLight[24];
  return sum;
}

// Radiance at a point of the level set; kind is how it was found: 0 all texels, 1 some, 2 those around, 3 none.
vec3 look(vec3 p, out int kind) {
  vec3 q = p / cells * (texels - 1.0);
  vec4 found = texture(radiances, (q + 0.5) / texels);
  fetches++;
  kind = found.a > 0.999 ? 0 : 1;
  if (found.a > 0.002) return found.rgb / found.a;
  ivec3 last = ivec3(texels) - 1;
  ivec3 base = min(ivec3(q), max(last - 1, ivec3(0)));
  ivec3 first = max(base - 1, ivec3(0)), end = min(base + 2, last);
  vec4 sum = vec4(0.0);
  for (int z = first.z; z <= end.z; z++)
    for (int y = first.y; y <= end.y; y++)
      for (int x = first.x; x <= end.x; x++) {
        sum += texelFetch(radiances, ivec3(x, y, z), 0);
        fetches++;
      }
  kind = 2;
  if (sum.a > 0.0) return sum.rgb / sum.a;
  kind = 3;
  return albedo * openRadiance(normalAt(p)) + emitted;
}

struct Hit { bool found, isCut; float t; vec3 at; int face; };

Hit march(vec3 start, vec3 ray) {
  Hit hit = Hit(false, false, 0.0, start, 0);
  vec3 inverse = 1.0 / mix(ray, vec3(1e-20), equal(ray, vec3(0.0)));
  vec3 a = -start * inverse, b = (cells - start) * inverse;
  vec3 nearest = min(a, b), farthest = max(a, b);
  float enter = max(max(nearest.x, nearest.y), max(nearest.z, 0.0)), leave = min(farthest.x, min(farthest.y, farthest.z));
  if (enter >= leave) return hit;
  vec3 p = start + ray * enter;
  ivec3 most = ivec3(cells) - 1;
  if (field(clamp(p, vec3(0.0), cells)) > 0.0) {
    int axis = nearest.x >= nearest.y && nearest.x >= nearest.z ? 0 : nearest.y >= nearest.z ? 1 : 2;
    return Hit(true, true, enter, p, 2 * axis + (ray[axis] > 0.0 ? 0 : 1));
  }
  ivec3 cell = clamp(ivec3(floor(p)), ivec3(0), most);
  ivec3 forward = ivec3(greaterThan(ray, vec3(0.0)));
  ivec3 block = ivec3(-1);
  bool skip = false;
  float t = enter;
  for (int i = 0; i < 4096; i++) {
    if (cell / 8 != block) {
      block = cell / 8;
      vec2 range = texelFetch(ranges, block, 0).rg;
      fetches++;
      skip = side > 0.0 ? range.g <= level : range.r >= level;
    }
    ivec3 low = skip ? block * 8 : cell;
    vec3 exits = (vec3(low + forward * (skip ? 8 : 1)) - start) * inverse;
    int axis = exits.x <= exits.y && exits.x <= exits.z ? 0 : exits.y <= exits.z ? 1 : 2;
    float next = max(min(exits[axis], leave), t);
    if (!skip) {
      // The field at the exit and half way: a bump that rises and sinks within a half is missed.
      float middle = 0.5 * (t + next);
      bool inMiddle = field(start + ray * middle) > 0.0;
      if (inMiddle || field(start + ray * next) > 0.0) {
        float at = crossing(start, ray, cell, t, inMiddle ? middle : next);
        return Hit(true, false, at, start + ray * at, 0);
      }
      cell[axis] += forward[axis] == 1 ? 1 : -1;
    } else {
      cell = clamp(ivec3(floor(start + ray * next)), low, low + 7);
      cell[axis] = forward[axis] == 1 ? low[axis] + 8 : low[axis] - 1;
    }
    t = next;
    if (any(lessThan(cell, ivec3(0))) || any(greaterThan(cell, most))) break;
  }
  return hit;
}

vec3 skyRadiance(vec3 d) {
  d = normalize(d);
  vec2 place = vec2(0.5 + atan(d.z, d.x) / 6.2831853, acos(clamp(d.y, -1.0, 1.0)) / 3.1415927); // as three.js
  return texture(sky, place).rgb;
}

vec3 heat(float v) { // black, blue, orange, white
  return clamp(vec3(2.0 * v, 3.0 * v - 0.9, v < 0.4 ? 2.0 * v : 3.0 * v - 2.0), 0.0, 1.0);
}

vec3 encoded(vec3 linear) {
  linear = clamp(linear, 0.0, 1.0);
  return mix(12.92 * linear, 1.055 * pow(max(linear, 1e-9), vec3(1.0 / 2.4)) - 0.055, greaterThan(linear, vec3(0.0031308)));
}

vec4 sum = vec4(0.0);
vec3 special = vec3(0.0);
int hits = 0;
float nearestHit = 1e30, farthestHit = -1e30; // along the ray, in cells
float pixelInCells = 0.0;

// Adds what n × n rays through the pixel see.
void take(int n) {
  sum = vec4(0.0);
  special = vec3(0.0);
  for (int i = 0; i < n * n; i++) {
    vec2 place = (gl_FragCoord.xy - 0.5 + (vec2(i % n, i / n) + 0.5) / float(n)) / size * 2.0 - 1.0;
    vec3 start = origin + place.x * originX + place.y * originY;
    vec3 ray = direction + place.x * directionX + place.y * directionY;
    Hit hit = march(start, ray);
    if (!hit.found) continue;
    hits++;
    float along = hit.t * length(ray);
    nearestHit = min(nearestHit, along);
    farthestHit = max(farthestHit, along);
    pixelInCells = 2.0 * length(originX + hit.t * directionX) / size.x;
    int kind = 0;
    vec3 rgb = hit.isCut ? cut[hit.face] : look(hit.at, kind);
    if (mode == ${MODES.normal}) special += hit.isCut ? vec3(0.5) : 0.5 + 0.5 * normalAt(hit.at);
    if (mode == ${MODES.depth}) special += vec3(hit.t);
    if (mode == ${MODES.error}) {
      float root = texture(errors, (hit.at / cells * (texels - 1.0) + 0.5) / texels).r;
      special += heat(hit.isCut ? 0.0 : root * root / 0.2);
    }
    if (mode == ${MODES.lookup}) special += hit.isCut ? vec3(0.3) : kind == 0 ? vec3(0.1, 0.45, 0.2) : kind == 1 ? vec3(0.8, 0.7, 0.1) : kind == 2 ? vec3(0.9, 0.35, 0.05) : vec3(0.8, 0.05, 0.2);
    sum += vec4(rgb, 1.0);
  }
}

// As the program: what has a negative channel moves towards the grey of its luminance until none has.
vec3 withoutNegative(vec3 rgb) {
  float least = min(rgb.r, min(rgb.g, rgb.b)), grey = dot(rgb, vec3(0.2126, 0.7152, 0.0722));
  if (least >= 0.0) return rgb;
  return grey > 0.0 ? max(grey + grey / (grey - least) * (rgb - grey), 0.0) : vec3(0.0);
}

void main() {
  int n = min(supersampling, 2);
  take(n);
  // Silhouettes, against the background and where the surface hides itself (steeper than 76°), take all rays.
  if (supersampling > n && ((hits > 0 && hits < n * n) || farthestHit - nearestHit > 4.0 * pixelInCells)) {
    n = supersampling;
    take(n);
  }
  float samplesTaken = float(n * n);
  float coverage = sum.a / samplesTaken;
  vec3 straight = sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0);
  if (mode == ${MODES.fetches}) { colour = vec4(float(fetches) / samplesTaken, coverage, 0.0, 1.0); return; }
  if (mode == ${MODES.radiance}) { colour = vec4(straight, coverage); return; }
  if (mode == ${MODES.depth}) { float d = sum.a > 0.0 ? special.r / sum.a : 0.0; colour = vec4(d, fract(d * 256.0), coverage, 1.0); return; }
  vec2 place = gl_FragCoord.xy / size * 2.0 - 1.0;
  vec3 behind = background.a > 0.0 ? background.rgb : clamp(exposure * skyStrength * skyRadiance(skyRay + place.x * skyX + place.y * skyY), 0.0, 1.0);
  vec3 front = mode == ${MODES.light} ? clamp(withoutNegative(straight) * exposure, 0.0, 1.0) : sum.a > 0.0 ? special / sum.a : vec3(0.0);
  if (mode == ${MODES.normal}) front = pow(front, vec3(2.2));
  colour = vec4(encoded(mix(behind, front, coverage)), 1.0);
}
`;
