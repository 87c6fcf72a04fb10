"""Tables against other programs: `cargo xtask bench peers [NAME...]`, or `python3 crates/bench/peers/run.py [NAME...]`.

Each driver is one file beside this one with a line ABOUT, the packages it NEEDS (at the versions of requirements.txt)
and a function `table()` that returns Markdown; `ready()`, where there is one, says what the system lacks, `title()`, asked after
the table, what stands in place of ABOUT above it, and `versions()` what else it ran. What it returns is written to
out/bench/peers/NAME.md, below the versions of all programs. A driver whose packages are missing is skipped with one line that
says how to install them; with `--strict` that is an error.
"""

import ast
import importlib
import importlib.metadata
import os
import pathlib
import sys
import time
import traceback

HERE = pathlib.Path(__file__).resolve().parent
NAMES = ["embree", "mitsuba", "mitsuba_gradients", "mitsuba_recover", "oidn", "denoise_stages", "deodr", "skimage", "filters", "judge", "ratios", "ratios_three", "levels_three"]


def pins():
    lines = (HERE / "requirements.txt").read_text().splitlines()
    return dict(line.split("==") for line in lines if "==" in line and not line.startswith("#"))


def needs(name):
    """The packages of a driver, without importing it: that would need them."""
    tree = ast.parse((HERE / f"driver_{name}.py").read_text())
    found = [s.value for s in tree.body if isinstance(s, ast.Assign) and getattr(s.targets[0], "id", "") == "NEEDS"]
    return ast.literal_eval(found[0])


def missing(needs):
    """What is not installed, or installed at another version, as arguments of pip."""
    wanted, out = pins(), []
    for package in needs:
        try:
            found = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found = None
        if found != wanted[package]:
            out.append(f"{package}=={wanted[package]}")
    return out


def main(arguments):
    strict = "--strict" in arguments
    names = [a for a in arguments if a != "--strict"] or NAMES
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        print(f"peers: no driver `{unknown[0]}`; there are {', '.join(NAMES)}")
        return 2
    sys.path.insert(0, str(HERE))
    folder = HERE.parents[2] / "out" / "bench" / "peers"
    folder.mkdir(parents=True, exist_ok=True)
    failed = False
    for name in names:
        lacking = missing(needs(name))
        if lacking:
            print(f"peers: {name} skipped: {sys.executable} -m pip install {' '.join(lacking)}")
            failed |= strict
            continue
        # The files have a prefix: a driver may be called like the package that it drives.
        driver = importlib.import_module(f"driver_{name}")
        # Not above: it needs numpy.
        harness = importlib.import_module("harness")
        hint = getattr(driver, "ready", lambda: None)()
        if hint:
            print(f"peers: {name} skipped: {hint}")
            failed |= strict
            continue
        print(f"# {name}: {driver.ABOUT}", flush=True)
        start = time.perf_counter()
        harness.RAN.clear()
        try:
            body = driver.table()
        except Exception:
            traceback.print_exc()
            failed = True
            continue
        packages = [f"{p} {pins()[p]}" for p in driver.NEEDS]
        versions = "; ".join([*sorted(harness.RAN), ", ".join([*packages, *getattr(driver, "versions", list)()])])
        title = getattr(driver, "title", lambda: driver.ABOUT)()
        text = f"# {title}\n\n`cargo xtask bench peers {name}`; {versions}.\n\n{body}\n"
        (folder / f"{name}.md").write_text(text)
        print(text)
        print(f"wrote {folder / (name + '.md')} after {time.perf_counter() - start:.0f} s", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    # Blender as a module may crash while the interpreter ends.
    os._exit(status) if "bpy" in sys.modules else sys.exit(status)
