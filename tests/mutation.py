"""Mutation testing: change single expressions of a module and count how many changes its tests detect.

Run by ``make mutation``. Cosmic Ray generates the mutants; the table ``tests/mutation.toml`` lists modules with their
tests, and mutants that were reviewed as equivalent. Mutants are written into a copy of the checkout, never into the
checkout itself.
"""

from __future__ import annotations

import argparse
import ast
import compileall
import fnmatch
import os
import random
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

CHECKOUT = Path(__file__).parents[1]
TABLE = CHECKOUT / "tests" / "mutation.toml"
OUTSIDE_GIT = ("src/omnimirror/base/_native*",)
"""Built files that a copy needs although git ignores them."""
PRELOADED = (
    "numpy scipy.optimize scipy.interpolate cv2 pytest hypothesis pydantic click matplotlib.pyplot"
)
"""Imported once; every test run is a fork of the process that holds them."""
IDENTITY = re.compile(r"ReplaceComparisonOperator_(Is_Eq|Eq_Is|IsNot_NotEq|NotEq_IsNot)$")
"""Operators that are not applied: None, bool, enumerations and small integers are singletons."""
MEMORY = 8 << 30
"""Data of one process of a test run in bytes: some mutants allocate without end."""
# An editable installation locates the package by a finder that precedes sys.path.
SITE = "import sys\nsys.meta_path[:] = [f for f in sys.meta_path if not type(f).__name__.startswith('ScikitBuild')]\n"


@dataclass(frozen=True)
class Mutant:
    """One changed expression, with the lines it changes."""

    source: str
    before: str
    after: str


@dataclass
class Score:
    """Results of one module."""

    killed: int = 0
    equivalent: int = 0
    survivors: list[Mutant] = field(default_factory=list)

    def __str__(self) -> str:
        return f"{self.killed:8d} {len(self.survivors):9d} {self.equivalent:11d}"


def declarations(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return the spans (line, column) that are not mutated, as they declare and do not compute.

    Annotations are never evaluated, decorators declare what Python enforces, ``strict=`` of ``zip`` is an assertion.
    """
    nodes: list[ast.expr] = []
    for node in ast.walk(ast.parse(source)):
        nodes += [getattr(node, name, None) for name in ("annotation", "returns")]
        nodes += getattr(node, "decorator_list", [])
        if isinstance(node, ast.Call):
            nodes += [keyword.value for keyword in node.keywords if keyword.arg == "strict"]
    # col_offset - 1 includes the @ of a decorator, which is not part of its expression
    return [
        ((e.lineno, e.col_offset - 1), (e.end_lineno, e.end_col_offset))
        for e in nodes
        if isinstance(e, ast.expr)
    ]


def changed_lines(source: str, other: str) -> tuple[str, str]:
    """Return the lines in which two sources differ, each joined and stripped."""
    a, b = source.splitlines(), other.splitlines()
    start = next(
        (k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b))
    )
    end = 0
    while end < min(len(a), len(b)) - start and a[-1 - end] == b[-1 - end]:
        end += 1
    before, after = a[start : len(a) - end], b[start : len(b) - end]
    return " ".join(" ".join(before).split()), " ".join(" ".join(after).split())


def mutants(source: str, count: int, draw: random.Random) -> Iterator[Mutant]:
    """Yield ``count`` random mutants of a source, one per expression; all of them if ``count`` is 0."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator, operator_names

    operators_at: dict[tuple[tuple[int, int], tuple[int, int]], list[tuple[str, int]]] = {}
    excluded, nodes = declarations(source), list(ast_nodes(get_ast(source)))
    for name in sorted(operator_names()):
        if get_operator(name).arguments() or IDENTITY.search(name):
            continue  # needs a configuration of its own, or changes nothing
        operator = get_operator(name)()
        spans = (span for node in nodes for span in operator.mutation_positions(node))
        for occurrence, (start, end) in enumerate(spans):
            if not any(a <= start < b for a, b in excluded):
                operators_at.setdefault((start, end), []).append((name, occurrence))
    order = sorted(operators_at)
    draw.shuffle(order)
    original, total = ast.dump(ast.parse(source)), 0
    for position in order:
        choices = operators_at[position]
        for name, occurrence in choices if count == 0 else [draw.choice(choices)]:
            try:
                mutated = mutate_code(source, get_operator(name)(), occurrence)
                is_changed = mutated is not None and ast.dump(ast.parse(mutated)) != original
            except (SyntaxError, AttributeError):  # Cosmic Ray cannot replace dotted exceptions
                is_changed = False
            if is_changed:
                total += 1
                yield Mutant(mutated, *changed_lines(source, mutated))
        if total >= count > 0:
            return


def copy_checkout(folder: Path) -> None:
    """Copy the files of the checkout that git tracks or would track, and the compiled module."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=CHECKOUT,
        capture_output=True,
        text=True,
        check=True,
    )
    files = [CHECKOUT / name for name in listing.stdout.split("\0") if name]
    for pattern in OUTSIDE_GIT:
        files += CHECKOUT.glob(pattern)
    for file in files:
        if file.is_file():
            target = folder / file.relative_to(CHECKOUT)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, target)
    (folder / "sitecustomize.py").write_text(SITE)
    compileall.compile_dir(folder / "src", quiet=1)


def passes(copy: Path, arguments: list[str], timeout: float) -> bool | None:
    """Run pytest in a fork with the package of the copy; return None if it exceeds ``timeout`` seconds."""
    log = copy / "pytest.log"
    child = os.fork()
    if child == 0:
        code = 70
        try:
            os.setsid()
            output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(output, 1)
            os.dup2(output, 2)
            resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
            os.chdir(copy)
            os.environ["PYTHONPATH"] = f"{copy / 'src'}{os.pathsep}{copy}"
            sys.meta_path[:] = [
                f for f in sys.meta_path if not type(f).__name__.startswith("ScikitBuild")
            ]
            outside = {str(CHECKOUT), str(CHECKOUT / "src"), str(CHECKOUT / "tests")}
            sys.path[:] = [str(copy / "src"), str(copy), *(p for p in sys.path if p not in outside)]
            import pytest

            code = int(pytest.main(arguments))
        finally:
            sys.stdout.flush()
            os._exit(code)
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def examine(
    copy: Path, module: str, tests: str, equivalent: set[tuple[str, str]], count: int, seed: int
) -> Score:
    """Test mutants of one module by its tests and by the examples of its docstrings.

    Raises
    ------
    SystemExit
        If the tests fail without a mutation.
    """
    path = copy / module
    source = path.read_text()
    arguments = [
        "-n",
        "0",
        "-x",
        "-m",
        "not full and not long",
        "-p",
        "no:cacheprovider",
        *shlex.split(tests),
        module,
    ]

    def write(text: str) -> None:
        # Python would reuse the byte code of another mutant with the same length and modification second.
        for file in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            file.unlink()
        path.write_text(text)

    start = time.monotonic()
    if not passes(copy, arguments, 600.0):
        raise SystemExit(
            f"{module}: its tests fail without a mutation\n{(copy / 'pytest.log').read_text()[-2000:]}"
        )
    timeout = 20.0 + 5.0 * (time.monotonic() - start)
    score = Score()
    try:
        for mutant in mutants(source, count, random.Random(f"{seed}/{module}")):
            if (mutant.before, mutant.after) in equivalent:
                score.equivalent += 1
                continue
            write(mutant.source)
            if passes(copy, arguments, timeout):
                score.survivors.append(mutant)
            else:
                score.killed += 1
    finally:
        write(source)
    return score


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "modules",
        nargs="*",
        default=["*"],
        help="glob patterns of modules in the table; default: all",
    )
    parser.add_argument(
        "--sample",
        type=int,
        default=12,
        metavar="N",
        help="mutants per module; 0: all (default: 12)",
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="random seed of the sample (default: 1)"
    )
    parser.add_argument(
        "--min-score",
        type=float,
        default=90.0,
        help="minimum of killed mutants in %% (default: 90)",
    )
    options = parser.parse_args()

    table = tomllib.loads(TABLE.read_text())
    tests_of = {
        m: t
        for m, t in table["tests"].items()
        if any(fnmatch.fnmatch(m, f"*{p}") for p in options.modules)
    }
    if not tests_of:
        parser.error(
            f"modules must match a module of {TABLE.relative_to(CHECKOUT)}; got {' '.join(options.modules)}"
        )
    equivalent: dict[str, set[tuple[str, str]]] = {}
    for entry in table.get("equivalent", []):
        equivalent.setdefault(entry["module"], set()).update(map(tuple, entry["mutants"]))

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Only this process writes byte code: tests that limit the file size would leave truncated files.
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    sys.dont_write_bytecode = True
    for name in PRELOADED.split():
        __import__(name)
    scores: list[Score] = []
    with tempfile.TemporaryDirectory(prefix="omnimirror-mutation-") as folder:
        copy = Path(folder, "checkout").resolve()
        copy_checkout(copy)
        width = max(map(len, tests_of))
        print(f"{'module':{width}} {'killed':>8} {'survived':>9} {'equivalent':>11} {'seconds':>8}")
        for module, tests in tests_of.items():
            start = time.monotonic()
            score = examine(
                copy, module, tests, equivalent.get(module, set()), options.sample, options.seed
            )
            scores.append(score)
            print(f"{module:{width}} {score} {time.monotonic() - start:8.0f}")
            for mutant in score.survivors:
                print(f"    - {mutant.before}\n    + {mutant.after}", flush=True)
    total = Score(
        sum(s.killed for s in scores),
        sum(s.equivalent for s in scores),
        [m for s in scores for m in s.survivors],
    )
    percent = 100.0 * total.killed / max(total.killed + len(total.survivors), 1)
    print(
        f"{f'{len(scores)} modules':{width}} {total}\n{percent:.1f} % of the non-equivalent mutants are killed"
    )
    return int(percent < options.min_score)


if __name__ == "__main__":
    raise SystemExit(main())
