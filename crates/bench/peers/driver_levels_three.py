"""A chain of levels of detail in three.js (`in_three`), each at the size that it is for, beside peers at as many triangles.

Assets and environment are those of `ratios`; what is made stands in out/bench/peers/work/levels, under keys as in `judge`. The reference has many
samples a pixel, all else one, the asset itself too (`original`): what is beyond that is aliasing.
"""

import json

import numpy as np

import classic_bake
import in_cycles
import in_three
import ratios
from driver_judge import ENVIRONMENT, VIEWS, as_glb, blender, digest_of, found, functions_of, how, kept, likeness, made
from harness import WORK, markdown, our_version, program
from in_cycles import display
from ratios import PEERS, within
from reducers import packed, quiet, tool, transformed, version

ABOUT = "A chain of levels of detail in three.js at the sizes that they are for, beside peers at as many triangles"
NEEDS = ["numpy", "scipy", "bpy", "flip-evaluator"]

#: Pixels on screen, triangles, and samples a side of a pixel of the reference.
LEVELS = [(512, 3000, 4), (128, 800, 16), (32, 200, 16)]
#: By how much the picture moves where flicker is measured, pixels.
SHIFT = 0.5
LUMINANCE = [0.2126, 0.7152, 0.0722]
HERE = WORK / "levels"


def ready():
    return ratios.ready() or in_three.lacking()


def versions():
    return [*map(version, PEERS), blender(), in_three.version()]


class Level:
    """How files are judged at a size."""

    def __init__(self, size, per_axis):
        self.size, self.per_axis, self.suffix = size, per_axis, f".{size}.json"

    def judge(self):
        settings = {"views": VIEWS, "size": self.size, "per axis": self.per_axis, "shift": SHIFT, "code": in_three.code(), "how": how(Level)}
        return {**settings, "environment": digest_of(found(ENVIRONMENT)), "by": in_three.version()}

    def pair(self, path, around, per_axis):
        """Pictures as they are, and moved."""
        draw = lambda shift: in_three.pictures(path, found(ENVIRONMENT), VIEWS, self.size, around, per_axis, shift)
        return np.stack([draw(0), draw(SHIFT)])

    def reference(self, name, path):
        def draw():
            around = in_cycles.sphere(in_cycles.load(path))
            return {"seen": self.pair(as_glb(name, path), around, self.per_axis), "around": around}

        key = {"asset": digest_of(path), "judge": self.judge()}
        seen, around, _ = kept(HERE / f"{name}-reference.{self.size}.npz", key, draw)
        return seen, around

    def figures(self, name, path, shown):
        truth, around = self.reference(name, path)
        seen = self.pair(shown, around, 1)
        change = lambda pair: np.abs(display(pair[1]) - display(pair[0])).mean()
        light = lambda pair: (pair[0][..., :3] @ LUMINANCE).mean()
        return {
            "views": in_three.likeness(truth[0], seen[0]),
            "triangles": in_cycles.triangles(in_cycles.load(shown)),
            "flicker": float(change(seen) / change(truth)),
            "luminance": float(light(seen) / light(truth)),
        }


def chain(path, out):
    """All levels of ours, from the first file on."""
    sizes, triangles, _ = zip(*LEVELS)
    listed = lambda numbers: ",".join(map(str, numbers))
    program("simplify", path, "-o", out, "--lod", listed(sizes), "--lod-triangles", listed(triangles), "--seed", 0)


def level(path, number, out):
    """A level of ours, of a chain that is made once for all of them."""
    folder = out.parent.parent / f"{path.stem}-chain"
    folder.mkdir(parents=True, exist_ok=True)
    first, mark = folder / "chain.glb", folder / "chain.key"
    key = json.dumps({"asset": digest_of(path), "by": our_version(), "how": how(chain)})
    if not mark.exists() or mark.read_text() != key:
        mark.unlink(missing_ok=True)
        chain(path, first)
        mark.write_text(key)
    out.write_bytes((folder / ("chain.glb" if number == 0 else f"chain.lod{number}.glb")).read_bytes())


def copied(path, out):
    """The asset itself, in one file."""
    quiet(tool("gltf-transform"), "copy", path, out)


def table():
    rows = []
    for path in ratios.assets():
        name, glb = path.stem, as_glb(path.stem, path)
        share = lambda most: most / in_cycles.triangles(in_cycles.load(path))
        for number, (size, most, per_axis) in enumerate(LEVELS):
            bake = functions_of(classic_bake)
            ways = {
                "original": (version("gltf-transform"), (copied,), lambda out: copied(glb, out)),
                "ours": (our_version(), (chain, level), lambda out: level(path, number, out)),
                "gltfpack -sv -sp": (version("gltfpack"), (packed, within), lambda out: within(most, lambda out: packed(glb, most, out, "-sp"), out)),
                "gltf-transform": (version("gltf-transform"), (transformed, within), lambda out: within(most, lambda out: transformed(glb, share(most), out), out)),
                "bake": (blender(), (*bake, within), lambda out: within(most, lambda out: classic_bake.baked(path, most, out), out)),
            }
            for way, (maker, code, make) in ways.items():
                key = {"asset": digest_of(path), "size": size, "triangles": most, "by": maker, "how": how(*code)}
                figures = made(name, path, HERE / f"{name}-{most}", way, key, make, Level(size, per_axis))
                if "views" not in figures:
                    rows.append([name, size, way, "-", "-", "-", "-", "-"])
                else:
                    told = [f"{figures['flicker']:.2f}", f"{figures['luminance']:.3f}"]
                    rows.append([name, size, way, figures["triangles"], *likeness(figures), *told])
                print(rows[-1], flush=True)
    head = ["asset", "pixels", "way", "triangles", "PSNR (worst view)", "FLIP", "flicker", "luminance"]
    return (
        f"{VIEWS} views under {ENVIRONMENT} and a sun by turns, without shadows, one sample a pixel, by {in_three.version()}, beside the asset with"
        f" {', '.join(f'{n} x {n} at {size} pixels' for size, _, n in LEVELS)}. Flicker: the mean change of the picture, as a screen shows it, when it moves by"
        f" {SHIFT} pixels, over that of the reference. Luminance: linear, over that of the reference. A dash: the tool writes nothing, or more than"
        f" {ratios.OVER} times the budget.\n\n{markdown(head, rows)}"
    )
