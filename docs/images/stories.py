"""Generate the images of docs/stories.md with its own commands at more rays per pixel, and that of
docs/bought.md.

python docs/images/stories.py
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
STORIES_PAGE, BOUGHT_PAGE = IMAGES.parent / "stories.md", IMAGES.parent / "bought.md"
IMAGE_ROWS = {
    "robot.jpg": (("robot.jpg", "robot-plan.jpg"), ("robot-drawing.png",)),
    "ceiling.jpg": (("ceiling.jpg", "ceiling-drawing.png"), ("ceiling-panorama.jpg",)),
    "panorama.jpg": (("panorama.jpg", "panorama-drawing.png"), ("panorama-dewarped.jpg",)),
}
"""Images of the page by rows."""
WIDTH, GAP = 1200, 10


def _files_of(page: Path, folder: Path) -> str:
    """Write the files listed on a page; return its text."""
    text = page.read_text(encoding="utf-8")
    for name, file in re.findall(r"^```toml\n# ([\w-]+\.toml)\n(.*?)^```", text, flags=re.M | re.S):
        (folder / name).write_text(file, encoding="utf-8")
    return text


def make_bought(folder: Path) -> None:
    """Run the designs and renderings of docs/bought.md."""
    text, program = _files_of(BOUGHT_PAGE, folder), Path(sys.executable).with_name("omnimirror")
    for line in re.findall(
        r"^\$ omnimirror ((?:design \w+\.toml|simulate|dewarp) .*)", text, flags=re.M
    ):
        subprocess.run([program, *shlex.split(line)], cwd=folder, check=True)
    names = ("hall", "pipe", "player", "sky")
    rows = [_row([_square(read_image(folder / f"{name}.jpg")) for name in names])]
    rows.append(_row([read_image(folder / "hall-panorama.jpg")]))
    write_image(IMAGES / "bought.jpg", np.concatenate(rows))


def _square(image: np.ndarray) -> np.ndarray:
    """Crop a landscape image to its central square."""
    side = image.shape[0]
    left = (image.shape[1] - side) // 2
    return image[:, left : left + side]


def make(folder: Path) -> None:
    """Run the commands in a folder and compose their output side by side."""
    text, program = _files_of(STORIES_PAGE, folder), Path(sys.executable).with_name("omnimirror")
    for block in re.findall(r"^```console\n(.*?)^```", text, flags=re.M | re.S):
        for line in re.findall(r"^\$ omnimirror (.*)", block, flags=re.M):
            arguments = line.replace("--spp 1", "--spp 16").replace("zmx,csv,pdf", "png")
            subprocess.run([program, *shlex.split(arguments)], cwd=folder, check=True)
    for drawing in folder.glob("*-workshop/*[!r]-drawing.png"):  # of the sensor, not of its mirror
        drawing.rename(folder / drawing.name)
    for name, rows in IMAGE_ROWS.items():
        page = np.concatenate(
            [_row([read_image(folder / part)[..., :3] for part in row]) for row in rows]
        )
        write_image(IMAGES / name, page)
    figure = read_image(folder / "panorama-figures" / "fig5.png")[..., :3]
    write_image(IMAGES / "panorama-mapping.png", _scaled(figure, 900 / figure.shape[1]))


def _row(parts: list[np.ndarray]) -> np.ndarray:
    """Scale images to a common height and the total width of the page."""
    widths = [part.shape[1] / part.shape[0] for part in parts]
    height = (WIDTH - GAP * (len(parts) - 1)) / sum(widths)
    scaled = [_scaled(part, height / part.shape[0]) for part in parts]
    rows = min(part.shape[0] for part in scaled)
    gap = np.full((rows, GAP, 3), 255, np.uint8)
    row = np.concatenate([piece for part in scaled for piece in (part[:rows], gap)][:-1], axis=1)
    row = cv2.copyMakeBorder(
        row, 0, GAP, 0, max(WIDTH - row.shape[1], 0), cv2.BORDER_CONSTANT, value=(255,) * 3
    )
    return row[:, :WIDTH]


def _scaled(image: np.ndarray, factor: float) -> np.ndarray:
    return cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)


if __name__ == "__main__":
    with TemporaryDirectory() as temporary:
        make(Path(temporary))
        make_bought(Path(temporary))
