"""Common templates of the report pages."""

from __future__ import annotations

import base64
from pathlib import Path
from string import Template

from ...base.escaping import html_text

TEMPLATES = Path(__file__).parent


def page_html(title: str, body: str, **parts: object) -> str:
    """Return a self-contained page from a named body template, filled with HTML fragments."""
    return _template("page").substitute(title=html_text(title), body=_template(body).substitute(parts))


def figure_html(data: bytes, kind: str, caption: str, css: str = "") -> str:
    """Return an embedded image with its caption."""
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    text = html_text(caption)
    return f'<figure><img class="{css}" alt="{text}" src="{source}"><figcaption>{text}</figcaption></figure>'


def _template(name: str) -> Template:
    return Template((TEMPLATES / f"{name}.html").read_text(encoding="utf-8"))
