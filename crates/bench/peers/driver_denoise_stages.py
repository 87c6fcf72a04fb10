"""What each stage of `photofit denoise` brings, and its models, on the set of `denoise_scenes.py`."""

import numpy as np

from denoise_scenes import SAMPLES, display, last_frame, pictures, psnr, rendered
from harness import WORK, markdown, program

ABOUT = "Stages and models of the denoiser"
NEEDS = ["numpy", "mitsuba"]

#: Options that leave out one input or stage.
WITHOUT = {
    **{stage: ["--without", stage] for stage in (
        "albedo", "normal", "position", "variance", "exact", "demodulation", "widths", "highlights", "black", "detail", "jagged", "edges",
    )},
    "fireflies": ["--keep-fireflies"],
}
MODELS = ["rof", "tvl1", "hybrid", "tgv", "atrous"]


def table():
    folder, found = rendered()
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

    def change(label, options):
        values = run(options)
        change = {key: values[key] - base[key] for key in base}
        # The fresh set is shown by its mean alone: what is read of single scenes and samples is an occasion to choose.
        judged = {key: v for key, v in change.items() if key[0] in found["sets"]["judging"]}
        least, most = min(judged, key=judged.get), max(judged, key=judged.get)
        by_samples = [f"{np.mean([v for key, v in judged.items() if key[1] == s]):+.2f}" for s in SAMPLES]
        ends = [f"{name} {samples}: {judged[name, samples]:+.1f}" for name, samples in (least, most)]
        return [label, *(f"{mean(change, which):+.2f}" for which in found["sets"]), *by_samples, *ends]

    head = [*found["sets"], *(f"at {s}" for s in SAMPLES), "least, scene and samples", "most"]
    stages = [change(f"without {stage}", options) for stage, options in WITHOUT.items()]
    models = []
    for model in MODELS:
        models.append(change(model, ["--model", model]))
        if model != "atrous":
            models.append(change(f"{model} without coherence", ["--model", model, "--without", "coherence"]))
    absolute = ", ".join(f"{which} {mean(base, which):.2f}" for which in found["sets"])
    return "\n\n".join([
        f"PSNR less that of the automatic model ({absolute} dB), means over scenes and samples, and over the judging set at each number of"
        " samples, as are the extremes: what is negative is lost without the stage.",
        markdown(["automatic model", *head], stages),
        markdown(["model", *head], models),
    ])
