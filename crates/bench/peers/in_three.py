"""Assets in three.js beside a reference, as an engine shows them: one sample a pixel, mip levels, a prefiltered environment.

Cameras, lights and figures are those of `in_cycles`, without shadows and light between surfaces. The reference is drawn with many samples a pixel,
which are averaged in linear light.
"""

import hashlib
import inspect
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

import numpy as np

import in_cycles
from harness import ROOT, digest, first_line
from reducers import tool

HERE = pathlib.Path(__file__).parent / "three"
MODULES = ROOT / "target" / "three"
#: Samples a side of a pixel of the reference.
PER_AXIS = 4


def chromium():
    """The path of the browser; None where there is none."""
    names = ["chromium", "chromium-browser", "google-chrome"]
    return os.environ.get("PHOTOFIT_CHROMIUM") or next(filter(None, map(shutil.which, names)), None)


def installed(package):
    """The version of a package in MODULES; None where it is not there."""
    file = MODULES / "node_modules" / package / "package.json"
    return json.loads(file.read_text())["version"] if file.exists() else None


def lacking():
    """What is not installed, in words; None where all is there."""
    pins = json.loads((HERE / "package.json").read_text())["dependencies"]
    missing = [] if tool("node") else ["node"]
    missing += [] if first_line(chromium(), "--version") else ["Chromium (PHOTOFIT_CHROMIUM or PATH)"]
    missing += [f"{name} {pin}, see three/package.json beside this driver" for name, pin in pins.items() if installed(name) != pin]
    return f"not installed: {', '.join(missing)}" if missing else None


def version():
    return f"three.js {installed('three')} in {first_line(chromium(), '--version')}"


def code():
    """The digest of what draws and compares."""
    sources = [inspect.getsource(module) for module in (in_cycles, sys.modules[__name__])]
    drawn = digest(sorted(HERE.glob("*.*")))
    return hashlib.sha256("".join([drawn, *sources]).encode()).hexdigest()[:16]


def y_up(v):
    """Blender's z up to that of glTF."""
    x, y, z = map(float, v)
    return [x, z, -y]


def pictures(path, environment, count, size, around, per_axis=1, shift=0):
    """Radiance, premultiplied, float32 (count, size, size, 4), rows from the top, of views around the sphere `around` (z up); moved by
    `shift` pixels to the left and up."""
    center, radius = around
    views = [{"eye": y_up(eye), "sun": None if sun is None else y_up(sun)} for eye, sun in in_cycles.views(count)]
    width = size * per_axis
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "pictures"
        job = {
            "environment": str(environment),
            "width": width,
            "shift": shift * per_axis,
            "views": views,
            "center": y_up(center),
            "distance": radius / math.sin(in_cycles.FIELD_OF_VIEW / 2) * 1.01,
            "fov": math.degrees(in_cycles.FIELD_OF_VIEW),
            "file": str(path),
            "out": str(out),
        }
        command = [tool("node"), HERE / "draw.mjs", MODULES, chromium()]
        done = subprocess.run(list(map(str, command)), input=json.dumps(job), capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"three.js does not draw {path}: {' '.join(done.stderr.split())[:200]}")
        halves = np.fromfile(out, np.float16).reshape(count, size, per_axis, size, per_axis, 4)
    if not all(halves[..., 3].any((1, 2, 3, 4))):
        raise RuntimeError(f"three.js shows nothing of {path}")
    return halves.astype(np.float32).mean((2, 4))


def likeness(reference, candidate):
    """PSNR and FLIP of each view, of pictures as :func:`pictures` gives them."""
    return in_cycles.likeness(*(np.stack([seen, seen]) for seen in (reference, candidate)))
