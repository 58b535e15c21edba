"""Random figures: what a surface has of form errors that only their size and their power spectrum are known of.

A Zernike term of order n has about n/2 periods over the mirror. Of a power spectral density that falls as the
``exponent`` of the spatial frequency, in two dimensions, each term of order n has the variance ``A n^-exponent``; an
order has n + 1 terms. The whole is as large as its rms, its peak to valley, or the rms of its slope says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import check_fields, checked, number
from ...errors import InvalidParameter
from ...mirrors import Mirror
from ...mirrors.form import LARGEST_ORDER, TERMS, MirrorForm
from ...numerics.zernike import noll, terms_of, zernike_values
from ...sensor import Sensor
from ..metrology.form_error import FormError, form_error
from ..metrology.readers import Unit, read_points
from .compensation import merit_names
from .evaluator import Judge

Array = NDArray[np.float64]

LOWEST_ORDER = 2  # below, forms are places
GRID = 41  # points across the mirror, on which figures are measured
DRAWS = 200  # figures whose mean peak to valley is taken
MM_PER_UM = 1e-3


@dataclass(frozen=True)
class RandomFigure:
    """Form errors of a power spectrum.

    Parameters
    ----------
    exponent
        Of the spectral density over spatial frequency, which falls with it; 2 to 3 of turned and polished surfaces.
    orders
        First and last order of Zernike terms that it has; one period over the mirror is order 2.
    rms_um, peak_to_valley_um, slope_mrad
        One of them: of the whole figure over the disk of the rim, along the axis; the slope's is an rms of its length.

    Raises
    ------
    InvalidParameter
        Orders that are none, or not exactly one size.

    Examples
    --------
    >>> figure = RandomFigure(2.5, (4, 8), rms_um=0.5)
    >>> sigmas = figure.sigmas_um(44.0)
    >>> round(sum(um**2 for um in sigmas.values()) ** 0.5, 9), len(sigmas)
    (0.5, 35)
    """

    exponent: float = 2.5
    orders: tuple[int, int] = (LOWEST_ORDER, LARGEST_ORDER)
    rms_um: float | None = None
    peak_to_valley_um: float | None = None
    slope_mrad: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        number("exponent", self.exponent, low=0.0, high=10.0)
        low, high = self.orders
        if not (LOWEST_ORDER <= low <= high <= LARGEST_ORDER and (low, high) == (int(low), int(high))):
            raise InvalidParameter(
                f"orders = {low:g} to {high:g} is valid from {LOWEST_ORDER} to {LARGEST_ORDER}; finer figures than "
                "that are not traced"
            )
        sizes = [self.rms_um, self.peak_to_valley_um, self.slope_mrad]
        given = [size for size in sizes if size is not None]
        if len(given) != 1 or not 0 < given[0] < np.inf:
            raise InvalidParameter(
                "one of rms_um, peak_to_valley_um and slope_mrad, above 0, says how large a random figure is"
            )

    def sigmas_um(self, rim_mm: float) -> dict[int, float]:
        """Standard deviation of each Zernike term, um rms, by Noll's number.

        Parameters
        ----------
        rim_mm
            Radius of the mirror's rim.

        Returns
        -------
        dict
            Of all terms of its orders.
        """
        low, high = self.orders
        terms = range(terms_of(low - 1) + 1, terms_of(high) + 1)
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
    """Points (n, 2) of the unit disk."""
    x, y = (v.ravel() for v in np.meshgrid(*2 * [np.linspace(-1, 1, GRID)]))
    places: Array = np.stack([x, y], axis=-1)[np.hypot(x, y) <= 1]
    return places


def _peak_to_valley(sigmas: dict[int, float]) -> float:
    """Mean peak to valley (um) of figures with these standard deviations."""
    amounts = np.random.default_rng(0).normal(size=(DRAWS, len(sigmas))) * list(sigmas.values())
    x, y = _places().T
    heights = amounts @ zernike_values(x, y, list(sigmas)).T
    return float(np.ptp(heights, axis=1).mean())


def _slope_mrad(sigmas: dict[int, float], rim_mm: float) -> float:
    """Root of the mean square (mrad) of the slope of figures with these standard deviations."""
    squares = 0.0
    for j, sigma in sigmas.items():
        form = MirrorForm((j,), (1.0,)).heights(rim_mm, rim_mm * _places())
        squares += sigma**2 * float((form.gx**2 + form.gy**2).mean())
    return 1e3 * float(np.sqrt(squares))


def figure_of(mirror: Mirror, figure: RandomFigure) -> dict[str, float]:
    """Tolerances of a random figure of a mirror: normal ones, two sigma, by the names of their errors."""
    return {f"mirror.zernike_{j}_um": 2 * sigma for j, sigma in figure.sigmas_um(mirror.rim_radius_mm).items()}


LEAST_UM = 1e-6  # rms: what is smaller is rounding


@checked
def measured_form(mirror: Mirror, path: str | Path, unit: Unit = "mm") -> MirrorForm:
    """The form error that was measured on a mirror, up to Zernike terms of order 12.

    Parameters
    ----------
    mirror
        That was meant.
    path
        Of a cloud or grid of points, as :func:`omnimirror.manufacturing.metrology.readers.read_points` reads them.
    unit
        Of points by the line.

    Returns
    -------
    MirrorForm
        The terms that the points tell, beside the place of the mirror in the machine and their noise.

    Raises
    ------
    OmnimirrorError
        The file is missing or holds no points, or too few.
    InvalidParameter
        The points show no form error at all.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from omnimirror.mirrors import Sphere
    >>> ball, (x, y) = Sphere(50.0, 44.0), (v.ravel() for v in np.meshgrid(*2 * [np.linspace(-31, 31, 41)]))
    >>> z = ball.sag(np.hypot(x, y)) + 1e-3 * np.sqrt(6) * (x**2 - y**2) / 44**2  # 1 um of astigmatism
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.savetxt(f"{folder}/cmm.csv", np.stack([x, y, z], axis=-1), delimiter=",")
    ...     form = measured_form(ball, f"{folder}/cmm.csv")
    >>> round(dict(zip(form.zernike, form.um))[6], 4)
    1.0
    """
    found = form_error(mirror, read_points(path, unit))
    terms = [term for term in found.terms if 1 < term.noll <= TERMS and abs(term.um) > max(term.sigma_um, LEAST_UM)]
    if not terms:
        raise InvalidParameter(f"{path} shows no form error beyond its noise of {found.noise_um:.3g} um")
    return MirrorForm(tuple(term.noll for term in terms), tuple(term.um for term in terms))


@dataclass(frozen=True)
class FormEffect:
    """What a form error does.

    Attributes
    ----------
    meant, made
        Merits of the sensor with the mirror that was meant, and with the one that was made, by name: motions of the
        picture, left after each calibration, and blur. NaN where rays are lost.
    lost_rays
        How many objects of the field the one that was made does not show.
    beyond_um
        rms of the terms that are too fine to be traced here (above order 12), along the axis.
    """

    meant: Mapping[str, float]
    made: Mapping[str, float]
    lost_rays: int
    beyond_um: float

    def to_dict(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "meant": dict(self.meant),
            "made": dict(self.made),
            "lost_rays": self.lost_rays,
            "beyond_um": self.beyond_um,
        }


@checked
def form_effect(sensor: Sensor, form: FormError) -> FormEffect:
    """What a form error does to the picture of a sensor.

    Parameters
    ----------
    sensor
        With the mirror that was meant.
    form
        Of the mirror that was made.

    Returns
    -------
    FormEffect
        By exactly traced rays to objects all over the field, as :func:`omnimirror.tolerance` traces them.

    Raises
    ------
    InvalidParameter
        The form error is that of another mirror, or the sensor is one that tolerances are not computed of.

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
    >>> effect.made["motion_px"] > effect.made["motion_px after affine"] > 0.0
    True
    """
    _check_its_mirror(sensor, form)
    judge, names = Judge.of(sensor), merit_names()
    amounts = {term.noll: term.um for term in form.terms}
    values = {f"mirror.zernike_{j}_um": np.array([0.0, amounts.get(j, 0.0)]) for j in range(1, TERMS + 1)}
    meant, made = (dict(zip(names, row.tolist(), strict=True)) for row in judge.judged(values))
    lost, _ = int(made.pop("lost_rays")), meant.pop("lost_rays")
    beyond = float(np.sqrt(sum(um**2 for j, um in amounts.items() if j > TERMS)))
    return FormEffect(meant, made, lost, beyond)


@checked
def as_made(sensor: Sensor, form: FormError, *, whole: bool = False) -> Sensor:
    """The sensor with its mirror as it was made, to be saved, simulated and straightened with.

    Parameters
    ----------
    sensor
        With the mirror that was meant.
    form
        Of the one that was made.
    whole
        With what is not about the axis too, as its ``mirror_form``; such a sensor has no meridian any more, and rays,
        pictures and straightening are valid for it. By default only with the part about the axis.

    Returns
    -------
    Sensor
        Its mirror a sampled profile, its vertex as far away as the form says.

    Raises
    ------
    InvalidParameter
        The form error is that of another mirror; or the whole of it is asked of a sensor of two mirrors.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> x, y = np.meshgrid(np.linspace(-43, 43, 61), np.linspace(-43, 43, 61))
    >>> inside = np.hypot(x, y) < 43
    >>> points = np.stack([x, y, sensor.mirror.sag(np.minimum(np.hypot(x, y), 43))], axis=-1)[inside]
    >>> made = as_made(sensor, om.form_error(sensor.mirror, points))
    >>> made.mirror.KIND, bool(abs(made.mirror.sag(40.0) - sensor.mirror.sag(40.0)) < 1e-6)
    ('sampled', True)
    """
    _check_its_mirror(sensor, form)
    if whole:
        sensor.check("a mirror with all of its form error", "one mirror")
        beside = {t.noll: t.um for t in form.terms if noll(t.noll)[1] and t.noll <= TERMS}
        sensor = replace(sensor, mirror_form=MirrorForm(tuple(beside), tuple(beside.values())))
    away, pose, second = 1e-3 * form.vertex_um, sensor.mirror_pose, sensor.secondary
    if second is not None:  # two mirrors stand where their distances say
        farther = replace(second, distance_mm=second.distance_mm + away)
        distance = sensor.mirror_distance_mm + away
        return replace(sensor, mirror=form.corrected(), secondary=farther, mirror_distance_mm=distance)
    moved = replace(pose, displacement_mm=pose.displacement_mm + away)
    return replace(sensor, mirror=form.corrected(), mirror_pose=moved)


def _check_its_mirror(sensor: Sensor, form: FormError) -> None:
    if form.mirror != sensor.mirror:
        raise InvalidParameter(f"the form error is that of another mirror than {sensor.name!r} has")
