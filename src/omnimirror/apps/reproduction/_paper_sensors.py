"""Sensors of the paper, and the quantities of its statements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from ...analysis.evaluation import Evaluation, evaluate
from ...analysis.figures.curves import sphere_for
from ...analysis.figures.subjects import EXACT, PAPER, Conditions
from ...analysis.focus import (
    BestFocus,
    SingleViewpoint,
    best_focus,
    best_viewpoint,
    viewpoint_angle_error,
    viewpoint_z,
)
from ...base.caching import cached_property
from ...base.typing import Array
from ...optics.lenses import Orthographic, Perspective
from ...optics.mirrors import EvenPolynomial, Hyperboloid, Mirror, Sphere
from ...optics.sensor import Sensor
from ...optics.sensor_files import load_sensor
from ...optics.tracing.meridian import ChiefRays, trace_chief_rays

NAMES = {"SPH": "paper-spherical", "E-DI": "paper-equidistant", "SVP": "paper-hyperboloidal"}
"""Mirror names of the paper with the corresponding bundled sensors."""

M = 43.9  # mm: radius of the mirrors (Sec. 3.3)
OMEGA_MAX, THETA_MAX = np.radians(135.0), np.radians(12.0)
PITCH = 5.2e-3  # mm: pixel, and permissible blur
RADIUS_PX = 500.0  # N

TABLE_1: dict[str, tuple[Mirror, float]] = {
    "SPH": (Sphere(1.138, 1.0), 4.110),
    "E-DI": (EvenPolynomial((0.6409, 0.1550, -0.01), 1.0), 3.919),
    "SVP": (Hyperboloid(0.7407, 1.698, 1.0), 3.550),
}
"""Mirrors and lens distances m as printed, in units of the rim radius."""


def paper_sensors() -> list[Sensor]:
    """Return SPH, E-DI and SVP under these names."""
    return [replace(load_sensor(file), name=name) for name, file in NAMES.items()]


@dataclass(frozen=True)
class Paper:
    """Quantities of the three sensors; each is computed once."""

    @cached_property
    def sensors(self) -> dict[str, Sensor]:
        return {s.name: s for s in paper_sensors()}

    @cached_property
    def _evaluations(self) -> dict[tuple[str, Conditions, float], Evaluation]:
        return {}

    def field(
        self, name: str, conditions: Conditions = PAPER, object_distance_mm: float = np.inf
    ) -> Evaluation:
        """Evaluate the whole field of a sensor, every 0.5 deg from 0 to 135 deg."""
        key = (name, conditions, object_distance_mm)
        if key not in self._evaluations:
            self._evaluations[key] = self.at(
                name, np.arange(0, 135.25, 0.5), conditions, object_distance_mm
            )
        return self._evaluations[key]

    def at(
        self,
        name: str,
        omega_deg: ArrayLike,
        conditions: Conditions = PAPER,
        object_distance_mm: float = np.inf,
    ) -> Evaluation:
        """Evaluate a sensor at field angles (n,), deg."""
        return evaluate(
            self.sensors[name],
            omega_deg,
            object_distance_mm=object_distance_mm,
            mode=conditions.mode,
            image_radius_px=conditions.image_radius_px,
        )

    def rim(self, name: str) -> ChiefRays:
        """Return the chief ray of the rim, x = 1, with the numbers of Table 1."""
        mirror, m = TABLE_1[name]
        return trace_chief_rays(mirror, m, [1.0])

    def spread(self, name: str) -> float:
        """Return the distance between the lowest and the highest viewpoint, in M."""
        return float(np.ptp(self.field(name).viewpoint_z_mm)) / M

    def worst_blur_px(
        self,
        name: str,
        section: str,
        conditions: Conditions = PAPER,
        object_distance_mm: float = np.inf,
    ) -> float:
        """Return the largest tangential (``"t"``) or sagittal (``"s"``) blur of the field."""
        blur: Array = getattr(
            self.field(name, conditions, object_distance_mm), f"blur_{section}_px"
        )
        return float(np.abs(blur).max())

    def depth_of_field(self, name: str, conditions: Conditions = PAPER) -> float:
        """Return the depth of field about L0 in mm."""
        return self.field(name, conditions).depth_of_field_mm.depth

    def best_focus(self, name: str) -> BestFocus:
        """Return the L0 that minimises the largest blur area (the product used in the paper)."""
        omega = np.linspace(0.0, 135.0, 1001)
        return best_focus(
            self.sensors[name],
            "worst_blur_area_deg2",
            omega_deg=omega,
            mode="paper",
            image_radius_px=RADIUS_PX,
        )

    def one_viewpoint(self, distance_in_m: float, name: str = "SPH") -> SingleViewpoint:
        """Return the best single viewpoint for objects at a distance in units of M."""
        omega = np.linspace(0, 135, 1001)
        return best_viewpoint(
            self.sensors[name], distance_in_m * M, omega_deg=omega, image_radius_px=RADIUS_PX
        )

    def viewpoint_error_deg(self, distance_in_m: float, name: str) -> float:
        """Return the largest |eps| of Eq. 23 over 0 to 135 deg for the viewpoint that minimises it."""
        meridian = self.sensors[name].meridian
        rays = meridian.trace(meridian.x_from_omega(np.radians(np.linspace(0.0, 135.0, 1001))))

        def largest(z: float) -> float:
            return float(np.abs(viewpoint_angle_error(rays, z, distance_in_m * M)).max())

        # |eps| grows with the distance from z_v, so the maximum over the field is quasi-convex in z
        z = viewpoint_z(rays)
        optimum = minimize_scalar(
            largest, bounds=(z.min(), z.max()), method="bounded", options={"xatol": 1e-8}
        )
        return float(np.degrees(optimum.fun))

    @cached_property
    def aperture_diameter_mm(self) -> float:
        """Aperture diameter D of SPH from the image-side cone: 2 b0 tan of the half angle of F b0/f."""
        lens = self.lens
        return lens.image_distance / lens.image_f_number()

    def worst_at_best(self, name: str) -> float:
        """Return the smallest possible largest single blur in pixels over all focus settings."""
        omega = np.linspace(0, 135.0, 1001)
        return best_focus(
            self.sensors[name],
            "worst_blur_px",
            omega_deg=omega,
            mode="paper",
            image_radius_px=RADIUS_PX,
        ).value

    @cached_property
    def lens(self) -> Perspective:
        """Lens with f = 11.6 mm and F = 4, focused at 212 mm."""
        lens = self.sensors["SPH"].lens
        assert isinstance(lens, Perspective)
        return lens

    @cached_property
    def telecentric_sphere(self) -> Evaluation:
        """Evaluation of a sphere with a field of 135 deg under an orthographic lens."""
        sensor = sphere_for(self.sensors["SPH"], 135.0, 0.0, RADIUS_PX)
        return evaluate(sensor, np.arange(0, 135.0, 0.5), image_radius_px=RADIUS_PX)

    @cached_property
    def telecentric_paraboloid(self) -> Evaluation:
        """Evaluation of the bundled paraboloid under an orthographic lens."""
        sensor = load_sensor("paraboloid-telecentric")
        assert isinstance(sensor.lens, Orthographic)
        return evaluate(sensor, np.arange(0, 105.0, 0.5))

    @property
    def coverage(self) -> float:
        """Fraction of the viewing sphere between 0 and 135 deg."""
        return float(1 - np.cos(OMEGA_MAX)) / 2

    @property
    def square_degrees(self) -> float:
        """Solid angle of the whole sphere."""
        return float(4 * np.pi * np.degrees(1.0) ** 2)

    @property
    def mean_pixel_deg2(self) -> float:
        """Mean solid angle of a pixel in the image circle."""
        return self.square_degrees * self.coverage / (np.pi * RADIUS_PX**2)


def change(values: Array) -> tuple[float, float]:
    """Return the smallest and the largest difference between consecutive values."""
    steps = np.diff(values)
    return float(steps.min()), float(steps.max())


def half_range(values: Array) -> float:
    """Return 1 plus half of the range relative to the mid-range: 1 for constant values.

    >>> half_range(np.array([0.9, 1.0, 1.1]))
    1.1
    """
    low, high = float(values.min()), float(values.max())
    return 2 * high / (high + low)


def worst_ratio(a: Array, b: Array) -> float:
    """Return the ratio of two arrays that deviates most from 1; pairs of negligible values are
    excluded.

    >>> worst_ratio(np.array([1.0, 2.0]), np.array([1.0, 4.0]))
    0.5
    """
    ratio = a[np.abs(b) > 1e-9] / b[np.abs(b) > 1e-9]
    return float(ratio[np.abs(ratio - 1).argmax()])


__all__ = [
    "EXACT",
    "PAPER",
    "TABLE_1",
    "M",
    "Paper",
    "change",
    "half_range",
    "paper_sensors",
    "worst_ratio",
]
