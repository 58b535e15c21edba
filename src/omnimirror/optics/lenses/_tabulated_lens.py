"""Lens given by a table of its field, from a data sheet or a measurement."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from ._field_lens import (
    FRAUNHOFER_NM,
    MIN_NODES,
    FieldLens,
    FieldNodes,
    LensField,
    even_spline,
    odd_spline,
    ratio,
    through_three,
)
from ._lens_files import read_lens_table
from .lens import F_NUMBER, FOCUS

COLUMNS = {
    "field_deg": Parameter("deg", 0.0, 89.0, "viewing angles from the axis, increasing from 0"),
    "image_height_mm": Parameter("mm", 0.0, 1e4, "image heights at these angles"),
    "entrance_pupil_mm": Parameter(
        "mm",
        -1e4,
        1e4,
        "position of the entrance pupil, from the reference point towards the mirror",
    ),
    "relative_illumination": Parameter(
        "", 0.0, 2.0, "relative illumination of the imager, 1 on the axis"
    ),
    "chief_ray_deg": Parameter("deg", -89.0, 89.0, "angle of the chief ray at the imager"),
    "field_curvature_t_mm": Parameter(
        "mm", -100.0, 100.0, "tangential focus shift, from the imager away from the lens"
    ),
    "field_curvature_s_mm": Parameter(
        "mm", -100.0, 100.0, "sagittal focus shift, from the imager away from the lens"
    ),
    "own_blur_t_mm": Parameter(
        "mm", 0.0, 10.0, "tangential blur of the lens itself: four standard deviations"
    ),
    "own_blur_s_mm": Parameter(
        "mm", 0.0, 10.0, "sagittal blur of the lens itself: four standard deviations"
    ),
    "lateral_colour_short_mm": Parameter(
        "mm", -10.0, 10.0, "image heights in blue light, minus those of the table"
    ),
    "lateral_colour_long_mm": Parameter(
        "mm", -10.0, 10.0, "image heights in red light, minus those of the table"
    ),
}


@dataclass(frozen=True)
class TabulatedLens(FieldLens):
    """Lens given by a table of its field, interpolated by quintic splines.

    Parameters
    ----------
    focal_length_mm, f_number
        Axial values.
    focus_distance_mm : mm
        Object distance in focus, from the reference point.
    field_deg, image_height_mm : (n,)
        The table is valid at ``table_focus_mm``; at another focus, the imager moves along the chief
        rays.
    entrance_pupil_mm : (n,)
        Intersection of chief rays with the axis, from the reference point towards the mirror.
    relative_illumination, chief_ray_deg, field_curvature_t_mm, field_curvature_s_mm : (n,)
        By default: cos^4, the chief rays of a Gaussian lens, and a flat field.
    own_blur_t_mm, own_blur_s_mm : (n,)
        By default: none.
    lateral_colour_short_mm, lateral_colour_long_mm : (n,)
        Increase of the image height in blue and in red.
    principal_point_mm : mm
        Distance from the reference point towards the mirror; 0 by default.
    table_focus_mm : mm
        Focus distance of the table; by default that of the lens at its creation.
    barrel_diameter_mm, barrel_mm : mm
        Clear diameter of a barrel or hood that vignettes the beam, and the position of its front
        from the reference point towards the mirror; none by default. ``relative_illumination``, if
        given, already includes it.
    window_mm, window_index
        Thickness (mm) and refractive index of a flat pane between lens and mirror, perpendicular to
        the axis and not included in the table; its position has no effect. None by default.

    Raises
    ------
    InvalidParameter
        If columns differ in length, angles do not increase from 0, heights do not increase, or
        there are fewer than 4 rows.

    Examples
    --------
    A lens without aberrations equals the perspective lens:

    >>> angles = np.linspace(0, 30, 7)
    >>> ideal = tuple(12.0 * np.tan(np.radians(angles)))
    >>> lens = TabulatedLens(12.0, 4.0, 1e7, tuple(angles), ideal, tuple(0 * angles))
    >>> float(lens.image_height(np.array([10.0]), np.array([100.0])).round(6)[0])
    1.2
    """

    focal_length_mm: float
    f_number: float
    focus_distance_mm: float
    field_deg: tuple[float, ...]
    image_height_mm: tuple[float, ...]
    entrance_pupil_mm: tuple[float, ...]
    relative_illumination: tuple[float, ...] | None = None
    chief_ray_deg: tuple[float, ...] | None = None
    field_curvature_t_mm: tuple[float, ...] | None = None
    field_curvature_s_mm: tuple[float, ...] | None = None
    own_blur_t_mm: tuple[float, ...] | None = None
    own_blur_s_mm: tuple[float, ...] | None = None
    lateral_colour_short_mm: tuple[float, ...] | None = None
    lateral_colour_long_mm: tuple[float, ...] | None = None
    principal_point_mm: float = 0.0
    table_focus_mm: float | None = None
    barrel_diameter_mm: float | None = None
    barrel_mm: float = 0.0
    window_mm: float = 0.0
    window_index: float = 1.5168

    KIND: ClassVar[str] = "table"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "focal_length_mm": Parameter("mm", 1e-2, 1e5, "focal length (f)"),
        "f_number": F_NUMBER,
        "focus_distance_mm": FOCUS,
        **COLUMNS,
        "principal_point_mm": Parameter(
            "mm",
            -1e4,
            1e4,
            "position of the principal point, from the reference point towards the mirror",
        ),
        "table_focus_mm": Parameter(
            "mm", 1e-3, 1e7, "focus distance of the table; equal to that of the lens by default"
        ),
        "barrel_diameter_mm": Parameter(
            "mm", 1e-3, 1e4, "clear diameter of a barrel or hood, none by default"
        ),
        "barrel_mm": Parameter(
            "mm",
            -1e4,
            1e4,
            "position of the barrel's front, from the reference point towards the mirror",
        ),
        "window_mm": Parameter(
            "mm", 0.0, 1e3, "thickness of a flat pane between lens and mirror, none by default"
        ),
        "window_index": Parameter("", 1.0, 5.0, "refractive index of the pane"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is None:
                continue
            self.PARAMETERS[f.name].check(f.name, value)
            if f.name in COLUMNS:
                object.__setattr__(self, f.name, tuple(float(v) for v in value))
        count = len(self.field_deg)
        for name in COLUMNS:
            column = getattr(self, name)
            if column is not None and len(column) != count:
                raise InvalidParameter(
                    f"{name} must have as many values as field_deg, {count}; got {len(column)}"
                )
        if count < MIN_NODES:
            raise InvalidParameter(f"field_deg must have at least {MIN_NODES} values; got {count}")
        if self.field_deg[0] != 0.0 or not (np.diff(self.field_deg) > 0).all():
            raise InvalidParameter("field_deg must increase from 0; sort the rows")
        if self.image_height_mm[0] != 0.0:
            raise InvalidParameter(
                f"image_height_mm must be 0 on the axis; got {self.image_height_mm[0]:g}"
            )
        if self.table_focus_mm is None:
            object.__setattr__(self, "table_focus_mm", self.focus_distance_mm)
        if (min_focus_mm := max(self.entrance_pupil_mm)) >= self.focus_distance_mm:
            raise InvalidParameter(
                f"focus_distance_mm must be greater than {min_focus_mm:g} mm, the position of the "
                f"entrance pupil; got {self.focus_distance_mm:g}"
            )
        self._check_focus()
        _ = self.field

    @classmethod
    def from_spec(cls, data: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        return read_lens_table(data, folder, tuple(COLUMNS))

    @classmethod
    def file_entries(cls) -> dict[str, tuple[str, ...]]:
        return {"file": tuple(COLUMNS)}

    @property
    def pupil_from_principal(self) -> float:
        return self.entrance_pupil_mm[0] - self.principal_point_mm

    @cached_property
    def field(self) -> LensField:
        return _field_of(self)

    def at_wavelength(self, wavelength_nm: float) -> TabulatedLens:
        """Return the lens with the image heights of a wavelength, from the table's lateral colour.

        The heights are a parabola in the inverse squared wavelength; those of the table are
        assigned to the d line, blue and red to F and C.
        """
        if self.lateral_colour_short_mm is None and self.lateral_colour_long_mm is None:
            return self
        zeros = (0.0,) * len(self.field_deg)
        shifts = np.array(
            [
                self.lateral_colour_short_mm or zeros,
                zeros,
                self.lateral_colour_long_mm or zeros,
            ]
        )
        moved = through_three(wavelength_nm, FRAUNHOFER_NM, shifts)
        return replace(
            self,
            image_height_mm=tuple((np.array(self.image_height_mm) + moved).tolist()),
            lateral_colour_short_mm=None,
            lateral_colour_long_mm=None,
        )

    def clearances(self, points: Array, directions: Array) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at the front of the barrel, if present.

        A pane between lens and mirror shifts rays axially by the same amount as the chief rays.
        """
        if self.barrel_diameter_mm is None:
            return {}
        slopes = directions[..., :2] / directions[..., 2:]
        square = (slopes**2).sum(axis=-1)
        n = self.window_index
        is_nearer = self.window_mm * (1 - 1 / np.sqrt(n**2 + (n**2 - 1) * square))
        depth = self.barrel_mm + is_nearer - points[..., 2]
        radius = self.barrel_diameter_mm / 2
        across = points[..., :2] + depth[..., None] * slopes
        return {"barrel": (radius**2 - (across**2).sum(axis=-1)) / (2 * radius)}

    def _at_table(self) -> float:
        """Return the displacement (mm) of the imager from its position for the table."""
        assert self.table_focus_mm is not None
        f, zero = self.focal_length_mm, self.principal_point_mm
        focus, before = self.focus_distance_mm - zero, self.table_focus_mm - zero
        return 1 / (1 / f - 1 / focus) - 1 / (1 / f - 1 / before)


@lru_cache(maxsize=64)
def _field_of(lens: TabulatedLens) -> LensField:
    """Return the field functions of a table at the lens's focus."""
    tangent = np.tan(np.radians(lens.field_deg))
    pupil = np.array(lens.entrance_pupil_mm)
    f, e = lens.focal_length_mm, lens.pupil_from_principal
    behind = (
        tangent * (f - e) / f
        if lens.chief_ray_deg is None
        else np.tan(np.radians(lens.chief_ray_deg))
    )
    height = np.array(lens.image_height_mm) + lens._at_table() * behind
    zeros = np.zeros_like(tangent)
    column = {
        name: zeros if getattr(lens, name) is None else np.array(getattr(lens, name))
        for name in COLUMNS
        if name not in ("relative_illumination", "chief_ray_deg")
    }
    vergence = 1 / (lens.focus_distance_mm - pupil)
    rate, drift = _rate(tangent, height, even=False), _rate(tangent, pupil, even=True)
    scale_t, scale_s = rate / (1 - vergence * drift * tangent), ratio(height, tangent, rate)
    bend_t, bend_s = _of_defocus(tangent, behind, scale_t, scale_s)
    vergence_t = vergence - column["field_curvature_t_mm"] * bend_t
    vergence_s = vergence - column["field_curvature_s_mm"] * bend_s
    opening = _opening_of_barrel(lens, tangent, pupil, vergence)
    light = (1 + tangent**2) ** -2 * opening.area
    if lens.relative_illumination is not None:
        light = np.array(lens.relative_illumination)
    nodes = FieldNodes(
        tangent,
        height,
        pupil,
        vergence_t,
        vergence_s,
        scale_t,
        scale_s,
        opening.width_t,
        opening.width_s,
        opening.shift_t,
        light,
        column["own_blur_t_mm"],
        column["own_blur_s_mm"],
        column["lateral_colour_short_mm"],
        column["lateral_colour_long_mm"],
        np.ones_like(tangent),
        np.ones_like(tangent),
        zeros,
        opening.area,
    )
    nodes = _through_window(nodes, lens.window_mm, lens.window_index)
    return LensField(
        nodes,
        "the lens's table",
        at_fold="correct image_height_mm, or remove the rows from {angle} deg",
        at_end="add rows with larger field_deg",
    )


def _through_window(nodes: FieldNodes, thickness: float, index: float) -> FieldNodes:
    """Return the field functions of the lens behind a flat pane.

    A pane shifts a ray of slope u axially by ``d(u) = a (1 - u'/u)``, with the internal slope u',
    and does not deviate it: the pupil of an angle t is d(t) closer to the mirror. Another ray of
    its fan, of slope ``t - y v`` through y, originates at ``y (1 + t d'(t) v)`` there.
    """
    if not thickness:
        return nodes
    t = nodes.tangent
    inside = np.sqrt(index**2 + (index**2 - 1) * t**2)  # u/u'
    nearer = thickness * (1 - 1 / inside)
    rate = thickness * (index**2 - 1) * t / inside**3
    wider = 1 + t * rate * nodes.vergence_t
    return nodes._replace(
        pupil=nodes.pupil + nearer,
        vergence_t=nodes.vergence_t / wider,
        scale_t=nodes.scale_t * wider,
        width_t=nodes.width_t * wider,
        stop_t=nodes.stop_t * wider,
    )


class _Opening(NamedTuple):
    """Unvignetted part of the entrance pupil at n angles, relative to its axial radius and area."""

    width_t: Array
    width_s: Array
    shift_t: Array
    area: Array


def _opening_of_barrel(
    lens: TabulatedLens, tangent: Array, pupil: Array, vergence: Array
) -> _Opening:
    """Return the part of the pupil transmitted by the barrel: the intersection of two circles.

    A ray of slope ``t - y v`` through a pupil point y crosses the barrel's front, a before the
    pupil, at ``y (1 - a v) + a t``; the point in focus is ``1 / v`` before the pupil.

    Raises
    ------
    InvalidParameter
        If the barrel is narrower than the pupil seen through it, or vignettes an angle completely.
    """
    ones = np.ones_like(tangent)
    if lens.barrel_diameter_mm is None:
        return _Opening(ones, ones, 0 * ones, ones)
    ahead = lens.barrel_mm - pupil
    narrowing = (lens.focus_distance_mm - lens.barrel_mm) * vergence
    if narrowing[0] <= 0 or lens.barrel_diameter_mm / 2 < narrowing[0] * lens.aperture_radius:
        raise InvalidParameter(
            "barrel_diameter_mm must not vignette the bundle on the axis, which f_number "
            f"defines; got {lens.barrel_diameter_mm:g} at barrel_mm = {lens.barrel_mm:g}; "
            "use a wider barrel, or one in front of the object in focus"
        )
    radius = lens.barrel_diameter_mm / 2 / narrowing / lens.aperture_radius
    centre = -ahead * tangent / narrowing / lens.aperture_radius
    low, high = np.maximum(-1.0, centre - radius), np.minimum(1.0, centre + radius)
    if (high <= low).any():
        angle = lens.field_deg[int(np.argmax(high <= low))]
        raise InvalidParameter(
            "the barrel must transmit light over the whole table; it blocks all light at "
            f"{angle:g} deg; remove these rows or use a wider barrel"
        )
    distance = np.abs(centre)
    unvignetted = distance <= radius - 1
    d = np.where(unvignetted, 1.0, distance)
    own = np.clip((1 + d**2 - radius**2) / (2 * d), -1.0, 1.0)  # chord
    theirs = np.clip((d - own) / radius, -1.0, 1.0)
    chord = np.sqrt(1 - own**2)
    common = (
        np.arccos(own)
        - own * chord
        + radius**2 * (np.arccos(theirs) - theirs * np.sqrt(1 - theirs**2))
    )
    # sagittal width: the full circle if its centre is open, else the corners
    across = np.where(own <= 0, 1.0, np.where(theirs <= 0, np.minimum(radius, 1.0), chord))
    return _Opening(
        (high - low) / 2,
        np.where(unvignetted, 1.0, across),
        (high + low) / 2,
        np.where(unvignetted, 1.0, common / np.pi),
    )


def _of_defocus(
    tangent: Array, behind: Array, scale_t: Array, scale_s: Array
) -> tuple[Array, Array]:
    """Return the vergence (1/mm) at the pupil per mm of defocus at the imager.

    By the Lagrange invariant between a ray of the fan and the adjacent chief ray: in the meridian
    ``y cos(theta) dtheta = dh cos(theta') dtheta'``, sagittally
    ``y sin(theta) = h cos(theta') dtheta'``.
    """
    cos, cos_behind = (1 + tangent**2) ** -0.5, (1 + behind**2) ** -0.5
    return (cos / cos_behind) ** 3 / scale_t**2, cos / cos_behind / scale_s**2


def _rate(tangent: Array, values: Array, even: bool) -> Array:
    """Return the derivative (n,) with respect to the tangent of values that are even or odd about
    the axis.
    """
    spline = (even_spline if even else odd_spline)(tangent, values)
    return np.asarray(spline.derivative()(tangent))
