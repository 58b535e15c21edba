"""Combinations of parts: their requirements, and necessary conditions for early rejection.

A combination is rejected if a necessary condition is violated for any mirror. Each is a bound
derived from the equations of the paper, for the largest rim image permitted by imager and lens (N
pixels, radius r = N pitch):

    viewing angle    tan(Theta) = r (1/f - 1/L0) < r/f                             Eqs. 7, 25
    size             lens to rim M/tan(Theta) > M f/r; the imager is at least f behind the lens
    resolution       mean of dh/dOmega from a to b <= N/(b - a)                    Eq. 9
                     Dw = 2 pi h/(360 sin(Omega))                               Eq. 10
    diffraction      Airy >= 2.44 lambda F_min, a lower bound of the total blur
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..base.arguments import format_value
from ..base.caching import cached_property
from ..base.errors import InvalidParameter
from ..optics.housing import NO_HOUSING, Dome
from ..optics.image_sensor import Imager
from .catalogue import (
    BallComponent,
    Catalogue,
    Component,
    DomeComponent,
    ExtraComponent,
    ImagerComponent,
    LensComponent,
    TelecentricComponent,
    mounts_fit,
)
from .limits import Limit, contrast
from .merits import price
from .requirements import MAX_FOCUS, Range, Requirements, ends, ends_or_none

AIRY_MM = 2.44 * 550e-6  # diameter of the Airy disc over the F-number
ROOM = 1 + 1e-9  # rounding tolerance of bounds


@dataclass(frozen=True)
class PartsCombination:
    """Combination of a lens and an imager, optionally with mirror ball, dome and accessories."""

    lens: LensComponent | TelecentricComponent
    imager: ImagerComponent
    ball: BallComponent | None = None
    dome: DomeComponent | None = None
    extras: tuple[ExtraComponent, ...] = ()

    @property
    def parts(self) -> tuple[Component, ...]:
        return tuple(
            p for p in (self.lens, self.imager, self.ball, self.dome, *self.extras) if p is not None
        )

    @property
    def name(self) -> str:
        """Names of the parts."""
        return " + ".join(part.name for part in self.parts)

    @cached_property
    def price(self) -> float | None:
        """Total price; None if a price is unknown."""
        return price(self.parts)

    @property
    def f_numbers(self) -> tuple[float, float]:
        return self.lens.f_number_min, self.lens.f_number_max


def combinations_of(catalogue: Catalogue, requested: Requirements) -> list[PartsCombination]:
    """Return all combinations, cheapest first; those of unknown price are last."""
    assert requested.parts is not None
    balls = catalogue.balls if requested.parts.mirror == "ball" else (None,)
    domes = catalogue.domes if requested.parts.dome else (None,)
    extras = tuple(_cheapest(catalogue, use) for use in requested.parts.extras)
    combinations = [
        PartsCombination(*parts, extras)
        for parts in product(catalogue.lenses, catalogue.imagers, balls, domes)
    ]
    return sorted(combinations, key=lambda c: (c.price is None, c.price or 0.0))


def _cheapest(catalogue: Catalogue, use: str) -> ExtraComponent:
    """Return the cheapest part for a use; those of unknown price are last."""
    there = [part for part in catalogue.extras if part.use == use]
    if not there:
        uses = ", ".join(dict.fromkeys(part.use for part in catalogue.extras)) or "nothing"
        raise InvalidParameter(
            f"the catalogue must contain an extra part with the use {format_value(use)} "
            f"for parts.extras; it has {uses}"
        )
    return min(there, key=lambda part: (part.price is None, part.price or 0.0))


def requirements_with_parts(requested: Requirements, combination: PartsCombination) -> Requirements:
    """Return the requirements on the sensor of a combination, with the values of its parts."""
    lens, imager = combination.lens, combination.imager
    ranges = requested.lens
    circles = [mm for mm in (ranges.image_circle_mm, lens.image_circle_mm) if mm is not None]
    apertures = _overlap(ranges.f_number, combination.f_numbers) or combination.f_numbers
    table = replace(ranges, f_number=apertures, image_circle_mm=min(circles) if circles else None)
    if isinstance(lens, TelecentricComponent):
        table = replace(table, magnification=lens.magnification)
    else:
        focus = _overlap(ranges.focus_mm, (nearest_focus_mm(lens), MAX_FOCUS)) or ranges.focus_mm
        optics = lens.optics
        if optics is not None:  # at its own aperture, or the nearest permitted one
            low, high = ends(apertures)
            optics = replace(optics, f_number=float(np.clip(optics.f_number, low, high)))
        focal = lens.focal_length_mm if optics is None else None
        table = replace(table, focal_length_mm=focal, focus_mm=focus, optics=optics)
    housing = requested.housing
    if (dome := combination.dome) is not None:
        shell = Dome(
            diameter_mm=dome.dome_diameter_mm, wall_mm=dome.wall_mm, material=dome.material
        )
        housing = replace(housing, shell=shell)
    return replace(
        requested,
        lens=table,
        housing=housing,
        parts=None,
        imager=Imager(imager.width_px, imager.height_px, imager.pixel_pitch_um),
    )


def nearest_focus_mm(lens: LensComponent) -> float:
    """Return the nearest focus distance of a lens with all of its extension rings.

    >>> lens = LensComponent("12 mm", 12.0, 1.4, 16.0, 300.0, extension_rings_mm=(0.5, 1.0))
    >>> round(nearest_focus_mm(lens), 2)
    84.0
    """
    f = lens.focal_length_mm
    return f + f * f / (f * f / (lens.minimum_focus_mm - f) + sum(lens.extension_rings_mm))


def _overlap(requested: Range | None, there: tuple[float, float]) -> Range | None:
    """Return the intersection of a requested range and the range of a part; None if it is empty."""
    low, high = ends(requested) if requested is not None else there
    low, high = max(low, there[0]), min(high, there[1])
    return None if low > high else low if low == high else (low, high)


# -- necessary conditions --------------------------------------------------------------------------


@dataclass(frozen=True)
class PartsBounds:
    """Necessary conditions of a combination, valid for any mirror."""

    requested: Requirements
    combination: PartsCombination

    @cached_property
    def own(self) -> Requirements:
        return requirements_with_parts(self.requested, self.combination)

    @property
    def image_px(self) -> float:
        """Largest radius of the rim image."""
        return self.own.largest_image_px

    @property
    def airy_px(self) -> float:
        """Smallest diameter of the Airy disc."""
        return AIRY_MM * ends(self.own.lens.f_number)[0] / self.own.imager.pitch_mm

    @property
    def tangent(self) -> float:
        """Largest tan(Theta)."""
        lens = self.combination.lens
        assert isinstance(lens, LensComponent)
        radius = self.image_px * self.own.imager.pitch_mm
        if (
            optics := lens.optics
        ) is not None:  # distortion and focus may increase the field above that of f
            field = optics.focused_at(MAX_FOCUS).field
            tangent = float(field.tangent_of(np.array([radius]))[0])
            filled = field.end if np.isnan(tangent) else max(tangent, radius / lens.focal_length_mm)
        else:
            filled = radius / lens.focal_length_mm
        theta = ends_or_none(self.own.lens.theta_max_deg)
        return filled if theta is None else min(filled, float(np.tan(np.radians(theta[1]))))


def _is_of_other_kind(b: PartsBounds) -> bool:
    return isinstance(b.combination.lens, TelecentricComponent) != b.requested.lens.is_telecentric


def _does_not_screw_on(b: PartsBounds) -> bool:
    return not mounts_fit(b.combination.lens, b.combination.imager)


def _is_too_dear(b: PartsBounds) -> bool:
    assert b.requested.parts is not None
    maximum, own = b.requested.parts.max_price, b.combination.price
    return maximum is not None and (own is None or own > maximum)


def _is_too_heavy(b: PartsBounds) -> bool:
    assert b.requested.parts is not None
    maximum = b.requested.parts.max_mass_g
    masses = [part.mass_g for part in b.combination.parts]
    return maximum is not None and (None in masses or sum(m or 0.0 for m in masses) > maximum)


def _has_other_numbers(b: PartsBounds) -> bool:
    """Return whether lens parameters are outside the requested ranges."""
    lens, ranges = b.combination.lens, b.requested.lens
    if _overlap(ranges.f_number, b.combination.f_numbers) is None:
        return True
    if isinstance(lens, TelecentricComponent):
        return _overlap(ranges.magnification, (lens.magnification,) * 2) is None
    if _overlap(ranges.focus_mm, (nearest_focus_mm(lens), MAX_FOCUS)) is None:
        return True
    return _overlap(ranges.focal_length_mm, (lens.focal_length_mm,) * 2) is None


def _has_no_such_angle(b: PartsBounds) -> bool:
    """Return whether the lens cannot reach the viewing angle on this imager."""
    theta = ends_or_none(b.requested.lens.theta_max_deg)
    if theta is None or not isinstance(b.combination.lens, LensComponent):
        return False
    return bool(b.tangent * ROOM < np.tan(np.radians(theta[0])))


def _is_too_large(b: PartsBounds) -> bool:
    """Return whether the parts exceed the overall dimensions, or a limit of the length."""
    assert b.requested.parts is not None
    requested, least_rim = (
        b.requested.parts,
        0.0 if b.combination.ball else ends(b.requested.mirror.rim_radius_mm)[0],
    )
    width = max(2 * least_rim, *(part.diameter_mm or 0.0 for part in b.combination.parts))
    if b.combination.dome is not None:
        width = max(width, b.combination.dome.dome_diameter_mm)
    if requested.max_diameter_mm is not None and width > requested.max_diameter_mm * ROOM:
        return True
    lens = b.combination.lens
    if isinstance(lens, TelecentricComponent):
        return lens.front_diameter_mm * ROOM < 2 * least_rim
    length = least_rim / b.tangent
    lengths = [
        limit.at_most
        for limit in b.requested.limits
        if limit.quantity == "length_mm" and limit.at_most is not None
    ]
    lengths += (
        [] if requested.max_height_mm is None else [requested.max_height_mm - lens.focal_length_mm]
    )
    return bool(lengths) and length > min(lengths) * ROOM


def _resolves_too_little(b: PartsBounds) -> bool:
    return any(_has_too_few_pixels(limit, b.image_px, b.own) for limit in b.own.limits)


def _has_too_few_pixels(limit: Limit, image_px: float, own: Requirements) -> bool:
    if limit.at_least is None or limit.quantity not in (
        "resolution_px_per_deg",
        "dh_domega_px_per_deg",
        "width_px_per_deg",
    ):
        return False
    if not _covers_evaluated_field(own):
        return False
    low, high = limit.omega_deg or (own.field.omega_min_deg, own.field.omega_max_deg)
    if limit.quantity != "width_px_per_deg" and limit.at_least * (high - low) > image_px * ROOM:
        return True
    if limit.quantity == "dh_domega_px_per_deg":
        return False
    square = np.sin(np.radians(np.clip(90.0, low, high)))
    return bool(limit.at_least > 2 * np.pi * image_px / 360 / square * ROOM)


def _covers_evaluated_field(own: Requirements) -> bool:
    """Return whether all field angles of the limits are evaluated."""
    return own.housing == NO_HOUSING and not own.mirror.is_pointed


def _diffracts_too_much(b: PartsBounds) -> bool:
    return any(
        _is_dominated_by_airy_disk(limit, b.airy_px, b.image_px, b.own) for limit in b.own.limits
    )


def _is_dominated_by_airy_disk(
    limit: Limit, airy_px: float, image_px: float, own: Requirements
) -> bool:
    if limit.at_most is not None and limit.of.is_blur:
        if limit.of.unit == "px":
            return airy_px > limit.at_most * ROOM
        if not _covers_evaluated_field(own):
            return False
        low, high = limit.omega_deg or (own.field.omega_min_deg, own.field.omega_max_deg)
        return (
            limit.quantity != "total_blur_s_deg"
            and airy_px * (high - low) > limit.at_most * image_px * ROOM
        )
    if limit.at_least is not None and limit.cycles_per_px is not None:
        return (
            limit.at_least
            > float(contrast(np.zeros(1), np.array([airy_px]), limit.cycles_per_px)[0]) * ROOM
        )
    return False


CUTS: dict[str, Callable[[PartsBounds], bool]] = {
    "different kind of lens": _is_of_other_kind,
    "different mount": _does_not_screw_on,
    "too expensive, or of unknown price": _is_too_dear,
    "too heavy, or of unknown mass": _is_too_heavy,
    "different focal length, magnification, aperture or focus": _has_other_numbers,
    "different viewing angle": _has_no_such_angle,
    "too large": _is_too_large,
    "too few pixels": _resolves_too_little,
    "too much diffraction": _diffracts_too_much,
}
"""Reasons for rejection before the mirror design, in the order of evaluation."""


def cut(requested: Requirements, combination: PartsCombination) -> str | None:
    """Return the reason why a combination is infeasible for any mirror; None without one."""
    bounds = PartsBounds(requested, combination)
    return next((name for name, fails in CUTS.items() if fails(bounds)), None)
