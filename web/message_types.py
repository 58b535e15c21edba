"""Write the page's types (src/shared/messages.ts) from the server's messages: one schema for both sides."""

from __future__ import annotations

import argparse
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic.json_schema import models_json_schema

from omnimirror.apps.studio import bench_messages as bench
from omnimirror.apps.studio import bench_messages as tolerances
from omnimirror.apps.studio import calibration_messages as calibrate
from omnimirror.apps.studio import look_messages as look
from omnimirror.apps.studio import messages

MODULES = (messages, look, bench, tolerances, calibrate)
WRITTEN = Path(__file__).parent / "src" / "shared" / "messages.ts"
HEAD = "// Made by web/message_types.py from the server's messages; not to be edited.\n"
SIMPLE = {
    "string": "string",
    "number": "number",
    "integer": "number",
    "boolean": "boolean",
    "null": "null",
}


def typescript() -> str:
    """The text of the page's file."""
    _, schema = models_json_schema(
        [(m, "serialization") for module in MODULES for m in _messages_of(module)]
    )
    return HEAD + "".join(
        _interface(name, model) for name, model in sorted(schema["$defs"].items())
    )


def _messages_of(module: ModuleType) -> list[type[messages.Message]]:
    models = [
        m for m in vars(module).values() if isinstance(m, type) and issubclass(m, messages.Message)
    ]
    return [m for m in models if m not in (messages.Message, messages.ClientMessage)]


def _interface(name: str, model: dict[str, Any]) -> str:
    lines = [f"\n/** {model['description']} */\nexport interface {name} {{\n"]
    for field, kind in model["properties"].items():
        if "description" in kind:
            lines.append(f"  /** {kind['description']} */\n")
        lines.append(f"  {field}: {_type(kind)};\n")
    return "".join([*lines, "}\n"])


def _type(kind: dict[str, Any]) -> str:
    if "$ref" in kind:
        return kind["$ref"].rsplit("/", 1)[1]
    if "anyOf" in kind:
        return " | ".join(_type(k) for k in kind["anyOf"])
    if "const" in kind:
        return f'"{kind["const"]}"'
    if "enum" in kind:
        return " | ".join(f'"{value}"' for value in kind["enum"])
    if kind.get("type") == "object":
        return "Record<string, any>"
    if kind["type"] == "array":
        if "prefixItems" in kind:
            return f"[{', '.join(_type(k) for k in kind['prefixItems'])}]"
        items = _type(kind["items"])
        return f"({items})[]" if " | " in items else f"{items}[]"
    return SIMPLE[kind["type"]]


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    WRITTEN.write_text(typescript(), encoding="utf-8")
