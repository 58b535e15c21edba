"""Straight edges: tables of points, plumb-line fit, and observations of a bundle adjustment."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import finite, format_value, number, parse_float, validate_arguments
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.files import read_text
from ..base.numerics import damped_step, levenberg_marquardt
from ..base.typing import Array, Mask
from ..cameras.camera import perpendicular_axes, rotate_vectors
from ..cameras.models.camera_model import CameraModel

# -- Tables of points ------------------------------------------------------------------------------

IMAGE_COLUMN = "image"
"""Optional column of tables with points of several images."""


class TableRow(NamedTuple):
    """Line of a table of points."""

    location: str
    """File and line number."""
    cells: dict[str, str]
    """Text by column."""

    def number(self, name: str) -> float:
        """Return the number in a column."""
        try:
            value = parse_float(self.cells[name])
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise InvalidParameter(
                f"{self.location}: {name} must be a finite number; "
                f"got {format_value(self.cells[name])}"
            )
        return value


def read_point_table(
    path: Path, contents: str, column_sets: Sequence[tuple[str, ...]]
) -> tuple[tuple[str, ...], list[TableRow]]:
    """Read a CSV table with a header line; lines that start with ``#`` are comments.

    Parameters
    ----------
    path
        File.
    contents
        Description of the contents for messages.
    column_sets
        Valid sets of columns, to which :data:`IMAGE_COLUMN` may be added.

    Returns
    -------
    columns
        Set of columns of the file.
    rows
        Lines after the header.

    Raises
    ------
    InvalidParameter
        If the file is missing, has no lines after the header or other columns, or a line has
        another number of cells than the header.
    """
    text = read_text(
        path,
        contents,
        InvalidParameter,
        f"cannot read the points {path}: the file does not exist",
    )
    lines = [
        (n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"
    ]
    if len(lines) < 2:
        raise InvalidParameter(
            f"{path} contains no points; its first line must be {','.join(column_sets[0])}"
        )
    (number, header), *rest = lines
    names = _cells(header, f"line {number} of {path}")
    columns = next((c for c in column_sets if set(names) - {IMAGE_COLUMN} == set(c)), None)
    if columns is None or len(set(names)) < len(names):
        raise InvalidParameter(
            f"line {number} of {path}: the columns must be "
            f"{' or '.join(map(','.join, column_sets))}, and "
            f"{IMAGE_COLUMN} for several images; got {format_value(header)}"
        )
    return columns, [_table_row(f"{path.name} line {n}", names, line) for n, line in rest]


def _table_row(location: str, names: list[str], line: str) -> TableRow:
    cells = _cells(line, location)
    if len(cells) != len(names):
        raise InvalidParameter(
            f"{location} must have {len(names)} values, as the first line; got {len(cells)}"
        )
    return TableRow(location, dict(zip(names, cells, strict=True)))


def _cells(line: str, location: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as e:
        raise InvalidParameter(f"{location} is not valid CSV: {e}") from None


# -- Tables of edge points -------------------------------------------------------------------------

COLUMNS = ("line", "u_px", "v_px")
DEFAULT_IMAGE_NAME = "image"  # name of a single image
MIN_MARKED_POINTS = 3
"""Minimum number of points on an edge; two always fit the image of a straight line."""


@validate_arguments
def read_line_points(paths: Sequence[str | Path]) -> dict[str, tuple[Array, ...]]:
    """Read points on straight edges from CSV tables with a header line.

    Parameters
    ----------
    paths
        CSV files with the columns ``line`` (name or number of the edge), ``u_px``, ``v_px``, and
        ``image`` for several images.

    Returns
    -------
    dict
        Edges of each image by its name: points (n, 2) px.

    Raises
    ------
    InvalidParameter
        If a column is missing or unknown, a value is not a number, or an edge has fewer than three
        points; the message names the line.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/edges.csv", "w") as file:
    ...         _ = file.write("line,u_px,v_px\\ndoor,10,20\\ndoor,11,40.5\\ndoor,13,61\\n")
    ...     om.read_line_points([f"{folder}/edges.csv"])["image"][0].tolist()
    [[10.0, 20.0], [11.0, 40.5], [13.0, 61.0]]
    """
    points: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for path in map(Path, paths):
        for row in read_point_table(path, "points on lines", (COLUMNS,))[1]:
            image = row.cells.get(IMAGE_COLUMN) or DEFAULT_IMAGE_NAME
            pixel = row.number("u_px"), row.number("v_px")
            points.setdefault(image, {}).setdefault(row.cells["line"], []).append(pixel)
        for image, edges in points.items():
            for edge, pixels in edges.items():
                if len(pixels) < MIN_MARKED_POINTS:
                    raise InvalidParameter(
                        f"{path.name}: line {edge} of {image} must have at least "
                        f"{MIN_MARKED_POINTS} points; got {len(pixels)}"
                    )
    return {
        image: tuple(np.array(pixels) for pixels in edges.values())
        for image, edges in points.items()
    }


# -- Plumb-line fit --------------------------------------------------------------------------------
#
# Each edge is in a plane through the viewpoint with unit normal n; the direction d of each of its
# pixels satisfies ``n . d = 0``. The residual is the distance of the pixel from the image of that
# plane in pixels, to first order ``n . d / |(dd/du)^T n|``. Angular residuals would be minimal for
# a model that compresses the whole scene into one direction. Normals are fitted for each trial and
# eliminated, which leaves only the parameters of the camera.

NORMAL_STEPS = 3
MAX_STEPS = 40
RELATIVE_TOLERANCE = 1e-7
SCALE_PX = 0.5  # residual above which an edge is downweighted
MIN_VISIBLE_POINTS = 6  # minimum visible points of an edge, or all of an edge with fewer
UNSEEN_PX = 10.0


class FreeParameters(NamedTuple):
    """Free parameters of a model, some of them coupled."""

    names: tuple[tuple[str, ...], ...]
    """Names of parameters; coupled ones form a group."""
    turn: Array
    """Change (p, q) of each model parameter by each free parameter."""
    prior: Array
    """Expected values (q,)."""
    information: Array
    """Information (q,), 1 / sigma^2, of the expected values."""
    scales: Array
    """Typical changes (q,)."""


class Edges(NamedTuple):
    """Concatenated chains of all images."""

    pixels: Array
    """Pixels (n, 2)."""
    slices: tuple[slice, ...]


@dataclass(frozen=True)
class LinesFit:
    """Fit of a model to its edges."""

    model: CameraModel
    values: Array
    """Changes (q,) of the free parameters."""
    normals: Array
    """Plane normals (chains, 3) in the camera frame."""
    residuals: Array
    """Residuals (n,) px; NaN for pixels outside the model's field."""
    rates: Array
    """Derivatives (n, q) of the residuals with respect to the free parameters, normals eliminated.
    """
    cost: float
    weights: Array
    """Weights (chains,) from 0 to 1."""

    def rms_of(self, edges: Edges) -> Array:
        """Return the RMS residual (chains,) px; infinite for invisible chains."""
        return np.array([_rms(self.residuals[part]) for part in edges.slices])


def edges_of(chains: Sequence[Array]) -> Edges:
    """Return concatenated chains (n, 2)."""
    ends = np.cumsum([len(chain) for chain in chains])
    parts = tuple(slice(int(e) - len(c), int(e)) for e, c in zip(ends, chains, strict=True))
    return Edges(np.concatenate(chains), parts)


def fit_lines(
    model: CameraModel,
    edges: Edges,
    free: FreeParameters,
    *,
    distance_mm: float = np.inf,
    max_steps: int = MAX_STEPS,
) -> LinesFit:
    """Return the model with the straightest edges, starting from an initial model."""
    start = np.array([p.value for p in model.parameters])

    def linearise(fit: LinesFit) -> Callable[[float], LinesFit | None]:
        matrix, gradient = normal_equations(fit, edges, free)

        def after_step(damping: float) -> LinesFit | None:
            values = fit.values + damped_step(matrix, gradient, damping)
            try:
                candidate = model.with_parameters(start + free.turn @ values)
                return _evaluate(candidate, edges, free, values, distance_mm)
            except OmnimirrorError:
                return None

        return after_step

    initial = _evaluate(model, edges, free, np.zeros(len(free.names)), distance_mm)
    return levenberg_marquardt(initial, linearise, max_steps, RELATIVE_TOLERANCE)


def normal_equations(fit: LinesFit, edges: Edges, free: FreeParameters) -> tuple[Array, Array]:
    """Return matrix (q, q) and gradient (q,) of the weighted squares, including priors."""
    matrix = np.diag(free.information).astype(float)
    gradient = free.information * (fit.values - free.prior)
    for part, weight in zip(edges.slices, fit.weights, strict=True):
        r, a = fit.residuals[part], fit.rates[part]
        visible = np.isfinite(r)
        matrix += weight * a[visible].T @ a[visible]
        gradient += weight * a[visible].T @ r[visible]
    return matrix, gradient


def leave_one_out_gradients(fit: LinesFit, edges: Edges, matrix: Array) -> Array:
    """Return the gradients (chains, q) of each chain at the model fitted without it."""
    scale = np.sqrt(np.diag(matrix))
    inverse = np.linalg.pinv(matrix / np.outer(scale, scale), hermitian=True)
    gradients = []
    for part, weight in zip(edges.slices, fit.weights, strict=True):
        rates = np.nan_to_num(fit.rates[part]) / scale
        leverage = weight * rates.T @ rates @ inverse
        gradient = weight * rates.T @ np.nan_to_num(fit.residuals[part])
        gradients.append(
            np.linalg.lstsq(np.eye(len(leverage)) - leverage, gradient, rcond=None)[0] * scale
        )
    return np.array(gradients)


def _evaluate(
    model: CameraModel, edges: Edges, free: FreeParameters, values: Array, distance_mm: float
) -> LinesFit:
    """Evaluate all chains at once, with sums over each chain by reduction."""
    order = np.concatenate([np.arange(part.start, part.stop) for part in edges.slices])
    sizes = np.array([part.stop - part.start for part in edges.slices])
    owner, starts = (
        np.repeat(np.arange(len(sizes)), sizes),
        np.concatenate([[0], np.cumsum(sizes)[:-1]]),
    )
    directions, by_pixel, by_parameter, visible = _pixel_directions(
        model, edges.pixels[order], distance_mm
    )
    is_sufficient = np.add.reduceat(visible.astype(int), starts) >= np.minimum(
        MIN_VISIBLE_POINTS, sizes
    )
    visible &= is_sufficient[owner]
    count = np.maximum(np.add.reduceat(visible.astype(int), starts), 1)
    e, j, change = (
        np.where(visible[(...,) + (None,) * (a.ndim - 1)], a, 0.0)
        for a in (directions, by_pixel, by_parameter)
    )
    normal, slant = _planes(e, j, visible, owner, starts)
    r = np.einsum("ni,ni->n", e, normal[owner]) / slant
    by_normal = (
        np.einsum("ni,nik->nk", e, perpendicular_axes(normal)[owner]) / slant[:, None]
    )  # rotations of the normal n
    by_free = np.einsum("nip,ni->np", change, normal[owner]) @ free.turn / slant[:, None]
    inner = np.add.reduceat(by_normal[:, :, None] * by_normal[:, None, :], starts) + 1e-30 * np.eye(
        2
    )
    outer = np.add.reduceat(by_normal[:, :, None] * by_free[:, None, :], starts)
    by_free = by_free - np.einsum(
        "nk,nkq->nq", by_normal, (np.linalg.pinv(inner, hermitian=True) @ outer)[owner]
    )
    square = np.add.reduceat(r**2, starts) / count
    cost = float((sizes * np.where(is_sufficient, _loss(square), _loss(UNSEEN_PX**2))).sum())
    cost += float((free.information * (values - free.prior) ** 2).sum())
    residuals, rates = (
        np.full(len(edges.pixels), np.nan),
        np.zeros((len(edges.pixels), len(free.names))),
    )
    residuals[order], rates[order] = np.where(visible, r, np.nan), by_free
    normal[~is_sufficient] = np.nan
    return LinesFit(
        model,
        values,
        normal,
        residuals,
        rates,
        cost,
        np.where(is_sufficient, 1 / (1 + square / SCALE_PX**2), 0.0),
    )


def _loss(square: Any) -> Any:
    """Return the robust loss of a chain's mean square, which saturates for curved chains."""
    return SCALE_PX**2 * np.log1p(square / SCALE_PX**2)


def _planes(
    e: Array, j: Array, visible: Mask, owner: NDArray[np.int64], starts: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Return normals (chains, 3) of planes fitted to directions (n, 3) in pixels, and |J^T n| (n,).

    The unit of |J^T n| is radians per pixel.
    """
    weight = visible.astype(float)
    for _ in range(NORMAL_STEPS):
        moments = np.add.reduceat(weight[:, None, None] * e[:, :, None] * e[:, None, :], starts)
        normal = np.linalg.eigh(moments)[1][:, :, 0]
        slant = np.maximum(np.linalg.norm(np.einsum("nik,ni->nk", j, normal[owner]), axis=1), 1e-12)
        weight = visible / slant**2
    return normal, np.where(visible, slant, 1.0)


def _pixel_directions(
    model: CameraModel, pixels: Array, distance_mm: float
) -> tuple[Array, Array, Array, Mask]:
    """Return directions (n, 3) of pixels in the camera frame and their derivatives.

    Derivatives are with respect to pixels (n, 3, 2) and parameters (n, 3, p). For a camera with
    several viewpoints, directions are those from the point nearest to all rays to points on the
    rays at the given distance.
    """
    rays = model.backproject(pixels)
    world = model.mount.rotation()
    directions, origins = (
        rotate_vectors(rays.directions, world),
        rotate_vectors(rays.origins, world),
    )
    towards, length = directions, np.ones(len(pixels))
    if np.isfinite(distance_mm):
        points = origins + distance_mm * directions
        towards = points - _nearest_point(origins[rays.valid], directions[rays.valid])
        length = np.linalg.norm(towards, axis=1)
        towards = towards / length[:, None]
        image = model.image(np.nan_to_num(points), distant=False)
    else:
        image = model.image(np.nan_to_num(directions, nan=1.0), distant=True)
    across = perpendicular_axes(towards)
    by_angle = image.d_points @ across * length[:, None, None]
    visible = rays.valid & image.valid & np.isfinite(image.d_parameters).all(axis=(1, 2))
    visible[visible] = np.abs(np.linalg.det(by_angle[visible])) > 0
    to_angles = np.full((len(pixels), 3, 2), np.nan)
    to_angles[visible] = across[visible] @ np.linalg.inv(by_angle[visible])
    return towards, to_angles, -to_angles @ image.d_parameters, visible


def _nearest_point(origins: Array, directions: Array) -> Array:
    """Return the point (3,) nearest to rays with origins (n, 3) and directions (n, 3)."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    point: Array = np.linalg.lstsq(
        across.sum(axis=0), np.einsum("nij,nj->i", across, origins), rcond=None
    )[0]
    return point


def _rms(residuals: Array) -> float:
    finite_residuals = residuals[np.isfinite(residuals)]
    return (
        float(np.sqrt((finite_residuals**2).mean()))
        if len(finite_residuals) >= min(MIN_VISIBLE_POINTS, len(residuals))
        else np.inf
    )


# -- Edges as observations of a bundle adjustment --------------------------------------------------
#
# An edge has no target pose: it is in a plane through the viewpoint, which the plumb-line fit
# eliminates. Near a camera, the contribution of edges is therefore a quadratic form in its
# parameters. It is added to the normal equations like a prior and relinearised at each solution
# until convergence to the minimum of the total sum.

MIN_EDGES = 3  # minimum number of edges
INDEPENDENT_VALUES = 4  # independent values per edge, whatever its number of points
MIN_EDGE_NOISE_PX = 0.05
OUTLYING, MIN_OUTLYING_PX, MAX_PX = 3.0, 0.4, 3.0  # outlier limits: ratio to median, min and max
MIN_RELATIVE_EIGENVALUE = (
    1e-12  # relative to the largest eigenvalue; smaller ones are unconstrained
)


class EdgeInformation(NamedTuple):
    """Information on model parameters from edges."""

    information: Array
    """Information matrix (p, p), the inverse of a covariance."""
    expected: Array
    """Expected values (p,)."""


class Edge(NamedTuple):
    """Points marked on one straight edge."""

    image: str
    number: int
    """Number in its image, from 1."""
    pixels: Array
    """Pixels (n, 2)."""

    @property
    def name(self) -> str:
        return f"edge {self.number} of {self.image}"


@dataclass(frozen=True)
class StraightEdges:
    """Edges of all images, with a distance that is relevant for cameras with several viewpoints."""

    edges: tuple[Edge, ...]
    distance_mm: float = np.inf

    @classmethod
    def of(
        cls, lines: Mapping[str, Sequence[Array]], distance_mm: float, size: tuple[int, int]
    ) -> StraightEdges:
        """Create from the result of :func:`omnimirror.read_line_points`.

        Raises
        ------
        InvalidParameter
            If there are too few edges or points, or points outside the image.
        """
        number("lines_distance_mm", distance_mm if np.isfinite(distance_mm) else 1.0, above=0.0)
        edges = []
        for image, image_edges in lines.items():
            for number_in_image, points in enumerate(image_edges, 1):
                edge = Edge(image, number_in_image, finite("lines", points, last=2))
                if edge.pixels.ndim != 2 or len(edge.pixels) < MIN_MARKED_POINTS:
                    raise InvalidParameter(
                        f"{edge.name} must be an array (n, 2) with n >= "
                        f"{MIN_MARKED_POINTS}; got shape {edge.pixels.shape}"
                    )
                outside = np.any(
                    (edge.pixels < -0.5) | (edge.pixels > np.array(size) - 0.5), axis=1
                )
                if outside.any():
                    (u, v), (width, height) = edge.pixels[outside][0], size
                    raise InvalidParameter(
                        f"{edge.name}: pixels must be inside the image of {width} x {height} px; got {u:g}, {v:g}"
                    )
                edges.append(edge)
        if len(edges) < MIN_EDGES:
            raise InvalidParameter(
                f"lines must contain at least {MIN_EDGES} edges; got {len(edges)}"
            )
        return cls(tuple(edges), distance_mm)

    def fit(self, model: CameraModel) -> LinesFit:
        """Evaluate the straightness of the edges for a camera without changing it."""
        names = tuple((p.name,) for p in model.parameters)
        zeros = np.zeros(len(names))
        free = FreeParameters(
            names, np.eye(len(names)), zeros, zeros, np.array([p.scale for p in model.parameters])
        )
        chains = edges_of([edge.pixels for edge in self.edges])
        return fit_lines(model, chains, free, distance_mm=self.distance_mm, max_steps=0)

    def rms_px(self, model: CameraModel) -> Array:
        """Return the rms deviation (k,) of each edge from a straight line's image, px.

        It is infinite for invisible edges.
        """
        return self.fit(model).rms_of(edges_of([edge.pixels for edge in self.edges]))

    def information(self, model: CameraModel) -> EdgeInformation:
        """Return the information on the parameters of a camera, linearised at this camera.

        Errors of points on one edge are correlated if it is not exactly straight: an edge counts as
        a few independent values, whatever its number of points.
        """
        fit = self.fit(model)
        count = len(model.parameters)
        matrix, gradient, squares, values = np.zeros((count, count)), np.zeros(count), 0.0, 0.0
        for part, weight in zip(
            edges_of([e.pixels for e in self.edges]).slices, fit.weights, strict=True
        ):
            visible = np.isfinite(fit.residuals[part])
            r, a = fit.residuals[part][visible], fit.rates[part][visible]
            independent = min(len(r) - 2, INDEPENDENT_VALUES)  # two define its plane
            if independent < 1:
                continue
            point_weight = float(weight) * independent / len(r)
            matrix, gradient = matrix + point_weight * a.T @ a, gradient + point_weight * a.T @ r
            squares, values = (
                squares + point_weight * len(r) / (len(r) - 2) * float(r @ r),
                values + float(weight) * independent,
            )
        noise = max(float(np.sqrt(squares / values)) if values else 1.0, MIN_EDGE_NOISE_PX)
        start = np.array([p.value for p in model.parameters])
        return EdgeInformation(
            matrix / noise**2,
            start - _regularised_solution(matrix, gradient, [p.scale for p in model.parameters]),
        )

    def select_straight(self, model: CameraModel) -> StraightEdges:
        """Return the edges that a camera model undistorts to straight lines or does not image."""
        rms = self.rms_px(model)
        finite_rms = rms[np.isfinite(rms)]
        limit = (
            min(max(OUTLYING * float(np.median(finite_rms)), MIN_OUTLYING_PX), MAX_PX)
            if len(finite_rms)
            else 0.0
        )
        straight = tuple(
            edge for edge, r in zip(self.edges, rms, strict=True) if r <= limit or np.isinf(r)
        )
        if (count := int((rms <= limit).sum())) < MIN_EDGES:
            raise InvalidParameter(
                f"at least {MIN_EDGES} of {len(self.edges)} edges must be straight for "
                f"this camera; got {count}; check that the lines belong to its images"
            )
        return replace(self, edges=straight)


def _regularised_solution(matrix: Array, gradient: Array, scales: Sequence[float]) -> Array:
    """Return the step of minimum norm, in typical parameter changes, to a zero gradient."""
    size = np.asarray(scales)
    inverse = np.linalg.pinv(
        matrix * size[:, None] * size, rcond=MIN_RELATIVE_EIGENVALUE, hermitian=True
    )
    return np.asarray(size * (inverse @ (size * gradient)))
