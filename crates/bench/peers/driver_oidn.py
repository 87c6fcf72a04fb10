"""Monte Carlo denoising: Open Image Denoise and `photofit denoise` on the set of `denoise_scenes.py`."""

import numpy as np

from denoise_scenes import REFERENCE_SAMPLES, SAMPLES, SIZE, display, last_frame, pictures, psnr, rendered
from harness import WORK, markdown, program

ABOUT = "Denoising against Open Image Denoise"
NEEDS = ["numpy", "scikit-image", "mitsuba", "mitsuba-oidn", "flip-evaluator"]

OURS = "photofit"
FAST = "OIDN fast"
HIGH = "OIDN high"


def versions():
    import mitsuba_oidn as oidn

    return [f"Open Image Denoise {oidn.oidn_version()}"]


def scores(image, truth):
    """PSNR, SSIM and FLIP of a displayed picture."""
    import flip_evaluator
    from skimage.metrics import structural_similarity

    ssim = float(structural_similarity(truth, image, channel_axis=2, data_range=1.0))
    return psnr(image, truth), ssim, float(flip_evaluator.evaluate(truth, image, "LDR", applyMagma=False)[1])


def alone(guide, image, quality):
    """A guide that Open Image Denoise has denoised by itself."""
    import mitsuba_oidn as oidn

    work, out = oidn.Device().new_filter("RT"), np.empty_like(image)
    work.quality = quality
    work.set_image(guide, image)
    work.set_image("output", out)
    work.execute()
    return out


def denoised(folder, found, name, samples):
    """The scores of every denoiser for one picture; those of a sequence where the camera moves."""
    import mitsuba_oidn as oidn

    truth = display(pictures(folder / name / "truth.exr")["color"])
    noisy, clean = last_frame(folder, found, name, samples), WORK / f"oidn-{name}-{samples}.exr"
    layers = pictures(noisy)
    program("denoise", noisy, "-o", clean)
    out = {"noisy": layers["color"], OURS: pictures(clean)["color"]}
    for label, quality in ((FAST, oidn.Quality.Fast), (HIGH, oidn.Quality.High)):
        # As its manual has it for the best results: on the choosing set better than noisy guides at all samples, for both qualities.
        guides = {guide: alone(guide, layers[guide], quality) for guide in ("albedo", "normal")}
        out[label] = oidn.denoise(layers["color"], hdr=True, quality=quality, clean_aux=True, **guides)
    if found["frames"][name] > 1:
        program("denoise", noisy, "-o", clean, "--sequence", folder / name / "cameras.json")
        out["sequence"] = pictures(clean)["color"]
    return {label: scores(display(image), truth) for label, image in out.items()}


def table():
    folder, found, told = rendered()
    all_of = {
        (name, samples): denoised(folder, found, name, samples)
        for names in found["sets"].values()
        for name in names
        for samples in SAMPLES
    }
    tools = [OURS, FAST, HIGH]
    rows, summary = [], []
    for name in found["sets"]["judging"] + found["sets"]["fresh"]:
        for samples in SAMPLES:
            s = all_of[name, samples]
            cells = [" / ".join(f"{s[t][k]:{form}}" for t in tools) for k, form in ((0, ".1f"), (1, ".3f"), (2, ".3f"))]
            rows.append([name, samples, f"{s['noisy'][0]:.1f}", *cells, f"{s[OURS][0] - s[FAST][0]:+.1f}"])
    for which, names in found["sets"].items():
        for samples in SAMPLES:
            gap = {name: all_of[name, samples][OURS][0] - all_of[name, samples][FAST][0] for name in names}
            mean = lambda tool, k: np.mean([all_of[name, samples][tool][k] for name in names])
            worst, best = min(gap, key=gap.get), max(gap, key=gap.get)
            cells = [" / ".join(f"{mean(t, k):{form}}" for t in tools) for k, form in ((0, ".2f"), (1, ".3f"), (2, ".3f"))]
            ends = [f"{worst} {gap[worst]:+.1f}", f"{best} {gap[best]:+.1f}"]
            summary.append([which, samples, *cells, f"{np.mean(list(gap.values())):+.2f}", *ends])
    moving, gains = [], []
    for which, names in found["sets"].items():
        names = [name for name in names if found["frames"][name] > 1]
        for name in names:
            for samples in SAMPLES:
                one, six, fast, high = (all_of[name, samples][t][0] for t in (OURS, "sequence", FAST, HIGH))
                moving.append([which, name, samples, *(f"{v:.1f}" for v in (one, six)), f"{six - one:+.1f}", f"{fast:.1f}", f"{high:.1f}"])
        for samples in SAMPLES:
            of = lambda tool: np.array([all_of[name, samples][tool][0] for name in names])
            cells = []
            for tool in (OURS, FAST, HIGH):
                gain = of("sequence") - of(tool)
                cells += [f"{gain.mean():+.2f}", f"{names[gain.argmin()]} {gain.min():+.1f}"]
            gains.append([which, samples, *cells])
    each = "PSNR, dB", "SSIM", "FLIP"
    return "\n\n".join([
        f"Pictures of {SIZE[0]} x {SIZE[1]} pixels at gamma 2.2 against {REFERENCE_SAMPLES} samples a pixel. Triples are photofit /"
        " Open Image Denoise fast / high, which denoise albedo and normals by themselves first; means over the scenes of a set; the last"
        " three columns are photofit less fast, dB.",
        markdown(["set", "samples", *each, "mean", "worst scene", "best scene"], summary),
        "Each picture of the judging and the fresh set:",
        markdown(["scene", "samples", "noisy", *each, "less fast"], rows),
        "The sixth frame of a moving camera, PSNR: from one frame, from six; Open Image Denoise from one:",
        markdown(["set", "scene", "samples", "photofit", "photofit, six frames", "gain", FAST, HIGH], moving),
        "PSNR from six frames less that of others from one, dB, mean and worst scene:",
        markdown(["set", "samples", *(v for t in (OURS, FAST, HIGH) for v in (f"less {t}", "worst"))], gains),
        told,
    ])
