"""Evaluation of a misaligned sensor over the whole image: all azimuths, from the axis to the rim.

One meridian is representative for an aligned sensor only. An as-built sensor depends on the azimuth
and is traced in three dimensions: chief rays in directions at all azimuths, and around each of them
rays near the centre of the aperture, whose image spread is proportional to the blur, to first order
as in Eqs. 28, 36 and 37.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.caching import cached_property
from ..base.typing import Array, Mask
from ..cameras.camera import camera_direction
from ..optics.housing import NO_HOUSING
from ..optics.lenses import Lens
from ..optics.sensor import Sensor
from ..optics.tracing.reflection import RayEndpoints, ReflectionPoints
from .focus import FocusedBlur, FocusStudy, ImagingCharacteristics, virtual_images
from .ray_bundles import Bundles, Pupil, trace_bundles

RINGS, AZIMUTHS = 31, 24
FINE_RINGS, FINE_AZIMUTHS = 181, 96  # for obscurations
SCANNED_ANGLES = np.radians(np.arange(0.25, 180.0, 0.5))
BISECTIONS = 30  # bisections for an end of the field
RIM_MARGIN = 1e-7  # relative distance of the last ring from the rim
NEAR_AXIS_RAD = 1e-3  # radians; a ring at this angle still has distinct azimuths
DIFFERENCE_STEP = 1e-4  # radians, of central differences
NEAR_CENTRE = 0.01  # relative to the aperture radius; small enough for first-order blur
FOCUS_SAMPLES = 41
FOCUS_EXTENSION = 0.1  # extension, relative to the range of the focus coordinates of the images
FOCUS_TOLERANCE = 1e-5  # relative to that range
VIEWPOINT_ITERATIONS = 3  # iterations of the best viewpoint
CROSS_PUPIL = Pupil(
    NEAR_CENTRE * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]), np.full(4, 0.25)
)
WAVELENGTH_NM = 550.0


class FieldGrid(NamedTuple):
    """Directions on rings between the ends of the field of each azimuth; radians."""

    omega: Array
    """Field angles (rings, azimuths)."""
    phi: Array
    """Azimuths (rings, azimuths)."""


@dataclass(frozen=True)
class FullFieldEvaluation:
    """Evaluation of a sensor with one mirror and an ideal lens at RINGS x AZIMUTHS directions.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.mirrors.mirror import MirrorPose
    >>> built = replace(om.load_sensor("paper-spherical"), mirror_pose=MirrorPose(decentre_x_mm=0.5))
    >>> low, high = FullFieldEvaluation(built).field_deg  # at some azimuth
    >>> low, round(high, 1)
    (0.0, 135.1)
    """

    sensor: Sensor

    # -- directions --------------------------------------------------------------------------------

    @cached_property
    def grid(self) -> FieldGrid:
        return self._field_grid(RINGS, AZIMUTHS)

    def _field_grid(self, rings: int, azimuths: int) -> FieldGrid:
        """Return rings between the inner and outer end of the field, at each azimuth."""
        phi = np.linspace(0.0, 2 * np.pi, azimuths, endpoint=False)
        scanned = np.broadcast_to(SCANNED_ANGLES[:, None], (len(SCANNED_ANGLES), azimuths))
        visible = self._sees(scanned, np.broadcast_to(phi, scanned.shape))
        first, last = visible.argmax(axis=0), len(SCANNED_ANGLES) - 1 - visible[::-1].argmax(axis=0)
        step = SCANNED_ANGLES[1] - SCANNED_ANGLES[0]
        start = np.where(
            first == 0,
            NEAR_AXIS_RAD,
            self._edge(SCANNED_ANGLES[first], SCANNED_ANGLES[first] - step, phi),
        )
        end = self._edge(SCANNED_ANGLES[last], SCANNED_ANGLES[last] + step, phi)
        fractions = np.linspace(RIM_MARGIN, 1 - RIM_MARGIN, rings)[:, None]
        omega = start + fractions * (end - start)
        return FieldGrid(omega, np.broadcast_to(phi, omega.shape))

    def _edge(self, visible: Array, invisible: Array, phi: Array) -> Array:
        """Return the last visible angles (azimuths,), found by bisection."""
        for _ in range(BISECTIONS):
            midpoint = (visible + invisible) / 2
            is_visible = self._sees(midpoint, phi)
            visible, invisible = (
                np.where(is_visible, midpoint, visible),
                np.where(is_visible, invisible, midpoint),
            )
        return visible

    def _sees(self, omega: Array, phi: Array) -> Mask:
        towards = camera_direction(omega, phi).reshape(-1, 3)
        return np.asarray(
            self.sensor.optical_train.chief_rays_to(RayEndpoints(towards, True)).valid.reshape(
                omega.shape
            )
        )

    @cached_property
    def _axes(self) -> tuple[Array, Array, Array]:
        """Directions (n, 3) of the grid, and radial and azimuthal unit vectors."""
        omega, phi = (a.ravel() for a in self.grid)
        towards, outwards = camera_direction(omega, phi), camera_direction(omega + np.pi / 2, phi)
        return towards, outwards, np.stack([-np.sin(phi), np.cos(phi), 0 * phi], axis=-1)

    # -- traced rays -------------------------------------------------------------------------------

    @cached_property
    def bundles(self) -> Bundles:
        """Rays of each direction through four points near the centre of the aperture."""
        omega, phi = (np.degrees(a.ravel()) for a in self.grid)
        return trace_bundles(self.sensor, omega, CROSS_PUPIL, phi)

    @cached_property
    def _neighbours(self) -> tuple[tuple[ReflectionPoints, ReflectionPoints], ...]:
        """Chief rays offset by one step in both radial and both azimuthal directions."""
        towards, *steps = self._axes
        return tuple(
            (
                self._chief(towards + DIFFERENCE_STEP * step),
                self._chief(towards - DIFFERENCE_STEP * step),
            )
            for step in steps
        )

    def _chief(self, towards: Array) -> ReflectionPoints:
        return self.sensor.optical_train.chief_rays_to(RayEndpoints.of(towards, True))

    def _pixels(self, lens: Lens, reflections: ReflectionPoints) -> Array:
        """Return image positions (n, 2) px of chief rays relative to the lens axis."""
        image = lens.image_of(
            reflections.facing_points - self.sensor.lens_offset, reflections.to_pupils
        )
        return np.asarray(image / self.sensor.imager.pitch_mm)

    def _rates(self, lens: Lens) -> tuple[Array, Array]:
        """Return radial and azimuthal derivatives (n, 2), (n, 2) of pixels, px per degree."""
        angle = np.degrees(2 * np.arctan(DIFFERENCE_STEP))
        outwards, around = (
            (self._pixels(lens, a) - self._pixels(lens, b)) / angle for a, b in self._neighbours
        )
        return outwards, around

    # -- derived quantities ------------------------------------------------------------------------

    def at(self, focus_mm: float) -> FocusedBlur:
        """Return resolution and blur (n,) with the lens focused at an object distance."""
        sensor = self.bundles.focused_at(focus_mm)
        outwards, around = self._rates(sensor.lens)
        height, width = np.linalg.norm(outwards, axis=1), np.linalg.norm(around, axis=1)
        area = np.abs(outwards[:, 0] * around[:, 1] - outwards[:, 1] * around[:, 0])
        pitch = sensor.imager.pitch_mm
        images = self.bundles.image_mm(sensor) / pitch
        aberration = np.stack(
            [images[:, 0] - images[:, 1], images[:, 2] - images[:, 3]], axis=2
        ) / (2 * NEAR_CENTRE)
        along = outwards / height[:, None]
        across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        # the image shift per unit of the aperture coordinates is a linear map; the spot of the unit disc
        # has the full width 2 |J^T e| in the direction e
        t, s = (
            2 * np.linalg.norm(np.einsum("nij,ni->nj", aberration, axis), axis=1)
            for axis in (along, across)
        )
        imaging = ImagingCharacteristics(height, width, area, width / height)
        airy = sensor.lens.airy_diameter(WAVELENGTH_NM) / pitch
        return FocusedBlur(t, s, imaging, self.grid.omega.ravel(), airy)

    @cached_property
    def at_sensor_focus(self) -> FocusedBlur:
        """Resolution and blur at the focus of the sensor."""
        return self.at(self.sensor.lens.focus_distance_mm)

    def best_focus(self) -> tuple[float, float]:
        """Return the focus (mm) with the minimum of the worst floored blur area, and that area."""
        from scipy.optimize import minimize_scalar

        lens, aligned = self.sensor.lens, self.sensor.aligned()
        low, high = np.radians(aligned.field_deg)
        rays = aligned.meridian.trace(aligned.meridian.x_from_omega(np.linspace(low, high, RINGS)))
        images = virtual_images(rays, np.array(np.inf))
        coordinates = np.stack(
            FocusStudy(aligned, rays, images, "exact", None, WAVELENGTH_NM).coordinates(lens)
        )
        near, far = float(np.nanmin(coordinates)), float(np.nanmax(coordinates))
        margin = FOCUS_EXTENSION * (far - near)

        def max_area(coordinate: float) -> float:
            area = self.at(float(lens.distance_of(coordinate))).floored_area()
            return float(area[np.isfinite(area)].max())

        samples = np.linspace(near - margin, far + margin, FOCUS_SAMPLES)
        minimum = int(np.argmin([max_area(c) for c in samples]))
        bounds = samples[max(minimum - 1, 0)], samples[min(minimum + 1, FOCUS_SAMPLES - 1)]
        optimum = minimize_scalar(
            max_area,
            bounds=bounds,
            method="bounded",
            options={"xatol": FOCUS_TOLERANCE * (far - near)},
        )
        return float(lens.distance_of(optimum.x)), float(optimum.fun)

    @cached_property
    def hidden(self) -> tuple[float, float]:
        """End of the central obscuration, deg, and the obscured image area, %."""
        obstructions = self.sensor.obstructions
        if obstructions.housing == NO_HOUSING:
            return self.field_deg[0], 0.0
        omega, phi = self._field_grid(FINE_RINGS, FINE_AZIMUTHS)
        chief = self._chief(camera_direction(omega, phi).reshape(-1, 3))
        parts = obstructions.blocks(
            chief.points, chief.to_targets, chief.to_pupils, self.sensor.mirror_pose
        )
        hidden = np.logical_or.reduce(list(parts.values())).reshape(omega.shape)
        run = np.logical_and.accumulate(hidden, axis=0)
        pixels = self._pixels(self.sensor.lens, chief).reshape(*omega.shape, 2)
        by_ring, by_turn = (
            np.gradient(pixels, axis=0),
            np.roll(pixels, -1, axis=1) - np.roll(pixels, 1, axis=1),
        )
        area = np.abs(by_ring[..., 0] * by_turn[..., 1] - by_ring[..., 1] * by_turn[..., 0])
        area[[0, -1]] /= 2
        to = float(np.degrees(omega[run].max())) if run.any() else self.field_deg[0]
        return to, float(100 * (area * hidden).sum() / area.sum())

    @property
    def field_deg(self) -> tuple[float, float]:
        """Smallest and largest field angle at any azimuth; 0 if the axis is visible."""
        omega = np.degrees(self.grid.omega)
        low = float(omega[0].min())
        return 0.0 if low < np.degrees(2 * NEAR_AXIS_RAD) else low, float(omega[-1].max())

    def sphere_coverage_percent(self) -> float:
        """Return the visible percentage of all directions."""
        first, last = np.cos(self.grid.omega[0]), np.cos(self.grid.omega[-1])
        # solid angle 2 pi (cos(first) - cos(last)), averaged over the azimuths, relative to 4 pi
        return float(50 * np.mean(first - last))

    def _rings(self) -> Array:
        """Return pixels (rings, azimuths, 2) relative to the lens axis."""
        pixels = self._pixels(self.sensor.lens, self.bundles.chief)
        return pixels.reshape(*self.grid.omega.shape, 2)

    def rim_radius_px(self) -> float:
        """Return the mean distance of the rim image from its centre."""
        rim = self._rings()[-1]
        return float(np.linalg.norm(rim - rim.mean(axis=0), axis=1).mean())

    def nonlinearity(self) -> float:
        """Return the largest deviation from a linear mapping, % of the rim height."""
        rings, omega = self._rings(), self.grid.omega
        h = np.linalg.norm(rings - rings[0].mean(axis=0), axis=2)
        return float(100 * np.abs(h / h[-1] - omega / omega[-1]).max())

    def viewpoint_spread(self) -> float:
        """Return the largest distance (mm) between the viewpoints of two rings."""
        chief, shape = self.bundles.chief, (*self.grid.omega.shape, 3)
        points, directions = chief.points.reshape(shape), self._axes[0].reshape(shape)
        # least squares: the point nearest to lines (p, d) satisfies sum(I - d d^T) v = sum(I - d d^T) p
        across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
        sums, right = across.sum(axis=1), np.einsum("raij,raj->ri", across, points)
        viewpoints = np.array(
            [np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(sums, right, strict=True)]
        )
        return float(np.linalg.norm(viewpoints[:, None] - viewpoints[None], axis=2).max())

    def one_viewpoint_error(self, distance_mm: float) -> float:
        """Return the largest error (px) of the best single viewpoint for finite objects."""
        from scipy.optimize import minimize

        towards, outwards, around = self._axes
        chief, lens = self.bundles.chief, self.sensor.lens
        objects, here = chief.points + distance_mm * towards, self._pixels(lens, chief)
        by_out, by_around = (np.degrees(rate) for rate in self._rates(lens))

        def directions_from(viewpoint: Array) -> Array:
            directions = objects - viewpoint
            return np.asarray(directions / np.linalg.norm(directions, axis=1)[:, None])

        def linear_shift(directions: Array) -> Array:
            offset = directions - towards
            moved = (offset * outwards).sum(1)[:, None] * by_out + (offset * around).sum(1)[
                :, None
            ] * by_around
            return np.asarray(moved)

        viewpoint_mm, nonlinear = np.median(chief.points, axis=0), np.zeros_like(here)
        for _ in range(VIEWPOINT_ITERATIONS):
            max_error = lambda v, nonlinear=nonlinear: float(  # noqa: E731
                np.linalg.norm(linear_shift(directions_from(v)) + nonlinear, axis=1).max()
            )
            viewpoint_mm = minimize(
                max_error,
                viewpoint_mm,
                method="Nelder-Mead",
                options={"xatol": 1e-5, "fatol": 1e-9, "maxiter": 2000},
            ).x
            directions = directions_from(viewpoint_mm)
            true = self._pixels(lens, self._chief(directions)) - here
            nonlinear = true - linear_shift(directions)
        return float(np.linalg.norm(true, axis=1).max())
