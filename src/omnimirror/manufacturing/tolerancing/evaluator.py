"""Merits of trials: their names, limits and evaluation by the compiled kernel or in NumPy.

Merits are image motion, blur and the quantities of requirement files.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import format_value
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.native import backend
from ...base.quantities import format_part
from ...base.typing import Array
from ...design.limits import LIMITABLE, Limit
from ...design.merits import OF_THE_WHOLE
from ...optics.sensor import Sensor
from ...optics.tracing.reflection import REFLECTION_TOLERANCE, RIM_SLACK
from .compensation import (
    CALIBRATIONS,
    LOST,
    MERITS,
    ROUNDS,
    Reference,
    after,
    evaluate_numpy,
    fit_compensators,
    merit_names,
)
from .perturbed_states import States, Values, is_vectorised, states_of
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
from .tolerances import perturbed
from .trial_images import CLOSE, HALVINGS, REFOCUS, STEPS, Field, Refocus, field_at, field_of

# -- Merits that limits require --------------------------------------------------------------------
#
# Examples of names in tables and of ``--merit``: ``motion_px after pose``,
# ``total_blur_px, 20 to 100 deg``, ``mtf at 0.25 cycles/px``. Merits with a lower limit have the prefix
# ``min``: ``min resolution_px_per_deg``.

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


CHUNK = 256  # trials per batch in NumPy, for cache locality


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


# -- Evaluation of trials --------------------------------------------------------------------------

TERMS = (0, 4, 8, 16)
"""Supported numbers of polynomial coefficients; arrays are padded with 0."""
POWERS = (1, 15, 28, 91)
"""Supported numbers of form coefficients."""


def has_kernel(states: States) -> bool:
    """Return whether the compiled kernel supports these sensors."""
    return backend.is_compiled and states.surfaces.polynomial.shape[1] <= TERMS[-1]


def evaluate_compiled(reference: Reference, states: States) -> tuple[Array, Array]:
    """Compute merits (t, m) and motions (t, 2 n) in px of trials with the compiled kernel."""
    field, c = reference.field, reference.compensators
    numbers, terms = packed(states)
    merits = np.empty((len(states), MERITS))
    displaced = np.full((len(states), 2 * len(field)), np.nan)
    table = states.surfaces.table
    pieces = (np.zeros((0, 6)), 1.0) if table is None else (table.pieces, table.step_mm)
    area = np.abs(np.linalg.det(field.px_per_deg))
    deg_per_px = np.linalg.inv(field.px_per_deg).reshape(-1, 4)
    rows = tuple(
        np.ascontiguousarray(part) for part in (c.affine, c.basis, c.linear, c.quadratic, c.radial)
    )
    objects = (field.targets, field.start, reference.reference_px, deg_per_px, area)
    backend.kernels.evaluate_trials(
        numbers,
        terms,
        bool(states.surfaces.curvature.any()),
        states.surfaces.rim_radius_mm,
        pieces,
        (*(np.ascontiguousarray(part) for part in objects), field.distant),
        (*rows, ROUNDS),
        (STEPS, CLOSE, REFLECTION_TOLERANCE, RIM_SLACK, HALVINGS),
        REFOCUS.index(reference.refocus),
        reference.floor_px2,
        merits,
        displaced,
    )
    merits[:, -2] += (
        states.focal_mm - states.breathing_mm
    )  # relative to the principal point instead of the pupil
    return merits, displaced


def packed(states: States) -> tuple[Array, int]:
    """Pack trial parameters (t, n) in the order of ``TrialNumber``; also return the number of
    terms.
    """
    surfaces, count = states.surfaces, len(states)
    pupil = np.einsum("tji,tj->ti", states.rotation, states.pupil - states.shift)
    singles = (
        surfaces.curvature,
        surfaces.conic,
        states.aperture_mm,
        states.vergence,
        states.breathing_mm,
    )
    polynomial, form = _filled(surfaces.polynomial, TERMS), _filled(surfaces.form, POWERS)
    parts = (
        states.rotation.reshape(count, 9),
        states.shift,
        pupil,
        np.stack(singles, axis=-1),
        states.brown,
        states.imager.reshape(count, 9),
        states.focal_mm[:, None],
        polynomial,
        form,
    )
    return np.concatenate(parts, axis=1), polynomial.shape[1]


def _filled(columns: Array, sizes: tuple[int, ...]) -> Array:
    """Pad columns (t, n) with 0 to the next supported size."""
    target = next(size for size in sizes if size >= columns.shape[1])
    return np.pad(columns, ((0, 0), (0, target - columns.shape[1])))


COMPILED_CHUNK = 2048


@dataclass(frozen=True)
class TrialEvaluator(Reference):
    """Evaluator of trials of a sensor.

    Attributes
    ----------
    required
        Additional merits that limits require.

    Examples
    --------
    Image motion due to a decentre of 0.1 mm, and its residual after a pose calibration:

    >>> import omnimirror as om
    >>> from omnimirror.manufacturing.tolerancing.compensation import merit_names
    >>> evaluator = TrialEvaluator.of(om.load_sensor("paper-spherical"))
    >>> merits = evaluator.evaluate({"mirror.decentre_x_mm": np.array([0.1])})
    >>> worst = dict(zip(merit_names(), merits[0], strict=True))
    >>> float(worst["motion_px"].round(2)), float(worst["motion_px after pose"].round(4))
    (1.15, 0.0)
    """

    required: RequiredMerits | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the merits, in column order."""
        names = merit_names()
        return names if self.required is None else (*names[:-1], *self.required.names, LOST)

    @classmethod
    def of(
        cls, sensor: Sensor, refocus: Refocus = "none", required: tuple[str, ...] = (), **field: Any
    ) -> TrialEvaluator:
        """Create the evaluator of a sensor; further arguments are passed to :func:`field_of`."""
        objects = field_of(sensor, **field)
        airy_px = sensor.lens.airy_diameter() / sensor.imager.pitch_mm
        reference = objects.images_and_focus({}, 1, refocus=refocus)[0].offsets_px[0]
        floor = 1 + airy_px**2
        distance = field.get("object_distance_mm", np.inf)
        evaluator = cls(objects, fit_compensators(objects), reference, refocus, floor)
        if not required:
            return evaluator
        return replace(
            evaluator, required=RequiredMerits.of(required, objects, refocus, distance, floor)
        )

    def evaluate(self, values: Values) -> Array:
        """Compute the merits of trials.

        Parameters
        ----------
        values
            Errors (t,) by name.

        Returns
        -------
        (t, m) array
            Merits in the order of :attr:`names`; NaN except for the number of lost rays if rays are lost.
        """
        return self.evaluate_with_motions(values)[0]

    def evaluate_with_motions(self, values: Values) -> tuple[Array, Array]:
        """Compute merits of trials and image motions of all objects.

        Parameters
        ----------
        values
            Errors (t,) by name.

        Returns
        -------
        tuple of arrays
            Merits (t, m) and motions (t, 2 n) in px, x of all objects, then y; NaN if rays are lost.
        """
        merits, displaced = _evaluated(self, values)
        if self.required is None:
            return merits, displaced
        more, lost_count = self.required.evaluate(values, image_motions)
        whole = np.concatenate(
            [merits[:, :-1], more, np.maximum(merits[:, -1:], lost_count[:, None])], axis=1
        )
        whole[whole[:, -1] > 0, :-1] = displaced[whole[:, -1] > 0] = np.nan
        return whole, displaced


def image_motions(reference: Reference, values: Values) -> Array:
    """Return motions (t, 2 n) in px of the objects of a reference; NaN if rays are lost."""
    return _evaluated(reference, values)[1]


def _evaluated(reference: Reference, values: Values) -> tuple[Array, Array]:
    count = len(next(iter(values.values())))
    chunk = COMPILED_CHUNK if backend.is_compiled else CHUNK
    parts = [slice(k, k + chunk) for k in range(0, count, chunk)]
    both = [
        _evaluated_together(reference, {name: of[part] for name, of in values.items()})
        for part in parts
    ]
    return np.concatenate([merits for merits, _ in both]), np.concatenate(
        [displaced for _, displaced in both]
    )


def _evaluated_together(reference: Reference, values: Values) -> tuple[Array, Array]:
    sensor = reference.field.sensor
    if backend.is_compiled and is_vectorised(sensor, values):
        states = states_of(sensor, values)
        if has_kernel(states):
            return evaluate_compiled(reference, states)
    return evaluate_numpy(reference, values)
