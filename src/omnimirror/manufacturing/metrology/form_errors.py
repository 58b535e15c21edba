"""Form error of a measured mirror, separated from its alignment and from measurement noise.

Axial heights above the nominal mirror are fitted by Zernike terms over the disc of the rim:
rotationally symmetric terms up to a high order, others up to an order that the data support.
Uncorrelated residuals of neighbouring points are noise; correlated residuals are reported as
unexplained. Effects of a shift or tilt belong to the alignment, also if a form error would explain
them equally well.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import integer, number, row, validate_arguments, vectors
from ...base.caching import cached_property
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.numerics import noll, zernike_terms, zernike_values
from ...base.results import Result
from ...base.typing import Array
from ...optics.mirrors import Mirror, SampledProfile
from ...optics.mirrors.measured import MAD_TO_SIGMA, check_distance, check_spread
from .alignment import Alignment, aligned, distances, is_line, outline_centre
from .forbes import sphere_sag

MIN_POINTS = 200
MIN_PROFILE_POINTS = 50
PER_TERM = 5  # minimum number of points per term
ORDERS = (2, 4, 6, 8, 10, 12)
ABOUT_AXIS = tuple(range(2, 42, 2))  # candidate orders of symmetric terms
PATIENCE = 3  # orders without improvement that end the search
STEADY = 30.0  # maximum condition number
STEADY_OF_PROFILE = 1e4  # maximum condition number for profiles
OUTLIER_SIGMAS = 6.0  # outlier limit in standard deviations
MIN_OUTLIER_MM = 1e-6  # minimum outlier distance, below the accuracy of any machine
ROUNDING = 1e-14  # relative rounding error of sums of squares
CELLS = 12  # sectors, and twice the number of rings, of cells with correlated residuals
AT_A_TIME = 8192  # points per block
PROFILE_POINTS = 401
MIN_TERM_UM = 1e-6  # minimum contribution of a radius error
UM = 1e3


@dataclass(frozen=True)
class FormTerm:
    """Zernike term of a form error.

    Attributes
    ----------
    noll
        Noll index.
    um
        RMS amplitude over the disc, along the axis.
    sigma_um
        Standard uncertainty.
    """

    noll: int
    um: float
    sigma_um: float

    @property
    def name(self) -> str:
        """Common name of the aberration, or radial order and azimuthal frequency."""
        n, m = noll(self.noll)
        return NAMES.get((n, abs(m)), f"order {n}, {f'{abs(m)}-fold' if m else 'about the axis'}")


NAMES = {
    (0, 0): "piston",
    (1, 1): "tilt",
    (2, 0): "power",
    (2, 2): "astigmatism",
    (3, 1): "coma",
    (3, 3): "trefoil",
    (4, 0): "spherical",
    (4, 2): "secondary astigmatism",
    (4, 4): "tetrafoil",
    (5, 1): "secondary coma",
    (6, 0): "secondary spherical",
}


@dataclass(frozen=True)
class FormError(Result):
    """Form error of a measured mirror.

    Attributes
    ----------
    mirror
        Nominal mirror.
    place
        Alignment of the points.
    terms : tuple of FormTerm
        Rotationally symmetric terms, and all others up to :attr:`order`.
    order
        Maximum order of the asymmetric terms.
    outliers
        Number of rejected outliers.
    noise_um
        Standard deviation of uncorrelated residuals, along the normal.
    unexplained_um
        Standard deviation of correlated residuals.
    x_mm, y_mm, height_um, residual_um : (n,)
        Points used: coordinates, axial height above the nominal mirror (positive away from the lens),
        and residual after subtraction of the terms.

    Examples
    --------
    >>> import omnimirror as om
    >>> mirror = om.load_sensor("paper-spherical").mirror
    >>> x, y = (v.ravel() for v in np.meshgrid(np.linspace(-30, 30, 31), np.linspace(-30, 30, 31)))
    >>> form = om.form_error(mirror, np.stack([x, y, mirror.sag(np.hypot(x, y))], axis=-1))
    >>> form.rms_um < 1e-6, form.outliers
    (True, 0)
    """

    mirror: Mirror
    place: Alignment
    terms: tuple[FormTerm, ...]
    order: int
    outliers: int
    noise_um: float
    unexplained_um: float
    x_mm: Array = field(repr=False)
    y_mm: Array = field(repr=False)
    height_um: Array = field(repr=False)
    residual_um: Array = field(repr=False)

    def at(self, x_mm: ArrayLike, y_mm: ArrayLike) -> Array:
        """Evaluate the terms at points of the mirror.

        Parameters
        ----------
        x_mm, y_mm : (n,)
            Coordinates in the mirror frame.

        Returns
        -------
        (n,) array
            Axial form error in um, positive away from the lens; NaN beyond the rim.

        Raises
        ------
        InvalidParameter
            If the coordinates differ in length.
        """
        rim = self.mirror.rim_radius_mm
        x, y = (row(name, value) / rim for name, value in (("x_mm", x_mm), ("y_mm", y_mm)))
        if len(x) != len(y):
            raise InvalidParameter(
                f"x_mm and y_mm must have equal lengths; got {len(x)} and {len(y)}"
            )
        inside = np.hypot(x, y) <= 1 + 1e-9
        values = zernike_values(x[inside], y[inside], [term.noll for term in self.terms])
        form = np.full(len(x), np.nan)
        form[inside] = values @ np.array([term.um for term in self.terms])
        return form

    @cached_property
    def _map(self) -> tuple[Array, Array]:
        """Form error on a grid over the mirror: total and rotationally symmetric part."""
        axis = np.linspace(-1.0, 1.0, 201)
        x, y = np.meshgrid(axis, axis)
        inside = x**2 + y**2 <= 1
        terms = [term.noll for term in self.terms]
        values = zernike_values(x[inside], y[inside], terms) * np.array(
            [term.um for term in self.terms]
        )
        about = np.array([noll(j)[1] == 0 for j in terms])
        return values.sum(axis=1), values[:, about].sum(axis=1)

    @property
    def radius_mm(self) -> float | None:
        """Radius of the best-fit sphere; None for aspheres."""
        return self.place.radius_mm

    @property
    def rms_um(self) -> float:
        """RMS of the terms over the disc, without their mean."""
        return float(self._map[0].std())

    @property
    def peak_to_valley_um(self) -> float:
        """Peak-to-valley value of the terms over the disc."""
        return float(np.ptp(self._map[0]))

    @property
    def rotational_rms_um(self) -> float:
        """RMS of the rotationally symmetric terms."""
        return float(self._map[1].std())

    @property
    def radial_range_mm(self) -> tuple[float, float]:
        """Minimum and maximum distance of a point from the axis."""
        r = np.hypot(self.x_mm, self.y_mm)
        return float(r.min()), float(r.max())

    @property
    def vertex_um(self) -> float:
        """Axial displacement of the vertex by the rotationally symmetric terms."""
        about = [term for term in self.terms if noll(term.noll)[1] == 0]
        return float(
            (zernike_values([0.0], [0.0], [t.noll for t in about]) @ [t.um for t in about])[0]
        )

    def corrected(self) -> SampledProfile:
        """Return the as-built mirror with its rotationally symmetric terms.

        Heights refer to its own vertex; :attr:`vertex_um` is the displacement from the nominal vertex.

        Returns
        -------
        SampledProfile
            Profile of the nominal mirror and the symmetric terms.
        """
        mirror, about = self.mirror, [term for term in self.terms if noll(term.noll)[1] == 0]
        x = np.linspace(0.0, mirror.rim_radius_mm, PROFILE_POINTS)
        values = zernike_values(x / mirror.rim_radius_mm, 0 * x, [t.noll for t in about]) @ [
            t.um for t in about
        ]
        z = mirror.sag(x) + (values - self.vertex_um) / UM
        apex = "pointed" if mirror.is_pointed else "smooth"
        return SampledProfile(
            tuple(map(float, x)), tuple(map(float, z)), apex=apex, uncertainty_um=0.0
        )


@validate_arguments
def form_error(
    mirror: Mirror,
    points_mm: ArrayLike,
    *,
    order: int | None = None,
    are_departures: bool = False,
    probe_radius_mm: float = 0.0,
) -> FormError:
    """Estimate the form error of a mirror from measured points.

    The rotation of a sphere about its centre is undetermined: the machine axes are used, or the outline of
    the points is centred if it is decentred. The radius of a sphere is estimated.

    Parameters
    ----------
    mirror
        Nominal mirror.
    points_mm : (n, 3), or (n, 2) for a profile
        Points in the machine frame, at least 200, or 50 of a profile through the axis.
    order : optional
        Maximum order of the asymmetric terms; selected by the Schwarz criterion by default.
    are_departures
        Whether the third column is the departure from the nominal mirror along its normal.
    probe_radius_mm
        Radius of the probe, if the points are centres of the probe ball.

    Returns
    -------
    FormError
        Terms with uncertainties, alignment, noise and residuals.

    Raises
    ------
    OmnimirrorError
        If the points do not match the mirror or do not determine the terms.
    InvalidParameter
        If an argument is out of range.

    Examples
    --------
    Half a micrometre of astigmatism on a sphere, measured 2 mm off the machine's axis:

    >>> from omnimirror.optics.mirrors import Sphere
    >>> rng, ball = np.random.default_rng(1), Sphere(50.0, 40.0)
    >>> r, phi = 40 * np.sqrt(rng.uniform(0, 1, 4000)), rng.uniform(0, 2 * np.pi, 4000)
    >>> x, y = r * np.cos(phi), r * np.sin(phi)
    >>> bump = 0.5e-3 * np.sqrt(6) * (x**2 - y**2) / 40**2
    >>> found = form_error(ball, np.stack([x + 2, y, ball.sag(r) + bump + 1e-4 * rng.normal(size=4000)], axis=-1))
    >>> [(term.name, round(term.um, 2)) for term in found.terms if abs(term.um) > 0.02]
    [('astigmatism', 0.5)]
    """
    probe_radius_mm = number("probe_radius_mm", probe_radius_mm, low=0.0, unit="mm")
    if order is not None:
        order = integer("order", order, 2, ORDERS[-1])
    points, what = _checked_points(mirror, points_mm, order, are_departures, probe_radius_mm)
    alignment = aligned(mirror, points, f"the {what}", probe_radius_mm)
    everything = _Heights.of(mirror, alignment)
    sphere = None if alignment.radius_mm is None else _Sphere.of(mirror, alignment)
    if sphere is not None:
        everything = sphere.less(everything)
    part = everything.those(np.isfinite(alignment.distance_mm))
    inside, equations = len(part.x), _Gram.of(part)
    while True:
        fit = equations.of_profile() if alignment.is_profile else equations.chosen(order)
        residual = part.distance - part.modelled(fit.terms, fit.values)
        far = np.abs(residual) > max(
            OUTLIER_SIGMAS * MAD_TO_SIGMA * float(np.median(np.abs(residual))), MIN_OUTLIER_MM
        )
        if not far.any():
            break
        equations, part = equations.less(_Gram.of(part.those(far))), part.those(~far)
    noise, shared = _noise(part, residual, len(fit.terms))
    sigmas = _sigmas(part, fit, residual, noise)
    amounts = {
        j: (UM * v, UM * s)
        for j, v, s in zip(fit.terms, fit.values.tolist(), sigmas.tolist(), strict=True)
    }
    rim, heights = mirror.rim_radius_mm, UM * part.distance / part.up
    if sphere is not None:
        amounts = sphere.added_to(amounts)
        heights = heights + UM * sphere.departure(np.hypot(part.x, part.y))
    terms = tuple(FormTerm(j, *amounts[j]) for j in sorted(amounts))
    return FormError(
        mirror,
        alignment,
        terms,
        fit.order,
        inside - len(part.x),
        UM * noise,
        UM * shared,
        part.x * rim,
        part.y * rim,
        heights,
        UM * residual / part.up,
    )


def _checked_points(
    mirror: Mirror,
    points_mm: ArrayLike,
    order: int | None,
    are_departures: bool,
    probe_radius_mm: float,
) -> tuple[Array, str]:
    """Return points (n, 3), mm, and their name for messages, "profile" or "cloud"."""
    try:
        is_profile = np.shape(points_mm)[1:] == (2,)
    except ValueError:  # rows of different lengths, which `vectors` rejects
        is_profile = False
    points = vectors("points_mm", points_mm, 2 if is_profile else 3, is_list=True)
    points = points[np.isfinite(points).all(axis=-1)]
    if are_departures and (is_profile or probe_radius_mm):
        what = "points (n, 2)" if is_profile else f"probe_radius_mm = {probe_radius_mm:g}"
        raise InvalidParameter(
            f"are_departures requires departures (x, y, departure) of the surface itself; got {what}"
        )
    if is_profile:
        points = np.insert(points, 1, 0.0, axis=1)
    if not is_profile:
        check_distance(points, "the cloud")
        is_profile = len(points) > 1 and is_line(points)
        if are_departures and is_profile:
            raise OmnimirrorError(
                "departures must cover an area of the mirror; got points on one line; measure the "
                "whole surface, or analyse a profile of points (x, z)"
            )
    fewest, what = (MIN_PROFILE_POINTS, "profile") if is_profile else (MIN_POINTS, "cloud")
    if len(points) < fewest:
        raise OmnimirrorError(f"the {what} must have at least {fewest} points; got {len(points)}")
    if is_profile and order is not None:
        raise InvalidParameter(f"order must be None for a profile; got {order}")
    if not is_profile:
        check_spread(points, "the cloud")
    if are_departures:
        points = _risen(mirror, points)
        check_spread(points, "the cloud within the rim")
    return points, what


def _risen(mirror: Mirror, departures: Array) -> Array:
    """Convert departures along the normal to points; a null test does not determine the mean
    departure.
    """
    points = departures - np.append(outline_centre(departures), np.median(departures[:, 2]))
    r = np.hypot(points[:, 0], points[:, 1])
    points = points[r <= mirror.rim_radius_mm]
    sag, slope, _ = mirror.profile(np.hypot(points[:, 0], points[:, 1]))
    heights = sag + points[:, 2] * np.sqrt(1 + slope**2)
    return np.column_stack([points[:, :2], heights])


class _Sphere(NamedTuple):
    """Best-fit sphere of a spherical mirror; Zernike terms describe only the residual."""

    radius: float
    sigma: float
    nominal: float
    rim: float

    @classmethod
    def of(cls, mirror: Mirror, alignment: Alignment) -> _Sphere | None:
        """Return the best-fit sphere, or None if it ends inside the rim."""
        assert alignment.radius_mm is not None
        assert alignment.radius_sigma_mm is not None
        rim = mirror.rim_radius_mm
        if abs(alignment.radius_mm) <= rim * (1 + 1e-6):
            return None
        return cls(alignment.radius_mm, alignment.radius_sigma_mm, float(mirror.radius_t(0.0)), rim)

    def departure(self, rho: Array, more: float = 0.0) -> Array:
        """Return heights (n,) in mm above the nominal sphere at normalised radii (n,); ``more`` is
        added to R.
        """
        x = rho * self.rim
        return sphere_sag(x, self.radius + more) - sphere_sag(x, self.nominal)

    def less(self, heights: _Heights) -> _Heights:
        """Convert distances from the nominal sphere to distances from the best-fit sphere."""
        rho = np.hypot(heights.x, heights.y)
        up = np.sqrt(np.maximum(1 - (rho * self.rim / self.radius) ** 2, 0.0))
        distance = (heights.distance / heights.up - self.departure(np.minimum(rho, 1.0))) * up
        return _Heights(heights.x, heights.y, distance, up)

    def added_to(self, amounts: dict[int, tuple[float, float]]) -> dict[int, tuple[float, float]]:
        """Add the departure of the best-fit sphere to amplitudes and uncertainties (um) of the
        terms.
        """
        terms = _terms(0, ABOUT_AXIS[-1])
        rho = np.sin(np.linspace(0.0, np.pi / 2, PROFILE_POINTS))
        values = zernike_values(rho, 0 * rho, terms)
        right = np.stack(
            [self.departure(rho), self.departure(rho, self.sigma) - self.departure(rho)], axis=1
        )
        result = UM * np.linalg.lstsq(values, right, rcond=None)[0]
        result[0] -= (
            result[:, 0] @ zernike_values(np.zeros(1), np.zeros(1), terms)[0] * np.array([1.0, 0.0])
        )
        added = dict(amounts)
        for j, (um, sigma) in zip(terms, result.tolist(), strict=True):
            before, spread = added.get(j, (0.0, 0.0))
            if j in added or abs(um) > MIN_TERM_UM:
                added[j] = before + um, float(np.hypot(spread, sigma))
        return added


# -- fit -------------------------------------------------------------------------------------------------


class _Heights(NamedTuple):
    """Normalised coordinates (n,), normal distances in mm, and cosines of the slope angle."""

    x: Array
    y: Array
    distance: Array
    up: Array

    @classmethod
    def of(cls, mirror: Mirror, alignment: Alignment) -> _Heights:
        rim = mirror.rim_radius_mm
        _, normal, _ = distances(mirror, alignment.points)
        return cls(
            alignment.points[:, 0] / rim,
            alignment.points[:, 1] / rim,
            alignment.distance_mm,
            normal[:, 2],
        )

    def those(self, retained: NDArray[np.bool_]) -> _Heights:
        return _Heights(*(column[retained] for column in self))

    def bases(self, terms: list[int]) -> Iterator[tuple[slice, Array]]:
        """Yield the distances per unit of each term, (m, t), in blocks that fit the cache."""
        for start in range(0, len(self.x), AT_A_TIME):
            some = slice(start, start + AT_A_TIME)
            yield some, self.up[some, None] * zernike_values(self.x[some], self.y[some], terms)

    def modelled(self, terms: list[int], values: Array) -> Array:
        """Return the distances (n,) of given terms."""
        return np.concatenate([basis @ values for _, basis in self.bases(terms)])


class _Fit(NamedTuple):
    order: int
    terms: list[int]
    values: Array
    inverse: Array
    """Inverse (t, t) of the normal equations."""


@dataclass(frozen=True)
class _Gram:
    """Normal equations of all candidate terms; subsets of terms use submatrices."""

    terms: list[int]
    matrix: Array
    right: Array
    squares: float
    count: int

    @classmethod
    def of(cls, part: _Heights) -> _Gram:
        terms = _terms(ORDERS[-1], ABOUT_AXIS[-1])
        matrix, right = np.zeros((len(terms), len(terms))), np.zeros(len(terms))
        for some, basis in part.bases(terms):
            matrix += basis.T @ basis
            right += basis.T @ part.distance[some]
        return cls(terms, matrix, right, float(part.distance @ part.distance), len(part.x))

    def less(self, other: _Gram) -> _Gram:
        """Subtract the contribution of some points."""
        return _Gram(
            self.terms,
            self.matrix - other.matrix,
            self.right - other.right,
            self.squares - other.squares,
            self.count - other.count,
        )

    def chosen(self, order: int | None) -> _Fit:
        """Select the fit by the Schwarz criterion, for a given order or all orders.

        Raises
        ------
        OmnimirrorError
            If the points do not determine the terms.
        """
        best = self._best((n, n) for n in (ORDERS if order is None else (order,)))
        if best is None:
            valid = [n for n in ORDERS if self._fit(n, n) is not None]
            advice = f"; use order {valid[-1]}" if valid else ": gaps are too large"
            raise OmnimirrorError(
                f"the points do not determine terms up to order {order or ORDERS[0]}{advice}"
            )
        again = self._best((best.order, n) for n in ABOUT_AXIS if n >= best.order)
        return again or best

    def of_profile(self) -> _Fit:
        """Select the fit of rotationally symmetric terms.

        Raises
        ------
        OmnimirrorError
            If the points do not determine the terms.
        """
        best = self._best(((0, n) for n in ABOUT_AXIS), STEADY_OF_PROFILE)
        if best is None:
            raise OmnimirrorError("the profile must cover more of the mirror to determine its form")
        return best

    def _best(self, orders: Iterable[tuple[int, int]], steady: float = STEADY) -> _Fit | None:
        result: list[tuple[float, _Fit]] = []
        for order, about_axis in orders:
            fit = self._fit(order, about_axis, steady)
            if fit is None:
                break
            result.append((self._price(fit), fit))
            if len(result) - int(np.argmin([price for price, _ in result])) > PATIENCE:
                break
        return min(result, key=lambda one: one[0])[1] if result else None

    def _fit(self, order: int, about_axis: int, steady: float = STEADY) -> _Fit | None:
        """Solve for the terms; None if they are ill-conditioned."""
        terms = _terms(order, about_axis)
        if PER_TERM * len(terms) > self.count:
            return None
        at = np.searchsorted(self.terms, terms)
        matrix = self.matrix[np.ix_(at, at)]
        sizes = np.linalg.eigvalsh(matrix)
        if sizes[-1] > steady**2 * sizes[0]:
            return None
        inverse = np.asarray(np.linalg.inv(matrix), dtype=float)
        return _Fit(order, terms, inverse @ self.right[at], inverse)

    def _price(self, fit: _Fit) -> float:
        """Return the Schwarz criterion (BIC) of a fit."""
        at = np.searchsorted(self.terms, fit.terms)
        residual = max(
            self.squares - float(fit.values @ self.right[at]), ROUNDING * self.squares, 1e-300
        )
        return self.count * float(np.log(residual)) + len(fit.terms) * float(np.log(self.count))


def _terms(order: int, about_axis: int) -> list[int]:
    """Return Noll indices of all terms up to an order, and of symmetric terms up to another.

    >>> _terms(2, 4)
    [1, 2, 3, 4, 5, 6, 11]
    """
    return sorted(
        {
            *range(1, zernike_terms(order) + 1),
            *(zernike_terms(n - 1) + 1 for n in range(2, about_axis + 1, 2)),
        }
    )


def _noise(part: _Heights, residual: Array, terms: int) -> tuple[float, float]:
    """Return standard deviations (mm) of uncorrelated and correlated residuals of neighbouring
    points.
    """
    from scipy.spatial import KDTree

    positions = np.stack([part.x, part.y], axis=-1)
    beside = KDTree(positions).query(positions, k=2)[1][:, 1]
    noise = MAD_TO_SIGMA * float(np.median(np.abs(residual - residual[beside]))) / np.sqrt(2)
    whole_variance = float((residual**2).sum()) / max(len(residual) - terms, 1)
    return float(noise), float(np.sqrt(max(whole_variance - noise**2, 0.0)))


def _sigmas(part: _Heights, fit: _Fit, residual: Array, noise: float) -> Array:
    """Compute standard uncertainties (t,) in mm of the terms by a cluster-robust estimate.

    Residuals within one cell of the mirror may be correlated; those of different cells are
    independent. The uncertainty is at least that of uncorrelated noise.
    """
    ring = np.minimum((part.x**2 + part.y**2) * CELLS / 2, CELLS / 2 - 1).astype(
        int
    )  # rings of equal area
    sector = (np.floor((np.arctan2(part.y, part.x) / (2 * np.pi)) * CELLS) % CELLS).astype(int)
    cell = ring * CELLS + sector
    scores = np.zeros((CELLS * CELLS // 2, len(fit.terms)))
    for some, basis in part.bases(fit.terms):
        np.add.at(scores, cell[some], basis * residual[some, None])
    together = (((scores @ fit.inverse) ** 2).sum(axis=0)) * len(scores) / (len(scores) - 1)
    return np.asarray(np.sqrt(np.maximum(together, noise**2 * np.diag(fit.inverse))))
