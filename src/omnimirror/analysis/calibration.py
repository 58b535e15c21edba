"""What a calibrated camera does: radius, resolution, viewpoint and the error of directions over the field angle."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import instance, row
from ..camera_models import RadialModel
from ..camera_models.spread import direction_spread, larger_sigma
from ..cameras import inside_image
from ..errors import OutsideField
from ..files import write_text
from ..quantities import QUANTITIES

Array = NDArray[np.float64]

STEP_DEG = 5.0
AZIMUTHS = 36  # over which the error of a direction is averaged
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
        Image radii, before tangential distortion and stretch.
    dh_domega_px_per_deg, width_px_per_deg : (n,)
        Resolution along and across the radius.
    area_px2 : (n,)
        Image of a square degree.
    aspect : (n,)
        Width to height of the image of a small square.
    viewpoint_z_mm : (n,)
        Where rays meet the axis, along the camera's Z from the origin of its frame.
    direction_sigma_deg : (n,)
        Standard error of a direction; NaN where no uncertainty is known.
    camera
        That was evaluated.
    """

    omega_deg: Array
    h_px: Array
    dh_domega_px_per_deg: Array
    width_px_per_deg: Array
    area_px2: Array
    aspect: Array
    viewpoint_z_mm: Array
    direction_sigma_deg: Array
    camera: RadialModel

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
            "field_deg": float(np.degrees(camera.omega_max)),
            "rim_radius_px": camera.field_radius_px,
            "is_central": camera.is_central,
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


def evaluate_camera(camera: RadialModel, omega_deg: ArrayLike | None = None) -> CameraMapping:
    """Evaluate a calibrated camera at field angles.

    Parameters
    ----------
    camera
        Such as :func:`omnimirror.load_camera` gives; for a sensor there is :func:`omnimirror.evaluate`.
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
    instance("camera", camera, RadialModel, "a calibrated camera, such as om.load_camera gives")
    end = float(np.degrees(camera.omega_max))
    asked = every_step(end) if omega_deg is None else row("omega_deg", omega_deg)
    if (outside := ~((asked >= 0) & (asked <= end * (1 + 1e-12)))).any():
        raise OutsideField(f"omega_deg = {asked[outside][0]:g} is not seen; the camera sees 0 to {end:.6g} deg")
    omega = np.minimum(np.radians(asked), camera.omega_max)
    radius, rate, height = camera.mapping(omega)
    along = np.radians(rate)
    with np.errstate(divide="ignore", invalid="ignore"):
        across = np.where(np.sin(omega) > 1e-12, radius * np.radians(1.0) / np.sin(omega), along)
    sigma = np.full(len(omega), np.nan) if camera.uncertainty is None else mean_sigma_deg(camera, omega)
    return CameraMapping(asked, radius, along, across, along * across, across / along, height, sigma, camera)


def every_step(end_deg: float) -> Array:
    """Field angles (n,) every 5 deg from the axis, and the end of the field.

    >>> every_step(12.0)
    array([ 0.,  5., 10., 12.])
    """
    steps = np.arange(0.0, end_deg - 1e-9, STEP_DEG)
    return np.append(steps, end_deg)


def mean_sigma_deg(camera: RadialModel, omega: Array) -> Array:
    """Error of directions (n,) deg at field angles in radians, in quadrature over the azimuths in the picture."""
    phi = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS)
    sin, cos = np.sin(omega)[:, None], np.cos(omega)[:, None]
    ahead = -1.0 if camera.looks_back else 1.0
    across = (sin * np.cos(phi), sin * np.sin(phi), ahead * cos + 0 * phi)
    directions = np.stack(across, axis=-1).reshape(-1, 3)
    assert camera.uncertainty is not None
    covariance = camera.uncertainty.of([p.name for p in camera.parameters])
    squares = larger_sigma(direction_spread(camera, covariance, directions)).reshape(len(omega), AZIMUTHS) ** 2
    pixels = camera.image(directions, distant=True).pixels.reshape(len(omega), AZIMUTHS, 2)
    seen = np.isfinite(squares) & inside_image(pixels, camera.image_size)
    with np.errstate(invalid="ignore"):
        sigma: Array = np.degrees(np.sqrt(np.where(seen, squares, 0.0).sum(axis=1) / seen.sum(axis=1)))
    return sigma
