"""Shares of the triangles (`ratios`) in Blender Cycles as the judge has it."""

import ratios
from driver_judge import Cycles, blender, terms
from ratios import PEERS, ready  # noqa: F401 (what a driver has)
from reducers import version

ABOUT = "Shares of the triangles in Blender Cycles: ours with the asset's own textures, gltfpack, gltf-transform"
NEEDS = ["numpy", "scipy", "bpy", "flip-evaluator"]


def versions():
    return [*map(version, PEERS), blender()]


def table():
    return ratios.table(Cycles, terms(), blender())
