"""One step of a recovery (picture, gradient of the loss, Adam, values set in the scene) by Mitsuba (prb) and by the suite `recover-steps`."""

import time

import numpy as np

from driver_mitsuba import ready, versions
from harness import ROOT, markdown, suite_by_cpu

ABOUT = "Variance and time of the steps of recoveries against Mitsuba"
NEEDS = ["numpy", "mitsuba"]

FOLDER = ROOT / "out" / "bench" / "recover-steps"
#: Samples of the picture and of the gradient of Mitsuba's steps; ours must reach the variance of the first.
SAMPLES = [(16, 1), (8, 4), (4, 4)]
STEPS = 24
# Scene, its values (their name, what Mitsuba's key ends in, the suite's figure), and Mitsuba's integrator and max_depth, which counts one more than ours.
SCENES = [
    ("plate", [("plate", ".alpha.data", "variance")], "prb", 4),
    ("cloud", [("density", "sigma_t.data", "variance"), ("albedo", "albedo.data", "variance of albedo")], "prbvolpath", 16),
]
STATES = ["start", "halfway"]


def theirs(mi, dr, name, state, values, kind, depth, samples):
    """Gradients of each step by value, and CPU seconds of each."""
    scene = mi.load_file(str(FOLDER / f"{name}_{state}.xml"))
    read = lambda what: mi.TensorXf(np.array(mi.Bitmap(str(FOLDER / f"{name}_{what}.exr")), np.float32)[..., :3])
    target, weights = read("target"), read("weights")
    integrator = mi.load_dict({"type": kind, "max_depth": depth, "rr_depth": 5})
    params = mi.traverse(scene)
    keys = [next(k for k in params.keys() if k.endswith(ending)) for _, ending, _ in values]
    # A rate that moves nothing in single precision: every step begins at the same values.
    adam = mi.ad.Adam(lr=1e-30)
    for key in keys:
        adam[key] = params[key]
    params.update(adam)
    found, seconds = [[] for _ in keys], []
    for k in range(STEPS + 1):
        start = time.process_time()
        image = mi.render(scene, params, integrator=integrator, spp=samples[0], spp_grad=samples[1], seed=k, seed_grad=1000 + k)
        # The derivative of half of the weighted squares is that of the suite's loss.
        dr.backward(0.5 * dr.sum(weights * dr.square(image - target), axis=None))
        gradients = [dr.grad(adam[key]) for key in keys]
        dr.eval(gradients)
        adam.step()
        params.update(adam)
        dr.eval(*[params[key] for key in keys])
        dr.sync_thread()
        seconds.append(time.process_time() - start)
        # The first one compiles.
        if k > 0:
            for all_of, one in zip(found, gradients):
                all_of.append(np.array(one, np.float64).reshape(-1))
    return [np.array(f) for f in found], float(np.median(seconds[1:]))


def table():
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    import drjit as dr

    ours = suite_by_cpu("recover-steps")
    rows = []
    for name, values, kind, depth in SCENES:
        for state in STATES:
            runs = [theirs(mi, dr, name, state, values, kind, depth, samples) for samples in SAMPLES]
            gradients, other = runs[0]
            for k, (value, _, figure) in enumerate(values):
                # The least variance times time of Mitsuba by any of its samples.
                products = [float(found[k].var(0, ddof=1).sum()) * each for found, each in runs]
                found = gradients[k]
                variance = float(found.var(0, ddof=1).sum())
                best = min(products) / (variance * other)
                at = " + ".join(map(str, SAMPLES[products.index(min(products))]))
                for (method, case), row in ours.items():
                    if method != f"{name}, {state}":
                        continue
                    ratio, each = row["figures"][figure] / variance, row["seconds"]
                    product = ratio * each / other
                    rows.append([f"{value}, {state}", case, ratio, each, other, each / other, product, product / best, at])
                    print(rows[-1], flush=True)
    head = [
        "values", "ours: picture + gradient", "variance, ours / Mitsuba", "ours: CPU s", "Mitsuba: CPU s", "time, ours / Mitsuba",
        "variance x time, ours / Mitsuba",
        "ours / best of Mitsuba", "at",
    ]
    least = {}
    for row in rows:
        if row[2] <= 1:
            least[row[0]] = min(least.get(row[0], row), row, key=lambda r: r[5])
    reached = "; ".join(f"{name}: {row[5]:.2f} ({row[1]})" for name, row in least.items())
    return (
        f"{markdown(head, rows)}\n\nMitsuba takes {SAMPLES[0][0]} + {SAMPLES[0][1]} samples; the last columns compare with its least variance x time by {len(SAMPLES)} pairs of samples. Variance is that of the gradient of the whole step, summed over all"
        " values; that gradients agree is shown by `mitsuba_gradients`. Least time of ours over that of Mitsuba among the rows whose variance is no larger than its:"
        f" {reached}."
    )
