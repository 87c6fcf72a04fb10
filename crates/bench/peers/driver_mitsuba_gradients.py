"""Gradients through the path tracer: the same scenes and weights by Mitsuba (prb) and by `photofit gradient`."""

import json
import os
import time

import numpy as np

from driver_mitsuba import ready
from harness import ROOT, WORK, markdown, program

ABOUT = "Variance and time of path-traced gradients against Mitsuba"
NEEDS = ["numpy", "mitsuba"]

# Independent estimates of each program, and samples a pixel of each.
ESTIMATES = 16
SPP = 4
# Of a run whose time is taken off, so that reading and building do not count.
SHORT = 16
DEPTH = 8
PLATE = "out/bench/recover/plate.xml"

# Scene, our key, what theirs ends in, and the depth of paths.
CASES = [
    ("assets/box.xml", "white.reflectance.value", "white.reflectance.value", DEPTH),
    ("assets/box.xml", "red.reflectance.value", "red.reflectance.value", DEPTH),
    (PLATE, "metal.alpha.data", ".alpha.data", 3),
]


def theirs(mi, dr, path, ending, depth, weights):
    """Estimates of the gradient, and CPU seconds of each."""
    scene = mi.load_file(path)
    integrator = mi.load_dict({"type": "prb", "max_depth": depth, "rr_depth": 5})
    params = mi.traverse(scene)
    key = next(k for k in params.keys() if k.endswith(ending))
    found, seconds = [], []
    for k in range(ESTIMATES + 1):
        dr.enable_grad(params[key])
        dr.set_grad(params[key], 0)
        params.update()
        start = time.process_time()
        integrator.render_backward(scene, params, mi.TensorXf(weights), seed=100 + k, spp=SPP)
        dr.eval(dr.grad(params[key]))
        dr.sync_thread()
        seconds.append(time.process_time() - start)
        found.append(np.array(dr.grad(params[key]), np.float64).reshape(-1))
    # The first one compiles.
    return np.array(found[1:]), float(np.median(seconds[1:]))


def ours(path, key, depth, weights):
    """Gradient, its standard error, and CPU seconds of all estimates without reading and building."""
    image, out = WORK / "weights.exr", WORK / "gradient.json"
    import mitsuba as mi

    mi.Bitmap(np.ascontiguousarray(weights)).write(str(image))
    run = lambda spp: program(
        "gradient", path, "--parameter", key, "--weights", image, "--max-depth", depth, "--spp", spp, "--json", out
    )
    short = run(SHORT)
    seconds = run(ESTIMATES * SPP + SHORT) - short
    run(ESTIMATES * SPP)
    record = json.loads(out.read_text())
    flat = lambda name: np.array(record[name], np.float64).reshape(-1)
    return flat("gradient"), flat("standard_error"), seconds


def table():
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    import drjit as dr

    rows, left_out = [], []
    for path, our_key, their_key, depth in CASES:
        file = str(ROOT / path)
        if not os.path.exists(file):
            left_out.append(path)
            continue
        size = mi.load_file(file).sensors()[0].film().size()
        weights = np.random.default_rng(1).normal(size=(size[1], size[0], 3)).astype(np.float32)
        found, each = theirs(mi, dr, file, their_key, depth, weights)
        mean, error = found.mean(0), found.std(0, ddof=1) / ESTIMATES**0.5
        own, own_error, seconds = ours(file, our_key, depth, weights)
        seen = (error > 0) & (own_error > 0)
        chi = float(((own - mean)[seen] ** 2 / (own_error**2 + error**2)[seen]).mean())
        variance = [float((e[seen] ** 2).sum()) for e in (own_error, error)]
        time_of_theirs = each * ESTIMATES
        ratio = variance[0] * seconds / (variance[1] * time_of_theirs)
        name = path.rsplit("/", 1)[-1]
        rows.append(
            [name, our_key, own.size, variance[0] / variance[1], seconds, time_of_theirs, ratio, chi]
        )
    head = [
        "scene", "parameter", "values", "variance, ours / Mitsuba", "ours: CPU s", "Mitsuba: CPU s",
        "variance x time, ours / Mitsuba", "mean squared z",
    ]
    note = (
        f"Random weights of every pixel; {ESTIMATES} estimates of {SPP} samples a pixel. Times without reading, building and"
        " compiling. The mean squared z is that of the difference of both gradients over their standard errors: 1 where they agree."
    )
    if left_out:
        note += f"\n\nLeft out: {', '.join(left_out)}."
    return f"{markdown(head, rows)}\n\n{note}"
