"""Dewarped images against the true view: the densely sampled scene."""

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.dewarp.contracts import INTERPOLATIONS
from omnimirror.simulation.rendering.picture import pinhole_picture

S = om.screens
SAMPLES = 4
CAMERA = om.MirrorBall((149.5, 149.5), 142.0, 270.0, (300, 300))
VIEWS = {
    "magnified": S.Plane((160, 120), 20.0, -15.0, 0.0, 45.0),
    "about 1 to 1": S.Cylinder((360, 135), -90.0, 45.0),
    "both, in one view": S.Plane((150, 96), 20.0, -40.0, 0.0, 140.0),
    "2 to 1": S.Dome((140, 140), 135.0, "nadir"),
    "4 to 1": S.Cylinder((100, 36), -90.0, 45.0),
    "7 to 1": S.Dome((42, 42), 135.0, "nadir"),
}


@pytest.fixture(scope="module")
def room():
    return om.Room()


@pytest.fixture(scope="module")
def picture(room):
    return om.take_picture(CAMERA, room, samples=SAMPLES**2, distant=True)


def decibels(room, picture):
    """Return the PSNR of all interpolations in all views, by omnimirror and OpenCV; {view:
    {interpolation: dB}}."""
    table = {}
    for name, screen in VIEWS.items():
        width, height = screen.size
        u, v = ((np.arange(n * SAMPLES) + 0.5) / SAMPLES - 0.5 for n in (width, height))
        truth = pinhole_picture(room, screen.targets_at(*np.meshgrid(u, v)), SAMPLES)
        pixels = om.Dewarper(CAMERA, screen).coordinates()
        inside = np.isfinite(pixels[..., 0])
        maps = np.moveaxis(np.nan_to_num(pixels, nan=-10.0).astype(np.float32), -1, 0)
        pictures = {kind: om.Dewarper(CAMERA, screen, kind)(picture) for kind in INTERPOLATIONS}
        pictures["cv2 lanczos"] = cv2.remap(picture, *maps, cv2.INTER_LANCZOS4)
        table[name] = {
            kind: 10 * np.log10(255**2 / np.mean((taken[inside].astype(float) - truth[inside]) ** 2))
            for kind, taken in pictures.items()
        }
    return table


def test_auto_is_the_best_in_every_view(room, picture):
    table = decibels(room, picture)
    for name, row in table.items():
        assert row["auto"] > max(row.values()) - 0.3, (name, row)
    assert table["magnified"]["cubic"] > table["magnified"]["linear"] + 0.7
    for name in ("2 to 1", "4 to 1", "7 to 1"):
        assert table[name]["auto"] > table[name]["cubic"] + 2, table[name]
    mixed = table["both, in one view"]
    assert mixed["auto"] > max(mixed["linear"], mixed["cubic"], mixed["area"]), mixed
