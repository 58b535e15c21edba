"""MkDocs hook: repository link, version and site address from the metadata of the package."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def on_config(config: Any) -> Any:
    """Set the settings that pyproject.toml and the package define."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    source = (ROOT / "src" / "omnimirror" / "__init__.py").read_text(encoding="utf-8")
    version = re.findall(r'^__version__ = "(.+)"$', source, re.MULTILINE)[0]
    config.site_url = project["urls"]["Documentation"]
    config.repo_url = project["urls"]["Repository"]
    config.repo_name = f"omnimirror {version}"
    config.copyright = f"omnimirror {version} ({project['license']})"
    return config
