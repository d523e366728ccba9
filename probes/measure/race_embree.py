"""Embree's single-ray intersect on the rays and the mesh that `measure-race --out DIR` has written.

    python -m pip install embreex numpy
    python race_embree.py DIR [REPETITIONS]

One thread, processor time, median of the repetitions; and how far its hits agree with ours: Embree
sees the triangles, we see the trilinear level set, and rays leave the surface at another angle to each.
"""

import sys
import time

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

# Voxels along the ray: Embree would hit the triangle where the ray starts.
OFFSET = 1e-3


def main() -> None:
    folder = sys.argv[1]
    repetitions = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    read = lambda name, kind: np.fromfile(f"{folder}/{name}", kind)
    vertices = read("vertices.f32", np.float32).reshape(-1, 3)
    triangles = read("triangles.u32", np.uint32).astype(np.int32).reshape(-1, 3)
    scene = EmbreeScene()
    mesh = TriangleMesh(scene, vertices, triangles)
    print("order,rays,median_ns_cpu,least_ns_cpu,hit_share,agree_on_hit,median_distance_difference")
    for order in ["scattered", "texel"]:
        origins = read(f"{order}.origins.f32", np.float32).reshape(-1, 3)
        directions = read(f"{order}.directions.f32", np.float32).reshape(-1, 3)
        ours = read(f"{order}.distances.f32", np.float32)
        start = (origins + OFFSET * directions).astype(np.float32)
        scene.run(start[:1], directions[:1], query="DISTANCE")  # builds the tree
        times = []
        for _ in range(repetitions):
            clock = time.thread_time_ns()
            distances = scene.run(start, directions, query="DISTANCE")
            times.append((time.thread_time_ns() - clock) / len(start))
        hits, own = distances < 1e30, np.isfinite(ours)
        both = hits & own
        difference = np.median(np.abs(distances[both] + OFFSET - ours[both])) if both.any() else float("nan")
        print(
            f"{order},{len(start)},{np.median(times):.1f},{min(times):.1f},{hits.mean():.3f},"
            f"{(hits == own).mean():.4f},{difference:.5f}"
        )
    del mesh


if __name__ == "__main__":
    main()
