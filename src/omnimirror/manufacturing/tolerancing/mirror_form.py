"""Form errors of mirrors in tolerance analysis: random figures, measured forms, and their effects.

A Zernike term of order n has about n/2 periods over the mirror. For a power spectral density
proportional to the spatial frequency to the power of ``-exponent`` in two dimensions, each term of
order n has the variance ``A n^-exponent``; an order has n + 1 terms. The amplitude follows from RMS,
peak-to-valley value or RMS slope.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arguments import check_fields, number, validate_arguments
from ...base.errors import InvalidParameter
from ...base.numerics import noll, zernike_terms, zernike_values
from ...base.results import Columns, Result
from ...base.typing import Array
from ...optics.mirrors import Mirror
from ...optics.mirrors.mirror import MAX_ORDER, TERMS, MirrorForm
from ...optics.sensor import Sensor
from ..metrology.form_errors import FormError, form_error
from ..metrology.readers import Unit, read_points
from .compensation import merit_names
from .evaluator import TrialEvaluator

LOWEST_ORDER = 2  # lower orders are piston and tilt
GRID = 41  # grid points across the mirror
DRAWS = 200  # samples for the mean peak-to-valley value
MM_PER_UM = 1e-3


@dataclass(frozen=True)
class RandomFigure:
    """Random form error with a power spectrum.

    Parameters
    ----------
    exponent
        Exponent of the power spectral density; 2 to 3 for turned and polished surfaces.
    orders
        First and last Zernike order; order 2 has one period over the mirror.
    rms_um, peak_to_valley_um, slope_mrad
        Exactly one amplitude over the disc of the rim, along the axis; the slope is the RMS of its
        magnitude.

    Raises
    ------
    InvalidParameter
        If the orders are invalid or not exactly one amplitude is given.

    Examples
    --------
    >>> figure = RandomFigure(2.5, (4, 8), rms_um=0.5)
    >>> sigmas = figure.sigmas_um(44.0)
    >>> round(sum(um**2 for um in sigmas.values()) ** 0.5, 9), len(sigmas)
    (0.5, 35)
    """

    exponent: float = 2.5
    orders: tuple[int, int] = (LOWEST_ORDER, MAX_ORDER)
    rms_um: float | None = None
    peak_to_valley_um: float | None = None
    slope_mrad: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        number("exponent", self.exponent, low=0.0, high=10.0)
        low, high = self.orders
        if not (LOWEST_ORDER <= low <= high <= MAX_ORDER and (low, high) == (int(low), int(high))):
            raise InvalidParameter(
                f"orders must be between {LOWEST_ORDER} and {MAX_ORDER}, in ascending order; got {low:g} to {high:g}"
            )
        sizes = [self.rms_um, self.peak_to_valley_um, self.slope_mrad]
        specified = [size for size in sizes if size is not None]
        if len(specified) != 1 or not 0 < specified[0] < np.inf:
            raise InvalidParameter(
                "exactly one of rms_um, peak_to_valley_um and slope_mrad must be given, and it must be positive"
            )

    def sigmas_um(self, rim_mm: float) -> dict[int, float]:
        """Return the standard deviation of each Zernike term.

        Parameters
        ----------
        rim_mm
            Rim radius.

        Returns
        -------
        dict
            Standard deviations in um RMS by Noll index.
        """
        low, high = self.orders
        terms = range(zernike_terms(low - 1) + 1, zernike_terms(high) + 1)
        shape = {j: float(noll(j)[0]) ** (-self.exponent / 2) for j in terms}
        whole = float(np.sqrt(sum(sigma**2 for sigma in shape.values())))
        if self.rms_um is not None:
            scale = self.rms_um / whole
        elif self.peak_to_valley_um is not None:
            scale = self.peak_to_valley_um / _peak_to_valley(shape)
        else:
            assert self.slope_mrad is not None, "one of the three"
            scale = self.slope_mrad / _slope_mrad(shape, rim_mm)
        return {j: scale * sigma for j, sigma in shape.items()}


def _places() -> Array:
    """Return grid points (n, 2) of the unit disc."""
    x, y = (v.ravel() for v in np.meshgrid(*2 * [np.linspace(-1, 1, GRID)]))
    positions: Array = np.stack([x, y], axis=-1)[np.hypot(x, y) <= 1]
    return positions


def _peak_to_valley(sigmas: dict[int, float]) -> float:
    """Return the mean peak-to-valley value (um) of random figures."""
    amounts = np.random.default_rng(0).normal(size=(DRAWS, len(sigmas))) * list(sigmas.values())
    x, y = _places().T
    heights = amounts @ zernike_values(x, y, list(sigmas)).T
    return float(np.ptp(heights, axis=1).mean())


def _slope_mrad(sigmas: dict[int, float], rim_mm: float) -> float:
    """Return the RMS slope (mrad) of random figures."""
    squares = 0.0
    for j, sigma in sigmas.items():
        form = MirrorForm((j,), (1.0,)).heights(rim_mm, rim_mm * _places())
        squares += sigma**2 * float((form.gx**2 + form.gy**2).mean())
    return 1e3 * float(np.sqrt(squares))


def figure_tolerances(mirror: Mirror, figure: RandomFigure) -> dict[str, float]:
    """Return normal tolerances (two sigma) of a random figure by error source."""
    return {
        f"mirror.zernike_{j}_um": 2 * sigma
        for j, sigma in figure.sigmas_um(mirror.rim_radius_mm).items()
    }


MIN_UM = 1e-6  # rounding errors, rms


@validate_arguments
def load_measured_form(mirror: Mirror, path: str | Path, unit: Unit = "mm") -> MirrorForm:
    """Read a measured form error up to Zernike order 12.

    Parameters
    ----------
    mirror
        Nominal mirror.
    path
        Point list or grid for :func:`omnimirror.manufacturing.metrology.readers.read_points`.
    unit
        Unit of point lists.

    Returns
    -------
    MirrorForm
        Significant terms without alignment and noise.

    Raises
    ------
    OmnimirrorError
        If the file is missing or has too few points.
    InvalidParameter
        If the form error is below the noise.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from omnimirror.optics.mirrors import Sphere
    >>> ball, (x, y) = Sphere(50.0, 44.0), (v.ravel() for v in np.meshgrid(*2 * [np.linspace(-31, 31, 41)]))
    >>> z = ball.sag(np.hypot(x, y)) + 1e-3 * np.sqrt(6) * (x**2 - y**2) / 44**2  # 1 um of astigmatism
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.savetxt(f"{folder}/cmm.csv", np.stack([x, y, z], axis=-1), delimiter=",")
    ...     form = load_measured_form(ball, f"{folder}/cmm.csv")
    >>> round(dict(zip(form.zernike, form.um))[6], 4)
    1.0
    """
    result = form_error(mirror, read_points(path, unit))
    terms = [
        term
        for term in result.terms
        if 1 < term.noll <= TERMS and abs(term.um) > max(term.sigma_um, MIN_UM)
    ]
    if not terms:
        raise InvalidParameter(
            f"the form error in {path} must exceed its noise of {result.noise_um:.3g} um"
        )
    return MirrorForm(tuple(term.noll for term in terms), tuple(term.um for term in terms))


@dataclass(frozen=True)
class FormEffect(Result):
    """Effect of a form error on the images of a sensor.

    Attributes
    ----------
    nominal, as_built
        Merits of the sensor with the nominal and the as-built mirror, by name: image motions after each
        calibration, and blur. NaN if rays are lost.
    lost_rays
        Number of objects that the as-built sensor does not image.
    untraced_um
        Axial RMS of terms above order 12, which are not traced.
    """

    nominal: Mapping[str, float]
    as_built: Mapping[str, float]
    lost_rays: int
    untraced_um: float

    def _table(self) -> Columns:
        return {
            "merit": list(self.nominal),
            "nominal": list(self.nominal.values()),
            "as_built": [self.as_built[name] for name in self.nominal],
        }

    def to_dict(self) -> dict[str, Any]:
        """Convert to a JSON-serialisable dictionary."""
        return {
            "nominal": dict(self.nominal),
            "as_built": dict(self.as_built),
            "lost_rays": self.lost_rays,
            "untraced_um": self.untraced_um,
        }


@validate_arguments
def form_effect(sensor: Sensor, form: FormError) -> FormEffect:
    """Compute the effect of a form error on the images of a sensor.

    Parameters
    ----------
    sensor
        Sensor with the nominal mirror.
    form
        Form error of the as-built mirror.

    Returns
    -------
    FormEffect
        Merits of exactly traced rays to objects over the field, as in :func:`omnimirror.tolerance`.

    Raises
    ------
    InvalidParameter
        If the form error belongs to another mirror, or the sensor is not supported.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> rng, mirror = np.random.default_rng(1), sensor.mirror
    >>> r, phi = mirror.rim_radius_mm * np.sqrt(rng.uniform(0, 1, 4000)), rng.uniform(0, 2 * np.pi, 4000)
    >>> x, y = r * np.cos(phi), r * np.sin(phi)
    >>> bump = 2e-3 * np.sqrt(6) * (x**2 - y**2) / mirror.rim_radius_mm**2
    >>> form = om.form_error(mirror, np.stack([x, y, mirror.sag(r) + bump], axis=-1))
    >>> effect = form_effect(sensor, form)
    >>> effect.as_built["motion_px"] > effect.as_built["motion_px after affine"] > 0.0
    True
    """
    _check_its_mirror(sensor, form)
    evaluator, names = TrialEvaluator.of(sensor), merit_names()
    amounts = {term.noll: term.um for term in form.terms}
    values = {
        f"mirror.zernike_{j}_um": np.array([0.0, amounts.get(j, 0.0)]) for j in range(1, TERMS + 1)
    }
    nominal, as_built = (
        dict(zip(names, row.tolist(), strict=True)) for row in evaluator.evaluate(values)
    )
    lost_rays, _ = int(as_built.pop("lost_rays")), nominal.pop("lost_rays")
    beyond = float(np.sqrt(sum(um**2 for j, um in amounts.items() if j > TERMS)))
    return FormEffect(nominal, as_built, lost_rays, beyond)


@validate_arguments
def as_built(sensor: Sensor, form: FormError, *, asymmetric: bool = False) -> Sensor:
    """Return the sensor with its as-built mirror, for saving, rendering and dewarping.

    Parameters
    ----------
    sensor
        Sensor with the nominal mirror.
    form
        Form error of the as-built mirror.
    asymmetric
        Include asymmetric terms as ``mirror_form``. Such a sensor has no meridian; rays, images and
        dewarping remain valid. By default, only rotationally symmetric terms are included.

    Returns
    -------
    Sensor
        Sensor with a sampled profile and a displaced vertex.

    Raises
    ------
    InvalidParameter
        If the form error belongs to another mirror, or asymmetric terms are requested for a folded
        sensor.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> x, y = np.meshgrid(np.linspace(-43, 43, 61), np.linspace(-43, 43, 61))
    >>> inside = np.hypot(x, y) < 43
    >>> points = np.stack([x, y, sensor.mirror.sag(np.minimum(np.hypot(x, y), 43))], axis=-1)[inside]
    >>> made = as_built(sensor, om.form_error(sensor.mirror, points))
    >>> made.mirror.KIND, bool(abs(made.mirror.sag(40.0) - sensor.mirror.sag(40.0)) < 1e-6)
    ('sampled', True)
    """
    _check_its_mirror(sensor, form)
    if asymmetric:
        sensor.check("a mirror with all of its form error", "single mirror")
        beside = {t.noll: t.um for t in form.terms if noll(t.noll)[1] and t.noll <= TERMS}
        sensor = replace(sensor, mirror_form=MirrorForm(tuple(beside), tuple(beside.values())))
    away, pose, second = 1e-3 * form.vertex_um, sensor.mirror_pose, sensor.secondary
    if second is not None:  # mirror positions of folded sensors are distances
        farther = replace(second, distance_mm=second.distance_mm + away)
        distance = sensor.mirror_distance_mm + away
        return replace(
            sensor, mirror=form.corrected(), secondary=farther, mirror_distance_mm=distance
        )
    displaced = replace(pose, displacement_mm=pose.displacement_mm + away)
    return replace(sensor, mirror=form.corrected(), mirror_pose=displaced)


def _check_its_mirror(sensor: Sensor, form: FormError) -> None:
    if form.mirror != sensor.mirror:
        raise InvalidParameter(
            f"form must belong to the mirror of {sensor.name!r}; got the form error of another mirror"
        )
