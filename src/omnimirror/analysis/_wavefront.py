"""Wavefront over the aperture: phase, aberrations, light density and edges (polynomial fits)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.caching import cached_property
from ..base.errors import InvalidParameter
from ..base.typing import Array
from ..optics.lenses import FieldLens, GaussianLens, TabulatedLens
from ..optics.sensor import Sensor
from .ray_bundles import Bundles, gaussian

# -- Polynomial fits over the aperture -------------------------------------------------------------

FITTED_RINGS = 12  # rings of the fitted pupil
DEGREE = 10

FITTED = gaussian(FITTED_RINGS)
"""Pupil of the fitted rays."""


def polynomial_basis(points: Array) -> Array:
    """Return products of Chebyshev polynomials (n, terms) at points (n, 2) of the disc."""
    x, y = (np.polynomial.chebyshev.chebvander(c, DEGREE) for c in points.T)
    i, j = polynomial_orders()
    return x[:, i] * y[:, j]


def polynomial_orders() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the orders (terms,), (terms,) in x and y of the products."""
    i, j = np.indices((DEGREE + 1, DEGREE + 1)).reshape(2, -1)
    low = i + j <= DEGREE
    return i[low], j[low]


@cache
def fit_matrix() -> Array:
    """Return the linear map (terms, n) from values at the fitted pupil to coefficients."""
    return fit_matrix_at(FITTED.points)


def fit_matrix_at(points: Array) -> Array:
    """Return the linear map (terms, n) from values at displaced points (n, 2) to coefficients."""
    root = np.sqrt(FITTED.weights)
    inverse = np.linalg.pinv(root[:, None] * polynomial_basis(points)) * root
    return inverse.astype(np.float64)


@cache
def basis_slopes() -> tuple[Array, Array]:
    """Return derivatives (n, terms), (n, terms) of the products by x and y at the fitted pupil."""
    rotated = np.polynomial.chebyshev.chebder(np.eye(DEGREE + 1))
    (x, y), (dx, dy) = (
        [make(c) for c in FITTED.points.T]
        for make in (
            lambda c: np.polynomial.chebyshev.chebvander(c, DEGREE),
            lambda c: np.polynomial.chebyshev.chebvander(c, DEGREE - 1) @ rotated,
        )
    )
    i, j = polynomial_orders()
    by_x: Array = dx[:, i] * y[:, j]
    by_y: Array = x[:, i] * dy[:, j]
    return by_x, by_y


@cache
def integration_matrix() -> Array:
    """Return the linear map (terms, 2 n) from x and y derivatives to coefficients."""
    root = np.tile(np.sqrt(FITTED.weights), 2)
    inverse: Array = np.linalg.pinv(root[:, None] * np.concatenate(basis_slopes())) * root
    return inverse


# -- Wavefront of a real lens over direction cosines at the imager ---------------------------------
#
# Rays are normal to the wavefront. Relative to the reference sphere about the image point of the
# chief ray, a ray with the transverse aberration eps has the phase lag W, with ``dW = -eps . dL``,
# where L are the direction cosines of the rays at the imager. In these coordinates the field at the
# imager is a Fourier integral. For a lens made of surfaces, both are traced, and W and L are exact; a
# table provides them to first order in the aperture.

EDGE_AZIMUTHS = 2 * np.pi * np.arange(96) / 96  # azimuths of the edge of the stop
MAX_ELLIPSE_DEVIATION = (
    2e-3  # relative to the radius: largest deviation of a section treated as an ellipse
)


class PupilLight(NamedTuple):
    """Cone of light behind a real lens: section in direction cosines, scaled to the unit disc."""

    points: Array
    """Tangential and sagittal coordinates (n, 2) of rays in the section."""
    area_ratios: Array
    """Ratio (n,) of aperture area to section area."""
    f_numbers: tuple[float, float]
    """Tangential and sagittal F-number of the disc."""
    stop: Array | None
    """Clearance (n,) at the stop edge, in stop radii, for a non-elliptical section, or None."""


def check_wave_is_known(lens: FieldLens) -> None:
    """Check that a lens table contains no lens blur of unknown shape."""
    blurs = (lens.own_blur_t_mm, lens.own_blur_s_mm) if isinstance(lens, TabulatedLens) else ()
    if any(blur is not None and any(blur) for blur in blurs):
        raise InvalidParameter(
            "PSF and MTF require the wavefront of the lens; a table with own_blur_t_mm and "
            "own_blur_s_mm defines only the size of its blur; use a table without them, or "
            "a lens given by its surfaces"
        )


def phase_of_real_lens(cosines: Array, aberrations: Array) -> tuple[Array, Array]:
    """Return W (k, n), mm, from transverse aberrations (k, n, 2) mm, and its roughness (k,), mm.

    The roughness is the residual slope of the polynomial fit divided by its degree, the RMS of a
    wave of the next degree with this slope.

    Parameters
    ----------
    cosines, aberrations : (k, n, 2) arrays
        Direction cosines of the rays at the imager, and their positions relative to the chief rays.
    """
    derivatives = basis_slopes()
    coefficients = np.einsum("tn,knc->ktc", fit_matrix(), cosines)
    # (2, k, n): derivatives with respect to x and y of the aperture
    slopes = np.stack(
        [
            -np.einsum("knc,nt,ktc->kn", aberrations, rate, coefficients, optimize=True)
            for rate in derivatives
        ]
    )
    k, n = aberrations.shape[:2]
    phase_coefficients = np.einsum(
        "tm,km->kt", integration_matrix(), slopes.transpose(1, 0, 2).reshape(k, 2 * n)
    )
    phase = np.einsum("nt,kt->kn", polynomial_basis(FITTED.points), phase_coefficients)
    residuals = [
        np.einsum("nt,kt->kn", rate, phase_coefficients) - slope
        for rate, slope in zip(derivatives, slopes, strict=True)
    ]
    rough = np.sqrt((residuals[0] ** 2 + residuals[1] ** 2) @ FITTED.weights) / DEGREE
    return phase, rough


def cone_of_light(cosines: Array, at_stop: Array, axes: Array) -> PupilLight:
    """Return the cone of light of one object from the rays at :data:`FITTED`.

    Parameters
    ----------
    cosines : (n, 2) array
        Direction cosines at the imager.
    at_stop : (n, 2) array
        Positions in the stop, in stop radii.
    axes : (2, 2) array
        Unit vectors of the tangential and the sagittal direction.
    """
    tangential, sagittal = (rate @ fit_matrix() @ cosines for rate in basis_slopes())
    area = np.abs(tangential[:, 0] * sagittal[:, 1] - tangential[:, 1] * sagittal[:, 0])
    cosines = cosines @ axes.T
    edge = (
        polynomial_basis(np.stack([np.cos(EDGE_AZIMUTHS), np.sin(EDGE_AZIMUTHS)], axis=-1))
        @ fit_matrix_at(at_stop)
        @ cosines
    )
    low, high = edge.min(axis=0), edge.max(axis=0)
    centre, half = (low + high) / 2, (high - low) / 2
    radii = np.hypot(*((edge - centre) / half).T)
    stop = None
    if np.ptp(radii) > 2 * MAX_ELLIPSE_DEVIATION:
        half = half * radii.max()
        stop = (1 - (at_stop**2).sum(axis=1)) / 2
    points = (cosines - centre) / half
    t, s = 1 / (2 * half)
    return PupilLight(points, half[0] * half[1] / area, (float(t), float(s)), stop)


# -- Wavefront over the aperture -------------------------------------------------------------------
#
# Rays through a few hundred points of the aperture are fitted with polynomials, which can then be
# integrated exactly because these functions are smooth. The phase is the optical path length minus
# that of the reference wave to the image point of the chief ray (an ideal thin lens contributes
# equally to both); its slopes are the transverse aberrations: ``dW/d(rho) = -eps / (2 F)`` with the
# working F-number in that direction. For a real lens these slopes are known, and the phase is their
# integral.

# Divided by the nodes: width of softened edges in radii, the largest distance of neighbouring nodes
EDGE_SOFTNESS = 5.0
CUT_NODES = 128  # per side, of integrals over a vignetted aperture
# Points for which matrix products justify BLAS
MIN_BLAS_POINTS = 4096
# Relative to the range of its clearance: an edge with a larger clearance of all rays does not vignette
MIN_CLEARANCE = 0.1
MAX_PHASE_RESIDUAL = 0.02  # wavelengths of 550 nm: largest rms residual of the phase
PHASE, LANDING, DENSITY, EDGES = 0, (1, 2), 3, 4  # fitted columns; edges from the last index


@dataclass(frozen=True)
class Wavefront:
    """Wavefront of one object, as functions of the tangential and sagittal aperture coordinates.

    Attributes
    ----------
    coefficients : (terms, 4 + edges)
        Coefficients of phase W (mm), position t and s (mm from the chief ray), light density, and
        the clearance (mm) at each vignetting edge.
    f_numbers
        Working F-numbers of the cone of light at the imager, tangential and sagittal.
    """

    coefficients: Array
    f_numbers: tuple[float, float]

    def at(self, points: Array, soft: float = 0.0) -> tuple[Array, Array, Array]:
        """Return phase (n,) mm, positions (n, 2) mm and light (n,) at points (n, 2) of the disc.

        Vignetted points have no light. The edge may be softened over a fraction of the aperture
        radius, for continuous sums over points at this distance.
        """
        x, y = self._polynomials(points)
        t, s = (self._value(column, x, y) for column in LANDING)
        return self._value(PHASE, x, y), np.stack([t, s], axis=-1), self._light(x, y, soft)

    def light(self, points: Array, soft: float = 0.0) -> Array:
        """Return the light (n,) at points (n, 2); softening an edge preserves its integral."""
        return self._light(*self._polynomials(points), soft)

    def phase_and_amplitude(self, points: Array, soft: float = 0.0) -> tuple[Array, Array]:
        """Return phase (n,) mm and amplitude (n,); softening an edge preserves its integral."""
        x, y = self._polynomials(points)
        light = np.maximum(self._value(DENSITY, x, y), 0.0)
        return self._value(PHASE, x, y), np.sqrt(light) * self._transmission(x, y, soft)

    def on_grid(self, centres: Array) -> tuple[Array, Array, Array]:
        """Return phase, mm, light density and unvignetted fraction of a square grid, (n, n) by t
        and s.

        Parameters
        ----------
        centres : (n,) array
            Coordinates of the cell centres, evenly spaced.
        """
        polynomials, cell = (
            np.polynomial.chebyshev.chebvander(centres, DEGREE),
            centres[1] - centres[0],
        )
        phase, density, *edges = (
            polynomials @ self._square(column) @ polynomials.T
            for column in (PHASE, DENSITY, *self._edges)
        )
        open_fraction = _softened(1 - np.hypot(centres[:, None], centres), cell)
        for clearance, slope in zip(edges, self._edge_slopes, strict=True):
            open_fraction *= _softened(clearance, cell * slope)
        return phase, np.maximum(density, 0.0), open_fraction

    @property
    def _edges(self) -> range:
        """Column indices of the edges."""
        return range(EDGES, self.coefficients.shape[1])

    def _square(self, column: int) -> Array:
        """Return the coefficients (orders, orders) of a fitted function by orders in t and s."""
        square = np.zeros((DEGREE + 1, DEGREE + 1))
        square[polynomial_orders()] = self.coefficients[:, column]
        return square

    def _polynomials(self, points: Array) -> tuple[Array, Array]:
        """Return Chebyshev polynomials (n, orders), (n, orders) of both coordinates."""
        t, s = (np.polynomial.chebyshev.chebvander(c, DEGREE) for c in points.T)
        return t, s

    def _light(self, x: Array, y: Array, soft: float) -> Array:
        light: Array = np.maximum(self._value(DENSITY, x, y), 0.0) * self._transmission(x, y, soft)
        return light

    def _transmission(self, x: Array, y: Array, soft: float) -> Array:
        """Return the transmission (n,) of all edges: 1 or 0, with a ramp over softened edges."""
        passed = np.ones(len(x))
        for column, slope in zip(self._edges, self._edge_slopes, strict=True):
            clearance = self._value(column, x, y)
            passed *= _softened(clearance, soft * slope) if soft else clearance >= 0
        return passed

    def _value(self, column: int, x: Array, y: Array) -> Array:
        """Return a fitted function (n,) from Chebyshev polynomials (n, orders) in t and s."""
        square = self._square(column)
        # for few points, starting BLAS threads takes longer than the product
        along = x @ square if len(x) > MIN_BLAS_POINTS else np.einsum("ni,ij->nj", x, square)
        value: Array = np.einsum("nj,nj->n", along, y)
        return value

    @cached_property
    def _edge_slopes(self) -> list[float]:
        """RMS gradient of the clearance at each edge, where it is near 0, mm per aperture radius."""
        slopes = []
        for column in self.coefficients.T[EDGES:]:
            by_x, by_y = (rate @ column for rate in basis_slopes())
            near_edge = np.argsort(np.abs(polynomial_basis(FITTED.points) @ column))[
                : len(by_x) // 10
            ]
            slopes.append(float(np.sqrt(np.mean(by_x[near_edge] ** 2 + by_y[near_edge] ** 2))))
        return slopes

    @property
    def is_vignetted(self) -> bool:
        """True if an edge vignettes the aperture."""
        return len(self._edges) > 0

    def nodes(self, wavelength_mm: float) -> int:
        """Return the nodes per side for integrals over the disc, according to the phase range."""
        return int(
            np.clip(24 + 2 * self.waves(wavelength_mm), CUT_NODES if self.is_vignetted else 32, 400)
        )

    def waves(self, wavelength_mm: float) -> float:
        """Return the range of the phase over the aperture, in wavelengths."""
        phase = polynomial_basis(FITTED.points) @ self.coefficients[:, PHASE]
        return float(np.ptp(phase)) / wavelength_mm


def wavefronts(bundles: Bundles, focus_mm: float) -> list[Wavefront]:
    """Return the wavefronts of k objects, with bundles that fill the pupil :data:`FITTED`.

    Raises
    ------
    InvalidParameter
        If the wavefront is too rough for the polynomial fit.
    """
    sensor = bundles.focused_at(focus_mm)
    turn = bundles.axes()
    chief = bundles.chief_mm(sensor)
    aberrations = bundles.image_mm(sensor) - chief[:, None]
    landing = np.einsum("knc,kac->kna", aberrations, turn)
    edges = bundles.clearances()
    lens, cosines, at_stop = sensor.lens, np.empty(0), np.empty(0)
    if isinstance(lens, FieldLens):
        check_wave_is_known(lens)
        rays = bundles.facing_points - sensor.lens_offset, bundles.to_pupils
        cosines, at_stop = lens.image_cosines(*rays), lens.stop_points(*rays)
        phase, rough = phase_of_real_lens(cosines, aberrations)
    else:
        phase = _phase(bundles, sensor, chief)
        rough = _misfit(phase)
    waves = []
    for i in range(len(chief)):
        if not rough[i] <= MAX_PHASE_RESIDUAL * 550e-6:
            raise InvalidParameter(
                "the wavefront must be smooth for PSF and MTF: at omega = "
                f"{bundles.omega_deg[i]:.10g} deg, a polynomial of degree {DEGREE} has a "
                f"residual of {rough[i] / 550e-6:.2g} waves; reduce the aperture or use a "
                "smoother mirror"
            )
        cut = [_bounded(edge[i]) for edge in edges.values() if _vignettes(edge[i])]
        columns = np.column_stack([phase[i], landing[i], bundles.density[i], *cut])
        points = FITTED.points @ turn[i].T
        if isinstance(lens, FieldLens):
            cone = cone_of_light(cosines[i], at_stop[i], turn[i])
            points, f_numbers = cone.points, cone.f_numbers
            columns[:, DENSITY] *= cone.area_ratios
            if cone.stop is not None:
                columns = np.column_stack([columns, cone.stop])
        else:
            f_numbers = working_f_numbers(sensor, float(np.hypot(*chief[i])))
        waves.append(Wavefront(fit_matrix_at(points) @ columns, f_numbers))
    return waves


def _softened(clearance: Array, width: Array | float) -> Array:
    """Return the transmission of an edge with a linear ramp, 0.5 at the edge."""
    ramp: Array = np.clip(0.5 + clearance / width, 0.0, 1.0)
    return ramp


def _vignettes(clearance: Array) -> bool:
    """Return whether an edge vignettes the aperture, from the clearance (n,) at fitted points."""
    is_known = clearance[np.isfinite(clearance)]
    return bool(is_known.size and is_known.min() < MIN_CLEARANCE * np.ptp(is_known))


def _bounded(clearance: Array) -> Array:
    """Return a clearance (n,) with the infinite values, of rays that never meet the edge, replaced
    by the largest finite one.
    """
    return np.where(
        np.isposinf(clearance),
        np.max(clearance, where=np.isfinite(clearance), initial=0.0),
        clearance,
    )


def _misfit(phase: Array) -> Array:
    """Return the rms residual (k,) in mm of the polynomial fit of phases (k, n)."""
    misfit = phase - np.einsum(
        "nt,tm,km->kn", polynomial_basis(FITTED.points), fit_matrix(), phase, optimize=True
    )
    return np.asarray(np.sqrt(misfit**2 @ FITTED.weights))


def working_f_numbers(sensor: Sensor, height_mm: float) -> tuple[float, float]:
    """Return tangential and sagittal F-number (F_w / cos^3, F_w / cos) at an image height.

    Magnification by distortion reduces the cone by the same factor. The cone of a real lens follows
    from its rays (:func:`~omnimirror.analysis._wavefront.cone_of_light`).
    """
    F = sensor.lens.image_f_number()
    if not isinstance(sensor.lens, GaussianLens):
        return F, F
    ideal = sensor.lens.undistorted_height(np.array(height_mm))
    wider_t, wider_s = map(float, sensor.lens.stretch(ideal))
    cos = float(np.cos(np.arctan(ideal / sensor.lens.principal_distance)))
    return wider_t * F / cos**3, wider_s * F / cos


def _phase(bundles: Bundles, sensor: Sensor, chief_mm: Array) -> Array:
    """Return W (k, n), mm: path to each aperture point minus that of the conjugate point."""
    train = sensor.optical_train
    in_focus = _conjugate(sensor, chief_mm) + train.lens_offset
    pupil, pupil_centre = (
        train.entrance_pupil_points(points) for points in (bundles.pupil.points, np.zeros((1, 2)))
    )
    if pupil.distant:
        ideal, central = (-(in_focus @ e.xyz.T) for e in (pupil, pupil_centre))
    else:
        ideal, central = (
            np.linalg.norm(e.xyz - in_focus[:, None], axis=2) for e in (pupil, pupil_centre)
        )
    return (bundles.path - bundles.chief_path()[:, None]) - (ideal - central)


def _conjugate(sensor: Sensor, image_mm: Array) -> Array:
    """Return the conjugates (k, 3) of image points (k, 2) in the plane in focus."""
    lens = sensor.lens
    origins, directions = lens.rays(image_mm, np.zeros_like(image_mm))
    steps = (lens.focus_distance_mm - origins[:, 2]) / directions[:, 2]
    points: Array = origins + steps[:, None] * directions
    return points
