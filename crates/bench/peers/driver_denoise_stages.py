"""What each stage of `photofit denoise` brings, and its models, on the set of `denoise_scenes.py`."""

import numpy as np

from denoise_scenes import SAMPLES, display, last_frame, pictures, psnr, rendered
from harness import WORK, markdown, program

ABOUT = "Stages and models of the denoiser"
NEEDS = ["numpy", "mitsuba"]

#: Options that leave out one input or stage.
WITHOUT = {
    **{stage: ["--without", stage] for stage in (
        "albedo", "normal", "position", "variance", "noiseless", "demodulation", "bandwidth", "highlights", "zero-albedo", "detail",
        "antialiasing", "edges",
    )},
    "fireflies": ["--keep-fireflies"],
}
MODELS = ["rof", "tvl1", "hybrid", "tgv", "atrous"]


def table():
    folder, found, told = rendered()
    truth = {name: display(pictures(folder / name / "truth.exr")["color"]) for names in found["sets"].values() for name in names}
    clean = WORK / "stages.exr"

    def run(options):
        out = {}
        for name in truth:
            for samples in SAMPLES:
                program("denoise", last_frame(folder, found, name, samples), "-o", clean, *options)
                out[name, samples] = psnr(display(pictures(clean)["color"]), truth[name])
        return out

    base = run([])
    mean = lambda values, which, samples=SAMPLES: np.mean([values[n, s] for n in found["sets"][which] for s in samples])

    def change(options):
        values = run(options)
        return {key: values[key] - base[key] for key in base}

    def of_set(which, changes):
        """A row for each change: means over the set, and the pictures that lose and gain most."""
        rows = []
        for label, change in changes.items():
            own = {key: change[key] for key in base if key[0] in found["sets"][which]}
            ends = (min(own, key=own.get), max(own, key=own.get))
            means = [mean(change, which), *(mean(change, which, [s]) for s in SAMPLES)]
            rows.append([label, *(f"{v:+.2f}" for v in means), *(f"{name} {s}: {own[name, s]:+.1f}" for name, s in ends)])
        return markdown([which, "mean", *(f"at {s}" for s in SAMPLES), "least, scene and samples", "most"], rows)

    stages = {f"without {stage}": change(options) for stage, options in WITHOUT.items()}
    models = {}
    for model in MODELS:
        models[model] = change(["--model", model])
        if model != "atrous":
            models[f"{model} without coherence"] = change(["--model", model, "--without", "coherence"])
    sets = list(found["sets"])
    absolute = ", ".join(f"{which} {mean(base, which):.2f}" for which in sets)
    # A hundredth of a decibel is chance.
    idle = {
        which: [label.removeprefix("without ") for label, change in stages.items() if mean(change, which) > -0.01]
        for which in sets
        if which != "choosing"
    }
    return "\n\n".join([
        f"PSNR less that of the automatic model ({absolute} dB), means over the scenes of a set, and the pictures that change most: what is"
        " negative is lost without the stage.",
        *(of_set(which, stages) for which in sets),
        "Stages whose absence loses less than .01 dB in the mean of a set that nothing is chosen on: "
        + "; ".join(f"{which}: {', '.join(labels) or 'none'}" for which, labels in idle.items()) + ".",
        "The other models:",
        *(of_set(which, models) for which in sets),
        told,
    ])
