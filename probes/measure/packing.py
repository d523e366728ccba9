"""What packing a store costs and gains, read with zarr-python alone: bytes a texel, error, and the largest error under random lights.

    python probes/measure/packing.py PLAIN.isolume PACKED.isolume [LIGHTS] >> packing.csv

Both are read by the recipe of FORMAT.md. Lights are random directions in the space of coefficients, of norm 1; albedos 0.3 and 0.7.
"""
import os
import sys

import numpy as np
import zarr

BRICKS = 4


def size(folder):
    return sum(os.path.getsize(os.path.join(at, f)) for at, _, files in os.walk(folder) for f in files if f != "zarr.json")


def chunks_of(env):
    z, y, x = [-(-n // 32) for n in env.shape[:3]]
    return [(i, j, k) for i in range(z) for j in range(y) for k in range(x)]


def by_brick(block):
    """A chunk [z, y, x, …], padded to 32³, in the order of its bricks."""
    pad = [(0, 32 - n) for n in block.shape[:3]] + [(0, 0)] * (block.ndim - 3)
    fill = np.nan if block.dtype.kind == "f" else 0
    block = np.pad(block, pad, constant_values=fill)
    split = block.reshape((4, 8, 4, 8, 4, 8) + block.shape[3:])
    return np.moveaxis(split, (0, 2, 4), (0, 1, 2)).reshape((-1,) + block.shape[3:])


def main():
    plain_path, packed_path = sys.argv[1:3]
    lights = int(sys.argv[3]) if len(sys.argv) > 3 else 10_000
    plain, packed = (zarr.open_group(p, mode="r") for p in (plain_path, packed_path))
    name = next(iter(plain["transfer"].group_keys()))
    a, b = plain[f"transfer/{name}/env"], packed[f"transfer/{name}/env"]
    packing, layers = b.attrs["packing"], a.attrs["layers"]
    counts = [layer["bands"] ** 2 for layer in layers]
    weight = np.repeat(packing["layer_weights"], counts)
    was, now = [], []
    for c, (k, j, i) in enumerate(chunks_of(a["transfer"])):
        valid = (b["validity"][8 * c:8 * c + 8].ravel() & 16) != 0
        if not valid.any():
            continue
        here = np.s_[32 * k:32 * k + 32, 32 * j:32 * j + 32, 32 * i:32 * i + 32]
        was.append(by_brick(a["transfer"][here])[valid].astype("f8"))
        q = 256 * b["high"][8 * c:8 * c + 8].astype("i4") + b["low"][8 * c:8 * c + 8]
        q = np.moveaxis(q, 1, 2).reshape(-1, len(weight))[: valid.sum()]
        now.append((q * packing["step"] / weight).astype("f2").astype("f8"))
    was, now = np.concatenate(was), np.concatenate(now)
    assert np.isfinite(was).all()
    lost = (now - was) * weight
    error = np.sqrt((lost ** 2).sum() / ((was * weight) ** 2).sum())
    # Under a light, radiance changes by a sum over layers: fold them, once for each albedo.
    bands = max(counts)
    rng = np.random.default_rng(1)
    worst = {}
    for albedo in (0.3, 0.7):
        folded = np.zeros((len(was), bands))
        for layer, n in zip(range(len(counts)), counts):
            at = layers[layer]["offset"]
            folded[:, :n] += albedo ** (layer + 1) * (now - was)[:, at:at + n]
        most = 0.0
        for _ in range(lights // 100):
            light = rng.standard_normal((bands, 100))
            most = max(most, np.abs(folded @ (light / np.linalg.norm(light, axis=0))).max())
        worst[albedo] = most
    texels = len(was)
    planes = size(f"{packed_path}/transfer/{name}/env/low") + size(f"{packed_path}/transfer/{name}/env/high")
    whole = [sum(size(f"{p}/transfer/{name}/env/{n}") for n in g.array_keys()) for p, g in ((plain_path, a), (packed_path, b))]
    print(",".join(map(str, [
        os.path.basename(packed_path), texels, packing["asked"], f"{error:.6f}", f"{packing['measured']:.6f}",
        f"{planes / texels:.2f}", f"{whole[1] / texels:.2f}", f"{whole[0] / texels:.2f}", f"{packing['step']:.6g}",
        lights, f"{worst[0.3]:.5f}", f"{worst[0.7]:.5f}", f"{packing['largest']:.5f}", f"{packing['bound']:.5f}"])))
    assert worst[0.7] <= packing["largest"] * (1 + 1e-9) <= packing["bound"] * (1 + 1e-9) and worst[0.3] <= packing["bound"]


if __name__ == "__main__":
    main()
