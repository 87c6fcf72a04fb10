"""Fewer triangles by ratio: ours with the asset's own texture coordinates, gltfpack and gltf-transform, as a judge has them.

`PHOTOFIT_PEER_ASSETS` names the assets, separated by colons, `PHOTOFIT_JUDGE_ASSETS` the folder of the judge's environment. What is
made is kept as that of the judge is.
"""

import os
import pathlib

import numpy as np

import in_cycles
from driver_judge import ENVIRONMENT, HERE, as_glb, digest_of, found, how, likeness, made
from harness import markdown, our_version, program
from reducers import TOOLS, Refused, packed, tool, transformed, unpinned, version

RATIOS = ["0.7", "0.5", "0.3", "0.1", "0.03", "0.01"]
PEERS = [name for name in TOOLS if name != "node"]
# How many more triangles than the budget still count as reaching it.
OVER = 1.05


def assets():
    return [pathlib.Path(path) for path in os.environ.get("PHOTOFIT_PEER_ASSETS", "").split(":") if path]


def ready():
    """There is nothing to compare without assets, light and peers."""
    if not assets():
        return "PHOTOFIT_PEER_ASSETS=A.glb:B.glb names no assets"
    absent = [str(path) for path in assets() if not path.is_file()]
    if absent:
        return f"PHOTOFIT_PEER_ASSETS names what is no file: {', '.join(absent)}"
    if not found(ENVIRONMENT):
        return f"PHOTOFIT_JUDGE_ASSETS=FOLDER has no {ENVIRONMENT}"
    lacking = [f"{name} ({TOOLS[name]} or PATH)" for name in PEERS if not tool(name)] + unpinned()
    return f"not installed, see package.json beside this driver: {', '.join(lacking)}" if lacking else None


def ours(path, most, out):
    # A share would leave 64 triangles at least.
    program("simplify", path, "-o", out, "--triangles", int(most), "--keep-uvs", "--seed", 0)


def within(most, make, out):
    """Refuses what has no triangles or too many."""
    make(out)
    count = in_cycles.triangles(in_cycles.load(out))
    if not 0 < count <= OVER * most:
        out.unlink()
        raise Refused(f"{count} triangles in place of {most:.0f}")


def table(judge, terms, by):
    """The table of a judge, who is told of in these words."""
    rows, least, without = [], {}, 0
    for path in assets():
        name, glb = path.stem, as_glb(path.stem, path)
        triangles = in_cycles.triangles(in_cycles.load(path))
        for ratio in RATIOS:
            most = float(ratio) * triangles
            ways = {
                "ours": (our_version(), (ours,), lambda out: ours(path, most, out)),
                "gltfpack -sv": (version("gltfpack"), (packed,), lambda out: packed(glb, most, out)),
                "gltfpack -sv -sp": (version("gltfpack"), (packed,), lambda out: packed(glb, most, out, "-sp")),
                "gltf-transform": (version("gltf-transform"), (transformed,), lambda out: transformed(glb, ratio, out)),
            }
            cells, psnr = [], {}
            for way, (maker, code, make) in ways.items():
                key = {"asset": digest_of(path), "ratio": ratio, "by": maker, "how": how(*code, within), "over": OVER}
                figures = made(name, path, HERE / f"{name}-{ratio}", way, key, lambda out: within(most, make, out), judge)
                if "views" not in figures:
                    cells.append("-")
                    continue
                cells.append(", ".join(likeness(figures)))
                psnr[way] = np.mean(figures["views"], 0)[0]
                if way == "ours":
                    count = figures["triangles"]
                elif "ours" in psnr:
                    least[way] = min(least.get(way, np.inf), psnr["ours"] - psnr[way])
            without += "ours" not in psnr
            rows.append([name, ratio, count if "ours" in psnr else "-", *cells])
            print(rows[-1], flush=True)
    head = ["asset", "ratio", "triangles of ours", *ways]
    gains = ", ".join(f"{gain:+.2f} dB against {way}" for way, gain in least.items())
    return (
        f"{terms}\n\n{markdown(head, rows)}\n\nPSNR in decibels, in the mean of the views (in the worst view), and mean FLIP, by"
        f" {by}. A dash: the tool writes nothing, or more than {OVER} times the budget. Least lead of ours in PSNR, where both"
        f" made a file: {gains}. Rows without one of ours: {without}."
    )
