"""What several drivers share: our programs, meshes, medians, tables."""

import functools
import hashlib
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import time

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[3]
WORK = ROOT / "out" / "bench" / "peers" / "work"
WORK.mkdir(parents=True, exist_ok=True)
#: The versions of our programs that were asked for or ran, for the head of the table.
RAN = set()


def digest(files):
    """SHA-256 of the contents of files."""
    sums = [hashlib.sha256(pathlib.Path(file).read_bytes()).hexdigest() for file in files]
    return hashlib.sha256("".join(sums).encode()).hexdigest()


@functools.cache
def first_line(*command):
    """What a program says first; empty where it says nothing."""
    try:
        done = subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True)
    except OSError:
        return ""
    return next(iter((done.stdout + done.stderr).strip().splitlines()), "").strip()


@functools.cache
def version_of(exe, variable):
    """The version of the sources, or the SHA-256 of a program that they do not tell: one that `variable` names."""
    sources = "" if os.environ.get(variable) else first_line("git", "describe", "--always", "--dirty")
    if not sources or sources.endswith("-dirty"):
        sources = f"{sources} program {hashlib.sha256(pathlib.Path(exe).read_bytes()).hexdigest()[:8]}".strip()
    return sources


def our_version():
    """`photofit --version` and :func:`version_of` it."""
    version = f"{first_line(built(), '--version')}, {version_of(built(), 'PHOTOFIT_PEER_PROGRAM')}"
    RAN.add(version)
    return version


def released(name):
    """Where cargo puts a release build."""
    return pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / name


@functools.cache
def built():
    """The program that `PHOTOFIT_PEER_PROGRAM` names, which is built already; without it the release build, which is made."""
    named = os.environ.get("PHOTOFIT_PEER_PROGRAM")
    if named:
        return named
    subprocess.run(["cargo", "build", "--release", "--quiet", "-p", "photofit-cli"], cwd=ROOT, check=True)
    return released("photofit")


def program(*arguments, **environment):
    """Runs `photofit ARGUMENTS`; returns the CPU seconds of the process, start and end included."""
    our_version()
    command = [built(), *map(str, arguments)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, **environment}, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def suite(name, baseline=False, **environment):
    """Runs a suite of photofit-bench; returns its rows from out/bench/NAME.json.

    `PHOTOFIT_PEER_BENCH` names a photofit-bench that is built already; without it the release build is made and run.
    """
    named = os.environ.get("PHOTOFIT_PEER_BENCH")
    command = [named] if named else ["cargo", "run", "--release", "--quiet", "-p", "photofit-bench", "--"]
    command += [name, "--baseline"] if baseline else [name]
    environment = {k: str(v) for k, v in environment.items()}
    subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, **environment}, stdout=subprocess.DEVNULL)
    RAN.add(f"photofit-bench, {version_of(named or released('photofit-bench'), 'PHOTOFIT_PEER_BENCH')}")
    return json.loads((ROOT / "out" / "bench" / f"{name}.json").read_text())


def suite_with_python(name):
    """A suite whose baseline is a Python script of this folder, run by this interpreter; its Markdown without the title."""
    suite(name, baseline=True, PHOTOFIT_PYTHON=sys.executable)
    lines = (ROOT / "out" / "bench" / f"{name}.md").read_text().splitlines()
    return "\n".join(line for line in lines if not line.startswith("# ")).strip()


def compiled(source, *flags):
    """The path of what the C or C++ compiler makes of a file of this folder."""
    out = WORK / f"{source.replace('.', '-')}-{os.getpid()}"
    compiler = "c++" if source.endswith(".cpp") else "cc"
    subprocess.run([compiler, "-O2", *flags, "-o", out, pathlib.Path(__file__).with_name(source), "-ldl"], check=True)
    return out


def suite_by_cpu(name, **environment):
    """A suite whose times are CPU seconds of the process: for rows of one thread, where other programs share the cores.

    Returns the rows as (method, case) -> (seconds, metrics).
    """
    clock = compiled("cpu_clock.c", "-shared", "-fPIC")
    rows = suite(name, LD_PRELOAD=clock, **environment)["rows"]
    return {(row["method"], row["case"]): row for row in rows}


def median_seconds(work, repetitions=5, clock=time.perf_counter):
    """Median seconds of `work()` by the clock after one run that is not counted."""
    work()
    times = []
    for _ in range(repetitions):
        start = clock()
        work()
        times.append(clock() - start)
    return statistics.median(times)


def sphere(frequency, amplitude=0.12, seed=7):
    """An icosahedron divided into 20 f^2 triangles, on a sphere with bumps; float32 (n, 3) and int32 (m, 3), outward."""
    golden = (1 + 5**0.5) / 2
    corners = np.array([[0, s, t * golden] for s in (-1, 1) for t in (-1, 1)], float)
    corners = np.concatenate([corners, corners[:, [2, 0, 1]], corners[:, [1, 2, 0]]])
    near = lambda a, b: np.isclose(((corners[a] - corners[b]) ** 2).sum(), 4)
    faces = [
        (a, b, c)
        for a in range(12) for b in range(a + 1, 12) for c in range(b + 1, 12)
        if near(a, b) and near(b, c) and near(a, c)
    ]
    points, triangles, known = [], [], {}
    for a, b, c in faces:
        if np.dot(corners[a], np.cross(corners[b], corners[c])) < 0:
            b, c = c, b
        index = {}
        for i in range(frequency + 1):
            for j in range(frequency + 1 - i):
                p = corners[a] * (frequency - i - j) + corners[b] * i + corners[c] * j
                p = p / np.linalg.norm(p)
                key = tuple(np.round(p * 1e6).astype(int))
                index[i, j] = known.setdefault(key, len(points))
                if index[i, j] == len(points):
                    points.append(p)
        for i in range(frequency):
            for j in range(frequency - i):
                triangles.append((index[i, j], index[i + 1, j], index[i, j + 1]))
                if i + j + 2 <= frequency:
                    triangles.append((index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]))
    points, random = np.array(points), np.random.default_rng(seed)
    radius = np.ones(len(points))
    for octave in range(4):
        for _ in range(3):
            wave = random.normal(size=3)
            wave *= 3 * 2**octave / np.linalg.norm(wave)
            radius += amplitude / 2**octave / 3 * np.cos(points @ wave + random.uniform(0, 2 * np.pi))
    return (points * radius[:, None]).astype(np.float32), np.array(triangles, np.int32)


def write_ply(path, vertices, triangles):
    """A binary PLY file of positions and triangles."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(triangles), [("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, triangles
    pathlib.Path(path).write_bytes(head.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())


def markdown(head, rows):
    """A table; numbers with three digits."""
    cell = lambda v: f"{v:.3g}" if isinstance(v, float) else str(v)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in lines)
