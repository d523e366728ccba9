"""What `isolume export` and `relight` wrote, read by VTK and pynrrd and compared number by number.

    python tests/readers/vtk_reads.py VTI NRRD RAW GLB PLY

All of one store under one light; the GLB with --radiance, relit from the same texture. Linear against linear. Exit
code 0: everything holds.
"""

import json
import struct
import sys

import nrrd
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

failures = 0


def check(holds, text):
    global failures
    failures += not holds
    print("ok  " if holds else "FAIL", text)


def arrays(data):
    return {data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)) for i in range(data.GetNumberOfArrays())}


def glb_json(path):
    with open(path, "rb") as f:
        f.seek(12)
        length = struct.unpack("<I", f.read(4))[0]
        f.read(4)
        return json.loads(f.read(length))


vti, nrrd_file, raw, glb, ply = sys.argv[1:]

reader = vtk.vtkXMLImageDataReader()
reader.SetFileName(vti)
reader.Update()
image = reader.GetOutput()
dims = image.GetDimensions()
data = arrays(image.GetPointData())
check(set(data) == {"radiance", "colour", "value", "valid"}, f"VTI: arrays {sorted(data)} on {dims}")

grid, header = nrrd.read(nrrd_file)  # (3, x, y, z)
flat = grid.reshape(3, -1, order="F").T
check(np.array_equal(flat, data["radiance"]), "NRRD holds the same radiance as VTI")
detached, head = nrrd.read(raw.replace(".raw", ".nhdr"))
rgba = detached.reshape(4, -1, order="F").T
check(np.array_equal(rgba[:, :3], data["radiance"]) and np.array_equal(rgba[:, 3] == 1, data["valid"] == 1),
      "raw RGBA with its header too; alpha says where a level set is")
matrix = np.array([[image.GetDirectionMatrix().GetElement(r, c) for c in range(3)] for r in range(3)])
steps = matrix * np.array(image.GetSpacing())  # columns
check(np.allclose(header["space directions"][1:].T, steps, rtol=1e-12, atol=1e-12)
      and np.allclose(header["space origin"], image.GetOrigin(), rtol=1e-12), "both stand at the same place in world")
exposure = 2.0 ** json.loads(open(nrrd_file, "rb").read(4000).split(b"\n")[1][2:])["exposure_ev"]
linear = np.clip(data["radiance"] * exposure, 0, 1)
signal = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
check(np.abs(signal * 255 - data["colour"]).max() <= 0.51, "VTI colours are its exposed radiance in sRGB")

# The mesh, by VTK's glTF reader, against the volume.
gltf = vtk.vtkGLTFReader()
gltf.SetFileName(glb)
gltf.ApplyDeformationsToGeometryOff()
gltf.Update()
blocks = gltf.GetOutput().NewIterator()
mesh = None
while not blocks.IsDoneWithTraversal():
    mesh = blocks.GetCurrentDataObject()
    blocks.GoToNextItem()
points = arrays(mesh.GetPointData())
position = vtk_to_numpy(mesh.GetPoints().GetData()).astype(float)
document = glb_json(glb)
node = next(n for n in document["nodes"] if "mesh" in n)
in_world = position + np.array(node["extras"]["centre_in_world"])
# The reader knows the attributes of the specification alone; those with an underscore are read from the buffer.
radiance = points.get("_RADIANCE")
if radiance is None:
    index = document["meshes"][0]["primitives"][0]["attributes"]["_RADIANCE"]
    view = document["bufferViews"][document["accessors"][index]["bufferView"]]
    bytes_ = open(glb, "rb").read()
    start = 20 + struct.unpack("<I", bytes_[12:16])[0] + 8 + view["byteOffset"]
    radiance = np.frombuffer(bytes_, "<f4", view["byteLength"] // 4, start).reshape(-1, 3)
colour = points["COLOR_0"].astype(float)
if colour.max() > 1.5:
    colour /= 65535.0
exposure = 2.0 ** document["asset"]["extras"]["exposure_ev"]
# What has a negative channel moves towards the grey of its luminance.
grey, least = radiance @ np.array([0.2126, 0.7152, 0.0722]), radiance.min(axis=1)
kept = np.where(least < 0, np.where(grey > 0, grey / np.where(least < 0, grey - least, 1), 0), 1)[:, None]
shown = np.where(least[:, None] < 0, np.maximum(grey, 0)[:, None] + kept * (radiance - grey[:, None]), radiance)
shown[(least < 0) & (grey <= 0)] = 0
difference = np.abs(colour[:, :3] - np.clip(shown * exposure, 0, 1)).max()
check(difference <= 1 / 65535, f"glTF: COLOR_0 of {len(colour)} vertices is exposed radiance, largest difference {difference:.1e}")

cloud = vtk.vtkPolyData()
where = vtk.vtkPoints()
where.SetData(numpy_to_vtk(in_world, deep=True))
cloud.SetPoints(where)
probe = vtk.vtkProbeFilter()
probe.SetInputData(cloud)
probe.SetSourceData(image)
# Where a corner was filled the program renormalises instead: those vertices are left out.
valid = numpy_to_vtk((data["valid"] == 1).astype(np.float32), deep=True)
valid.SetName("whole")
image.GetPointData().AddArray(valid)
probe.Update()
found = arrays(probe.GetOutput().GetPointData())
whole = (found["vtkValidPointMask"] == 1) & (found["whole"] > 0.9999)
difference = np.abs(found["radiance"] - radiance)[whole].max() / radiance.mean()
check(whole.mean() > 0.5 and difference < 1e-4,
      f"VTK's interpolation of the VTI is the radiance of the glTF at {whole.sum()} of {len(whole)} vertices, within {difference:.1e} of the mean")

# A contour made by VTK, coloured from the same file.
isovalue = document["asset"]["extras"]["isovalue"]
contour = vtk.vtkContourFilter()
contour.SetInputData(image)
contour.SetInputArrayToProcess(0, 0, 0, vtk.vtkDataObject.FIELD_ASSOCIATION_POINTS, "value")
contour.SetValue(0, isovalue)
contour.Update()
coloured = arrays(contour.GetOutput().GetPointData())
means = coloured["radiance"].mean(), radiance.mean()
# It is a contour of the lattice, which may be coarser than the data: the same surface only roughly.
check(abs(means[0] / means[1] - 1) < 0.15,
      f"VTK's contour of {contour.GetOutput().GetNumberOfPoints()} points carries radiance, mean {means[0]:.4f}; ours {means[1]:.4f}")

plys = vtk.vtkPLYReader()
plys.SetFileName(ply)
plys.Update()
rgb = arrays(plys.GetOutput().GetPointData())["RGB"].astype(float)
linear = np.clip(shown * exposure, 0, 1)
signal = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
check(len(rgb) == len(signal) and np.abs(rgb - 255 * signal).max() <= 0.51, "PLY: colours of every vertex in sRGB")

print(f"{vtk.vtkVersion.GetVTKSourceVersion()}: " + ("everything holds" if failures == 0 else f"{failures} checks failed"))
sys.exit(failures != 0)
