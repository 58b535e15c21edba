"""Sequential tracing of real rays through surfaces of revolution.

Coordinates are those of the lens: x and y across, s along the light from the first surface's
vertex.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....base.typing import Array, Mask

STEPS = 30
CLOSE = 1e-13  # mm


class Paraxial(NamedTuple):
    """Paraxial properties of a sequence; positions along s from the first vertex, mm."""

    focal_length: float
    front_principal: float
    entrance_pupil: float
    pupil_magnification: float
    """Diameter of the entrance pupil divided by that of the stop."""
    back: tuple[float, float, float, float]
    """The matrix (a, b, c, d) from height and slope at the first vertex to those at the last."""


class Landed(NamedTuple):
    """Intersections of rays (n,) with imager, stop and surfaces."""

    image: Array
    """(n, 2), mm, on the imager."""
    stop: Array
    """(n, 2), mm, on the stop."""
    clear: Mask
    """(n,) True if they pass all clear apertures."""
    on_glass: Mask
    """(n,) True if they are within the edges of all surfaces."""
    radii: Array
    """(surfaces, n), mm: distances from the axis on the surfaces."""
    cosines: Array
    """(n, 2) direction cosines across the axis, at the imager."""

    def upright(self) -> Landed:
        """Convert to an upright image."""
        return self._replace(image=-self.image, cosines=-self.cosines)


@dataclass(frozen=True)
class Sequence:
    """Sequence of n surfaces, including the stop, and the media between them.

    Attributes
    ----------
    curvature, conic : (n,)
    aspheres : (n, k)
        Coefficients of r^2, r^4, ...
    thickness : (n,) mm
        Distance to the next surface; that of the last surface is to the imager.
    index : (n + 1,)
        Refractive index before the first surface, and after each.
    edge, clear : (n,) mm
        Radius of the surface, and of its clear aperture; infinite if unknown.
    stop
        Index of the stop surface, from 0.
    """

    curvature: Array
    conic: Array
    aspheres: Array
    thickness: Array
    index: Array
    edge: Array
    clear: Array
    stop: int

    def paraxial(self) -> Paraxial:
        """Compute Gaussian optics with ray transfer matrices; infinities for zero power."""
        matrix, to_stop = np.eye(2), np.eye(2)
        power = self.curvature + 2 * (self.aspheres[:, 0] if self.aspheres.shape[1] else 0.0)
        for i, c in enumerate(power):
            if i == self.stop:
                to_stop = matrix.copy()
            before, after = self.index[i], self.index[i + 1]
            matrix = np.array([[1.0, 0.0], [-(after - before) * c / after, before / after]]) @ matrix
            if i < len(power) - 1:
                matrix = np.array([[1.0, self.thickness[i]], [0.0, 1.0]]) @ matrix
        (a, b), (c, d) = matrix
        with np.errstate(divide="ignore", invalid="ignore"):
            # pupil plane s = p: the stop height of rays (y, u) is independent of u
            p = to_stop[0, 1] / to_stop[0, 0]
            return Paraxial(-1 / c, (d - 1) / c, p, 1 / to_stop[0, 0], (a, b, c, d))

    def trace(self, places: Array, slopes: Array, to_imager: float) -> Landed:
        """Trace rays from points (n, 2) in the first vertex plane with slopes (n, 2).

        NaN if a ray misses a surface or is totally reflected.
        """
        p = np.concatenate([places, np.zeros((len(places), 1))], axis=1)
        d = np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)
        d /= np.sqrt(np.einsum("ni,ni->n", d, d))[:, None]
        clear, on_glass, stop = np.ones(len(p), bool), np.ones(len(p), bool), np.empty((len(p), 2))
        radii = np.empty((len(self.curvature), len(p)))
        with np.errstate(invalid="ignore", divide="ignore"):
            for i in range(len(self.curvature)):
                p, normal = self._meet(i, p, d)
                r2 = p[:, 0] ** 2 + p[:, 1] ** 2
                radii[i] = np.sqrt(r2)
                clear &= r2 <= self.clear[i] ** 2
                on_glass &= r2 <= self.edge[i] ** 2
                if i == self.stop:
                    stop = p[:, :2].copy()
                if self.index[i] != self.index[i + 1]:
                    d = refracted(d, normal, self.index[i] / self.index[i + 1])
                p = p.copy()
                p[:, 2] -= self.thickness[i] if i < len(self.curvature) - 1 else to_imager
            image = p[:, :2] - (p[:, 2] / d[:, 2])[:, None] * d[:, :2]
        return Landed(image, stop, clear, on_glass, radii, d[:, :2])

    def _meet(self, i: int, p: Array, d: Array) -> tuple[Array, Array]:
        """Return intersections (n, 3) and normals (n, 3), in the surface's frame."""
        c, k, a = self.curvature[i], self.conic[i], self.aspheres[i]
        p = p - (p[:, 2] / d[:, 2])[:, None] * d
        square = c * (p[:, 0] ** 2 + p[:, 1] ** 2)
        along = d[:, 2] - c * (p[:, 0] * d[:, 0] + p[:, 1] * d[:, 1])
        t = square / (along + np.sqrt(along**2 - c * (1 + k * d[:, 2] ** 2) * square))
        if not a.any():
            p = p + t[:, None] * d
            normal = np.stack([-c * p[:, 0], -c * p[:, 1], 1 - c * (1 + k) * p[:, 2]], axis=-1)
            return p, normal / np.sqrt(np.einsum("ni,ni->n", normal, normal))[:, None]
        for _ in range(STEPS):
            at = p + t[:, None] * d
            sag, slope = sag_and_slope(at[:, 0] ** 2 + at[:, 1] ** 2, c, k, a)
            normal = np.stack([-slope * at[:, 0], -slope * at[:, 1], np.ones_like(t)], axis=-1)
            step = (sag - at[:, 2]) / np.einsum("ni,ni->n", normal, d)
            t = t + step
            if not (np.abs(step) > CLOSE).any():
                break
        return p + t[:, None] * d, normal / np.sqrt(np.einsum("ni,ni->n", normal, normal))[:, None]


def sag_and_slope(r2: Array, c: float, k: float, a: Array) -> tuple[Array, Array]:
    """Return sag (n,) of an even asphere, and slope divided by radius, from the squared radius."""
    root = np.sqrt(1 - (1 + k) * c * c * r2)
    sag, slope = c * r2 / (1 + root), c / root
    power = np.ones_like(r2)
    for j, coefficient in enumerate(a, start=1):
        slope = slope + 2 * j * coefficient * power
        power = power * r2
        sag = sag + coefficient * power
    return sag, slope


def refracted(d: Array, normal: Array, ratio: float) -> Array:
    """Return unit directions (n, 3) after refraction; NaN for total reflection."""
    cos = np.einsum("ni,ni->n", d, normal)
    after = np.sqrt(1 - ratio**2 * (1 - cos**2))
    bent: Array = ratio * d + (after - ratio * cos)[:, None] * normal
    return bent
