"""The same image lights an exported file from the same side as in Blender.

    python tests/readers/blender_reads.py [FOLDER]

FOLDER (default target/orientation) holds what tests/browser/orientation.mjs leaves: NAME-IMAGE.glb, lit by IMAGE.hdr. Each file
is imported; then Cycles bakes the light of the image on the same surface, white and diffuse, into its vertices. The mean
normals, weighted by radiance, must agree within 2°. Needs bpy (PyPI) and numpy.
"""

import pathlib
import sys

import bpy
import numpy as np

LIMIT = 2.0  # degrees
folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "target/orientation")


def mean_normal(mesh, colours):
    """Mean of the vertex normals in world, weighted by area and by the colours at the vertices."""
    points = np.empty(3 * len(mesh.data.vertices))
    mesh.data.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3) @ np.array(mesh.matrix_world)[:3, :3].T
    mesh.data.calc_loop_triangles()
    corners = np.empty(3 * len(mesh.data.loop_triangles), dtype="i4")
    mesh.data.loop_triangles.foreach_get("vertices", corners)
    corners = corners.reshape(-1, 3)
    a, b, c = (points[corners[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)  # twice the area long
    weights = colours[corners].mean(axis=1)
    total = (normals * weights[:, None]).sum(axis=0)
    return total / np.linalg.norm(total)


def at_vertices(mesh, attribute):
    """Green of a colour attribute at the vertices."""
    values = np.empty(4 * len(attribute.data), dtype="f4")
    attribute.data.foreach_get("color", values)
    green = values.reshape(-1, 4)[:, 1].astype("f8")
    if attribute.domain == "POINT":
        return green
    vertex = np.empty(len(mesh.data.loops), dtype="i4")
    mesh.data.loops.foreach_get("vertex_index", vertex)
    sums, counts = (np.bincount(vertex, w, len(mesh.data.vertices)) for w in (green, None))
    return sums / np.maximum(counts, 1)


def light_with(image):
    """The world lit by a lat-long image, its pixels as they are."""
    world = bpy.data.worlds.new("world")
    bpy.context.scene.world = world
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load(str(image))
    texture.interpolation = "Closest"
    background = next(n for n in nodes if n.type == "BACKGROUND")
    links.new(texture.outputs["Color"], background.inputs["Color"])


def diffuse():
    material = bpy.data.materials.new("white")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    shader, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (1, 1, 1, 1)
    links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    return material


failures = 0
files = sorted(folder.glob("*-*.glb"))
for path in files:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(path.resolve()))
    mesh = next(o for o in bpy.context.scene.objects if o.type == "MESH")
    baked = mean_normal(mesh, at_vertices(mesh, mesh.data.color_attributes[0]))
    light_with((folder / f"{path.stem.split('-')[1]}.hdr").resolve())
    mesh.data.materials.clear()
    mesh.data.materials.append(diffuse())
    mesh.data.color_attributes.new("baked", "FLOAT_COLOR", "POINT")
    mesh.data.color_attributes.active_color = mesh.data.color_attributes["baked"]
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 64
    scene.render.bake.target = "VERTEX_COLORS"
    bpy.context.view_layer.objects.active = mesh
    mesh.select_set(True)
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"})
    lit = mean_normal(mesh, at_vertices(mesh, mesh.data.color_attributes["baked"]))
    apart = np.degrees(np.arccos(np.clip(baked @ lit, -1, 1)))
    holds = bool(apart < LIMIT)
    failures += not holds
    print(f"{'ok  ' if holds else 'FAIL'} {path.name}: {apart:.2f} degrees from Blender {bpy.app.version_string}")
if not files:
    print(f"FAIL no .glb in {folder}: run tests/browser/orientation.mjs first")
sys.exit(1 if failures or not files else 0)
