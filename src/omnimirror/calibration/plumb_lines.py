"""Plumb-line calibration without a target, from straight edges in images of rooms and streets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import finite, instance, number, validate_arguments
from ..base.errors import InvalidParameter
from ..base.parameters import Uncertainty
from ..base.results import Columns, Result, table_of
from ..base.typing import Array
from ..cameras.camera import Mount
from ..cameras.models import Unified
from ..cameras.models.camera_model import CameraModel, Optics, measured_field_deg
from ..optics.sensor import Sensor
from .edge_detection import edge_chains
from .levelling import Level, level_from_edges, level_from_image
from .sensor_model import SensorModel
from .straight_edges import (
    MIN_MARKED_POINTS,
    SCALE_PX,
    Edges,
    FreeParameters,
    LinesFit,
    edges_of,
    fit_lines,
    leave_one_out_gradients,
    normal_equations,
    read_line_points,
)
from .uncertainty import direction_uncertainty

__all__ = [
    "Level",
    "PlumbLineCalibration",
    "calibrate_plumb_lines",
    "draw_edges",
    "edge_chains",
    "level_from_edges",
    "level_from_image",
    "read_line_points",
]


# -- Plumb-line calibration ------------------------------------------------------------------------

XIS = (0.6, 0.8, 0.9, 1.0, 1.1, 1.25, 1.5, 1.8)
FOCALS = np.geomspace(0.2, 2.5, 14)
"""Trial values for an unknown camera: xi, and focal length in radii of the field for xi = 1."""
XI_SIGMA = 0.5
STRETCH_SIGMA = 0.3
"""Standard deviation of s - 1 in ``tan Omega -> s tan Omega`` for an unknown camera.

This stretch of the field preserves straight lines.
"""
TRIED, THINNED = 60, 4  # number of the longest chains in that search, and thinning factor
SEARCH_STEPS = 8
MIN_CHAINS = 8
CENTRE_SIGMA = 0.01  # fraction of the field's radius
LOOSE_PRIOR = 10.0  # typical changes; prior of a model to be refined, without other information
OUTLYING, MIN_OUTLYING_PX = 3.0, 0.4
OUTLIER_PASSES = 3  # passes of outlier rejection
FREE_PX = 5.0


@dataclass(frozen=True)
class PlumbLineCalibration(Result):
    """Result of a plumb-line calibration.

    Parameters
    ----------
    camera
        Refined camera with its uncertainty, levelled if upright edges were found.
    chains
        Detected edges of each image: points (n, 2) px.
    used
        Whether each chain of each image is straight.
    rms_px
        RMS distance of the points of used edges from their edges.
    free
        Combinations of parameters that the edges do not determine.
    levels
        Tilt of the camera in each image; None without upright edges.
    distance_mm
        Assumed distance of the edges; relevant for cameras with several viewpoints.

    Examples
    --------
    Grid of a window in front of a horizontal camera with a field of 90 deg:

    >>> import omnimirror as om
    >>> picture = np.full((400, 400), 90, np.uint8)
    >>> for at in range(40, 380, 64):
    ...     picture[at : at + 6], picture[:, at : at + 6] = 200, 200
    >>> camera = om.KannalaBrandt(
    ...     focal_px=(250.0, 250.0), centre_px=(199.5, 199.5), image_size=(400, 400), k1=0.3
    ... )
    >>> found = om.calibrate_plumb_lines([picture], model=camera)
    >>> sum(found.used[0]) >= 8
    True
    """

    camera: Sensor | CameraModel
    chains: tuple[tuple[Array, ...], ...]
    used: tuple[tuple[bool, ...], ...]
    rms_px: float
    free: tuple[str, ...]
    levels: tuple[Level | None, ...]
    distance_mm: float

    def _table(self) -> Columns:
        return table_of(
            {"image": image, "edge": edge, "points": len(points), "used": used}
            for image, (chains, is_used) in enumerate(zip(self.chains, self.used, strict=True), 1)
            for edge, (points, used) in enumerate(zip(chains, is_used, strict=True), 1)
        )

    def to_dict(self) -> dict[str, Any]:
        """Convert to plain data for files.

        Returns
        -------
        dict
            ``rms_px``, ``parameters`` (name, value, sigma, unit), ``free`` and ``images``
            (edges, used, level).
        """
        uncertainty = self.camera.uncertainty
        sigmas = {} if uncertainty is None else {k: float(v) for k, v in uncertainty.sigmas.items()}
        model = self.camera
        if isinstance(model, Sensor):
            model = SensorModel(model, tuple(sigmas))
        return {
            "rms_px": self.rms_px,
            "parameters": [
                {"name": p.name, "value": p.value, "sigma": sigmas[p.name], "unit": p.unit}
                for p in model.parameters
                if p.name in sigmas
            ],
            "free": list(self.free),
            "images": [
                {
                    "edges": len(used),
                    "used": sum(used),
                    "level": None if level is None else level._asdict(),
                }
                for used, level in zip(self.used, self.levels, strict=True)
            ],
        }


@validate_arguments
def calibrate_plumb_lines(
    images: Sequence[NDArray[Any]] = (),
    *,
    lines: Sequence[Sequence[Array]] = (),
    image_size: tuple[int, int] | None = None,
    model: Sensor | CameraModel | None = None,
    optics: Optics = "mirror",
    mount: Mount | None = None,
    centre_px: tuple[float, float] | None = None,
    radius_px: float | None = None,
    inner_radius_px: float = 0.0,
    distance_mm: float = np.inf,
) -> PlumbLineCalibration:
    """Refine a camera so that straight edges of the scene map to planes through its viewpoint.

    Edges are traced in the images. Edges of curved objects have a low weight and are rejected at
    the end. Lines contain no scale, and parallax only for cameras with several viewpoints, whose
    edges are assumed at ``distance_mm``.

    Parameters
    ----------
    images
        One or several images of the same camera, (height, width, 3) uint8 RGB or (height, width).
    lines
        Marked edges of each image, and of further images: points (n, 2) px, n at least 3
        (:func:`omnimirror.read_line_points`). They are used in addition to the traced ones.
    image_size : (width, height), px
        Image size, if only lines are given.
    model
        Model to refine: a sensor or its :class:`omnimirror.SensorModel`, whose free parameters are
        estimated within their tolerances, or a camera model. By default an unknown camera, for
        which a unified model is estimated. It is exact for mirrors with one viewpoint and accurate
        to some degrees for others: stretching the scene along the camera's axis preserves lines,
        and only a known type of mirror determines the stretch.
    optics
        Optics of the unknown camera: ``"mirror"`` or ``"fisheye"``.
    mount
        Orientation of the unknown camera.
    centre_px, radius_px
        Circle of the field, from the mirror's rim; by default the largest in the image.
    inner_radius_px
        Radius of the camera's own image.
    distance_mm
        Distance of the edges.

    Returns
    -------
    PlumbLineCalibration
        Camera, edges and tilt.

    Raises
    ------
    InvalidParameter
        If there are no images, their sizes differ, or there are too few edges.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.calibrate_plumb_lines([np.zeros((64, 64), np.uint8)])
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.InvalidParameter: images must contain at least 8 long edges in different directions; got 0
    """
    # More than 60 lines: 10 parameters to check and pass on; the steps are functions.
    size = _size(images, lines, image_size)
    chains = _chains(images, lines, centre_px, radius_px, inner_radius_px)
    edges = edges_of([chain for image_chains in chains for chain in image_chains])
    number("distance_mm", distance_mm if np.isfinite(distance_mm) else 1.0, above=0.0)
    initial: CameraModel
    if model is None:
        radius = min(size) / 2 if radius_px is None else radius_px
        initial = _initial_model(edges, size, optics, mount or Mount(), centre_px, radius)
        free = _parameters_of_unknown_camera(initial, radius)
    else:
        instance("model", model, (Sensor, CameraModel), "a sensor or a camera model")
        initial = SensorModel(model) if isinstance(model, Sensor) else model
        if initial.image_size != size:
            raise InvalidParameter(
                f"model must have the size of the images, {size[0]} x {size[1]} px; got "
                f"{initial.image_size[0]} x {initial.image_size[1]} px"
            )
        free = _parameters_with_priors(initial)
    fit, retained = _without_curved_edges(initial, edges, free, distance_mm)
    covariance, undetermined = _parameter_covariance(fit, retained, free)
    if model is None:
        covariance = covariance + _stretch_covariance(fit.model, free)
    used_starts = {part.start for part in retained.slices}
    used = [
        tuple(part.start in used_starts for part in own) for own in _by_image(edges.slices, chains)
    ]
    image_index = np.repeat(
        np.arange(len(chains)), [sum(map(len, image_chains)) for image_chains in chains]
    )[[s.start for s in retained.slices]]
    lengths = np.array([float(part.stop - part.start) for part in retained.slices])
    levels = [
        level_from_edges(fit.normals[image_index == i], lengths[image_index == i], initial.mount)
        for i in range(len(chains))
    ]
    field = measured_field_deg(
        fit.model, np.concatenate([edges.pixels[part] for part in retained.slices])
    )
    camera = _calibrated_camera(fit.model, covariance, levels[0], field)
    levels = [level and _with_camera_uncertainty(camera, level) for level in levels]
    residuals = np.concatenate([fit.residuals[part] for part in retained.slices])
    rms = float(np.sqrt(np.nanmean(residuals**2)))
    return PlumbLineCalibration(
        camera,
        tuple(map(tuple, chains)),
        tuple(used),
        rms,
        undetermined,
        tuple(levels),
        distance_mm,
    )


def _size(
    images: Sequence[NDArray[Any]],
    lines: Sequence[Sequence[Array]],
    specified: tuple[int, int] | None,
) -> tuple[int, int]:
    """Return the common size (width, height) of all images."""
    sizes = {(image.shape[1], image.shape[0]) for image in images} | (
        {tuple(specified)} if specified else set()
    )
    if not images and not lines:
        raise InvalidParameter("images or lines must contain at least one image; got none")
    if not sizes:
        raise InvalidParameter(
            "image_size (--image-size) must be specified for lines without images"
        )
    if len(sizes) > 1:
        raise InvalidParameter(f"images must have one size; got {len(sizes)} different sizes")
    ((width, height),) = sizes
    return int(width), int(height)


def _chains(
    images: Sequence[NDArray[Any]],
    lines: Sequence[Sequence[Array]],
    centre: tuple[float, float] | None,
    radius: float | None,
    inner: float,
) -> list[list[Array]]:
    """Return the traced and marked edges of each image, after a check of their number."""
    traced = [
        edge_chains(p, centre_px=centre, radius_px=radius, inner_radius_px=inner) for p in images
    ]
    marked = [[_checked_edge(edge) for edge in edges] for edges in lines]
    empty: list[Array] = []
    chains = [[*a, *b] for a, b in zip_longest(traced, marked, fillvalue=empty)]
    count = sum(map(len, chains))
    if count < MIN_CHAINS:
        raise InvalidParameter(
            f"images must contain at least {MIN_CHAINS} long edges in different directions; got {count}"
        )
    return chains


def _checked_edge(edge: Array) -> Array:
    points = finite("lines", edge, last=2)
    if points.ndim != 2 or len(points) < MIN_MARKED_POINTS:
        raise InvalidParameter(
            f"lines must be arrays (n, 2) with n >= {MIN_MARKED_POINTS}; got shape {points.shape}"
        )
    return points


def _initial_model(
    edges: Edges,
    size: tuple[int, int],
    optics: Optics,
    mount: Mount,
    centre: tuple[float, float] | None,
    radius: float,
) -> CameraModel:
    """Return the unified camera with the straightest edges."""
    principal_point = centre or ((size[0] - 1) / 2, (size[1] - 1) / 2)
    longest = sorted(edges.slices, key=lambda part: part.start - part.stop)[:TRIED]
    sample = edges_of([edges.pixels[part][::THINNED] for part in longest])
    best: LinesFit | None = None
    for xi in XIS:
        trials = []
        for focal in FOCALS * radius * (1 + xi) / 2:
            model = Unified(
                xi=xi,
                focal_px=(float(focal),) * 2,
                centre_px=principal_point,
                image_size=size,
                optics=optics,
                mount=mount,
            )
            trials.append(
                fit_lines(model, sample, _parameters_of_unknown_camera(model, radius), max_steps=0)
            )
        initial = min(trials, key=lambda fit: fit.cost).model
        candidate = fit_lines(
            initial, sample, _parameters_of_unknown_camera(initial, radius), max_steps=SEARCH_STEPS
        )
        best = candidate if best is None or candidate.cost < best.cost else best
    assert best is not None
    return best.model


def _parameters_of_unknown_camera(model: CameraModel, radius: float) -> FreeParameters:
    """Return the free parameters of an unknown camera: xi, a common focal length and the centre."""
    groups = (("xi",), ("fx", "fy"), ("cx",), ("cy",))
    sigma = np.array([XI_SIGMA, np.inf, CENTRE_SIGMA * radius, CENTRE_SIGMA * radius])
    xi = next(p.value for p in model.parameters if p.name == "xi")
    return _free_parameters(model, groups, np.array([1.0 - xi, 0.0, 0.0, 0.0]), sigma)


def _stretch_covariance(model: CameraModel, free: FreeParameters) -> Array:
    """Return the covariance (p, p) of a stretch of the scene along the camera's axis.

    Planes through the viewpoint remain planes under ``tan Omega -> s tan Omega``; therefore lines
    do not determine s. For a camera of known type s is fixed; for an unknown one this covariance is
    added.
    """
    omega, phi = (
        a.ravel()
        for a in np.meshgrid(np.radians(np.linspace(10, 110, 11)), np.arange(0, 2 * np.pi, 0.5))
    )
    across = np.stack([np.cos(phi), np.sin(phi)])
    forward = -1.0 if model.optics == "mirror" else 1.0
    image = model.image(
        np.stack([*(np.sin(omega) * across), forward * np.cos(omega)], axis=1), distant=True
    )
    d_directions = (
        np.stack([*(np.cos(omega) * across), -forward * np.sin(omega)], axis=1)
        * np.sin(2 * omega)[:, None]
        / 2
    )
    is_valid = image.valid
    d_pixels = np.einsum("nij,nj->ni", image.d_points[is_valid], d_directions[is_valid]).ravel()
    derivatives = (image.d_parameters[is_valid] @ free.turn).reshape(len(d_pixels), -1)
    change = free.turn @ np.linalg.lstsq(derivatives, d_pixels, rcond=None)[0] * STRETCH_SIGMA
    covariance: Array = np.outer(change, change)
    return covariance


def _parameters_with_priors(model: CameraModel) -> FreeParameters:
    """Return the free parameters of a model to refine, with priors.

    Priors are the tolerances, or typical changes.
    """
    priors = {p.name: p for p in getattr(model, "priors", ())}
    expected = np.array(
        [priors[p.name].value - p.value if p.name in priors else 0.0 for p in model.parameters]
    )
    sigma = np.array(
        [
            priors[p.name].sigma if p.name in priors else LOOSE_PRIOR * p.scale
            for p in model.parameters
        ]
    )
    return _free_parameters(model, tuple((p.name,) for p in model.parameters), expected, sigma)


def _free_parameters(
    model: CameraModel, groups: tuple[tuple[str, ...], ...], expected: Array, sigma: Array
) -> FreeParameters:
    names = [p.name for p in model.parameters]
    jacobian = np.zeros((len(names), len(groups)))
    for column, group in enumerate(groups):
        for name in group:
            jacobian[names.index(name), column] = 1.0
    scales = np.array([model.parameters[names.index(group[0])].scale for group in groups])
    return FreeParameters(groups, jacobian, expected, SCALE_PX**2 / sigma**2, scales)


def _without_curved_edges(
    model: CameraModel, edges: Edges, free: FreeParameters, distance_mm: float
) -> tuple[LinesFit, Edges]:
    """Return the fit, and the edges that are straight after undistortion."""
    retained = edges
    fit = fit_lines(model, retained, free, distance_mm=distance_mm)
    for _ in range(OUTLIER_PASSES):
        rms = fit.rms_of(retained)
        limit = max(OUTLYING * float(np.median(rms[np.isfinite(rms)])), MIN_OUTLYING_PX)
        straight = [part for part, r in zip(retained.slices, rms, strict=True) if r <= limit]
        if len(straight) < MIN_CHAINS:
            raise InvalidParameter(
                f"at least {MIN_CHAINS} edges must be straight for one camera; got "
                f"{len(straight)} of {len(edges.slices)}; check that the images are from "
                "this camera"
            )
        if len(straight) == len(rms):
            break
        retained = Edges(edges.pixels, tuple(straight))
        fit = fit_lines(model, retained, free, distance_mm=distance_mm)
    return fit, retained


def _by_image(slices: Sequence[slice], chains: Sequence[Sequence[Array]]) -> list[Sequence[slice]]:
    """Return the concatenated chains grouped by image."""
    ends = np.cumsum([len(image_chains) for image_chains in chains])
    return [
        slices[int(end) - len(image_chains) : int(end)]
        for end, image_chains in zip(ends, chains, strict=True)
    ]


def _parameter_covariance(
    fit: LinesFit, edges: Edges, free: FreeParameters
) -> tuple[Array, tuple[str, ...]]:
    """Return the covariance (p, p) of the parameters, and the undetermined combinations.

    Errors of points on one edge are correlated if it is not exactly straight, or near. Therefore
    each edge counts as one observation (cluster-robust covariance): ``H^-1 (sum g g^T) H^-1`` with
    the gradients g of the edges. Each gradient is evaluated at the model without this edge (Bell
    and McCaffrey, Survey Methodology 28 (2002)), because a fit to few edges reduces their
    residuals.
    """
    matrix, _ = normal_equations(fit, edges, free)
    gradients = leave_one_out_gradients(fit, edges, matrix)
    count = len(gradients)
    scatter = (
        gradients.T @ gradients * (count - 1) / count + np.diag(free.information) * SCALE_PX**2
    )
    sizes = np.outer(free.scales, free.scales)
    inverse = np.linalg.pinv(matrix * sizes, hermitian=True)
    scaled = inverse @ (scatter * sizes) @ inverse
    values, vectors = np.linalg.eigh(scaled)
    undetermined = []
    for value, vector in zip(values, vectors.T, strict=True):
        if np.sqrt(max(value, 0.0)) > FREE_PX:
            order = np.argsort(-np.abs(vector))
            group_names = [
                free.names[i] for i in order if abs(vector[i]) > 0.25 * np.abs(vector).max()
            ]
            undetermined.append(" with ".join("/".join(group) for group in group_names))
    covariance: Array = free.turn @ (scaled * sizes) @ free.turn.T
    return (covariance + covariance.T) / 2, tuple(undetermined)


def _calibrated_camera(
    model: CameraModel, covariance: Array, level: Level | None, field_deg: float | None
) -> Sensor | CameraModel:
    """Return the levelled camera with its uncertainty and the field in which edges were measured."""
    is_free = np.diag(covariance) > 0
    names = [p.name for p, free in zip(model.parameters, is_free, strict=True) if free]
    uncertainty = Uncertainty(
        tuple(names), tuple(map(tuple, covariance[np.ix_(is_free, is_free)])), field_deg
    )
    camera: Any = model.sensor if isinstance(model, SensorModel) else model
    mount = camera.mount if level is None else level.on(camera.mount)
    calibrated: Sensor | CameraModel = replace(camera, uncertainty=uncertainty, mount=mount)
    return calibrated


def _with_camera_uncertainty(camera: Sensor | CameraModel, level: Level) -> Level:
    """Return the tilt including the camera's own uncertainty in the vertical direction.

    The vertical direction may be outside the calibrated field.
    """
    up = level.on(camera.mount).rotation()[2]
    model = SensorModel(camera) if isinstance(camera, Sensor) else camera
    image = model.image(np.array([up, -up]), distant=True)
    pixels = image.pixels[image.valid]
    sigma = direction_uncertainty(camera, pixels, field_deg=180.0) if len(pixels) else np.zeros(0)
    finite_sigma = sigma[np.isfinite(sigma)]
    return (
        level._replace(sigma_deg=float(np.hypot(level.sigma_deg, finite_sigma.min())))
        if len(finite_sigma)
        else level
    )


def draw_edges(
    image: NDArray[Any], chains: Sequence[Array], used: Sequence[bool]
) -> NDArray[np.uint8]:
    """Draw edges on the darkened image: green if straight for the camera, otherwise red."""
    import cv2

    rgb = np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image
    canvas: NDArray[np.uint8] = np.ascontiguousarray(rgb // 2).astype(np.uint8)
    for chain, straight in zip(chains, used, strict=True):
        colour = (80, 230, 120) if straight else (240, 80, 60)
        cv2.polylines(
            canvas, [np.round(chain * 16).astype(np.int32)], False, colour, 1, cv2.LINE_AA, 4
        )
    return canvas
