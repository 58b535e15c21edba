"""Generate the gallery page and its images from the examples in gallery/.

    python docs/gallery.py [NAME ...]

Each example is a program of fewer than 30 lines that writes an image with its own name to the
working directory. Images are generated for the given names, or for all examples; the page is always
generated.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from omnimirror.io import read_image

ROOT = Path(__file__).resolve().parents[1]
PAGE, IMAGES = ROOT / "docs" / "gallery.md", ROOT / "docs" / "images" / "gallery"
SECTIONS = {
    "dewarp": "Dewarping and export",
    "evaluate": "Evaluation",
    "design": "Design",
    "simulate": "Simulation",
    "measure": "Measurement, calibration and tolerancing",
}
PROPER_NAMES = {"mtf": "MTF", "opencv": "OpenCV"}
COLUMNS = 4  # thumbnails in a row
WIDTH, QUALITY = 600, 80  # images on the page: width in px, WebP quality
INTRODUCTION = """# Gallery

Example programs with their output. The sources are in `gallery/`, and the tests run them:
`python gallery/dewarp/panorama.py`.
"""


def examples() -> list[Path]:
    """Return the example programs in the order of the page."""
    return [
        path for folder in SECTIONS for path in sorted((ROOT / "gallery" / folder).glob("*.py"))
    ]


def heading(stem: str) -> str:
    """Return the heading of an example, from the name of its file.

    >>> heading("mtf_over_the_field"), heading("opencv_remap")
    ('MTF over the field', 'OpenCV remap')
    """
    first, *others = stem.split("_")
    return " ".join([PROPER_NAMES.get(first, first.capitalize()), *others])


def thumbnails() -> str:
    """Return tables of linked images, one per section."""
    parts = []
    for folder, title in SECTIONS.items():
        cells = [
            f"[![{heading(path.stem)}](images/gallery/{path.stem}.webp)<br>{heading(path.stem)}]"
            f"(#{heading(path.stem).lower().replace(' ', '-')})"
            for path in examples()
            if path.parent.name == folder
        ]
        rows = [cells[i : i + COLUMNS] for i in range(0, len(cells), COLUMNS)]
        table = [[title, *[""] * (COLUMNS - 1)], ["---"] * COLUMNS, *rows]
        lines = [f"| {' | '.join([*row, *[''] * (COLUMNS - len(row))])} |" for row in table]
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def page() -> str:
    """Return the text of the page."""
    parts, folder = [INTRODUCTION, thumbnails()], ""
    for path in examples():
        if path.parent.name != folder:
            folder = path.parent.name
            parts.append(f"## {SECTIONS[folder]}\n")
        source = path.read_text(encoding="utf-8")
        title = (ast.get_docstring(ast.parse(source)) or "").rstrip(".")
        code = source.split('"""\n', 2)[-1].strip()
        name = heading(path.stem)
        parts.append(
            f"### {name}\n\n{title}.\n\n![{title}](images/gallery/{path.stem}.webp)\n\n```python\n{code}\n```\n"
        )
    return "\n".join(parts)


def make_image(example: Path) -> None:
    """Run an example and store its image, scaled to the width of the page."""
    with TemporaryDirectory() as folder:
        environment = {**os.environ, "MPLBACKEND": "Agg"}
        subprocess.run([sys.executable, example], cwd=folder, check=True, env=environment)
        image = read_image(Path(folder) / f"{example.stem}.png")[..., :3]
    height, width = image.shape[:2]
    if width > WIDTH:
        image = cv2.resize(
            image, (WIDTH, round(height * WIDTH / width)), interpolation=cv2.INTER_AREA
        )
    IMAGES.mkdir(exist_ok=True)
    _, data = cv2.imencode(".webp", image[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    (IMAGES / f"{example.stem}.webp").write_bytes(data.tobytes())


if __name__ == "__main__":
    for path in examples():
        if path.stem in sys.argv[1:] or not sys.argv[1:]:
            make_image(path)
    PAGE.write_text(page(), encoding="utf-8")
