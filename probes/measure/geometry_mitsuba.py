"""`isolume compare --against geometry` against Mitsuba 3 on the mesh of a threefold resampled field.

    python3 -m venv mi && mi/bin/pip install mitsuba scikit-image mrcfile pynrrd numpy
    mi/bin/python probes/measure/geometry_mitsuba.py VOLUME ISOVALUE [ENV.hdr | constant] [POINTS] [PATHS]

`isolume` is taken from the path, or from ISOLUME. A volume (.map, or .nrrd on a grid along the axes) resampled linearly
along each axis has the same trilinear surface; marching cubes (scikit-image) on the finer grid follow it. The points are
those of the comparison, listed by --list-points; a ray along the normal of each finds the facet that it lies on, and
Mitsuba's `path` integrator says what leaves it: facet normals, one-sided diffuse, any number of bounces. It shares no code
and no random numbers with isolume. Where several layers lie within a fiftieth of a voxel a point is left out and counted.

Prints CSV: mean of both, their difference with its standard error over the points, and the RMS of the difference without the
noise of both, in percent of the mean.

Mitsuba needs LLVM (DRJIT_LIBLLVM_PATH names its library where it is not found).
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
import drjit as dr  # noqa: E402

REFINEMENT = 3
ALBEDO = 0.7
# Of the finer mesh's distance from the trilinear surface and of f32, in voxels of the volume.
OFFSET = 0.02
RAYS_AT_ONCE = 1 << 20
# Times that a pixel of the environment is repeated along each axis.
REPEATED = 8


def read(path: Path) -> tuple:
    """Samples by x, y, z, and the spacing."""
    if path.suffix == ".nrrd":
        import nrrd

        samples, header = nrrd.read(str(path))
        spacing = header.get("spacings", [1.0] * 3)
    else:
        import mrcfile

        with mrcfile.open(path) as file:
            samples = np.transpose(file.data, (2, 1, 0))
            spacing = [float(file.voxel_size[a]) for a in "xyz"]
    return samples.astype(np.float64), np.asarray(spacing, dtype=np.float64)


def refined(samples: np.ndarray) -> np.ndarray:
    for axis in range(3):
        count = samples.shape[axis]
        places = np.arange(REFINEMENT * (count - 1) + 1) / REFINEMENT
        low = np.minimum(places.astype(int), count - 2)
        shape = [1] * 3
        shape[axis] = -1
        t = (places - low).reshape(shape)
        samples = np.take(samples, low, axis) * (1 - t) + np.take(samples, low + 1, axis) * t
    return samples


def mesh_of(samples: np.ndarray, isovalue: float, spacing: np.ndarray) -> mi.Mesh:
    from skimage.measure import marching_cubes

    fine = refined(samples)
    vertices, triangles, _, _ = marching_cubes(fine, isovalue, gradient_direction="ascent")
    # Larger samples are solid: triangles must face down the gradient.
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normals, centres = np.cross(b - a, c - a), np.rint((a + b + c) / 3).astype(int)
    inner = np.all((centres > 0) & (centres < np.array(fine.shape) - 1), axis=1)
    at = centres[inner]
    gradient = np.stack([fine[tuple((at + e).T)] - fine[tuple((at - e).T)] for e in np.eye(3, dtype=int)], axis=1)
    if np.sum(normals[inner] * gradient) > 0:
        triangles = triangles[:, ::-1]
    props = mi.Properties()
    props["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": [ALBEDO] * 3}})
    mesh = mi.Mesh("surface", len(vertices), len(triangles), props=props)
    params = mi.traverse(mesh)
    params["vertex_positions"] = (vertices / REFINEMENT * spacing).astype(np.float32).ravel()
    params["faces"] = np.ascontiguousarray(triangles, dtype=np.uint32).ravel()
    params.update()
    return mesh


def environment(name: str) -> dict:
    if name == "constant":
        return {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}
    # World has z up. Isolume puts the centre of the image at +X of glTF, which is +x of the world, and the right of it towards
    # +Z of glTF, −y of the world; Mitsuba puts the centre at +z of its own frame, the right towards −x, up is +y.
    world_from_image = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
    # Isolume takes an image as constant over each pixel, Mitsuba interpolates: repeated pixels leave little of that. Probes
    # hold tiny negative numbers, which isolume sets to 0.
    pixels = np.maximum(np.array(mi.Bitmap(name).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)), 0)
    pixels = np.repeat(np.repeat(pixels, REPEATED, axis=0), REPEATED, axis=1)
    return {"type": "envmap", "bitmap": mi.Bitmap(pixels), "to_world": mi.ScalarTransform4f(world_from_image)}


def main() -> None:
    path, isovalue = Path(sys.argv[1]), float(sys.argv[2])
    env = sys.argv[3] if len(sys.argv) > 3 else "constant"
    points = sys.argv[4] if len(sys.argv) > 4 else "1000"
    paths = int(sys.argv[5]) if len(sys.argv) > 5 else 1024
    isolume = os.environ.get("ISOLUME", "isolume")
    with tempfile.TemporaryDirectory() as folder:
        store = f"{folder}/s.isolume"
        subprocess.run([isolume, "bake", path, "--isovalues", str(isovalue), "--rays", "16", "-o", store],
                       check=True, capture_output=True)
        said = subprocess.run(
            [isolume, "compare", store, "--isovalue", str(isovalue), "--env", env, "--albedo", str(ALBEDO), "--against",
             "geometry", "--points", points, "--paths", str(paths), "--texel-rays", "4", "--list-points", "--json"],
            check=True, capture_output=True, text=True).stdout
    row = json.loads(said)["rows"][0]["geometry"]
    samples, spacing = read(path)
    scene = mi.load_dict({"type": "scene", "mesh": mesh_of(samples, isovalue, spacing), "light": environment(env)})
    place = np.array([p["position_in_grid"] for p in row["points"]]) * spacing
    normal = np.array([p["normal"] for p in row["points"]])
    ours = np.array([p["geometry"] for p in row["points"]])
    offset = OFFSET * spacing.min()
    origins, towards = (place + offset * normal).astype(np.float32), (-normal).astype(np.float32)
    found = scene.ray_intersect(mi.Ray3f(mi.Point3f(origins.T), mi.Vector3f(towards.T)))
    distance, facing = np.array(found.t), np.sum(np.array(found.n).T * normal, axis=1)
    good = (distance < 2 * offset) & (facing > 0)
    integrator = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 8})
    count, each = len(place), max(1, min(paths, RAYS_AT_ONCE // len(place)))
    batches = []
    for seed in range(max(4, paths // each)):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count * each)
        # By path, then by point.
        rays = mi.RayDifferential3f(
            mi.Point3f(np.tile(origins.T, (1, each))), mi.Vector3f(np.tile(towards.T, (1, each))))
        radiance, _, _ = integrator.sample(scene, sampler, rays)
        batches.append(np.array(radiance).T.reshape(each, count, 3).mean(axis=0))
        dr.eval()
    batches = np.array(batches)[:, good]
    theirs, ours = batches.mean(axis=0), ours[good]
    noise = np.mean(batches.var(axis=0, ddof=1) / len(batches))
    mean = theirs.mean()
    off = (ours - theirs).mean(axis=1)
    square = np.mean((ours - theirs) ** 2) - noise - (row["noise"] * row["mean_radiance"]) ** 2
    percent = lambda value: f"{100 * value / mean:.2f}"  # noqa: E731
    print("volume,isovalue,environment,points,left_out,mitsuba_mean,geometry_mean,difference_%,standard_error_%,"
          "rms_%,rms_without_noise_%,mitsuba_noise_%,geometry_noise_%,lost")
    print(path.name, isovalue, Path(env).name, good.sum(), (~good).sum(), f"{mean:.5f}", f"{ours.mean():.5f}",
          percent(off.mean()), percent(off.std(ddof=1) / np.sqrt(len(off))),
          percent(np.sqrt(np.mean((ours - theirs) ** 2))), percent(np.sqrt(max(square, 0.0))), percent(np.sqrt(noise)),
          f"{100 * row['noise']:.2f}", row["lost"], sep=",")


if __name__ == "__main__":
    main()
