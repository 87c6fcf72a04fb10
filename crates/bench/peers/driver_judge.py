"""The judge: light assets beside the heavy one in Blender Cycles, which knows nothing of us; at equal triangles and at equal bytes.

`PHOTOFIT_JUDGE_ASSETS` names a folder in which the files of ROWS are looked for, at any depth, and ENVIRONMENT. What is made
stands in out/bench/peers/work/judge, one folder a row: files, figures and references that are there are not made again.
`PHOTOFIT_JUDGE_ROWS=YcbBanana:500,spot:bytes` makes some rows alone; the table has all that stand there.
"""

import json
import os
import pathlib
import shutil
import subprocess

import numpy as np

import in_cycles
from harness import WORK, markdown, program

ABOUT = "Light assets in Blender Cycles: ours, by Blender's Decimate modifier, by gltfpack, by gltf-transform"
NEEDS = ["numpy", "scipy", "bpy", "flip-evaluator"]

ENVIRONMENT = "venice_sunset_1k.hdr"
#: File and budgets of triangles; `bytes` is the budget that gltf-transform (lossy WebP) and gltfpack (meshopt) come to.
ROWS = {
    "DamagedHelmet": ("DamagedHelmet.glb", [500, 1545, "bytes"]),
    "FlightHelmet": ("FlightHelmet.gltf", [947, 2842, "bytes"]),
    "DutchShipMedium": ("dutch_ship_medium_1k.gltf", [2075]),
    "YcbBanana": ("textured_simple_reoriented.obj", [500]),
    "igea": ("igea.ply", [9000, 3000]),
    "spot": ("spot.obj", ["bytes"]),
}
VIEWS = 8
SIZE = 512
SAMPLES = 16
HERE = WORK / "judge"
#: Programs of peers: their variable, or what PATH finds.
TOOLS = {"gltfpack": "PHOTOFIT_GLTFPACK", "gltf-transform": "PHOTOFIT_GLTF_TRANSFORM", "node": "PHOTOFIT_NODE"}


def tool(name):
    return os.environ.get(TOOLS[name]) or shutil.which(name)


def found(file):
    """A file of the folder of assets; None where it is not there."""
    folder = os.environ.get("PHOTOFIT_JUDGE_ASSETS")
    return next(iter(sorted(pathlib.Path(folder).rglob(file))), None) if folder else None


def wanted():
    """The rows that are asked for and whose assets are there: name, file, budget."""
    only = list(filter(None, os.environ.get("PHOTOFIT_JUDGE_ROWS", "").split(",")))
    rows = [(name, found(file), budget) for name, (file, budgets) in ROWS.items() for budget in budgets]
    return [(n, f, b) for n, f, b in rows if f and (not only or f"{n}:{b}" in only)]


def ready():
    """There is nothing to judge without assets and light."""
    if not wanted() or not found(ENVIRONMENT):
        return f"PHOTOFIT_JUDGE_ASSETS=FOLDER has none of the assets that are asked for, or no {ENVIRONMENT}"
    return None


def once(path, make):
    """Makes a file under another name and gives it its own when it is complete, unless it is there; whether it is."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name("part-" + path.name)
        if make(part) is False:
            return False
        part.rename(path)
    return True


def quiet(*command):
    """Runs a peer; an error where it refuses."""
    subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)


def as_glb(name, path):
    """The asset as a GLB file that all peers read."""
    if path.suffix in (".glb", ".gltf"):
        return path
    out = HERE / f"{name}.glb"

    def export(part):
        import bpy

        in_cycles.load(path)
        with in_cycles.quiet():
            bpy.ops.export_scene.gltf(filepath=str(part), export_format="GLB")

    once(out, export)
    return out


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
    """By gltfpack, which looks at attributes, beyond the usual limit of the error; False where it is missing."""
    if not tool("gltfpack"):
        return False
    share = budget / in_cycles.triangles(in_cycles.load(path))
    quiet(tool("gltfpack"), "-noq", "-si", share, "-se", "1", "-sv", *flags, "-i", path, "-o", out)


def compressed(path, out):
    """All triangles, textures as lossy WebP by gltf-transform, geometry by gltfpack."""
    webp = out.with_suffix(".webp.glb")
    quiet(tool("gltf-transform"), "webp", path, webp)
    quiet(tool("gltfpack"), "-c", "-i", webp, "-o", out)
    webp.unlink()


def uncompressed(path, out):
    """The same file without meshopt compression, which Blender does not read."""
    script = pathlib.Path(__file__).parent / "judge" / "plain.mjs"
    quiet(tool("node"), script, pathlib.Path(tool("gltf-transform")).resolve(), path, out)


def reference(name, path):
    """Pictures of the asset and what its candidates are seen like; kept."""
    kept = HERE / f"{name}-reference.npz"

    def render(part):
        seen, around, count = in_cycles.pictures(path, found(ENVIRONMENT), VIEWS, SIZE, SAMPLES * in_cycles.REFERENCE_FACTOR, 0)
        with open(part, "wb") as file:
            np.savez_compressed(file, seen=seen.astype(np.float16), center=around[0], radius=around[1], triangles=count)

    once(kept, render)
    held = np.load(kept)
    return held["seen"].astype(np.float32), (held["center"].tolist(), float(held["radius"])), int(held["triangles"])


def judged(name, path, file, shown):
    """The figures of a file, whose geometry stands in `shown` without compression; kept."""
    kept = file.with_suffix(".json")

    def measure(part):
        truth, around, _ = reference(name, path)
        seen, _, count = in_cycles.pictures(shown, found(ENVIRONMENT), VIEWS, SIZE, SAMPLES, 1, around)
        part.write_text(json.dumps({"views": in_cycles.likeness(truth, seen), "triangles": count, "bytes": file.stat().st_size}))

    once(kept, measure)
    return json.loads(kept.read_text())


def at_triangles(name, path, budget):
    """Files with at most `budget` triangles."""
    folder, glb = HERE / f"{name}-{budget}", as_glb(name, path)
    ways = {
        "ours": lambda out: program("simplify", path, "-o", out, "--triangles", budget) and None,
        "Decimate": lambda out: decimated(path, budget, out),
        "gltfpack -sv": lambda out: packed(glb, budget, out),
        "gltfpack -sv -sp": lambda out: packed(glb, budget, out, "-sp"),
    }
    made = {way: folder / f"{way}.glb" for way, make in ways.items() if once(folder / f"{way}.glb", make)}
    return {way: judged(name, path, file, file) for way, file in made.items()}


def at_bytes(name, path):
    """The whole asset compressed by peers, and ours within as many bytes; nothing where a peer is missing."""
    if not all(map(tool, TOOLS)):
        return {}
    folder, glb = HERE / f"{name}-bytes", as_glb(name, path)
    peer, ours = folder / "WebP and meshopt.glb", folder / "ours.glb"
    once(peer, lambda out: compressed(glb, out))
    most = peer.stat().st_size
    small = ["--max-bytes", most, "--textures", "webp", "--compress", "meshopt"]
    once(ours, lambda out: program("simplify", path, "-o", out, *small) and None)
    out = {}
    for file in (ours, peer):
        shown = file.with_suffix(".plain.glb")
        once(shown, lambda part: uncompressed(file, part))
        out[file.stem] = judged(name, path, file, shown)
    return out


def cells(figures):
    """Triangles, kilobytes, PSNR in the mean (in the worst view), FLIP."""
    psnr, flip = np.array(figures["views"]).T
    kb = f"{figures['bytes'] / 1e3:.0f}"
    return [figures["triangles"], kb, f"{psnr.mean():.2f} ({psnr.min():.2f})", f"{flip.mean():.4f}"]


def rows_of(results):
    """A line for each file that has triangles."""
    shown = lambda made: {way: figures for way, figures in made.items() if figures["triangles"]}
    return [[name, budget, way, *cells(f)] for (name, budget), made in results.items() for way, f in shown(made).items()]


def standing():
    """The rows whose figures stand in the folder, in the order of ROWS."""
    out = {}
    for name, (_, budgets) in ROWS.items():
        for budget in budgets:
            files = sorted((HERE / f"{name}-{budget}").glob("*.json"), key=lambda f: (f.stem != "ours", f.stem))
            made = {f.stem: json.loads(f.read_text()) for f in files if not f.name.startswith("part-")}
            if made:
                out[name, budget] = made
    return out


def table():
    for name, path, budget in wanted():
        at_bytes(name, path) if budget == "bytes" else at_triangles(name, path, budget)
        # A row takes from minutes to an hour: what stands is told after each.
        (HERE / "table.md").write_text(tables())
    return tables()


def tables():
    results = standing()
    head = ["asset", "budget", "made by", "triangles", "kB", "PSNR, dB (worst view)", "FLIP"]
    by_triangles = rows_of({key: made for key, made in results.items() if key[1] != "bytes"})
    by_bytes = rows_of({key: made for key, made in results.items() if key[1] == "bytes"})
    about = (
        f"{VIEWS} views of {SIZE} x {SIZE} pixels, {SAMPLES} samples ({SAMPLES * in_cycles.REFERENCE_FACTOR} of the reference), under"
        f" {ENVIRONMENT} and a sun by turns. PSNR without Monte Carlo noise, FLIP with it; both over the foreground. Peers"
        " that come to more or fewer triangles than the budget are listed as they are, those that leave none are not."
    )
    parts = [about, markdown(head, by_triangles)]
    if by_bytes:
        parts += ["At equal bytes: all triangles as lossy WebP and meshopt by the peers, and ours within as many bytes:", markdown(head, by_bytes)]
    return "\n\n".join(parts)
