"""Lens given by its surfaces, as in optical design programs, with real ray tracing."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from ._field_lens import FRAUNHOFER_NM, FieldLens, LensField, axes, through_three
from ._lens_files import read_lens_file
from ._sequential_tracing import (
    Landed,
    Paraxial,
    Sequence,
    Traced,
    field_end,
    stop_radius,
    traced_field,
)
from .lens import F_NUMBER, FOCUS

AIMING_STEPS = 12
AIMING_TOLERANCE_MM = 1e-10
PER_SURFACE = {
    "curvature_per_mm": Parameter(
        "1/mm", -1e3, 1e3, "curvatures of the surfaces from the front, 0 for planes"
    ),
    "thickness_mm": Parameter(
        "mm", -1e4, 1e4, "distance from each surface to the next; not used for the last"
    ),
    "index": Parameter("", 1.0, 5.0, "refractive index after each surface; 1 after the last"),
    "conic": Parameter("", -1e4, 1e4, "conic constants"),
    "edge_mm": Parameter("mm", 0.0, 1e4, "semi-diameters of the surfaces, 0 if unknown"),
    "clear_mm": Parameter("mm", 0.0, 1e4, "radii of apertures that vignette, 0 for none"),
    "index_short": Parameter("", 1.0, 5.0, "refractive indices at the shortest wavelength"),
    "index_long": Parameter("", 1.0, 5.0, "refractive indices at the longest wavelength"),
}


@dataclass(frozen=True)
class SurfaceLens(FieldLens):
    """Lens of surfaces of revolution; its reference point is the vertex of the first surface.

    The imager is in the paraxial focus of an object on the axis at ``focus_distance_mm`` from that
    vertex, at the middle wavelength. Chief rays pass the centre of the stop; T and S focus,
    distortion, vignetting and the lens's own blur are those of real rays.

    Parameters
    ----------
    f_number
        Focal length divided by the diameter of the entrance pupil.
    focus_distance_mm : mm
    curvature_per_mm, thickness_mm, index : (n,)
        Values from the front: the surface facing the mirror is first.
    stop_surface
        Number of the stop surface, from 1.
    field_max_deg
        Largest viewing angle; by default up to 80 deg, limited by vignetting.
    conic, edge_mm, clear_mm, index_short, index_long : (n,)
    aspheres : (n k,)
        Coefficients of r^2, r^4, ... in mm, equally many per surface; those of the first surface
        first.
    wavelengths_nm
        Shortest, middle and longest wavelength; informative.

    Raises
    ------
    InvalidParameter
        If columns differ in length, the stop is not a surface, the focal length is not positive, or
        no light is transmitted.

    Examples
    --------
    Plano-convex lens of 50 mm with a front stop:

    >>> lens = SurfaceLens(8.0, 1e6, (0.0, 1 / 25.84, 0.0), (10.0, 4.0, 0.0), (1.0, 1.5168, 1.0), 1)
    >>> round(lens.focal_length_mm, 2)
    50.0
    """

    f_number: float
    focus_distance_mm: float
    curvature_per_mm: tuple[float, ...]
    thickness_mm: tuple[float, ...]
    index: tuple[float, ...]
    stop_surface: int
    field_max_deg: float = 80.0
    conic: tuple[float, ...] | None = None
    aspheres: tuple[float, ...] | None = None
    edge_mm: tuple[float, ...] | None = None
    clear_mm: tuple[float, ...] | None = None
    index_short: tuple[float, ...] | None = None
    index_long: tuple[float, ...] | None = None
    wavelengths_nm: tuple[float, ...] | None = None

    KIND: ClassVar[str] = "surfaces"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "f_number": F_NUMBER,
        "focus_distance_mm": FOCUS,
        **PER_SURFACE,
        "stop_surface": Parameter("", 1, 1000, "number of the stop surface, starting at 1"),
        "field_max_deg": Parameter("deg", 1.0, 80.0, "maximum viewing angle"),
        "aspheres": Parameter(
            "", -1e9, 1e9, "coefficients of r^2, r^4, ... of each surface, in order"
        ),
        "wavelengths_nm": Parameter("nm", 100.0, 2e4, "shortest, middle and longest wavelength"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is None:
                continue
            if isinstance(value, list | tuple):
                object.__setattr__(self, f.name, tuple(float(v) for v in value))
            self.PARAMETERS[f.name].check(f.name, value)
        count = len(self.curvature_per_mm)
        for name in PER_SURFACE:
            column = getattr(self, name)
            if column is not None and len(column) != count:
                raise InvalidParameter(
                    f"{name} must have one value for each of the {count} surfaces; got {len(column)}"
                )
        if self.aspheres is not None and len(self.aspheres) % count:
            raise InvalidParameter(
                f"aspheres must have the same number of values for each of the {count} "
                f"surfaces; got {len(self.aspheres)} in total"
            )
        if int(self.stop_surface) != self.stop_surface or not 1 <= self.stop_surface <= count:
            raise InvalidParameter(
                f"stop_surface must be a surface number from 1 to {count}; got "
                f"{self.stop_surface:g}"
            )
        if self.index[-1] != 1.0:
            raise InvalidParameter(
                f"index must end with 1, the air in front of the imager; got {self.index[-1]:g}"
            )
        with np.errstate(all="ignore"):  # overflow is rejected
            focal = self._paraxial.focal_length
            if not (np.isfinite(focal) and focal > 0):
                raise InvalidParameter(
                    f"the focal length of the surfaces must be greater than 0; got {focal:g} mm"
                )
            if not np.isfinite(self._paraxial.entrance_pupil):
                raise InvalidParameter(
                    "the entrance pupil must be at a finite distance; the stop, surface "
                    f"{self.stop_surface:g}, is in the focal plane of the surfaces in front of it"
                )
            self._check_focus()
            _ = self.field

    @classmethod
    def from_file(cls, path: str | Path, **entries: Any) -> SurfaceLens:
        """Read a lens from a .zmx file.

        Parameters
        ----------
        path
            File to read.
        entries
            Entries such as ``focus_distance_mm``, ``f_number``, ``field_max_deg``, which take
            precedence over the file, and ``glass_catalogue`` (.agf).

        Returns
        -------
        SurfaceLens
            Lens focused at ``focus_distance_mm``.

        Raises
        ------
        OmnimirrorError
            If the file is missing or not a supported lens; the message states the reason.

        Examples
        --------
        >>> SurfaceLens.from_file("nothing.zmx")
        Traceback (most recent call last):
        ...
        omnimirror.base.errors.SpecError: cannot read nothing.zmx: No such file or directory
        """
        return cls(**read_lens_file({"file": str(path), **entries}, Path()))

    @classmethod
    def from_spec(cls, data: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        return read_lens_file(data, folder)

    @classmethod
    def file_entries(cls) -> dict[str, tuple[str, ...]]:
        return {"file": tuple(cls.PARAMETERS), "glass_catalogue": ()}

    @cached_property
    def _paraxial(self) -> Paraxial:
        return _sequence_of(self).paraxial()

    @property
    def focal_length_mm(self) -> float:  # type: ignore[override]  # a field of other lenses
        """Paraxial focal length at the middle wavelength."""
        return float(self._paraxial.focal_length)

    @property
    def principal_point_mm(self) -> float:
        return -float(self._paraxial.front_principal)

    @property
    def imager_mm(self) -> float:
        """Distance from the first surface to the imager, mm."""
        return float(sum(self.thickness_mm[:-1]) + _traced_of(self).to_imager)

    @property
    def pupil_from_principal(self) -> float:
        return float(self._paraxial.front_principal - self._paraxial.entrance_pupil)

    @cached_property
    def field(self) -> LensField:
        return _field_of(self)

    def _check_focus(self) -> None:
        min_focus_mm = self.principal_point_mm + self.focal_length_mm
        if self.focus_distance_mm <= min_focus_mm:
            raise InvalidParameter(
                f"focus_distance_mm must be greater than {min_focus_mm:g} mm, the front focus from "
                f"the first surface; got {self.focus_distance_mm:g}"
            )

    def at_wavelength(self, wavelength_nm: float) -> SurfaceLens:
        """Return the lens at a wavelength, with fixed stop and imager.

        Raises
        ------
        InvalidParameter
            If no other wavelengths are given, or such light has no image before the imager.
        """
        wavelengths = (self.wavelengths_nm, self.index_short, self.index_long)
        if any(column is None for column in wavelengths) or len(self.wavelengths_nm or ()) != len(
            FRAUNHOFER_NM
        ):
            raise InvalidParameter(
                f"the indices at {wavelength_nm:g} nm are unknown; specify wavelengths_nm, "
                "index_short and index_long, or read the lens from a .zmx file"
            )
        rows = np.array([self.index_short, self.index, self.index_long])
        index = through_three(wavelength_nm, np.array(self.wavelengths_nm), rows)
        changed = replace(
            self,
            index=tuple(index.tolist()),
            index_short=None,
            index_long=None,
            wavelengths_nm=None,
        )
        a, b, c, d = changed._paraxial.back
        to_imager = _traced_of(self).to_imager
        focal = changed._paraxial.focal_length
        return replace(
            changed,
            focus_distance_mm=float(-(b + d * to_imager) / (a + c * to_imager)),
            f_number=self.f_number * float(focal / self.focal_length_mm),
        )

    # -- real rays ---------------------------------------------------------------------------------

    def image_of(self, points: Array, directions: Array) -> Array:
        """Trace the rays through every surface; NaN for blocked rays."""
        return self._landed_from(points, directions).image.reshape(directions[..., :2].shape)

    def clearances(self, points: Array, directions: Array) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at every surface with a clear aperture (``clear_mm``)."""
        radii = self._landed_from(points, directions).radii.reshape(-1, *directions.shape[:-1])
        limits = enumerate(self.clear_mm or (), start=1)
        return {
            f"lens surface {i}": (c**2 - radii[i - 1] ** 2) / (2 * c) for i, c in limits if c > 0
        }

    def image_cosines(self, points: Array, directions: Array) -> Array:
        """Trace the rays through every surface; NaN for blocked rays."""
        return self._landed_from(points, directions).cosines.reshape(directions[..., :2].shape)

    def stop_points(self, points: Array, directions: Array) -> Array:
        """Trace the rays to the stop surface; NaN for blocked rays."""
        stop_points = self._landed_from(points, directions).stop / self._stop_scale
        return stop_points.reshape(directions[..., :2].shape)

    @cached_property
    def _stop_scale(self) -> float:
        """Radius of the stop, mm, negative if the preceding surfaces invert its image."""
        return _traced_of(self).stop_radius * float(np.sign(self._paraxial.pupil_magnification))

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        """Return rays through pupil points to image points, by Newton's method."""
        origins, directions = super().rays(image, pupil)
        slopes = directions[:, :2] / directions[:, 2:]
        chief = self.undistorted(image) / self.principal_distance
        values = self.field.at(np.hypot(chief[:, 0], chief[:, 1]))
        t, s = axes(chief)
        for _ in range(AIMING_STEPS):
            miss = image - self._landed(origins[:, :2] - origins[:, 2:] * slopes, slopes).image
            along, across = (np.einsum("ni,ni->n", miss, axis) for axis in (t, s))
            step = (along / values.scale_t)[:, None] * t + (across / values.scale_s)[:, None] * s
            slopes = slopes + step
            if not (np.abs(miss) > AIMING_TOLERANCE_MM).any():
                break
        return origins, np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)

    def _landed_from(self, points: Array, directions: Array) -> Landed:
        """Trace rays from the mirror, by points and directions of any shape."""
        slopes = (directions[..., :2] / directions[..., 2:]).reshape(-1, 2)
        return self._landed(
            points[..., :2].reshape(-1, 2) - points[..., 2].reshape(-1, 1) * slopes, slopes
        )

    def _landed(self, points: Array, slopes: Array) -> Landed:
        """Trace rays from points (n, 2) in the first vertex plane, given slopes."""
        traced = _traced_of(self)
        return traced.sequence.trace(points, -slopes, traced.to_imager).upright()


@lru_cache(maxsize=64)
def _traced_of(lens: SurfaceLens) -> Traced:
    """Return the lens with its imager, pupil and stop."""
    sequence, paraxial = _sequence_of(lens), lens._paraxial
    a, b, c, d = paraxial.back
    distance = lens.focus_distance_mm
    to_imager = -(a * distance + b) / (c * distance + d)
    radius = paraxial.focal_length / lens.f_number / 2
    traced = Traced(sequence, to_imager, -paraxial.entrance_pupil, radius, np.inf, distance)
    return traced._replace(stop_radius=stop_radius(traced))


@lru_cache(maxsize=64)
def _field_of(lens: SurfaceLens) -> LensField:
    """Return the field functions of a lens at its focus."""
    traced = _traced_of(lens)
    end = field_end(traced, float(np.tan(np.radians(lens.field_max_deg))))
    outer = None
    if lens.index_short is not None and lens.index_long is not None:
        outer = np.array([1.0, *lens.index_short]), np.array([1.0, *lens.index_long])
    return LensField(
        traced_field(traced, end, outer),
        "the lens's field",
        at_fold="set field_max_deg below {angle}",
        at_end=(
            f"increase field_max_deg (now {lens.field_max_deg:.4g}) if the lens transmits "
            "light there"
        ),
    )


def _sequence_of(lens: SurfaceLens) -> Sequence:
    count = len(lens.curvature_per_mm)

    def column(values: tuple[float, ...] | None, missing: float) -> Array:
        values_or_zeros = np.zeros(count) if values is None else np.array(values)
        return (
            np.where(values_or_zeros == 0.0, missing, values_or_zeros)
            if missing
            else values_or_zeros
        )

    return Sequence(
        np.array(lens.curvature_per_mm),
        column(lens.conic, 0.0),
        np.reshape(lens.aspheres or (), (count, -1)),
        np.array(lens.thickness_mm),
        np.array([1.0, *lens.index]),
        column(lens.edge_mm, np.inf),
        column(lens.clear_mm, np.inf),
        int(lens.stop_surface) - 1,
    )
