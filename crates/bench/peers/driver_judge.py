"""The judge: light assets beside the heavy one in Blender Cycles, which knows nothing of us; at equal triangles and at equal bytes.

`PHOTOFIT_JUDGE_ASSETS` names a folder in which the files of ROWS are looked for, at any depth, and ENVIRONMENT. What is made
stands in out/bench/peers/work/judge, one folder a row. Beside each file stands its key: digests of the asset and of the
environment, versions of the programs, the code that runs them, settings; what is there under the same key is not made again.
`PHOTOFIT_JUDGE_ROWS=YcbBanana:500,spot:bytes` makes some rows alone; the table has all that stand there with this judge and
these assets, each with the version that made it.
"""

import functools
import hashlib
import importlib.metadata
import inspect
import json
import os
import pathlib
import subprocess
import traceback
import urllib.parse

import numpy as np

import classic_bake
import in_cycles
import reducers
from harness import WORK, digest, markdown, our_version, program
from reducers import TOOLS, Refused, by_quadrics, decimated, packed, quiet, tool, transformed, unpinned, version

ABOUT = "Light assets in Blender Cycles, ours and those of peers"
NEEDS = ["numpy", "scipy", "bpy", "flip-evaluator", "pymeshlab"]

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


def parts(path):
    """A file, and what it names of those in its folder."""
    out, beside = [path], sorted(f for f in path.parent.rglob("*") if f.is_file())
    for file in out:
        if file.suffix in (".gltf", ".obj", ".mtl"):
            text = urllib.parse.unquote(file.read_text(errors="replace"))
            out += [f for f in beside if f.name in text and f not in out]
    return out


@functools.cache
def digest_of(path):
    return digest(parts(path))


def how(*functions):
    """The digest of the code that makes a file, its flags included."""
    return hashlib.sha256("".join(map(inspect.getsource, functions)).encode()).hexdigest()[:16]


def functions_of(module):
    """Those that a module defines."""
    return [f for f in vars(module).values() if inspect.isfunction(f) and f.__module__ == module.__name__]


def meshlab():
    return f"pymeshlab {importlib.metadata.version('pymeshlab')}"


def blender():
    import bpy

    return f"Blender {bpy.app.version_string}"


def judge():
    """What the figures of all rows have in common."""
    settings = {"views": VIEWS, "size": SIZE, "samples": SAMPLES, "reference": SAMPLES * in_cycles.REFERENCE_FACTOR}
    return {**settings, "environment": digest_of(found(ENVIRONMENT)), "by": blender()}


def once(path, key, make):
    """Makes a file under another name and gives it its own when it is complete, unless it is there under this key."""
    of_file, text = path.with_name(path.name + ".key"), json.dumps(key, sort_keys=True)
    if path.exists() and of_file.exists() and of_file.read_text() == text:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name("part-" + path.name)
    make(part)
    of_file.unlink(missing_ok=True)
    part.rename(path)
    of_file.write_text(text)


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

    once(out, {"asset": digest_of(path), "by": blender(), "how": how(as_glb)}, export)
    return out


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


def kept(file, key, draw):
    """What `draw` gives as a dictionary, from a file: pictures `seen` of an asset, the sphere that cameras look at as `around`, and more."""

    def make(part):
        drawn = draw()
        (center, radius), seen = drawn.pop("around"), drawn.pop("seen").astype(np.float16)
        with open(part, "wb") as out:
            np.savez_compressed(out, seen=seen, center=center, radius=radius, **drawn)

    once(file, key, make)
    held = np.load(file)
    return held["seen"].astype(np.float32), (held["center"].tolist(), float(held["radius"])), held


def reference(name, path):
    """Pictures of the asset and what its candidates are seen like; kept."""

    def draw():
        seen, around, count = in_cycles.pictures(path, found(ENVIRONMENT), VIEWS, SIZE, SAMPLES * in_cycles.REFERENCE_FACTOR, 0)
        return {"seen": seen, "around": around, "triangles": count}

    seen, around, held = kept(HERE / f"{name}-reference.npz", {"asset": digest_of(path), "judge": judge()}, draw)
    return seen, around, int(held["triangles"])


class Cycles:
    """How files are judged by Blender Cycles: the end of the name of their figures, what all of them have in common, and the figures of
    a file."""

    suffix = ".json"
    judge = staticmethod(judge)

    @staticmethod
    def figures(name, path, shown):
        truth, around, _ = reference(name, path)
        seen, _, count = in_cycles.pictures(shown, found(ENVIRONMENT), VIEWS, SIZE, SAMPLES, 1, around)
        return {"views": in_cycles.likeness(truth, seen), "triangles": count}


def judged(name, path, file, shown, key, judge=Cycles):
    """Keeps the figures of a file, whose geometry stands in `shown` without compression."""
    key = {**key, "judge": judge.judge()}

    def measure(part):
        part.write_text(json.dumps({"key": key, **judge.figures(name, path, shown), "bytes": file.stat().st_size}))

    once(file.with_suffix(judge.suffix), key, measure)


def attempt(folder, way, key, make, judge=Cycles):
    """Whether the file or the figures of a way are made; else why not is kept in place of its figures."""
    try:
        make()
        return True
    except Exception as e:
        if not isinstance(e, Refused):
            traceback.print_exc()
        why = str(e) if isinstance(e, Refused) else f"{type(e).__name__}: {e}"
    folder.mkdir(parents=True, exist_ok=True)
    # Without a key of its own it is tried again.
    (folder / f"{way}{judge.suffix}.key").unlink(missing_ok=True)
    (folder / f"{way}{judge.suffix}").write_text(json.dumps({"key": {**key, "judge": judge.judge()}, "refused": why}))
    return False


def made(name, path, folder, way, key, make, judge=Cycles):
    """Makes and judges the file of a way; its figures, or why there is none."""
    file = folder / f"{way}.glb"

    def whole():
        once(file, key, make)
        judged(name, path, file, file, key, judge)

    attempt(folder, way, key, whole, judge)
    return json.loads(file.with_suffix(judge.suffix).read_text())


def ours(path, budget, out):
    program("simplify", path, "-o", out, "--triangles", budget)


def at_triangles(name, path, budget):
    """Files with at most `budget` triangles."""
    folder, asset = HERE / f"{name}-{budget}", {"asset": digest_of(path), "budget": budget}
    ways = {
        "ours": (our_version(), (ours,), lambda out: ours(path, budget, out)),
        "Decimate": (blender(), (decimated,), lambda out: decimated(path, budget, out)),
        "bake": (blender(), (*functions_of(classic_bake),), lambda out: classic_bake.baked(path, budget, out)),
        "MeshLab": (meshlab(), (by_quadrics, reducers.with_materials), lambda out: by_quadrics(path, budget, out)),
    }
    if tool("gltfpack"):
        by = version("gltfpack")
        code = (packed, as_glb)
        for flags in [], ["-sp"]:
            # The flags are in the name.
            way = " ".join(["gltfpack -sv", *flags])
            ways[way] = (by, code, lambda out, flags=flags: packed(as_glb(name, path), budget, out, *flags))
    if tool("gltf-transform"):
        glb, share = as_glb(name, path), lambda: budget / in_cycles.triangles(in_cycles.load(path))
        by, code = version("gltf-transform"), (transformed, as_glb)
        ways["gltf-transform"] = (by, code, lambda out: transformed(glb, share(), out))
    for way, (by, code, make) in ways.items():
        made(name, path, folder, way, {**asset, "by": by, "how": how(*code)}, make)


def within(path, most, out):
    """Ours within as many bytes."""
    large = out.with_name(out.stem + ".too-large.glb")
    large.unlink(missing_ok=True)
    try:
        program("simplify", path, "-o", out, "--max-bytes", most, "--textures", "webp", "--compress", "meshopt")
    except subprocess.CalledProcessError as e:
        if not large.exists():
            raise
        lightest = large.stat().st_size
        large.unlink()
        raise Refused(f"none fits: the lightest has {lightest / 1e3:.0f} of {most / 1e3:.0f} kB") from e


def at_bytes(name, path):
    """The whole asset compressed by peers, and ours within as many bytes and half of them; nothing where a peer is missing."""
    if not all(map(tool, TOOLS)):
        return
    folder, asset = HERE / f"{name}-bytes", {"asset": digest_of(path), "budget": "bytes"}
    plain = [version("node"), version("gltf-transform"), how(uncompressed)]

    def whole(way, key, make):
        file = folder / f"{way}.glb"
        shown = file.with_suffix(".plain.glb")

        def work():
            once(file, key, make)
            once(shown, {**key, "plain": plain}, lambda part: uncompressed(file, part))
            judged(name, path, file, shown, {**key, "plain": plain})

        return attempt(folder, way, key, work)

    peer = "WebP and meshopt"
    by = f"{version('gltf-transform')}, {version('gltfpack')}"
    theirs = {**asset, "by": by, "how": how(compressed, as_glb)}
    if whole(peer, theirs, lambda out: compressed(as_glb(name, path), out)):
        most = (folder / f"{peer}.glb").stat().st_size
        for way, bytes in ("ours", most), ("ours, half the bytes", most // 2):
            own = {**asset, "by": our_version(), "how": how(within), "bytes": bytes}
            whole(way, own, lambda out: within(path, bytes, out))


def likeness(figures):
    """PSNR in the mean (in the worst view), FLIP."""
    psnr, flip = np.array(figures["views"]).T
    return [f"{psnr.mean():.2f} ({psnr.min():.2f})", f"{flip.mean():.4f}"]


def cells(figures):
    """Triangles, kilobytes, likeness."""
    return [figures["triangles"], f"{figures['bytes'] / 1e3:.0f}", *likeness(figures)]


def rows_of(results):
    """A line for each file that has triangles, and for each that was not made."""
    out = []
    for (name, budget), made in results.items():
        for way, figures in made.items():
            by = figures["key"]["by"]
            if "refused" in figures:
                why = " ".join(figures["refused"].replace("|", "/").split())[:200]
                out.append([name, budget, way, by, why, "", "", ""])
            elif figures["triangles"]:
                out.append([name, budget, way, by, *cells(figures)])
    return out


def standing():
    """The rows that stand in the folder, of this judge and these assets, in the order of ROWS."""
    now, out = judge(), {}
    for name, (file, budgets) in ROWS.items():
        asset = found(file)
        for budget in budgets:
            files = sorted((HERE / f"{name}-{budget}").glob("*.json"), key=lambda f: (f.stem != "ours", f.stem))
            made = {f.stem: json.loads(f.read_text()) for f in files if not f.name.startswith("part-")}
            same = lambda key: key.get("judge") == now and (not asset or key["asset"] == digest_of(asset))
            made = {way: figures for way, figures in made.items() if same(figures.get("key", {}))}
            if made:
                out[name, budget] = made
    return out


def title():
    """By what stands in the table."""
    ways = dict.fromkeys(way for made in standing().values() for way, figures in made.items() if "views" in figures)
    return "Light assets in Blender Cycles" + (f": {', '.join(ways)}" if ways else "")


def table():
    HERE.mkdir(parents=True, exist_ok=True)
    for name, path, budget in wanted():
        try:
            at_bytes(name, path) if budget == "bytes" else at_triangles(name, path, budget)
        except Exception:
            traceback.print_exc()
            print(f"judge: {name}:{budget} is not made", flush=True)
        # A row takes from minutes to an hour: what stands is told after each.
        (HERE / "table.md").write_text(tables())
    return tables()


def terms():
    """How is judged, in words."""
    return (
        f"{VIEWS} views of {SIZE} x {SIZE} pixels, {SAMPLES} samples ({SAMPLES * in_cycles.REFERENCE_FACTOR} of the reference), under"
        f" {ENVIRONMENT} and a sun by turns. PSNR without the variance of Monte Carlo noise, FLIP with it; both over the foreground."
    )


def tables():
    results = standing()
    head = ["asset", "budget", "made by", "version", "triangles", "kB", "PSNR, dB (worst view)", "FLIP"]
    by_triangles = rows_of({key: made for key, made in results.items() if key[1] != "bytes"})
    by_bytes = rows_of({key: made for key, made in results.items() if key[1] == "bytes"})
    about = (
        f"{terms()} Peers that come to more or fewer triangles than the budget are listed as they are, those that leave none are not."
    )
    missing = [f"{name} ({variable})" for name, variable in TOOLS.items() if not tool(name)]
    there = [version(name) for name in TOOLS if tool(name)]
    programs = f"{blender()} judges; peers: {', '.join(there) or 'none'}."
    if missing:
        programs += f" Not found, so that what needs them is not made: {', '.join(missing)}."
    if unpinned():
        programs += f" Those of package.json are {', '.join(unpinned())}."
    out = [about, programs, markdown(head, by_triangles)]
    if by_bytes:
        out += ["Within bytes: all triangles as lossy WebP and meshopt by the peers, and ours within as many bytes and within half of them:", markdown(head, by_bytes)]
    return "\n\n".join(out)
