"""Escaping of text from files and users: one function per target language.

Names, notes and file names may contain any characters. Before such text enters generated source
code, markup, drawings, tables, terminals or displayed commands, it passes through the function of
the target language.

Ordinary letters of all scripts stay readable. Characters without a visible form (control
characters, line separators, bidirectional controls, lone surrogates, noncharacters) are written as
backslash escapes such as ``\\x1b``. Comments and labels are limited to one line of
:data:`MAX_LABEL` characters and end in ``...`` if they are cut; string literals, markup and data
keep the whole text.
"""

from __future__ import annotations

import html
import json
import re
import shlex
import unicodedata
from collections.abc import Iterable
from itertools import groupby
from typing import Any
from urllib.parse import quote

MAX_LABEL = 200
"""Maximum number of characters of text in a comment or a label."""
MAX_PLOT_LABEL = 40
"""Maximum number of characters of a label in a figure."""
MAX_STEP_STRING = 60
"""Maximum number of characters of a name in a STEP file, encoded: one line of OpenCASCADE."""
MAX_STEM = 100
"""Maximum number of bytes of a file name that is derived from a name."""
LINE_BREAKS = re.compile(r"\s*[\t-\r\x1c-\x1f\x85\u2028\u2029]\s*")
JOINERS = "\u200c\u200d"
"""Format characters that Persian, Indic scripts and emoji need."""


def escape_invisible(text: str, keep: str = "") -> str:
    """Write characters without a visible form as backslash escapes.

    Parameters
    ----------
    text
        Any text.
    keep
        Control characters to keep, such as ``"\\n"``.

    Returns
    -------
    str
        Text that any encoding of Unicode, XML and a terminal accept.

    Examples
    --------
    >>> print(escape_invisible("a\\tb\\u202ec\\udcff"), escape_invisible("Größe"))
    a\\tb\\u202ec\\udcff Größe
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(c if c in keep or not _is_invisible(c) else repr(c)[1:-1] for c in text)


def label(text: str, max_characters: int = MAX_LABEL) -> str:
    """Return text as one visible line of limited length.

    Only the first ``4 * max_characters`` characters are examined.

    Examples
    --------
    >>> label("a\\n  b"), label("abcdefgh", 6)
    ('a b', 'abc...')
    """
    text = escape_invisible(LINE_BREAKS.sub(" ", text[: 4 * max_characters]).strip())
    return text if len(text) <= max_characters else f"{text[: max_characters - 3]}..."


def _is_invisible(character: str) -> bool:
    """Return whether a character has no visible form, or changes the display of its neighbours."""
    if character in JOINERS:
        return False
    kind, code = unicodedata.category(character), ord(character)
    is_noncharacter = code & 0xFFFE == 0xFFFE or 0xFDD0 <= code <= 0xFDEF
    return kind in ("Cc", "Cf", "Cs", "Zl", "Zp") or is_noncharacter


# -- Programming languages ------------------------------------------------------------------------


def python_string(text: str) -> str:
    """Return a Python string literal, quotes included.

    Examples
    --------
    >>> python_string("a'b\\n")
    '"a\\'b\\\\n"'
    """
    return repr(text)


def python_docstring(text: str) -> str:
    """Return text for the inside of a Python string between triple quotation marks, not raw.

    Examples
    --------
    >>> print(python_docstring('a \\"\\"\\" b \\\\N{DASH}'))
    a \\"\\"\\" b \\\\N{DASH}
    """
    return label(text).replace("\\", r"\\").replace('"', r"\"").replace("'", r"\'")


def line_comment(text: str) -> str:
    """Return text for a comment from ``#`` to the end of the line: Python, shell, TOML, YAML.

    A declaration of the source encoding (PEP 263) is broken by a space.

    Examples
    --------
    >>> line_comment("a\\nimport b"), line_comment("coding: utf-7")
    ('a import b', 'coding : utf-7')
    """
    return re.sub(r"(?<=coding)(?=[:=])", " ", label(text))


def c_string(text: str) -> str:
    """Return a string literal of C, OSL and OBS effects, quotes included.

    Examples
    --------
    >>> print(c_string('a"?'), c_string("ö\\n"))
    "a\\"\\?" "ö\\012"
    """
    escaped = (_octal(c) if _is_invisible(c) else f"\\{c}" if c in '"\\?' else c for c in text)
    return f'"{"".join(escaped)}"'


def _octal(text: str) -> str:
    """Return the bytes of text as octal escapes: UTF-8, with undecodable bytes of file names
    unchanged.
    """
    is_bytes = all("\udc80" <= c <= "\udcff" for c in text if "\ud800" <= c <= "\udfff")
    return "".join(
        f"\\{b:03o}"
        for b in text.encode("utf-8", "surrogateescape" if is_bytes else "surrogatepass")
    )


def c_comment(text: str) -> str:
    """Return text for a comment of C, GLSL, HLSL and OSL, both ``/* */`` and ``//``.

    A space separates the characters of comment delimiters and of trigraphs; a backslash, which
    would continue a comment on the next line, is followed by a full stop at the end of the text.

    Examples
    --------
    >>> c_comment("a */ b"), c_comment("c\\\\")
    ('a * / b', 'c\\\\.')
    """
    text = re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", label(text))
    text = f"{text} " if text.endswith(("*", "/", "?")) else text
    return f"{text}." if text.rstrip().endswith("\\") else text


def shell_word(text: str) -> str:
    """Return one word of a POSIX shell command; characters without a visible form are encoded by
    ``printf``.

    Examples
    --------
    >>> print(shell_word("$(ls)'s"), shell_word("a\\u202eb"))
    '$(ls)'"'"'s' a"$(printf '\\342\\200\\256')"b
    """
    runs = groupby(text, lambda c: c != "\n" and _is_invisible(c))
    return "".join(_shell_run("".join(run), is_hidden) for is_hidden, run in runs) or "''"


def _shell_run(run: str, is_hidden: bool) -> str:
    """Return one part of a word: characters that are all visible, or all invisible."""
    return f"\"$(printf '{_octal(run)}')\"" if is_hidden else shlex.quote(run)


def shell_command(arguments: Iterable[object]) -> str:
    """Return a command line for a POSIX shell.

    Examples
    --------
    >>> shell_command(["omnimirror", "evaluate", "my mirror.toml"])
    "omnimirror evaluate 'my mirror.toml'"
    """
    return " ".join(shell_word(str(word)) for word in arguments)


def gstreamer_comment(text: str) -> str:
    """Return text for a GLSL comment within a quoted property of ``gst-launch-1.0``, which has
    additional escapes.

    Examples
    --------
    >>> gstreamer_comment('a" ! filesink')
    "a' ! filesink"
    """
    return c_comment(text.replace('"', "'").replace("\\", "/")).replace("\\", "/")


def gcode_comment(text: str) -> str:
    """Return text for a comment in parentheses of a G-code program: ASCII without the characters
    that controllers interpret.

    Letters with accents lose these; parentheses become brackets, semicolons commas. Percent signs
    and characters that GRBL interprets anywhere (``!``, ``?``, ``~``) become escapes.

    Examples
    --------
    >>> gcode_comment("Spiegel für (A); 100%")
    'Spiegel fur [A], 100\\\\x25'
    """
    text = ascii_only(label(text)).translate({ord("("): "[", ord(")"): "]", ord(";"): ","})
    return re.sub(r"[%!?~]", lambda c: f"\\x{ord(c[0]):02x}", text)


# -- Markup and data ------------------------------------------------------------------------------


def html_text(text: str) -> str:
    """Return text for elements and quoted attributes of HTML, XML and SVG.

    Examples
    --------
    >>> html_text("a < b & 'c'\\x00")
    'a &lt; b &amp; &#x27;c&#x27;\\\\x00'
    """
    return html.escape(escape_invisible(text, keep="\n\t"))


xml_text = html_text
"""Function that escapes text for XML and SVG; characters that XML 1.0 excludes become escapes."""


def json_text(data: Any, **options: Any) -> str:
    """Return JSON, with characters without a visible form as ``\\u`` escapes.

    Examples
    --------
    >>> print(json_text({"name": "Größe\\u202e\\udcff"}))
    {"name": "Größe\\u202e\\udcff"}
    """
    text = json.dumps(data, ensure_ascii=False, **options)
    return "".join(c if c in "\n\t" or not _is_invisible(c) else json.dumps(c)[1:-1] for c in text)


def script_json(data: str) -> str:
    """Return JSON text for the inside of a ``<script>`` element.

    Examples
    --------
    >>> print(script_json('["</script>"]'))
    ["\\u003c/script\\u003e"]
    """
    codes = {ord(c): f"\\u{ord(c):04x}" for c in "<>&\u2028\u2029"}
    return data.translate(codes)


def toml_string(text: str) -> str:
    """Return a TOML string, quotes included.

    Examples
    --------
    >>> print(toml_string('a "b"\\n\\u202e'))
    "a \\"b\\"\\n\\u202e"
    """
    text = re.sub(
        "[\ud800-\udfff]", lambda c: escape_invisible(c[0]), text
    )  # TOML has no surrogates
    escaped = text.replace("\\", r"\\").replace('"', r"\"")
    short = {"\b": r"\b", "\t": r"\t", "\n": r"\n", "\f": r"\f", "\r": r"\r"}
    codes = (
        short.get(c, f"\\u{ord(c):04x}" if ord(c) < 1 << 16 else f"\\U{ord(c):08x}")
        for c in escaped
    )
    return (
        '"'
        + "".join(code if _is_invisible(c) else c for c, code in zip(escaped, codes, strict=True))
        + '"'
    )


def yaml_string(text: str) -> str:
    """Return a YAML scalar: a plain word if possible, otherwise a quoted string.

    Examples
    --------
    >>> yaml_string("front"), yaml_string("a: b"), yaml_string("no")
    ('front', '"a: b"', '"no"')
    """
    is_plain = re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", text)
    is_word = text.lower() in ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
    return (
        text if is_plain and not is_word else json.dumps(escape_invisible(text), ensure_ascii=False)
    )


def markdown_text(text: str) -> str:
    """Return text for one line or table cell of Markdown.

    Examples
    --------
    >>> print(markdown_text("a|b <i> `c`"))
    a\\|b &lt;i&gt; \\`c\\`
    """
    return re.sub(r"([\\`*_{}\[\]()#+!|~-])", r"\\\1", html.escape(label(text), quote=False))


def csv_cell(text: str) -> str:
    """Return text for a field of a CSV file; the writer adds the quotation marks.

    Text that a spreadsheet would evaluate as a formula is prefixed with an apostrophe.

    Examples
    --------
    >>> csv_cell("=1+1"), csv_cell("mirror 1")
    ("'=1+1", 'mirror 1')
    """
    prefix = "'" if text.lstrip()[:1] in ("=", "+", "-", "@") else ""
    return prefix + escape_invisible(text)  # tabs and carriage returns become escapes


def csv_comment(line: str) -> str:
    """Return a comment line of a CSV file in TOML, in which no cell of a spreadsheet is a formula.

    Characters that would start a formula after a separator become TOML escapes.

    Examples
    --------
    >>> print(csv_comment('name = "a,=1+1"'))
    name = "a,\\u003d1+1"
    """
    return re.sub(r"([,;|\t][\s\"']*)([=+@-])", lambda m: f"{m[1]}\\u{ord(m[2]):04x}", line)


def file_stem(name: str, default: str) -> str:
    """Return a file name without its suffix, of at most :data:`MAX_STEM` bytes, for a name.

    Examples
    --------
    >>> file_stem("my mirror / 2", "sensor"), file_stem("../..", "sensor")
    ('my-mirror-2', 'sensor')
    """
    stem = re.sub(r"[^\w.+-]+", "-", name)
    return stem.encode()[:MAX_STEM].decode(errors="ignore").strip("-.") or default


def http_attachment(name: str) -> str:
    """Return the value of a Content-Disposition header that offers a file under a name (RFC 6266).

    Examples
    --------
    >>> http_attachment("a.csv")
    'attachment; filename="a.csv"'
    >>> print(http_attachment('ö".csv'))
    attachment; filename="o_.csv"; filename*=UTF-8''%C3%B6%22.csv
    """
    plain = re.sub(r"[^\w.+-]", "_", ascii_only(escape_invisible(name)), flags=re.ASCII)
    extended = (
        "" if plain == name else f"; filename*=UTF-8''{quote(escape_invisible(name), safe='')}"
    )
    return f'attachment; filename="{plain}"{extended}'


# -- Drawings and CAD -----------------------------------------------------------------------------


def plot_text(text: str) -> str:
    """Return text for a label of Matplotlib: dollar signs are no formulas.

    Examples
    --------
    >>> print(plot_text("$x$ 5"))
    \\$x\\$ 5
    """
    return label(text, MAX_PLOT_LABEL).replace("$", r"\$")


def dxf_text(text: str) -> str:
    """Return text for a single-line TEXT entity of DXF.

    Examples
    --------
    >>> print(dxf_text("100%%c ^J \\\\U+0041"))
    100%%%%%%c ^ J \\U +0041
    """
    return _without_codes(escape_invisible(text).replace("%%", "%%%%%%").replace("^", "^ "))


def dxf_mtext(text: str) -> str:
    """Return one line for an MTEXT entity of DXF.

    Examples
    --------
    >>> print(dxf_mtext("{a\\\\P}"))
    \\{a\\\\P\\}
    """
    escaped = re.sub(r"([\\{}])", r"\\\1", label(text)).replace("^", "^ ").replace("%%", "%%%%%%")
    return _without_codes(escaped)


def _without_codes(text: str) -> str:
    """Insert a space into sequences that some DXF readers decode as a character: ``\\U+0041``,
    ``\\M+18281``.
    """
    return re.sub(r"(?<=\\[UuMm])(?=\+)", " ", text)


def step_string(text: str, max_characters: int = MAX_STEP_STRING) -> str:
    """Return text for the inside of a string of a STEP file (ISO 10303-21), of at most
    ``max_characters`` characters.

    OpenCASCADE breaks long strings into lines, even within an encoded character, and ends a string
    of several lines at ``')``. Therefore names are cut to one line, and apostrophes are encoded,
    not doubled.

    Examples
    --------
    >>> print(step_string("Größe"))
    Gr\\X2\\00F600DF\\X0\\e
    """
    lengths = range(min(max_characters, MAX_LABEL), 2, -1)
    return next(code for n in lengths if len(code := _step_code(label(text, n))) <= max_characters)


def _step_code(text: str) -> str:
    """Encode all but printable ASCII, and backslashes and apostrophes, as control directives."""
    return re.sub(r"[^ -&(-\[\]-~]+", lambda run: _directive(run[0]), text)


def _directive(run: str) -> str:
    digits, encoding = ("2", "utf-16-be") if max(run) < "\U00010000" else ("4", "utf-32-be")
    return f"\\X{digits}\\{run.encode(encoding).hex().upper()}\\X0\\"


# -- Streams --------------------------------------------------------------------------------------


def terminal_text(text: str) -> str:
    """Return text for a terminal, without control sequences.

    Examples
    --------
    >>> terminal_text("a\\x1b[31m\\nb")
    'a\\\\x1b[31m\\nb'
    """
    return escape_invisible(text, keep="\n\t")


def ascii_only(text: str) -> str:
    """Return text in ASCII: letters without accents, other characters as escapes.

    Examples
    --------
    >>> ascii_only("für 5 µm")
    'fur 5 \\\\xb5m'
    """
    return "".join(c if c.isascii() else _ascii_equivalent(c) for c in text)


def _ascii_equivalent(character: str) -> str:
    base = unicodedata.normalize("NFD", character).encode("ascii", "ignore").decode()
    return base or character.encode("ascii", "backslashreplace").decode()
