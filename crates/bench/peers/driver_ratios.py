"""Fewer triangles by ratio: ours with the asset's own texture coordinates, gltfpack and gltf-transform, by our own pictures."""

import json
import os
import shutil
import subprocess

from harness import WORK, markdown, program

ABOUT = "Shares of the triangles: ours with the asset's own textures, gltfpack, gltf-transform"
NEEDS = ["numpy"]

RATIOS = ["0.7", "0.5", "0.3", "0.1", "0.03", "0.01"]
TOOLS = {"gltfpack": "PHOTOFIT_GLTFPACK", "gltf-transform": "PHOTOFIT_GLTF_TRANSFORM"}
# Runs side by side do not share files.
RUN = os.getpid()
# How many more triangles than the budget still count as reaching it.
OVER = 1.05


def assets():
    """The assets that PHOTOFIT_PEER_ASSETS names, separated by colons."""
    return list(filter(None, os.environ.get("PHOTOFIT_PEER_ASSETS", "").split(":")))


def tool(name):
    """The path of a peer: its variable, or what PATH finds; None where it is not installed."""
    return os.environ.get(TOOLS[name]) or shutil.which(name)


def ready():
    """There is nothing to compare without assets and peers."""
    if not assets():
        return "PHOTOFIT_PEER_ASSETS=A.glb:B.glb names no assets"
    missing = [f"{name} ({TOOLS[name]} or PATH)" for name in TOOLS if not tool(name)]
    return f"not installed: {', '.join(missing)}" if missing else None


def quiet(*command):
    """Runs a peer; False where it refuses."""
    return subprocess.run(list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0


def packed(path, ratio, out, *flags):
    # -se 1: no limit of the error stops it before the ratio.
    return quiet(tool("gltfpack"), "-noq", "-si", ratio, "-se", 1, *flags, "-i", path, "-o", out)


def transformed(path, ratio, out):
    welded = WORK / f"ratios-welded-{RUN}.glb"
    simplify = ["simplify", welded, out, "--ratio", ratio, "--error", 1]
    return quiet(tool("gltf-transform"), "weld", path, welded) and quiet(tool("gltf-transform"), *simplify)


def ours(path, ratio, out):
    program("simplify", path, "-o", out, "--ratio", ratio, "--keep-uvs", "--seed", 0)
    return True


WAYS = {
    "ours": ours,
    "gltfpack -sv": lambda path, ratio, out: packed(path, ratio, out, "-sv"),
    "gltfpack -sv -sp": lambda path, ratio, out: packed(path, ratio, out, "-sv", "-sp"),
    "gltf-transform": transformed,
}


def figures(path, out, most):
    """Triangles, and PSNR and FLIP of the mean and of the worst view; None for what has no triangles or too many."""
    seen = WORK / f"ratios-{RUN}.json"
    try:
        program("inspect", out, "--json", seen)
        triangles = json.loads(seen.read_text())["triangles"]
        if not 0 < triangles <= OVER * most:
            return None
        program("compare", path, out, "--json", seen)
    except subprocess.CalledProcessError:
        return None
    found = json.loads(seen.read_text())
    views = found["views"]
    worst = min(v["psnr"] for v in views)
    return triangles, found["psnr"], worst, found["flip"]


def table():
    rows, least = [], {}
    for path in assets():
        name = path.rsplit("/", 1)[-1].rsplit(".", 1)[0]
        seen = WORK / f"ratios-{RUN}.json"
        program("inspect", path, "--json", seen)
        all_triangles = json.loads(seen.read_text())["triangles"]
        for ratio in RATIOS:
            cells, own = [], None
            for way, make in WAYS.items():
                out = WORK / f"ratios-{RUN}.glb"
                out.unlink(missing_ok=True)
                made = make(path, ratio, out) and out.exists()
                found = figures(path, out, float(ratio) * all_triangles) if made else None
                cells.append("-" if found is None else f"{found[1]:.2f} ({found[2]:.2f}), {found[3]:.4f}")
                if way == "ours":
                    own = found
                elif found and own:
                    gain = own[1] - found[1]
                    least[way] = min(least.get(way, gain), gain)
            rows.append([name, ratio, own[0] if own else "-", *cells])
    head = ["asset", "ratio", "triangles of ours", *WAYS]
    gains = ", ".join(f"{gain:+.2f} dB against {way}" for way, gain in least.items())
    return (
        f"{markdown(head, rows)}\n\nPSNR in decibels, in the mean of 8 views of 512 x 512 pixels (in the worst view), and mean FLIP, "
        f"by `photofit compare`. A dash: the tool writes nothing, or more than {OVER} times the budget. "
        f"Least lead of ours over all assets and ratios: {gains}."
    )
