"""Sensors side by side: one table of what each does over its whole field, the best of each row known."""

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
from numpy.typing import NDArray

from ..base.arguments import distances, instance
from ..base.errors import InvalidParameter
from ..base.escaping import csv_cell, json_text
from ..base.files import write_text
from ..base.numerics.lazy import cached_property
from ..base.quantities import QUANTITIES, Quantity
from ..optics.image_sensor import ImagerPose
from ..optics.lenses import GaussianLens
from ..optics.sensor import Sensor, check_sensor
from .evaluation import Evaluation, evaluate
from .meridional.focus import best_focus
from .meridional.viewpoints import best_viewpoint
from .whole_picture import WholePicture

Array = NDArray[np.float64]
Better = Literal["high", "low", ""]

MOST = 6  # sensors side by side; as many as there are colours that the colour-blind tell apart
NODES = 721  # field angles over which the worst and the mean are taken
NEAR_MM = 1000.0  # distance of the objects for which one viewpoint is assumed


@dataclass(frozen=True)
class Compared:
    """One line of the comparison: a quantity of every sensor."""

    quantity: Quantity
    values: tuple[float | str, ...]
    """One per sensor; NaN where the sensor has no such thing."""
    better: Better
    """Whether high or low is better; neither for what only describes."""

    @property
    def name(self) -> str:
        return self.quantity.name

    @property
    def texts(self) -> list[str]:
        """The values as people read them."""
        text = self.quantity.text
        return [v if isinstance(v, str) else "–" if math.isnan(v) else text(v) for v in self.values]

    @property
    def best(self) -> list[bool]:
        """Which sensors are best; none where it does not matter or all are equal, all that read equal to the best."""
        numbers = [v for v in self.values if isinstance(v, float) and not math.isnan(v)]
        if not self.better or len({*self.texts} - {"–"}) < 2:
            return [False] * len(self.values)
        best = self.quantity.text((max if self.better == "high" else min)(numbers))
        return [text == best for text in self.texts]


@dataclass(frozen=True)
class Comparison:
    """One to six sensors side by side; see :func:`compare`."""

    sensors: tuple[Sensor, ...]
    rows: tuple[Compared, ...]
    notes: tuple[str, ...] = ()
    """Of sensors that were compared otherwise than they are, in sentences."""

    @property
    def names(self) -> list[str]:
        """Names of the sensors, told apart by a number where two are the same."""
        return [s.name for s in self.sensors]

    def __getitem__(self, name: str) -> Compared:
        """The row of a quantity.

        Raises
        ------
        InvalidParameter
            A quantity that is not in the table.
        """
        for row in self.rows:
            if row.name == name:
                return row
        raise InvalidParameter(f"{name!r} is not compared; valid are {', '.join(r.name for r in self.rows)}")

    def to_csv(self, path: str | Path) -> None:
        """Write the table, a line per quantity and a column per sensor, numbers with 17 significant digits."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["quantity", *map(csv_cell, self.names)])
        for row in self.rows:
            writer.writerow([row.name, *(csv_cell(v) if isinstance(v, str) else f"{v:.17g}" for v in row.values)])
        write_text(path, text.getvalue())

    def to_json(self, path: str | Path) -> None:
        """Write a list of sensors, each an object of its quantities; numbers that are not finite become words."""
        sensors = [
            {"name": name, **{row.name: _word(row.values[i]) for row in self.rows}} for i, name in enumerate(self.names)
        ]
        write_text(path, json_text(sensors, indent=1) + "\n")


def compare(sensors: Sequence[Sensor], object_distance_mm: float = np.inf) -> Comparison:
    """Compare up to six sensors over their whole fields, each at its own F-number.

    A sensor whose mirror is decentred or tilted, as a calibration finds it, is traced in space: what is least, largest
    or worst is so over its whole picture, at all azimuths. With a real lens, a cover or a leaning imager it is compared
    as if it were in place. Its note says which.

    Parameters
    ----------
    sensors
        One to six; sensors of the same name get a number behind it.
    object_distance_mm
        Distance of the objects from the mirror, for the lengths per pixel on a plane and on a cylinder; all other rows
        are of distant objects.

    Returns
    -------
    Comparison
        A row per quantity, with the best of each marked.

    Raises
    ------
    InvalidParameter
        No sensor, or more than six.
    NotOneToOne, SelfObstruction
        A mirror that cannot be used as it stands.

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
    if not 1 <= len(sensors) <= MOST:
        raise InvalidParameter(f"{len(sensors)} sensors do not fit side by side; 1 to {MOST} are valid")
    named = _told_apart(sensors)
    distance = float(distances("object_distance_mm", object_distance_mm))
    studies = [replace(_study(s), object_distance_mm=distance) for s in named]
    notes = [_note(study, s) for study, s in zip(studies, named, strict=True) if not s.is_axial]
    rows = tuple(_compared(name, studies) for name in COMPARED)
    return Comparison(tuple(s.sensor for s in studies), rows, tuple(notes))


def _study(sensor: Sensor) -> Study:
    """What the rows of a sensor are made from: of one that is out of its axis, in space as far as that is traced."""
    if sensor.is_axial:
        return Study(sensor)
    is_traced = sensor.lens.IS_THIN and sensor.imager_pose.is_square
    is_traced &= sensor.secondary is None and sensor.housing.shell is None
    return StudyInSpace(sensor) if is_traced else Study(sensor.aligned())


def _note(study: Study, sensor: Sensor) -> str:
    """How a sensor differs from its drawing, and how it was compared."""
    pose, shell, is_in_place = sensor.mirror_pose, sensor.housing.shell, study.sensor != sensor
    how = "as if it were in place" if is_in_place else "over its whole picture, at all azimuths"
    differs = {
        f"its mirror is decentred by {math.hypot(pose.decentre_x_mm, pose.decentre_y_mm):.2g} mm and "
        f"tilted by {math.hypot(pose.tilt_x_deg, pose.tilt_y_deg):.2g} deg": not pose.is_axial,
        "its mirror has a form error": not sensor.mirror_form.is_empty,
        "its imager leans or is turned": sensor.imager_pose != ImagerPose(),
        "its cover is out of place": shell is not None and not shell.is_axial,
    }
    return f"{sensor.name}: {', '.join(what for what, is_so in differs.items() if is_so)}; it is compared {how}."


def _told_apart(sensors: Sequence[Sensor]) -> list[Sensor]:
    """The sensors with names that all differ."""
    names = [s.name for s in sensors]
    return [
        s if names.count(s.name) == 1 else replace(s, name=f"{s.name} ({names[: i + 1].count(s.name)})")
        for i, s in enumerate(sensors)
    ]


# -- what is compared ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Study:
    """What the rows of one sensor are made from."""

    sensor: Sensor
    object_distance_mm: float = np.inf

    @cached_property
    def own(self) -> Any:
        """Columns of the whole field, focused as the sensor says, by their names in an evaluation."""
        return self.evaluation

    @cached_property
    def evaluation(self) -> Evaluation:
        """Of the aligned sensor."""
        aligned = self.sensor.aligned()
        return evaluate(aligned, np.linspace(*aligned.field_deg, NODES))

    @cached_property
    def near(self) -> Evaluation:
        """Evaluation of the aligned sensor for objects at the distance."""
        omega_deg = self.evaluation.omega_deg
        return evaluate(self.sensor.aligned(), omega_deg, object_distance_mm=self.object_distance_mm)

    def object_size(self, surface: str) -> float:
        """Return the least length per pixel, mm, on a plane or a cylinder; the larger of both directions counts."""
        t = getattr(self.near, f"{surface}_t_mm_per_px")
        return float(np.fmin.reduce(np.maximum(t, self.near.object_s_mm_per_px)))

    @cached_property
    def best(self) -> tuple[float, float]:
        """The best focus, mm, and the worst floored blur area there."""
        found = best_focus(self.sensor)
        return found.focus_mm, found.value

    @property
    def field_deg(self) -> tuple[float, float]:
        return self.sensor.field_deg

    @property
    def hidden(self) -> tuple[float, float]:
        """Up to which angle (deg) the middle is hidden, and what share of the picture, %."""
        return self.sensor.hidden_to_deg, self.sensor.hidden_percent

    def rim_radius(self) -> float:
        return self.sensor.rim_radius_px

    def viewpoint_spread(self) -> float:
        heights = self.own.viewpoint_z_mm
        return float(np.ptp(heights[np.isfinite(heights)]))

    def share_of_sphere(self) -> float:
        """Percentage of all directions that is seen."""
        low, high = np.cos(np.radians(self.sensor.field_deg))
        return float(50 * (low - high))

    def nonlinearity(self) -> float:
        """Largest departure of the image height from the line through centre and rim, % of the rim's."""
        h, omega = self.own.h_px, self.own.omega_deg
        return float(100 * np.abs(h / h[-1] - omega / omega[-1]).max())

    def worst_aspect(self) -> float:
        """Largest ratio of the longer to the shorter side of the image of a small square; inf at the tip of a cone."""
        ratio = self.own.aspect[np.isfinite(self.own.aspect)]
        with np.errstate(divide="ignore"):
            return float(np.maximum(ratio, 1 / ratio).max())

    def one_viewpoint_error(self) -> float:
        return best_viewpoint(self.sensor, NEAR_MM).worst_px

    def length(self) -> float:
        """From the lens (or a second mirror before it) to the far end, mm; NaN for a telecentric lens, which stands
        anywhere."""
        sensor, second = self.sensor, self.sensor.secondary
        if sensor.lens.TELECENTRIC:
            return float("nan")
        m = self.evaluation.sensor.meridian.m
        heights = [*sensor.mirror.bounds[1], -m if second is None else second.lens_height(m)]
        if second is not None:
            heights += list(second.height(np.linspace(0, second.mirror.rim_radius_mm, 129)))
        return float(max(heights) - min(heights))


class StudyInSpace(Study):
    """The same of a sensor that is out of its axis: at all azimuths."""

    @cached_property
    def picture(self) -> WholePicture:
        return WholePicture(self.sensor)

    @cached_property
    def own(self) -> Any:
        """Columns over the whole picture."""
        blur = self.picture.own
        return SimpleNamespace(
            dh_domega_px_per_deg=blur.imaging.height, area_px2=blur.imaging.area, aspect=blur.imaging.aspect,
            blur_t_px=blur.t_px, blur_s_px=blur.s_px, blur_t_deg=blur.t_deg, blur_s_deg=blur.s_deg,
            floored_area_deg2=blur.floored_area(),
        )  # fmt: skip

    @cached_property
    def best(self) -> tuple[float, float]:
        return self.picture.best_focus()

    @property
    def field_deg(self) -> tuple[float, float]:
        return self.picture.field_deg

    @property
    def hidden(self) -> tuple[float, float]:
        return self.picture.hidden

    def rim_radius(self) -> float:
        return self.picture.rim_radius_px()

    def viewpoint_spread(self) -> float:
        return self.picture.viewpoint_spread()

    def share_of_sphere(self) -> float:
        return self.picture.share_of_sphere()

    def nonlinearity(self) -> float:
        return self.picture.nonlinearity()

    def one_viewpoint_error(self) -> float:
        return self.picture.one_viewpoint_error(NEAR_MM)


def _of(column: str, reduce: Callable[[Array], Any]) -> Callable[[Study], float]:
    """A number made from a column of the evaluation, poles (a cone's tip) left out."""

    def value(study: Study) -> float:
        values = getattr(study.own, column)
        return float(reduce(values[np.isfinite(values)]))

    return value


def _worst(column: str) -> Callable[[Study], float]:
    return _of(column, lambda values: np.abs(values).max())


def _ratio(column: str) -> Callable[[Study], float]:
    return _of(column, lambda values: values.min() / values.max())


def _secondary(study: Study) -> str:
    second = study.sensor.secondary
    return "–" if second is None else second.mirror.KIND


def _f_number(study: Study) -> float:
    lens = study.sensor.lens
    return lens.f_number if isinstance(lens, GaussianLens) else lens.image_f_number()


def _sag(study: Study) -> float:
    low, high = study.sensor.mirror.bounds[1]
    return high - low


Value = Callable[[Study], float | str]
TANGENTIAL = "dh_domega_px_per_deg"
COMPARED: dict[str, tuple[Better, Value]] = {
    "mirror": ("", lambda s: s.sensor.mirror.KIND),
    "secondary": ("", _secondary),
    "f_number": ("", _f_number),
    "field_from_deg": ("low", lambda s: s.field_deg[0]),
    "field_to_deg": ("high", lambda s: s.field_deg[1]),
    "share_of_sphere_percent": ("high", lambda s: s.share_of_sphere()),
    "hidden_to_deg": ("low", lambda s: s.hidden[0]),
    "hidden_percent": ("low", lambda s: s.hidden[1]),
    "rim_radius_px": ("", lambda s: s.rim_radius()),
    "nonlinearity_percent": ("low", lambda s: s.nonlinearity()),
    "least_dh_domega_px_per_deg": ("high", _of(TANGENTIAL, np.min)),
    "largest_dh_domega_px_per_deg": ("", _of(TANGENTIAL, np.max)),
    "dh_domega_ratio": ("high", _ratio(TANGENTIAL)),
    "area_ratio": ("high", _ratio("area_px2")),
    "least_aspect": ("", _of("aspect", np.min)),
    "largest_aspect": ("", _of("aspect", np.max)),
    "worst_aspect": ("low", lambda s: s.worst_aspect()),
    "least_plane_mm_per_px": ("low", lambda s: s.object_size("plane")),
    "least_cylinder_mm_per_px": ("low", lambda s: s.object_size("cylinder")),
    "viewpoint_spread_mm": ("low", lambda s: s.viewpoint_spread()),
    "one_viewpoint_error_px": ("low", lambda s: s.one_viewpoint_error()),
    "focus_mm": ("", lambda s: s.evaluation.focus_mm),
    "depth_of_field_mm": ("high", lambda s: s.evaluation.depth_of_field_mm.depth),
    "worst_blur_t_px": ("low", _worst("blur_t_px")),
    "worst_blur_s_px": ("low", _worst("blur_s_px")),
    "worst_blur_t_deg": ("low", _worst("blur_t_deg")),
    "worst_blur_s_deg": ("low", _worst("blur_s_deg")),
    "worst_floored_area_deg2": ("low", _worst("floored_area_deg2")),
    "best_focus_mm": ("", lambda s: s.best[0]),
    "best_focus_worst_floored_area_deg2": ("low", lambda s: s.best[1]),
    "airy_px": ("low", lambda s: s.evaluation.airy_px),
    "length_mm": ("low", lambda s: s.length()),
    "mirror_diameter_mm": ("low", lambda s: 2 * s.sensor.mirror.rim_radius_mm),
    "sag_mm": ("low", _sag),
    "rim_slope_deg": ("low", lambda s: float(s.evaluation.beta_deg[-1])),
}
"""What is better and the value of each quantity compared; pixels, blur and depth of field are each sensor's own."""


def _compared(name: str, studies: Sequence[Study]) -> Compared:
    better, value = COMPARED[name]
    return Compared(QUANTITIES[name], tuple(value(s) for s in studies), better)


def _word(value: float | str) -> float | str:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
