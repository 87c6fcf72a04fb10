"""The judge: light assets beside the heavy one in Blender Cycles, which knows nothing of us."""

import math
import os
import shutil
import subprocess

import numpy as np

from harness import WORK, markdown, program

ABOUT = "Light assets in Blender Cycles: ours, by Blender's Decimate modifier, by gltfpack"
NEEDS = ["numpy", "bpy", "flip-evaluator"]

VIEWS = 8
SIZE = 256
RATIO = 0.1


def assets():
    """The .glb files that PHOTOFIT_PEER_ASSETS names, separated by colons."""
    return list(filter(None, os.environ.get("PHOTOFIT_PEER_ASSETS", "").split(":")))


def ready():
    """There is nothing to judge without assets."""
    return None if assets() else "PHOTOFIT_PEER_ASSETS=A.glb:B.glb names no assets"


def stage():
    """An empty Blender file with Cycles, an even sky and a sun."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.seed = 64, False, 1
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.55, 0.6, 1)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 2.0, (0.7, 0.2, 0.4)
    scene.collection.objects.link(sun)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene, camera


def bounds():
    """Centre and radius of the meshes in the file."""
    import bpy
    import mathutils

    corners = [o.matrix_world @ mathutils.Vector(c) for o in bpy.data.objects if o.type == "MESH" for c in o.bound_box]
    points = np.array(corners)
    low, high = points.min(0), points.max(0)
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2)


def pictures(path, frame=None):
    """VIEWS pictures (float32, RGB over grey), and the frame (centre, radius) that they were taken in."""
    import bpy
    import mathutils

    scene, camera = stage()
    bpy.ops.import_scene.gltf(filepath=str(path))
    center, radius = frame or bounds()
    camera.data.angle = 0.7
    out = []
    for k in range(VIEWS):
        # Directions that no fit chose: turns by the golden angle, heights from below to above.
        z, turn = -0.35 + 1.2 * (k + 0.5) / VIEWS, 2.399963 * k
        side = math.sqrt(1 - z * z)
        direction = mathutils.Vector((side * math.cos(turn), side * math.sin(turn), z))
        camera.location = mathutils.Vector(center) + direction * (radius / math.sin(0.35))
        camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
        file = WORK / "judge.png"
        scene.render.filepath = str(file)
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(str(file))
        pixels = np.array(image.pixels[:], np.float32).reshape(SIZE, SIZE, 4)
        bpy.data.images.remove(image)
        out.append(np.ascontiguousarray(pixels[..., :3] * pixels[..., 3:] + 0.5 * (1 - pixels[..., 3:])))
    return out, (center, radius)


def decimated(path, out):
    """The asset by Blender's Decimate modifier, which keeps materials and texture coordinates."""
    import bpy

    stage()
    bpy.ops.import_scene.gltf(filepath=str(path))
    for thing in [o for o in bpy.data.objects if o.type == "MESH"]:
        if len(thing.data.polygons) >= 20:
            thing.modifiers.new("decimate", "DECIMATE").ratio = RATIO
    bpy.ops.export_scene.gltf(filepath=str(out), export_format="GLB", export_apply=True)


def packed(path, out):
    """The asset by gltfpack, which looks at attributes; False where it is not installed."""
    tool = os.environ.get("PHOTOFIT_GLTFPACK") or shutil.which("gltfpack")
    if not tool:
        return False
    # Attributes weigh, across seams and beyond the usual limit of the error, as far as the budget asks for.
    subprocess.run([tool, "-noq", "-si", str(RATIO), "-se", "1", "-sp", "-sv", "-i", path, "-o", out], check=True)
    return True


def triangles(path):
    import bpy

    stage()
    bpy.ops.import_scene.gltf(filepath=str(path))
    return sum(len(o.data.polygons) for o in bpy.data.objects if o.type == "MESH")


def table():
    import flip_evaluator

    rows = []
    for path in map(str, assets()):
        name = path.rsplit("/", 1)[-1]
        ours, theirs = WORK / f"judge-{name}", WORK / f"judge-decimated-{name}"
        light, pack = WORK / f"judge-light-{name}", WORK / f"judge-packed-{name}"
        program("simplify", path, "-o", ours, "--ratio", RATIO, "--seed", 0)
        decimated(path, theirs)
        made = [("ours", ours), ("Blender Decimate", theirs)]
        if packed(path, pack):
            made.append(("gltfpack", pack))
        # At as many bytes as the smallest of the others.
        most = min(file.stat().st_size for _, file in made[1:])
        program("simplify", path, "-o", light, "--ratio", RATIO, "--seed", 0, "--max-bytes", most)
        made.insert(1, ("ours, as many bytes", light))
        truth, frame = pictures(path)
        for tool, file in made:
            shown, _ = pictures(file, frame)
            psnr = float(np.mean([-10 * np.log10(((a - b) ** 2).mean()) for a, b in zip(shown, truth)]))
            flip = [flip_evaluator.evaluate(a, b, "LDR", applyMagma=False)[1] for a, b in zip(truth, shown)]
            rows.append([name, tool, triangles(file), file.stat().st_size >> 10, f"{psnr:.2f}", f"{float(np.mean(flip)):.4f}"])
    head = ["asset", "made by", "triangles", "KiB", "PSNR, dB", "FLIP"]
    return f"{markdown(head, rows)}\n\n{VIEWS} views of {SIZE} x {SIZE} pixels under an even sky and a sun, 64 samples."
