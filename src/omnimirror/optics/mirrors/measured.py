"""Measured mirror profiles: column files, point clouds and grids, and their smoothing."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...base.arguments import format_value, parse_float
from ...base.errors import InvalidParameter, OmnimirrorError, SpecError
from ...base.files import read_text
from ...base.typing import Array, Mask

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


# -- Smoothing of measured meridians ---------------------------------------------------------------
#
# The noise of a point is its residual from polynomials through 6, 8 or 10 neighbours on both sides,
# provided that residuals alternate in sign as noise does; those of a smooth curve do not. The curve
# is a quintic spline with a few more pieces than selected by the Bayesian information criterion
# (Schwarz): many more pieces fit the noise, fewer underfit the shape by a similar amount. The fit is
# linear in the heights; their uncertainty is propagated to all results.

SMOOTHING_DEGREE = 5  # quintic: the curvature is a smooth cubic spline
ORDERS = (6, 8, 10)  # neighbours that predict a point
MAD_TO_SIGMA = 1.4826  # standard deviation over median absolute value of normal numbers
ALTERNATING = 0.6  # minimum fraction of sign changes of noise (expected 0.83)
MAX_NOISE_RATIO = 3.0  # maximum ratio of noise estimates of different orders (1 for noise)
MIN_NOISE_POINTS = 12  # points with neighbours on both sides, required for a noise estimate
ROUNDING = 1e-13  # of the profile height: smaller noise is rounding
OUTLIER_THRESHOLD = 7.0  # outlier threshold, in local standard deviations
WINDOW = 15  # points on each side of the local estimate
MAX_OUTLIER_FRACTION = 0.05  # maximum fraction of outliers
MAX_ROUNDS = 20
MAX_DEVIATION = 5.0  # standard deviations from the smooth curve
PIECE_COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128, 192, 256)
MIN_POINTS_PER_PIECE = 2  # minimum number of points per piece
PATIENCE = 4  # steps without improvement that end the search
EXTRA_REFINEMENTS = 3  # refinements beyond the minimum: bias becomes small relative to noise
TOO_ROUGH = 2.0  # maximum ratio of estimated to specified uncertainty


@dataclass(frozen=True)
class Fit:
    """Smooth curve through n points of a meridian.

    Attributes
    ----------
    spline
        Spline z(x) relative to its first height.
    uncertainty_mm
        Standard uncertainty of one height; 0 for exact points.
    used : (n,)
        False for outliers.
    deviations : (j, coefficients)
        Independent standard deviations of the spline coefficients; empty for exact points.
    """

    spline: BSpline
    uncertainty_mm: float
    used: Mask
    deviations: Array


class Scatter(NamedTuple):
    """Prediction residuals of n points, mm, scaled to one standard deviation."""

    residuals: Array
    is_noise: bool

    @property
    def sigma(self) -> float:
        """Robust standard deviation."""
        return MAD_TO_SIGMA * float(np.median(np.abs(self.residuals)))


def fitted(x: Array, z: Array, smooth_apex: bool, uncertainty_mm: float | None) -> Fit:
    """Fit a curve through points (n,) that increase from 0.

    Parameters
    ----------
    smooth_apex
        True for a curve symmetric about the axis.
    uncertainty_mm
        Uncertainty of the heights; estimated if None, 0 for interpolation.

    Raises
    ------
    InvalidParameter
        If the points scatter far more than specified.
    """
    used = np.ones(len(x), dtype=bool)
    if uncertainty_mm == 0.0:
        return _interpolated(x, z, smooth_apex, used)
    used = ~_local_outliers(x, z)
    scatter = _scatter(x[used], z[used])
    noise = scatter.sigma if uncertainty_mm is None else uncertainty_mm
    if uncertainty_mm is None and (not scatter.is_noise or noise <= ROUNDING * float(np.ptp(z))):
        return _interpolated(x, z, smooth_apex, used)
    for _ in range(MAX_ROUNDS):
        fit, residuals, residual = _smooth(x, z, smooth_apex, used, noise)
        size = np.where(used, np.abs(residuals), 0.0)
        typical = MAD_TO_SIGMA * float(np.median(size[used]))
        outliers = size > max(
            MAX_DEVIATION * max(noise, typical), size.max() / 2
        )  # the worst may bend the others
        if not outliers.any() or used.sum() - outliers.sum() < (1 - MAX_OUTLIER_FRACTION) * len(x):
            break
        used = used & ~outliers
    if (
        uncertainty_mm is None and residual > TOO_ROUGH * noise
    ):  # points too sparse for fewer pieces
        return _interpolated(x, z, smooth_apex, used)
    if uncertainty_mm is not None and residual > TOO_ROUGH * uncertainty_mm:
        raise InvalidParameter(
            f"uncertainty_um must be at least {residual * 1e3 / TOO_ROUGH:.2g}: the points "
            f"of the profile scatter by {residual * 1e3:.3g} um about the smoothest "
            f"admissible curve; got {uncertainty_mm * 1e3:g}; omit it to estimate it"
        )
    return fit


def _interpolated(x: Array, z: Array, smooth_apex: bool, used: Mask) -> Fit:
    from scipy.interpolate import make_interp_spline

    x, z = x[used], z[used] - z[used][0]
    if smooth_apex:
        x, z = np.concatenate([-x[:0:-1], x]), np.concatenate([z[:0:-1], z])
    spline = make_interp_spline(x, z, k=SMOOTHING_DEGREE)
    return Fit(spline, 0.0, used, np.zeros((0, len(spline.c))))


def extended(x: Array, z: Array, smooth_apex: bool, at: Array) -> Array:
    """Extrapolate heights (m,) slightly beyond the points (n,) of a meridian by a smooth curve.

    The minimum number of pieces is used: a curve that follows the noise extrapolates poorly.
    """
    used = np.ones(len(x), dtype=bool)
    noise = max(_scatter(x, z).sigma, ROUNDING * float(np.ptp(z)))
    fit, residuals, _ = _smooth(x, z, smooth_apex, used, noise)
    level = z[-1] - residuals[-1] - fit.spline(x[-1])  # of the apex
    return np.asarray(fit.spline(at) + level)


# -- noise and outliers ----------------------------------------------------------------------------


def _scatter(x: Array, z: Array) -> Scatter:
    """Return the smallest noise estimate over several polynomial degrees."""
    residuals_by_order = [
        _prediction_residuals(x, z, order) for order in ORDERS if len(x) > order + 1
    ]
    if not residuals_by_order:
        return Scatter(np.zeros(len(x)), False)
    sizes = [float(np.median(np.abs(r))) for r in residuals_by_order]
    residuals = residuals_by_order[int(np.argmin(sizes))]
    inner = residuals[ORDERS[-1] // 2 : -ORDERS[-1] // 2]
    changes = np.signbit(inner[1:]) != np.signbit(inner[:-1])
    is_noise = (
        len(inner) >= MIN_NOISE_POINTS
        and changes.mean() > ALTERNATING
        and max(sizes) < MAX_NOISE_RATIO * min(sizes)
    )
    return Scatter(residuals, bool(is_noise))


def _prediction_residuals(x: Array, z: Array, order: int) -> Array:
    """Return prediction residuals (n,) from the ``order`` nearest neighbours."""
    n, half = len(x), order // 2
    first = np.clip(np.arange(n) - half, 0, n - order - 1)
    window = first[:, None] + np.arange(order + 1)
    neighbours = window[window != np.arange(n)[:, None]].reshape(n, order)
    neighbour_x = x[neighbours]
    # Lagrange weights of the neighbours at x; independent noise of equal variance has the residual
    # variance sigma^2 (1 + sum of the squared weights)
    gaps = neighbour_x[:, :, None] - neighbour_x[:, None, :] + np.eye(order)
    steps = x[:, None] - neighbour_x
    ratio = steps[:, None, :] / gaps
    ratio[:, np.arange(order), np.arange(order)] = 1.0
    weights = ratio.prod(axis=2)
    residual: Array = (z - np.einsum("no,no->n", weights, z[neighbours])) / np.sqrt(
        1 + (weights**2).sum(axis=1)
    )
    return residual


def _local_outliers(x: Array, z: Array) -> Mask:
    """Return isolated outliers (n,): far from their neighbours, which agree without them."""
    outliers = np.zeros(len(x), dtype=bool)
    tested = np.zeros(len(x), dtype=bool)
    for _ in range(max(int(MAX_OUTLIER_FRACTION * len(x)), 1)):
        inliers = np.flatnonzero(~outliers)
        if len(inliers) <= 2 * ORDERS[0] + 2:
            break
        deviation, scatter = _relative_residuals(x[inliers], z[inliers], float(np.ptp(z)))
        deviation[tested[inliers]] = 0.0
        candidate = int(np.argmax(deviation))
        if deviation[candidate] <= OUTLIER_THRESHOLD:
            break
        without = np.delete(inliers, candidate)
        again, _ = _relative_residuals(x[without], z[without], float(np.ptp(z)), scatter[candidate])
        neighbours = again[max(candidate - ORDERS[0] // 2, 0) : candidate + ORDERS[0] // 2]
        tested[inliers[candidate]] = True
        outliers[inliers[candidate]] = bool(
            (neighbours < max(OUTLIER_THRESHOLD, deviation[candidate] / 8)).all()
        )
    return outliers


def _relative_residuals(
    x: Array, z: Array, height: float, given_scatter: float | None = None
) -> tuple[Array, Array]:
    """Return residuals (n,) in local (or given) standard deviations, and the latter, mm."""
    size = np.abs(_prediction_residuals(x, z, ORDERS[0]))
    padded = np.pad(size, WINDOW, constant_values=np.nan)
    views = np.lib.stride_tricks.sliding_window_view(padded, 2 * WINDOW + 1).copy()
    views[:, WINDOW - ORDERS[0] // 2 : WINDOW + ORDERS[0] // 2 + 1] = np.nan  # the outlier's own
    overall = _scatter(x, z)
    min_scatter = max(ROUNDING * height, 0.7 * overall.sigma if overall.is_noise else 0.0)
    scatter = np.maximum(MAD_TO_SIGMA * np.nanmedian(views, axis=1), min_scatter)
    return size / (scatter if given_scatter is None else given_scatter), scatter


# -- smooth curve ----------------------------------------------------------------------------------


def _smooth(
    x: Array, z: Array, smooth_apex: bool, used: Mask, noise: float
) -> tuple[Fit, Array, float]:
    """Return the fit of the points used, all residuals (n,), mm, and their sigma."""
    curves: list[_Curve] = []
    criteria: list[float] = []
    for pieces in PIECE_COUNTS:
        if curves and pieces + SMOOTHING_DEGREE > used.sum() / 2:
            break
        curves.append(_least_squares(x, z, smooth_apex, used, pieces))
        count = curves[-1].basis.shape[1]
        loss = np.abs(curves[-1].residuals[used] / noise)
        loss = np.where(
            loss > MAX_DEVIATION, MAX_DEVIATION * (2 * loss - MAX_DEVIATION), loss**2
        )  # Huber loss
        criteria.append(float(loss.sum() + np.log(used.sum()) * count))
        if len(curves) - int(np.argmin(criteria)) > max(PATIENCE, EXTRA_REFINEMENTS):
            break
    curve = curves[min(int(np.argmin(criteria)) + EXTRA_REFINEMENTS, len(curves) - 1)]
    sigma = float(np.sqrt(curve.square_sum / max(used.sum() - curve.basis.shape[1], 1)))
    deviations = max(noise, sigma) * curve.roots @ curve.expand.T
    return Fit(curve.spline, max(noise, sigma), used, deviations), curve.residuals, sigma


class _Curve(NamedTuple):
    spline: BSpline
    basis: Array
    residuals: Array
    square_sum: float
    """Sum of squared residuals of the points used."""
    roots: Array
    """(j, j): its transpose times itself is the inverse of the normal equations."""
    expand: Array
    """(coefficients, j): expansion to the coefficients of the spline."""


def _least_squares(x: Array, z: Array, smooth_apex: bool, used: Mask, pieces: int) -> _Curve:
    from scipy.interpolate import BSpline

    breaks = _breaks(x[used], x[-1], pieces)
    if smooth_apex:
        breaks = np.concatenate([-breaks[:0:-1], breaks])
    knots = np.concatenate(
        [[breaks[0]] * SMOOTHING_DEGREE, breaks, [breaks[-1]] * SMOOTHING_DEGREE]
    )
    count = len(knots) - SMOOTHING_DEGREE - 1
    half = (count + 1) // 2
    expand = np.eye(count)
    if smooth_apex:  # even functions: mirrored coefficients are equal
        expand = (expand + expand[::-1])[:, :half]
        expand[:, -1] /= expand[:, -1].max()
    basis = BSpline.design_matrix(x, knots, SMOOTHING_DEGREE).toarray() @ expand
    Q, R = np.linalg.qr(basis[used])
    c = np.linalg.solve(R, Q.T @ z[used])
    residuals = z - basis @ c
    spline = BSpline(knots, expand @ c, SMOOTHING_DEGREE)
    spline = BSpline(knots, spline.c - spline(0.0), SMOOTHING_DEGREE)
    return _Curve(
        spline, basis, residuals, float((residuals[used] ** 2).sum()), np.linalg.inv(R).T, expand
    )


def _breaks(x: Array, end: float, pieces: int) -> Array:
    """Return the ends of equally long pieces, merged if they contain too few of the points (n,).

    Pieces of equal point count are unsuitable: clouds are sparse at the apex, with high curvature.
    """
    breaks = [0.0]
    counted = 0
    for ahead in np.linspace(0.0, end, pieces + 1)[1:-1]:
        before = int(np.searchsorted(x, ahead))
        if before - counted >= MIN_POINTS_PER_PIECE and len(x) - before >= MIN_POINTS_PER_PIECE:
            breaks.append(float(ahead))
            counted = before
    return np.array([*breaks, end])


# -- Point files of measuring machines -------------------------------------------------------------
#
# Separator and decimal sign apply to the whole file and are inferred from all rows; columns of labels
# and of row numbers are dropped; a header naming x, y and z selects the columns.

Line = tuple[int, str]
"""Line number and text."""
Table = tuple[list[str], list[bool], Array]
"""Header lines, mask of numeric columns, and their values (n, columns)."""

STYLE_LINES = 2000  # used to infer separator and decimal sign
COMMENTS = ("#", "!", "%", "//", "*")
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"
COMMA_NUMBER = NUMBER.replace(r"\.", ",")
UNMEASURED = {"nan", "inf", "-inf", "+inf", "none", "null", "---", "****", "bad"}
PREFIXED = re.compile(r"[xyzXYZ]\s*[=:]?\s*(?=[+-]?[\d.,])")
UNIT_WORDS = {
    "mm": "mm",
    "um": "um",
    "µm": "um",
    "μm": "um",
    "micron": "um",
    "microns": "um",
    "m": "m",
    "in": "inch",
    "inch": "inch",
}
AXES = ("x", "y", "z")


def parsed_points(text: str, path: Path, unit: str | None = None) -> Array:
    """Parse the points of a text, (n, 3) of x, y, z or (n, 2) of x, z.

    Parameters
    ----------
    text
    path
        Name of the file, for messages.
    unit : optional
        Unit assumed by the caller; a header naming another one is an error.

    Raises
    ------
    OmnimirrorError
        If there are no numeric rows, a row differs from the others, or the separators are
        ambiguous; the message states the line.

    Examples
    --------
    >>> parsed_points("Nr;X;Y;Z\\n1;1,5;2,0;-1,0D-02\\n2;2,5;2,0;3,0D-02", Path("cmm.csv"))
    array([[ 1.5 ,  2.  , -0.01],
           [ 2.5 ,  2.  ,  0.03]])
    """
    lines = [(i, line.strip()) for i, line in enumerate(text.splitlines(), start=1)]
    lines = [(i, line) for i, line in lines if line and not line.startswith(COMMENTS)]
    style = _Style.of([line for _, line in lines[:STYLE_LINES]], path)
    header, is_numeric, table = _plain_table(lines, style) or _labelled_table(lines, style, path)
    _check_unit(header, unit, path)
    names = _named_columns(header, len(is_numeric))
    has_decimals = any(
        sign in style.words(line)[0] for _, line in lines[len(header) :][:1] for sign in ".,"
    )
    table = table[np.isfinite(table).all(axis=1)]
    if names is not None and all(is_numeric[column] for column in names.values()):
        columns = [sum(is_numeric[: names[axis]]) for axis in AXES if axis in names]
        return np.asarray(table[:, columns])
    if table.shape[1] >= 3 and not has_decimals and _are_row_numbers(table[:, 0]):
        table = table[:, 1:]
    if table.shape[1] < 2:
        raise OmnimirrorError(
            f"{path} must contain rows of x, y, z, or of x, z for a profile; got one column"
        )
    return np.asarray(table[:, :3])


def _plain_table(lines: list[Line], style: _Style) -> Table | None:
    """Return header, column kinds and values of numeric rows; else None."""
    if style.has_decimal_comma:
        return None
    rows = [line.replace(",", " ").replace(";", " ").split() for _, line in lines]
    first = next(
        (k for k, row in enumerate(rows) if len(row) > 1 and all(map(style.is_number, row))), None
    )
    if (
        first is None
        or len({len(row) for row in rows[first:]}) > 1
        or any("_" in line for _, line in lines[first:])
    ):
        return None
    try:
        table = np.array(rows[first:], dtype=float)
    except ValueError:
        return None
    return [line for _, line in lines[:first]], [True] * table.shape[1], table


def _labelled_table(lines: list[Line], style: _Style, path: Path) -> Table:
    """Return header, column kinds (number or label) and values of rows of any kind.

    Raises
    ------
    OmnimirrorError
        If there are no numeric rows, or a row differs from the others.
    """
    rows = [style.words(line) for _, line in lines]
    widths = [len(words) if sum(map(style.is_number, words)) >= 2 else 0 for words in rows]
    counts = Counter(width for width in widths if width)
    if not counts:
        raise OmnimirrorError(
            f"{path} must contain rows of x, y, z, or of x, z for a profile; got no numbers"
        )
    common_width, count = counts.most_common(1)[0]
    first = next(
        k
        for k, width in enumerate(widths)
        if width and (width == common_width or 2 * count <= counts.total())
    )
    width = widths[first]
    is_numeric = [style.is_number(word) for word in rows[first]]
    values: list[list[float]] = []
    for (number, line), words in zip(lines[first:], rows[first:], strict=True):
        row_values = [
            style.value(word)
            for word, is_number in zip(words, is_numeric, strict=False)
            if is_number
        ]
        if len(words) < width or None in row_values:
            names = "x, y, z" if sum(is_numeric) > 2 else "x, z"
            raise OmnimirrorError(
                f"{path} line {number}: the row must contain {names}, as the other rows; got {format_value(line)}"
            )
        values.append([value for value in row_values if value is not None])
    return [line for _, line in lines[:first]], is_numeric, np.array(values)


class _Style:
    """Separator and decimal sign of a file."""

    def __init__(self, separator: str, has_decimal_comma: bool) -> None:
        self.separator, self.has_decimal_comma = re.compile(separator), has_decimal_comma
        self.number = re.compile(COMMA_NUMBER if has_decimal_comma else NUMBER)

    @classmethod
    def of(cls, lines: list[str], path: Path) -> _Style:
        """Infer the separator and the decimal sign from all lines with numbers.

        Raises
        ------
        OmnimirrorError
            If commas are used for both.
        """
        text = "\n".join(line for line in lines if len(re.findall(r"\d", line)) >= 2)
        has_point = re.search(r"(?<![A-Za-z\d])[+-]?\d*\.\d", text) is not None
        has_semicolons = any(sign in text for sign in (";", "\t"))
        if has_point or "," not in text:
            return cls(r"\s*[,;\t]\s*|\s+", has_decimal_comma=False)
        if has_semicolons:
            return cls(r"\s*[;\t]\s*|\s+", has_decimal_comma=True)
        digits = [line for line in lines if re.search(r"\d", line)]
        if any(re.search(r"\d,\d", line) and re.search(r"\S\s+\S", line) for line in digits):
            return cls(r",?\s+", has_decimal_comma=True)  # such as "1,5 2,0 3,1"
        rows = [line.split(",") for line in digits]
        counts = Counter(map(len, rows))
        if (
            counts
            and counts.most_common(1)[0][0] in (4, 6)
            and all(
                re.fullmatch(r"\d+", row[k].strip())
                for row in rows
                if len(row) in (4, 6)
                for k in range(1, len(row), 2)
            )
        ):
            raise OmnimirrorError(
                f"{path} must not use commas for both columns and decimals; use semicolons "
                "or tabs between columns, or decimal points"
            )
        return cls(r"\s*,\s*", has_decimal_comma=False)

    def words(self, line: str) -> list[str]:
        """Return the words of a line, without quotes and axis names."""
        return [word.strip("\"'") for word in self.separator.split(PREFIXED.sub("", line)) if word]

    def is_number(self, word: str) -> bool:
        """Return True for a number, or a marker of a missing point."""
        return word.lower() in UNMEASURED or self.number.fullmatch(word) is not None

    def value(self, word: str) -> float | None:
        """Return the value of a word, NaN for a missing point; None for a label."""
        if word.lower() in UNMEASURED:
            return float("nan")
        if not self.number.fullmatch(word):
            return None
        return float(word.replace(",", ".").replace("D", "e").replace("d", "e"))


def _named_columns(header: list[str], width: int) -> dict[str, int] | None:
    """Return the columns of x, (y) and z from the last header line that names them."""
    for line in reversed(header):
        words = [
            re.sub(r"[\[(/_ ].*", "", word.strip("\"' ").lower())
            for word in re.split(r"[;,\t]|\s+", line)
        ]
        words = [word for word in words if word]
        columns = {axis: words.index(axis) for axis in AXES if words.count(axis) == 1}
        if len(words) == width and {"x", "z"} <= set(columns):
            return columns
    return None


def _check_unit(header: list[str], unit: str | None, path: Path) -> None:
    """Check that the header does not name another unit than that assumed by the caller."""
    words = [
        word
        for line in header
        for word in re.findall(r"[\[(/_]\s*([A-Za-zµμ]+)\s*[\])\s,;]?", line)
    ]
    header_units = {UNIT_WORDS[word.lower()] for word in words if word.lower() in UNIT_WORDS}
    if unit is not None and len(header_units) == 1 and unit not in header_units:
        (header_unit,) = header_units
        raise OmnimirrorError(
            f"{path} specifies the unit {header_unit}, which differs from {unit}; set unit "
            f"{header_unit} (--unit {header_unit})"
        )


def _are_row_numbers(first: Array) -> bool:
    """Return True if a column (n,) holds row numbers: integers with (almost) unit increments."""
    if len(first) < 2 or np.any(first != np.round(first)):
        return False
    steps = np.diff(first)
    return bool(
        np.all(steps > 0) and np.median(steps) == 1 and steps.max() <= max(10.0, 0.05 * len(first))
    )


# -- Meridian from point clouds and grids ----------------------------------------------------------
#
# The axes of the measuring machine differ from those of the mirror: centre and tilt are fitted
# together with the meridian by robust least squares. (The axis of a sphere is undetermined; the
# machine's is kept.) Rings of equally many points are averaged to one profile point each, to equalise
# the noise.

Columns = tuple[tuple[float, ...], tuple[float, ...]]

MIN_CLOUD_POINTS = 200  # points
MAX_COORDINATE_MM = 1e7  # largest coordinate: 10 km from the machine origin, a double resolves 2 nm
MIN_WIDTH_MM = 1e-3  # minimum width of a cloud across its longest direction, projected along z
MIN_RELATIVE_WIDTH = 1e-6  # the same, relative to its length
MAX_AXIS_POINTS = 1500  # points used to fit the axis
POINTS_PER_RING = 8
MAX_RINGS = 500
MERIDIAN_PIECES = (4, 48)  # spline pieces of the meridian, during the axis fit and finally
TIP = 0.7  # ratio of residual squares, pointed to smooth, below which the apex is pointed
UNITS_MM = (1.0, 10.0, 25.4, 1000.0)  # OpticStudio's unit flags: mm, cm, in, m


def read_cloud(path: Path, noun: str = "cloud", names: str = "x, y, z in mm") -> Columns:
    """Return the profile of a CSV file of points x, y, z in mm; header and comments are skipped."""
    return profile_of(cloud_points(path, noun, names), str(path))


def cloud_points(path: Path, noun: str = "points", names: str = "x, y, z in mm") -> Array:
    """Return the points (n, 3) of a text file, one per line; see :func:`parsed_points`.

    Raises
    ------
    OmnimirrorError
        If the file cannot be read, or contains the two columns of a profile.
    """
    points = parsed_points(read_text(path, noun), path)
    if points.shape[1] != 3:
        raise OmnimirrorError(f"{path} must contain {names} for {noun}; got two columns")
    return points


def read_grid(path: Path, noun: str = "grid", names: str = "z and further columns") -> Columns:
    """Return the profile of an OpticStudio grid sag file (.DAT)."""
    return profile_of(grid_points(path, noun, names), str(path))


def grid_points(path: Path, noun: str = "grid", names: str = "z and further columns") -> Array:
    """Return the points (n, 3), mm, of an OpticStudio grid sag file (.DAT).

    The first line is ``nx ny dx dy unit xdec ydec``. Points follow row by row, one per line,
    starting at the corner -x, +y; a non-zero fifth number marks missing data.
    """
    text = read_text(path, noun)
    lines = [
        line
        for line in text.splitlines()
        if line.strip() and not line.lstrip().startswith(("!", "#"))
    ]
    try:
        head = [parse_float(word) for word in lines[0].split()]
        nx, ny, (dx, dy), unit = int(head[0]), int(head[1]), head[2:4], UNITS_MM[int(head[4])]
        offset = [*head[5:7], 0.0, 0.0][:2]
        if nx < 2 or ny < 2 or nx * ny != len(lines) - 1 or not (dx > 0 and dy > 0):
            raise ValueError
    except (ValueError, IndexError):
        raise OmnimirrorError(
            f"{path} must be a grid of heights: first line 'nx ny dx dy unit xdec ydec', followed by nx * ny lines"
        ) from None
    rows = _cloud_rows(path, "\n".join(lines[1:]), names)
    j, i = np.divmod(np.arange(nx * ny), nx)
    x, y = (i - (nx - 1) / 2) * dx + offset[0], ((ny - 1) / 2 - j) * dy + offset[1]
    points = np.stack([x, y, rows[:, 0]], axis=-1) * unit
    valid = np.hypot(x, y) <= min((nx - 1) * dx, (ny - 1) * dy) / 2 * (1 + 1e-9)
    if rows.shape[1] >= 5:
        valid &= rows[:, 4] == 0
    return np.asarray(points[valid])


def _cloud_rows(path: Path, text: str, names: str) -> Array:
    """Return the numbers (n, columns) of a grid's text, separated by commas or blanks."""
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            numbers = [
                parse_float(word) for word in line.replace(",", " ").replace(";", " ").split()
            ]
            if (
                not numbers
                or not np.isfinite(numbers).all()
                or len(numbers) < len(rows[0] if rows else [])
            ):
                raise ValueError
        except ValueError:
            raise OmnimirrorError(
                f"{path} line {number}: the line must contain {names}; got {format_value(line)}"
            ) from None
        rows.append(numbers[: len(rows[0])] if rows else numbers)
    return np.array(rows).reshape(-1, len(rows[0]) if rows else 1)


def profile_of(points: Array, source: str = "the cloud") -> Columns:
    """Return distances from the axis and heights, away from the lens, of points (n, 3), mm.

    Raises
    ------
    OmnimirrorError
        If there are too few points, or they do not surround an axis.

    Examples
    --------
    >>> x, y = np.meshgrid(np.linspace(-10, 10, 41), np.linspace(-10, 10, 41))
    >>> r, z = profile_of(np.stack([x + 3, y - 2, 50 - (x**2 + y**2) / 100], axis=-1).reshape(-1, 3))
    >>> bool(np.abs(np.array(z) - np.square(r) / 100).max() < 1e-9)
    True
    """
    check_spread(points, source)
    points = points - points.mean(axis=0)
    # initial axis: the apex of the best-fit paraboloid z = a + b x + c y + d (x^2 + y^2)
    a = np.column_stack([np.ones(len(points)), points[:, :2], (points[:, :2] ** 2).sum(axis=1)])
    bowl = np.linalg.lstsq(a, points[:, 2], rcond=None)[0]
    if bowl[3] < 0:  # measured from above: rotate about x
        points, bowl = points * [1.0, -1.0, -1.0], bowl * [-1.0, -1.0, 1.0, -1.0]
    if not bowl[3] > 0:
        raise OmnimirrorError(f"{source} must be convex or concave; got flat points")
    r, z = _about_axis(points, -bowl[1:3] / (2 * bowl[3]), source)
    order = np.argsort(r, kind="stable")
    r, z = r[order], z[order]
    pieces = min(MERIDIAN_PIECES[1], len(r) // (2 * POINTS_PER_RING))
    smooth, pointed = (
        _least_squares(r, z, apex, np.ones(len(r), dtype=bool), pieces) for apex in (True, False)
    )
    curve = pointed if pointed.square_sum < TIP * smooth.square_sum else smooth
    rings = np.array_split(np.arange(len(r)), min(MAX_RINGS, len(r) // POINTS_PER_RING))
    x = np.array([r[ring].mean() for ring in rings])
    heights = curve.spline(x) + np.array([curve.residuals[ring].mean() for ring in rings])
    growing = np.concatenate([[True], np.diff(x) > 1e-9 * r[-1]]) & (x > 1e-6 * r[-1])
    x, heights = x[growing], heights[growing]
    rim = [r[-1]] if r[-1] > x[-1] * (1 + 1e-9) else []
    ends = extended(x, heights, curve is smooth, np.array([0.0, *rim]))
    x, heights = (
        np.concatenate([[0.0], x, rim]),
        np.concatenate([ends[:1], heights, ends[1:]]) - ends[0],
    )
    return tuple(map(float, x)), tuple(map(float, heights))


def check_distance(points: Array, source: str) -> None:
    """Check that no point (n, 3), mm, is farther than 10 km from the origin."""
    max_coordinate = float(np.abs(points).max(initial=0.0))
    if max_coordinate > MAX_COORDINATE_MM:
        raise OmnimirrorError(
            f"{source} must lie within {MAX_COORDINATE_MM:g} mm of the machine's origin; "
            f"got {max_coordinate:.4g} mm; check the unit and remove outliers"
        )


def check_spread(points: Array, source: str) -> None:
    """Check that points (n, 3) mm can determine a surface.

    Raises
    ------
    OmnimirrorError
        If there are fewer than 200, one is farther than 10 km from the origin, or all are on a line
        projected along z.
    """
    if len(points) < MIN_CLOUD_POINTS:
        raise OmnimirrorError(
            f"{source} must have at least {MIN_CLOUD_POINTS} points; got {len(points)}"
        )
    check_distance(points, source)
    length, width = np.linalg.svd(
        points[:, :2] - points[:, :2].mean(axis=0), compute_uv=False
    ) / np.sqrt(len(points))
    if width < max(MIN_WIDTH_MM, MIN_RELATIVE_WIDTH * length):
        raise OmnimirrorError(
            f"{source} must not lie on one line; got points {width:.2g} mm about a line "
            "(rms, along z); measure points all over the mirror"
        )


def _about_axis(points: Array, start: Array, source: str) -> tuple[Array, Array]:
    """Return distances (n,) from the best-fit axis and heights (n,) of points (n, 3)."""
    from scipy.optimize import least_squares

    size = float(np.ptp(points[:, :2])) / 2
    subset = points[:: max(len(points) // MAX_AXIS_POINTS, 1)]
    profile = _profile_function(subset, size)

    def residuals(pose: Array) -> Array:
        r, z = profile(pose)
        order = np.argsort(r)
        curve = _least_squares(
            r[order], z[order], False, np.ones(len(r), dtype=bool), MERIDIAN_PIECES[0]
        )
        ordered_residuals = np.empty_like(r)
        ordered_residuals[order] = curve.residuals / scale
        return ordered_residuals

    scale, pose = 1.0, np.array([*(start / size), 0.0, 0.0])
    scale = max(MAD_TO_SIGMA * float(np.median(np.abs(residuals(pose)))), 1e-12 * size)
    for _ in range(2):
        pose = least_squares(
            residuals, pose, loss="soft_l1", x_scale=1e-2, xtol=1e-12, ftol=1e-12, max_nfev=25
        ).x
        scale = max(scale * MAD_TO_SIGMA * float(np.median(np.abs(residuals(pose)))), 1e-12 * size)
    r, z = _profile_function(points, size)(pose)
    centred = points[:, :2] - pose[:2] * size
    if len({(bool(x > 0), bool(y > 0)) for x, y in centred}) < 4:
        raise OmnimirrorError(f"{source} must surround its axis; measure points on all sides of it")
    return r, z


def _profile_function(points: Array, size: float) -> Callable[[Array], tuple[Array, Array]]:
    """Return a function from centre and tilts to distances and heights of points."""

    def at(pose: Array) -> tuple[Array, Array]:
        cx, cy, a, b = pose
        axis = np.array(
            [np.sin(a), np.sin(b), np.sqrt(max(1 - np.sin(a) ** 2 - np.sin(b) ** 2, 0.0))]
        )
        p = points - [cx * size, cy * size, 0.0]
        z = p @ axis
        return np.sqrt(np.maximum((p**2).sum(axis=1) - z**2, 0.0)), z

    return at


# -- Column files ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class ColumnFile:
    """Table entry that names a file; its two columns replace the entry."""

    entry: str
    columns: tuple[str, str]
    noun: str
    read: Callable[[Path, str], Columns]
    """Reader of the file, given its path and noun."""

    def followed(self, table: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """Return the table with the columns of the file instead of its name.

        This is the only place that opens a file named in another file. Only files named on the
        user's command line have a ``folder``; with None, the table must not name a file.

        Raises
        ------
        OmnimirrorError
            If the table must not name a file, also has the columns, or the file is missing or
            invalid.

        Examples
        --------
        >>> PROFILE_FILE.followed({"profile_csv": "/etc/passwd"}, None)
        Traceback (most recent call last):
        ...
        omnimirror.base.errors.SpecError: profile_csv must not name a file here; enter x_mm and z_mm instead
        """
        if self.entry not in table:
            return dict(table)
        if folder is None:
            names = " and ".join(self.columns)
            raise SpecError(f"{self.entry} must not name a file here; enter {names} instead")
        if clash := set(self.columns) & set(table):
            raise SpecError(
                f"{self.entry} must not be combined with {' and '.join(sorted(clash))}; remove one"
            )
        name = table[self.entry]
        if not isinstance(name, str):
            raise SpecError(f"{self.entry} must be a file name in quotes; got {format_value(name)}")
        columns = self.read(folder / name, self.noun)
        entries = {k: v for k, v in table.items() if k != self.entry}
        return entries | dict(zip(self.columns, map(list, columns), strict=True))


def read_columns(
    path: Path, noun: str = "profile", names: str = "x_mm, z_mm"
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read two numeric columns of a CSV file; header and comment lines are skipped.

    Raises
    ------
    OmnimirrorError
        If the file is missing, or a line after the first number does not hold two numbers.
    """
    points: list[tuple[float, float]] = []
    for number, row in enumerate(_csv_rows(read_text(path, noun), path), start=1):
        try:
            first, second = parse_float(row[0]), parse_float(row[1])
        except (ValueError, IndexError):
            if points and row and not row[0].lstrip().startswith("#"):
                raise OmnimirrorError(
                    f"{path} line {number}: the line must contain two numbers {names}; got "
                    f"{format_value(','.join(row))}"
                ) from None
            continue
        points.append((first, second))
    if not points:
        raise OmnimirrorError(f"{path} must contain lines of two numbers {names}; got none")
    firsts, seconds = zip(*points, strict=True)
    return firsts, seconds


def _csv_rows(text: str, path: Path) -> list[list[str]]:
    try:
        return list(csv.reader(text.splitlines()))
    except csv.Error as e:  # an entry of more than 128 kB
        raise OmnimirrorError(f"{path} must be a table of two columns: {e}") from None


PROFILE_FILE = ColumnFile("profile_csv", ("x_mm", "z_mm"), "profile", read_columns)
CLOUD_FILE = ColumnFile("cloud_csv", ("x_mm", "z_mm"), "cloud", read_cloud)
GRID_FILE = ColumnFile("grid_sag", ("x_mm", "z_mm"), "grid", read_grid)
MAPPING_FILE = ColumnFile(
    "mapping_csv",
    ("omega_deg", "height"),
    "mapping",
    lambda path, noun: read_columns(path, noun, "omega_deg, height"),
)
