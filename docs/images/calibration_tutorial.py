"""Generate the images of docs/tutorial-calibration.md with its own commands at higher sampling, and
maps of true errors.

python docs/images/calibration_tutorial.py [FOLDER]

A given folder is not deleted, and its existing image sets and cameras are reused.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from pages import GAP, side_by_side
from PIL import Image

import omnimirror as om
from omnimirror.io import read_image

IMAGES = Path(__file__).parent
PAGE = IMAGES.parent / "tutorial-calibration.md"
ROWS = {
    "tutorial-pictures.jpg": (("board.png", "boards/view-004.png", "boards/view-002.png"),),
    "tutorial-rim.jpg": (("rim.png",),),
    "tutorial-first.jpg": (("hall.png", "first.png"),),
    "tutorial-report.webp": (("figures/residuals.png", "figures/coverage.png"),),
    "tutorial-straight.jpg": (("view.png", "uncalibrated.png"), ("panorama.png",)),
    "tutorial-truth.webp": (("truth.png",),),
}
"""Images of the page by rows."""
WIDTHS = {"tutorial-report.webp": 1100, "tutorial-truth.webp": 1100}
WIDTH = 1000
QUALITY = 72
SAME_VIEW = "--view perspective --pan-deg 60 --tilt-deg -30 --size 800x600 -o uncalibrated.png"
FAR_MM = 1e9


def make(folder: Path) -> None:
    """Run all commands of the page and compose its images."""
    text = PAGE.read_text(encoding="utf-8")
    (folder / "bought.toml").write_text(
        re.findall(r"^```toml\n(# bought\.toml\n.*?)^```", text, flags=re.M | re.S)[0]
    )
    for line in re.findall(r"^\$ omnimirror (.*)", text, flags=re.M):
        if line.startswith("calibrate"):
            _calibrate(folder)
        elif not (line.startswith("simulate dataset") and (folder / "boards").exists()):
            _run(
                line.replace("--spp 1 --no-blur", "--spp 9").replace("board.pdf", "board.png"),
                folder,
            )
    _run(f"dewarp hall.png --auto {SAME_VIEW}", folder)
    _draw_truth(folder)
    _put_together(folder)


def _put_together(folder: Path) -> None:
    for name, rows in ROWS.items():
        width = WIDTHS.get(name, WIDTH)
        page = np.concatenate(
            [side_by_side([_rgb(folder / part) for part in row], width) for row in rows]
        )
        Image.fromarray(page[:-GAP]).save(IMAGES / name, quality=QUALITY)


def _rgb(file: Path) -> np.ndarray:
    image = read_image(file)
    return np.dstack([image] * 3) if image.ndim == 2 else image[..., :3]


def _run(line: str, folder: Path) -> None:
    subprocess.run([sys.executable, "-m", "omnimirror", *shlex.split(line)], cwd=folder, check=True)


def _calibrate(folder: Path) -> None:
    """Run the calibrations of the page: the mirror model, and a single-viewpoint camera."""
    if (folder / "central.toml").exists():
        return
    board = om.Board("chessboard", 11, 7, 100.0)
    detections = om.find_boards(sorted((folder / "boards").glob("*.png")), board, several=True)
    calibration = om.calibrate_camera(detections, board)
    calibration.save(folder / "camera.toml")
    om.write_calibration_figures(calibration, folder / "figures", kind="png")
    om.calibrate_camera(detections, board, model="kannala-brandt", rim_radius_px=375.4).save(
        folder / "central.toml"
    )


def _draw_truth(folder: Path) -> None:
    """Draw maps of the direction error of both cameras, for near and distant objects."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    truth = om.load_sensor(folder / "bought.toml")
    u, v = np.meshgrid(np.arange(0.0, 800.0, 10.0), np.arange(0.0, 800.0, 10.0))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    is_inside = np.hypot(*(pixels - [406.5, 391.9]).T) < 370.0
    true_rays = truth.backproject(pixels[is_inside])
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    axes = figure.subplots(1, 3)
    cases = (
        ("central.toml", 2500.0, "single viewpoint, 2.5 m"),
        ("central.toml", FAR_MM, "single viewpoint, distant objects"),
        ("camera.toml", FAR_MM, "mirror model, distant objects"),
    )
    for ax, (name, distance_mm, title) in zip(axes, cases, strict=True):
        camera_rays = om.load_camera(folder / name).backproject(pixels[is_inside])

        def angular_errors(pose, at_mm, rays=camera_rays):
            offsets = Rotation.from_rotvec(pose[:3]).apply(
                true_rays.origins + at_mm * true_rays.directions
            )
            offsets += 100.0 * pose[3:] - rays.origins
            return np.nan_to_num(
                np.degrees(offsets / np.linalg.norm(offsets, axis=1)[:, None] - rays.directions)
            )

        pose = least_squares(
            lambda pose, angular_errors=angular_errors: angular_errors(pose, 2500.0).ravel(),
            np.zeros(6),
        ).x
        error = np.full(len(pixels), np.nan)
        error[is_inside] = np.linalg.norm(angular_errors(pose, distance_mm), axis=1)
        image = ax.imshow(
            error.reshape(u.shape), extent=(-5, 795, 795, -5), vmin=0, vmax=0.3, cmap="viridis"
        )
        ax.set_title(f"{title}: {np.sqrt(np.nanmean(error**2)):.3f} deg rms", fontsize=10)
        ax.set_axis_off()
    figure.colorbar(image, ax=axes, label="direction error, deg", extend="max")
    figure.savefig(folder / "truth.png", dpi=110)


if __name__ == "__main__":
    if sys.argv[1:]:
        make(Path(sys.argv[1]))
    else:
        with TemporaryDirectory() as temporary:
            make(Path(temporary))
