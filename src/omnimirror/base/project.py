"""Address of the documentation, from the metadata of the installed package."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, metadata


@cache
def documentation_address() -> str:
    """Return the address of the documentation; "" for an installation without metadata."""
    try:
        lines = metadata("omnimirror").get_all("Project-URL") or []
    except PackageNotFoundError:
        return ""
    addresses: dict[str, str] = dict(line.split(", ", 1) for line in lines)
    return addresses.get("Documentation", "")


def schema_address(kind: str) -> str:
    """Return the address at which the documentation publishes the JSON Schema of a kind of file.

    >>> schema_address("sensor").removeprefix(documentation_address())
    'schemas/sensor.json'
    """
    return f"{documentation_address()}schemas/{kind}.json"


def schema_directive(kind: str) -> str:
    """Return the first line of a TOML file, which links the schema of its kind for editors.

    >>> schema_directive("sensor").startswith("#:schema ")
    True
    """
    return f"#:schema {schema_address(kind)}\n"
