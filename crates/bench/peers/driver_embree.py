"""Rays: `embree_rays.cpp` casts them through the Embree that embreex brings, our suite `rays` casts the same ones."""

import glob
import importlib.util
import pathlib
import shutil
import subprocess

import numpy as np

from harness import WORK, compiled, markdown, sphere, suite_by_cpu, write_ply

ABOUT = "Ray casting against Embree 4.4, million rays a second of CPU time on one thread"
NEEDS = ["numpy", "embreex"]

FOLDER = WORK / "rays"
KINDS = ["camera", "bounce", "chord"]
MODES = ["medium", "high", "robust"]
# Cells along a side of the ground, and its half width in radii of what stands on it.
CELLS, WIDTH = 60, 400


def ready():
    return None if shutil.which("c++") else "no C++ compiler (c++)"


def library():
    """The Embree that comes with embreex."""
    package = pathlib.Path(importlib.util.find_spec("embreex").origin).parent
    return glob.glob(str(package.parent / "embreex.libs" / "libembree4*"))[0]


def on_ground():
    """A sphere on uneven ground, 400 times as wide and coarse."""
    vertices, triangles = sphere(71)
    x, z = np.meshgrid(*[np.linspace(-WIDTH, WIDTH, CELLS + 1)] * 2, indexing="ij")
    ground = np.stack([x, 0.3 * np.sin(x) * np.cos(z) - 1, z], -1).reshape(-1, 3)
    i, j = (a.reshape(-1) for a in np.meshgrid(*[np.arange(CELLS)] * 2, indexing="ij"))
    at = lambda i, j: len(vertices) + i * (CELLS + 1) + j
    halves = [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]]
    faces = np.concatenate([np.stack(half, -1) for half in halves])
    return np.concatenate([vertices, ground.astype(np.float32)]), np.concatenate([triangles, faces.astype(np.int32)])


def slivers(count=40_000):
    """Triangles without order, hundreds of times as long as wide, that cross each other."""
    random = np.random.default_rng(5)
    a = random.normal(size=(count, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b, c = a + 0.5 * random.normal(size=(count, 3)), a + 0.002 * random.normal(size=(count, 3))
    return np.stack([a, b, c], 1).reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def meshes():
    """Name, mesh, and the side of the camera's picture: that squared is the number of rays of each kind."""
    for frequency in (16, 71, 224):
        yield "sphere", sphere(frequency), 512
    yield "sphere on ground", on_ground(), 512
    yield "slivers", slivers(), 64


def unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def camera_rays(side):
    """A pinhole camera at (0, 0, 3), 45 degrees, in tiles of 8 x 8 pixels."""
    at = np.arange(side * side)
    tile, inside = at // 64, at % 64
    x, y = tile % (side // 8) * 8 + inside % 8, tile // (side // 8) * 8 + inside // 8
    half = np.tan(np.pi / 8)
    d = np.stack([((x + 0.5) * 2 / side - 1) * half, (1 - (y + 0.5) * 2 / side) * half, -np.ones(side * side)], -1)
    return np.tile([0, 0, 3.0], (side * side, 1)), unit(d)


def chord_rays(random, count):
    """Chords of the sphere of radius 1.5 between two of its points."""
    ends = random.normal(size=(2, count, 3))
    ends *= 1.5 / np.linalg.norm(ends, axis=2, keepdims=True)
    return ends[0], unit(ends[1] - ends[0])


def bounce_rays(random, vertices, triangles, o, d):
    """From where camera rays hit, in cosine-weighted directions about the normal of the side that they see."""
    from embreex import rtcore_scene as rtcs
    from embreex.mesh_construction import TriangleMesh

    scene = rtcs.EmbreeScene()
    TriangleMesh(scene, vertices, triangles)
    found = scene.run(o.astype(np.float32), d.astype(np.float32), output=1)
    at = np.resize(np.flatnonzero(found["primID"] >= 0), len(o))
    corners = vertices[triangles[found["primID"][at]]].astype(float)
    normal = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) + 1e-30)
    normal *= -np.sign((normal * d[at]).sum(1, keepdims=True))
    start = o[at] + d[at] * found["tfar"][at, None] + 1e-4 * normal
    return start, unit(normal + unit(random.normal(size=(len(o), 3))) * 0.999)


def cast(name, vertices, triangles, side):
    """Embree's figures: (what, mode, kind) -> numbers. The rays and its hits lie in the folder afterwards."""
    write_ply(FOLDER / f"{name}.ply", vertices, triangles)
    random = np.random.default_rng(1)
    camera = camera_rays(side)
    rays = [camera, bounce_rays(random, vertices, triangles, *camera), chord_rays(random, side * side)]
    for kind, (o, d) in zip(KINDS, rays):
        limits = np.tile([0, np.inf], (len(o), 1))
        np.concatenate([o, d, limits], 1).astype("<f4").tofile(FOLDER / f"rays_{name}_{kind}.bin")
    command = [compiled("embree_rays.cpp", "-std=c++17"), library(), FOLDER, name, *KINDS]
    lines = subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True).stdout.splitlines()
    out = {}
    for what, mode, *rest in map(str.split, lines):
        out[(what, mode, *rest[:-3])] = list(map(float, rest[-3:]))
    return out


def table():
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir()
    embree, names = {}, {}
    for name, (vertices, triangles), side in meshes():
        names[len(triangles)] = name
        embree[len(triangles)] = cast(f"{name.replace(' ', '-')}{len(triangles)}", vertices, triangles, side)
    ours = suite_by_cpu("rays", PHOTOFIT_BENCH_RAYS=FOLDER)
    tables, notes, apart = [], [], 0
    for column, query in enumerate(["closest", "occlusion"]):
        rows = []
        for count, name in names.items():
            for kind in KINDS:
                figures = ours[f"{query}, 1 thread(s)", f"{count}, {kind}"]["figures"]
                apart = max(apart, int(figures["rays with another hit"]))
                rate = figures["Mray/s"]
                theirs = [embree[count]["cast", mode, kind] for mode in MODES]
                single = [t[column] for t in theirs]
                packets = [max(t[2] for t in theirs)] if query == "closest" else []
                rows.append([f"{count:,}, {name}", kind, rate, *single, *packets, rate / single[0], rate / max(single)])
        head = ["mesh", "rays", f"{query}, ours", *(f"Embree {mode}" for mode in MODES)]
        head += ["packets of 16, best mode"] if query == "closest" else []
        tables.append(markdown([*head, "ours / medium", "ours / best single"], rows))
        worst = min(rows, key=lambda row: row[-2])
        notes.append(f"{query}: worst {worst[-2]:.2f} of medium, {worst[0]}, {worst[1]}")
    builds = [
        [f"{count:,}, {name}", 1e3 * ours["build, all threads", f"{count} triangles"]["seconds"]]
        + [embree[count]["build", mode][0] for mode in MODES]
        for count, name in names.items()
    ]
    tables.append(markdown(["mesh", "build, CPU ms, ours", *(f"Embree {mode}" for mode in MODES)], builds))
    notes.append(
        f"modes are build quality medium, high, and medium with the robust flag; {apart} rays at most have another hit than"
        " Embree medium's; times are CPU seconds, one program after the other"
    )
    return "\n\n".join([*tables, "; ".join(notes) + "."])
