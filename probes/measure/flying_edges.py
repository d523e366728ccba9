"""VTK's flying edges on the volumes of `measure-bandwidth`, for comparison.

    python3 -m venv vtk && vtk/bin/pip install vtk numpy
    cargo run --release --example measure-bandwidth -- volumes DIRECTORY
    vtk/bin/python probes/measure/flying_edges.py DIRECTORY [REPETITIONS]

Reads each NAME.json (dims, dtype, isovalue) with NAME.raw beside it, which the Rust program writes, and prints CSV:
volume, threads, vertices, triangles, median wall and CPU milliseconds. No normals, gradients or scalars; the copy of
the samples into VTK is not timed. Each repetition makes the filter anew, so that its output is allocated again.
"""

import json
import statistics
import sys
import time
from pathlib import Path

import numpy
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkSMPTools
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D


def image(path: Path, about: dict) -> vtkImageData:
    samples = numpy.fromfile(path.with_suffix(".raw"), dtype=about["dtype"])
    data = vtkImageData()
    data.SetDimensions(*about["dims"])
    data.GetPointData().SetScalars(numpy_to_vtk(samples, deep=True))
    return data


def once(data: vtkImageData, isovalue: float) -> tuple:
    wall, cpu = time.perf_counter(), time.process_time()
    edges = vtkFlyingEdges3D()
    edges.SetInputData(data)
    edges.SetValue(0, isovalue)
    edges.ComputeNormalsOff()
    edges.ComputeGradientsOff()
    edges.ComputeScalarsOff()
    edges.Update()
    seconds = time.perf_counter() - wall, time.process_time() - cpu
    mesh = edges.GetOutput()
    return (*seconds, mesh.GetNumberOfPoints(), mesh.GetNumberOfPolys())


def main() -> None:
    folder = Path(sys.argv[1])
    repetitions = int(sys.argv[2]) if len(sys.argv) > 2 else 9
    backends = [b for b in ("STDThread", "TBB", "OpenMP") if vtkSMPTools.SetBackend(b)]
    runs = [("Sequential", 1)] + [(b, n) for b in backends[:1] for n in (1, 2)]
    print("volume,backend,threads,vertices,triangles,wall_ms,cpu_ms")
    for path in sorted(folder.glob("*.json")):
        about = json.loads(path.read_text())
        data = image(path, about)
        times = {run: [] for run in runs}
        for _ in range(repetitions):
            for backend, threads in runs:
                vtkSMPTools.SetBackend(backend)
                vtkSMPTools.Initialize(threads)
                times[backend, threads].append(once(data, about["isovalue"]))
        for (backend, threads), seen in times.items():
            wall, cpu = (1e3 * statistics.median(s[i] for s in seen) for i in (0, 1))
            print(f"{path.stem},{backend},{threads},{seen[0][2]},{seen[0][3]},{wall:.2f},{cpu:.2f}")


if __name__ == "__main__":
    main()
