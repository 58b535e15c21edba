"""Mechanical rules of the style guide: openings of docstrings, option help, headings, messages,
numbers, spelling, terms and names.

Texts are docstrings, comments, option help and error messages of the package, and the pages of the
documentation without code. The package is not imported.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Container, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "omnimirror"

GIVEN = "options given on the command line, as opposed to defaults"
EXCEPTIONS = {
    "apps/cli/_camera_options.py: given": GIVEN,
    "apps/cli/_declarations.py: given": GIVEN,
    "apps/cli/_design_options.py: given": GIVEN,
    "apps/cli/_scene_options.py: given": GIVEN,
    "apps/cli/commands/design.py: given": GIVEN,
    "apps/cli/commands/dewarp.py: given": GIVEN,
    "apps/cli/commands/evaluate.py: given": GIVEN,
    "apps/cli/commands/simulate.py: given": GIVEN,
}
"""Permitted violations as reported by the rules, with their reasons."""
MAX_EXCEPTIONS = 30

# -- Vocabulary ------------------------------------------------------------------------------------


def words(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


VERBS = words(
    """
    abort accumulate add adjust align arrange allocate analyse answer append apply approximate
    assemble average bracket build calibrate call change check choose clip close collect
    combine compare complete compose compress compute concatenate connect construct convert
    copy correct count declare create crop cross-validate decode decompress define deform deliver
    deduce derive describe design detect dewarp discard display distort distribute divide
    document draw encode end enumerate escape estimate evaluate expand export extend
    extrapolate fill filter find finish fit flush follow format forward generate get group
    handle hatch hold import infer insert integrate interpolate interrupt intersect invert
    iterate join keep kill label list load locate lock map mark measure merge minimise
    maximise monitor move multiply name normalise notify occupy open optimise output pack
    pad paint parse pickle place plan plot prepare print process project propagate provide
    push query queue raise rank read receive record redraw reduce refine reflect refract
    register reject release remove render repeat replace report represent request resend
    resample reserve reset resolve restart restore return reverse revolve rotate round run
    sample save scale search select send separate serialise serve set shift shorten show
    simulate simplify skip smooth solve sort split stack start stop store substitute
    subtract suggest suppress tabulate terminate test trace track transform triangulate
    truncate try undistort unpack update use validate verify view wait weight wrap write
    yield zip
    """
)
"""Verbs that may open the docstring of a function."""
NOUNS = words(
    """
    answer approximate average bracket close complete dewarp open report separate smooth
    substitute call change check count cross-validation design display document
    end estimate export filter fit format group hold label limit list lock map mark measure
    name output pad plan plot process project query queue rank record request reserve reset
    reverse round run sample scale search set shift show split stack start stop store test
    trace track transform try update use view wait weight import
    """
)
"""Verbs that are also nouns, which may open the docstring of a class or an attribute."""
CLAUSES = words(
    """
    what whether how that where which who whose why when if because of by from in to for
    with as at on
    """
)
"""Words that open a clause or a fragment."""
PROPER_NAMES = words(
    """
    Airy AprilTag Blender Carlo Docker FFmpeg Gaussian Gauss-Newton Git GStreamer Kalibr
    Lambertian Matplotlib Mitsuba Monte Newton Node NumPy Optiland Pareto Python PyTorch ROS
    Scaramuzza Seidel Sobol Studio Zemax Zernike
    """
)
"""Names with a capital inside headings."""
AMERICAN = re.compile(
    r"""(?:
    (?:\w*(?:colo|behavio|favo|neighbo|hono|labo|vapo)r)(?:s|ed|ing|less|hood|ful|al|able)?
    | \w*(?:optim|minim|maxim|normal|initial|summar|recogn|parametr|discret|quant|vector|general|
      orthogonal|synchron|visual|local|serial|token|util|regular|symmetr|special|standard|organ|
      custom|emphas|penal|categor|digit|equal|stabil|polar|parallel|linear|real|character|
      priorit|random|final|capital|memor|item)iz(?:e|es|ed|ing|ation|ations|er|ers|able)
    | \w*analyz(?:e|es|ed|ing|er)
    | (?:de|re)?cent(?:er|ers|ered|ering)
    | (?:milli|centi|micro|nano)?meters?
    | fibers? | catalogs? | grays? | grayscale
    | (?:model|label|cancel|level|signal|travel|channel)(?:ed|ing)
    | aluminum | artifacts? | fulfill | defense
    )""",
    re.VERBOSE,
)
REPLACED_TERMS = {
    r"pictures?": "image",
    r"straighten(?:s|ed|ing)?": "dewarp, undistort or rectify",
    r"tells?|told|telling": "specify, report",
    r"says?|said|saying": "state, report",
    r"ask(?:s|ed|ing)?": "request, require",
    r"judg(?:e|es|ed|ing|ement)": "check, evaluate",
    r"askew|out of (?:its )?place|in its place": "misaligned, aligned",
    r"leans?|leaned|leaning": "tilt",
    r"near things|things?": "objects",
    r"bought": "off-the-shelf",
    r"free[ -]form": "freeform",
    r"hand(?:s|ed)? over|hand-off": "export, pass",
    r"wrong points?": "outliers",
    r"pictures left out|images left out": "held-out images",
    r"sets? to learn from|learning sets?": "training dataset",
    r"offer(?:s|ed)? views?": "serve views",
    r"kept (?:best|worst)": "largest margin, smallest margin",
    r"takes? (?:an image|images)": "capture, render",
    r"rim finder|find(?:s|ing)? the rim": "mirror-outline detection",
    r"anew|alike|nobody|beside|thereby|whichever": "again, equal, next to",
    r"fields? of vision": "field of view",
    r"hardly|merely": "scarcely changed, only",
    r"two thirds|three fifths|a (?:third|fifth|tenth) of": "a number",
}
"""Terms of early versions, and the terms that replace them."""
TERM = re.compile(rf"\b(?:{'|'.join(REPLACED_TERMS)})\b", re.IGNORECASE)
REPLACED_WORDS = words(
    """
    picture pictures straighten straightened told tell say said askew bought anew alike
    judged judge leaning ours looker knobs wanted
    """
)
"""Words that names may not contain."""
VERB_FORMS = words(
    """
    seen found made asked wanted kept given said told meant gone looked judged tried says
    tells asks wants sees gives looks stands least most
    """
)
"""Names of local variables that state an event instead of a quantity."""
BARE_CONSTANT = re.compile(
    r"_?(?:(?!MANIFEST)[A-Z]{2,}EST|NOTHING|KEPT|MOST|LEAST|ENOUGH|OURS|FAR|NEAR|FEW|MORE|LESS|AWAY|BEYOND|"
    r"AROUND|ALONG|TOGETHER|MANY|FINER|LEAST_\w+|FARTHEST_\w+)"
)

# -- Texts -----------------------------------------------------------------------------------------


class Text(NamedTuple):
    """Text of the package or of a page."""

    kind: str
    name: str
    text: str
    place: str


CODE = re.compile(r"``[^`]*``|`[^`]*`|:\w+:`[^`]*`|\{[^{}]*\}|<[^<>\n]*>|\]\([^)]*\)|https?://\S+")


STRING = re.compile(r"""("(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')""")


def prose(text: str) -> str:
    """Return a text without code, quoted names, placeholders and doctests.

    >>> prose("Read ``a.b``; got {x!r} of `om`.")
    'Read  ; got   of  .'
    """
    text = re.sub(r"(?m)^\s*(?:>>>|\.\.\. ).*(?:\n(?!\s*$).*)*", "", text)
    return CODE.sub(" ", text)


class Name(NamedTuple):
    """Name that a module binds."""

    name: str
    is_local: bool
    """True inside a function."""
    is_class: bool


FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
STRINGS = (ast.Constant, ast.JoinedStr)
LEAVES = (ast.expr_context, ast.operator, ast.unaryop, ast.cmpop, ast.boolop, ast.Constant)


class Module(NamedTuple):
    """Texts and names of a module."""

    place: str
    texts: list[Text]
    names: list[Name]
    in_strings: set[int]
    """Lines of strings with several lines."""

    def visit(self, node: ast.AST, is_local: bool = False) -> None:
        """Collect the texts and names of a node and its children."""
        if isinstance(node, DOCUMENTED):
            self.texts.extend(docstrings(node, self.place))
        self.texts.extend(strings(node, self.place))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            self.names.append(Name(node.id, is_local, False))
        elif isinstance(node, ast.arg):
            self.names.append(Name(node.arg, True, False))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            self.names.append(Name(node.name, False, False))
        elif isinstance(node, ast.ClassDef):
            self.names.append(Name(node.name, False, not is_local))
        is_local = is_local or isinstance(node, FUNCTIONS)
        for child in ast.iter_child_nodes(node):
            if isinstance(child, STRINGS) and child.end_lineno != child.lineno:
                self.in_strings.update(range(child.lineno, (child.end_lineno or 0) + 1))
            if not isinstance(child, LEAVES):
                self.visit(child, is_local)


@cache
def modules() -> tuple[Module, ...]:
    """Return the texts and names of all modules."""
    results = []
    for path in sorted(SOURCE.rglob("*.py")):
        module, source = Module(str(path.relative_to(SOURCE)), [], [], set()), path.read_text()
        module.visit(ast.parse(source))
        module.texts.extend(comments(source, module.place, module.in_strings))
        results.append(module)
    return tuple(results)


def docstrings(node: ast.AST, module_path: str) -> Iterator[Text]:
    """Yield the docstrings of a module, class or function and of its attributes."""
    assert isinstance(node, DOCUMENTED)
    if doc := ast.get_docstring(node):
        kind = type(node).__name__.removeprefix("Async").removesuffix("Def").lower()
        if any(ast.unparse(d).endswith("property") for d in getattr(node, "decorator_list", [])):
            kind = "property"
        yield Text(kind, getattr(node, "name", ""), doc, f"{module_path}:{node.body[0].lineno}")
    for field, below in pairwise(node.body):
        if isinstance(field, ast.Assign | ast.AnnAssign) and isinstance(below, ast.Expr):
            target = field.targets[0] if isinstance(field, ast.Assign) else field.target
            if text := literal(below.value):
                location = f"{module_path}:{below.lineno}"
                yield Text("attribute", ast.unparse(target), inspect.cleandoc(text), location)


def literal(node: ast.expr) -> str:
    """Return a string expression with ``{...}`` for its values; empty for other expressions."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(literal(v) or "{...}" for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return literal(node.left) + literal(node.right)
    if isinstance(node, ast.IfExp):
        return literal(node.body) or literal(node.orelse)
    return ""


def strings(node: ast.AST, where: str) -> Iterator[Text]:
    """Yield the error message or the option help of a node."""
    if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
        yield Text("message", "", literal(node.exc.args[0]), f"{where}:{node.lineno}")
    elif isinstance(node, ast.keyword) and node.arg in ("help", "short_help"):
        yield Text("help", "", literal(node.value), f"{where}:{node.value.lineno}")


def comments(source: str, where: str, in_strings: Container[int]) -> Iterator[Text]:
    """Yield the comments of a module, adjacent lines as one."""
    block: list[str] = []
    last = 0
    for row, line in enumerate(source.splitlines(), start=1):
        if "#" not in line or row in in_strings:
            continue
        code, _, comment = STRING.sub("", line).partition("#")
        if block and (row != last + 1 or code.strip()):
            yield Text("comment", "", " ".join(block), f"{where}:{last}")
            block = []
        if comment:
            block.append(comment.strip("# "))
            last = row
    if block:
        yield Text("comment", "", " ".join(block), f"{where}:{last}")


def pages() -> list[Path]:
    """Return the pages of the documentation."""
    own = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "CODE_OF_CONDUCT.md", "SECURITY.md")
    folders = ("native", "web", "release")
    return [
        *sorted((ROOT / "docs").glob("*.md")),
        *(ROOT / name for name in own),
        *(ROOT / name / "README.md" for name in folders),
    ]


@cache
def texts() -> tuple[Text, ...]:
    """Return all texts."""
    results = [text for module in modules() for text in module.texts if text.text]
    for page in pages():
        text = re.sub(r"(?ms)^```.*?^```|^ {4}\S.*?$|^<!--.*?-->", "", page.read_text())
        where = page.relative_to(ROOT)
        for line in re.split(r"\n(?=#)|\n\s*\n", text):
            kind = "heading" if line.startswith("#") else "page"
            head, _, body = line.partition("\n") if kind == "heading" else (line, "", "")
            results.append(Text(kind, "", head, str(where)))
            if body:
                results.append(Text("page", "", body, str(where)))
    return tuple(results)


def first_word(text: str) -> str:
    """Return the first word of a text in lower case."""
    match = re.match(r"[\W\d]*([A-Za-z][\w'-]*)", text)
    return match[1].lower() if match else ""


# -- Rules: each yields "place: quotation" ---------------------------------------------------------


def quoted(text: Text, hit: str) -> str:
    """Return a violation for a message and for :data:`EXCEPTIONS`."""
    return f"{text.place}: {' '.join(hit.split())}"


def function_docstrings() -> Iterator[str]:
    """Docstrings of functions start with an imperative verb."""
    for text in texts():
        if text.kind == "function" and first_word(text.text) not in VERBS:
            yield quoted(text, f"{text.name}: {text.text[:60]}")


def noun_docstrings() -> Iterator[str]:
    """Docstrings of modules, classes, properties and attributes start with a noun phrase."""
    for text in texts():
        if text.kind not in ("module", "class", "property", "attribute"):
            continue
        word = first_word(text.text)
        is_verb = word in VERBS and (
            word not in NOUNS or re.match(r"\w+ (?:the|an?|all|each|if|whether|it)\b", text.text)
        )
        if (is_verb or word in CLAUSES) and text.text[:1].isupper():
            yield quoted(text, f"{text.name}: {text.text[:60]}")


def option_help() -> Iterator[str]:
    """Help of options starts with a capital, ends with a stop, and has no third person."""
    third = re.compile(rf"^(?:{'|'.join(sorted(v for v in VERBS if v not in NOUNS))})e?s\b", re.I)
    for text in texts():
        if text.kind == "help":
            body = re.sub(r"\s*\[(?:default|required)[^]]*\]\.?$", "", text.text).strip()
            if (
                not re.match(r"[A-Z0-9'\"{`-]", body)
                or not body.endswith((".", "}", ".)"))
                or any(third.match(s) for s in re.split(r"[.] +", body))
            ):
                yield quoted(text, body[:80])


def headings() -> Iterator[str]:
    """Headings are noun phrases or imperatives in sentence case."""
    for text in texts():
        if text.kind != "heading" or re.match(r"# omnimirror|#+ \[", text.text):
            continue
        title = re.sub(r"^#+ (?:\d+\. )?", "", text.text)
        title_words = re.findall(r"[\w.'-]+", CODE.sub(" ", title))
        capitals = [w for w in title_words[1:] if re.fullmatch("[A-Z][a-z]+", w)]
        if (
            title.endswith((".", "?", "!"))
            or not re.match(r"[A-Z0-9`]", title)
            or first_word(title) in CLAUSES - {"from"}
            or set(capitals) - PROPER_NAMES
        ):
            yield quoted(text, title)


CONDITION = re.compile(
    r"\bmust be (?:between|at (?:least|most)|(?:less|greater|smaller|larger) than|above|below|one of)\b"
)


def messages() -> Iterator[str]:
    """Messages start in lower case, have no final stop, and contain the value of a range."""
    for text in texts():
        if text.kind != "message":
            continue
        is_capital = re.match(r"[A-Z][a-z]+\b(?![/.])", text.text)
        if (is_capital and is_capital[0] not in PROPER_NAMES) or text.text.rstrip().endswith("."):
            yield quoted(text, text.text[:80])
        if CONDITION.search(text.text) and not re.search("got|{", text.text):
            yield quoted(text, text.text[:80])


def numbers() -> Iterator[str]:
    """Numbers have a leading zero, and an ellipsis has three points."""
    pattern = re.compile(
        r"(?<![\w.)\]'\"*\\/:{}+-])[-+]?\.\d+\b|(?<![.\w\"/])\.\.(?![./\w\"]| \[)|\w\.\.(?![.\w/])"
    )
    for text in texts():
        body = CODE.sub(" ", text.text)
        for match in pattern.finditer(body):
            yield quoted(text, body[max(0, match.start() - 20) : match.end() + 15])


def spelling() -> Iterator[str]:
    """British spelling."""
    bodies = {text: prose(text.text) for text in texts()}
    used = {word for body in bodies.values() for word in re.findall(r"[a-z]+", body.lower())}
    american = [word for word in used if AMERICAN.fullmatch(word)]
    if american:
        pattern = re.compile(rf"\b(?:{'|'.join(american)})\b", re.IGNORECASE)
        for text, body in bodies.items():
            for match in pattern.finditer(body):
                yield quoted(text, body[max(0, match.start() - 20) : match.end() + 20])


def terms() -> Iterator[str]:
    """Each concept has one term."""
    for text in texts():
        body = prose(text.text)
        for match in TERM.finditer(body):
            yield quoted(text, body[max(0, match.start() - 20) : match.end() + 20])


def names() -> Iterator[str]:
    """Names are nouns for values, and constants state what they limit."""
    for module in modules():
        for name in module.names:
            parts = {w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name.name)}
            if (
                (name.is_local and name.name in VERB_FORMS)
                or BARE_CONSTANT.fullmatch(name.name)
                or parts & REPLACED_WORDS
            ):
                yield f"{module.place}: {name.name}"


def class_names() -> Iterator[str]:
    """Public classes have different names."""
    homes: dict[str, set[str]] = {}
    for module in modules():
        for name in module.names:
            if name.is_class and not name.name.startswith("_"):
                homes.setdefault(name.name, set()).add(module.place)
    for name, files in homes.items():
        if len(files) > 1:
            yield f"{name}: {', '.join(sorted(files))}"


RULES: tuple[Callable[[], Iterator[str]], ...] = (
    function_docstrings,
    noun_docstrings,
    option_help,
    headings,
    messages,
    numbers,
    spelling,
    terms,
    names,
    class_names,
)


def key(violation: str) -> str:
    """Return a violation without its line, which changes with every edit."""
    return re.sub(r"^(\S+?\.py):\d+:", r"\1:", violation)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_texts_and_names_follow_the_style_guide(rule):
    violations = [v for v in dict.fromkeys(rule()) if key(v) not in EXCEPTIONS]
    assert not violations, f"{rule.__doc__}\n" + "\n".join(violations)


def test_exceptions_are_few_and_necessary():
    reported = {key(violation) for rule in RULES for violation in rule()}
    assert len(EXCEPTIONS) <= MAX_EXCEPTIONS
    assert set(EXCEPTIONS) - reported == set()
