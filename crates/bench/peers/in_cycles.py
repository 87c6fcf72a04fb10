"""Assets in Blender Cycles beside a reference: cameras and lights that no fit chose, and how far the pictures differ.

Cameras look from a Fibonacci sphere at the reference's bounding sphere. Every other view is lit by an environment, scaled
so that a white matte sphere has a mean of .7, the others by a sun within 20 to 60 degrees of the camera and a weak even
light. Each view is rendered twice with half of the samples, and PSNR is taken of the mean of (C1 - R1) (C2 - R2), in sRGB: the variance of
Monte Carlo noise drops out of it. What stays is that the mean of a noisy colour moves where sRGB bends and clips. FLIP is of the mean of
both and holds noise. Both are means over the foreground.
"""

import contextlib
import math
import os
import pathlib
import sys
import tempfile

import numpy as np

#: Grey of sRGB behind the asset.
BACKGROUND = 0.5
#: How far the foreground reaches beyond both silhouettes, pixels.
MARGIN = 6
FIELD_OF_VIEW = math.radians(40)
#: The reference has this many times the samples of a candidate.
REFERENCE_FACTOR = 2


@contextlib.contextmanager
def quiet():
    """Blender logs to the descriptor of the output."""
    sys.stdout.flush()
    keep, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(keep, 1)
        os.close(keep)
        os.close(null)


def load(path):
    """The meshes of a file in a Blender file that holds nothing else; what has no normals is shaded smooth."""
    import bpy

    path = str(path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with quiet():
        if path.endswith((".gltf", ".glb")):
            bpy.ops.import_scene.gltf(filepath=path, disable_bone_shape=True)
        elif path.endswith(".obj"):
            bpy.ops.wm.obj_import(filepath=path)
        else:
            bpy.ops.wm.ply_import(filepath=path, forward_axis="NEGATIVE_Z", up_axis="Y")
    for thing in [o for o in bpy.data.objects if o.type in ("CAMERA", "LIGHT")]:
        bpy.data.objects.remove(thing)
    bpy.context.view_layer.update()
    meshes = [o for o in bpy.context.view_layer.objects if o.type == "MESH" and len(o.data.polygons)]
    for thing in meshes:
        if path.endswith(".ply"):
            thing.data.shade_smooth()
        if not thing.data.materials:
            thing.data.materials.append(clay())
    bpy.context.view_layer.update()
    return meshes


def clay():
    import bpy

    material = bpy.data.materials.get("clay") or bpy.data.materials.new("clay")
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"].inputs
    surface["Base Color"].default_value, surface["Roughness"].default_value = (0.5, 0.5, 0.5, 1), 0.5
    return material


def triangles(meshes):
    for thing in meshes:
        thing.data.calc_loop_triangles()
    return sum(len(thing.data.loop_triangles) for thing in meshes)


def sphere(meshes):
    """Centre of the bounding box, and the distance of the farthest vertex from it."""
    import bpy

    graph = bpy.context.evaluated_depsgraph_get()
    points = []
    for thing in meshes:
        data = thing.evaluated_get(graph).data
        found = np.empty(len(data.vertices) * 3, np.float32)
        data.vertices.foreach_get("co", found)
        place = np.array(thing.matrix_world)
        points.append(found.reshape(-1, 3) @ place[:3, :3].T + place[:3, 3])
    points = np.concatenate(points)
    center = (points.min(0) + points.max(0)) / 2
    return center.tolist(), float(np.sqrt(((points - center) ** 2).sum(1).max()))


def views(count, seed=7):
    """Of each view the direction of the camera, and that of the sun, None where the environment shines."""
    random, out = np.random.default_rng(seed), []
    for k in range(count):
        z, turn = 1 - 2 * (k + 0.5) / count, k * math.pi * (3 - math.sqrt(5)) + 0.4
        eye = np.array([math.sqrt(1 - z * z) * math.cos(turn), math.sqrt(1 - z * z) * math.sin(turn), z])
        aside = random.normal(size=3)
        aside -= aside.dot(eye) * eye
        angle = math.radians(random.uniform(20, 60))
        sun = eye * math.cos(angle) + aside / np.linalg.norm(aside) * math.sin(angle)
        out.append((eye, sun if k % 2 else None))
    return out


def worlds(environment):
    """The environment, and the even light beside the sun."""
    import bpy

    world = bpy.data.worlds.new("environment")
    world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    out, light, picture = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("OutputWorld", "Background", "TexEnvironment"))
    picture.image = image = bpy.data.images.load(str(environment))
    pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    rows = (pixels.reshape(image.size[1], image.size[0], 4)[..., :3] @ np.array([0.2126, 0.7152, 0.0722], np.float32)).mean(1)
    share = np.sin((np.arange(image.size[1]) + 0.5) / image.size[1] * math.pi)
    light.inputs["Strength"].default_value = float(0.7 / ((rows * share).sum() / share.sum()))
    tree.links.new(picture.outputs["Color"], light.inputs["Color"])
    tree.links.new(light.outputs[0], out.inputs[0])
    even = bpy.data.worlds.new("even")
    even.use_nodes = True
    inputs = even.node_tree.nodes["Background"].inputs
    inputs["Color"].default_value, inputs["Strength"].default_value = (1, 1, 1, 1), 0.06
    return world, even


def settings(scene, size, samples):
    scene.render.engine = "CYCLES"
    c, r = scene.cycles, scene.render
    c.device, c.samples, c.use_denoising, c.use_adaptive_sampling = "CPU", samples, False, False
    c.max_bounces, c.diffuse_bounces, c.glossy_bounces, c.transmission_bounces, c.transparent_max_bounces = 4, 2, 2, 4, 12
    c.caustics_reflective = c.caustics_refractive = False
    c.sample_clamp_indirect, c.pixel_filter_type, c.filter_width = 5.0, "BLACKMAN_HARRIS", 1.5
    r.resolution_x = r.resolution_y = size
    r.film_transparent, r.use_persistent_data, r.use_compositing, r.use_sequencer = True, True, False, False
    s = r.image_settings
    s.file_format, s.color_mode, s.color_depth, s.exr_codec = "OPEN_EXR", "RGBA", "32", "NONE"
    scene.view_settings.view_transform = "Standard"


def pictures(path, environment, count, size, samples, seed, around=None):
    """Radiance, premultiplied, float32 (2, count, size, size, 4), rows from the top; the sphere that the cameras look at, which
    `around` gives for candidates; triangles."""
    import bpy
    from mathutils import Vector

    meshes = load(path)
    around = around or sphere(meshes)
    scene = bpy.context.scene
    settings(scene, size, samples // 2)
    sky, even = worlds(environment)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    for thing in (camera, sun):
        scene.collection.objects.link(thing)
    scene.camera, sun.data.energy, sun.data.angle = camera, 2.6, math.radians(3)
    camera.data.sensor_fit, camera.data.angle = "HORIZONTAL", FIELD_OF_VIEW
    center, distance = Vector(around[0]), around[1] / math.sin(FIELD_OF_VIEW / 2) * 1.01
    camera.data.clip_start, camera.data.clip_end = distance * 0.01, distance * 4
    along = lambda direction: Vector(direction).to_track_quat("Z", "Y").to_euler()
    out = np.zeros((2, count, size, size, 4), np.float32)
    with tempfile.TemporaryDirectory() as folder:
        for k, (eye, light) in sorted(enumerate(views(count)), key=lambda v: v[1][1] is not None):
            scene.world, sun.hide_render = (sky, True) if light is None else (even, False)
            sun.rotation_euler = along(eye if light is None else light)
            camera.location, camera.rotation_euler = center + Vector(eye) * distance, along(eye)
            for half in range(2):
                scene.cycles.seed = seed * 1000 + k * 2 + half + 1
                scene.render.filepath = file = str(pathlib.Path(folder) / f"{k}-{half}.exr")
                with quiet():
                    bpy.ops.render.render(write_still=True)
                image = bpy.data.images.load(file)
                image.colorspace_settings.name = "Linear Rec.709"
                pixels = np.empty(size * size * 4, np.float32)
                image.pixels.foreach_get(pixels)
                out[half, k] = pixels.reshape(size, size, 4)[::-1]
                bpy.data.images.remove(image)
    return out, around, triangles(meshes)


def display(image):
    """sRGB over the background."""
    behind = ((BACKGROUND + 0.055) / 1.055) ** 2.4
    return encoded(image[..., :3] + (1 - image[..., 3:]) * behind)


def encoded(linear):
    """sRGB of linear light, float32."""
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)


def likeness(reference, candidate):
    """PSNR and FLIP of each view, of pictures as :func:`pictures` gives them."""
    import flip_evaluator
    from scipy.ndimage import binary_dilation

    out = []
    for k in range(reference.shape[1]):
        r, c = reference[:, k], candidate[:, k]
        seen = binary_dilation((r.mean(0)[..., 3] > 0.02) | (c.mean(0)[..., 3] > 0.02), iterations=MARGIN)
        error = ((display(c[0]) - display(r[0])) * (display(c[1]) - display(r[1]))).mean(-1)[seen].mean()
        flip = flip_evaluator.evaluate(display(r.mean(0)), display(c.mean(0)), "LDR", applyMagma=False, computeMeanError=False)[0]
        out.append((float(-10 * np.log10(max(error, 1e-6))), float(np.asarray(flip)[..., 0][seen].mean())))
    return out
