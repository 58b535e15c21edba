"""Comparison of sensors: table of their properties over the whole field."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from ..base.arguments import distances, instance
from ..base.caching import cached_property
from ..base.errors import InvalidParameter
from ..base.escaping import csv_cell, json_text
from ..base.files import write_text
from ..base.quantities import QUANTITIES, Quantity
from ..base.results import Columns, Result
from ..base.typing import Array
from ..optics.image_sensor import ImagerPose
from ..optics.lenses import GaussianLens
from ..optics.sensor import Sensor, check_sensor
from ._full_field import FullFieldEvaluation
from .evaluation import Evaluation, evaluate
from .focus import best_focus, best_viewpoint

Better = Literal["high", "low", ""]

MAX_SENSORS = 6  # maximum number of sensors; limited by the colour-blind-safe palette
FIELD_NODES = 721  # field angles for extreme and mean values
NEAR_OBJECT_MM = 1000.0  # object distance of the single-viewpoint error


@dataclass(frozen=True)
class ComparedQuantity:
    """Row of the comparison: one quantity for all sensors."""

    quantity: Quantity
    values: tuple[float | str, ...]
    """One value per sensor; NaN if inapplicable."""
    better: Better
    """Direction of improvement; empty for a descriptive quantity."""

    @property
    def name(self) -> str:
        return self.quantity.name

    @property
    def texts(self) -> list[str]:
        """Values as formatted text."""
        text = self.quantity.text
        return [v if isinstance(v, str) else "–" if math.isnan(v) else text(v) for v in self.values]

    @property
    def best(self) -> list[bool]:
        """Mask of the best sensors; empty for descriptive or equal values."""
        numbers = [v for v in self.values if isinstance(v, float) and not math.isnan(v)]
        if not self.better or len({*self.texts} - {"–"}) < 2:
            return [False] * len(self.values)
        best_text = self.quantity.text((max if self.better == "high" else min)(numbers))
        return [text == best_text for text in self.texts]


@dataclass(frozen=True)
class Comparison(Result):
    """Comparison of one to six sensors, computed by :func:`compare`."""

    sensors: tuple[Sensor, ...]
    rows: tuple[ComparedQuantity, ...]
    notes: tuple[str, ...] = ()
    """Notes on sensors with limitations of the comparison."""

    def _table(self) -> Columns:
        names = [row.name for row in self.rows]
        columns = zip(*(row.values for row in self.rows), strict=True)
        return {"quantity": names} | dict(zip(self.names, map(list, columns), strict=True))

    @property
    def names(self) -> list[str]:
        """Unique names of the sensors, numbered if necessary."""
        return [s.name for s in self.sensors]

    def __getitem__(self, name: str) -> ComparedQuantity:
        """Return the row of a quantity.

        Raises
        ------
        InvalidParameter
            If the quantity is not in the table.
        """
        for row in self.rows:
            if row.name == name:
                return row
        raise InvalidParameter(
            f"the quantity must be one of {', '.join(r.name for r in self.rows)}; got {name!r}"
        )

    def to_csv(self, path: str | Path) -> None:
        """Write the table as CSV, a line per quantity and a column per sensor."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["quantity", *map(csv_cell, self.names)])
        for row in self.rows:
            writer.writerow(
                [
                    row.name,
                    *(csv_cell(v) if isinstance(v, str) else f"{v:.17g}" for v in row.values),
                ]
            )
        write_text(path, text.getvalue())

    def to_json(self, path: str | Path) -> None:
        """Write the sensors as JSON objects; non-finite numbers become strings."""
        sensors = [
            {"name": name, **{row.name: _word(row.values[i]) for row in self.rows}}
            for i, name in enumerate(self.names)
        ]
        write_text(path, json_text(sensors, indent=1) + "\n")


def compare(sensors: Sequence[Sensor], object_distance_mm: float = np.inf) -> Comparison:
    """Compare up to six sensors over their whole fields, each at its own F-number.

    A sensor with a decentred or tilted mirror, for example from a calibration, is traced in three
    dimensions; its extreme values include all azimuths. With a real lens, a cover or a tilted
    imager, the aligned sensor is compared instead, with a note. Extreme values of an
    aligned sensor are those of 721 field angles.

    Parameters
    ----------
    sensors
        One to six sensors; duplicate names are numbered.
    object_distance_mm
        Object distance from the mirror, for the lengths per pixel on a plane and on a cylinder; all
        other rows refer to distant objects.

    Returns
    -------
    Comparison
        One row for each quantity, with the best values marked.

    Raises
    ------
    InvalidParameter
        If there is no sensor, or more than six.
    NotOneToOne, SelfObstruction
        If the mirror cannot be used.

    Examples
    --------
    >>> import omnimirror as om
    >>> result = om.compare([om.load_sensor("paper-spherical"), om.load_sensor("paper-hyperboloidal")])
    >>> result["best_focus_worst_floored_area_deg2"].texts, result["viewpoint_spread_mm"].best
    (['0.741', '1.795'], [False, True])
    """
    sensors = list(instance("sensors", sensors, Sequence, "a list of sensors"))
    for i, sensor in enumerate(sensors):
        check_sensor(sensor, f"sensors[{i}]")
    if not 1 <= len(sensors) <= MAX_SENSORS:
        raise InvalidParameter(
            f"the number of sensors must be 1 to {MAX_SENSORS}; got {len(sensors)}"
        )
    unique = _with_unique_names(sensors)
    distance = float(distances("object_distance_mm", object_distance_mm))
    studies = [replace(_study(s), object_distance_mm=distance) for s in unique]
    notes = [_note(study, s) for study, s in zip(studies, unique, strict=True) if not s.is_axial]
    rows = tuple(_compared(name, studies) for name in COMPARED)
    return Comparison(tuple(s.sensor for s in studies), rows, tuple(notes))


def _study(sensor: Sensor) -> Study:
    """Return the data source for the rows of a sensor, three-dimensional if misaligned."""
    if sensor.is_axial:
        return Study(sensor)
    is_traced = sensor.lens.IS_THIN and sensor.imager_pose.is_perpendicular
    is_traced &= sensor.secondary is None and sensor.housing.shell is None
    return FullFieldStudy(sensor) if is_traced else Study(sensor.aligned())


def _note(study: Study, sensor: Sensor) -> str:
    """Return a note on the misalignment of a sensor and the method of comparison."""
    pose, shell, is_in_place = sensor.mirror_pose, sensor.housing.shell, study.sensor != sensor
    method = "as an aligned sensor" if is_in_place else "over the full image, at all azimuths"
    differences = {
        f"mirror decentred by {math.hypot(pose.decentre_x_mm, pose.decentre_y_mm):.2g} mm "
        f"and tilted by {math.hypot(pose.tilt_x_deg, pose.tilt_y_deg):.2g} deg": not pose.is_axial,
        "form error of the mirror": not sensor.mirror_form.is_empty,
        "tilted or rotated imager": sensor.imager_pose != ImagerPose(),
        "misaligned cover": shell is not None and not shell.is_axial,
    }
    return f"{sensor.name}: {', '.join(text for text, applies in differences.items() if applies)}; compared {method}."


def _with_unique_names(sensors: Sequence[Sensor]) -> list[Sensor]:
    """Return the sensors with unique names."""
    names = [s.name for s in sensors]
    return [
        s
        if names.count(s.name) == 1
        else replace(s, name=f"{s.name} ({names[: i + 1].count(s.name)})")
        for i, s in enumerate(sensors)
    ]


# -- compared quantities ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Study:
    """Data source for the rows of an aligned sensor."""

    sensor: Sensor
    object_distance_mm: float = np.inf

    @cached_property
    def at_sensor_focus(self) -> Any:
        """Columns over the whole field at the focus of the sensor."""
        return self.evaluation

    @cached_property
    def evaluation(self) -> Evaluation:
        """Evaluation of the aligned sensor."""
        aligned = self.sensor.aligned()
        return evaluate(aligned, np.linspace(*aligned.field_deg, FIELD_NODES))

    @cached_property
    def near_objects(self) -> Evaluation:
        """Evaluation of the aligned sensor for objects at the finite distance."""
        omega_deg = self.evaluation.omega_deg
        return evaluate(
            self.sensor.aligned(), omega_deg, object_distance_mm=self.object_distance_mm
        )

    def object_size(self, surface: str) -> float:
        """Return the smallest length per pixel, mm, the larger of both directions."""
        t = getattr(self.near_objects, f"{surface}_t_mm_per_px")
        return float(np.fmin.reduce(np.maximum(t, self.near_objects.object_s_mm_per_px)))

    @cached_property
    def best_focus_optimum(self) -> tuple[float, float]:
        """Best focus, mm, and its worst floored blur area."""
        optimum = best_focus(self.sensor)
        return optimum.focus_mm, optimum.value

    @property
    def field_deg(self) -> tuple[float, float]:
        return self.sensor.field_deg

    @property
    def hidden(self) -> tuple[float, float]:
        """End of the central obscuration, deg, and the obscured fraction of the image, %."""
        return self.sensor.obscured_to_deg, self.sensor.obscured_percent

    def rim_radius(self) -> float:
        return self.sensor.rim_radius_px

    def viewpoint_spread(self) -> float:
        heights = self.at_sensor_focus.viewpoint_z_mm
        return float(np.ptp(heights[np.isfinite(heights)]))

    def sphere_coverage_percent(self) -> float:
        """Return the visible percentage of all directions."""
        low, high = np.cos(np.radians(self.sensor.field_deg))
        # solid angle 2 pi (cos(low) - cos(high)) relative to 4 pi
        return float(50 * (low - high))

    def nonlinearity(self) -> float:
        """Return the largest deviation from a linear mapping, % of the rim height."""
        h, omega = self.at_sensor_focus.h_px, self.at_sensor_focus.omega_deg
        return float(100 * np.abs(h / h[-1] - omega / omega[-1]).max())

    def worst_aspect(self) -> float:
        """Return the largest ratio of the longer to the shorter side of the image of a small
        square; inf at a cone tip.
        """
        ratio = self.at_sensor_focus.aspect[np.isfinite(self.at_sensor_focus.aspect)]
        with np.errstate(divide="ignore"):
            return float(np.maximum(ratio, 1 / ratio).max())

    def one_viewpoint_error(self) -> float:
        return best_viewpoint(self.sensor, NEAR_OBJECT_MM).worst_px

    def length(self) -> float:
        """Return the axial length from the lens, or a second mirror before it, to the far end, mm;
        NaN for a telecentric lens, whose distance is free.
        """
        sensor, second = self.sensor, self.sensor.secondary
        if sensor.lens.TELECENTRIC:
            return float("nan")
        m = self.evaluation.sensor.meridian.m
        heights = [*sensor.mirror.bounds[1], -m if second is None else second.lens_height(m)]
        if second is not None:
            heights += [-second.distance_mm - z for z in second.mirror.bounds[1]]
        return float(max(heights) - min(heights))


class FullFieldStudy(Study):
    """Data source for the rows of a misaligned sensor, over all azimuths."""

    @cached_property
    def full_field(self) -> FullFieldEvaluation:
        return FullFieldEvaluation(self.sensor)

    @cached_property
    def at_sensor_focus(self) -> Any:
        """Columns over the whole image."""
        blur = self.full_field.at_sensor_focus
        return SimpleNamespace(
            dh_domega_px_per_deg=blur.imaging.height,
            area_px2=blur.imaging.area,
            aspect=blur.imaging.aspect,
            blur_t_px=blur.t_px,
            blur_s_px=blur.s_px,
            blur_t_deg=blur.t_deg,
            blur_s_deg=blur.s_deg,
            floored_area_deg2=blur.floored_area(),
        )

    @cached_property
    def best_focus_optimum(self) -> tuple[float, float]:
        return self.full_field.best_focus()

    @property
    def field_deg(self) -> tuple[float, float]:
        return self.full_field.field_deg

    @property
    def hidden(self) -> tuple[float, float]:
        return self.full_field.hidden

    def rim_radius(self) -> float:
        return self.full_field.rim_radius_px()

    def viewpoint_spread(self) -> float:
        return self.full_field.viewpoint_spread()

    def sphere_coverage_percent(self) -> float:
        return self.full_field.sphere_coverage_percent()

    def nonlinearity(self) -> float:
        return self.full_field.nonlinearity()

    def one_viewpoint_error(self) -> float:
        return self.full_field.one_viewpoint_error(NEAR_OBJECT_MM)


def _reduced(column: str, reduce: Callable[[Array], Any]) -> Callable[[Study], float]:
    """Return a function for a reduction of an evaluation column, without poles (tip of a cone)."""

    def value(study: Study) -> float:
        values = getattr(study.at_sensor_focus, column)
        return float(reduce(values[np.isfinite(values)]))

    return value


def _max_abs(column: str) -> Callable[[Study], float]:
    return _reduced(column, lambda values: np.abs(values).max())


def _ratio(column: str) -> Callable[[Study], float]:
    return _reduced(column, lambda values: values.min() / values.max())


def _secondary(study: Study) -> str:
    second = study.sensor.secondary
    return "–" if second is None else second.mirror.KIND


def _f_number(study: Study) -> float:
    lens = study.sensor.lens
    return lens.f_number if isinstance(lens, GaussianLens) else lens.image_f_number()


def _sag(study: Study) -> float:
    mirror = study.sensor.mirror
    return float(mirror.sag(mirror.rim_radius_mm))


Value = Callable[[Study], float | str]
TANGENTIAL = "dh_domega_px_per_deg"
COMPARED: dict[str, tuple[Better, Value]] = {
    "mirror": ("", lambda s: s.sensor.mirror.KIND),
    "secondary": ("", _secondary),
    "f_number": ("", _f_number),
    "field_from_deg": ("low", lambda s: s.field_deg[0]),
    "field_to_deg": ("high", lambda s: s.field_deg[1]),
    "sphere_coverage_percent": ("high", lambda s: s.sphere_coverage_percent()),
    "obscured_to_deg": ("low", lambda s: s.hidden[0]),
    "obscured_percent": ("low", lambda s: s.hidden[1]),
    "rim_radius_px": ("", lambda s: s.rim_radius()),
    "nonlinearity_percent": ("low", lambda s: s.nonlinearity()),
    "min_dh_domega_px_per_deg": ("high", _reduced(TANGENTIAL, np.min)),
    "max_dh_domega_px_per_deg": ("", _reduced(TANGENTIAL, np.max)),
    "dh_domega_ratio": ("high", _ratio(TANGENTIAL)),
    "area_ratio": ("high", _ratio("area_px2")),
    "min_aspect": ("", _reduced("aspect", np.min)),
    "max_aspect": ("", _reduced("aspect", np.max)),
    "worst_aspect": ("low", lambda s: s.worst_aspect()),
    "min_plane_mm_per_px": ("low", lambda s: s.object_size("plane")),
    "min_cylinder_mm_per_px": ("low", lambda s: s.object_size("cylinder")),
    "viewpoint_spread_mm": ("low", lambda s: s.viewpoint_spread()),
    "single_viewpoint_error_px": ("low", lambda s: s.one_viewpoint_error()),
    "focus_mm": ("", lambda s: s.evaluation.focus_mm),
    "depth_of_field_mm": ("high", lambda s: s.evaluation.depth_of_field_mm.depth),
    "worst_blur_t_px": ("low", _max_abs("blur_t_px")),
    "worst_blur_s_px": ("low", _max_abs("blur_s_px")),
    "worst_blur_t_deg": ("low", _max_abs("blur_t_deg")),
    "worst_blur_s_deg": ("low", _max_abs("blur_s_deg")),
    "worst_floored_area_deg2": ("low", _max_abs("floored_area_deg2")),
    "best_focus_mm": ("", lambda s: s.best_focus_optimum[0]),
    "best_focus_worst_floored_area_deg2": ("low", lambda s: s.best_focus_optimum[1]),
    "airy_px": ("low", lambda s: s.evaluation.airy_px),
    "length_mm": ("low", lambda s: s.length()),
    "mirror_diameter_mm": ("low", lambda s: 2 * s.sensor.mirror.rim_radius_mm),
    "sag_mm": ("low", _sag),
    "rim_slope_deg": ("low", lambda s: float(s.evaluation.beta_deg[-1])),
}
"""Direction of improvement and value of each compared quantity."""


def _compared(name: str, studies: Sequence[Study]) -> ComparedQuantity:
    preference, value = COMPARED[name]
    return ComparedQuantity(QUANTITIES[name], tuple(value(s) for s in studies), preference)


def _word(value: float | str) -> float | str:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
