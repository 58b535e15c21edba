"""Rendered photographs of boards: a grid of rays per pixel integrates over the pixel area."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

import omnimirror as om

SUBPIXELS = 4


class Photograph(NamedTuple):
    image: np.ndarray
    corners_px: np.ndarray
    """True corner positions (n, 2), by projection."""


def pose(
    board: om.Board, azimuth_deg: float, elevation_deg: float, distance_mm: float, *turns_deg: float
):
    """Return rotation and position of a board facing the sensor from a direction, with rotations
    about its own axes."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    direction = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    right = -np.cross([0, 0, 1], direction) / np.cos(elevation)
    facing = np.stack([right, np.cross(direction, right), direction], axis=1)
    rotation = facing @ Rotation.from_euler("xyz", turns_deg or (0, 0, 0), degrees=True).as_matrix()
    return rotation, distance_mm * direction - rotation @ board.points_mm.mean(axis=0)


def photographed(
    sensor, board, board_pose, *, blur_px=0.7, noise=3.0, quality=90, seed=0, sheet=None
):
    """Render a board with blur, noise and compression; return it with its true corners."""
    light, truth = rendered(sensor, board, board_pose, sheet=sheet)
    blurred = cv2.GaussianBlur(light, (0, 0), blur_px)
    return Photograph(
        digital(blurred, np.random.default_rng(seed), noise=noise, quality=quality), truth
    )


def digital(light, random, *, noise=3.0, quality=None):
    """Convert to grey values with noise, clipping, and compression at a JPEG quality."""
    values = light + random.normal(0, noise, light.shape)
    values = np.clip(np.rint(values), 0, 255).astype(np.uint8)
    if quality is not None:
        values = cv2.imdecode(
            cv2.imencode(".jpg", values, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0
        )
    return values


def rendered(sensor, board, board_pose, *, sheet=None):
    """Render a sharp, noise-free board; return it with its true corners.

    ``sheet`` is the print of a board other than a chessboard: brightness of points (n, 2) mm, NaN
    outside.
    """
    rotation, translation = board_pose
    width, height = sensor.image_size
    truth = sensor.project(board.points_mm @ rotation.T + translation).pixels
    visible = truth[np.isfinite(truth[:, 0])]
    low = np.maximum(np.floor(visible.min(axis=0)) - 50, 0).astype(int)
    high = np.minimum(np.ceil(visible.max(axis=0)) + 50, [width - 1, height - 1]).astype(int)
    steps = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    columns, rows = (np.arange(low[i], high[i] + 1) for i in (0, 1))
    grid = np.meshgrid((columns[:, None] + steps).ravel(), (rows[:, None] + steps).ravel())
    rays = sensor.backproject(np.stack(grid, axis=-1).reshape(-1, 2))
    origins, directions = (rays.origins - translation) @ rotation, rays.directions @ rotation
    with np.errstate(invalid="ignore", divide="ignore"):
        length = -origins[:, 2] / directions[:, 2]
        points = origins[:, :2] + length[:, None] * directions[:, :2]
        light = (sheet or chessboard(board))(points)
        light = np.where((length > 0) & np.isfinite(light), light, 100.0)
    image = np.full((height, width), 100.0)
    shape = (len(rows), SUBPIXELS, len(columns), SUBPIXELS)
    image[low[1] : high[1] + 1, low[0] : high[0] + 1] = light.reshape(shape).mean(axis=(1, 3))
    return Photograph(image, truth)


def chessboard(board):
    """Return the brightness of points of a chessboard with a white margin."""

    def brightness(points):
        x, y = points.T / board.square_mm
        columns, rows = board.lattice_size
        on = (x > -1) & (x < columns) & (y > -1) & (y < rows)
        paper = (x > -2) & (x < columns + 1) & (y > -2) & (y < rows + 1)
        is_black = on & ((np.floor(x) + np.floor(y)) % 2 == 0)
        return np.where(paper, np.where(is_black, 30.0, 210.0), np.nan)

    return brightness
