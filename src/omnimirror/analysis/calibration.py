"""What a calibrated camera does: radius, resolution, viewpoint and the error of directions over the field angle."""

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
from ..cameras.camera import inside_image
from ..cameras.frames import turned
from ..cameras.models import RadialModel
from ..cameras.models.base import CameraModel
from ..cameras.models.spread import direction_sigma_deg

Array = NDArray[np.float64]

STEP_DEG = 5.0
AZIMUTHS = 36  # over which is averaged what differs between them
NEXT_TO_AXIS = 1e-3  # radians, at which a ring about the axis still has azimuths
SCANNED_DEG = 0.5
HALVED = 24  # times, until the end of the field is known
MAPPING_COLUMNS = (
    *("omega_deg", "h_px", "dh_domega_px_per_deg", "width_px_per_deg", "area_px2", "aspect"),
    *("viewpoint_z_mm", "direction_sigma_deg"),
)


@dataclass(frozen=True)
class CameraMapping:
    """How a calibrated camera maps field angles, as :func:`evaluate_camera` finds it.

    Attributes
    ----------
    omega_deg : (n,)
        Field angles from the axis of the picture's centre.
    h_px : (n,)
        Image radii, before tangential distortion and stretch; of a misaligned sensor the mean distance from the pixel
        that looks along the lens's axis.
    dh_domega_px_per_deg, width_px_per_deg : (n,)
        Resolution along and across the radius.
    area_px2 : (n,)
        Image of a square degree.
    aspect : (n,)
        Width to height of the image of a small square.
    viewpoint_z_mm : (n,)
        Where rays meet the axis, along the camera's Z from the origin of its frame; where there is no axis, the point
        that is nearest to the rays of all azimuths.
    direction_sigma_deg : (n,)
        Standard error of a direction; NaN where no uncertainty is known, and outside of the calibrated field.
    camera
        That was evaluated.
    field_deg
        Largest field angle that is seen, at some azimuth.
    rim_radius_px
        Image radius there.
    varies_percent
        By how much resolution differs at some azimuth from the mean over all, at most over the rows and the end of the
        field; 0 where the columns hold for each.
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
    varies_percent: float = 0.0

    def __len__(self) -> int:
        return len(self.omega_deg)

    def columns(self) -> dict[str, Array]:
        """The columns (n,) of the table; that of errors where an uncertainty is known."""
        known = self.camera.uncertainty is not None
        return {name: getattr(self, name) for name in MAPPING_COLUMNS if known or name != "direction_sigma_deg"}

    def texts(self) -> dict[str, list[str]]:
        """The columns as people read them, one list of cells each."""
        return {name: [QUANTITIES[name].text(v) for v in values] for name, values in self.columns().items()}

    def summary(self) -> dict[str, Any]:
        """What holds for the whole camera: its model, numbers and field."""
        camera = self.camera
        sigmas = camera.uncertainty.sigmas if camera.uncertainty else {}
        return {
            "kind": camera.KIND,
            "optics": camera.optics,
            "field_deg": self.field_deg,
            "rim_radius_px": self.rim_radius_px,
            "calibrated_field_deg": camera.uncertainty.field_deg if camera.uncertainty else None,
            "is_central": isinstance(camera, RadialModel) and camera.is_central,
            "varies_percent": self.varies_percent,
            "parameters": [
                {"name": p.name, "value": p.value, "sigma": sigmas.get(p.name), "unit": p.unit}
                for p in camera.parameters
            ],
        }

    def to_csv(self, path: str | Path) -> None:
        """Write the table with 17 significant digits, which hold every double exactly."""
        columns = self.columns()
        rows = (",".join(f"{v:.17g}" for v in row) for row in zip(*columns.values(), strict=True))
        write_text(path, "\n".join([",".join(columns), *rows]) + "\n")

    def to_json(self, path: str | Path) -> None:
        """Write summary and columns; what is not known becomes null."""
        columns = {k: [v if np.isfinite(v) else None for v in c.tolist()] for k, c in self.columns().items()}
        write_text(path, json.dumps({"summary": self.summary(), "columns": columns}, indent=1) + "\n")


def evaluate_camera(camera: CameraModel, omega_deg: ArrayLike | None = None) -> CameraMapping:
    """Evaluate a calibrated camera at field angles.

    Parameters
    ----------
    camera
        Such as :func:`omnimirror.load_camera` gives; for an aligned sensor there is :func:`omnimirror.evaluate`. One
        whose mirror is decentred or tilted has no meridian that tells all: its :class:`omnimirror.SensorModel` is
        traced in space, and what is told is the mean over the azimuths that it sees.
    omega_deg : (n,), optional
        Field angles from the axis; every 5 deg of the field when nothing is given.

    Returns
    -------
    CameraMapping
        A column (n,) per quantity.

    Raises
    ------
    OutsideField
        An angle that the camera does not see.
    InvalidParameter
        Anything else that cannot be computed.

    Examples
    --------
    Of a paraboloid, a degree at the horizon is as high as it is wide:

    >>> import omnimirror as om
    >>> found = evaluate_camera(om.Unified(1.0, (200.0, 200.0), (319.5, 239.5), (640, 480)), [45.0, 90.0])
    >>> found.h_px, found.aspect
    (array([ 82.84271247, 200.        ]), array([1., 1.]))
    """
    instance("camera", camera, CameraModel, "a calibrated camera, such as om.load_camera gives")
    end = float(np.degrees(camera.omega_max)) if isinstance(camera, RadialModel) else _field_end_deg(camera)
    asked = every_step(end) if omega_deg is None else row("omega_deg", omega_deg)
    if (outside := ~((asked >= 0) & (asked <= end * (1 + 1e-12)))).any():
        raise OutsideField(f"omega_deg = {asked[outside][0]:g} is not seen; the camera sees 0 to {end:.6g} deg")
    if not isinstance(camera, RadialModel):
        return _in_space(camera, asked, end)
    omega = np.minimum(np.radians(asked), camera.omega_max)
    radius, rate, height = camera.mapping(omega)
    along = np.radians(rate)
    with np.errstate(divide="ignore", invalid="ignore"):
        across = np.where(np.sin(omega) > 1e-12, radius * np.radians(1.0) / np.sin(omega), along)
    sigma = np.full(len(omega), np.nan) if camera.uncertainty is None else mean_sigma_deg(camera, omega)
    columns = (radius, along, across, along * across, across / along, height, sigma)
    return CameraMapping(asked, *columns, camera, end, camera.field_radius_px)


def _in_space(camera: CameraModel, asked: Array, end: float) -> CameraMapping:
    """The table of a camera without an axis: rings of directions, and what their pixels see."""
    omega = np.maximum(np.radians(np.append(asked, end)), NEXT_TO_AXIS)
    seen, (directions, outwards, around) = _sees(camera, omega), _rings(camera, omega)
    image = camera.image(directions.reshape(-1, 3), distant=True)
    pixels = np.where(image.valid[:, None], image.pixels, np.nan).reshape(*seen.shape, 2)
    rates = np.radians(image.d_points).reshape(*seen.shape, 2, 3)
    along, across = ((rates @ across[..., None])[..., 0] for across in (outwards, around))
    area = np.abs(along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0])
    sizes = [np.linalg.norm(part, axis=-1) for part in (along, across)]
    high, wide = (_mean(size, seen) for size in sizes)
    radius = _mean(np.linalg.norm(pixels - _middle(camera, end), axis=-1), seen)
    off = [np.abs(size / mean[:, None] - 1)[seen] for size, mean in zip(sizes, (high, wide), strict=True)]
    sigma = np.full(len(omega), np.nan) if camera.uncertainty is None else mean_sigma_deg(camera, omega)
    heights = _viewpoints(camera, pixels, seen)
    told = (radius, high, wide, _mean(area, seen), _mean(sizes[1] / sizes[0], seen), heights, sigma)
    h, dh, dw, ds, aspect, height, error = (column[:-1] for column in told)
    varies = 100 * float(np.max(np.concatenate(off)))
    return CameraMapping(asked, h, dh, dw, ds, aspect, height, error, camera, end, float(radius[-1]), varies)


def _middle(camera: CameraModel, end: float) -> Array:
    """The pixel (2,) in the middle of the smallest ring that is seen whole; beyond the picture's edge too."""
    rings = np.append(NEXT_TO_AXIS, np.radians(np.arange(SCANNED_DEG, end, SCANNED_DEG)))
    image = camera.image(_rings(camera, rings)[0].reshape(-1, 3), distant=True)
    whole = np.flatnonzero(image.valid.reshape(-1, AZIMUTHS).all(axis=1))
    if not len(whole):
        raise OutsideField("of no field angle the camera sees all azimuths, so that its picture has no middle")
    return np.asarray(image.pixels.reshape(-1, AZIMUTHS, 2)[whole[0]].mean(axis=0))


def _viewpoints(camera: CameraModel, pixels: Array, seen: NDArray[np.bool_]) -> Array:
    """Heights (n,) of the points nearest to the rays of each ring; NaN where too little of it is seen."""
    heights = np.full(len(seen), np.nan)
    world = camera.mount.rotation()
    for i in np.flatnonzero(seen.sum(axis=1) > 1):
        rays = camera.backproject(pixels[i, seen[i]])
        origins, ways = turned(rays.origins[rays.valid], world), turned(rays.directions[rays.valid], world)
        if len(ways) > 1:
            across = np.eye(3) - ways[:, :, None] * ways[:, None, :]
            heights[i] = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, origins), rcond=None)[0][2]
    return heights


def _mean(values: Array, seen: NDArray[np.bool_]) -> Array:
    """Means (n,) over those azimuths (n, k) that are seen; NaN where none is."""
    with np.errstate(invalid="ignore"):
        mean: Array = np.where(seen, values, 0.0).sum(axis=1) / seen.sum(axis=1)
    return mean


def _field_end_deg(camera: CameraModel) -> float:
    """Largest field angle in degrees that a camera sees at some azimuth."""
    tried = np.radians(np.arange(SCANNED_DEG, 180.0, SCANNED_DEG))
    rings = np.flatnonzero(_sees(camera, tried).any(axis=1))
    if not len(rings):
        raise OutsideField("the camera sees nothing of its field; a mirror whose middle it sees has one")
    low, high = tried[rings[-1]], tried[rings[-1]] + np.radians(SCANNED_DEG)
    for _ in range(HALVED):
        middle = (low + high) / 2
        low, high = (middle, high) if _sees(camera, np.array([middle])).any() else (low, middle)
    return float(np.degrees(low))


def _rings(camera: CameraModel, omega: Array) -> tuple[Array, Array, Array]:
    """Directions (n, k, 3) of the camera frame at field angles (n,), and unit vectors outwards and around."""
    phi = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS)
    sin, cos = np.sin(omega)[:, None], np.cos(omega)[:, None]
    ahead, ones = (-1.0 if camera.looks_back else 1.0), np.ones((len(omega), AZIMUTHS))
    directions = np.stack([sin * np.cos(phi), sin * np.sin(phi), ahead * cos * ones], axis=-1)
    outwards = np.stack([cos * np.cos(phi), cos * np.sin(phi), -ahead * sin * ones], axis=-1)
    around = np.stack([-np.sin(phi) * ones, np.cos(phi) * ones, 0 * ones], axis=-1)
    return directions, outwards, around


def _sees(camera: CameraModel, omega: Array) -> NDArray[np.bool_]:
    """Whether the camera sees directions at field angles (n,), at each azimuth (n, k)."""
    world = _rings(camera, omega)[0].reshape(-1, 3) @ camera.mount.rotation().T
    return np.asarray(camera.project_directions(world).valid.reshape(len(omega), AZIMUTHS))


def every_step(end_deg: float) -> Array:
    """Field angles (n,) every 5 deg from the axis, and the end of the field.

    >>> every_step(12.0)
    array([ 0.,  5., 10., 12.])
    """
    steps = np.arange(0.0, end_deg - 1e-9, STEP_DEG)
    return np.append(steps, end_deg)


def mean_sigma_deg(camera: CameraModel, omega: Array) -> Array:
    """Error of directions (n,) deg at field angles in radians, in quadrature over the azimuths in the picture."""
    directions = _rings(camera, omega)[0].reshape(-1, 3)
    assert camera.uncertainty is not None
    covariance = camera.uncertainty.of([p.name for p in camera.parameters])
    sigmas = direction_sigma_deg(camera, covariance, directions, camera.uncertainty.field_deg)
    squares = sigmas.reshape(len(omega), AZIMUTHS) ** 2
    pixels = camera.image(directions, distant=True).pixels.reshape(len(omega), AZIMUTHS, 2)
    seen = np.isfinite(squares) & inside_image(pixels, camera.image_size)
    return np.sqrt(_mean(squares, seen))
