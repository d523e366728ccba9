"""What `isolume relight --lightmap` wrote, read by trimesh, VTK and USD, against the plain file of the same surface.

    python tests/readers/assets_read.py PLAIN.glb PLAIN.ply LIGHTMAP.glb SURFACE.usdz

Exit code 0: everything holds.
"""

import json
import struct
import sys

import numpy as np
import trimesh
import vtk
from pxr import Usd, UsdGeom, UsdShade, UsdValidation
from scipy.spatial import cKDTree
from vtk.util.numpy_support import vtk_to_numpy

failures = 0


def check(holds, text):
    global failures
    failures += not holds
    print("ok  " if holds else "FAIL", text)


def extras(path):
    with open(path, "rb") as f:
        f.seek(12)
        length = struct.unpack("<I", f.read(4))[0]
        f.read(4)
        return json.loads(f.read(length))["asset"]["extras"]


plain, ply, lightmap, usdz = sys.argv[1:]

# trimesh: the colour of every vertex, from the picture at its place, against that of the PLY there.
expected = trimesh.load(ply, process=False)
world = np.asarray(expected.vertices)
colours = np.asarray(expected.visual.vertex_colors)[:, :3].astype(float)
scene = trimesh.load(lightmap, process=False)
mesh = trimesh.util.concatenate(scene.dump())
seen = np.asarray(mesh.visual.to_color().vertex_colors)[:, :3].astype(float)
# The PLY is in world and has the vertices of the plain file in the same order.
reference = trimesh.util.concatenate(trimesh.load(plain, process=False).dump())
check(len(reference.vertices) == len(world), f"trimesh reads {len(reference.vertices)} vertices of the plain file, {len(mesh.vertices)} with a picture")
distance, index = cKDTree(reference.vertices).query(mesh.vertices)
off = np.sqrt(((seen - colours[index]) ** 2).mean())
stated = 255 * extras(lightmap)["lightmap"]["colour_rms_srgb"]
check(distance.max() < 1e-6 and off < 2 * stated + 1.5, f"the picture has the colours of the vertices: RMS {off:.2f} of 255 by nearest texel, stated {stated:.2f} by interpolation")


def render(add):
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(0, 1, 0)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(400, 400)
    window.AddRenderer(renderer)
    add(renderer, window)
    return renderer, window


def pixels(window):
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.Update()
    return vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars()).astype(float)


def add_glb(renderer, window):
    importer = vtk.vtkGLTFImporter()
    importer.SetFileName(lightmap)
    importer.SetRenderWindow(window)
    importer.Update()


def add_ply(renderer, window):
    reader = vtk.vtkPLYReader()
    reader.SetFileName(ply)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(reader.GetOutputPort())
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().LightingOff()
    renderer.AddActor(actor)


def look(renderer, up, front):
    low_x, high_x, low_y, high_y, low_z, high_z = renderer.ComputeVisiblePropBounds()
    centre = np.array([low_x + high_x, low_y + high_y, low_z + high_z]) / 2
    camera = renderer.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetFocalPoint(*centre)
    camera.SetPosition(*(centre + 10 * max(high_x - low_x, high_z - low_z) * np.array(front)))
    camera.SetViewUp(*up)
    camera.SetParallelScale(0.6 * max(high_x - low_x, high_y - low_y, high_z - low_z))
    renderer.ResetCameraClippingRange()


# VTK: from the front, the PLY in world (z up, seen from anterior), the GLB in glTF (y up, anterior is +Z).
one, window_one = render(add_glb)
window_one.Render()
look(one, (0, 1, 0), (0, 0, 1))
glb = pixels(window_one)
two, window_two = render(add_ply)
window_two.Render()
look(two, (0, 0, 1), (0, 1, 0))
reference = pixels(window_two)
green = np.array([0, 255, 0])
both = ~((glb == green).all(1) | (reference == green).all(1))
means = glb[both].mean(), reference[both].mean()
apart = np.abs(glb[both] - reference[both]).mean()
check(both.sum() > 20000 and abs(means[0] - means[1]) < 2 and apart < 4, f"VTK shows it as the PLY: mean {means[0]:.1f} and {means[1]:.1f} of 255, a pixel {apart:.2f} apart")

# USD: read, and judged by all of its validators.
stage = Usd.Stage.Open(usdz)
surface = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Surface"))
found = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(stage)
check(not found, f"the validators of USD find nothing in the USDZ{''.join(': ' + e.GetMessage() for e in found)}")
points = np.array(surface.GetPointsAttr().Get())
places = UsdGeom.PrimvarsAPI(surface).GetPrimvar("st").Get()
material = UsdShade.MaterialBindingAPI(surface).ComputeBoundMaterial()[0]
check(len(points) == len(places) and bool(material) and UsdGeom.GetStageUpAxis(stage) == "Y", f"it has {len(points)} vertices with places in the picture, and a material")
box = UsdGeom.BBoxCache(0, ["default"]).ComputeWorldBound(stage.GetPrimAtPath("/Root")).ComputeAlignedRange()
sides = np.array(box.GetMax()) - np.array(box.GetMin())
check(np.allclose(sides, mesh.extents, rtol=1e-5), f"and is {' × '.join(f'{s:.3f}' for s in sides)} m as the GLB")
print("everything holds" if failures == 0 else f"{failures} checks failed")
sys.exit(failures > 0)
