"""Who judges trials: the compiled kernel, or NumPy where there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....native import backend
from ....sensor import Sensor
from . import compiled
from . import merits as merits_in_numpy
from .compensation import compensators_of
from .field import field_of
from .merits import LOST, Reference
from .picture import Refocus
from .states import Values, are_traced_together, states_of

if TYPE_CHECKING:
    from .required.merits import RequiredMerits

Array = NDArray[np.float64]

CHUNK = 256  # trials at a time in NumPy: their arrays stay in the cache
COMPILED_CHUNK = 2048


@dataclass(frozen=True)
class Judge(Reference):
    """Judges trials of a sensor.

    Attributes
    ----------
    required
        What is worked out besides, because limits ask for it.

    Examples
    --------
    How far a decentre of .1 mm moves the picture, and what a calibration of the mirror's pose leaves of it:

    >>> import omnimirror as om
    >>> judge = Judge.of(om.load_sensor("paper-spherical"))
    >>> merits = judge.judged({"mirror.decentre_x_mm": np.array([0.1])})
    >>> worst = dict(zip(merits_in_numpy.merit_names(), merits[0], strict=True))
    >>> float(worst["motion_px"].round(2)), float(worst["motion_px after pose"].round(4))
    (1.15, 0.0)
    """

    required: RequiredMerits | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the merits, in the order of their columns."""
        names = merits_in_numpy.merit_names()
        return names if self.required is None else (*names[:-1], *self.required.names, LOST)

    @classmethod
    def of(cls, sensor: Sensor, refocus: Refocus = "none", required: tuple[str, ...] = (), **field: Any) -> Judge:
        """Of a sensor, with merits that limits ask for; further arguments are those of :func:`field_of`."""
        objects = field_of(sensor, **field)
        airy_px = sensor.lens.airy_diameter() / sensor.imager.pitch_mm
        reference = objects.shown({}, 1, refocus=refocus)[0].offsets_px[0]
        floor = 1 + airy_px**2
        distance = field.get("object_distance_mm", np.inf)
        judge = cls(objects, compensators_of(objects), reference, refocus, floor)
        if not required:
            return judge
        from .required.merits import RequiredMerits  # brings all of design with it, which most trials do not need

        return replace(judge, required=RequiredMerits.of(required, objects, refocus, distance, floor))

    def judged(self, values: Values) -> Array:
        """Merits (t, m) of trials, in the order of their names; NaN, but for their number, where rays are lost.

        Parameters
        ----------
        values
            Of errors, by name: (t,).

        Returns
        -------
        (t, m) array
            Merits.
        """
        return self.judged_with_motions(values)[0]

    def judged_with_motions(self, values: Values) -> tuple[Array, Array]:
        """Merits (t, m) and motions (t, 2 n) px of all objects, x and then y; NaN where rays are lost.

        Parameters
        ----------
        values
            Of errors, by name: (t,).

        Returns
        -------
        tuple of arrays
            Merits and motions.
        """
        merits, moved = _judged(self, values)
        if self.required is None:
            return merits, moved
        more, lost = self.required.judged(values, motions_of)
        whole = np.concatenate([merits[:, :-1], more, np.maximum(merits[:, -1:], lost[:, None])], axis=1)
        whole[whole[:, -1] > 0, :-1] = moved[whole[:, -1] > 0] = np.nan
        return whole, moved


def motions_of(reference: Reference, values: Values) -> Array:
    """Motions (t, 2 n) px of the objects of a reference; NaN where rays are lost."""
    return _judged(reference, values)[1]


def _judged(reference: Reference, values: Values) -> tuple[Array, Array]:
    count = len(next(iter(values.values())))
    chunk = COMPILED_CHUNK if backend.is_compiled else CHUNK
    parts = [slice(k, k + chunk) for k in range(0, count, chunk)]
    both = [_judged_at_once(reference, {name: of[part] for name, of in values.items()}) for part in parts]
    return np.concatenate([merits for merits, _ in both]), np.concatenate([moved for _, moved in both])


def _judged_at_once(reference: Reference, values: Values) -> tuple[Array, Array]:
    sensor = reference.field.sensor
    if backend.is_compiled and are_traced_together(sensor, values):
        states = states_of(sensor, values)
        if compiled.can_judge(states):
            return compiled.judged(reference, states)
    return merits_in_numpy.judged(reference, values)
