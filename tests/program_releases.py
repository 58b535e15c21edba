"""Compare with the oldest and the newest release of other programs: `make test-releases`.

Each release from the Python package index is installed in a temporary folder, its tests run with it, and
docs/cross-validation.md lists the deviations. The oldest release is the lower bound of the requirement.

    python tests/program_releases.py COLMAP "Mitsuba 3"
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
import tomllib
from itertools import product
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
UV = Path(sys.executable).with_name("uv")
RESOLUTIONS = ("lowest-direct", "highest")


class Program(NamedTuple):
    """Program on the Python package index and the tests that compare with it."""

    requirement: str
    """Name of a package in the extras of pyproject.toml, or a requirement with a lower bound."""
    tests: str
    variable: str = ""
    """Variable with the interpreter of a separate environment; else the release is on the path of the tests."""
    pythons: tuple[str, str] = ("", "")
    """Versions of Python for the oldest and the newest release, if they support a single one."""


PEERS = "tests/full/test_camera_peers.py"
MAPS = "tests/interop/view_maps/test_consumers.py"
IMAGES = "tests/interop/ray_tables/test_programs.py"
PROGRAMS = {
    "Optiland": Program("optiland", "tests/full -k optiland"),
    "Mitsuba 3": Program(
        "mitsuba",
        "tests/optics/tracing/test_mitsuba.py tests/simulation/test_mitsuba_images.py "
        "tests/interop/ray_tables/test_mitsuba_sensor.py",
    ),
    "OpenCV": Program(
        "opencv-contrib-python-headless>=4.13", f"{MAPS} {PEERS} -k 'opencv or omnidir'"
    ),
    "FFmpeg": Program("av>=14", f"{MAPS} -k ffmpeg"),
    "COLMAP": Program("pycolmap", f"{PEERS} tests/full/test_colmap.py -k colmap"),
    "Blender": Program(
        "bpy>=4.5", f"{IMAGES} -k 'blender and not oldest'", "OMNIMIRROR_BLENDER", ("3.11", "3.13")
    ),
    "Newton": Program("newton>=1.4", f"{IMAGES} -k newton", "OMNIMIRROR_NEWTON"),
    "PyTorch": Program("torch", "tests/interop/torch tests/full/test_torch.py -k dewarper"),
    "OpenImageIO": Program("OpenImageIO", f"{MAPS} -k openimageio"),
}
"""Names as in the sections of the page."""


def requirement(program: Program) -> str:
    """Return the requirement of a program, from pyproject.toml unless it is complete."""
    if ">=" in program.requirement:
        return program.requirement
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    extras = tomllib.loads(text)["project"]["optional-dependencies"]
    lines = [line for extra in extras.values() for line in extra]
    return next(line for line in lines if line.startswith(f"{program.requirement}>="))


def installed(program: Program, resolution: str, folder: Path) -> dict[str, str]:
    """Install a release in a folder; return the variables by which the tests use it."""
    install = [UV, "pip", "install", "--quiet", "--resolution", resolution, requirement(program)]
    if not program.variable:
        run(*install, "--python", sys.executable, "--target", folder)
        return {"PYTHONPATH": str(folder)}
    python = program.pythons[RESOLUTIONS.index(resolution)] or sys.executable
    run(UV, "venv", "--quiet", "--no-python-downloads", "--python", python, folder)
    interpreter = folder / "bin" / "python"
    run(*install, "--python", interpreter)
    return {program.variable: str(interpreter)}


def run(*command: str | Path, **variables: str) -> None:
    """Run a command in the root folder of the repository; raise an error if it fails."""
    subprocess.run(command, cwd=ROOT, env=os.environ | variables, check=True)


def compare(program: Program, resolution: str, output: Path) -> None:
    """Run the tests of a program with a release; raise an error if they fail or are skipped."""
    before = output.stat().st_mtime_ns if output.exists() else None
    tests = (*shlex.split(program.tests), "--cross-validation", str(output), "--timeout", "3600")
    with tempfile.TemporaryDirectory() as folder:
        variables = installed(program, resolution, Path(folder) / "release")
        run(sys.executable, "-m", "pytest", "-q", *tests, **variables)
    if not output.exists() or output.stat().st_mtime_ns == before:
        raise LookupError("all tests were skipped")


def main() -> None:
    """Compare with the oldest and the newest release of the given programs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "program", nargs="*", help=f"Programs; default: all of {', '.join(PROGRAMS)}."
    )
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs/cross-validation.md")
    parser.add_argument(
        "--oldest",
        action="store_true",
        help="Compare with the oldest releases only; `make test-full` compares with the installed ones.",
    )
    options = parser.parse_args()
    if unknown := sorted(set(options.program) - set(PROGRAMS)):
        parser.error(f"programs must be among {', '.join(PROGRAMS)}; got {', '.join(unknown)}")
    resolutions = RESOLUTIONS[:1] if options.oldest else RESOLUTIONS
    failed = []
    for name, resolution in product(options.program or PROGRAMS, resolutions):
        print(f"{name}, {resolution}", flush=True)
        try:
            compare(PROGRAMS[name], resolution, options.output)
        except (subprocess.CalledProcessError, LookupError) as error:
            failed.append(f"{name}, {resolution}: {error}")
    if failed:
        sys.exit("\n".join(failed))


if __name__ == "__main__":
    main()
