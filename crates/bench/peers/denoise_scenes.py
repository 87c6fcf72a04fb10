"""Scenes for denoisers, made when they are needed: three sets of different content, as Mitsuba 3 scenes.

`CHOOSING` holds the scenes that constants of a denoiser may be chosen on, `JUDGING` those that only judge. `FRESH` were made
after the stages and constants of single frames stood; no constant was chosen by them. The stage that brings back from the last frame
of a sequence is younger (and `court` moves since then): its figures on `FRESH` were seen while it was made.
Each scene is a function that returns the elements of its XML file; what it names (meshes, textures, environments, grids) is written
beside it. All numbers are fixed: two machines make the same files.
"""

import json
import os
import pathlib
import re
import shutil
import tempfile

import numpy as np

from harness import ROOT, WORK, digest, our_version, program, sphere as bumpy, write_ply

#: Pixels of all pictures.
SIZE = (192, 144)
#: Frames of a sequence; the last one is judged.
FRAMES = 6
#: Samples a pixel of the noisy pictures, and of the references.
SAMPLES = (1, 4, 16)
REFERENCE_SAMPLES = 512
#: What is rendered beside the colour.
LAYERS = "albedo,normal,position,variance"


def pfm(path, image):
    """A picture of linear light, float32 (height, width, 3), rows from the top."""
    image = np.ascontiguousarray(np.asarray(image, "<f4")[::-1])
    pathlib.Path(path).write_bytes(f"PF\n{image.shape[1]} {image.shape[0]}\n-1.0\n".encode() + image.tobytes())


def smooth(shape, cells, seed):
    """Noise in [0, 1]: bilinear between random values at `cells` by `cells` points."""
    grid = np.random.default_rng(seed).uniform(size=(cells + 1, cells + 1))
    at = lambda n: np.linspace(0, cells, n, endpoint=False)
    y, x = at(shape[0]), at(shape[1])
    i, j = y.astype(int), x.astype(int)
    f, g = (y - i)[:, None], (x - j)[None, :]
    a, b = grid[i][:, j] * (1 - g) + grid[i][:, j + 1] * g, grid[i + 1][:, j] * (1 - g) + grid[i + 1][:, j + 1] * g
    return a * (1 - f) + b * f


def coordinates(n):
    """Rows and columns of n by n texels, in [0, 1)."""
    return np.meshgrid(np.arange(n) / n, np.arange(n) / n, indexing="ij")


def mix(share, a, b):
    return share[..., None] * np.array(a) + (1 - share[..., None]) * np.array(b)


# Pieces of XML.


def rgb(name, *value):
    value = value * 3 if len(value) == 1 else value
    return f'<rgb name="{name}" value="{", ".join(map(str, value))}"/>'


def number(name, value):
    return f'<float name="{name}" value="{value}"/>'


def bitmap(name, file, repeat=1):
    return (
        f'<texture type="bitmap" name="{name}"><string name="filename" value="{file}"/><boolean name="raw" value="true"/>'
        f'<transform name="to_uv"><scale x="{repeat}" y="{repeat}"/></transform></texture>'
    )


def bsdf(kind, *inside):
    return f'<bsdf type="{kind}">{"".join(inside)}</bsdf>'


def diffuse(*value):
    return bsdf("diffuse", rgb("reflectance", *value))


def painted(file, repeat=1):
    return bsdf("diffuse", bitmap("reflectance", file, repeat))


def metal(alpha, *value):
    return bsdf("roughconductor", number("alpha", alpha), rgb("specular_reflectance", *value))


def emitter(*radiance):
    return f'<emitter type="area">{rgb("radiance", *radiance)}</emitter>'


def ball(center, radius, *inside):
    x, y, z = center
    return f'<shape type="sphere"><point name="center" x="{x}" y="{y}" z="{z}"/>{number("radius", radius)}{"".join(inside)}</shape>'


def rod(a, b, radius, *inside):
    ends = "".join(f'<point name="{n}" x="{p[0]:.5f}" y="{p[1]:.5f}" z="{p[2]:.5f}"/>' for n, p in (("p0", a), ("p1", b)))
    return f'<shape type="cylinder">{ends}{number("radius", radius)}{"".join(inside)}</shape>'


def bar(a, b, radius, *inside):
    """As a rod, of square section: twelve triangles in place of many long ones."""
    a, b = np.array(a, float), np.array(b, float)
    at = lambda p: ", ".join(f"{v:.5f}" for v in p)
    up = "1, 0, 0" if abs(b - a)[1] > abs(b - a)[0] else "0, 1, 0"
    look = f'<lookat origin="{at((a + b) / 2)}" target="{at(b)}" up="{up}"/>'
    return placed("cube", scale(radius, radius, np.linalg.norm(b - a) / 2) + look, *inside)


def placed(kind, steps, *inside):
    return f'<shape type="{kind}"><transform name="to_world">{steps}</transform>{"".join(inside)}</shape>'


def scale(x, y=None, z=None):
    y, z = (x if v is None else v for v in (y, z))
    return f'<scale x="{x}" y="{y}" z="{z}"/>'


def turn(axis, angle):
    return f'<rotate {axis}="1" angle="{angle}"/>'


def move(x=0, y=0, z=0):
    return f'<translate x="{x}" y="{y}" z="{z}"/>'


def floor(half, *inside, y=0):
    return placed("rectangle", scale(half) + turn("x", -90) + move(0, y, 0), *inside)


def walls(width, height, depth, left, right, rest, front=None):
    """A room over the floor at y = 0, |x| <= width, -depth <= z <= depth, without floor and lamps; `front` closes it."""
    out = [
        placed("rectangle", scale(width, depth, 1) + turn("x", 90) + move(0, height, 0), rest),
        placed("rectangle", scale(width, height / 2, 1) + move(0, height / 2, -depth), rest),
        placed("rectangle", scale(depth, height / 2, 1) + turn("y", 90) + move(-width, height / 2, 0), left),
        placed("rectangle", scale(depth, height / 2, 1) + turn("y", -90) + move(width, height / 2, 0), right),
    ]
    if front:
        out.append(placed("rectangle", scale(width, height / 2, 1) + turn("y", 180) + move(0, height / 2, depth), front))
    return "".join(out)


def lamp(x, y, z, half, *radiance):
    """A square lamp that shines down."""
    return placed("rectangle", scale(half) + turn("x", 90) + move(x, y, z), diffuse(0.5), emitter(*radiance))


def environment(file, angle=0, factor=1.0):
    steps = f'<transform name="to_world">{turn("y", angle)}</transform>'
    return f'<emitter type="envmap"><string name="filename" value="{file}"/>{number("scale", factor)}{steps}</emitter>'


def sky(folder, name, sun=(0.62, 0.3), strength=60.0, radius=0.03, ground=(0.25, 0.22, 0.18)):
    """An environment of 256 x 128 texels: a gradient, clouds, and a sun at (column, row) of 1."""
    rows, columns = (np.arange(128) + 0.5) / 128, (np.arange(256) + 0.5) / 256
    up = np.clip(1 - 2 * rows, 0, 1)[:, None, None]
    image = np.where(rows[:, None, None] < 0.5, (1 - up) * np.array([0.9, 0.85, 0.8]) + up * np.array([0.25, 0.45, 0.9]), np.array(ground))
    image = image * (0.7 + 0.6 * smooth((128, 256), 16, 11))[..., None]
    away = np.hypot((columns[None] - sun[0]) * 2, rows[:, None] - sun[1])
    image = image + strength * np.array([1.0, 0.85, 0.6]) * np.exp(-0.5 * (away / radius) ** 2)[..., None]
    pfm(folder / name, image)
    return name


def camera(origin, target, fov, lens=""):
    kind = "thinlens" if lens else "perspective"
    look = f'<lookat origin="{", ".join(f"{v:.5f}" for v in origin)}" target="{", ".join(f"{v:.5f}" for v in target)}" up="0, 1, 0"/>'
    return (
        f'<sensor type="{kind}">{number("fov", fov)}<string name="fov_axis" value="y"/>{lens}'
        f'<transform name="to_world">{look}</transform><film type="hdrfilm"><integer name="width" value="{SIZE[0]}"/>'
        f'<integer name="height" value="{SIZE[1]}"/><rfilter type="box"/></film></sensor>'
    )


def lens(radius, distance):
    return number("aperture_radius", radius) + number("focus_distance", distance)


def before(t):
    """Frame `t` counted from the last one, which is the view of a scene that does not move."""
    return t - FRAMES + 1


def path(depth=10, kind="path"):
    return f'<integrator type="{kind}"><integer name="max_depth" value="{depth}"/></integrator>'


# Scenes that constants may be chosen on.


def box(folder, t):
    """A lamp, metal and glass in a box: `assets/box.xml` at this size."""
    text = (ROOT / "assets" / "box.xml").read_text()
    return text[text.index("<integrator") : text.rindex("</scene>")].replace('"160"', f'"{SIZE[0]}"').replace('"120"', f'"{SIZE[1]}"')


def gallery(folder, t):
    """Textures of low and high contrast in a room, metal and plastic balls; a sequence."""
    y, x = coordinates(256)
    tiles = (np.floor(8 * x) + np.floor(8 * y)) % 2
    pfm(folder / "gallery-tiles.pfm", mix(tiles, (0.75, 0.7, 0.6), (0.15, 0.3, 0.25)) * (0.6 + 0.4 * smooth((256, 256), 32, 1))[..., None])
    bands = 0.5 + 0.5 * np.sin(40 * x + 6 * smooth((256, 256), 6, 2))
    pfm(folder / "gallery-bands.pfm", mix(bands, (0.7, 0.35, 0.2), (0.75, 0.72, 0.65)))
    return "".join([
        path(),
        camera((-0.3 + 0.03 * t, 1.1, 3.4 - 0.01 * t), (0.05, 0.8, 0), 42),
        floor(1.6, painted("gallery-tiles.pfm")),
        walls(1.5, 2.2, 1.6, diffuse(0.6, 0.1, 0.08), diffuse(0.15, 0.4, 0.5), painted("gallery-bands.pfm")),
        lamp(0, 2.19, 0.2, 0.35, 17, 14, 10),
        ball((0.55, 0.4, -0.3), 0.4, metal(0.15, 0.95, 0.75, 0.4)),
        ball((-0.35, 0.25, 0.5), 0.25, bsdf("roughplastic", rgb("diffuse_reflectance", 0.1, 0.2, 0.65), number("alpha", 0.1))),
        placed("cube", scale(0.3, 0.6, 0.3) + turn("y", 25) + move(-0.75, 0.6, -0.7), diffuse(0.7)),
    ])


def spheres(folder, t):
    """Metals and plastics of rising roughness under a sky with a sun; a sequence."""
    parts = [path(), camera((0.06 * before(t), 1.6, 5.5), (0.02 * before(t), 0.45, 0), 30), environment(sky(folder, "spheres-sky.pfm"))]
    for k in range(5):
        parts.append(ball((1.1 * (k - 2), 0.5, 0.3), 0.48, metal(0.02 + 0.12 * k, 0.9, 0.85, 0.75)))
        plastic = bsdf("principled", rgb("base_color", 0.15 + 0.15 * k, 0.3, 0.7 - 0.12 * k), number("roughness", 0.1 + 0.2 * k), number("specular", 0.6))
        parts.append(ball((1.1 * (k - 2) + 0.3, 0.35, -1.2), 0.35, plastic))
    checks = '<texture type="checkerboard" name="reflectance">' + rgb("color0", 0.5) + rgb("color1", 0.2) + f'<transform name="to_uv">{scale(12)}</transform></texture>'
    return "".join([*parts, floor(6, bsdf("diffuse", checks))])


def reeds(folder, t):
    """Rods a pixel or two wide before a wall, under a small lamp and weak sky; a sequence."""
    random = np.random.default_rng(3)
    parts = [path(), camera((0.03 * before(t), 1.0, 4.2), (0, 0.85, 0), 34), '<emitter type="constant">' + rgb("radiance", 0.15, 0.2, 0.3) + "</emitter>"]
    for _ in range(90):
        x, z = random.uniform(-1.8, 1.8), random.uniform(-0.8, 0.8)
        lean = random.uniform(-0.25, 0.25, 2)
        tint = random.uniform(0.2, 0.7, 3).round(3)
        parts.append(bar((x, 0, z), (x + lean[0], random.uniform(1.0, 1.9), z + lean[1]), random.uniform(0.006, 0.02), diffuse(*tint)))
    parts += [floor(4, diffuse(0.4, 0.35, 0.25)), placed("rectangle", scale(4) + move(0, 0, -1.6), diffuse(0.6, 0.6, 0.55)), lamp(1.4, 3.2, 1.6, 0.3, 45, 40, 32)]
    return "".join(parts)


def glasses(folder, t):
    """Smooth glass balls and a cube before a dark wall: refraction and caustics."""
    glass = bsdf("dielectric")
    return "".join([
        path(16),
        camera((0, 1.2, 4.0), (0, 0.5, 0), 32),
        floor(3, diffuse(0.55, 0.5, 0.45)),
        placed("rectangle", scale(3) + move(0, 1, -1.6), diffuse(0.2, 0.25, 0.35)),
        ball((-0.8, 0.45, 0), 0.45, glass), ball((0.25, 0.3, 0.6), 0.3, glass),
        placed("cube", scale(0.35, 0.5, 0.35) + turn("y", 35) + move(0.85, 0.5, -0.4), glass),
        ball((0.1, 0.5, -0.9), 0.5, diffuse(0.7, 0.25, 0.1)),
        lamp(0.4, 3.4, 0.8, 0.5, 16, 15, 13),
        '<emitter type="constant">' + rgb("radiance", 0.08) + "</emitter>",
    ])


def fog(folder, t):
    """A room full of thin fog with a bright lamp in it."""
    air = '<medium type="homogeneous" name="interior">' + rgb("sigma_t", 0.25) + rgb("albedo", 0.9, 0.92, 0.95) + '<phase type="hg"><float name="g" value="0.4"/></phase></medium>'
    return "".join([
        path(24, "volpath"),
        camera((0, 1.0, 4.4), (0, 0.9, 0), 36),
        floor(2.5, diffuse(0.5)),
        walls(1.6, 2.2, 1.6, diffuse(0.5, 0.3, 0.15), diffuse(0.2, 0.3, 0.5), diffuse(0.6)),
        placed("cube", scale(1.59, 1.09, 1.59) + move(0, 1.1, 0), bsdf("null"), air),
        placed("cube", scale(0.3, 0.5, 0.3) + turn("y", 30) + move(0.6, 0.51, -0.3), diffuse(0.7, 0.6, 0.2)),
        ball((-0.6, 0.4, 0.2), 0.38, diffuse(0.75)),
        lamp(0, 2.1, 0, 0.25, 30, 26, 20),
    ])


def row(folder, t):
    """A thin lens: near and far balls of a row are out of focus, features are noisy."""
    y, x = coordinates(128)
    pfm(folder / "row-dots.pfm", mix(((x * 8) % 1 - 0.5) ** 2 + ((y * 8) % 1 - 0.5) ** 2 < 0.09, (0.8, 0.2, 0.1), (0.75, 0.7, 0.6)))
    parts = [path(), camera((-1.3, 0.9, 3.2), (0.1, 0.35, 0), 32, lens(0.09, 3.3))]
    for k in range(6):
        parts.append(ball((-0.9 + 0.42 * k, 0.3, 1.5 - 0.75 * k), 0.3, painted("row-dots.pfm", 2) if k % 2 else metal(0.1, 0.8)))
    return "".join([*parts, floor(6, painted("row-dots.pfm", 8)), environment(sky(folder, "row-sky.pfm", (0.2, 0.25), 80, 0.04), 0, 0.5)])


def bulbs(folder, t):
    """Many small coloured lamps in a closed room; a sequence."""
    random = np.random.default_rng(8)
    parts = [path(), camera((0.03 * before(t), 1.2, 2.6), (0, 0.8, 0), 50), floor(2.7, diffuse(0.55, 0.5, 0.45)), walls(2, 2.4, 2.7, diffuse(0.6), diffuse(0.6), diffuse(0.65), diffuse(0.5))]
    for k in range(14):
        color = np.round(random.uniform(0.2, 1, 3) * 40, 3)
        parts.append(ball((-1.7 + 3.4 * (k % 7) / 6, 1.6 + 0.4 * (k // 7), -1.8 + 1.3 * (k // 7)), 0.05, diffuse(0.5), emitter(*color)))
    for k in range(4):
        parts.append(placed("cube", scale(0.25, 0.2 + 0.15 * k, 0.25) + turn("y", 20 * k) + move(-1.2 + 0.8 * k, 0.2 + 0.15 * k, -0.6), diffuse(*np.round(random.uniform(0.2, 0.8, 3), 3))))
    return "".join(parts)


# Scenes that only judge.


def window(folder, t):
    """A room lit through a window by sun and sky, with a textured rug; a sequence."""
    y, x = coordinates(256)
    knots = 0.5 + 0.5 * np.sin(60 * x) * np.sin(45 * y + 4 * smooth((256, 256), 5, 21))
    pfm(folder / "window-rug.pfm", mix(knots, (0.55, 0.12, 0.1), (0.7, 0.6, 0.4)))
    wall = diffuse(0.7, 0.68, 0.62)
    side = lambda y0, y1, z0, z1: placed("rectangle", scale((z1 - z0) / 2, (y1 - y0) / 2, 1) + turn("y", -90) + move(2, (y0 + y1) / 2, (z0 + z1) / 2), wall)
    return "".join([
        path(14),
        camera((-1.2 + 0.04 * t, 1.25, 2.3), (0.5 + 0.02 * t, 0.8, -0.6), 50),
        environment(sky(folder, "window-sky.pfm", (0.5, 0.3), 500, 0.03), 120, 1.2),
        floor(2.6, diffuse(0.45, 0.3, 0.18)),
        placed("rectangle", scale(1.1, 0.8, 1) + turn("x", -90) + move(0, 0.01, -0.2), painted("window-rug.pfm")),
        placed("rectangle", scale(2, 2.6, 1) + turn("x", 90) + move(0, 2.4, 0), wall),
        placed("rectangle", scale(2, 1.2, 1) + move(0, 1.2, -2.6), wall),
        placed("rectangle", scale(2, 1.2, 1) + turn("y", 180) + move(0, 1.2, 2.6), wall),
        placed("rectangle", scale(2.6, 1.2, 1) + turn("y", 90) + move(-2, 1.2, 0), diffuse(0.3, 0.42, 0.5)),
        side(0, 0.8, -2.6, 2.6), side(2.0, 2.4, -2.6, 2.6), side(0.8, 2.0, -2.6, -1.2), side(0.8, 2.0, 0.6, 2.6),
        placed("cube", scale(0.45, 0.3, 0.35) + turn("y", 15) + move(0.5, 0.3, -1.4), bsdf("principled", rgb("base_color", 0.5, 0.35, 0.2), number("roughness", 0.4))),
        ball((-0.7, 0.35, -1.2), 0.35, diffuse(0.75)),
    ])


def workshop(folder, t):
    """Rough metals and a polished floor under two long lamps; a sequence."""
    parts = [path(), camera((0.6 + 0.04 * before(t), 1.5, 4.0), (0, 0.5, -0.2), 36), floor(4, bsdf("principled", rgb("base_color", 0.2, 0.18, 0.16), number("roughness", 0.2), number("specular", 0.7)))]
    parts += [placed("rectangle", scale(4, 2, 1) + move(0, 2, -2), diffuse(0.4, 0.42, 0.45))]
    parts += [placed("rectangle", scale(1.2, 0.12, 1) + turn("x", 90) + move(0, 2.8, z), diffuse(0.5), emitter(14, 14, 13)) for z in (-0.9, 1.0)]
    parts += [placed("cube", scale(0.4, 0.25, 0.3) + turn("y", 30) + move(-0.9, 0.25, 0.1), metal(0.3, 0.9, 0.6, 0.4)), ball((0.0, 0.4, -0.4), 0.4, metal(0.08, 0.85)), ball((0.95, 0.3, 0.3), 0.3, metal(0.2, 0.95, 0.8, 0.5))]
    parts += [rod((-0.2, 0.06, 0.9), (1.0, 0.06, 1.1), 0.06, metal(0.12, 0.7, 0.72, 0.75)), rod((0.55, 0, -1.1), (0.75, 1.6, -1.4), 0.05, metal(0.25, 0.8))]
    return "".join(parts)


def bottles(folder, t):
    """Rough and clear glass, a mirror and a striped wall behind it."""
    y, x = coordinates(128)
    pfm(folder / "bottles-stripes.pfm", mix((x * 10) % 1 < 0.5, (0.7, 0.65, 0.55), (0.2, 0.3, 0.4)))
    return "".join([
        path(16),
        camera((0.3, 1.1, 3.8), (0, 0.6, 0), 33),
        floor(3, diffuse(0.5, 0.48, 0.45)),
        placed("rectangle", scale(2.6, 1.6, 1) + move(0, 1.6, -1.7), painted("bottles-stripes.pfm")),
        placed("rectangle", scale(0.6, 0.8, 1) + turn("y", 50) + move(-1.5, 0.8, -0.7), bsdf("conductor", rgb("specular_reflectance", 0.9))),
        rod((-0.5, 0, 0.2), (-0.5, 0.9, 0.2), 0.25, bsdf("roughdielectric", number("alpha", 0.1))),
        ball((-0.5, 0.95, 0.2), 0.2, bsdf("roughdielectric", number("alpha", 0.25))),
        ball((0.35, 0.4, 0.35), 0.4, bsdf("dielectric", rgb("specular_transmittance", 0.6, 0.95, 0.7))),
        placed("cube", scale(0.02, 0.6, 0.5) + turn("y", 60) + move(1.0, 0.6, -0.3), bsdf("thindielectric")),
        placed("cube", scale(0.25) + turn("y", 20) + move(1.2, 0.25, -0.9), diffuse(0.7, 0.2, 0.15)),
        lamp(-0.4, 3.0, 0.9, 0.45, 18, 17, 15),
        '<emitter type="constant">' + rgb("radiance", 0.1, 0.1, 0.12) + "</emitter>",
    ])


def carpet(folder, t):
    """Fine, dark and bright textures at grazing angles under one lamp; a sequence."""
    y, x = coordinates(512)
    weave = ((np.floor(64 * x) + np.floor(64 * y)) % 2) * 0.6 + 0.4 * smooth((512, 512), 64, 31)
    pfm(folder / "carpet-weave.pfm", mix(weave, (0.7, 0.6, 0.5), (0.02, 0.025, 0.04)))
    letters = (smooth((512, 512), 48, 32) > 0.6) & ((y * 20) % 1 < 0.7)
    pfm(folder / "carpet-page.pfm", mix(letters, (0.03, 0.03, 0.03), (0.85, 0.83, 0.78)))
    return "".join([
        path(),
        camera((0.5 - 0.03 * t, 0.8 + 0.01 * t, 2.6), (0.0, 0.35, -0.3), 42),
        floor(2.2, painted("carpet-weave.pfm", 3)),
        walls(2.2, 2.4, 2.2, painted("carpet-page.pfm", 2), diffuse(0.5, 0.5, 0.3), painted("carpet-page.pfm", 3)),
        placed("rectangle", scale(0.6, 0.45, 1) + turn("x", -75) + turn("y", 20) + move(-0.4, 0.25, 0.4), painted("carpet-page.pfm")),
        ball((0.7, 0.35, 0.2), 0.35, bsdf("plastic", bitmap("diffuse_reflectance", "carpet-weave.pfm"))),
        placed("cube", scale(0.3, 0.45, 0.3) + turn("y", 40) + move(-0.9, 0.45, -0.8), painted("carpet-weave.pfm")),
        lamp(-0.6, 2.39, 0.3, 0.3, 26, 24, 20),
    ])


def stone(folder, t):
    """A mesh of many bumps with a clear coat under an environment with a low sun."""
    write_ply(folder / "stone.ply", *bumpy(40))
    coat = bsdf("principled", rgb("base_color", 0.55, 0.3, 0.15), number("roughness", 0.5), number("clearcoat", 1.0), number("clearcoat_gloss", 0.9))
    return "".join([
        path(),
        camera((1.2, 1.4, 4.2), (0, 0.05, 0), 34),
        environment(sky(folder, "stone-sky.pfm", (0.1, 0.42), 150, 0.025), 40),
        f'<shape type="ply"><string name="filename" value="stone.ply"/>{coat}</shape>',
        floor(5, diffuse(0.35, 0.37, 0.3), y=-1.05),
    ])


def hedge(folder, t):
    """Leaves cut out of quads by masks, behind wires; a sequence."""
    y, x = coordinates(64)
    leaf = (((x - 0.5) / 0.22) ** 2 + ((y - 0.5) / 0.45) ** 2 < 1).astype(float)
    pfm(folder / "hedge-leaf.pfm", np.repeat(leaf[..., None], 3, 2))
    random = np.random.default_rng(17)
    parts = [path(), camera((0.025 * before(t), 1.0, 3.6), (0, 0.9, 0), 36), environment(sky(folder, "hedge-sky.pfm", (0.7, 0.2), 120, 0.04))]
    for _ in range(220):
        tint = np.round(np.array([0.12, 0.35, 0.08]) * random.uniform(0.5, 1.6), 3)
        leafy = bsdf("mask", bitmap("opacity", "hedge-leaf.pfm"), bsdf("twosided", diffuse(*tint)))
        angles = random.uniform(0, 360, 3).round(2)
        p = np.round([random.uniform(-1.4, 1.4), random.uniform(0.1, 1.7), random.uniform(-0.9, 0.2)], 4)
        parts.append(placed("rectangle", scale(0.16) + turn("x", angles[0]) + turn("y", angles[1]) + turn("z", angles[2]) + move(*p), leafy))
    for k in range(9):
        parts.append(bar((-1.6 + 0.4 * k, 0, 0.8), (-1.6 + 0.4 * k, 1.5, 0.8), 0.008, metal(0.3, 0.6)))
    parts += [bar((-2, h, 0.8), (2, h, 0.8), 0.006, metal(0.3, 0.6)) for h in (0.4, 0.8, 1.2)]
    return "".join([*parts, floor(4, diffuse(0.4, 0.33, 0.25))])


def bokeh(folder, t):
    """A wide lens before distant lamps: discs of light, a blurred table, one cup in focus."""
    random = np.random.default_rng(5)
    parts = [path(), camera((0, 0.8, 2.6), (0, 0.45, 0), 34, lens(0.12, 2.65)), floor(8, bsdf("roughplastic", rgb("diffuse_reflectance", 0.3, 0.2, 0.15), number("alpha", 0.2)))]
    for _ in range(22):
        color = np.round(random.uniform(0.3, 1, 3) * 30, 3)
        parts.append(ball((random.uniform(-4, 4), random.uniform(0.3, 3.0), random.uniform(-7, -4)), 0.09, diffuse(0.5), emitter(*color)))
    parts += [rod((0, 0, 0), (0, 0.5, 0), 0.25, bsdf("twosided", diffuse(0.75, 0.72, 0.65))), ball((0.6, 0.22, 0.5), 0.22, metal(0.1, 0.9, 0.7, 0.3)), ball((-0.7, 0.3, -0.8), 0.3, diffuse(0.2, 0.35, 0.6))]
    parts += [placed("rectangle", scale(9, 5, 1) + move(0, 3, -8), diffuse(0.25)), lamp(0.8, 2.6, 1.0, 0.25, 20, 18, 14)]
    return "".join(parts)


def smoke(folder, t):
    """A cloud of varying density over a floor with balls."""
    n = 32
    z, y, x = (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij")) + 0.5) / n
    puffs = sum(np.sin(f * x + a) * np.sin(f * y + 2 * a) * np.sin(f * z + 3 * a) for f, a in ((9, 1), (17, 2), (29, 3)))
    density = np.clip(1.4 - 9 * ((x - 0.5) ** 2 + (y - 0.5) ** 2 + (z - 0.5) ** 2) + 0.6 * puffs, 0, None)
    head = b"VOL\x03" + np.array([1, n, n, n, 1], "<i4").tobytes() + np.array([0, 0, 0, 1, 1, 1], "<f4").tobytes()
    (folder / "smoke.vol").write_bytes(head + density.astype("<f4").tobytes())
    grid = '<volume type="gridvolume" name="sigma_t"><string name="filename" value="smoke.vol"/><transform name="to_world">' + scale(1.6, 1.3, 1.2) + move(-0.8, 0.35, -0.6) + "</transform></volume>"
    air = '<medium type="heterogeneous" name="interior">' + grid + rgb("albedo", 0.9, 0.88, 0.85) + number("scale", 4) + '<phase type="isotropic"/></medium>'
    return "".join([
        path(24, "volpath"),
        camera((0.4, 1.3, 3.8), (0, 0.8, 0), 34),
        environment(sky(folder, "smoke-sky.pfm", (0.35, 0.25), 90, 0.04)),
        floor(5, diffuse(0.45, 0.42, 0.38)),
        placed("cube", scale(0.799, 0.649, 0.599) + move(0, 1.0, 0), bsdf("null"), air),
        ball((1.1, 0.3, 0.4), 0.3, diffuse(0.7, 0.2, 0.1)), ball((-1.1, 0.3, 0.2), 0.3, metal(0.15, 0.9)),
    ])


# Scenes that nothing was chosen by.


def kitchen(folder, t):
    """Glossy tiles, copper pots and a board under a strip lamp and a spot."""
    y, x = coordinates(256)
    joints = ((x * 12) % 1 < 0.06) | ((y * 12) % 1 < 0.06)
    pfm(folder / "kitchen-tiles.pfm", mix(joints, (0.25, 0.24, 0.22), (0.8, 0.82, 0.78)) * (0.85 + 0.15 * smooth((256, 256), 12, 41))[..., None])
    grain = 0.5 + 0.5 * np.sin(90 * y + 10 * smooth((256, 256), 4, 42))
    pfm(folder / "kitchen-board.pfm", mix(grain, (0.5, 0.3, 0.15), (0.62, 0.42, 0.24)))
    tiles = bsdf("plastic", bitmap("diffuse_reflectance", "kitchen-tiles.pfm"))
    copper = metal(0.14, 0.95, 0.6, 0.45)
    look = '<lookat origin="-1.4, 2.6, 1.6" target="0.1, 0.2, 0" up="0, 1, 0"/>'
    spot = f'<emitter type="spot">{rgb("intensity", 30, 26, 20)}{number("cutoff_angle", 28)}<transform name="to_world">{look}</transform></emitter>'
    return "".join([
        path(12),
        camera((0.3, 1.35, 3.3), (0, 0.5, -0.2), 36),
        placed("rectangle", scale(2.6, 1.6, 1) + move(0, 1.6, -1.2), tiles),
        floor(3, bsdf("roughplastic", rgb("diffuse_reflectance", 0.18, 0.2, 0.22), number("alpha", 0.15))),
        placed("cube", scale(0.55, 0.03, 0.35) + turn("y", 12) + move(0.5, 0.03, 0.6), painted("kitchen-board.pfm")),
        rod((-0.7, 0, -0.2), (-0.7, 0.5, -0.2), 0.36, bsdf("twosided", copper)), rod((0.35, 0, -0.5), (0.35, 0.35, -0.5), 0.25, bsdf("twosided", metal(0.05, 0.8))),
        ball((0.45, 0.17, 0.6), 0.11, bsdf("principled", rgb("base_color", 0.75, 0.12, 0.05), number("roughness", 0.25), number("specular", 0.5))),
        ball((0.7, 0.16, 0.5), 0.1, diffuse(0.35, 0.55, 0.12)), ball((1.2, 0.3, -0.4), 0.3, bsdf("dielectric")),
        placed("rectangle", scale(1.5, 0.05, 1) + turn("x", 90) + move(0, 2.4, -0.6), diffuse(0.5), emitter(30, 30, 27)),
        spot,
    ])


def stairs(folder, t):
    """Steps and railings that a lamp behind a baffle lights by way of the ceiling alone."""
    wall, wood = diffuse(0.72, 0.7, 0.66), diffuse(0.4, 0.24, 0.12)
    parts = [path(16), camera((-0.9, 1.5, 3.4), (0.15, 0.95, -0.3), 44), floor(2, diffuse(0.35, 0.36, 0.38)), walls(1.8, 3.0, 2.0, diffuse(0.55, 0.25, 0.2), wall, wall)]
    for k in range(8):
        parts.append(placed("cube", scale(0.5, 0.03, 0.14) + move(0.9, 0.2 + 0.2 * k, 1.0 - 0.26 * k), wood))
        parts.append(bar((0.42, 0.22 + 0.2 * k, 1.0 - 0.26 * k), (0.42, 0.9 + 0.2 * k, 1.0 - 0.26 * k), 0.012, metal(0.3, 0.6)))
    parts += [bar((0.42, 0.9, 1.0), (0.42, 2.3, -0.82), 0.02, wood), ball((-0.8, 0.35, 0.2), 0.35, bsdf("roughplastic", rgb("diffuse_reflectance", 0.2, 0.4, 0.55), number("alpha", 0.2)))]
    up = placed("rectangle", scale(0.9, 0.15, 1) + turn("x", -90) + move(-0.7, 2.3, -1.7), diffuse(0.5), emitter(60, 54, 44))
    return "".join([*parts, up, placed("cube", scale(0.95, 0.15, 0.02) + move(-0.7, 2.35, -1.5), wall), placed("cube", scale(0.95, 0.02, 0.25) + move(-0.7, 2.24, -1.75), wall)])


def shelf(folder, t):
    """Books with printed backs between two coloured lamps; a sequence."""
    random = np.random.default_rng(29)
    y, x = coordinates(128)
    print_ = (smooth((128, 128), 24, 43) > 0.62) & ((x * 9) % 1 < 0.6)
    for k in range(4):
        pfm(folder / f"shelf-back-{k}.pfm", mix(print_, (0.85, 0.75, 0.4), random.uniform(0.03, 0.5, 3)))
    parts = [path(), camera((0.7 - 0.03 * t, 1.05, 2.7 - 0.015 * t), (0.05, 0.75, -0.5), 40), floor(2.4, diffuse(0.3, 0.2, 0.13)), walls(2.2, 2.5, 2.2, diffuse(0.5), diffuse(0.45, 0.5, 0.5), diffuse(0.6, 0.58, 0.52))]
    for row in range(3):
        parts.append(placed("cube", scale(1.2, 0.025, 0.25) + move(0, 0.12 + 0.55 * row, -0.8), diffuse(0.42, 0.28, 0.16)))
        at = -1.1
        while at < 1.0:
            half, high = random.uniform(0.025, 0.06), random.uniform(0.16, 0.23)
            lean = turn("z", round(random.uniform(-2, 2), 2))
            book = painted(f"shelf-back-{random.integers(4)}.pfm") if random.uniform() < 0.7 else diffuse(*random.uniform(0.05, 0.6, 3).round(3))
            parts.append(placed("cube", scale(round(half, 4), round(high, 4), 0.17) + lean + move(round(at + half, 4), round(0.15 + high + 0.55 * row, 4), -0.78), book))
            at += 2 * half + random.uniform(0.004, 0.03)
    parts += [ball((0.8, 0.2, 0.3), 0.2, metal(0.05, 0.9, 0.85, 0.7)), ball((-0.9, 0.25, 0.2), 0.25, bsdf("plastic", rgb("diffuse_reflectance", 0.1, 0.35, 0.2)))]
    return "".join([*parts, lamp(-1.2, 2.4, 0.6, 0.2, 45, 24, 10), lamp(1.3, 2.4, 0.2, 0.2, 10, 18, 40)])


def lantern(folder, t):
    """Small lamps in globes of rough and clear glass in a mist, over wet ground."""
    air = '<medium type="homogeneous" name="interior">' + rgb("sigma_t", 0.1) + rgb("albedo", 0.95) + '<phase type="hg"><float name="g" value="0.6"/></phase></medium>'
    wet = bsdf("principled", rgb("base_color", 0.12, 0.13, 0.15), number("roughness", 0.12), number("specular", 0.6))
    parts = [path(24, "volpath"), camera((0, 1.2, 4.6), (0, 0.7, 0), 34), floor(6, wet), '<emitter type="constant">' + rgb("radiance", 0.03, 0.04, 0.07) + "</emitter>"]
    parts += [placed("cube", scale(2.6, 1.6, 2.2) + move(0, 1.62, 0), bsdf("null"), air), placed("rectangle", scale(2.5, 1.5, 1) + move(0, 1.5, -2), diffuse(0.45, 0.4, 0.36))]
    for k, (at, tint) in enumerate((((-1.0, 0.9, 0.1), (60, 36, 14)), ((0.25, 1.3, -0.6), (50, 44, 36)), ((1.1, 0.7, 0.5), (16, 30, 60)))):
        glass = bsdf("roughdielectric", number("alpha", 0.2)) if k % 2 == 0 else bsdf("thindielectric")
        parts += [ball(at, 0.22, glass), ball(at, 0.09, diffuse(0.5), emitter(*tint)), bar((at[0], 0, at[2]), (at[0], at[1] - 0.22, at[2]), 0.02, metal(0.3, 0.5))]
    return "".join([*parts, placed("cube", scale(0.3, 0.25, 0.25) + turn("y", 25) + move(-0.2, 0.25, 0.9), diffuse(0.6, 0.3, 0.2))])


def court(folder, t):
    """Columns, a mesh of bumps and a fence of masks under a bright sky with a directional sun; a sequence."""
    write_ply(folder / "court.ply", *(lambda v, f: (0.5 * v, f))(*bumpy(24, 0.2, 13)))
    y, x = coordinates(64)
    pfm(folder / "court-fence.pfm", np.repeat((((x + y) * 6 % 1 < 0.25) | ((x - y) * 6 % 1 < 0.25)).astype(float)[..., None], 3, 2))
    pfm(folder / "court-sand.pfm", mix(smooth((256, 256), 64, 44), (0.6, 0.5, 0.35), (0.4, 0.33, 0.24)))
    fence = bsdf("mask", bitmap("opacity", "court-fence.pfm", 3), bsdf("twosided", metal(0.3, 0.55)))
    parts = [path(12), camera((1.6 + 0.03 * before(t), 1.3, 4.0), (0, 0.75, -0.2), 38), environment(sky(folder, "court-sky.pfm", strength=0.0), 70, 0.8), floor(6, painted("court-sand.pfm", 4))]
    parts += [f'<emitter type="directional"><vector name="direction" x="0.55" y="-0.75" z="-0.35"/>{rgb("irradiance", 4.5, 4.0, 3.2)}</emitter>']
    for k in range(5):
        parts.append(rod((-1.6 + 0.8 * k, 0, -1.1), (-1.6 + 0.8 * k, 1.8, -1.1), 0.14, diffuse(0.7, 0.66, 0.58)))
    parts += [placed("cube", scale(1.9, 0.12, 0.2) + move(0, 1.9, -1.1), diffuse(0.65, 0.6, 0.52)), placed("cube", scale(0.35, 0.2, 0.35) + move(0, 0.2, 0.2), diffuse(0.5))]
    parts += [f'<shape type="ply"><string name="filename" value="court.ply"/><transform name="to_world">{move(0, 0.88, 0.2)}</transform>{bsdf("roughplastic", rgb("diffuse_reflectance", 0.3, 0.42, 0.36), number("alpha", 0.15))}</shape>']
    return "".join([*parts, placed("rectangle", scale(0.7, 0.4, 1) + turn("y", -30) + move(1.2, 0.4, 0.6), fence)])


CHOOSING = [box, gallery, spheres, reeds, glasses, fog, row, bulbs]
JUDGING = [window, workshop, bottles, carpet, stone, hedge, bokeh, smoke]
FRESH = [kitchen, stairs, shelf, lantern, court]
SETS = {"choosing": CHOOSING, "judging": JUDGING, "fresh": FRESH}
ALL = CHOOSING + JUDGING + FRESH
#: Scenes whose camera moves with the frame.
MOVING = [gallery, spheres, reeds, bulbs, window, workshop, carpet, hedge, shelf, court]


def write(scene, folder):
    """Writes the files of a scene's frames, and all that they name, into a folder that holds nothing else; the paths of the frames."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    files = [folder / f"{scene.__name__}-{k}.xml" for k in range(FRAMES if scene in MOVING else 1)]
    for k, file in enumerate(files):
        file.write_text(f'<scene version="3.0.0">\n{scene(folder, k)}\n</scene>\n')
    return files


def world_to_pixel(file):
    """The matrix from world points to pixels of a scene's camera, whose field of view is vertical; 3 rows of 4."""
    text = file.read_text()
    sensor = text[text.index("<sensor") : text.index("</sensor>")]
    origin, target = (np.array([float(v) for v in re.search(f'{name}="([^"]*)"', sensor)[1].split(",")]) for name in ("origin", "target"))
    fov = float(re.search(r'name="fov" value="([^"]*)"', sensor)[1])
    unit = lambda v: v / np.linalg.norm(v)
    forward = unit(target - origin)
    right = unit(np.cross(forward, (0, 1, 0)))
    axes = np.array([right, np.cross(forward, right), forward])
    focal = SIZE[1] / 2 / np.tan(np.radians(fov) / 2)
    pixel = np.array([[focal, 0, SIZE[0] / 2], [0, focal, SIZE[1] / 2], [0, 0, 1]])
    return (pixel @ np.concatenate([axes, -(axes @ origin)[:, None]], 1)).tolist()


def content(folder):
    """What pictures of the scene that :func:`write` put into a folder show."""
    return {"scene": digest(sorted(folder.iterdir())), "layers": LAYERS, "reference": REFERENCE_SAMPLES}


def kept(folder):
    """The key of the pictures in a folder: their content, and who rendered them."""
    file = folder / "key.json"
    return json.loads(file.read_text()) if file.exists() else {}


def render(folder):
    """Renders what `folder` lacks, or has of another content or by another version: SCENE/sppN_FRAME.exr with layers, SCENE/truth.exr
    and, for moving cameras, SCENE/cameras.json; `set.json` lists the sets, samples and frames."""
    for scene in ALL:
        out = folder / scene.__name__
        files = write(scene, folder / "scenes" / scene.__name__)
        out.mkdir(parents=True, exist_ok=True)
        key = {**content(files[0].parent), "by": our_version()}
        if kept(out) != key:
            print(f"denoise set: {scene.__name__} by {key['by']}, in place of {kept(out).get('by', 'none')}", flush=True)
            for picture in out.glob("*.exr"):
                picture.unlink()
            (out / "key.json").write_text(json.dumps(key))
        if scene in MOVING:
            cameras = [{"frame": k, "world_to_pixel": world_to_pixel(file)} for k, file in enumerate(files)]
            (out / "cameras.json").write_text(json.dumps({"frames": cameras}))
        for samples in SAMPLES:
            for k, file in enumerate(files):
                picture = out / f"spp{samples}_{k:03}.exr"
                if not picture.exists():
                    program("render", file, "-o", picture, "--spp", samples, "--seed", 101 * k + samples, "--aov", LAYERS)
        if not (out / "truth.exr").exists():
            program("render", files[-1], "-o", out / "truth.exr", "--spp", REFERENCE_SAMPLES, "--seed", 99991)
    found = {
        "sets": {name: [scene.__name__ for scene in members] for name, members in SETS.items()},
        "samples": SAMPLES,
        "frames": {scene.__name__: FRAMES if scene in MOVING else 1 for scene in ALL},
    }
    (folder / "set.json").write_text(json.dumps(found, indent=1))


def rendered():
    """The folder of the rendered set, what its `set.json` holds, and a line for the table on who rendered it.

    `PHOTOFIT_DENOISE_SET` names a finished set in another folder, which is taken as it is.
    """
    named = os.environ.get("PHOTOFIT_DENOISE_SET")
    folder = pathlib.Path(named or WORK / "denoise-set")
    if not named:
        render(folder)
    keys, other = {scene.__name__: kept(folder / scene.__name__) for scene in ALL}, []
    # The set of this folder has just been compared.
    with tempfile.TemporaryDirectory(dir=WORK) as work:
        for scene in ALL if named else []:
            now, key = content(write(scene, pathlib.Path(work) / scene.__name__)[0].parent), keys[scene.__name__]
            if key and key != {**now, "by": key["by"]}:
                other.append(scene.__name__)
    by = sorted({key.get("by", "a version that left no keys") for key in keys.values()})
    told = f"Pictures rendered by {'; '.join(by)}."
    if other:
        told += f" Of other contents than those of `denoise_scenes.py`: {', '.join(other)}."
    print(told, flush=True)
    return folder, json.loads((folder / "set.json").read_text()), told


def last_frame(folder, found, name, samples):
    """The file of the frame that is judged."""
    return folder / name / f"spp{samples}_{found['frames'][name] - 1:03}.exr"


def display(image):
    """Radiance as it is shown: gamma 2.2, cut to [0, 1]."""
    return np.clip(np.nan_to_num(image), 0, 1).astype(np.float32) ** np.float32(1 / 2.2)


def psnr(shown, truth):
    return float(-10 * np.log10(((shown - truth) ** 2).mean()))


def pictures(path):
    """The layers of an EXR file by name, three channels each; the colour is `color`."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    parts = {name: np.ascontiguousarray(np.array(part, np.float32)[..., :3]) for name, part in mi.Bitmap(str(path)).split()}
    parts["color"] = parts.get("<root>", parts.get("root", next(iter(parts.values()))))
    return parts
