"""Heights of perturbed mirrors over (x, y), with first and second derivatives: conic, polynomial, table and form.

``z = conic + sum p_i (s/N^2)^i + table(r) + sum f_ij (x/N)^i (y/N)^j`` with ``s = r^2 = x^2 + y^2`` and N the rim
radius. Each trial has conic, polynomial and form of its own; the table, of mirrors without a formula, is one for all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....mirrors import Mirror
from ....mirrors.form import LARGEST_ORDER, SurfaceHeights
from ....numerics.zernike import terms_of

Array = NDArray[np.float64]

NODES = 1024  # of the table; quintic pieces of .001 of a rim radius are exact to 1e-12 of it
LEAST_RADIUS = 1e-9  # of the rim radius: on the axis, derivatives are taken so far beside it
ORDERS = {terms_of(order): order for order in range(LARGEST_ORDER + 1)}
"""Order of a form by how many powers it has."""


@dataclass(frozen=True)
class MeridianTable:
    """A meridian in quintic pieces, as smooth as the mirror: sag, slope and curvature are right at every node.

    Parameters
    ----------
    pieces : (n, 6)
        Coefficients of powers of the share t in [0, 1] of a piece; the last one goes on beyond the rim.
    step_mm
        Length of a piece.
    """

    pieces: Array
    step_mm: float

    @classmethod
    def of(cls, mirror: Mirror) -> MeridianTable:
        """Of any mirror.

        >>> from omnimirror.mirrors import Cone
        >>> table = MeridianTable.of(Cone(30.0, 20.0))
        >>> bool(np.allclose(table.profile(np.array([5.0]))[1], Cone(30.0, 20.0).slope([5.0])))
        True
        """
        nodes = np.linspace(0.0, mirror.rim_radius_mm, NODES)
        h = float(nodes[1])
        z, slope, bend = mirror.profile(nodes)
        slope, bend = slope * h, bend * h * h
        a0, a1, a2 = z[:-1], slope[:-1], bend[:-1] / 2
        rise, turn, curl = z[1:] - a0 - a1 - a2, slope[1:] - a1 - 2 * a2, bend[1:] - 2 * a2
        a3 = 10 * rise - 4 * turn + curl / 2
        a4 = -15 * rise + 7 * turn - curl
        a5 = 6 * rise - 3 * turn + curl / 2
        return cls(np.ascontiguousarray(np.stack([a0, a1, a2, a3, a4, a5], axis=-1)), h)

    def profile(self, r: Array) -> tuple[Array, Array, Array]:
        """Sag, slope and curvature at radii."""
        piece = np.minimum((r / self.step_mm).astype(np.intp), len(self.pieces) - 1)
        t, a = r / self.step_mm - piece, self.pieces[piece]
        z, slope, bend = a[..., 5], np.zeros_like(t), np.zeros_like(t)
        for power in range(4, -1, -1):
            bend = bend * t + slope
            slope = slope * t + z
            z = z * t + a[..., power]
        return z, slope / self.step_mm, 2 * bend / self.step_mm**2


@dataclass(frozen=True)
class MirrorSurfaces:
    """Mirrors of trials (t,), each with errors of its own.

    Parameters
    ----------
    rim_radius_mm
        N.
    curvature, conic : (t,)
        At the vertex, 1/mm, and k; 0 where a table says the shape.
    polynomial : (t, terms)
        p_i of (s/N^2)^i, i = 1, 2, .., mm.
    form : (t, powers)
        f_ij, mm, in the order of ``numerics.zernike.power_place``; as many as whole orders have.
    table : MeridianTable, optional
        What is one for all.
    """

    rim_radius_mm: float
    curvature: Array
    conic: Array
    polynomial: Array
    form: Array
    table: MeridianTable | None = None

    def heights(self, x: Array, y: Array) -> SurfaceHeights:
        """Over points (t, n) mm; NaN where a conic has ended."""
        value, first, second = self._meridian(x * x + y * y)
        formed = self._form(x, y)
        return SurfaceHeights(
            value + formed.z,
            2 * x * first + formed.gx,
            2 * y * first + formed.gy,
            2 * first + 4 * x * x * second + formed.hxx,
            4 * x * y * second + formed.hxy,
            2 * first + 4 * y * y * second + formed.hyy,
        )

    def meridian(self, r: Array) -> Array:
        """Heights (t, n) mm at distances (t, n) or (1, n) from the axis, without form errors."""
        return self._meridian(np.broadcast_to(r * r, (len(self.curvature), r.shape[1])))[0]

    def _meridian(self, s: Array) -> tuple[Array, Array, Array]:
        """Value, first and second derivative by s = r^2."""
        c, k = self.curvature[:, None], self.conic[:, None]
        root = np.sqrt(1 - (1 + k) * c * c * s)
        value, first, second = c * s / (1 + root), c / (2 * root), (1 + k) * c**3 / (4 * root**3)
        for part in (self._polynomial(s), self._of_table(s)):
            value, first, second = value + part[0], first + part[1], second + part[2]
        return value, first, second

    def _polynomial(self, s: Array) -> tuple[Array, Array, Array]:
        """Value, first and second derivative by s."""
        unit = self.rim_radius_mm**2
        u = s / unit
        value, first, second = (np.zeros_like(u) for _ in range(3))
        for coefficient in (*self.polynomial.T[::-1], np.zeros(len(u))):
            second = second * u + first
            first = first * u + value
            value = value * u + coefficient[:, None]
        return value, first / unit, 2 * second / unit**2

    def _of_table(self, s: Array) -> tuple[Array, Array, Array] | tuple[float, float, float]:
        """The same of the table: f' = z'/2r, f'' = (z'' - z'/r)/4r^2."""
        if self.table is None:
            return 0.0, 0.0, 0.0
        r = np.maximum(np.sqrt(s), LEAST_RADIUS * self.rim_radius_mm)
        z, slope, bend = self.table.profile(r)
        return z, slope / (2 * r), (bend - slope / r) / (4 * r * r)

    def _form(self, x: Array, y: Array) -> SurfaceHeights:
        """By Horner's rule in y of polynomials in x."""
        order, unit = ORDERS[self.form.shape[1]], self.rim_radius_mm
        u, v = x / unit, y / unit
        zero = np.zeros_like(u)
        z, by_y, by_yy, by_x, by_xy, by_xx = (zero for _ in range(6))
        for j in range(order, -1, -1):
            q, dq, ddq = zero, zero, zero
            for i in range(order - j, -1, -1):
                coefficient = self.form[:, (i + j) * (i + j + 1) // 2 + j]
                ddq = ddq * u + dq
                dq = dq * u + q
                q = q * u + coefficient[:, None]
            by_yy = by_yy * v + by_y
            by_y = by_y * v + z
            z = z * v + q
            by_xy = by_xy * v + by_x
            by_x = by_x * v + dq
            by_xx = by_xx * v + 2 * ddq
        return SurfaceHeights(z, by_x / unit, by_y / unit, by_xx / unit**2, by_xy / unit**2, 2 * by_yy / unit**2)
