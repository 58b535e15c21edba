"""Make the pictures of the pages on simulating, mappings, drawings and trade-offs.

python docs/images/pages.py [NAME ...]

Each is what a command of omnimirror draws, scaled to the page; without names all are made.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from omnimirror.io import read_image, write_image

IMAGES = Path(__file__).parent
GAP = 10
WHITE = (255, 255, 255)

STREET = "--support rod --support-diameter-mm 3 --support-end-diameter-mm 6 --reflectivity aluminium"
DOME = "--support dome --camera-diameter-mm 40"
COMMANDS: dict[str, tuple[str, ...]] = {
    "scenes.jpg": (
        f"simulate paper-spherical --scene street {STREET} --spp 16 -o street.png --panorama panorama.png",
        f"simulate paper-equidistant --scene hall {DOME} --spp 16 -o hall.png",
    ),
    "drawing.png": (
        "tolerance init paper-spherical",
        "export paper-spherical -o drawing.png --sheet A4 --thread M6 --bore-depth-mm 12 --workshop workshop.toml "
        "--tolerances tolerances.toml",
    ),
    "folded-drawing.png": ("export folded-spherical -o drawing.png --sheet A4",),
    "mappings.png": ("mappings --figure mappings.png",),
    "front.png": (
        "design --pareto worst_floored_area_deg2,inverse_area_ratio --shape polynomial:6 --figure front.png",
    ),
}
ROWS: dict[str, tuple[tuple[str, ...], ...]] = {
    "scenes.jpg": (("street.png", "hall.png"), ("panorama.png",)),
    "drawing.png": (("drawing.png", "drawing-mirror.png"),),
    "folded-drawing.png": (("drawing.png", "drawing-mirror.png", "drawing-secondary.png"),),
    "mappings.png": (("mappings.png",),),
    "front.png": (("front.png",),),
}
"""What stands beside each other and below each other."""
WIDTHS = {
    "scenes.jpg": 1200, "drawing.png": 1500, "folded-drawing.png": 1984, "mappings.png": 1440,
    "front.png": 1036,
}  # fmt: skip


def make(name: str, folder: Path) -> None:
    """Run the commands of a picture in a folder, and put what they draw together."""
    program = Path(sys.executable).with_name("omnimirror")
    text = (IMAGES.parent / "manufacture.md").read_text(encoding="utf-8")
    (folder / "workshop.toml").write_text(re.search(r"```toml\n(# workshop.toml\n.*?)```", text, flags=re.S)[1])
    for command in COMMANDS[name]:
        subprocess.run([program, *shlex.split(command)], cwd=folder, check=True)
    rows = [[read_image(folder / part)[..., :3] for part in row] for row in ROWS[name]]
    write_image(IMAGES / name, np.concatenate([side_by_side(row, WIDTHS[name]) for row in rows])[:-GAP])


def side_by_side(parts: list[np.ndarray], width: int) -> np.ndarray:
    """Pictures of one height side by side, all together of a width, and a gap below."""
    height = round((width - GAP * (len(parts) - 1)) / sum(part.shape[1] / part.shape[0] for part in parts))
    pieces = []
    for part in parts:
        size = (round(part.shape[1] * height / part.shape[0]), height)
        pieces += [cv2.resize(part, size, interpolation=cv2.INTER_AREA), np.full((height, GAP, 3), WHITE, np.uint8)]
    row = np.concatenate(pieces[:-1], axis=1)
    missing = max(width - row.shape[1], 0)
    return cv2.copyMakeBorder(row, 0, GAP, 0, missing, cv2.BORDER_CONSTANT, value=WHITE)[:, :width]


if __name__ == "__main__":
    for name in sys.argv[1:] or COMMANDS:
        with TemporaryDirectory() as temporary:
            make(name, Path(temporary))
