"""Path tracing: the same scenes by Mitsuba (llvm_ad_rgb) and by `photofit render`, error against CPU time."""

import glob
import os
import re
import time

import numpy as np

from harness import ROOT, WORK, markdown, program

ABOUT = "Error of a path traced picture against Mitsuba"
NEEDS = ["numpy", "mitsuba"]

REFERENCE = 4096
SPP = [4, 16, 64]


def ready():
    """Dr.Jit compiles its kernels by LLVM; 15 and older fail on them."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    found = glob.glob("/usr/lib/*/libLLVM*.so*") + glob.glob("/usr/lib/llvm-*/lib/libLLVM*.so*")
    versions = {path: re.search(r"libLLVM(?:-|\.so\.)(\d+)", path) for path in found}
    new = {path: int(match[1]) for path, match in versions.items() if match and int(match[1]) >= 16}
    if not named and not new:
        return "apt-get install libllvm19 (or DRJIT_LIBLLVM_PATH names an LLVM of 16 or newer)"
    os.environ["DRJIT_LIBLLVM_PATH"] = named or max(new, key=new.get)
    return None


def scenes():
    """assets/box.xml, and the files that PHOTOFIT_PEER_SCENES names, separated by colons."""
    return [ROOT / "assets" / "box.xml", *filter(None, os.environ.get("PHOTOFIT_PEER_SCENES", "").split(":"))]


def table():
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    rows, means = [], []
    for path in map(str, scenes()):
        name = path.rsplit("/", 1)[-1]
        scene = mi.load_file(path)
        picture = lambda spp, seed: np.array(mi.render(scene, spp=spp, seed=seed))[..., :3]
        # In parts: one kernel over all samples would need gigabytes.
        truth = np.mean([picture(64, 1000 + k) for k in range(REFERENCE // 64)], 0)
        # Root mean square over the picture; the brightest thousandth is left out, which one rare path may decide.
        limit = np.quantile(truth, 0.999)
        keep = (truth <= limit).all(-1)
        error = lambda image: float(np.sqrt(((image - truth)[keep] ** 2).mean()))
        out = WORK / "mitsuba.exr"
        for spp in SPP:
            picture(spp, 1)
            start = time.process_time()
            theirs = picture(spp, 2)
            their_seconds = time.process_time() - start
            our_seconds = program("render", path, "-o", out, "--spp", spp)
            ours = np.array(mi.Bitmap(str(out)), np.float32)[..., :3]
            a, b = error(ours), error(theirs)
            rows.append([name, spp, a, our_seconds, b, their_seconds, a * a * our_seconds / (b * b * their_seconds)])
        means.append(f"{name} {float(ours[keep].mean() / truth[keep].mean()):.4f}")
    head = ["scene", "samples", "ours: RMSE", "CPU s", "Mitsuba: RMSE", "CPU s", "error^2 x time, ours / Mitsuba"]
    return (
        f"{markdown(head, rows)}\n\nAgainst {REFERENCE} samples of Mitsuba. Our time is that of the whole process (reading, building,"
        f" writing), Mitsuba's that of the second render.\n\nRatio of the means, ours / reference: {', '.join(means)}."
    )
