"""What a calibration hands over: the camera, how well it is known, and what became of every picture and corner."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.files import json_plain, write_text
from ...base.numerics.lazy import cached_property
from ...base.parameters import Uncertainty
from ...cameras.models.base import CameraModel
from ...cameras.models.radial import RadialModel
from ...cameras.models.spread import direction_sigma_deg
from ...optics.sensor import Sensor
from ...optics.sensor_files import save_camera
from ..physical import SensorModel
from ..physical.starting import without_fold
from ..propagation import measured_field_deg
from .advice import Coverage
from .bundle.adjustment import Adjustment
from .bundle.board_shape import BoardShape
from .choice import TriedModel
from .covariance import FreeCombination, ParameterCovariance
from .leaving_out import HeldOut
from .outliers import Outlier, remaining_outliers

Array = NDArray[np.float64]


class PictureResult(NamedTuple):
    """What became of a picture."""

    name: str
    found: int
    """corners"""
    used: bool
    reason: str | None
    """why it was not used"""
    rms_px: float | None
    """of its corners but the outliers"""
    rotation: Array | None = None
    """(3, 3) from the frame of what it shows (board, survey) to the camera frame; None where it is not used"""
    shift_mm: Array | None = None
    """(3,) the same: ``X = rotation @ p + shift_mm``"""

    @property
    def camera_at_mm(self) -> Array | None:
        """Where (3,) the camera frame has its origin in the frame of what the picture shows."""
        return None if self.rotation is None or self.shift_mm is None else -self.rotation.T @ self.shift_mm


class ParameterResult(NamedTuple):
    """A parameter of the camera or of the board."""

    name: str
    value: float
    sigma: float
    """0 where it was fixed"""
    unit: str


class EdgeResult(NamedTuple):
    """What became of a straight edge that was marked."""

    picture: str
    edge: int
    """in its picture, from 1"""
    points: int
    used: bool
    """whether the camera makes it straight"""
    rms_px: float
    """how far its points are off the image of a straight line"""


@dataclass(frozen=True)
class Calibration:
    """A camera measured from its pictures.

    Attributes
    ----------
    model
        The camera.
    board
        That the pictures show, None where there is none.
    shape
        How the board differs from a flat one with square fields; None where it was taken as such.
    rms_px
        ``sqrt(mean |e|^2)`` over all corners but the outliers.
    corners
        Found in the pictures that are used, outliers among them.
    outliers
        Corners that were left out, the worst first.
    pictures
        What became of each, in the order in which they came.
    parameters
        With their standard deviations.
    uncertainty
        Covariance, correlations and what is not determined.
    candidates
        Models that were compared, the chosen one among them.
    notes
        What whoever uses this should know, in sentences.
    advice
        Which pictures to take next, in sentences.
    coverage
        How corners are spread over the picture.
    adjustment
        Residuals and all that they follow from.
    held_out
        Residuals of pictures in fits that did not see them; None where nothing was left out.
    seconds
        It took.
    is_complete
        False where it was stopped before the end.
    edges
        Straight edges that were marked, and what became of each.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.cameras.models import Unified
    >>> camera = Unified(0.95, (160.0, 160.0), (319.5, 239.5), (640, 480))
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
    pictures: tuple[PictureResult, ...]
    parameters: tuple[ParameterResult, ...]
    uncertainty: ParameterCovariance
    candidates: tuple[TriedModel, ...]
    notes: tuple[str, ...]
    advice: tuple[str, ...]
    coverage: Coverage = field(repr=False)
    adjustment: Adjustment = field(repr=False)
    held_out: HeldOut | None = field(default=None, repr=False)
    seconds: float = 0.0
    is_complete: bool = True
    edges: tuple[EdgeResult, ...] = ()

    @property
    def held_out_rms_px(self) -> float:
        """``sqrt(mean |e|^2)`` over pictures that were left out of the fit, with only their boards placed."""
        return float("nan") if self.held_out is None else self.held_out.rms_px

    @property
    def covariance(self) -> Array:
        """Of the camera's own parameters (p, p), 0 where they were fixed."""
        count = len(self.model.parameters)
        return self.uncertainty.covariance[:count, :count]

    @property
    def free(self) -> tuple[FreeCombination, ...]:
        """Combinations of parameters that the pictures do not determine."""
        return self.uncertainty.free

    def direction_sigma_deg(self, directions: ArrayLike) -> Array:
        """Return the standard deviation of the directions that pixels see.

        Parameters
        ----------
        directions : (n, 3)
            In the camera frame (X right, Y down, Z ahead).

        Returns
        -------
        (n,) array
            Deg, along the larger axis; NaN where the camera sees nothing, and outside of :attr:`field_deg`.
        """
        return direction_sigma_deg(self.model, self.covariance, directions, self.field_deg)

    @property
    def remaining_outliers(self) -> tuple[Outlier, ...]:
        """Corners that were used and are farther off than noise explains, the worst first."""
        return remaining_outliers(self.adjustment)

    @cached_property
    def field_deg(self) -> float | None:
        """Calibrated field: the largest field angle (deg) of anything that the fit used; None where nothing is seen.

        Beyond it the camera is an extrapolation: its errors there are not known.
        """
        edges = self.adjustment.edges
        measured = [s.pixels for s in self.adjustment.sightings] + [e.pixels for e in (edges.edges if edges else ())]
        return measured_field_deg(self.model, np.concatenate(measured))

    @property
    def camera(self) -> Sensor | CameraModel:
        """The camera as it is used and saved: the sensor itself, or the model with its uncertainty."""
        names = tuple(p.name for p in self.model.parameters)
        sigmas = self.uncertainty.sigmas[: len(names)]
        is_linear = np.allclose(sigmas**2, np.diag(self.covariance), rtol=1e-9, atol=0)
        known = Uncertainty(
            names, tuple(tuple(float(c) for c in row) for row in self.covariance), self.field_deg,
            None if is_linear else tuple(sigmas.tolist()),
        )  # fmt: skip
        if isinstance(self.model, SensorModel):
            return replace(without_fold(self.model.sensor), uncertainty=known)
        if isinstance(self.model, RadialModel):
            return replace(self.model, uncertainty=known)  # type: ignore[type-var]  # every model is a dataclass
        return self.model

    def save(self, path: str | Path) -> None:
        """Write the camera's file: a sensor file, or a camera file with its uncertainty.

        Parameters
        ----------
        path
            Of the file, TOML.

        Raises
        ------
        OmnimirrorError
            The file cannot be written.
        """
        save_camera(self.camera, path, self.summary)  # type: ignore[arg-type]

    @property
    def seen(self) -> str:
        """What was seen, as a word: corners, points, or both."""
        kinds = {"points" if s.is_surveyed else "corners" for s in self.adjustment.sightings}
        return " and ".join(sorted(kinds))

    @property
    def summary(self) -> str:
        """A line about it."""
        used = sum(p.used for p in self.pictures)
        held = f", {self.held_out_rms_px:.3f} px in pictures left out" if self.held_out else ""
        return (
            f"Calibrated from {used} {'picture' if used == 1 else 'pictures'} and {self.corners - len(self.outliers)} "
            f"{self.seen}: {self.rms_px:.3f} px RMS"
            f"{held}."
        )

    def to_dict(self) -> dict[str, Any]:
        """All numbers, as the file of ``--json`` has them.

        Returns
        -------
        dict
            Of texts, numbers and lists.
        """
        return {
            "rms_px": self.rms_px,
            "held_out_rms_px": self.held_out_rms_px,
            "corners": self.corners,
            "outliers": [o._asdict() for o in self.outliers],
            "remaining_outliers": [o._asdict() for o in self.remaining_outliers],
            "pictures": [p._asdict() | {"camera_at_mm": p.camera_at_mm} for p in self.pictures],
            "parameters": [p._asdict() for p in self.parameters],
            "seconds": self.seconds,
            "model": self.model.KIND,
            "field_deg": self.field_deg,
            "noise_px": self.adjustment.noise_px,
            "covariance": self.uncertainty.covariance,
            "free": [
                {"parameters": c.names, "parts": c.parts, "units": c.units, "sigma_px": c.sigma_px} for c in self.free
            ],
            "candidates": [c._asdict() for c in self.candidates],
            "notes": self.notes,
            "advice": self.advice,
            "is_complete": self.is_complete,
            "edges": [e._asdict() for e in self.edges],
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """All numbers as JSON; what is not a number, such as the held-out error of one picture, is null.

        Parameters
        ----------
        path
            A file to write, too.

        Returns
        -------
        str
            The text.
        """
        text = json.dumps(json_plain(self.to_dict()), indent=1) + "\n"
        if path is not None:
            write_text(path, text)
        return text
