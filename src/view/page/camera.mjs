// The camera, as the program's pictures have it: angles in the glTF frame (y up), the box of the volume in view.

const column = (m, c) => [m[c], m[c + 3], m[c + 6]]; // of a row-major 3×3
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const scaled = (a, s) => a.map((v) => v * s);
export const plus = (a, b) => a.map((v, i) => v + b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** Row-major 3×3 times vector. */
export const times = (m, v) => [0, 1, 2].map((r) => m[3 * r] * v[0] + m[3 * r + 1] * v[1] + m[3 * r + 2] * v[2]);
export const transposed = (m) => [0, 3, 6, 1, 4, 7, 2, 5, 8].map((i) => m[i]);

export function inverse(m) {
  const [a, b, c] = [column(m, 0), column(m, 1), column(m, 2)];
  const determinant = dot(a, cross(b, c));
  return [cross(b, c), cross(c, a), cross(a, b)].flat().map((v) => v / determinant);
}

/** Where the samples stand: cells of the volume's texture from world. */
export class Placement {
  constructor(volume) {
    this.cells = volume.samples.map((n) => n - 1);
    const m = volume.world_from_grid;
    this.linear = [m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]];
    this.offset = [m[3], m[7], m[11]];
    this.steps = volume.grid.map((n, a) => (n - 1) / this.cells[a]); // grid units to a cell
    this.grid = volume.grid;
    this.inverse = inverse(this.linear);
    this.worldFromGltf = transposed(volume.gltf_from_world);
    this.gltfFromWorld = volume.gltf_from_world;
    // n = −Gᵀ·gradient with G = grid from world; here for a gradient to a cell.
    this.normalFromGradient = transposed(this.inverse).map((v, i) => v / this.steps[i % 3]);
  }
  corner(i) {
    const grid = [0, 1, 2].map((a) => ((i >> a) & 1 ? this.grid[a] - 1 : 0));
    return plus(times(this.linear, grid), this.offset);
  }
  cellPoint(world) {
    return this.cellVector(world.map((v, a) => v - this.offset[a]));
  }
  cellVector(world) {
    return times(this.inverse, world).map((v, a) => v / this.steps[a]);
  }
}

/** Rays of a view as linear functions of the picture's (x, y) in [−1, 1]: origin + x·originX + y·originY, and so on. */
export function cameraRays(placement, view, aspect) {
  const [azimuth, elevation] = [view.azimuth, view.elevation].map((d) => (d * Math.PI) / 180);
  const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
  const axes = [[ca, 0, -sa], null, [ce * sa, se, ce * ca]];
  axes[1] = cross(axes[2], axes[0]);
  const [right, up, backward] = axes.map((axis) => times(placement.worldFromGltf, axis));
  const seen = [right, up, backward].map((axis) => {
    const along = [...Array(8).keys()].map((i) => dot(axis, placement.corner(i)));
    return { centre: (Math.min(...along) + Math.max(...along)) / 2, half: (Math.max(...along) - Math.min(...along)) / 2 };
  });
  let centre = [0, 0, 0];
  [right, up, backward].forEach((axis, i) => (centre = plus(centre, scaled(axis, seen[i].centre))));
  const [halfX, halfY, halfZ] = seen.map((s) => s.half);
  let halfHeight = Math.max(halfY, halfX / aspect, 1e-300) * 1.04;
  const reach = 2 * Math.hypot(halfX, halfY, halfZ);
  const tangent = Math.tan((0.5 * 35 * Math.PI) / 180);
  const distance = halfHeight / tangent + halfZ;
  if (view.perspective) halfHeight += halfZ * tangent;
  halfHeight /= view.zoom;
  centre = plus(centre, plus(scaled(right, -view.panX * halfHeight), scaled(up, -view.panY * halfHeight)));
  const [spanX, spanY] = [scaled(right, halfHeight * aspect), scaled(up, halfHeight)];
  const zero = [0, 0, 0];
  const rays = view.perspective
    ? { origin: plus(centre, scaled(backward, distance)), originX: zero, originY: zero, direction: scaled(backward, -distance), directionX: spanX, directionY: spanY }
    : { origin: plus(centre, scaled(backward, reach)), originX: spanX, originY: spanY, direction: scaled(backward, -reach), directionX: zero, directionY: zero };
  // Behind the surface the environment is seen in perspective always: parallel rays would see one direction.
  const wide = Math.tan((0.5 * 60 * Math.PI) / 180);
  rays.sky = scaled(backward, -1);
  rays.skyX = scaled(right, wide * aspect);
  rays.skyY = scaled(up, wide);
  rays.unitsPerPixelHeight = 2 * halfHeight;
  return rays;
}
