"""Gradients through the path tracer: the same scenes and weights by Mitsuba (prb) and by `photofit gradient`."""

import json
import os
import time

import numpy as np
from scipy.stats import chi2, norm

from denoise_scenes import coordinates, diffuse, floor, lamp, number, rgb, smooth
from driver_mitsuba import FILTERS, SAMPLERS, ready, variant, versions
from harness import ROOT, WORK, markdown, program

ABOUT = "Variance and time of path-traced gradients against Mitsuba"
NEEDS = ["numpy", "mitsuba", "scipy"]

# Independent estimates of each program, samples a pixel of each, and runs of ours that hold them together.
ESTIMATES = 64
SPP = 4
SEEDS = 4
WEIGHTS = ["random", "1"]
BOX = ROOT / "assets" / "box.xml"
PLATE = WORK / "plate" / "plate.xml"
CLOUD = WORK / "plate" / "cloud.xml"
# Media under a lamp: a grid whose voxels differ at random, thin and thick, a thin one with a few thick voxels, and a thick
# ball that is the same everywhere.
MIST, SMOKE, SPARSE, BALL = (WORK / "plate" / f"{name}.xml" for name in ["mist", "smoke", "sparse", "ball"])
# Scenes of the suite `recover`.
SCENES = ROOT / "crates" / "bench" / "src" / "suites" / "recover"
# Texels along the side of the plate, and pixels of its picture; voxels along a side of the grids of each scene.
TEXELS, PIXELS = 512, 256
VOXELS = {CLOUD: 64, MIST: 16, SMOKE: 16, SPARSE: 16}
# Blocks along the side of a grid whose sums are compared, with more runs of ours for their standard errors: estimates of
# single voxels that few paths meet are far from normal.
BLOCKS, BLOCK_SEEDS = {CLOUD: 8, MIST: 4, SMOKE: 4, SPARSE: 4}, 16

# Scene, our key, what theirs ends in, the scattering events of a path, which `--max-depth` counts, and the filters.
# Mitsuba's max_depth counts the segments of a path from the camera: 1 is what emits, 2 is direct light. It is one more.
# The box has Mitsuba's default filter (Gaussian, standard deviation .5 pixels), the plate one of a pixel.
CASES = [
    (BOX, "white.reflectance.value", "white.reflectance.value", 8, FILTERS),
    (BOX, "red.reflectance.value", "red.reflectance.value", 8, FILTERS),
    (BOX, "shape_4.bsdf.alpha.value", "bsdf.alpha.value", 8, FILTERS),
    (BOX, "shape_3.emitter.radiance.value", "emitter.radiance.value", 8, FILTERS),
    (PLATE, "metal.alpha.data", ".alpha.data", 3, ["as it is"]),
    (CLOUD, "fog.sigma_t.data", "sigma_t.data", 15, ["as it is"]),
    (CLOUD, "fog.albedo.data", "albedo.data", 15, ["as it is"]),
    (MIST, "fog.sigma_t.data", "sigma_t.data", 32, ["as it is"]),
    (MIST, "fog.albedo.data", "albedo.data", 32, ["as it is"]),
    (SMOKE, "fog.sigma_t.data", "sigma_t.data", 32, ["as it is"]),
    (SMOKE, "fog.albedo.data", "albedo.data", 32, ["as it is"]),
    (SPARSE, "fog.sigma_t.data", "sigma_t.data", 32, ["as it is"]),
    (SPARSE, "fog.albedo.data", "albedo.data", 32, ["as it is"]),
    (BALL, "fog.sigma_t.value.value", "interior_medium.sigma_t.value.value", 32, ["as it is"]),
    (BALL, "fog.albedo.value.value", "interior_medium.albedo.value.value", 32, ["as it is"]),
]


def write_plate(mi):
    """A metal plate whose roughness a texture holds under a sky with windows of light: as the suite `recover` has it, other noise aside."""
    PLATE.parent.mkdir(exist_ok=True)
    save = lambda image, name: mi.Bitmap(np.ascontiguousarray(image, np.float32)).write(str(PLATE.with_name(name)))
    y, x = (coordinate + 0.5 / TEXELS for coordinate in coordinates(TEXELS))
    noise = lambda cells, seed: 2 * smooth((TEXELS, TEXELS), cells, seed) - 1
    rough = 0.42 + 0.17 * noise(6, 3) + 0.06 * noise(24, 4)
    rough = np.where((np.floor(8 * x) + np.floor(8 * y)) % 2 == 1, 0.55 * rough, rough)
    rough = np.where(np.hypot(x - 0.5, y - 0.5) < 0.18, 0.75, rough)
    line = lambda t: abs(16 * t % 1 - 0.5) < 0.04
    rough = np.where(line(x) | line(y), 0.12, rough)
    save((rough.clip(0.08, 0.95) ** 2)[..., None], "plate.exr")
    row, column = np.arange(64)[:, None], np.arange(128)[None]
    height = (1 - row / 32)[..., None] + np.zeros((64, 128, 1))
    light = np.where(height > 0, np.array([0.3, 0.4, 0.55]) * (0.4 + 0.6 * height), [0.12, 0.1, 0.08])
    lamp = (row >= 6) & (row < 14) & (column % 32 < 8) | (row >= 16) & (row < 22) & ((column + 16) % 40 < 5)
    save(np.where(lamp[..., None], [9.0, 8.0, 6.5], light), "sky.exr")
    scene = SCENES / PLATE.name
    PLATE.write_text(scene.read_text().replace("{PIXELS}", str(PIXELS)))


def centres(n):
    """Centres of the voxels of a grid in the unit cube, n x n x n x 3."""
    z, y, x = np.meshgrid(*[(np.arange(n) + 0.5) / n] * 3, indexing="ij")
    return np.stack([x, y, z], -1)


def write_cloud(mi):
    """A cloud with bumps and coloured albedo under the same sky, as the suite `recover` has it, other bumps aside.

    Its density is nowhere 0, and at Mitsuba's upper bound in one corner alone: Mitsuba's derivatives are wrong at both.
    """
    place = centres(VOXELS[CLOUD])
    radius = np.linalg.norm(place - 0.5, axis=-1)
    numbers = np.random.default_rng(5)
    bumps = np.zeros(radius.shape)
    for octave in range(4):
        for _ in range(5):
            wave = numbers.normal(size=3)
            wave *= 9 * 1.8**octave / np.linalg.norm(wave)
            bumps += 0.6**octave / 5 * np.sin(place @ wave + numbers.uniform(0, 2 * np.pi))
    density = (np.clip(1.6 - 3.9 * radius, 0, 1) + 0.55 * bumps * (radius < 0.45)).clip(0.02, 1)
    # One corner alone holds the upper bound.
    density[0, 0, 0] = 1.2
    albedo = np.stack([0.35 + 0.6 * place[..., 0], 0.9 - 0.5 * place[..., 1], 0.3 + 0.6 * place[..., 2]], -1)
    save_grids(mi, density, albedo, "density.vol", "albedo.vol")
    scene = SCENES / CLOUD.name
    CLOUD.write_text(scene.read_text().replace("{PIXELS}", str(PIXELS // 2)))


def save_grids(mi, density, albedo, *names):
    for values, name in zip([density[..., None], albedo], names):
        mi.VolumeGrid(np.ascontiguousarray(values, np.float32)).write(str(CLOUD.with_name(name)))


def write_media(mi):
    """Media between surfaces above a floor under a lamp: grids of a mean thickness of about .2 and 11, one of .2 but for a voxel in 50 of thickness 2.4, a ball of 8; of grey extinction, as Mitsuba's derivatives of coloured are off."""
    place = centres(VOXELS[SMOKE])
    numbers = np.random.default_rng(11)
    density = numbers.uniform(0.05, 0.9, place.shape[:-1])
    density[0, 0, 0] = 1
    albedo = np.stack([0.95 - 0.4 * place[..., 2], 0.5 + 0.45 * place[..., 0], 0.3 + 0.5 * place[..., 1]], -1)
    save_grids(mi, density, albedo, "random.vol", "random_albedo.vol")
    thick = numbers.uniform(size=density.shape) < 0.02
    sparse = np.where(thick, numbers.uniform(0.4, 0.9, density.shape), numbers.uniform(0.001, 0.005, density.shape))
    sparse[0, 0, 0] = 1
    save_grids(mi, sparse, albedo, "sparse.vol", "random_albedo.vol")
    scene = (SCENES / CLOUD.name).read_text().replace("{PIXELS}", str(PIXELS // 4))
    head, grids = (part.replace("density.vol", "random.vol").replace("albedo.vol", "random_albedo.vol") for part in scene.split('<emitter type="envmap">'))
    grids = grids[grids.index("<shape") : grids.index("</scene>")]
    eight = number("scale", 8)
    assert grids.count(eight) == 1 and grids.count("random") == 2, grids
    phase = lambda g: f'<phase type="hg">{number("g", g)}</phase></medium>'
    even = f'<medium type="homogeneous" name="interior" id="fog">{number("scale", 4)}{rgb("sigma_t", 1)}{rgb("albedo", 0.95, 0.8, 0.6)}{phase(-0.3)}'
    of_scale = lambda factor: grids.replace(eight, number("scale", factor)).replace("</medium>", phase(0.5))
    lit = floor(4, diffuse(0.4, 0.55, 0.5), y=-1.2) + lamp(-0.5, 2.4, 0.4, 0.7, 9, 11, 12)
    media = {MIST: of_scale(0.2), SMOKE: of_scale(12), SPARSE: of_scale(30).replace("random.vol", "sparse.vol"), BALL: f'<shape type="sphere"><bsdf type="null"/>{even}</shape>'}
    for file, medium in media.items():
        file.write_text(f"{head}{medium}{lit}</scene>\n")


def limit(values):
    """The mean squared z of so many values from which two gradients count as different.

    Independent values are below it but for one time in 16,000, as one value is within four standard deviations. Of standard errors from 64 estimates
    the mean is 1.03 where gradients agree, from 16 (blocks) at most 1.15: a tenth more. Channels of one colour are not independent: where all three are
    one, three values are above it one time in 220.
    """
    return 1.1 * chi2.isf(2 * norm.sf(4), values) / values


def theirs(mi, dr, path, ending, events, weights):
    """Estimates of the gradient, and CPU seconds of each."""
    scene = mi.load_file(path)
    kind = "prbvolpath" if any(shape.interior_medium() for shape in scene.shapes()) else "prb"
    integrator = mi.load_dict({"type": kind, "max_depth": events + 1, "rr_depth": 5})
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


def ours(mi, path, key, events, weights, runs):
    """Gradient of each seed, standard error of their mean, and CPU seconds of all without reading; each estimate counts whole."""
    image, out = (WORK / f"gradient-{os.getpid()}.{kind}" for kind in ("exr", "json"))
    mi.Bitmap(np.ascontiguousarray(weights)).write(str(image))
    run = lambda spp, seed: program(
        "gradient", path, "--parameter", key, "--weights", image, "--max-depth", events, "--spp", spp, "--seed", seed,
        "--json", out, "--allow-parent-paths"
    )
    samples = ESTIMATES * SPP // runs
    gradients, errors, seconds = [], [], []
    for seed in range(runs):
        seconds.append(run(samples, seed))
        record = json.loads(out.read_text())
        gradients.append(np.array(record["gradient"], np.float64).reshape(-1))
        errors.append(np.array(record["standard_error"], np.float64).reshape(-1))
    reading = np.median([program("gradient", path, "--list", "--allow-parent-paths") for _ in range(SEEDS)])
    seconds = (np.median(seconds) - reading) * runs
    return np.array(gradients), np.sqrt(np.square(errors).sum(0)) / runs, float(seconds)


def spread(found):
    """Mean and standard error of estimates."""
    return found.mean(0), found.std(0, ddof=1) / len(found) ** 0.5


def blocks(found, path):
    """Sums over blocks of voxels of each of some estimates of the grid of a scene."""
    parts = found.reshape(len(found), *[BLOCKS[path], VOXELS[path] // BLOCKS[path]] * 3, -1)
    return parts.sum((2, 4, 6)).reshape(len(found), -1)


def squared_z(a, b):
    """Mean squared difference of two (mean, standard error) over their standard errors."""
    seen = (a[1] > 0) & (b[1] > 0)
    return float(((a[0] - b[0])[seen] ** 2 / (a[1] ** 2 + b[1] ** 2)[seen]).mean())


def of_case(mi, dr, case, reconstruction, kind):
    """Rows of one case, filter and kind of weights, by Mitsuba's samplers."""
    path, our_key, their_key, events, _ = case
    with variant(path, reconstruction) as file:
        size = mi.load_file(file).sensors()[0].film().size()
        shape = (size[1], size[0], 3)
        weights = np.random.default_rng(1).normal(size=shape) if kind == "random" else np.ones(shape)
        weights = weights.astype(np.float32)
        in_blocks = path in VOXELS
        seeds, error, seconds = ours(mi, file, our_key, events, weights, BLOCK_SEEDS if in_blocks else SEEDS)
    own = (seeds.mean(0), error)
    first = None
    for sampler in SAMPLERS:
        with variant(path, reconstruction, sampler) as file:
            found, each = theirs(mi, dr, file, their_key, events, weights)
        other, time_of_theirs = spread(found), each * ESTIMATES
        compared = (spread(blocks(seeds, path)), spread(blocks(found, path))) if in_blocks else (own, other)
        first = first or compared[1]
        seen = (own[1] > 0) & (other[1] > 0)
        ratio = float((own[1][seen] ** 2).sum() / (other[1][seen] ** 2).sum())
        cells = [own[0].size, ratio, seconds, time_of_theirs, ratio * seconds / time_of_theirs, squared_z(*compared)]
        row = [path.name, our_key, reconstruction, kind, sampler, *cells]
        # What Mitsuba's samplers differ by among themselves.
        row.append("" if compared[1] is first else squared_z(first, compared[1]))
        print(row, flush=True)
        yield row


def table():
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    import drjit as dr

    write_plate(mi)
    write_cloud(mi)
    write_media(mi)
    rows = []
    for case in CASES:
        for reconstruction in case[-1]:
            for kind in WEIGHTS:
                rows += of_case(mi, dr, case, reconstruction, kind)
    # Voxels of a block, by scene.
    per_block = {path.name: (VOXELS[path] // n) ** 3 for path, n in BLOCKS.items()}
    count = lambda row: row[5] // per_block.get(row[0], 1)
    # Mitsuba's first sampler, whose numbers are independent, judges.
    judged = [row for row in rows if row[4] == SAMPLERS[0]]
    apart = [", ".join(map(str, [*row[1:5], row[-2]])) for row in judged if not row[-2] <= limit(count(row))]
    head = [
        "scene", "parameter", "filter", "weights", "Mitsuba's sampler", "values", "variance, ours / Mitsuba",
        "ours: CPU s", "Mitsuba: CPU s", "variance x time, ours / Mitsuba", "mean squared z",
        f"of Mitsuba's {SAMPLERS[0]}",
    ]
    worst = max(rows, key=lambda row: row[-3])
    note = (
        f"{ESTIMATES} estimates of {SPP} samples a pixel. Times without reading and, of Mitsuba, compiling and building; ours build what rays are cast into in each run."
        f" The mean squared z is that of the difference of both gradients (of grids: of sums over blocks, {BLOCKS[CLOUD]} along a side in the cloud, {BLOCKS[MIST]} elsewhere)"
        " over their standard errors: about 1 where they"
        f" agree; the last column is that of Mitsuba's two samplers. Worst variance x time: {worst[-3]:.3g},"
        f" {worst[1]}, filter {worst[2]}, weights {worst[3]}, {worst[4]}."
    )
    text = f"{markdown(head, rows)}\n\n{note}"
    if apart:
        raise RuntimeError(f"{text}\n\nThe gradients are not the same, by the mean squared z: {'; '.join(apart)}")
    return text
