"""Monte Carlo denoising: Open Image Denoise and `photofit denoise` on pictures and guides that we render."""

import numpy as np

from harness import ROOT, WORK, markdown, median_seconds, program

ABOUT = "Denoising against Open Image Denoise"
NEEDS = ["numpy", "mitsuba", "mitsuba-oidn", "flip-evaluator"]

#: Scenes and how they are rendered.
SCENES = {"box": [ROOT / "assets" / "box.xml", "--width", 320, "--height", 240]}


def table():
    import flip_evaluator
    import mitsuba as mi
    import mitsuba_oidn as oidn

    mi.set_variant("scalar_rgb")
    display = lambda x: np.clip(np.nan_to_num(x), 0, 1).astype(np.float32) ** np.float32(1 / 2.2)

    def layers(path):
        parts = mi.Bitmap(str(path)).split()
        return {name: np.ascontiguousarray(np.array(part, np.float32)[..., :3]) for name, part in parts}

    rows = []
    for name, arguments in SCENES.items():
        truth_file = WORK / f"oidn-{name}-truth.exr"
        if not truth_file.exists():
            program("render", *arguments, "-o", truth_file, "--spp", 2048, "--seed", 99)
        truth = display(np.array(mi.Bitmap(str(truth_file)), np.float32)[..., :3])
        for spp in (1, 4, 16):
            noisy_file, clean_file = WORK / f"oidn-{name}-{spp}.exr", WORK / f"oidn-{name}-{spp}-ours.exr"
            program("render", *arguments, "-o", noisy_file, "--spp", spp, "--aov", "albedo,normal")
            found = layers(noisy_file)
            color = found.get("<root>", found.get("root", next(iter(found.values()))))
            guides = {"albedo": found["albedo"], "normal": found["normal"]}
            our_seconds = program("denoise", noisy_file, "-o", clean_file)
            results = {"noisy": (color, 0.0)}
            results["ours"] = (np.array(mi.Bitmap(str(clean_file)), np.float32)[..., :3], our_seconds)
            for quality in ("Fast", "High"):
                run = lambda: oidn.denoise(color, hdr=True, clean_aux=True, quality=getattr(oidn.Quality, quality), **guides)
                results[f"Open Image Denoise, {quality.lower()}"] = (run(), median_seconds(run, 3))
            for tool, (image, seconds) in results.items():
                shown = display(image)
                psnr = -10 * np.log10(float(((shown - truth) ** 2).mean()))
                flip = float(flip_evaluator.evaluate(truth, shown, "LDR", applyMagma=False)[1])
                rows.append([name, spp, tool, f"{psnr:.1f}", f"{flip:.3f}", seconds])
    head = ["scene", "samples", "denoiser", "PSNR, dB", "FLIP", "seconds"]
    return (
        f"{markdown(head, rows)}\n\nPictures of gamma 2.2 against 2048 samples. Ours: CPU seconds of the whole process, files"
        " included; Open Image Denoise: wall seconds of the filter with its guides."
    )
