"""Other programs that make an asset lighter: functions of its path, a budget of triangles and the file to write."""

import functools
import json
import os
import pathlib
import shutil
import subprocess
import sys

import in_cycles
from harness import ROOT, first_line

#: Programs of peers: their variable, or what PATH or package.json's folder finds.
TOOLS = {"gltfpack": "PHOTOFIT_GLTFPACK", "gltf-transform": "PHOTOFIT_GLTF_TRANSFORM", "node": "PHOTOFIT_NODE"}


class Refused(Exception):
    """A program that made nothing, and why."""


def tool(name):
    """The path of a peer; None where it is not installed."""
    places = [os.environ.get("PATH", ""), str(ROOT / "target" / "peers" / "node_modules" / ".bin")]
    return os.environ.get(TOOLS[name]) or shutil.which(name, path=os.pathsep.join(places))


@functools.cache
def version(name):
    """A peer with its version."""
    found = first_line(tool(name), {"gltfpack": "-v"}.get(name, "--version"))
    return found if found.startswith(name) else f"{name} {found or 'of an unknown version'}"


def unpinned():
    """The peers that are installed at another version than that of package.json, in words."""
    pins = json.loads(pathlib.Path(__file__).with_name("package.json").read_text())["dependencies"]
    wanted = {package.removeprefix("@").removesuffix("/cli"): pin for package, pin in pins.items()}
    # gltfpack leaves out the last number where it is 0.
    return [f"{name} {pin}" for name, pin in wanted.items() if tool(name) and not pin.startswith(version(name).split()[-1])]


def quiet(*command):
    """Runs a peer; `Refused` where it refuses."""
    name = pathlib.Path(command[0]).name
    try:
        done = subprocess.run(list(map(str, command)), stdout=subprocess.DEVNULL)
    except OSError as e:
        raise Refused(f"{name} does not start: {e.strerror}") from e
    if done.returncode:
        raise Refused(f"{name} ended with {done.returncode}")


def decimated(path, budget, out):
    """By Blender's Decimate modifier, which keeps materials and texture coordinates."""
    import bpy

    meshes = in_cycles.load(path)
    share = budget / in_cycles.triangles(meshes)
    for thing in meshes:
        # Of a few triangles the modifier leaves none.
        if len(thing.data.polygons) >= 20:
            thing.modifiers.new("decimate", "DECIMATE").ratio = share
    with in_cycles.quiet():
        bpy.ops.export_scene.gltf(filepath=str(out), export_format="GLB", export_apply=True)


def packed(path, budget, out, *flags):
    """By gltfpack, which looks at attributes, beyond the usual limit of the error."""
    share = budget / in_cycles.triangles(in_cycles.load(path))
    quiet(tool("gltfpack"), "-noq", "-si", share, "-se", "1", "-sv", *flags, "-i", path, "-o", out)


def transformed(path, ratio, out):
    """By gltf-transform, vertices welded before; a share of the triangles."""
    welded = out.with_suffix(".welded.glb")
    quiet(tool("gltf-transform"), "weld", path, welded)
    quiet(tool("gltf-transform"), "simplify", welded, out, "--ratio", ratio, "--error", 1)
    welded.unlink()


def by_quadrics(path, budget, out):
    """By the edge collapses of MeshLab, which know texture coordinates; of an asset of one mesh and at most one texture."""
    import bpy

    meshes = in_cycles.load(path)
    if len(meshes) != 1:
        raise Refused(f"{len(meshes)} meshes, of which MeshLab would have to be told one by one")
    folder = out.with_suffix(".obj-files")
    folder.mkdir(exist_ok=True)
    # Positions and texture coordinates apart, so that seams stay closed.
    heavy, light = str(folder / "heavy.obj"), str(folder / "light.obj")
    with in_cycles.quiet():
        bpy.ops.wm.obj_export(filepath=heavy, export_triangulated_mesh=True, path_mode="COPY")
    textured = bool(meshes[0].data.uv_layers)
    script = pathlib.Path(__file__).with_name("meshlab_collapse.py")
    command = [sys.executable, script, heavy, light, budget, "textured" if textured else "plain"]
    done = subprocess.run(list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    # Below zero: it crashed.
    if done.returncode in (1, 2):
        raise RuntimeError(done.stderr)
    if done.returncode:
        why = " ".join(done.stderr.split()[:30]) or f"ended with {done.returncode}"
        raise Refused(f"MeshLab: {why}")
    materials = list(meshes[0].data.materials)
    placed = with_materials(light, materials, textured)
    with in_cycles.quiet():
        bpy.ops.object.select_all(action="DESELECT")
        placed.select_set(True)
        bpy.ops.export_scene.gltf(filepath=str(out), export_format="GLB", use_selection=True)
    shutil.rmtree(folder)


def with_materials(obj, materials, textured):
    """The mesh of an OBJ file with these materials in place of its own, shaded smooth where it has no normals of its own."""
    import bpy

    before = set(bpy.data.objects)
    with in_cycles.quiet():
        bpy.ops.wm.obj_import(filepath=obj)
    (placed,) = [o for o in bpy.data.objects if o not in before and o.type == "MESH"]
    placed.data.materials.clear()
    for material in materials[:1]:
        placed.data.materials.append(material)
    if not textured:
        for layer in list(placed.data.uv_layers):
            placed.data.uv_layers.remove(layer)
    placed.data.shade_smooth()
    return placed
