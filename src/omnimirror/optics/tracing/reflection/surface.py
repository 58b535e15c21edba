"""Mirror surface over the vertex plane, continued beyond its rim, with two derivatives."""

from __future__ import annotations

import numpy as np

from ....base.typing import Array
from ...mirrors import Mirror
from ...mirrors.form import NO_FORM, MirrorForm, SurfaceHeights


def continued_profile(mirror: Mirror, x: Array) -> tuple[Array, Array, Array]:
    """Return sag, slope and curvature of a mirror, continued beyond its rim by a parabola.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> [float(v) for v in continued_profile(Sphere(50.0, 30.0), np.array([32.0]))[0].round(6)]
    [11.578125]
    """
    inside = np.minimum(x, mirror.rim_radius_mm)
    sag, slope, curvature = mirror.profile(inside)
    beyond = x - inside
    bend = np.where(beyond > 0, np.maximum(curvature, 0.0), curvature)
    return sag + slope * beyond + bend * beyond**2 / 2, slope + bend * beyond, bend


class Surface:
    """Points of the continued surface over (x, y) with first and second derivatives."""

    def __init__(self, mirror: Mirror, xy: Array, form: MirrorForm = NO_FORM) -> None:
        x, y = xy[:, 0], xy[:, 1]
        r = np.hypot(x, y)
        sag, slope, bend = continued_profile(mirror, r)
        on_axis = r == 0
        safe = np.where(on_axis, 1.0, r)
        cos, sin = np.where(on_axis, 1.0, x / safe), y / safe
        hoop = np.where(on_axis, bend, slope / safe)
        self.points = np.stack([x, y, sag], axis=-1)
        self.slopes = np.stack([slope * cos, slope * sin], axis=-1)
        self.second = (
            bend * cos * cos + hoop * sin * sin,
            (bend - hoop) * cos * sin,
            bend * sin * sin + hoop * cos * cos,
        )
        if not form.is_empty:
            self._add(form.heights(mirror.rim_radius_mm, xy))

    def _add(self, form: SurfaceHeights) -> None:
        self.points[:, 2] += form.z
        self.slopes += np.stack([form.gx, form.gy], axis=-1)
        xx, xy, yy = self.second
        self.second = xx + form.hxx, xy + form.hxy, yy + form.hyy

    @property
    def tangents(self) -> Array:
        """Derivatives (n, 2, 3) of the points by x and by y."""
        tangents = np.zeros((len(self.points), 2, 3))
        tangents[:, 0, 0] = tangents[:, 1, 1] = 1.0
        tangents[:, :, 2] = self.slopes
        return tangents

    @property
    def bend(self) -> Array:
        """Second derivatives (n, 2, 2) of the height over (x, y)."""
        xx, xy, yy = self.second
        return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=1)

    @property
    def normals(self) -> Array:
        """Unit normals (n, 3) towards the lens side."""
        normals = np.concatenate([self.slopes, np.full((len(self.points), 1), -1.0)], axis=1)
        unit: Array = normals / np.sqrt(np.einsum("ni,ni->n", normals, normals))[:, None]
        return unit
