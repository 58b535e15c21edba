"""Recommendations for further calibration images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from .bundle.observations import Sighting

RINGS, SECTORS = 4, 8
ENOUGH = 5  # minimum number of corners in a cell
LEAST_TILT_DEG = 25.0  # minimum angle between board normals
ENOUGH_PICTURES = 10
SIDES = ("right", "lower right", "bottom", "lower left", "left", "upper left", "top", "upper right")


class Coverage(NamedTuple):
    """Distribution of corners over the image."""

    centre_px: tuple[float, float]
    radii_px: Array
    """Radii of the ring boundaries (rings + 1,), px."""
    counts: NDArray[np.int64]
    """Number of corners (rings, sectors); sectors run from the right over the bottom."""
    tilts_deg: Array
    """Angles (m,) between each board's normal and the line of sight to its centre."""
    facing_deg: float
    """Largest angle between the normals of two boards; NaN if no pose is known."""


def coverage(
    sightings: Sequence[Sighting], centre_px: tuple[float, float], outer_radius_px: float | None = None
) -> Coverage:
    """Return the distribution of corners, up to the rim or to the farthest corner if it is unknown.

    Boards without a pose contribute their corners only.
    """
    offsets = np.concatenate([s.pixels for s in sightings]) - centre_px
    radius, azimuth = np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])
    outer = float(radius.max()) if outer_radius_px is None else outer_radius_px
    radii = outer * np.sqrt(np.linspace(0, 1, RINGS + 1))  # rings of equal areas
    ring = np.clip(np.searchsorted(radii, radius, side="right") - 1, 0, RINGS - 1)
    sector = np.round(azimuth / (2 * np.pi / SECTORS)).astype(int) % SECTORS
    counts = np.zeros((RINGS, SECTORS), dtype=np.int64)
    np.add.at(counts, (ring, sector), 1)
    placed = [(s.motion, s.points) for s in sightings if s.motion is not None and not s.is_surveyed]
    normals = np.array([motion.rotation[:, 2] for motion, _ in placed]).reshape(-1, 3)
    middles = np.array([motion(points).mean(axis=0) for motion, points in placed]).reshape(-1, 3)
    toward = np.sum(normals * middles, axis=1) / np.linalg.norm(middles, axis=1)
    cosines = np.clip(np.abs(normals @ normals.T), 0, 1)
    facing = float(np.degrees(np.arccos(cosines.min()))) if placed else float("nan")
    return Coverage(centre_px, radii, counts, np.degrees(np.arccos(np.clip(np.abs(toward), 0, 1))), facing)


def advised(found: Coverage, pictures: int) -> tuple[str, ...]:
    """Return recommendations for further images, most important first; empty if coverage suffices."""
    sentences = []
    if pictures < ENOUGH_PICTURES:
        sentences.append(
            f"Take more pictures: {pictures} {'is' if pictures == 1 else 'are'} used, and {ENOUGH_PICTURES} to 20 with "
            "the board at different places are usual."
        )
    outer = np.flatnonzero(found.counts[-1] < ENOUGH)
    if len(outer):
        low, high = found.radii_px[-2:]
        sentences.append(
            f"Hold the board so that it reaches the edge of the picture at the {_listed(outer)}: few corners lie "
            f"{low:.0f} to {high:.0f} px from the centre there."
        )
    inner = np.flatnonzero(found.counts[:-1].sum(axis=0) < ENOUGH)
    if len(inner):
        sentences.append(f"Hold the board towards the {_listed(inner)} of the picture: hardly any corner lies there.")
    if found.counts[0].sum() < ENOUGH:
        sentences.append(
            f"Hold the board nearer to the axis: few corners lie within {found.radii_px[1]:.0f} px of the centre."
        )
    if pictures > 1 and found.facing_deg < LEAST_TILT_DEG:
        sentences.append(
            f"Tilt the board more: its directions in the pictures differ by {found.facing_deg:.0f} deg only."
        )
    return tuple(sentences)


def _listed(sectors: NDArray[np.int64]) -> str:
    names = [SIDES[i] for i in sectors]
    if len(names) == SECTORS:
        return "whole rim"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
