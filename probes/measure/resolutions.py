#!/usr/bin/env python3
"""How far the radiance of vertices is from that of a finer surface of the same model.

    isolume relight M.toml:48 ... --radiance -o coarse.ply
    isolume relight M.toml:192 ... --radiance -o fine.ply
    python3 probes/measure/resolutions.py coarse.ply fine.ply 192

Each vertex of the coarse surface is compared with the mean of those of the fine one nearer than 1.5 of its voxels, weighted by
exp(-(2 d / 1.5 voxels)^2); the voxel is the longest side of the surface over 192. Prints median, 95th percentile and RMS, relative
to the mean, and the RMS without the worst hundredth.
"""

import math
import struct
import sys
from collections import defaultdict

TYPES = {"float": "f", "uchar": "B", "double": "d", "uint": "I", "int": "i", "ushort": "H"}


def read(path):
    """Positions, and the mean of the channels of radiance."""
    data = open(path, "rb").read()
    end = data.index(b"end_header\n") + 11
    layout, names, count, of_vertex = "<", [], 0, False
    for words in map(str.split, data[:end].decode("utf8", "replace").splitlines()):
        if words[0] == "element":
            of_vertex = words[1] == "vertex"
            count = int(words[2]) if of_vertex else count
        elif words[0] == "property" and of_vertex:
            layout += TYPES[words[1]]
            names.append(words[2])
    places = [names.index(axis) for axis in "xyz"]
    channels = [i for i, name in enumerate(names) if name.startswith("radiance")]
    rows = [struct.unpack_from(layout, data, end + i * struct.calcsize(layout)) for i in range(count)]
    return [([row[i] for i in places], sum(row[i] for i in channels) / len(channels)) for row in rows]


def main(coarse, fine, samples):
    coarse, fine = read(coarse), read(fine)
    side = max(max(p[a] for p, _ in fine) - min(p[a] for p, _ in fine) for a in range(3))
    reach = 1.5 * side / int(samples)
    cells = defaultdict(list)
    cell = lambda p: tuple(int(x // reach) for x in p)
    for vertex in fine:
        cells[cell(vertex[0])].append(vertex)
    around = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    errors, total, lost = [], 0.0, 0
    for place, value in coarse:
        at = cell(place)
        near = [v for d in around for v in cells.get(tuple(a + b for a, b in zip(at, d)), ())]
        near = [(math.dist(place, q), radiance) for q, radiance in near]
        near = [(math.exp(-((2 * d / reach) ** 2)), radiance) for d, radiance in near if d < reach]
        if not near:
            lost += 1
            continue
        reference = sum(w * radiance for w, radiance in near) / sum(w for w, _ in near)
        errors.append(abs(value - reference))
        total += reference
    errors.sort()
    mean, count = total / len(errors), len(errors)
    rms = lambda list: math.sqrt(sum(e * e for e in list) / len(list))
    found = [errors[count // 2], errors[count * 95 // 100], rms(errors), rms(errors[: count - count // 100])]
    print(f"{count} vertices, {lost} without neighbours;",
          "median, 95 %%, RMS, without the worst 1 %%: %.2f, %.2f, %.2f, %.2f %%" % tuple(100 * e / mean for e in found))


main(*sys.argv[1:])
