"""Simulated measurements of mirrors with known form errors in machine coordinates."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from omnimirror.optics.mirrors import Mirror

TERMS = {
    4: lambda x, y: np.sqrt(3) * (2 * (x * x + y * y) - 1),
    5: lambda x, y: np.sqrt(6) * 2 * x * y,
    6: lambda x, y: np.sqrt(6) * (x * x - y * y),
    9: lambda x, y: np.sqrt(8) * (3 * x * x * y - y**3),
    11: lambda x, y: np.sqrt(5) * (6 * (x * x + y * y) ** 2 - 6 * (x * x + y * y) + 1),
    14: lambda x, y: np.sqrt(10) * (x**4 - 6 * x * x * y * y + y**4),
    22: lambda x, y: np.sqrt(7) * (20 * (r := x * x + y * y) ** 3 - 30 * r**2 + 12 * r - 1),
}
"""Textbook formulas of Noll's terms on the unit disc."""


def places(rim_mm: float, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return points distributed uniformly over the disc."""
    r, phi = rim_mm * np.sqrt(rng.uniform(0, 1, count)), rng.uniform(0, 2 * np.pi, count)
    return r * np.cos(phi), r * np.sin(phi)


def height_mm(form_um: dict[int, float], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return heights of a form error at normalised coordinates."""
    return 1e-3 * sum((um * TERMS[j](x, y) for j, um in form_um.items()), np.zeros(len(x)))


def on(
    mirror: Mirror, form_um: dict[int, float], noise_um: float, count: int = 6000, seed: int = 0
) -> np.ndarray:
    """Return noisy points (n, 3) in mm on a mirror with a form error, in the mirror frame."""
    rng, rim = np.random.default_rng(seed), mirror.rim_radius_mm
    x, y = places(rim, count, rng)
    r = np.hypot(x, y)
    slope = mirror.slope(r)
    normal = (
        np.stack([-slope * x / r, -slope * y / r, np.ones(count)], axis=-1)
        / np.sqrt(1 + slope**2)[:, None]
    )
    surface = np.stack([x, y, mirror.sag(r) + height_mm(form_um, x / rim, y / rim)], axis=-1)
    return surface + 1e-3 * noise_um * rng.normal(size=(count, 1)) * normal


def in_machine(points: np.ndarray, above: bool = False) -> np.ndarray:
    """Convert to machine coordinates: tilts of 0.8 deg and -0.5 deg, vertex at (3, -2, 100) mm."""
    machine_points = points @ Rotation.from_euler("xy", [0.8, -0.5], degrees=True).as_matrix().T + [
        3.0,
        -2.0,
        100.0,
    ]
    return machine_points * [1.0, -1.0, -1.0] if above else machine_points
