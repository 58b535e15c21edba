"""Conversion of camera models between the file formats of different programs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from ..base.arguments import (
    InvalidType,
    choice,
    distances,
    file_name,
    format_value,
    instance,
    integer,
    optional_number,
)
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.files import atomic_output
from ..base.results import Columns, Result, record_of, table_of
from ..cameras.camera import Camera, Mount
from ..cameras.models import CameraModel, RadialModel
from ..cameras.models.camera_model import FIELD_ROUNDING_DEG, Optics
from ..dewarp.views import sphere
from ..optics.sensor import Sensor
from ..optics.sensor_files import bundled_sensors, load_sensor
from ._model_fitting import (
    INITIAL_MODELS,
    Cost,
    FittedModel,
    Sample,
    fit_model,
    initial_models,
    nearest_point_to_rays,
    parallax,
    reprojection_errors,
    rotational_projection,
    sample,
)
from .formats._camera_format import CameraEntry, ReadOptions
from .formats._registry import OutputLayout, output_layouts, read_cameras
from .sensor_model import SensorModel

__all__ = ["DISTANCES_MM", "Conversion", "Cost", "convert", "flipped"]


# -- Flipped cameras -------------------------------------------------------------------------------

Model = TypeVar("Model", bound=CameraModel)

SIGN_CHANGING = {"cx", "skew", "shear", "d", "p2", "s1", "s2"}
"""Parameters that change sign under a horizontal flip, for the centre up to a constant."""
ODD_FIELDS = ("skew_px", "shear", "p2", "s1", "s2")  # fields that change sign


def flipped(camera: Model) -> Model:
    """Return the camera of the image flipped left to right: column u becomes width - 1 - u.

    Parameters
    ----------
    camera
        Camera with a centre, and a matrix of two focal lengths and skew or of OCamCalib's c, d and
        e.

    Returns
    -------
    CameraModel
        Camera of the same class, with the flip recorded in its mount.

    Raises
    ------
    InvalidParameter
        If the camera has no centre.

    Examples
    --------
    >>> from omnimirror.cameras.models import OCam
    >>> camera = OCam(
    ...     polynomial=(-100.0, 0.0, 0.002), centre_px=(300.0, 240.0), image_size=(640, 480)
    ... )
    >>> flipped(camera).centre_px
    (339.0, 240.0)
    """
    model: Any = camera
    if not hasattr(model, "centre_px"):
        raise InvalidParameter(f"camera must have an image centre to be flipped; got {camera.KIND}")
    (u, v), width = model.centre_px, camera.image_size[0]
    changes: dict[str, Any] = {
        "centre_px": (width - 1 - u, v),
        "mount": replace(camera.mount, image_flipped=not camera.mount.image_flipped),
    }
    changes |= {name: -getattr(model, name) for name in ODD_FIELDS if getattr(model, name, 0.0)}
    if hasattr(model, "affine"):
        c, d, e = model.affine
        changes["affine"] = (c, -d, -e)
    if getattr(model, "uncertainty", None) is not None:
        uncertainty = model.uncertainty
        signs = np.array([-1.0 if name in SIGN_CHANGING else 1.0 for name in uncertainty.names])
        matrix = np.array(uncertainty.covariance) * np.outer(signs, signs)
        changes["uncertainty"] = replace(uncertainty, covariance=tuple(map(tuple, matrix.tolist())))
    return replace(model, **changes)  # type: ignore[no-any-return]  # changes has any values


# -- Conversion between file formats ---------------------------------------------------------------

N_EVALUATION_PIXELS = 20_000  # pixels of the grid for the evaluation of errors
FIT_THINNING = 8  # thinning factor of the grid for the fit
SUFFICIENT_ERROR_PX = 0.02  # a simpler model within this error is preferred to a richer one
NEAREST_MM, MAX_DISTANCE_MM = 1.0, 1e9
DISTANCES_MM = (500.0, 1000.0, 3000.0, np.inf)
REACH_REMEDY = (
    "reduce field_deg (--set fit.field_deg) to convert only the central field, or specify the radius "
    "of the camera's field, rim_radius_px (--set camera.rim_radius_px)"
)
_Field: TypeAlias = tuple[float | None, float | None]  # maximum and minimum field angle, deg


@dataclass(frozen=True)
class Conversion(Result):
    """Written camera file and the error of the conversion.

    Attributes
    ----------
    path
        Written file.
    source
        Format of the source; "" for a camera object.
    target
        Written layout of a format.
    camera
        Camera as stored in the file.
    exact
        Whether the file contains the exact parameters of the source.
    costs
        Reprojection error relative to the source for object points at each distance; one entry for
        a central camera.
    viewpoint_mm
        Origin of the file's frame in the camera frame of the source.
    notes
        Assumptions and contradictions in the source, information not stored in the file, and the
        direction of its frame.
    """

    path: Path
    source: str
    target: str
    camera: Camera
    exact: bool
    costs: tuple[Cost, ...]
    viewpoint_mm: tuple[float, float, float]
    notes: tuple[str, ...]

    def _table(self) -> Columns:
        return table_of(record_of(cost) for cost in self.costs)

    @property
    def rms_px(self) -> float:
        """RMS error over the field and all distances."""
        return float(np.sqrt(np.mean([c.rms_px**2 for c in self.costs]))) if self.costs else 0.0

    @property
    def largest_px(self) -> float:
        """Maximum error over the field and all distances."""
        return max((c.largest_px for c in self.costs), default=0.0)


class _StoredCamera(NamedTuple):
    """Camera as a target format stores it."""

    target: OutputLayout
    found: FittedModel
    costs: tuple[Cost, ...]
    is_restricted: bool = False
    """True if the field of the camera exceeds that of the fit."""

    @property
    def largest_px(self) -> float:
        return max((c.largest_px for c in self.costs), default=0.0)


def convert(
    source: str | Path | Camera,
    target: str | Path,
    *,
    to: str | None = None,
    from_: str | None = None,
    camera: int | str = 0,
    optics: Optics = "mirror",
    mount: Mount | None = None,
    rim_radius_px: float | None = None,
    image_size: tuple[int, int] | None = None,
    flip: bool = False,
    tolerance_px: float | None = None,
    distance_mm: Iterable[float] = DISTANCES_MM,
    field_deg: float | None = None,
    inner_deg: float | None = None,
) -> Conversion:
    """Convert a camera to the file format of another program.

    If the format supports the camera's model, its parameters are written unchanged. Otherwise
    another model is fitted within the calibrated field. The conversion fails if the error exceeds
    ``tolerance_px``.

    Parameters
    ----------
    source
        Camera file of any format, or a camera or sensor.
    target
        Output file; its name selects the format unless ``to`` does (cameras.txt: COLMAP).
    to : optional
        Format from ``omnimirror.calibration.formats.FORMATS``, or one of its models, such as
        ``"kalibr-ds"``. For a format, the model that represents the camera exactly, otherwise the
        best fit.
    from_ : optional
        Format of the source, if its content is ambiguous.
    camera
        Camera of a rig: its number in the file from 0, or its name.
    optics, mount, rim_radius_px, image_size
        Information that files of other programs do not contain: type of optics, orientation of the
        camera, boundary of its field (px), and for some the image size (px).
    flip
        Write the camera of the image flipped left to right; the frame of a mirror is then
        right-handed.
    tolerance_px : px, optional
        Maximum reprojection error of a fitted model over the whole field.
    distance_mm
        Distances of object points from the origin of a camera without a single viewpoint, with
        equal weights.
    field_deg : deg, optional
        Maximum field angle of the fit from the viewing direction at the image centre. By default
        the calibrated field in the camera's file
        (:attr:`omnimirror.base.parameters.Uncertainty.field_deg`), otherwise the whole field.
    inner_deg : deg, optional
        Minimum field angle of the fit; the image centre contains the camera itself, without
        calibration data.

    Returns
    -------
    Conversion
        Written file and the error of the conversion.

    Raises
    ------
    SpecError
        If the source cannot be read; the message names the location and valid values.
    InvalidParameter
        If the format is unknown, or cannot represent the camera within the tolerance; the message
        states the reason and the error.
    OmnimirrorError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> camera = om.OCam(
    ...     polynomial=(-130.0, 0.0, 1.9e-3, 2e-7),
    ...     centre_px=(320.0, 240.0),
    ...     image_size=(640, 480),
    ...     rim_radius_px=200.0,
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     exact = om.convert(camera, f"{folder}/calib_results.txt")
    ...     fitted = om.convert(camera, f"{folder}/a.yaml", to="opencv-omnidir", tolerance_px=0.5)
    >>> exact.exact, fitted.exact, fitted.largest_px < 0.5
    (True, False, True)
    """
    # More than 60 lines: 14 parameters to check; the steps are functions.
    target = file_name("target", target)
    instance("flip", flip, bool, "true or false")
    reading = _read_options(source, optics, mount, rim_radius_px, image_size)
    tolerance = optional_number("tolerance_px", tolerance_px, above=0.0, unit="px")
    field = (
        optional_number("field_deg", field_deg, above=0.0, high=180.0, unit="deg"),
        optional_number("inner_deg", inner_deg, above=0.0, high=180.0, unit="deg"),
    )
    object_distances = _object_distances(distance_mm)
    targets = output_layouts(target, to)
    source = source.sensor if isinstance(source, SensorModel) else source
    format_name, stored = (
        ("", CameraEntry("", source))
        if isinstance(source, Camera)
        else _read_camera(source, reading, from_, camera)
    )
    result = _exact_target(stored.camera, targets)
    exact = result is not None
    if result is None:
        calibrated_deg = _calibrated_deg(stored.camera)
        max_deg = calibrated_deg if field[0] is None else field[0]
        try:
            result = _approximate(
                stored.camera, targets, tolerance, object_distances, (max_deg, field[1])
            )
        except InvalidParameter as e:  # contradictions in the file may be the cause
            raise InvalidParameter("; ".join([str(e), *stored.notes])) from e
    elif result.target.layout.is_panorama:
        result = _panorama(stored.camera, result.target, object_distances)
        exact = not result.costs
    output_camera = (
        flipped(result.found.model)
        if flip and not result.target.layout.is_panorama
        else result.found.model
    )
    content = result.target.layout.write(output_camera, stored.name)
    notes = (
        *stored.notes,
        *_notes(stored.camera, output_camera, result),
        *_field_notes(stored.camera, result, field[0]),
    )
    with atomic_output(target) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    x, y, z = (float(v) for v in result.found.viewpoint_mm)
    return Conversion(
        target,
        format_name,
        result.target.name,
        output_camera,
        exact,
        result.costs,
        (x, y, z),
        notes,
    )


# -- arguments --------------------------------------------------------------------------------


def _read_options(
    source: Any, optics: Optics, mount: Any, rim_radius_px: Any, image_size: Any
) -> ReadOptions:
    choice("optics", optics, ("mirror", "fisheye"))
    orientation = Mount() if mount is None else instance("mount", mount, Mount, "a mount")
    rim = optional_number("rim_radius_px", rim_radius_px, above=0.0, unit="px")
    return ReadOptions(str(source), optics, orientation, rim, _size(image_size))


def _object_distances(distance_mm: Any) -> tuple[float, ...]:
    far = np.unique(distances("distance_mm", _number_list("distance_mm", distance_mm)))
    if far.ndim != 1 or np.any(
        np.isfinite(far) & ~((far >= NEAREST_MM) & (far <= MAX_DISTANCE_MM))
    ):
        raise InvalidParameter(
            f"distance_mm must be {NEAREST_MM:g} to {MAX_DISTANCE_MM:g} mm, or inf; got {format_value(distance_mm)}"
        )
    return tuple(far.tolist())


def _size(image_size: Any) -> tuple[int, int] | None:
    if image_size is None:
        return None
    width, height = _number_list("image_size", image_size, 2)
    return integer("image_size", width, 1), integer("image_size", height, 1)


def _number_list(name: str, value: Any, count: int | None = None) -> list[Any]:
    values = [value] if isinstance(value, int | float) else value
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InvalidType(f"{name} must be a list of numbers; got {format_value(value)}")
    values = list(values)
    if count is not None and len(values) != count:
        raise InvalidParameter(f"{name} must be {count} numbers; got {format_value(value)}")
    return values


def _read_camera(
    source: Any, reading: ReadOptions, name: str | None, camera: int | str
) -> tuple[str, CameraEntry]:
    path = file_name("source", source)
    if name is None and not path.exists() and str(source) in bundled_sensors():
        return "omnimirror", CameraEntry(str(source), load_sensor(source))
    format_name, cameras = read_cameras(path, reading, name)
    names = [c.name for c in cameras]
    if isinstance(camera, str) and camera in names:
        return format_name, cameras[names.index(camera)]
    if isinstance(camera, str) and not (camera.isascii() and camera.isdecimal()):
        raise InvalidParameter(
            f"camera must be one of {', '.join(filter(None, names))} in {source}; got {format_value(camera)}"
        )
    index = integer("camera", float(camera) if isinstance(camera, str) else camera)
    if index >= len(cameras):
        raise InvalidParameter(
            f"camera must be an index from 0 to {len(cameras) - 1} in {source}; got {index}"
        )
    return format_name, cameras[index]


# -- targets ----------------------------------------------------------------------------------


def _exact_target(camera: Camera, targets: list[OutputLayout]) -> _StoredCamera | None:
    """Return the first target that stores the exact parameters of the camera."""
    for target in targets:
        if not target.layout.unsupported(camera):
            model: Any = camera
            return _StoredCamera(target, FittedModel(model, np.zeros(3)), ())
    return None


def _panorama(camera: Camera, target: OutputLayout, distances: tuple[float, ...]) -> _StoredCamera:
    """Return a panorama of distant points with the parallax error of near points."""
    visible = sample(camera, getattr(camera, "mount", Mount()), N_EVALUATION_PIXELS)
    model: Any = camera
    if visible.is_central:
        return _StoredCamera(target, FittedModel(model, np.zeros(3)), ())
    viewpoint = nearest_point_to_rays(visible.origins, visible.directions)
    scale = sphere(camera).size[0] / 360
    return _StoredCamera(
        target,
        FittedModel(model, viewpoint),
        tuple(parallax(visible, viewpoint, d, scale) for d in distances),
    )


def _approximate(
    camera: Camera,
    targets: list[OutputLayout],
    tolerance: float | None,
    distances: tuple[float, ...],
    field: _Field,
) -> _StoredCamera:
    """Return the target with the smallest error, if within the tolerance."""
    mount = getattr(camera, "mount", Mount())
    full_field = sample(camera, mount, N_EVALUATION_PIXELS)
    evaluated = full_field.within(*field)
    fit_sample = (
        sample(camera, mount, N_EVALUATION_PIXELS // FIT_THINNING)
        .within(*field)
        .with_rim_of(evaluated)
    )
    trials, reasons = [], []
    for target in targets:
        if target.layout.kind not in INITIAL_MODELS:
            reasons.append(f"{target.name} {target.layout.unsupported(camera)}")
            continue
        try:
            trials.append(_best_fit(target, fit_sample, evaluated, camera.image_size, distances))
        except OmnimirrorError as e:
            reasons.append(f"{target.name} ({target.layout.description}) {e}")
    usable = [trial for trial in trials if np.isfinite(trial.largest_px)]
    reasons += [
        f"{trial.target.name} ({trial.target.layout.description}) does not cover the field "
        f"of {np.degrees(evaluated.omega.max()):.4g} deg from the axis"
        for trial in trials
        if trial not in usable
    ]
    if not usable:
        remedy = (
            f"; {REACH_REMEDY}" if any(t.layout.kind in INITIAL_MODELS for t in targets) else ""
        )
        raise InvalidParameter(f"this camera cannot be converted: {'; '.join(reasons)}{remedy}")
    best = min(usable, key=lambda trial: trial.largest_px)
    whole_field = [
        trial
        for trial in usable
        if trial.target.layout.max_field_angle_deg > np.degrees(evaluated.omega.max())
    ]
    if whole_field and tolerance is not None:  # prefer a model for the whole field
        best_full_field = min(whole_field, key=lambda trial: trial.largest_px)
        best = best_full_field if best_full_field.largest_px <= tolerance else best
    if tolerance is None or best.largest_px > tolerance:
        verdict = (
            f"set tolerance_px (--tolerance-px {_rounded_up(best.largest_px):g}) to accept this error"
            if tolerance is None
            else f"the error must be at most tolerance_px = {tolerance:g}"
        )
        raise InvalidParameter(
            f"{best.target.name} {best.target.layout.unsupported(camera)}; the best fit "
            f"has an error of {_description(best, evaluated.is_central)}; "
            f"{verdict}{_remedies(camera, best)}"
        )
    return best._replace(is_restricted=len(evaluated.pixels) < len(full_field.pixels))


def _calibrated_deg(camera: Camera) -> float | None:
    """Return the calibrated field (deg) of a camera; None if its file does not contain it."""
    uncertainty = getattr(camera, "uncertainty", None)
    return None if uncertainty is None else uncertainty.field_deg


def _rounded_up(value: float) -> float:
    """Round a positive number up to two digits.

    >>> _rounded_up(0.0341), _rounded_up(12.0)
    (0.035, 12.0)
    """
    digit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / digit - 1e-9) * digit:.2g}")


def _remedies(camera: Camera, best: _StoredCamera) -> str:
    """Return alternatives for a conversion, such as a smaller field or fixed parameters."""
    max_error_deg = max(best.costs, key=lambda c: c.largest_px).at_deg
    remedies = [f"or a field_deg (--set fit.field_deg) below {max_error_deg:.3g} deg"]
    if getattr(camera, "uncertainty", None) is not None and (
        names := best.target.layout.unsupported_parameters(camera)
    ):
        fixed = f"--set estimation.fixed={','.join(names)}"
        remedies.append(f"or calibrate with {fixed} for an exact conversion")
    return "".join(f", {remedy}" for remedy in remedies)


def _best_fit(
    target: OutputLayout,
    fit_sample: Sample,
    evaluated: Sample,
    size: tuple[int, int],
    distances: tuple[float, ...],
) -> _StoredCamera:
    """Return the best fit among the models of a target, or the first with negligible error."""
    layout = target.layout
    best = None
    for model in initial_models(
        layout.kind, layout.parameters, rotational_projection(fit_sample, size)
    ):
        free = [layout.parameters is None or p.name in layout.parameters for p in model.parameters]
        model_fit = fit_model(model, fit_sample, free, distances)
        distances = (np.inf,) if evaluated.is_central else distances
        trial = _StoredCamera(
            target,
            model_fit,
            tuple(reprojection_errors(model_fit, evaluated, distance) for distance in distances),
        )
        if best is None or trial.largest_px < best.largest_px:
            best = trial
        if best.largest_px < SUFFICIENT_ERROR_PX:
            break
    assert best is not None
    return best


def _description(stored: _StoredCamera, is_central: bool) -> str:
    maximum = max(stored.costs, key=lambda c: c.largest_px)
    rms = np.sqrt(np.mean([c.rms_px**2 for c in stored.costs]))
    distance = "" if is_central else f", object distance {maximum.distance_mm:g} mm"
    return f"{rms:.3g} px rms, at most {maximum.largest_px:.3g} px ({maximum.at_deg:.3g} deg from the axis{distance})"


def _field_notes(source: Camera, stored: _StoredCamera, field_deg: float | None) -> Iterable[str]:
    """Yield notes on the calibrated field in which the file is valid."""
    calibrated_deg = _calibrated_deg(source)
    if (
        calibrated_deg is None
        or field_deg is not None
        or stored.target.layout.kind in (RadialModel, Sensor)
    ):
        return
    if stored.is_restricted:
        yield (
            f"the fit is restricted to the calibrated field of 0 to {calibrated_deg:.4g} "
            "deg; use field_deg (--set fit.field_deg) to include angles beyond it, where the "
            "camera is an extrapolation"
        )
    elif (
        not stored.costs
        and np.degrees(getattr(source, "omega_max", 0.0)) > calibrated_deg + FIELD_ROUNDING_DEG
    ):
        yield (
            f"the calibrated field of 0 to {calibrated_deg:.4g} deg is not in the file: "
            "beyond it the camera is an extrapolation"
        )


def _notes(source: Camera, output_camera: Any, stored: _StoredCamera) -> Iterable[str]:
    """Yield notes for users of the file."""
    target = stored.target
    if np.any(stored.found.viewpoint_mm):
        x, y, z = (round(float(v), 3) + 0.0 for v in stored.found.viewpoint_mm)
        yield (
            f"the origin of the file's frame is the best single viewpoint, ({x:g}, {y:g}, {z:g}) mm in the camera frame"
        )
    if target.layout.is_panorama:
        width, height = sphere(source).size
        yield (
            "the file describes a panorama; dewarp each image first with omnimirror "
            f"dewarp --view sphere --size {width}x{height}; the axes of its frame are the "
            "world's right, down and forward"
        )
        return
    if not isinstance(output_camera, CameraModel) or target.layout.kind is RadialModel:
        return
    if output_camera.is_image_reversed:
        yield (
            "the image is mirrored: the file's frame (right, down, viewing direction of "
            "the image centre) is left-handed; flip writes the camera of the flipped "
            "image, whose frame is right-handed"
        )
    elif output_camera.mount.image_flipped:
        yield "the file applies to the image flipped left to right"
    field_angle = np.degrees(getattr(output_camera, "omega_max", 0.0))
    if field_angle > target.layout.max_field_angle_deg:
        yield (
            "programs that read this format project less than "
            f"{target.layout.max_field_angle_deg:g} deg from the axis; the field of the "
            f"camera is {field_angle:.4g} deg"
        )
    if isinstance(source, Sensor) or getattr(source, "rim_radius_px", None) is not None:
        yield "the boundary of the field (rim_radius_px) is not in the file"
    if getattr(source, "mount", Mount()) != Mount():
        yield "the orientation of the camera is not in the file"
