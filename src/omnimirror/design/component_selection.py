"""Selection of off-the-shelf lenses and imagers for a mirror, and of the best F-number and focus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from ..analysis.focus import FocusStudy, best_focus, virtual_images
from ..base.arguments import distances, validate_arguments
from ..base.errors import InvalidParameter
from ..base.optimisation import minimise_scalar
from ..base.results import Result
from ..base.typing import Array
from ..optics.batch.best_focus import AreaModel, IdealAreas, best_vergences
from ..optics.batch.closed_forms import PerspectiveCamera, node_optics
from ..optics.image_sensor import Imager
from ..optics.lenses import BlurMode, Lens, Orthographic, Perspective
from ..optics.sensor import Sensor
from .catalogue import Catalogue, ImagerComponent, LensComponent, TelecentricComponent, mounts_fit

# -- F-number and focus that minimise combined defocus blur and diffraction over the field ---------
#
# A large aperture increases defocus blur, a small one diffraction. The blur diameter on the imager is
# proportional to 1/F and the Airy disc diameter to F; they are added in quadrature. For a given
# focus, with the largest blur ``B/F`` over the field and the Airy disc ``a F``, the minimum of
# ``sqrt((B/F)^2 + (a F)^2)`` is ``sqrt(2 a B)``, at ``F = sqrt(B/a)``, the F-number of equal
# contributions.

SIDES = ("tangential", "sagittal", "together")
FIELD_ANGLES = 1001


@dataclass(frozen=True)
class BestAperture(Result):
    """Optimal F-number and focus, with the remaining blur.

    Attributes
    ----------
    side
        Minimised blur: tangential, sagittal, or the larger of both.
    worst_px
        Root sum of squares of blur and Airy disc at the worst field angle.
    blur_px, airy_px
        Contributions of defocus and diffraction.
    """

    side: str
    f_number: float
    focus_mm: float
    worst_px: float
    blur_px: float
    airy_px: float


@validate_arguments
def best_apertures(
    sensor: Sensor,
    f_number: float | tuple[float, float] = (0.5, 64.0),
    *,
    object_distance_mm: float = np.inf,
    mode: BlurMode = "exact",
    wavelength_nm: float = 550.0,
    omega_min_deg: float = 0.0,
) -> list[BestAperture]:
    """Compute the optimal F-number and focus for tangential, sagittal and combined blur.

    The merit is the root sum of squares of defocus blur and Airy disc at the worst field angle, in
    pixels. For a focus with the largest blur B/F and the Airy disc a F, its minimum is sqrt(2 a B),
    at F = sqrt(B/a).

    Parameters
    ----------
    sensor
        Sensor; its own F-number and focus are ignored.
    f_number
        Available F-numbers, a single value or (low, high); for a telecentric lens the image-side
        working F-number.
    object_distance_mm
        Object distance from the mirror, mm.
    mode
        ``"exact"`` blur (Eq. 28), or ``"paper"`` (Eq. 29).
    wavelength_nm
        Wavelength of the Airy disc, nm.
    omega_min_deg
        Smallest field angle considered, deg.

    Returns
    -------
    list of BestAperture
        Results for the tangential, the sagittal and the combined blur.

    Raises
    ------
    InvalidParameter
        If the range of F-numbers or the field is empty.

    Examples
    --------
    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> for best in best_apertures(load_sensor("paper-spherical")):
    ...     print(f"{best.side}: F/{best.f_number:.1f} at {best.focus_mm:.0f} mm leaves {best.worst_px:.2f} px")
    tangential: F/3.0 at 209 mm leaves 1.17 px
    sagittal: F/8.5 at 241 mm leaves 3.27 px
    together: F/8.5 at 241 mm leaves 3.27 px
    """
    low, high = f_number if isinstance(f_number, Sequence) else (f_number, f_number)
    if not 0 < low <= high:
        raise InvalidParameter(
            f"f_number must be a range with 0 < low <= high; got {low:g} to {high:g}"
        )
    first, last = sensor.field_deg
    if not omega_min_deg < last:
        raise InvalidParameter(
            f"omega_min_deg must be less than {last:.6g} deg, the end of the field; got {omega_min_deg:g}"
        )
    omega = np.radians(np.linspace(max(first, omega_min_deg), last, FIELD_ANGLES))
    unit = replace(sensor, lens=_at_f_number(sensor.lens, 1.0))
    rays = unit.meridian.trace(unit.meridian.x_from_omega(omega))
    study = FocusStudy(
        unit,
        rays,
        virtual_images(rays, distances("object_distance_mm", object_distance_mm)),
        mode,
        None,
        wavelength_nm,
    )
    return [_best(side, study, (low, high)) for side in SIDES]


def _best(side: str, study: FocusStudy, f_range: tuple[float, float]) -> BestAperture:
    """Optimise for one kind of blur; the sensor has F-number 1."""
    L_t, L_s = study.distances
    L = {"tangential": L_t, "sagittal": L_s, "together": np.concatenate([L_t, L_s])}[side]
    usable = L[np.isfinite(L) & (_nearest(study.sensor.lens) < L)]
    if not usable.size:
        raise InvalidParameter("the lens cannot be focused at the virtual images")

    def at(focus: float) -> BestAperture:
        blur = study.at(focus)
        t, s = float(np.abs(blur.t_px).max()), float(np.abs(blur.s_px).max())
        open_ = {"tangential": t, "sagittal": s, "together": max(t, s)}[side]
        # (B/F)^2 + (a F)^2 is stationary at F^2 = B/a; B and a are blur and Airy disc at F = 1.
        F = float(np.clip(np.sqrt(open_ / blur.airy_px), *f_range))
        return BestAperture(
            side,
            F,
            focus,
            float(np.hypot(open_ / F, blur.airy_px * F)),
            open_ / F,
            blur.airy_px * F,
        )

    return at(
        minimise_scalar(lambda focus: at(focus).worst_px, float(usable.min()), float(usable.max()))
    )


def _nearest(lens: Lens) -> float:
    return lens.focal_length_mm if isinstance(lens, Perspective) else -np.inf


def _at_f_number(lens: Lens, f_number: float) -> Lens:
    change: dict[str, Any] = {
        "f_number" if isinstance(lens, Perspective) else "working_f_number": f_number
    }
    return replace(lens, **change)  # type: ignore[type-var]  # all implementations are dataclasses


# -- Selection of off-the-shelf lenses and imagers for a mirror, with reasons for rejection --------
#
# The mirror distance follows from the field, and therefore the viewing angle at the rim is fixed.
# Lens and imager have to cover this angle, focus on the virtual images and keep the blur small.

STOPS = 2.0 ** (np.arange(-4, 25) / 4)  # candidate F-numbers in steps of half a stop
MIRROR_POINTS = 181


@dataclass(frozen=True)
class Combination(Result):
    """Combination of a lens and an imager for a given mirror.

    Attributes
    ----------
    reasons
        Reasons for rejection; empty for a feasible combination.
    fill
        Radius of the rim image relative to half of the shorter imager side; 1 fills it.
    rim_radius_px
    ring_mm
        Thickness of the extension rings required for the focus; 0 for none.
    sensor
        Sensor with the optimal F-number and focus; None for an incompatible kind of lens.
    worst_floored_area_deg2
        Largest floored blur area over the field, the ranking criterion of feasible combinations.
    """

    lens: str
    imager: str
    reasons: tuple[str, ...]
    fill: float
    rim_radius_px: float
    ring_mm: float
    sensor: Sensor | None
    worst_floored_area_deg2: float

    @property
    def fits(self) -> bool:
        return not self.reasons


@validate_arguments
def choose_parts(
    sensor: Sensor,
    catalogue: Catalogue,
    *,
    min_fill: float = 0.6,
    object_distance_mm: float = np.inf,
) -> list[Combination]:
    """Evaluate all combinations of lenses and imagers for the mirror of a sensor, best first;
    infeasible combinations are last.

    Parameters
    ----------
    sensor
        Mirror, mirror distance and kind of lens are used; focal length and imager are ignored.
    catalogue
        Catalogue from :func:`omnimirror.read_catalogue`.
    min_fill
        Minimum radius of the rim image relative to half of the shorter imager side, 0 to 1.
    object_distance_mm
        Object distance from the mirror, mm.

    Returns
    -------
    list of Combination
        Combinations with their sensors at optimal F-number and focus, or with reasons for
        rejection.

    Raises
    ------
    InvalidParameter
        If fill is outside 0 to 1, or the sensor has a second mirror.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.design.catalogue import Catalogue, ImagerComponent, LensComponent
    >>> shelf = Catalogue((LensComponent("8 mm", 8.0, 1.4, 16.0, 100.0),), (ImagerComponent("1 MP", 1280, 1024, 5.2),))
    >>> best = om.choose_parts(om.load_sensor("paper-spherical"), shelf)[0]
    >>> best.fits, best.lens, round(best.sensor.lens.focus_distance_mm)
    (True, '8 mm', 246)
    """
    sensor.check("the choice of parts", "single mirror")
    if not 0 <= min_fill <= 1:
        raise InvalidParameter(f"min_fill must be a fraction from 0 to 1; got {min_fill:g}")
    distances("object_distance_mm", object_distance_mm)
    matches = [
        _combine(sensor, lens, imager, min_fill, object_distance_mm)
        for lens in catalogue.lenses
        for imager in catalogue.imagers
    ]
    return sorted(matches, key=lambda c: (not c.fits, len(c.reasons), c.worst_floored_area_deg2))


def _combine(
    sensor: Sensor,
    lens: LensComponent | TelecentricComponent,
    imager: ImagerComponent,
    min_fill: float,
    distance: float,
) -> Combination:
    if isinstance(lens, TelecentricComponent) != sensor.lens.TELECENTRIC:
        required = "a telecentric lens" if sensor.lens.TELECENTRIC else "a perspective lens"
        return Combination(
            lens.name,
            imager.name,
            (f"the mirror requires {required}",),
            0.0,
            0.0,
            0.0,
            None,
            np.inf,
        )
    part = Imager(imager.width_px, imager.height_px, imager.pixel_pitch_um)
    best, area = _at_best_aperture(replace(sensor, imager=part), lens, distance)
    rim, half = best.rim_radius_px, min(part.size) / 2
    reasons = (
        []
        if mounts_fit(lens, imager)
        else [f"lens mount {lens.mount} differs from imager mount {imager.mount}"]
    )
    if rim > half:
        reasons.append(f"rim image radius {rim:.0f} px exceeds {half:g} px")
    if rim < min_fill * half:
        reasons.append(
            f"rim image radius {rim:.0f} px fills only {100 * rim / half:.0f} % of {half:g} px"
        )
    if lens.image_circle_mm is not None and 2 * rim * part.pitch_mm > lens.image_circle_mm:
        reasons.append(
            f"image circle {lens.image_circle_mm:g} mm, required {2 * rim * part.pitch_mm:.1f} mm"
        )
    ring = 0.0
    if isinstance(lens, LensComponent):
        ring, more = rings_for(lens, best.lens.focus_distance_mm)
        reasons += more
    elif lens.front_diameter_mm < (width := 2 * sensor.mirror.rim_radius_mm):
        reasons.append(
            f"front diameter {lens.front_diameter_mm:g} mm is less than that of the mirror, {width:g} mm"
        )
    return Combination(lens.name, imager.name, tuple(reasons), rim / half, rim, ring, best, area)


def rings_for(part: LensComponent, focus_mm: float) -> tuple[float, list[str]]:
    """Return the thinnest extension rings (mm) for a focus distance, or the reason for failure.

    The focus travel of the lens extends from infinity to its minimum object distance, ``f^2/(L_min
    - f)``; rings are added to it.

    >>> lens = LensComponent("12 mm", 12.0, 1.4, 16.0, 300.0, extension_rings_mm=(0.5, 1.0))
    >>> rings_for(lens, 400.0), rings_for(lens, 160.0)
    ((0.0, []), (0.5, []))
    """
    f = part.focal_length_mm
    needed, travel = f * f / (focus_mm - f), f * f / (part.minimum_focus_mm - f)
    rings = part.extension_rings_mm
    for ring in sorted(
        float(sum(chosen)) for n in range(len(rings) + 1) for chosen in combinations(rings, n)
    ):
        if ring <= needed <= ring + travel:
            return ring, []
    reason = f"minimum focus {part.minimum_focus_mm:g} mm, required {focus_mm:.0f} mm"
    if rings:
        reason += (
            f", which requires extension rings of {needed - travel:.2f} to {needed:.2f} mm in total"
        )
    return 0.0, [reason]


def _at_best_aperture(
    sensor: Sensor, part: LensComponent | TelecentricComponent, distance: float
) -> tuple[Sensor, float]:
    """Return the sensor at F-number and focus of minimum worst blur area, and that area."""
    low, high = part.f_number_min, part.f_number_max
    stops = np.concatenate([[low], STOPS[(low < STOPS) & (high > STOPS)], [high]])
    if isinstance(part, TelecentricComponent):
        lenses: list[Lens] = [Orthographic(part.magnification, float(F), 0.0) for F in stops]
        foci = [
            best_focus(replace(sensor, lens=lens), object_distance_mm=distance) for lens in lenses
        ]
        i = int(np.argmin([f.value for f in foci]))
        return replace(sensor, lens=lenses[i].focused_at(foci[i].focus_mm)), foci[i].value
    focus, area = _foci(sensor, part.focal_length_mm, stops, distance)
    i = int(area.argmin())
    return replace(
        sensor, lens=Perspective(part.focal_length_mm, float(stops[i]), float(focus[i]))
    ), float(area[i])


def _foci(
    sensor: Sensor, focal_length_mm: float, stops: Array, distance: float
) -> tuple[Array, Array]:
    """Return the best focus (mm) and the worst floored area (deg2) for each F-number (n,)."""
    rays = sensor.meridian.trace(np.linspace(0.0, sensor.mirror.rim_radius_mm, MIRROR_POINTS))
    with np.errstate(divide="ignore", invalid="ignore"):
        slope_over_x = np.where(rays.x > 0, rays.slope / rays.x, rays.curvature)
        o = node_optics(
            rays.x,
            rays.z,
            rays.slope,
            rays.curvature,
            slope_over_x,
            np.asarray(rays.m),
            1 / distance,
        )
        density = 1 / (o.magnification_t * o.magnification_s) ** 2
    camera = PerspectiveCamera(focal_length_mm, stops, o.ray[-1], sensor.imager.pitch_mm)
    vergence_t, vergence_s, density = (
        np.repeat(a[None], len(stops), axis=0) for a in (o.vergence_t, o.vergence_s, density)
    )
    v, area = best_vergences(
        IdealAreas(vergence_t, vergence_s, density, AreaModel.of(camera, len(stops)))
    )
    return 1 / v, area
