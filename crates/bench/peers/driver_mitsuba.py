"""Path tracing: the same scenes by Mitsuba (llvm_ad_rgb) and by `photofit render`, error against CPU time."""

import contextlib
import ctypes
import glob
import os
import pathlib
import re
import tempfile
import time
from xml.sax.saxutils import quoteattr

import numpy as np

from harness import ROOT, WORK, markdown, program

ABOUT = "Error of a path traced picture against Mitsuba"
NEEDS = ["numpy", "mitsuba"]

# The reference: pictures of 64 samples a pixel by Mitsuba's multijittered sampler, and how many.
PART, PARTS = 64, 32
SPP = [4, 16, 64]
# Pictures of each program whose errors are averaged.
SEEDS = 3
SAMPLERS = ["independent", "multijitter"]
FILTERS = ["as it is", "box"]


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


def versions():
    """The LLVM that Dr.Jit compiles with."""
    numbers = [ctypes.c_uint() for _ in range(3)]
    ctypes.CDLL(os.environ["DRJIT_LIBLLVM_PATH"]).LLVMGetVersion(*map(ctypes.byref, numbers))
    return ["LLVM " + ".".join(str(n.value) for n in numbers)]


def scenes():
    """assets/box.xml, and the files, or those of the folders, that PHOTOFIT_PEER_SCENES names, separated by colons."""
    found = [ROOT / "assets" / "box.xml"]
    for named in filter(None, os.environ.get("PHOTOFIT_PEER_SCENES", "").split(":")):
        path = pathlib.Path(named)
        found += sorted(path.glob("*.xml")) if path.is_dir() else [path]
    return found


@contextlib.contextmanager
def variant(path, reconstruction, sampler=None):
    """A file with another filter or sampler for the time of a `with`, which finds what the scene names."""
    if reconstruction == "as it is" and sampler is None:
        yield str(path)
        return
    text = pathlib.Path(path).read_text()
    if "<film" not in text:
        raise ValueError(f"{path}: has its film in another file, so that its filter and sampler cannot be changed")
    drop = lambda tag, text: re.sub(rf"<{tag}\b[^>]*?(/>|>.*?</{tag}>)", "", text, flags=re.S)
    if sampler:
        text = drop("sampler", text).replace("<film", f'<sampler type="{sampler}"/><film')
    if reconstruction != "as it is":
        inside = f'<rfilter type="{reconstruction}"/>'
        opened = lambda film: f"{film[1]}>{inside}" + ("</film>" if film[2] == "/>" else "")
        text = re.sub(r"(<film\b[^>]*?)(/>|>)", opened, drop("rfilter", text))
    with tempfile.TemporaryDirectory(dir=WORK) as folder:
        # Ours takes no absolute paths.
        beside = os.path.relpath(os.path.realpath(pathlib.Path(path).parent), os.path.realpath(folder))
        file = pathlib.Path(folder, pathlib.Path(path).name)
        file.write_text(re.sub(r"<scene\b[^>]*>", lambda scene: f"{scene[0]}<path value={quoteattr(beside)}/>", text, count=1))
        yield str(file)


def compared(mi, path, reconstruction):
    """Rows of a scene with one filter, and the ratio of the means."""
    loaded = {}
    for sampler in SAMPLERS:
        with variant(path, reconstruction, sampler) as file:
            loaded[sampler] = mi.load_file(file)
    picture = lambda sampler, spp, seed: np.array(mi.render(loaded[sampler], spp=spp, seed=seed))[..., :3]
    # In parts: one kernel over all samples would need gigabytes.
    parts = np.array([picture("multijitter", PART, 1000 + k) for k in range(PARTS)])
    truth = parts.mean(0)
    # The brightest thousandth is left out, which one rare path may decide.
    keep = (truth <= np.quantile(truth, 0.999)).all(-1)
    own_noise = float((parts.var(0, ddof=1) / PARTS)[keep].mean())
    error = lambda image: float(((image - truth)[keep] ** 2).mean()) - own_noise
    rows, out, ratios = [], WORK / f"mitsuba-{os.getpid()}.exr", []
    for spp in SPP:
        found, seconds = [], []
        for seed in range(SEEDS):
            with variant(path, reconstruction) as file:
                seconds.append(program("render", file, "-o", out, "--spp", spp, "--seed", seed, "--allow-parent-paths"))
            image = np.array(mi.Bitmap(str(out)), np.float32)[..., :3]
            found.append(error(image))
            ratios.append(float(image[keep].mean() / truth[keep].mean()))
        a, own = float(np.mean(found)), float(np.median(seconds))
        for sampler in SAMPLERS:
            picture(sampler, spp, 1)
            found, seconds = [], []
            for seed in range(SEEDS):
                start = time.process_time()
                image = picture(sampler, spp, 2 + seed)
                seconds.append(time.process_time() - start)
                found.append(error(image))
            b, other = float(np.mean(found)), float(np.median(seconds))
            name = pathlib.Path(path).name
            rows.append([name, reconstruction, spp, sampler, a, own, b, other, a * own / (b * other)])
            print(rows[-1], flush=True)
    return rows, f"{pathlib.Path(path).name}, filter {reconstruction}: {ratios[-1]:.4f}"


def table():
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    rows, means = [], []
    for path in scenes():
        for reconstruction in FILTERS:
            more, mean = compared(mi, path, reconstruction)
            rows += more
            means.append(mean)
    rows.sort(key=lambda row: -row[-1])
    head = [
        "scene", "filter", "samples", "Mitsuba's sampler", "ours: MSE", "CPU s", "Mitsuba: MSE", "CPU s",
        "error x time, ours / Mitsuba",
    ]
    return (
        f"{markdown(head, rows)}\n\nThe worst row first. Mean squared error, the mean of {SEEDS} pictures, against"
        f" {PART * PARTS} multijittered samples of Mitsuba, corrected for the noise of these. Our time is that of the whole"
        " process (reading, building, writing), Mitsuba's that of a render after the first; medians."
        f"\n\nRatio of the means of the last picture, ours / reference: {'; '.join(means)}."
    )
