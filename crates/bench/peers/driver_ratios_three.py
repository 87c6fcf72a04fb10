"""Shares of the triangles (`ratios`) in three.js (`in_three`)."""

import in_cycles
import in_three
import ratios
from driver_judge import ENVIRONMENT, HERE, SIZE, VIEWS, as_glb, blender, digest_of, found, kept
from ratios import PEERS
from reducers import version

ABOUT = "Shares of the triangles in three.js: ours with the asset's own textures, gltfpack, gltf-transform"
NEEDS = ["numpy", "scipy", "bpy", "flip-evaluator"]


def ready():
    return ratios.ready() or in_three.lacking()


def versions():
    return [*map(version, PEERS), in_three.version()]


class Three:
    """How files are judged by three.js."""

    suffix = ".three.json"

    @staticmethod
    def judge():
        settings = {"views": VIEWS, "size": SIZE, "per axis": in_three.PER_AXIS, "code": in_three.code()}
        return {**settings, "environment": digest_of(found(ENVIRONMENT)), "by": in_three.version(), "sphere": blender()}

    @staticmethod
    def figures(name, path, shown):
        truth, around = Three.reference(name, path)
        count = in_cycles.triangles(in_cycles.load(shown))
        seen = in_three.pictures(shown, found(ENVIRONMENT), VIEWS, SIZE, around)
        return {"views": in_three.likeness(truth, seen), "triangles": count}

    @staticmethod
    def reference(name, path):
        """Pictures of the asset and the sphere that cameras look at; kept."""

        def draw():
            around = in_cycles.sphere(in_cycles.load(path))
            seen = in_three.pictures(as_glb(name, path), found(ENVIRONMENT), VIEWS, SIZE, around, in_three.PER_AXIS)
            return {"seen": seen, "around": around}

        seen, around, _ = kept(HERE / f"{name}-reference.three.npz", {"asset": digest_of(path), "judge": Three.judge()}, draw)
        return seen, around


def table():
    terms = (
        f"{VIEWS} views of {SIZE} x {SIZE} pixels, one sample a pixel ({in_three.PER_AXIS} x {in_three.PER_AXIS} of the reference), under"
        f" {ENVIRONMENT} and a sun by turns, without shadows."
    )
    return ratios.table(Three, terms, in_three.version())
