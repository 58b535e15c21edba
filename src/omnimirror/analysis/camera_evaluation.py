"""Evaluation of a calibrated camera: mapping, resolution, viewpoint and uncertainty."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import instance, row
from ..base.errors import OutsideField
from ..base.files import write_text
from ..base.quantities import QUANTITIES
from ..base.results import Columns, FieldResult, Fields, column_fields, write_columns
from ..base.typing import Array
from ..cameras.camera import inside_image, rotate_vectors
from ..cameras.models import RadialModel
from ..cameras.models.camera_model import CameraModel, direction_sigma_deg

STEP_DEG = 5.0
AZIMUTHS = 36  # azimuths of the mean values
NEAR_AXIS_RAD = 1e-3  # radians; a ring at this angle still has distinct azimuths
SCAN_STEP_DEG = 0.5
BISECTIONS = 24  # bisections for the end of the field
MAPPING_COLUMNS = (
    *("omega_deg", "h_px", "dh_domega_px_per_deg", "width_px_per_deg", "area_px2", "aspect"),
    *("viewpoint_z_mm", "direction_sigma_deg"),
)


@dataclass(frozen=True)
class CameraMapping(FieldResult):
    """Mapping of a calibrated camera, computed by :func:`evaluate_camera`.

    Attributes
    ----------
    omega_deg : (n,)
        Field angles from the axis of the image centre.
    h_px : (n,)
        Image radii, before tangential distortion and stretch; for a misaligned sensor the mean
        distance from the pixel along the lens axis.
    dh_domega_px_per_deg, width_px_per_deg : (n,)
        Radial and azimuthal resolution.
    area_px2 : (n,)
        Image area of a square degree.
    aspect : (n,)
        Ratio of width to height of the image of a small square.
    viewpoint_z_mm : (n,)
        Intersection of the rays with the axis, along Z of the camera from the origin of its frame;
        without an axis, the point nearest to the rays of all azimuths.
    direction_sigma_deg : (n,)
        Standard deviation of a direction; NaN without an uncertainty, and outside the calibrated
        field.
    camera
        Evaluated camera.
    field_deg
        Largest field angle at any azimuth.
    rim_radius_px
        Image radius at the largest field angle.
    azimuthal_variation_percent
        Largest relative deviation of the resolution at an azimuth from the azimuthal mean, over the
        rows and the end of the field; 0 for a rotationally symmetric mapping.
    """

    omega_deg: Array
    h_px: Array
    dh_domega_px_per_deg: Array
    width_px_per_deg: Array
    area_px2: Array
    aspect: Array
    viewpoint_z_mm: Array
    direction_sigma_deg: Array
    camera: CameraModel
    field_deg: float
    rim_radius_px: float
    azimuthal_variation_percent: float = 0.0

    def _table(self) -> Columns:
        return self.columns()

    def _fields(self) -> Fields:
        names = ("field_deg", "rim_radius_px", "azimuthal_variation_percent")
        return column_fields(self.columns(), {name: getattr(self, name) for name in names})

    def __len__(self) -> int:
        return len(self.omega_deg)

    def columns(self) -> dict[str, Array]:
        """Return the columns (n,) of the table; uncertainties are included if known."""
        is_known = self.camera.uncertainty is not None
        return {
            name: getattr(self, name)
            for name in MAPPING_COLUMNS
            if is_known or name != "direction_sigma_deg"
        }

    def texts(self) -> dict[str, list[str]]:
        """Return the columns as formatted text, one list of cells each."""
        return {
            name: [QUANTITIES[name].text(v) for v in values]
            for name, values in self.columns().items()
        }

    def summary(self) -> dict[str, Any]:
        """Return the scalar results: model, parameters and field."""
        camera = self.camera
        sigmas = camera.uncertainty.sigmas if camera.uncertainty else {}
        return {
            "kind": camera.KIND,
            "optics": camera.optics,
            "field_deg": self.field_deg,
            "rim_radius_px": self.rim_radius_px,
            "calibrated_field_deg": camera.uncertainty.field_deg if camera.uncertainty else None,
            "is_central": isinstance(camera, RadialModel) and camera.is_central,
            "azimuthal_variation_percent": self.azimuthal_variation_percent,
            "parameters": [
                {"name": p.name, "value": p.value, "sigma": sigmas.get(p.name), "unit": p.unit}
                for p in camera.parameters
            ],
        }

    def to_csv(self, path: str | Path) -> None:
        """Write the table as CSV with 17 significant digits, exact for double precision."""
        write_columns(path, self.columns())

    def to_json(self, path: str | Path) -> None:
        """Write summary and columns as JSON; unknown values become null."""
        columns = {
            k: [v if np.isfinite(v) else None for v in c.tolist()]
            for k, c in self.columns().items()
        }
        write_text(
            path, json.dumps({"summary": self.summary(), "columns": columns}, indent=1) + "\n"
        )


def evaluate_camera(camera: CameraModel, omega_deg: ArrayLike | None = None) -> CameraMapping:
    """Evaluate a calibrated camera at field angles.

    Parameters
    ----------
    camera
        Camera, for example from :func:`omnimirror.load_camera`; use :func:`omnimirror.evaluate` for
        an aligned sensor. The :class:`omnimirror.SensorModel` of a decentred or tilted mirror is
        traced in three dimensions, because one meridian is not representative; the results are
        means over the visible azimuths.
    omega_deg : (n,), optional
        Field angles from the axis; by default every 5 deg of the field.

    Returns
    -------
    CameraMapping
        Columns (n,), one for each quantity.

    Raises
    ------
    OutsideField
        If the angle is outside the field of view.
    InvalidParameter
        If another argument is invalid.

    Examples
    --------
    For a paraboloid, the image of a small square at the horizon has equal height and width:

    >>> import omnimirror as om
    >>> found = evaluate_camera(
    ...     om.Unified(
    ...         xi=1.0, focal_px=(200.0, 200.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ...     ),
    ...     [45.0, 90.0],
    ... )
    >>> found.h_px, found.aspect
    (array([ 82.84271247, 200.        ]), array([1., 1.]))
    """
    instance("camera", camera, CameraModel, "a calibrated camera (see om.load_camera)")
    end = (
        float(np.degrees(camera.omega_max))
        if isinstance(camera, RadialModel)
        else _field_end_deg(camera)
    )
    requested = every_step(end) if omega_deg is None else row("omega_deg", omega_deg)
    if (outside := ~((requested >= 0) & (requested <= end * (1 + 1e-12)))).any():
        raise OutsideField(
            f"omega_deg must be 0 to {end:.6g} deg, the field of the camera; got {requested[outside][0]:g}"
        )
    if not isinstance(camera, RadialModel):
        return _evaluate_skew(camera, requested, end)
    omega = np.minimum(np.radians(requested), camera.omega_max)
    radius, rate, height = camera.mapping(omega)
    along = np.radians(rate)
    with np.errstate(divide="ignore", invalid="ignore"):
        across = np.where(np.sin(omega) > 1e-12, radius * np.radians(1.0) / np.sin(omega), along)
    sigma = (
        np.full(len(omega), np.nan) if camera.uncertainty is None else mean_sigma_deg(camera, omega)
    )
    columns = (radius, along, across, along * across, across / along, height, sigma)
    return CameraMapping(requested, *columns, camera, end, camera.field_radius_px)


def _evaluate_skew(camera: CameraModel, omega_deg: Array, end: float) -> CameraMapping:
    """Evaluate a camera without an axis on rings of directions."""
    omega = np.maximum(np.radians(np.append(omega_deg, end)), NEAR_AXIS_RAD)
    visible, (directions, outwards, around) = _sees(camera, omega), _rings(camera, omega)
    image = camera.image(directions.reshape(-1, 3), distant=True)
    pixels = np.where(image.valid[:, None], image.pixels, np.nan).reshape(*visible.shape, 2)
    rates = np.radians(image.d_points).reshape(*visible.shape, 2, 3)
    along, across = ((rates @ across[..., None])[..., 0] for across in (outwards, around))
    area = np.abs(along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0])
    sizes = [np.linalg.norm(part, axis=-1) for part in (along, across)]
    high, wide = (_mean(size, visible) for size in sizes)
    radius = _mean(np.linalg.norm(pixels - _image_centre(camera, end), axis=-1), visible)
    deviations = [
        np.abs(size / mean[:, None] - 1)[visible]
        for size, mean in zip(sizes, (high, wide), strict=True)
    ]
    sigma = (
        np.full(len(omega), np.nan) if camera.uncertainty is None else mean_sigma_deg(camera, omega)
    )
    heights = _viewpoints(camera, pixels, visible)
    columns = (
        radius,
        high,
        wide,
        _mean(area, visible),
        _mean(sizes[1] / sizes[0], visible),
        heights,
        sigma,
    )
    h, dh, dw, ds, aspect, height, error = (column[:-1] for column in columns)
    variation = 100 * float(np.max(np.concatenate(deviations)))
    return CameraMapping(
        omega_deg, h, dh, dw, ds, aspect, height, error, camera, end, float(radius[-1]), variation
    )


def _image_centre(camera: CameraModel, end: float) -> Array:
    """Return the pixel (2,) at the centre of the smallest completely visible ring."""
    rings = np.append(NEAR_AXIS_RAD, np.radians(np.arange(SCAN_STEP_DEG, end, SCAN_STEP_DEG)))
    image = camera.image(_rings(camera, rings)[0].reshape(-1, 3), distant=True)
    complete = np.flatnonzero(image.valid.reshape(-1, AZIMUTHS).all(axis=1))
    if not len(complete):
        raise OutsideField(
            "the camera must image at least one field angle at all azimuths, to define the centre of its image"
        )
    return np.asarray(image.pixels.reshape(-1, AZIMUTHS, 2)[complete[0]].mean(axis=0))


def _viewpoints(camera: CameraModel, pixels: Array, visible: NDArray[np.bool_]) -> Array:
    """Return the heights (n,) of the points nearest to the rays of each ring, or NaN."""
    heights = np.full(len(visible), np.nan)
    world = camera.mount.rotation()
    for i in np.flatnonzero(visible.sum(axis=1) > 1):
        rays = camera.backproject(pixels[i, visible[i]])
        origins, directions = (
            rotate_vectors(rays.origins[rays.valid], world),
            rotate_vectors(rays.directions[rays.valid], world),
        )
        if len(directions) > 1:
            # least squares: the point nearest to lines (p, d) satisfies sum(I - d d^T) v = sum(I - d d^T) p
            across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
            heights[i] = np.linalg.lstsq(
                across.sum(axis=0), np.einsum("nij,nj->i", across, origins), rcond=None
            )[0][2]
    return heights


def _mean(values: Array, visible: NDArray[np.bool_]) -> Array:
    """Return means (n,) over the visible azimuths (n, k); NaN without any."""
    with np.errstate(invalid="ignore"):
        mean: Array = np.where(visible, values, 0.0).sum(axis=1) / visible.sum(axis=1)
    return mean


def _field_end_deg(camera: CameraModel) -> float:
    """Return the largest field angle in degrees at any azimuth."""
    angles = np.radians(np.arange(SCAN_STEP_DEG, 180.0, SCAN_STEP_DEG))
    rings = np.flatnonzero(_sees(camera, angles).any(axis=1))
    if not len(rings):
        raise OutsideField(
            "the camera must image a part of its field; use a mirror whose centre is in the image"
        )
    low, high = angles[rings[-1]], angles[rings[-1]] + np.radians(SCAN_STEP_DEG)
    for _ in range(BISECTIONS):
        midpoint = (low + high) / 2
        low, high = (
            (midpoint, high) if _sees(camera, np.array([midpoint])).any() else (low, midpoint)
        )
    return float(np.degrees(low))


def _rings(camera: CameraModel, omega: Array) -> tuple[Array, Array, Array]:
    """Return directions (n, k, 3) at field angles (n,), with radial and azimuthal vectors."""
    phi = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS)
    sin, cos = np.sin(omega)[:, None], np.cos(omega)[:, None]
    ahead, ones = (-1.0 if camera.is_backward_facing else 1.0), np.ones((len(omega), AZIMUTHS))
    directions = np.stack([sin * np.cos(phi), sin * np.sin(phi), ahead * cos * ones], axis=-1)
    outwards = np.stack([cos * np.cos(phi), cos * np.sin(phi), -ahead * sin * ones], axis=-1)
    around = np.stack([-np.sin(phi) * ones, np.cos(phi) * ones, 0 * ones], axis=-1)
    return directions, outwards, around


def _sees(camera: CameraModel, omega: Array) -> NDArray[np.bool_]:
    """Return whether directions at field angles (n,) are visible, for each azimuth (n, k)."""
    world = _rings(camera, omega)[0].reshape(-1, 3) @ camera.mount.rotation().T
    return np.asarray(camera.project_directions(world).valid.reshape(len(omega), AZIMUTHS))


def every_step(end_deg: float) -> Array:
    """Return field angles (n,) every 5 deg from the axis, and the end of the field.

    >>> every_step(12.0)
    array([ 0.,  5., 10., 12.])
    """
    steps = np.arange(0.0, end_deg - 1e-9, STEP_DEG)
    return np.append(steps, end_deg)


def mean_sigma_deg(camera: CameraModel, omega: Array) -> Array:
    """Return the RMS uncertainty (n,) of directions in deg, at field angles in radians."""
    directions = _rings(camera, omega)[0].reshape(-1, 3)
    assert camera.uncertainty is not None
    covariance = camera.uncertainty.of([p.name for p in camera.parameters])
    sigmas = direction_sigma_deg(camera, covariance, directions, camera.uncertainty.field_deg)
    squares = sigmas.reshape(len(omega), AZIMUTHS) ** 2
    pixels = camera.image(directions, distant=True).pixels.reshape(len(omega), AZIMUTHS, 2)
    visible = np.isfinite(squares) & inside_image(pixels, camera.image_size)
    return np.sqrt(_mean(squares, visible))
