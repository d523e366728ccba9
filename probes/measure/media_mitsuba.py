"""Fog, smoke and translucent solids against Mitsuba 3's volumetric path tracer, on the mesh that isolume writes.

    python3 -m venv mi && mi/bin/pip install mitsuba numpy
    mi/bin/python probes/measure/media_mitsuba.py [POINTS] [PATHS]

`isolume` is taken from the path, or from ISOLUME. Three scenes on a small analytic volume, all under a white environment: `fog` (constant extinction, Henyey-Greenstein), `smoke` (extinction by table over a file, which Mitsuba gets as a
grid volume), and `wax` (a translucent solid, matched and of index 1.3). Radiance that leaves vertices of the mesh:
by isolume from transfer at them, by Mitsuba's `volpath` along rays that meet the facets beside them, over all outgoing directions by
the cosine where the solid is translucent. Vertices lie on the mesh and not on its facets' middles: rays meet a facet, up to a thousandth of a
cell beside the vertex.

Prints CSV: means, their difference with its standard error over the points, RMS of the difference without the noise of both, in percent.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

ALBEDO = 0.7
VOLUME, ISOVALUE = "torus:41", -0.1
BOX = 1.0
BATCHES = 4
# Outgoing directions of a point of a translucent solid, in each batch.
DIRECTIONS = 16
PATHS_OF_ISOLUME = 1024
GRID = 96


def read_ply(path: Path) -> tuple:
    """Positions, normals, faces, radiance and its standard error."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    kinds = {"float": "<f4", "uchar": "u1", "ushort": "<u2", "uint": "<u4", "int": "<i4", "double": "<f8"}
    fields, counts, element = [], {}, None
    for line in data[:end].decode().splitlines():
        words = line.split()
        if words[:1] == ["element"]:
            element, counts[words[1]] = words[1], int(words[2])
        elif words[:1] == ["property"] and element == "vertex":
            fields.append((words[2], kinds[words[1]]))
    kind = np.dtype(fields)
    vertices = np.frombuffer(data, kind, counts["vertex"], end)
    faces = np.frombuffer(data, np.dtype([("n", "u1"), ("v", "<u4", 3)]), counts["face"], end + kind.itemsize * counts["vertex"])
    pick = lambda *names: np.stack([vertices[n].astype(np.float64) for n in names], axis=1)  # noqa: E731
    names = [n for n, _ in fields]
    radiance = [n for n in names if "radiance" in n.lower()]
    error = [n for n in names if "stderr" in n.lower()]
    return pick("x", "y", "z"), pick("nx", "ny", "nz"), faces["v"], pick(*radiance), vertices[error[0]]


def mesh_of(positions, faces, bsdf: dict, interior: dict | None, exterior: dict | None) -> mi.Mesh:
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    if interior is not None:
        props["interior"] = mi.load_dict(interior)
    if exterior is not None:
        props["exterior"] = exterior
    mesh = mi.Mesh("surface", len(positions), len(faces), props=props)
    params = mi.traverse(mesh)
    params["vertex_positions"] = positions.astype(np.float32).ravel()
    params["faces"] = np.ascontiguousarray(faces, dtype=np.uint32).ravel()
    params.update()
    return mesh


def medium(extinction, albedo: float, g: float) -> dict:
    phase = {"type": "hg", "g": g} if g else {"type": "isotropic"}
    white = {"type": "rgb", "value": [albedo] * 3}
    if np.isscalar(extinction):
        return {"type": "homogeneous", "sigma_t": 1.0, "scale": extinction, "albedo": white, "phase": phase}
    to_world = mi.ScalarTransform4f().translate([-BOX] * 3).scale(2 * BOX)
    largest = float(extinction.max())
    grid = {"type": "gridvolume", "grid": mi.VolumeGrid((extinction / largest)[..., None].astype(np.float32)), "to_world": to_world}
    return {"type": "heterogeneous", "sigma_t": grid, "scale": largest, "albedo": {"type": "constvolume", "value": white}, "phase": phase}


def cosine(normal: np.ndarray, rng) -> np.ndarray:
    """A direction about a normal by the cosine."""
    u, v = rng.random(2)
    other = np.array([1.0, 0, 0]) if abs(normal[0]) < 0.9 else np.array([0, 1.0, 0])
    t = np.cross(normal, other)
    t /= np.linalg.norm(t)
    turn = 2 * np.pi * v
    return np.sqrt(u) * (np.cos(turn) * t + np.sin(turn) * np.cross(normal, t)) + np.sqrt(1 - u) * normal


def run(isolume: str, folder: Path, scene: str) -> tuple:
    path = folder / "scene.toml"
    path.write_text(f'volume = "{VOLUME}"\nisovalues = [{ISOVALUE}]\n{scene}[bake]\nlayers = 4\nbands = [1, 1, 1, 1]\n')
    write_nrrd(folder / "smoke.nrrd", smoke(GRID))
    out = folder / "lit.ply"
    subprocess.run([isolume, "relight", path, "--rays", str(PATHS_OF_ISOLUME), "--albedo", str(ALBEDO), "--env", "constant:1", "--radiance", "-o", out, "--cache", folder / "cache"],
                   check=True, capture_output=True)
    return read_ply(out)


def measure(name: str, isolume: str, scene: str, medium_of, points: int, paths: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        positions, normals, faces, ours, error = run(isolume, Path(folder), scene)
    is_body = name.startswith("wax")
    index = 1.3 if name.endswith("1.3") else 1.0
    of_medium = mi.load_dict(medium_of)
    if is_body:
        bsdf = {"type": "null"} if index == 1.0 else {"type": "dielectric", "int_ior": index, "ext_ior": 1.0}
        mesh, extra = mesh_of(positions, faces, bsdf, medium_of, None), {}
    else:
        diffuse = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [ALBEDO] * 3}}}
        mesh = mesh_of(positions, faces, diffuse, None, of_medium)
        extra = {"box": {"type": "cube", "to_world": mi.ScalarTransform4f().scale(BOX), "bsdf": {"type": "null"}, "interior": of_medium}}
    scene_of_mitsuba = mi.load_dict({"type": "scene", "mesh": mesh, **extra,
                                     "light": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}})
    rng = np.random.default_rng(7)
    # Not at the border of the box.
    inner = np.flatnonzero(np.all(np.abs(positions) < 0.97 * BOX, axis=1))
    chosen = rng.choice(inner, min(points, len(inner)), replace=False)
    step = 2 * BOX / 40
    place, normal = positions[chosen], normals[chosen]
    integrator = mi.load_dict({"type": "volpath", "max_depth": 4096, "rr_depth": 64})
    count, directions = len(chosen), DIRECTIONS if is_body else 1
    film = {"type": "hdrfilm", "width": 1, "height": 1, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    batches = np.zeros((BATCHES, count, 3))
    for batch, point in np.ndindex(BATCHES, count):
        for _ in range(directions):
            out = cosine(normal[point], rng) if is_body else normal[point]
            origin = place[point] + 1e-3 * step * rng.standard_normal(3) + 0.02 * step * out
            sensor = {"type": "radiancemeter", "origin": origin.tolist(), "direction": (-out).tolist(), "film": film}
            if not is_body:
                sensor["medium"] = of_medium
            seed = int(rng.integers(1 << 31))
            image = mi.render(scene_of_mitsuba, sensor=mi.load_dict(sensor), integrator=integrator,
                              spp=max(1, paths // (BATCHES * directions)), seed=seed)
            batches[batch, point] += np.array(image).reshape(3) / directions
    theirs, ours = batches.mean(axis=0), ours[chosen]
    noise = np.mean(batches.var(axis=0, ddof=1) / len(batches))
    mean, off = theirs.mean(), (ours - theirs).mean(axis=1)
    square = np.mean((ours - theirs) ** 2) - noise - np.mean(error[chosen].astype(np.float64) ** 2)
    percent = lambda value: f"{100 * value / mean:.2f}"  # noqa: E731
    print(name, count, f"{mean:.5f}", f"{ours.mean():.5f}", percent(ours.mean() - mean), percent(off.std(ddof=1) / np.sqrt(count)),
          percent(np.sqrt(max(square, 0))), percent(np.sqrt(noise)), sep=",", flush=True)


def smoke(n: int) -> np.ndarray:
    """Blobs of smoke at texel centres of [-1, 1] cubed, z by y by x, 0 towards the border."""
    centres = -BOX + 2 * BOX * (np.arange(n) + 0.5) / n
    z, y, x = np.meshgrid(centres, centres, centres, indexing="ij")
    wave = 0.5 + 0.5 * np.sin(5 * x + 1) * np.sin(4 * y + 2) * np.cos(6 * z)
    return (wave * np.clip(1 - (x * x + y * y + z * z), 0, None)).astype(np.float32)


def write_nrrd(path: Path, samples: np.ndarray) -> None:
    n, step = samples.shape[0], 2 * BOX / samples.shape[0]
    first = -BOX + 0.5 * step
    header = (f"NRRD0004\ntype: float\ndimension: 3\nsizes: {n} {n} {n}\nencoding: raw\nendian: little\n"
              f"space dimension: 3\nspace directions: ({step},0,0) (0,{step},0) (0,0,{step})\nspace origin: ({first},{first},{first})\n\n")
    path.write_bytes(header.encode() + samples.astype("<f4").tobytes())


def main() -> None:
    points = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    paths = int(sys.argv[2]) if len(sys.argv) > 2 else 4096
    isolume = os.environ.get("ISOLUME", "isolume")
    print("scene,points,mitsuba_mean,isolume_mean,difference_%,standard_error_%,rms_without_noise_%,mitsuba_noise_%")
    hg = "[medium]\nextinction = 1.5\nalbedo = 0.8\nphase = { hg = 0.5 }\n"
    measure("fog", isolume, hg, medium(1.5, 0.8, 0.5), points, paths)
    clouds = '[medium]\nfield = "smoke.nrrd"\nextinction = [[0, 0], [1, 6]]\nalbedo = 0.9\n'
    measure("smoke", isolume, clouds, medium(6.0 * smoke(GRID), 0.9, 0.0), points, paths)
    body = '[material]\nkind = "translucent"\nextinction = 8\nalbedo = 0.9\n'
    measure("wax 1.0", isolume, body, medium(8.0, 0.9, 0.0), points, paths)
    measure("wax 1.3", isolume, body + "index = 1.3\n", medium(8.0, 0.9, 0.0), points, paths)


if __name__ == "__main__":
    main()
