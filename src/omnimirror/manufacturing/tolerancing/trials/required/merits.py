"""Merits of requirements: what of a view of built sensors is limited, as one number of each trial."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .....design.criteria.limits import LIMITABLE
from .....design.criteria.merits import OF_THE_WHOLE
from .....errors import InvalidParameter, OmnimirrorError
from .....sensor import Sensor
from ...errors import perturbed
from ..compensation import CALIBRATIONS
from ..field import Field, field_at
from ..picture import Refocus
from ..states import Values, are_traced_together
from .names import OF_BUILT, STRAIGHTNESS, MeritName, named
from .one_by_one import views_one_by_one
from .rim import RimView, rims_one_by_one, rims_together
from .straightness import Motions, StraightLines
from .values import BuiltView, views_together

Array = NDArray[np.float64]

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
