"""Calibration results: camera, uncertainty, and residuals by image and corner."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...base.caching import cached_property
from ...base.files import json_plain, write_text
from ...base.parameters import Uncertainty
from ...base.results import Columns, Result, table_of
from ...base.typing import Array
from ...cameras.models.camera_model import (
    CameraModel,
    RadialModel,
    direction_sigma_deg,
    measured_field_deg,
)
from ...optics.camera_files import save_camera
from ...optics.sensor import Sensor
from ..sensor_model import SensorModel, without_fold
from ._accuracy import HeldOut, ModelCandidate, ParameterCovariance, UndeterminedCombination
from ._bundle_adjustment import BundleAdjustment
from .observation_checks import Coverage, Outlier, remaining_outliers
from .observations import BoardShape


class ImageResult(NamedTuple):
    """Result for an image."""

    name: str
    found: int
    """Number of detected corners."""
    used: bool
    reason: str | None
    """Reason for which the image is not used."""
    rms_px: float | None
    """Reprojection error of its inliers."""
    rotation: Array | None = None
    """Rotation (3, 3) from the target frame (board, survey) to the camera frame; None if not used.
    """
    translation_mm: Array | None = None
    """Translation (3,) of this transform: ``X = rotation @ p + translation_mm``."""

    @property
    def camera_at_mm(self) -> Array | None:
        """Origin (3,) of the camera frame in the target frame."""
        return (
            None
            if self.rotation is None or self.translation_mm is None
            else -self.rotation.T @ self.translation_mm
        )


class ParameterResult(NamedTuple):
    """Parameter of the camera or of the board."""

    name: str
    value: float
    sigma: float
    """Standard deviation; 0 for fixed parameters."""
    unit: str


class EdgeResult(NamedTuple):
    """Result for a marked straight edge."""

    image: str
    edge: int
    """Number in its image, from 1."""
    points: int
    used: bool
    """True if the edge is straight after undistortion."""
    rms_px: float
    """Deviation of its points from the image of a straight line."""


@dataclass(frozen=True)
class Calibration(Result):
    """Result of a camera calibration.

    Attributes
    ----------
    model
        Calibrated camera model.
    board
        Calibration target; None if there is none.
    shape
        Deviation of the board from a flat one with square fields; None if not estimated.
    rms_px
        Reprojection error ``sqrt(mean |e|^2)`` over all inliers.
    corners
        Number of corners in the used images, including outliers.
    outliers
        Rejected corners, worst first.
    images
        Result for each image, in input order.
    parameters
        Parameters with their standard deviations.
    uncertainty
        Covariance, correlations and weakly determined combinations.
    candidates
        Compared models, including the selected one.
    notes
        Notes for users of the camera, in sentences.
    advice
        Recommendations for further images, in sentences.
    coverage
        Distribution of corners over the image.
    adjustment
        Final fit with residuals and derivatives.
    held_out
        Cross-validation residuals; None without cross-validation.
    seconds
        Elapsed time.
    is_complete
        False if the calibration was cancelled.
    edges
        Result for each marked straight edge.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.cameras.models import Unified
    >>> camera = Unified(
    ...     xi=0.95, focal_px=(160.0, 160.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> board = om.Board("chessboard", 11, 7, 30.0)
    >>> found = om.calibrate_camera(om.simulate_detections(camera, board, 4), board, model="unified")
    >>> found.parameters[0]._fields, found.parameters[0].name
    (('name', 'value', 'sigma', 'unit'), 'xi')
    """

    model: CameraModel
    board: Any
    shape: BoardShape | None
    rms_px: float
    corners: int
    outliers: tuple[Outlier, ...]
    images: tuple[ImageResult, ...]
    parameters: tuple[ParameterResult, ...]
    uncertainty: ParameterCovariance
    candidates: tuple[ModelCandidate, ...]
    notes: tuple[str, ...]
    advice: tuple[str, ...]
    coverage: Coverage = field(repr=False)
    adjustment: BundleAdjustment = field(repr=False)
    held_out: HeldOut | None = field(default=None, repr=False)
    seconds: float = 0.0
    is_complete: bool = True
    edges: tuple[EdgeResult, ...] = ()

    def _table(self) -> Columns:
        return table_of(parameter._asdict() for parameter in self.parameters)

    @property
    def held_out_rms_px(self) -> float:
        """Reprojection error ``sqrt(mean |e|^2)`` of held-out images; only poses are fitted."""
        return float("nan") if self.held_out is None else self.held_out.rms_px

    @property
    def covariance(self) -> Array:
        """Covariance of the camera parameters (p, p); 0 for fixed parameters."""
        count = len(self.model.parameters)
        return self.uncertainty.covariance[:count, :count]

    @property
    def free(self) -> tuple[UndeterminedCombination, ...]:
        """Combinations of parameters that the images do not determine."""
        return self.uncertainty.free

    def direction_sigma_deg(self, directions: ArrayLike) -> Array:
        """Return the standard deviation of the directions of pixels.

        Parameters
        ----------
        directions : (n, 3)
            Directions in the camera frame (X right, Y down, Z ahead).

        Returns
        -------
        (n,) array
            Standard deviation in deg along the larger axis; NaN outside the image and outside
            :attr:`field_deg`.
        """
        return direction_sigma_deg(self.model, self.covariance, directions, self.field_deg)

    @property
    def remaining_outliers(self) -> tuple[Outlier, ...]:
        """Used corners with residuals beyond the noise, worst first."""
        return remaining_outliers(self.adjustment)

    @cached_property
    def field_deg(self) -> float | None:
        """Calibrated field: largest field angle (deg) of the used measurements; None without any.

        Beyond it the camera is an extrapolation with unknown errors.
        """
        edges = self.adjustment.edges
        measured = [s.pixels for s in self.adjustment.observations] + [
            e.pixels for e in (edges.edges if edges else ())
        ]
        return measured_field_deg(self.model, np.concatenate(measured))

    @property
    def camera(self) -> Sensor | CameraModel:
        """Camera for use and storage: the sensor itself, or the model with its uncertainty."""
        names = tuple(p.name for p in self.model.parameters)
        sigmas = self.uncertainty.sigmas[: len(names)]
        is_linear = np.allclose(sigmas**2, np.diag(self.covariance), rtol=1e-9, atol=0)
        uncertainty = Uncertainty(
            names,
            tuple(tuple(float(c) for c in row) for row in self.covariance),
            self.field_deg,
            None if is_linear else tuple(sigmas.tolist()),
        )
        if isinstance(self.model, SensorModel):
            return replace(without_fold(self.model.sensor), uncertainty=uncertainty)
        if isinstance(self.model, RadialModel):
            return replace(self.model, uncertainty=uncertainty)
        return self.model

    def save(self, path: str | Path) -> None:
        """Write the camera to a sensor file, or to a camera file with its uncertainty.

        Parameters
        ----------
        path
            TOML file.

        Raises
        ------
        OmnimirrorError
            If the file cannot be written.
        """
        save_camera(self.camera, path, self.summary)  # type: ignore[arg-type]  # a calibrated camera has a file format

    @property
    def measurement_kinds(self) -> str:
        """Kind of measurements: "corners", "points", or both."""
        kinds = {"points" if s.is_surveyed else "corners" for s in self.adjustment.observations}
        return " and ".join(sorted(kinds))

    @property
    def summary(self) -> str:
        """Summary in one line."""
        used = sum(p.used for p in self.images)
        held_out = f", {self.held_out_rms_px:.3f} px in held-out images" if self.held_out else ""
        return (
            f"Calibrated from {used} {'image' if used == 1 else 'images'} and {self.corners - len(self.outliers)} "
            f"{self.measurement_kinds}: {self.rms_px:.3f} px RMS"
            f"{held_out}."
        )

    def to_dict(self) -> dict[str, Any]:
        """Convert to the dictionary written by ``--json``.

        Returns
        -------
        dict
            Texts, numbers and lists.
        """
        return {
            "rms_px": self.rms_px,
            "held_out_rms_px": self.held_out_rms_px,
            "corners": self.corners,
            "outliers": [o._asdict() for o in self.outliers],
            "remaining_outliers": [o._asdict() for o in self.remaining_outliers],
            "images": [p._asdict() | {"camera_at_mm": p.camera_at_mm} for p in self.images],
            "parameters": [p._asdict() for p in self.parameters],
            "seconds": self.seconds,
            "model": self.model.KIND,
            "field_deg": self.field_deg,
            "noise_px": self.adjustment.noise_px,
            "covariance": self.uncertainty.covariance,
            "free": [
                {"parameters": c.names, "parts": c.parts, "units": c.units, "sigma_px": c.sigma_px}
                for c in self.free
            ],
            "candidates": [c._asdict() for c in self.candidates],
            "notes": self.notes,
            "advice": self.advice,
            "is_complete": self.is_complete,
            "edges": [e._asdict() for e in self.edges],
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """Convert to JSON; NaN, such as the held-out error of a single image, becomes null.

        Parameters
        ----------
        path
            Output file, optional.

        Returns
        -------
        str
            JSON text.
        """
        text = json.dumps(json_plain(self.to_dict()), indent=1) + "\n"
        if path is not None:
            write_text(path, text)
        return text
