"""Names and evaluation of merits that limits require: quantities of requirement files for trials.

Examples of names in tables and of ``--merit``: ``motion_px after pose``,
``total_blur_px, 20 to 100 deg``, ``mtf at 0.25 cycles/px``. Merits with a lower limit have the prefix
``min``: ``min resolution_px_per_deg``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import format_value
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.typing import Array
from ...design.limits import LIMITABLE, Limit, format_part
from ...design.merits import OF_THE_WHOLE
from ...optics.sensor import Sensor
from .compensation import CALIBRATIONS, after, merit_names
from .perturbation import perturbed
from .perturbed_states import Values, is_vectorised
from .requirement_values import (
    Motions,
    RimView,
    StraightLines,
    TrialView,
    sequential_rims,
    sequential_views,
    vectorised_rims,
    vectorised_views,
)
from .trial_images import Field, Refocus, field_at

MIN_PREFIX = "min "
STRAIGHTNESS = "straightness_deg"
BUILT_QUANTITIES = (STRAIGHTNESS, "viewpoint_shift_mm", "rim_reach_px", "field_to_deg")
"""Quantities that are limited only for as-built sensors."""
LOWER_LIMITED = ("field_to_deg",)
UNLIMITED = ("focus_distance_mm", "lost_rays")
PER_PIXEL = "mm_per_px"
"""Ending of quantities that depend on the object distance."""
NUMBER = r"([-+.\deE]+)"
WORDS = re.compile(
    rf"(?P<least>{MIN_PREFIX})?(?P<quantity>\w+)(?: at {NUMBER} cycles/px)?(?:, (?:at {NUMBER}|{NUMBER} to "
    rf"{NUMBER}) deg)?"
    r"(?: after (?P<after>[-\w]+))?"
)


@dataclass(frozen=True)
class MeritName:
    """Components of a merit name.

    Attributes
    ----------
    quantity
        Name of the quantity.
    is_lower_limit
        Whether the minimum is limited instead of the maximum.
    omega_deg
        Range of field angles, deg; the whole field if None.
    cycles_per_px
        Spatial frequency of an MTF.
    after
        Calibration, for motions, directions and straightness.
    """

    quantity: str
    is_lower_limit: bool = False
    omega_deg: tuple[float, float] | None = None
    cycles_per_px: float | None = None
    after: str = "none"

    @property
    def text(self) -> str:
        """Merit name as text.

        >>> MeritName("resolution_px_per_deg", True, (20.0, 100.0)).text
        'min resolution_px_per_deg, 20 to 100 deg'
        """
        frequency = "" if self.cycles_per_px is None else f" at {self.cycles_per_px:g} cycles/px"
        label = f"{MIN_PREFIX if self.is_lower_limit else ''}{self.quantity}{frequency}{format_part(self.omega_deg)}"
        return after(label, self.after)  # type: ignore[arg-type]  # _check rejects other words

    def limit(self, value: float) -> Limit:
        """Convert to a limit of a requirement file."""
        maximum, minimum = (None, value) if self.is_lower_limit else (value, None)
        return Limit(self.quantity, maximum, minimum, self.omega_deg, self.cycles_per_px)


@lru_cache(maxsize=1024)
def named(name: str) -> MeritName:
    """Parse a merit name.

    Raises
    ------
    InvalidParameter
        If the name is not a merit of trials.

    Examples
    --------
    >>> named("mtf at 0.25 cycles/px, at 90 deg").cycles_per_px
    0.25
    """
    result = WORDS.fullmatch(name) if isinstance(name, str) else None
    if result is None:
        raise _unknown(name)
    try:
        cycles, at, low, high = (
            None if part is None else float(part) for part in result.group(3, 4, 5, 6)
        )
    except ValueError:
        raise _unknown(name) from None
    part = (
        (at, at)
        if at is not None
        else (low, high)
        if low is not None and high is not None
        else None
    )
    parsed = MeritName(
        result["quantity"], result["least"] is not None, part, cycles, result["after"] or "none"
    )
    _check(parsed, name)
    return parsed


def _check(merit: MeritName, name: str) -> None:
    plain = merit.omega_deg is None and merit.cycles_per_px is None
    if name in merit_names() and merit.quantity not in UNLIMITED:
        return
    if merit.quantity in BUILT_QUANTITIES:
        is_calibrated = merit.after == "none" or (
            merit.quantity == STRAIGHTNESS and merit.after in CALIBRATIONS
        )
        if plain and is_calibrated and merit.is_lower_limit == (merit.quantity in LOWER_LIMITED):
            return
        right = MeritName(merit.quantity, merit.quantity in LOWER_LIMITED)
        raise InvalidParameter(
            f"{format_value(name)} is not a merit of trials; use {right.text!r}, for the whole image"
        )
    if merit.quantity not in LIMITABLE or merit.after != "none":
        raise _unknown(name)


def _unknown(name: object) -> InvalidParameter:
    plain = [each for each in merit_names() if " after " not in each and each not in UNLIMITED]
    built = [MeritName(quantity, quantity in LOWER_LIMITED).text for quantity in BUILT_QUANTITIES]
    calibrations = ", ".join(CALIBRATIONS[1:])
    return InvalidParameter(
        f"{format_value(name)} is not a merit of trials; use {', '.join(plain + built)}; motions, directions and "
        f"straightness with 'after' and one of {calibrations}, for example 'motion_px after affine'; and quantities of "
        "requirement files, for example 'total_blur_px, 20 to 100 deg' or 'min resolution_px_per_deg'"
    )


def is_requirement_merit(name: str) -> bool:
    """Return whether a merit is evaluated only if a limit requires it.

    >>> is_requirement_merit("motion_px after pose"), is_requirement_merit("total_blur_px")
    (False, True)
    """
    return name not in merit_names()


def select_requirement_merits(names: Iterable[str]) -> tuple[str, ...]:
    """Return the merits that are evaluated only if a limit requires them."""
    return tuple(name for name in dict.fromkeys(names) if is_requirement_merit(name))


def is_lower_limit(name: str) -> bool:
    """Return whether limits of a merit are lower limits.

    >>> is_lower_limit("min field_to_deg")
    True
    """
    return name.startswith(MIN_PREFIX)


def check_limit(name: str, value: float) -> None:
    """Raise an error for an unknown merit or a limit that cannot be satisfied."""
    merit = named(name)
    if merit.quantity in LIMITABLE and is_requirement_merit(name):
        merit.limit(value)
    elif not value > 0:
        raise InvalidParameter(
            f"the {'lower' if merit.is_lower_limit else 'upper'} limit of {name} must be positive; got {value:g}"
        )


def merit_limits(limit: Limit) -> dict[str, float]:
    """Convert a limit of a requirement file to limits of merits, one per side.

    >>> import omnimirror as om
    >>> merit_limits(om.Limit("aspect", at_least=0.8, at_most=1.2))
    {'aspect': 1.2, 'min aspect': 0.8}
    """
    sides = ((False, limit.at_most), (True, limit.at_least))
    return {
        MeritName(limit.quantity, is_lower_limit, limit.omega_deg, limit.cycles_per_px).text: value
        for is_lower_limit, value in sides
        if value is not None
    }


CHUNK = 256  # trials per batch, for cache locality


class MeritRows(NamedTuple):
    """Values from which a merit is computed."""

    takes: Literal["largest", "smallest", "spread", "ratio", "departure", "length"]
    """Reduction: maximum, minimum, range, minimum over maximum, maximum of absolute values, or
    length."""
    values: Array
    """Values (t, k)."""

    def merit(self) -> Array:
        """Compute the merits (t,).

        >>> MeritRows("ratio", np.array([[2.0, 4.0]])).merit()
        array([0.5])
        """
        low, high = self.values.min(axis=-1), self.values.max(axis=-1)
        match self.takes:
            case "largest":
                return np.asarray(high)
            case "smallest":
                return np.asarray(low)
            case "spread":
                return np.asarray(high - low)
            case "ratio":
                return np.asarray(low / high)
            case "departure":
                return np.asarray(np.maximum(high, -low))
        return np.asarray(np.linalg.norm(self.values, axis=-1))


@dataclass(frozen=True)
class RequiredMerits:
    """Evaluator of merits that limits require.

    Attributes
    ----------
    names
        Names of the merits, in column order.
    field
        Objects of all trials and circles at the limits of field ranges.
    refocus
        Refocusing mode.
    lines
        Straight lines for straightness.
    viewpoint : (3,)
        Nominal viewpoint.
    """

    names: tuple[str, ...]
    field: Field
    refocus: Refocus
    lines: StraightLines | None
    viewpoint: Array

    @classmethod
    def of(
        cls,
        names: tuple[str, ...],
        field: Field,
        refocus: Refocus,
        distance_mm: float,
        floor_px2: float,
    ) -> RequiredMerits:
        """Create the evaluator for the objects of a field."""
        merits = [named(name) for name in names]
        for merit in merits:
            if merit.quantity.endswith(PER_PIXEL) and np.isinf(distance_mm):
                raise InvalidParameter(
                    f"a limit of {merit.quantity} requires a finite object distance; specify object_distance_mm in "
                    "[objects] of the tolerance file or in [field] of the requirement file"
                )
        objects = _with_parts(field, merits, distance_mm)
        lines = None
        if any(merit.quantity == STRAIGHTNESS for merit in merits):
            lines = StraightLines.of(field, refocus, distance_mm, floor_px2)
        blank = cls(names, objects, refocus, lines, np.zeros(3))
        with np.errstate(all="ignore"):  # axial rays
            viewpoint = blank._view({"imager.pitch_ppm": np.zeros(1)})[0].viewpoint[0]
        return cls(names, objects, refocus, lines, viewpoint)

    def evaluate(self, values: Values, motions: Motions) -> tuple[Array, NDArray[np.intp]]:
        """Compute merits (t, e) and the number of lost objects (t,) of trials; NaN if rays are
        lost.
        """
        trials = len(next(iter(values.values())))
        parts = [slice(k, k + CHUNK) for k in range(0, trials, CHUNK)]
        both = [
            self._of_some({name: of[part] for name, of in values.items()}, motions)
            for part in parts
        ]
        return np.concatenate([merits for merits, _ in both]), np.concatenate(
            [lost_count for _, lost_count in both]
        )

    def _of_some(self, values: Values, motions: Motions) -> tuple[Array, NDArray[np.intp]]:
        rows, lost_count = self.rows(values, motions)
        merits = np.stack([one.merit() for one in rows.values()], axis=-1)
        lost_count = np.maximum(lost_count, np.isnan(merits).any(axis=1))
        merits[lost_count > 0] = np.nan
        return merits, lost_count

    def rows(
        self, values: Values, motions: Motions
    ) -> tuple[dict[str, MeritRows], NDArray[np.intp]]:
        """Return the values of each merit and the number of lost objects (t,)."""
        with np.errstate(all="ignore"):  # NaN for lost rays
            view, rim = self._view(values)
            departures = (
                None
                if self.lines is None
                else self.lines.departures(motions(self.lines.reference, values))
            )
            whole = partial(_sensor_values, self.field.sensor, values)
            rows = {
                name: whole(name)
                if named(name).quantity in OF_THE_WHOLE
                else self._rows(named(name), view, rim, departures)
                for name in self.names
            }
            return rows, view.lost

    def _rows(
        self,
        merit: MeritName,
        view: TrialView,
        rim: Callable[[], RimView],
        departures: Array | None,
    ) -> MeritRows:
        if merit.quantity == STRAIGHTNESS:
            assert departures is not None, "straightness requires departures of lines"
            residuals = departures[CALIBRATIONS.index(merit.after)]
            return MeritRows("departure", residuals.reshape(len(residuals), -1))
        if merit.quantity == "rim_reach_px":
            return MeritRows("largest", rim().reach_px)
        if merit.quantity == "field_to_deg":
            return MeritRows("smallest", rim().field_to_deg)
        if merit.quantity in BUILT_QUANTITIES:
            return MeritRows("length", view.viewpoint - self.viewpoint)
        of = merit.limit(1.0).of
        part = np.flatnonzero(is_within(self.field.omega_deg, merit.omega_deg))
        values = view.values._replace(**_select_objects(view, part))
        if of.takes in ("spread", "ratio"):
            return MeritRows(of.takes, of.parts(values)[0])
        return MeritRows("smallest" if merit.is_lower_limit else "largest", of.values(values))

    def _view(self, values: Values) -> tuple[TrialView, Callable[[], RimView]]:
        """Evaluate the objects, and provide the rims on demand."""
        sensor = self.field.sensor
        if is_vectorised(sensor, values):
            view, vergence = vectorised_views(self.field, values, self.refocus)
            return view, lambda: vectorised_rims(sensor, values, vergence)
        view, focus_mm = sequential_views(self.field, values, self.refocus)
        return view, lambda: sequential_rims(sensor, values, focus_mm)


def _sensor_values(sensor: Sensor, values: Values, name: str) -> MeritRows:
    """Evaluate a quantity of each aligned as-built sensor as a whole."""
    quantity, result = named(name).quantity, []
    for k in range(len(next(iter(values.values())))):
        try:
            built = perturbed(
                sensor, {error: float(of[k]) for error, of in values.items()}
            ).aligned()
            result.append(float(OF_THE_WHOLE[quantity](built)))
        except OmnimirrorError:
            result.append(np.nan)
    return MeritRows("largest", np.array(result)[:, None])


def is_within(omega_deg: Array, part: tuple[float, float] | None) -> NDArray[np.bool_]:
    """Return a mask of field angles within a range."""
    low, high = part or (-np.inf, np.inf)
    inside: NDArray[np.bool_] = (omega_deg >= low - 1e-9) & (omega_deg <= high + 1e-9)
    return inside


def _select_objects(view: TrialView, part: NDArray[np.intp]) -> dict[str, Array]:
    """Select values of some objects."""
    return {
        name: a if a.shape[-1] == 1 else a[..., part] for name, a in view.values._asdict().items()
    }


def _with_parts(field: Field, merits: list[MeritName], distance_mm: float) -> Field:
    """Add circles of objects at the ends of field ranges, limited to the field."""
    low, high = float(field.omega_deg.min()), float(field.omega_deg.max())
    edges: set[float] = set()
    for merit in merits:
        if merit.quantity in LIMITABLE and merit.omega_deg is not None:
            begin, end = max(merit.omega_deg[0], low), min(merit.omega_deg[1], high)
            if begin > end:
                raise InvalidParameter(
                    f"the range of {merit.text!r} must overlap the evaluated field, {low:.4g} to {high:.4g} deg"
                )
            edges |= {begin, end}
    more = sorted(edges - set(field.omega_deg.tolist()) - {0.0})
    if not more:
        return field
    around = np.unique(field.azimuth_deg)
    omega = np.append(field.omega_deg, np.repeat(more, len(around)))
    return field_at(
        field.sensor, omega, np.append(field.azimuth_deg, np.tile(around, len(more))), distance_mm
    )
