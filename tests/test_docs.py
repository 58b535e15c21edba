"""Execution of the examples in README and docs."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import inspect
import re
import shlex
import tomllib
import typing
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
import tomli_w
import yaml

import omnimirror as om
from omnimirror.apps.cli import app
from omnimirror.design import parse_requirements
from omnimirror.io.keyframes import Keyframes
from omnimirror.manufacturing.tolerancing.tolerance_file import parse_tolerances
from omnimirror.manufacturing.workshop import parse_workshop
from omnimirror.optics.sensor_files import format_sensor, parse_sensor
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.moving_objects import SceneWithBodies
from tests.commands import omnimirror
from tests.everyday import few
from tests.interop.test_file_schemas import problems

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
RUN_ELSEWHERE = {"gallery.md"}  # tests/test_gallery.py
LONG_EXAMPLES = {
    "calibrate.md",
    "design.md",
    "lenses.md",
    "manufacture.md",
    "optimisation.md",
    "simulate.md",
}
LONG_COMMANDS = {
    "aperture.md",
    "bought.md",
    "calibrate.md",
    "interoperability.md",
    "manufacture.md",
    "optimisation.md",
    "restoration.md",
    "stories.md",
}
"""Pages that run in the full test; the daily test checks that the named files exist."""
FIGURES = re.compile(r" --figures \S+| -o figures\b| -o (?!look)\S+\.html")
"""Options that create a dozen figures, or a page of images, that are not read again; the only output
look.html is required."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.M | re.S
    )


def every_day(pages: list[Path], long: set[str]) -> list[Any]:
    return few(pages, *(page for page in pages if page.name not in long))


OTHER_PACKAGES = "mitsuba", "pycolmap", "torch"
"""Programs whose examples run in a test of their own, if they are installed."""


def other_packages(text: str) -> set[str]:
    return {name for name in OTHER_PACKAGES if re.search(rf"^import .*\b{name}\b", text, re.M)}


WITH_EXAMPLES = [p for p in PAGES if blocks(p, "python") and p.name not in RUN_ELSEWHERE]
WITH_COMMANDS = [p for p in PAGES if blocks(p, "console")]


@pytest.mark.long
@pytest.mark.parametrize("page", every_day(WITH_EXAMPLES, LONG_EXAMPLES), ids=lambda p: p.name)
def test_python_examples_print_documented_output(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_examples(page, tmp_path, capsys)


@pytest.mark.long
@pytest.mark.parametrize(
    ("page", "package"),
    [(p, each) for p in WITH_EXAMPLES for each in sorted(other_packages(p.read_text("utf-8")))],
    ids=lambda p: getattr(p, "name", p),
)
def test_python_examples_with_other_packages(page, package, tmp_path, monkeypatch, capsys):
    pytest.importorskip(package, reason=f"{package} is installed by `make test-full` only")
    monkeypatch.chdir(tmp_path)
    run_examples(page, tmp_path, capsys, package)


def run_examples(page: Path, folder: Path, capsys: Any, package: str | None = None) -> None:
    """Run the examples of a page in order, except those with other packages than the given one."""
    write_files(page, folder)
    names: dict[str, object] = {}
    pattern = r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```)?"
    for block, expected in re.findall(pattern, page.read_text(encoding="utf-8"), flags=re.M | re.S):
        if other_packages(block) - {package}:
            continue
        capsys.readouterr()
        exec(compile(block, str(page), "exec"), names)
        assert_printed(expected.splitlines(), capsys.readouterr().out, block)


def files_shown(page: Path) -> dict[str, str]:
    """Return the files that a page shows: blocks whose first line is a comment with the name, "# name.toml"."""
    text = page.read_text(encoding="utf-8")
    named_blocks = re.findall(r"^```\w+\n(# ([\w-]+\.[a-z]+)\n.*?)^```", text, flags=re.M | re.S)
    return {name: block for block, name in named_blocks}


def write_files(page: Path, folder: Path) -> None:
    for name, block in files_shown(page).items():
        (folder / name).write_text(block)


def commands(page: Path, language: str) -> list[tuple[str, list[str]]]:
    """Return the commands of a page, each with its displayed lines of output."""
    outputs: list[tuple[str, list[str]]] = []
    for line in (line for block in blocks(page, language) for line in block.splitlines()):
        if line.startswith("$ "):
            outputs.append((line[2:], []))
        elif line.strip():
            outputs[-1][1].append(line)
    return outputs


def run_command(command: str, folder: Path, exit_codes: tuple[int, ...]) -> str:
    program, *args = shlex.split(command)
    assert program == "omnimirror"
    process = omnimirror(*args, cwd=folder)
    assert process.returncode in exit_codes, f"{command}\n{process.stderr}"
    return process.stdout


def assert_printed(expected_lines: list[str], output: str, command: str) -> None:
    """Check that every displayed line was printed, in this order, to the third digit of its
    numbers."""
    printed = iter(output.splitlines())
    for line in expected_lines:
        assert any(is_same(line, other) for other in printed), (
            f"{command} does not print\n{line}\n{output}"
        )


def is_same(expected: str, printed: str) -> bool:
    a, b = expected.split(), printed.split()
    return len(a) == len(b) and all(
        word == other or is_near(word, other) for word, other in zip(a, b, strict=True)
    )


def is_near(expected: str, printed: str) -> bool:
    try:
        return float(printed.strip("()%")) == pytest.approx(
            float(expected.strip("()%")), rel=2e-3, abs=0.02
        )
    except ValueError:
        return False


@pytest.mark.long
@pytest.mark.parametrize("page", every_day(WITH_COMMANDS, LONG_COMMANDS), ids=lambda p: p.name)
def test_commands_print_documented_output(page, tmp_path):
    """Without figures, which take half of the time; the next test includes them."""
    run_in_order(
        [
            (FIGURES.sub("", command), expected_lines)
            for command, expected_lines in commands(page, "console")
        ],
        page,
        tmp_path,
    )


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda p: p.name)
def test_python_examples_use_existing_names(page):
    for node in ast.walk(ast.parse("".join(blocks(page, "python")))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("omnimirror"):
            assert all(hasattr(import_module(node.module), name.name) for name in node.names), (
                ast.unparse(node)
            )
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "om":
            assert hasattr(om, node.attr), ast.unparse(node)


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda p: p.name)
def test_commands_use_existing_options(page):
    for line, _ in commands(page, "console"):
        _, name, *arguments = shlex.split(line)
        command = app.get_command(click.Context(app), name)
        assert command is not None, line
        valid_options = {"--help", *options(app), *options(command)}
        assert {
            word.partition("=")[0] for word in arguments if re.match(r"--?[a-z]", word)
        } <= valid_options, line


def options(command: click.Command) -> set[str]:
    """Return the options of a command and its subcommands."""
    own = {option for param in command.params for option in (*param.opts, *param.secondary_opts)}
    subcommands = command.commands.values() if isinstance(command, click.Group) else ()
    return own.union(*map(options, subcommands))


def run_in_order(commands: list[tuple[str, list[str]]], page: Path, folder: Path) -> None:
    write_files(page, folder)
    for command, expected_lines in commands:
        codes = (
            (0, 3) if command.startswith("omnimirror check") else (0,)
        )  # 3: violated requirements
        assert_printed(expected_lines, run_command(command, folder, codes), command)


@pytest.mark.full
@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if any(FIGURES.search(block) for block in blocks(p, "console"))],
    ids=lambda p: p.name,
)
def test_commands_write_requested_figures(page, tmp_path):
    run_in_order(commands(page, "console"), page, tmp_path)
    for option in FIGURES.findall("\n".join(blocks(page, "console"))):
        figure_path = tmp_path / option.split()[1]
        assert figure_path.is_file() or any(figure_path.glob("*.svg")), option


@pytest.mark.full
@pytest.mark.parametrize(
    "page", [p for p in PAGES if blocks(p, "console slow")], ids=lambda p: p.name
)
def test_slow_commands_print_documented_output(page, tmp_path):
    write_files(page, tmp_path)
    for command, expected_lines in commands(page, "console slow"):
        assert_printed(expected_lines, run_command(command, tmp_path, (0, 3)), command)


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "toml")], ids=lambda p: p.name)
def test_sensor_camera_requirement_and_view_files_are_valid(page, tmp_path):
    for block in blocks(page, "toml"):
        if block.startswith("# views.toml"):
            (tmp_path / "views.toml").write_text(block)
            assert problems("views", tomllib.loads(block)) == []
            assert all(
                view(om.load_sensor("paper-spherical"))
                for view in om.load_views(tmp_path / "views.toml").values()
            )
            continue
        if block.startswith("# carts.toml"):
            continue  # test_boxes_move_as_documented
        if "[output]" in block:
            continue  # tests/interop/batch/test_scenarios.py
        if "[field]" in block:
            assert problems("requirements", tomllib.loads(block)) == []
            assert parse_requirements(block).field.omega_max_deg > 0
            continue
        if "[[error]]" in block:
            assert problems("tolerances", tomllib.loads(block)) == []
            assert parse_tolerances(block, om.load_sensor("paper-spherical")).limits
            continue
        if "[title]" in block:
            assert parse_workshop(block).mirror.density
            continue
        if "[camera]" in block:
            assert problems("camera", tomllib.loads(block)) == []
            assert om.parse_camera(block).omega_max > 0
            continue
        assert problems("sensor", tomllib.loads(block)) == []
        assert parse_sensor(block).aligned().field_deg[1] > 0


TABLES: dict[str, Callable[[Path], Any]] = {
    "drive.csv": lambda path: om.load_path(path).at(2.0) == {"x_mm": 800.0, "pan_deg": 90.0},
    "lamp.csv": lambda path: om.load_path(path).at(1.0) == {"x_mm": -800.0, "z_mm": 250.0},
    "turn.csv": lambda path: (
        [Keyframes.load(path).at(time) for time in (0, 4, 6)]
        == [{"pan_deg": pan, "hfov_deg": hfov} for pan, hfov in ((0, 60), (90, 60), (90, 30))]
    ),
    "lens.csv": lambda path: parse_lens(path).field_deg == (0, 5, 10, 15),
    "room.csv": lambda path: (
        om.read_observations(points=[path]).observations[0].points.tolist() == [[2150, -730, 1420]]
    ),
    "sky.csv": lambda path: (
        om.read_observations(directions=[path]).observations[0].is_distant.tolist() == [True]
    ),
    "edges.csv": lambda path: (
        [len(edge) for edge in om.read_line_points([path])["hall.jpg"]] == [3]
    ),
}
"""Readers of the displayed tables, and their documented properties."""


def parse_lens(path: Path) -> Any:
    table = {
        "kind": "table",
        "file": path.name,
        "focal_length_mm": 11.6,
        "f_number": 8.0,
        "focus_distance_mm": 200.0,
    }
    sensor = tomllib.loads(format_sensor(om.load_sensor("paper-spherical"))) | {"lens": table}
    return parse_sensor(tomli_w.dumps(sensor), folder=path.parent).lens


@pytest.mark.parametrize(
    ("page", "name"),
    [(p, n) for p in PAGES for n in files_shown(p) if not n.endswith(".toml")],
    ids=lambda p: getattr(p, "name", p),
)
def test_tables_are_read_as_documented(page, name, tmp_path):
    write_files(page, tmp_path)
    assert TABLES[name](tmp_path / name)


def test_boxes_move_as_documented(tmp_path):
    """Render the boxes of docs/simulate.md; its last sentence states that one moves to the left and
    the other moves up."""
    write_files(ROOT / "docs" / "simulate.md", tmp_path)
    bodies = om.load_bodies(tmp_path / "carts.toml")
    sphere = om.load_sensor("paper-spherical")
    small = replace(
        sphere, imager=replace(sphere.imager, width_px=256, height_px=256, pixel_pitch_um=5.2 * 4)
    )
    points_mm = [
        [1300.0, 0.0, 0.0],
        [1300.0, 900.0, 0.0],
        [-700.0, 0.0, -400.0],
        [-700.0, 0.0, 650.0],
    ]
    (u, v), valid = (
        (projection := small.project(np.array(points_mm))).pixels.round().astype(int).T,
        projection.valid,
    )
    assert valid.all()
    for time, shows in ((0.0, [True, False, True, False]), (1.0, [False, True, False, True])):
        empty, full = (
            expose(small, SceneWithBodies(om.Room(), b, time), samples=1) for b in ((), bodies)
        )
        assert (np.abs(full - empty)[v, u].max(axis=-1) > 0.01).tolist() == shows, time


EXAMPLES = {
    "arrays and stacks": r"dewarp\(depth_mm\)",
    "__dlpack__": r"dewarp\(torch\.",
    "__array__": r"dewarp\(Image\.new",
    "PyTorch": r"om\.torch\.TorchDewarper\(",
    "gradients": r"om\.torch\.differentiable\(",
    "plots": r"om\.plot\.\w+\(.*ax=",
    "data frames": r"\.to_dataframe\(\)",
    "xarray": r"\.to_xarray\(\)",
    "schemas": r"om\.schema\(",
    "logging": r"logging\.getLogger\(\"omnimirror",
    "warnings": r"om\.OmnimirrorWarning",
    "callbacks": r"on_progress=",
    "ROS bags": r"om\.dewarp_bag\(",
    "Blender": r"rays .*--format blender",
    "Mitsuba": r"mi\.load_dict\(",
    "COLMAP": r"pycolmap\.Database",
    "OBS": r"maps .*--format obs",
    "GStreamer": r"maps .*--format gstreamer",
}
"""Interfaces to other packages and programs, and their examples that this module executes."""
EXECUTED_BY = {
    "GStreamer element": ("interop/test_gstreamer.py", "test_documented_pipelines"),
    "gateway": ("interop/gateway/test_gateway.py", "test_documented_python_call_and_curl_commands"),
    "video recorders, VLC": ("interop/gateway/test_gateway.py", "test_documented_configurations"),
    "OpenCV": ("interop/view_maps/test_consumers.py", "test_documented_opencv_lines"),
    "OpenImageIO": ("interop/view_maps/test_consumers.py", "test_documented_st_warp_line"),
    "FFmpeg": ("interop/view_maps/test_consumers.py", "test_documented_ffmpeg_command"),
    "Newton": ("interop/ray_tables/test_programs.py", "test_newton_depths"),
}
"""Interfaces whose documented lines are executed by other tests with the program."""


@pytest.mark.parametrize("interface", EXAMPLES)
def test_interfaces_have_executed_examples(interface):
    executed = [block for page in PAGES for block in blocks(page, "(?:python|console)")]
    assert any(re.search(EXAMPLES[interface], block) for block in executed)


@pytest.mark.parametrize("interface", EXECUTED_BY)
def test_lines_for_other_programs_are_executed(interface):
    path, test = EXECUTED_BY[interface]
    assert f"\ndef {test}" in (ROOT / "tests" / path).read_text(encoding="utf-8")


def headings(page: Path) -> set[str]:
    """Return the heading anchors of a page, as generated by repository hosts and MkDocs."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    titles = re.findall(r"^#+ (.*)", text, flags=re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


def test_links_between_pages_are_valid():
    for page in [
        *PAGES,
        ROOT / "CHANGELOG.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "SECURITY.md",
        ROOT / "THIRD_PARTY.md",
    ]:
        for target, anchor in re.findall(
            r"\]\(([^)#:\s]*)(?:#([^)\s]*))?\)", page.read_text(encoding="utf-8")
        ):
            there = page.parent / target if target else page
            assert there.exists(), f"{page.name} links to {target}"
            if anchor:
                assert anchor in headings(there), f"{page.name} links to {target}#{anchor}"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Module docs/site_pages.py after it has generated all pages."""
    spec = importlib.util.spec_from_file_location("site_pages", ROOT / "docs" / "site_pages.py")
    site = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(site)
    site.PAGES = tmp_path_factory.mktemp("site") / "pages"
    site.copy_pages()
    site.reference()
    site.command_line()
    return site


def test_site_contains_every_page_and_public_name(site):
    order = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = {p.relative_to(site.PAGES).as_posix() for p in site.PAGES.rglob("*.md")}
    assert set(re.findall(r": (\S+\.md)$", order, flags=re.M)) == {
        p for p in pages if not re.match(r"reference/(?!index|commands)", p)
    }
    reference = "".join(
        p.read_text(encoding="utf-8") for p in (site.PAGES / "reference").glob("*.md")
    )
    public = [n for n in om.__all__ if not n.startswith("_")]
    assert [n for n in public if f"## om.{n} " not in reference] == []
    for page in site.PAGES.rglob("*.md"):
        for target in re.findall(
            r"\]\(([^)#:\s]+\.md)(?:#[^)\s]*)?\)", page.read_text(encoding="utf-8")
        ):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def sections_of(site: Any) -> dict[str, str]:
    """Return the text of each documented name of the reference, including its members."""
    texts_by_name = {}
    for page in (site.PAGES / "reference").glob("*.md"):
        parts = re.split(r"(?m)^(#{2,5}) (\S+) \{.*$", page.read_text(encoding="utf-8"))
        levels, names, texts = parts[1::3], parts[2::3], parts[3::3]
        for i, (level, name) in enumerate(zip(levels, names, strict=True)):
            end = next((j for j in range(i + 1, len(names)) if len(levels[j]) <= len(level)), None)
            texts_by_name[name] = " ".join([*names[i:end], *texts[i:end]])
    return texts_by_name


def returned_classes(annotation: Any) -> list[type]:
    """Return the classes of the package in a type annotation."""
    own = [annotation] if getattr(annotation, "__module__", "").startswith("omnimirror.") else []
    parts = [c for part in typing.get_args(annotation) for c in returned_classes(part)]
    return [c for c in own + parts if inspect.isclass(c)]


def test_reference_contains_members_of_public_classes_and_of_returned_types(site):
    documented = sections_of(site)
    names = {n: getattr(om, n) for n in om.__all__ if not n.startswith("_")}
    classes = {cls: f"om.{name}" for name, cls in names.items() if inspect.isclass(cls)}
    functions = [f for f in names.values() if inspect.isfunction(f)]
    functions += [
        f
        for cls in classes
        for name, f in inspect.getmembers(cls, inspect.isfunction)
        if not name.startswith("_")
    ]
    for function in functions:
        try:
            annotation = typing.get_type_hints(function).get("return")
        except NameError:  # a name that is defined for type checkers only
            continue
        for cls in returned_classes(annotation):
            classes.setdefault(cls, cls.__name__)
    lacking = []
    for cls, title in classes.items():
        public = f"om.{cls.__module__.rpartition('.')[2].strip('_')}"
        text = documented.get(title) or next(
            (t for n, t in documented.items() if n.endswith(f".{title}") and n.startswith("om.")),
            "",
        )
        members = {n for n in dir(cls) if not n.startswith("_")}
        members |= (
            {f.name for f in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else set()
        )
        outside = {
            n
            for base in cls.__mro__
            if base.__module__.split(".")[0] != "omnimirror"
            for n in vars(base)
        }
        lacking += [f"{title}.{n}" for n in members - outside if not re.search(rf"\b{n}\b", text)]
        lacking += [f"{title} ({public})"] * (not text)
    assert len(classes) > 100
    assert not lacking, sorted(lacking)


SEARCHED = (
    "undistort",
    "camera matrix",
    "reprojection error",
    "Monte Carlo",
    "Zemax",
    "unwrap",
    "rectify",
    "FOV",
    "EFL",
    "RMS spot size",
    "as-built",
    "CRA",
)


@pytest.mark.parametrize("term", SEARCHED)
def test_search_terms_are_in_the_glossary_and_on_another_page(site, term):
    pattern = re.compile(rf"(?<!\w){term}(?!\w)", re.IGNORECASE)
    pages = {p.name: p.read_text(encoding="utf-8") for p in site.PAGES.glob("*.md")}
    hits = {name for name, text in pages.items() if pattern.search(text)}
    assert "glossary.md" in hits
    assert hits - {"glossary.md", "changelog.md"}


def test_site_navigation():
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    assert "navigation.footer" in site["theme"]["features"]  # previous and next page
    assert "navigation.sections" not in site["theme"]["features"]  # not collapsible
    assert all((ROOT / "docs" / sheet).is_file() for sheet in site["extra_css"])


def test_gallery_thumbnails_lead_to_examples():
    page = ROOT / "docs" / "gallery.md"
    text = page.read_text(encoding="utf-8")
    thumbnails = re.findall(r"\[!\[[^]]+\]\((\S+)\)<br>([^]]+)\]\(#(\S+)\)", text)
    assert len(thumbnails) == len(re.findall("^### ", text, re.M))
    for image, name, anchor in thumbnails:
        assert (page.parent / image).is_file()
        assert anchor in headings(page)
        assert f"### {name}\n" in text


QUALIFIED_NAME = re.compile(r"`(?!om\.)(?:omnimirror\.)?([a-z_]+(?:\.[a-z_]+)+)\.([A-Z]\w*)`")


def test_qualified_names_exist():
    """Names of modules in tables and text, which no example executes."""
    names = {match for page in PAGES for match in QUALIFIED_NAME.findall(page.read_text())}
    assert ("io.video_reader", "VideoReader") in names
    for module, name in names:
        assert hasattr(import_module(f"omnimirror.{module}"), name), (module, name)
