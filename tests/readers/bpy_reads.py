"""Reads a .glb with Blender's module and says what arrived: vertices, triangles, colours."""

import sys

import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=sys.argv[1])
meshes = [thing.data for thing in bpy.data.objects if thing.type == "MESH"]
assert meshes, "no mesh arrived"
for mesh in meshes:
    colours = mesh.color_attributes
    assert len(colours) >= 1, "no vertex colours arrived"
    values = [value for point in colours[0].data for value in point.color[:3]]
    assert all(0.0 <= value < 1e6 for value in values) and max(values) > 0.05, "the colours are no light"
    print(f"{mesh.name}: {len(mesh.vertices)} vertices, {len(mesh.polygons)} triangles, {colours[0].name}")
