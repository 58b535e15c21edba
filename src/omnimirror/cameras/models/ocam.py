"""OCamCalib calibration files and camera model.

OCamCalib (Scaramuzza, Martinelli and Siegwart, IROS 2006) defines a pixel's ray as
``(row - xc, col - yc, f(rho))`` with a polynomial f of the distance rho from the centre, f(0) < 0,
in a frame with its third axis from the scene to the camera. In the camera frame used here (X right,
Y down, Z ahead), the image centre of a mirror is directed backwards and that of a fisheye forwards:
``Z = f`` for a mirror and ``Z = -f`` for a fisheye. The file does not distinguish the two.

The inverse polynomial of the file is a fit, accurate to about 0.1 px: it is compared with the
direct polynomial and then ignored; projection solves the direct polynomial.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.polynomial.polynomial import polyadd, polyder, polymul, polyroots, polyval

from ...base.arguments import file_name, finite, format_value, parse_float
from ...base.caching import cached_property
from ...base.errors import (
    InvalidParameter,
    OmnimirrorError,
    OmnimirrorWarning,
    SpecError,
    abbreviate,
)
from ...base.files import read_text
from ...base.numerics import increasing_root
from ...base.typing import Array
from ..camera import Mount
from ._distortion import MIN_RATE
from .camera_model import Optics, ParameterSlot, RadialModel, RadialProjection
from .plausibility import inverse_polynomial_warnings, plausibility_warnings

MAX_OCAM_COEFFICIENT = 1e100  # its square is finite
MAX_RADIUS_RATIO = (
    1.5  # relative to the radius of the farthest corner: limit of points outside the image
)
NODES = 257  # nodes of the table of initial values for projection


@dataclass(frozen=True, kw_only=True)
class OCam(RadialModel):
    """Camera model of OCamCalib.

    The polynomial is valid up to the farthest corner of the image, limited by the radius at which
    the rate of the field angle falls to 1 % of that at the centre (the limit of validity of a
    fitted polynomial). The image of a mirror usually ends before, at its rim: specify
    ``rim_radius_px`` to exclude the region outside.

    Parameters
    ----------
    polynomial
        a0, a1, a2, ... of f(rho), rho in px; a0 < 0.
    affine
        c, d, e of OCamCalib: ``row = c x + d y + xc``, ``col = e x + y + yc``.
    **others
        Parameters of :class:`RadialModel`.

    Examples
    --------
    >>> camera = OCam(
    ...     polynomial=(-100.0, 0.0, 0.0025), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> float(np.degrees(camera.omega_from_radius(np.array([200.0]))[0]))  # f(200) = 0: the horizon
    90.0
    >>> camera.project_directions([[1.0, 0.0, 0.0]]).pixels  # forward, at the top of the image
    array([[319.5,  39.5]])
    """

    polynomial: tuple[float, ...]
    affine: tuple[float, float, float] = (1.0, 0.0, 0.0)

    KIND = "ocam"
    AFFINE = (((0.0, 0.0), (0.0, 1.0)), ((0.0, 0.0), (1.0, 0.0)))

    def __post_init__(self) -> None:
        super().__post_init__()
        if finite("polynomial", self.polynomial).ndim != 1:
            raise InvalidParameter(
                f"polynomial must be numbers of shape (n,); got {format_value(self.polynomial)}"
            )
        if finite("affine", self.affine).shape != (3,):
            raise InvalidParameter(
                f"affine must be three numbers (c, d, e) near 1, 0, 0; got {format_value(self.affine)}"
            )
        if not (
            len(self.polynomial) and np.isfinite(self.polynomial).all() and self.polynomial[0] < 0
        ):
            raise InvalidParameter(
                "polynomial must begin with a negative number, f(0) < 0, as OCamCalib's direct polynomial; "
                f"got {format_value(self.polynomial)}"
            )
        if not np.max(np.abs(self.polynomial)) < MAX_OCAM_COEFFICIENT:
            raise InvalidParameter(
                f"polynomial must have coefficients with magnitudes less than {MAX_OCAM_COEFFICIENT:g}; "
                f"got {max(self.polynomial, key=abs):g}"
            )
        if not np.isfinite(self.affine).all() or abs(np.linalg.det(self.matrix)) < 1e-3:
            raise InvalidParameter(
                f"affine must be an invertible matrix (c, d, e) near (1, 0, 0); got {self.affine}"
            )

    @property
    def matrix(self) -> Array:
        """Affine matrix of OCamCalib, in (right, down) instead of (row, column)."""
        c, d, e = self.affine
        return np.array([[1.0, e], [d, c]])

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        """All parameters except a1 (0) and e (equivalent to a rotation)."""
        half = min(self.image_size) / 2
        slots = tuple(
            ParameterSlot(f"a{i}", "polynomial", i, f"px^{1 - i}", half ** (1 - i) / 100)
            for i in self._powers
        )
        return slots, (
            ParameterSlot("c", "affine", 0, "", 0.01),
            ParameterSlot("d", "affine", 1, "", 0.01),
        )

    @property
    def _powers(self) -> list[int]:
        return [i for i in range(len(self.polynomial)) if i != 1]

    @cached_property
    def _projection_end(self) -> float:
        """Largest field angle of the polynomial, limited to slightly beyond the image."""
        return float(self._table[1][-1])

    def _inverse_projection(self, radius: Array) -> Array:
        """Compute the field angle by ``tan(Omega) = rho / -f(rho)``."""
        return np.arctan2(radius, -polyval(radius, self.polynomial))

    def _projected_radius(self, omega: Array) -> Array:
        """Solve ``rho cos(Omega) + f(rho) sin(Omega) = 0``, with a single root."""
        nodes, omegas = self._table
        cell = np.clip(np.searchsorted(omegas, omega) - 1, 0, NODES - 2)
        cos, sin = np.cos(omega), np.sin(omega)
        slope = polyder(self.polynomial)

        def difference(rho: Array) -> tuple[Array, Array]:
            return rho * cos + polyval(rho, self.polynomial) * sin, cos + polyval(rho, slope) * sin

        start = np.interp(omega, omegas, nodes)
        return increasing_root(difference, nodes[cell], nodes[cell + 1], start, float(nodes[-1]))

    def _projection(self, omega: Array) -> RadialProjection:
        """Compute radii and derivatives by the implicit function theorem."""
        rho = self._projected_radius(omega)
        cos, sin = np.cos(omega), np.sin(omega)
        to_rho = cos + polyval(rho, polyder(self.polynomial)) * sin
        to_omega = polyval(rho, self.polynomial) * cos - rho * sin
        powers = rho[:, None] ** self._powers
        return RadialProjection(rho, -to_omega / to_rho, -(sin / to_rho)[:, None] * powers)

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        max_radius = MAX_RADIUS_RATIO * self._max_corner_radius(np.linalg.inv(self.matrix))
        nodes = np.linspace(
            0.0, min(_max_valid_radius(np.array(self.polynomial)), max_radius), NODES
        )
        return nodes, self._inverse_projection(nodes)


def _max_valid_radius(a: Array) -> float:
    """Return the radius (px) at which the field angle nearly stops increasing; else infinity.

    ``dOmega/drho = g / (rho^2 + f^2)`` with ``g = rho f' - f``, and ``1 / |a0|`` at the centre. The
    limit is therefore the first root of the polynomial ``g |a0| - MIN_RATE (rho^2 + f^2)``.
    """
    g = a * (np.arange(len(a)) - 1)
    rest = polyadd(g * abs(a[0]), -MIN_RATE * polyadd([0.0, 0.0, 1.0], polymul(a, a)))
    roots = polyroots(np.trim_zeros(rest, "b"))
    ends = roots.real[(abs(roots.imag) < 1e-9 * abs(roots)) & (roots.real > 0)]
    return float(ends.min(initial=np.inf))


# -- Calibration files --------------------------------------------------------------------------------------


def load_ocam(
    path: str | Path,
    optics: Optics = "mirror",
    *,
    mount: Mount | None = None,
    rim_radius_px: float | None = None,
) -> OCam:
    """Read OCamCalib's ``calib_results.txt``.

    Parameters
    ----------
    path
    optics
        Calibrated optics, ``"mirror"`` or ``"fisheye"``, which the file does not specify.
    mount
        Orientation of the camera; upwards by default.
    rim_radius_px : px, optional
        Radius of the field in the image.

    Returns
    -------
    OCam
        Camera of the file.

    Raises
    ------
    SpecError
        If the file is missing or invalid; the message states the line and the expected contents.
    InvalidParameter
        If ``optics`` is unknown or the rim radius is invalid.

    Warns
    -----
    OmnimirrorWarning
        If the values of the file are inconsistent; the message states the magnitude.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/calib_results.txt"
    ...     result = om.convert(
    ...         om.OCam(
    ...             polynomial=(-260.0, 0.0, 0.0011),
    ...             centre_px=(402.7, 299.2),
    ...             image_size=(800, 600),
    ...         ),
    ...         path,
    ...     )
    ...     camera = om.load_ocam(path)
    >>> camera.image_size
    (800, 600)
    """
    path = file_name("path", path)
    text = read_text(
        path, "OCamCalib file", SpecError, f"path must be an existing OCamCalib file; got {path}"
    )
    model, inverse = parse_polynomials(text, str(path))
    camera = _with_mount(model, optics, mount, rim_radius_px)
    for message in (*inverse_polynomial_warnings(camera, inverse), *plausibility_warnings(camera)):
        warnings.warn(f"{abbreviate(str(path))}: {message}", OmnimirrorWarning, stacklevel=2)
    return camera


def parse_ocam(
    text: str,
    source: str = "OCamCalib file",
    optics: Optics = "mirror",
    mount: Mount | None = None,
    rim_radius_px: float | None = None,
) -> OCam:
    """Parse the text of a ``calib_results.txt``; arguments and errors as :func:`load_ocam`.

    Additional lines of other programs after the image size are ignored.

    >>> text = "3 -1.0e+002 0 2.5e-003\\n 2 100 50\\n 239.5 319.5\\n 1 0 0\\n # size\\n 480 640\\n"
    >>> parse_ocam(text).centre_px
    (319.5, 239.5)
    """
    model, _ = parse_polynomials(text, source)
    return _with_mount(model, optics, mount, rim_radius_px)


def _with_mount(
    model: OCam, optics: Optics, mount: Mount | None, rim_radius_px: float | None
) -> OCam:
    return replace(
        model, optics=optics, mount=Mount() if mount is None else mount, rim_radius_px=rim_radius_px
    )


def parse_polynomials(text: str, source: str) -> tuple[OCam, tuple[float, ...]]:
    """Parse a ``calib_results.txt`` to a mirror camera and the inverse polynomial."""
    lines = _Lines(text, source)
    direct = lines.polynomial("the direct polynomial")
    inverse = lines.polynomial("the inverse polynomial")
    row, column = lines.numbers("the centre (row and column)", 2)
    c, d, e = lines.numbers("the affine parameters (c, d and e)", 3)
    height, width = lines.numbers("the image size (height and width)", 2)
    if not (height == int(height) and width == int(width)):
        raise lines.error(f"the image size must be integers; got {height:g} {width:g}")
    size = (int(width), int(height))
    try:
        return OCam(
            polynomial=direct, centre_px=(column, row), image_size=size, affine=(c, d, e)
        ), inverse
    except OmnimirrorError as problem:
        raise SpecError(f"{lines.source}: {problem}") from None


class _Lines:
    """Iterator over the numeric lines of a file, with errors that name them."""

    def __init__(self, text: str, source: str) -> None:
        self.source = abbreviate(source)
        self.number = 0
        stripped = (
            (i, line.split("#")[0].split()) for i, line in enumerate(text.splitlines(), start=1)
        )
        self.lines = [(i, words) for i, words in stripped if words]

    def error(self, message: str) -> SpecError:
        return SpecError(f"{self.source} line {self.number}: {message}")

    def polynomial(self, what: str) -> tuple[float, ...]:
        """Parse a line of a count and that many coefficients."""
        count, *coefficients = self._next(f"{what} (a count, then that many coefficients)")
        if count != len(coefficients) or not coefficients:
            raise self.error(
                f"{what} must have the number of coefficients that precedes them, {count:g}; got {len(coefficients)}"
            )
        return tuple(coefficients)

    def numbers(self, what: str, count: int) -> tuple[float, ...]:
        """Parse a line of ``count`` numbers."""
        values = self._next(what)
        if len(values) != count:
            raise self.error(f"{what} must be {count} numbers; got {len(values)}")
        return tuple(values)

    def _next(self, what: str) -> list[float]:
        if not self.lines:
            raise SpecError(f"{self.source} must contain {what}; got the end of the file")
        self.number, entries = self.lines.pop(0)
        values = []
        for word in entries:
            try:
                values.append(parse_float(word))
            except ValueError:
                values.append(np.nan)
            if not np.isfinite(values[-1]):
                raise self.error(f"{what} must be numbers; got {word[:40]!r}")
        return values
