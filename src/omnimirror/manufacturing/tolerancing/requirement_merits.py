"""Names of what a built sensor is held to: merits of its trials, and what requirements limit in their own words.

A name is what a table shows and what ``--merit`` takes: ``motion_px after pose``, ``total_blur_px, 20 to 100 deg``,
``mtf at 0.25 cycles/px``. What is to be at least so much begins with ``least``: ``least resolution_px_per_deg``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import shown
from ...design.criteria.limits import LIMITABLE, Limit, told_part
from ...design.criteria.merits import OF_THE_WHOLE
from ...errors import InvalidParameter, OmnimirrorError
from ...sensor import Sensor
from .compensation import CALIBRATIONS, after, merit_names
from .object_field import Field, field_at
from .perturbation import perturbed
from .perturbed_states import Values, are_traced_together
from .requirement_values import (
    BuiltView,
    Motions,
    RimView,
    StraightLines,
    rims_one_by_one,
    rims_together,
    views_one_by_one,
    views_together,
)
from .trial_images import Refocus

Array = NDArray[np.float64]

LEAST = "least "
STRAIGHTNESS = "straightness_deg"
OF_BUILT = (STRAIGHTNESS, "viewpoint_shift_mm", "rim_reach_px", "field_to_deg")
"""Quantities that sensors without errors have no limits of."""
OF_LEAST = ("field_to_deg",)
UNLIMITED = ("focus_distance_mm", "lost_rays")
NUMBER = r"([-+.\deE]+)"
WORDS = re.compile(
    rf"(?P<least>{LEAST})?(?P<quantity>\w+)(?: at {NUMBER} cycles/px)?(?:, (?:at {NUMBER}|{NUMBER} to {NUMBER}) deg)?"
    r"(?: after (?P<after>[-\w]+))?"
)


@dataclass(frozen=True)
class MeritName:
    """A name, taken apart.

    Attributes
    ----------
    quantity
        Of the vocabulary.
    is_least
        Whether the least counts and not the largest.
    omega_deg
        Part of the field, deg; all of it without.
    cycles_per_px
        Spatial frequency of an MTF.
    after
        What a calibration leaves, of motions, directions and straightness.
    """

    quantity: str
    is_least: bool = False
    omega_deg: tuple[float, float] | None = None
    cycles_per_px: float | None = None
    after: str = "none"

    @property
    def text(self) -> str:
        """The name.

        >>> MeritName("resolution_px_per_deg", True, (20.0, 100.0)).text
        'least resolution_px_per_deg, 20 to 100 deg'
        """
        frequency = "" if self.cycles_per_px is None else f" at {self.cycles_per_px:g} cycles/px"
        words = f"{LEAST if self.is_least else ''}{self.quantity}{frequency}{told_part(self.omega_deg)}"
        return after(words, self.after)  # type: ignore[arg-type]  # a word that is no calibration is refused

    def limit(self, value: float) -> Limit:
        """As requirements have it."""
        most, least = (None, value) if self.is_least else (value, None)
        return Limit(self.quantity, most, least, self.omega_deg, self.cycles_per_px)


@lru_cache(maxsize=1024)
def named(name: str) -> MeritName:
    """A name, taken apart.

    Raises
    ------
    InvalidParameter
        It is the name of nothing that sensors are judged by.

    >>> named("mtf at 0.25 cycles/px, at 90 deg").cycles_per_px
    0.25
    """
    found = WORDS.fullmatch(name) if isinstance(name, str) else None
    if found is None:
        raise _unknown(name)
    try:
        cycles, at, low, high = (None if part is None else float(part) for part in found.group(3, 4, 5, 6))
    except ValueError:
        raise _unknown(name) from None
    part = (at, at) if at is not None else (low, high) if low is not None and high is not None else None
    parsed = MeritName(found["quantity"], found["least"] is not None, part, cycles, found["after"] or "none")
    _check(parsed, name)
    return parsed


def _check(merit: MeritName, name: str) -> None:
    plain = merit.omega_deg is None and merit.cycles_per_px is None
    if name in merit_names() and merit.quantity not in UNLIMITED:
        return
    if merit.quantity in OF_BUILT:
        is_calibrated = merit.after == "none" or (merit.quantity == STRAIGHTNESS and merit.after in CALIBRATIONS)
        if plain and is_calibrated and merit.is_least == (merit.quantity in OF_LEAST):
            return
        right = MeritName(merit.quantity, merit.quantity in OF_LEAST)
        raise InvalidParameter(f"{shown(name)} is not judged; {right.text!r} is, of the whole picture")
    if merit.quantity not in LIMITABLE or merit.after != "none":
        raise _unknown(name)


def _unknown(name: object) -> InvalidParameter:
    plain = [each for each in merit_names() if " after " not in each and each not in UNLIMITED]
    built = [MeritName(quantity, quantity in OF_LEAST).text for quantity in OF_BUILT]
    calibrations = ", ".join(CALIBRATIONS[1:])
    return InvalidParameter(
        f"{shown(name)} is nothing that trials are judged by; valid are {', '.join(plain + built)}; motions, "
        f"directions and straightness with 'after' and one of {calibrations}, as in 'motion_px after affine'; and what "
        "requirements limit, as in 'total_blur_px, 20 to 100 deg' or 'least resolution_px_per_deg'"
    )


def is_required(name: str) -> bool:
    """Whether a merit is worked out only where it is asked for.

    >>> is_required("motion_px after pose"), is_required("total_blur_px")
    (False, True)
    """
    return name not in merit_names()


def required_of(names: Iterable[str]) -> tuple[str, ...]:
    """Those of some merits that are worked out only where they are asked for."""
    return tuple(name for name in dict.fromkeys(names) if is_required(name))


def is_least(name: str) -> bool:
    """Whether a limit of it is one from below.

    >>> is_least("least field_to_deg")
    True
    """
    return name.startswith(LEAST)


def check_limit(name: str, value: float) -> None:
    """Refuse a limit of nothing, or one that nothing meets."""
    merit = named(name)
    if merit.quantity in LIMITABLE and is_required(name):
        merit.limit(value)
    elif not value > 0:
        raise InvalidParameter(
            f"the limit {name} {'at least' if merit.is_least else 'at most'} {value:g} is valid above 0"
        )


def names_of(limit: Limit) -> dict[str, float]:
    """A limit of requirements as limits of merits, a side each.

    >>> import omnimirror as om
    >>> names_of(om.Limit("aspect", at_least=0.8, at_most=1.2))
    {'aspect': 1.2, 'least aspect': 0.8}
    """
    sides = ((False, limit.at_most), (True, limit.at_least))
    return {
        MeritName(limit.quantity, is_least, limit.omega_deg, limit.cycles_per_px).text: value
        for is_least, value in sides
        if value is not None
    }


CHUNK = 256  # trials at a time: their arrays stay in the cache


class MeritRows(NamedTuple):
    """What a merit is made of."""

    takes: Literal["largest", "smallest", "spread", "ratio", "departure", "length"]
    """What of it: the largest less the smallest, the smallest over the largest; the largest whatever its sign; the
    length of a vector."""
    values: Array
    """(t, k)"""

    def merit(self) -> Array:
        """(t,)

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
    """What is worked out of trials because limits ask for it.

    Attributes
    ----------
    names
        Of the merits, in the order of their columns.
    field
        Objects: those that all trials are judged by, and circles where parts of the field begin and end.
    refocus
        Whether each trial is focused.
    lines
        Straight lines, where straightness is asked for.
    viewpoint : (3,)
        Of a sensor without errors.
    """

    names: tuple[str, ...]
    field: Field
    refocus: Refocus
    lines: StraightLines | None
    viewpoint: Array

    @classmethod
    def of(
        cls, names: tuple[str, ...], field: Field, refocus: Refocus, distance_mm: float, floor_px2: float
    ) -> RequiredMerits:
        """Of a sensor whose trials are judged by a field."""
        merits = [named(name) for name in names]
        objects = _with_parts(field, merits, distance_mm)
        lines = None
        if any(merit.quantity == STRAIGHTNESS for merit in merits):
            lines = StraightLines.of(field, refocus, distance_mm, floor_px2)
        blank = cls(names, objects, refocus, lines, np.zeros(3))
        with np.errstate(all="ignore"):  # what looks along the axis
            viewpoint = blank._view({"imager.pitch_ppm": np.zeros(1)})[0].viewpoint[0]
        return cls(names, objects, refocus, lines, viewpoint)

    def judged(self, values: Values, motions: Motions) -> tuple[Array, NDArray[np.intp]]:
        """Merits (t, e) of trials, and how many objects (t,) each loses, or whether its rim; NaN where it does."""
        trials = len(next(iter(values.values())))
        parts = [slice(k, k + CHUNK) for k in range(0, trials, CHUNK)]
        both = [self._of_some({name: of[part] for name, of in values.items()}, motions) for part in parts]
        return np.concatenate([merits for merits, _ in both]), np.concatenate([lost for _, lost in both])

    def _of_some(self, values: Values, motions: Motions) -> tuple[Array, NDArray[np.intp]]:
        rows, lost = self.rows(values, motions)
        merits = np.stack([one.merit() for one in rows.values()], axis=-1)
        lost = np.maximum(lost, np.isnan(merits).any(axis=1))
        merits[lost > 0] = np.nan
        return merits, lost

    def rows(self, values: Values, motions: Motions) -> tuple[dict[str, MeritRows], NDArray[np.intp]]:
        """What merits are the largest or least of, by their names, and how many objects (t,) are lost."""
        with np.errstate(all="ignore"):  # what is lost is not a number
            view, rim = self._view(values)
            departures = None if self.lines is None else self.lines.departures(motions(self.lines.reference, values))
            whole = partial(_whole, self.field.sensor, values)
            rows = {
                name: whole(name) if named(name).quantity in OF_THE_WHOLE
                else self._rows(named(name), view, rim, departures)
                for name in self.names
            }  # fmt: skip
            return rows, view.lost

    def _rows(
        self, merit: MeritName, view: BuiltView, rim: Callable[[], RimView], departures: Array | None
    ) -> MeritRows:
        if merit.quantity == STRAIGHTNESS:
            assert departures is not None, "lines are there where it is asked for"
            left = departures[CALIBRATIONS.index(merit.after)]
            return MeritRows("departure", left.reshape(len(left), -1))
        if merit.quantity == "rim_reach_px":
            return MeritRows("largest", rim().reach_px)
        if merit.quantity == "field_to_deg":
            return MeritRows("smallest", rim().field_to_deg)
        if merit.quantity in OF_BUILT:
            return MeritRows("length", view.viewpoint - self.viewpoint)
        of = merit.limit(1.0).of
        part = np.flatnonzero(is_within(self.field.omega_deg, merit.omega_deg))
        values = view.values._replace(**_of_part(view, part))
        if of.takes in ("spread", "ratio"):
            return MeritRows(of.takes, of.parts(values)[0])
        return MeritRows("smallest" if merit.is_least else "largest", of.values(values))

    def _view(self, values: Values) -> tuple[BuiltView, Callable[[], RimView]]:
        """What trials do to the objects, and their rims, which not all limits ask for."""
        sensor = self.field.sensor
        if are_traced_together(sensor, values):
            view, vergence = views_together(self.field, values, self.refocus)
            return view, lambda: rims_together(sensor, values, vergence)
        view, focus_mm = views_one_by_one(self.field, values, self.refocus)
        return view, lambda: rims_one_by_one(sensor, values, focus_mm)


def _whole(sensor: Sensor, values: Values, name: str) -> MeritRows:
    """What holds for the whole of each sensor, one by one, with its mirror in its place on the axis."""
    quantity, found = named(name).quantity, []
    for k in range(len(next(iter(values.values())))):
        try:
            built = perturbed(sensor, {error: float(of[k]) for error, of in values.items()}).aligned()
            found.append(float(OF_THE_WHOLE[quantity](built)))
        except OmnimirrorError:
            found.append(np.nan)
    return MeritRows("largest", np.array(found)[:, None])


def is_within(omega_deg: Array, part: tuple[float, float] | None) -> NDArray[np.bool_]:
    """Which field angles belong to a part of the field."""
    low, high = part or (-np.inf, np.inf)
    inside: NDArray[np.bool_] = (omega_deg >= low - 1e-9) & (omega_deg <= high + 1e-9)
    return inside


def _of_part(view: BuiltView, part: NDArray[np.intp]) -> dict[str, Array]:
    """Arrays of what is looked at, of some of the objects."""
    return {name: a if a.shape[-1] == 1 else a[..., part] for name, a in view.values._asdict().items()}


def _with_parts(field: Field, merits: list[MeritName], distance_mm: float) -> Field:
    """The field with circles where the parts that limits name begin and end, as far as it goes."""
    low, high = float(field.omega_deg.min()), float(field.omega_deg.max())
    edges: set[float] = set()
    for merit in merits:
        if merit.quantity in LIMITABLE and merit.omega_deg is not None:
            begin, end = max(merit.omega_deg[0], low), min(merit.omega_deg[1], high)
            if begin > end:
                raise InvalidParameter(
                    f"{merit.text}: sensors are judged from {low:.4g} to {high:.4g} deg; name a part of that"
                )
            edges |= {begin, end}
    more = sorted(edges - set(field.omega_deg.tolist()) - {0.0})
    if not more:
        return field
    around = np.unique(field.azimuth_deg)
    omega = np.append(field.omega_deg, np.repeat(more, len(around)))
    return field_at(field.sensor, omega, np.append(field.azimuth_deg, np.tile(around, len(more))), distance_mm)
