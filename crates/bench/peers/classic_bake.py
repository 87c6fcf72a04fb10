"""The classic way to a light asset: all meshes joined and decimated, unwrapped anew, and what the asset looks like baked onto
that by Cycles, from rays along its normals.
"""

import numpy as np

import in_cycles
from reducers import Refused

#: Rays of a texel.
SAMPLES = 4
#: Texels beyond the borders of charts.
MARGIN = 16
#: Angle between faces of one chart, radians, and the gap between charts, share of the atlas.
UNWRAP = {"angle_limit": 1.15, "island_margin": 0.004}
#: How far rays begin off the light surface: so that this share of the asset's vertices lies below, at most a share of the diagonal.
ENCLOSED, FARTHEST = 99.9, 0.02
#: Maps as Cycles bakes emission: the socket of the surface that is shown as one, and its value where nothing is to be baked.
EMITTED = {"color": ("Base Color", None), "metallic": ("Metallic", 0), "alpha": ("Alpha", 1), "glow": ("Emission Strength", 0)}


def baked(path, budget, out, size=1024):
    """A mesh of at most `budget` triangles with maps of `size` texels a side, as large as ours."""
    import bpy

    heavy = in_cycles.load(path)
    share = budget / in_cycles.triangles(heavy)
    light = joined(heavy)
    modifier = light.modifiers.new("decimate", "DECIMATE")
    modifier.ratio = share
    select([light])
    with in_cycles.quiet():
        bpy.ops.object.modifier_apply(modifier=modifier.name)
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.uv.smart_project(**UNWRAP)
        bpy.ops.object.mode_set(mode="OBJECT")
    maps = bake_all(heavy, light, size)
    light.data.materials.clear()
    light.data.materials.append(material_of(maps, size))
    select([light])
    with in_cycles.quiet():
        bpy.ops.export_scene.gltf(filepath=str(out), export_format="GLB", use_selection=True, export_tangents=False)


def select(things):
    """Selects these alone; the last is the active one."""
    import bpy

    for thing in bpy.context.view_layer.objects:
        thing.select_set(thing in things)
    bpy.context.view_layer.objects.active = things[-1]


def joined(meshes):
    """One mesh in world space, without the splits at seams of texture coordinates and normals."""
    import bmesh
    import bpy

    whole = bmesh.new()
    for thing in meshes:
        data = thing.data.copy()
        data.transform(thing.matrix_world)
        if thing.matrix_world.determinant() < 0:
            data.flip_normals()
        whole.from_mesh(data)
        bpy.data.meshes.remove(data)
    bmesh.ops.triangulate(whole, faces=whole.faces)
    points = np.array([v.co for v in whole.verts])
    bmesh.ops.remove_doubles(whole, verts=whole.verts, dist=1e-6 * float(np.ptp(points, 0).max()))
    data = bpy.data.meshes.new("light")
    whole.to_mesh(data)
    whole.free()
    for layers in data.uv_layers, data.color_attributes:
        while layers:
            layers.remove(layers[0])
    data.shade_smooth()
    light = bpy.data.objects.new("light", data)
    bpy.context.scene.collection.objects.link(light)
    bpy.context.view_layer.update()
    return light


def cage(heavy, light):
    """How far rays begin off the light surface."""
    from mathutils.bvhtree import BVHTree

    corners = [v.co for v in light.data.vertices]
    tree = BVHTree.FromPolygons(corners, [list(p.vertices) for p in light.data.polygons])
    distances = [tree.find_nearest(thing.matrix_world @ v.co)[3] for thing in heavy for v in thing.data.vertices]
    diagonal = float(np.linalg.norm(np.ptp(np.array(corners), 0)))
    return min(float(np.percentile(distances, ENCLOSED)), FARTHEST * diagonal)


def bake_all(heavy, light, size):
    """The maps, float32 (size, size, 4): normal, roughness, and those of EMITTED that some material has."""
    import bpy

    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", SAMPLES, False
    settings = scene.render.bake
    settings.use_selected_to_active, settings.margin, settings.cage_extrusion = True, MARGIN, cage(heavy, light)
    canvas = bpy.data.materials.new("canvas")
    canvas.use_nodes = True
    node = canvas.node_tree.nodes.new("ShaderNodeTexImage")
    canvas.node_tree.nodes.active = node
    light.data.materials.clear()
    light.data.materials.append(canvas)
    surfaces = [(m, *principled(m)) for m in {s.material for thing in heavy for s in thing.material_slots} if m]

    def bake(kind):
        node.image = bpy.data.images.new(kind, size, size, float_buffer=True, is_data=True)
        select([*heavy, light])
        with in_cycles.quiet():
            bpy.ops.object.bake(type=kind)
        pixels = np.empty(size * size * 4, np.float32)
        node.image.pixels.foreach_get(pixels)
        return pixels.reshape(size, size, 4)

    maps = {"normal": bake("NORMAL"), "roughness": bake("ROUGHNESS")}
    for name, (socket, neutral) in EMITTED.items():
        if not any(differs(surface.inputs[socket], neutral) for _, surface, _ in surfaces):
            continue
        for material, surface, end in surfaces:
            strength = surface.inputs[socket] if name == "glow" else None
            show(material.node_tree, surface.inputs["Emission Color" if name == "glow" else socket], end, strength)
        maps[name] = bake("EMIT")
    return filled(maps)


def differs(socket, neutral):
    """Whether a surface has another value than this there."""
    return neutral is None or socket.is_linked or socket.default_value != neutral


def filled(maps):
    """The maps without holes: where a ray met nothing or a back, whose normal points inwards, what the nearest one met that did."""
    from scipy.ndimage import distance_transform_edt

    missed = maps["normal"][..., 2] < 0.5
    if not missed.all():
        rows, columns = distance_transform_edt(missed, return_distances=False, return_indices=True)
        maps = {name: pixels[rows, columns] for name, pixels in maps.items()}
    return maps


def principled(material):
    """The surface of a material and where it ends."""
    nodes = material.node_tree.nodes if material.use_nodes else []
    surface = next((n for n in nodes if n.type == "BSDF_PRINCIPLED"), None)
    end = next((n for n in nodes if n.type == "OUTPUT_MATERIAL" and n.is_active_output), None)
    if not surface or not end:
        raise Refused(f"{material.name} is no metallic-roughness material")
    return surface, end


def show(tree, socket, end, strength):
    """Lets a material emit what goes into a socket."""
    emit = tree.nodes.new("ShaderNodeEmission")
    if socket.is_linked:
        tree.links.new(socket.links[0].from_socket, emit.inputs["Color"])
    else:
        value = socket.default_value
        emit.inputs["Color"].default_value = [value] * 3 + [1] if isinstance(value, float) else list(value)
    if strength is not None:
        emit.inputs["Strength"].default_value = strength.default_value
    tree.links.new(emit.outputs[0], end.inputs["Surface"])


def material_of(maps, size):
    """The material that shows the maps."""
    import bpy

    material = bpy.data.materials.new("baked")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = nodes["Principled BSDF"]

    def texture(name, pixels, data):
        image = bpy.data.images.new(name, size, size, alpha=True, is_data=data)
        if not data:
            image.colorspace_settings.name = "sRGB"
            pixels = np.concatenate([in_cycles.encoded(pixels[..., :3]), pixels[..., 3:]], -1)
        image.pixels.foreach_set(np.ascontiguousarray(np.clip(pixels, 0, 1), np.float32).ravel())
        image.pack()
        node = nodes.new("ShaderNodeTexImage")
        node.image = image
        return node

    color = maps["color"].copy()
    color[..., 3] = maps["alpha"][..., 0] if "alpha" in maps else 1
    base = texture("color", color, False)
    links.new(base.outputs["Color"], surface.inputs["Base Color"])
    if "alpha" in maps:
        # The exporter reads a rounded alpha as a mask.
        cut = nodes.new("ShaderNodeMath")
        cut.operation = "ROUND"
        links.new(base.outputs["Alpha"], cut.inputs[0])
        links.new(cut.outputs[0], surface.inputs["Alpha"])
    both = np.ones_like(color)
    both[..., 1], both[..., 2] = maps["roughness"][..., 0], maps["metallic"][..., 0] if "metallic" in maps else 0
    apart = nodes.new("ShaderNodeSeparateColor")
    links.new(texture("roughness and metalness", both, True).outputs["Color"], apart.inputs[0])
    links.new(apart.outputs["Green"], surface.inputs["Roughness"])
    links.new(apart.outputs["Blue"], surface.inputs["Metallic"])
    bent = nodes.new("ShaderNodeNormalMap")
    links.new(texture("normal", maps["normal"], True).outputs["Color"], bent.inputs["Color"])
    links.new(bent.outputs[0], surface.inputs["Normal"])
    if "glow" in maps:
        links.new(texture("glow", maps["glow"], False).outputs["Color"], surface.inputs["Emission Color"])
        surface.inputs["Emission Strength"].default_value = 1
    return material
