"""Rays: Embree through embreex casts rays and writes them down; our suite `rays` casts the same ones."""

import numpy as np

from harness import WORK, markdown, median_seconds, sphere, suite, write_ply

ABOUT = "Ray casting against Embree 4.4, million rays a second on one thread"
NEEDS = ["numpy", "embreex"]

COUNT = 1 << 18


def camera_rays():
    """A pinhole camera of 512 x 512 at (0, 0, 3), 45 degrees, in tiles of 8 x 8."""
    at = np.arange(COUNT)
    tile, inside = at // 64, at % 64
    x, y = tile % 64 * 8 + inside % 8, tile // 64 * 8 + inside // 8
    half = np.tan(np.pi / 8)
    d = np.stack([((x + 0.5) / 256 - 1) * half, (1 - (y + 0.5) / 256) * half, -np.ones(COUNT)], -1)
    return np.tile([0, 0, 3.0], (COUNT, 1)), d / np.linalg.norm(d, axis=1, keepdims=True)


def chord_rays(random):
    """Chords of the sphere of radius 1.5 between two of its points."""
    ends = random.normal(size=(2, COUNT, 3))
    ends *= 1.5 / np.linalg.norm(ends, axis=2, keepdims=True)
    d = ends[1] - ends[0]
    return ends[0], d / np.linalg.norm(d, axis=1, keepdims=True)


def table():
    from embreex import rtcore_scene as rtcs
    from embreex.mesh_construction import TriangleMesh

    embree = {}
    for old in WORK.glob("*.ply"):
        old.unlink()
    for frequency in (16, 71, 224):
        vertices, triangles = sphere(frequency)
        name = f"sphere{len(triangles)}"
        write_ply(WORK / f"{name}.ply", vertices, triangles)
        scene = rtcs.EmbreeScene()
        TriangleMesh(scene, vertices, triangles)
        random = np.random.default_rng(1)
        for kind, (o, d) in (("camera", camera_rays()), ("chord", chord_rays(random))):
            o, d = o.astype(np.float32), d.astype(np.float32)
            found = scene.run(o, d, output=1)
            t = np.where(found["primID"] < 0, -1, found["tfar"]).astype("<f4")
            rays = np.concatenate([o, d, np.zeros((COUNT, 1)), np.full((COUNT, 1), np.inf)], 1).astype("<f4")
            rays.tofile(WORK / f"rays_{name}_{kind}.bin")
            hits = np.empty(COUNT, [("t", "<f4"), ("id", "<i4")])
            hits["t"], hits["id"] = t, found["primID"]
            hits.tofile(WORK / f"hits_{name}_{kind}.bin")
            closest = median_seconds(lambda: scene.run(o, d))
            occluded = median_seconds(lambda: scene.run(o, d, query="OCCLUDED"))
            embree[name, kind] = COUNT / closest / 1e6, COUNT / occluded / 1e6
    report = suite("rays", PHOTOFIT_BENCH_RAYS=WORK)
    rows = []
    for (name, kind), (closest, occluded) in embree.items():
        rows.append([name.removeprefix("sphere"), kind, closest, occluded])
    ours = (WORK.parents[1] / "rays.md").read_text().split("\n", 1)[1].strip()
    head = ["triangles", "rays", "closest hit, Embree", "occlusion, Embree"]
    note = "Embree's rates hold the copies between its Python binding and the caller's arrays, one ray at a time."
    return f"{markdown(head, rows)}\n\n{note}\n\nOurs, the same rays ({len(report['rows'])} rows):\n\n{ours}"
