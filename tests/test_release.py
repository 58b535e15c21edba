"""Metadata of releases: version, date, addresses, dependencies and the README on a package index."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

import omnimirror as om

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
LINK = re.compile(r"\]\(([^)\s]+)\)")
CONDA_NAMES = {"matplotlib": "matplotlib-base", "opencv-python-headless": "py-opencv"}
"""Packages that have other names on conda-forge."""
DEVELOPMENT_EXTRAS = {"full", "mutation", "test"}


def requirements(lines: list[str]) -> dict[str, str]:
    """Return the lower bounds of requirements by lower-case name."""
    pairs = (re.match(r"([\w.-]+)\s*(?:>=([\d.]+))?", line) for line in lines)
    return {pair[1].lower(): pair[2] for pair in pairs if pair}


def test_citation_agrees_with_the_package():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == om.__version__
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", citation["date-released"])
    assert citation["license"] == PROJECT["license"]
    assert citation["authors"] == PROJECT["authors"]


def test_changelog_begins_with_this_version_and_the_date_of_the_citation():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    version, date = re.findall(r"^## \[(.+)\] - (.+)$", changelog, re.MULTILINE)[0]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert version == om.__version__
    assert date in ("Unreleased", citation["date-released"])


def test_conda_recipe_agrees_with_the_package():
    text = (ROOT / "release" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    recipe = yaml.safe_load(text)
    assert recipe["context"]["version"] == om.__version__
    assert recipe["about"]["license"] == PROJECT["license"]
    assert recipe["about"]["summary"] == PROJECT["description"]
    expected = requirements(PROJECT["dependencies"])
    expected = {CONDA_NAMES.get(name, name): bound for name, bound in expected.items()}
    python = PROJECT["requires-python"].removeprefix(">=")
    assert requirements(recipe["requirements"]["run"]) == expected | {"python": python}
    build = requirements(PYPROJECT["build-system"]["requires"])
    host = requirements(recipe["requirements"]["host"])
    assert host == build | {"python": None, "pip": None}


def test_lower_bounds_are_declared():
    assert [
        name for name, bound in requirements(PROJECT["dependencies"]).items() if not bound
    ] == []


def test_extra_all_contains_the_runtime_extras():
    extras = PROJECT["optional-dependencies"]
    (line,) = extras["all"]
    names = line.removeprefix("omnimirror[").removesuffix("]").split(",")
    assert names == sorted({*extras} - DEVELOPMENT_EXTRAS - {"all"})


def test_code_that_requires_an_extra_imports_existing_modules():
    """`make release` runs the code of each extra; it downloads 2 GB and is not part of the tests."""
    spec = importlib.util.spec_from_file_location("release_build", ROOT / "release" / "build.py")
    assert spec is not None
    assert spec.loader is not None
    build = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(build)
    assert {*build.EXTRAS} == {*PROJECT["optional-dependencies"]} - DEVELOPMENT_EXTRAS - {"all"}
    modules = re.findall(r"omnimirror\.[\w.]+", " ".join(build.EXTRAS.values()))
    assert len(modules) > 5
    assert all(importlib.util.find_spec(name.removesuffix(".")) for name in modules)


def test_links_of_the_readme_are_absolute_on_an_index():
    metadata = PYPROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    assert metadata["fragments"] == [{"path": "README.md"}]
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert sum(":" not in link for link in LINK.findall(text)) > 20
    for rule in metadata["substitutions"]:
        text, count = re.subn(rule["pattern"], rule["replacement"], text)
        assert count
    urls = PROJECT["urls"]
    files = f"{urls['Repository']}/blob/main/", f"{urls['Repository']}/raw/main/"
    for link in LINK.findall(text):
        if link.startswith(files):
            assert (ROOT / link.split("/main/")[1]).is_file(), link
        elif link.startswith(urls["Documentation"]):
            page = link.removeprefix(urls["Documentation"]).split("/")[0]
            assert (ROOT / "docs" / f"{page}.md").is_file(), link
        else:
            assert link.startswith("https://"), link


def test_addresses_are_in_one_file():
    """The placeholders of the project's own addresses are in pyproject.toml only."""
    host = PROJECT["urls"]["Homepage"].removesuffix("/")
    names = ("README.md", "CITATION.cff", "CONTRIBUTING.md", "SECURITY.md", "mkdocs.yml")
    assert [name for name in names if host in (ROOT / name).read_text(encoding="utf-8")] == []


def test_site_shows_repository_link_and_version():
    spec = importlib.util.spec_from_file_location("site_hooks", ROOT / "docs" / "site_hooks.py")
    assert spec is not None
    assert spec.loader is not None
    hooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hooks)
    config = hooks.on_config(SimpleNamespace())
    assert config.repo_url == PROJECT["urls"]["Repository"]
    assert om.__version__ in config.repo_name.split()
    assert om.__version__ in config.copyright.split()
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    assert site["hooks"] == ["docs/site_hooks.py"]


def test_references_of_the_paper_exist_and_are_cited():
    text = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    bibliography = (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8")
    cited = set(re.findall(r"@(\w+)", text))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", bibliography, re.MULTILINE))


RUNNERS = {"macos-15", "macos-15-intel", "ubuntu-24.04", "ubuntu-24.04-arm", "windows-2025"}
"""Available runners of the host of the repository."""


@pytest.mark.parametrize("path", sorted((ROOT / ".github" / "workflows").glob("*.yml")), ids=str)
def test_workflows_use_existing_runners_targets_and_programs(path):
    jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for job in jobs.values():
        matrix = job.get("strategy", {}).get("matrix", {})
        assert {*matrix.get("system", [job["runs-on"]])} <= RUNNERS
        rows = matrix.get("include", [{}])
        commands = [step["run"] for step in job["steps"] if "run" in step]
        for command in (
            re.sub(r"\$\{\{ matrix\.(\w+) }}", lambda m, row=row: row[m[1]], command)
            for row in rows
            for command in commands
        ):
            for target in re.findall(r"^make ([\w-]+)", command):
                assert re.search(rf"^{target}:", makefile, re.MULTILINE), command
            for program in re.findall(r"[\w./-]+\.(?:py|txt)|^\.ci/run", command):
                assert (ROOT / program).is_file(), command


def test_wheels_are_published_after_all_tests():
    text = (ROOT / ".github" / "workflows" / "wheels.yml").read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    publish = jobs.pop("publish")
    assert {*publish["needs"]} == {*jobs}
    assert publish["permissions"] == {"id-token": "write"}
