"""Who judges trials: the compiled kernel, or NumPy where there is none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...native import backend
from ...sensor import Sensor
from . import compiled
from . import merits as merits_in_numpy
from .compensation import compensators_of
from .field import field_of
from .merits import Reference
from .picture import Refocus
from .states import Values, are_traced_together, states_of

Array = NDArray[np.float64]

CHUNK = 256  # trials at a time in NumPy: their arrays stay in the cache
COMPILED_CHUNK = 2048


class Judge(Reference):
    """Judges trials of a sensor.

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

    @classmethod
    def of(cls, sensor: Sensor, refocus: Refocus = "none", **field: object) -> Judge:
        """Of a sensor; further arguments are those of :func:`field_of`."""
        objects = field_of(sensor, **field)  # type: ignore[arg-type]  # passed on
        airy_px = sensor.lens.airy_diameter() / sensor.imager.pitch_mm
        reference = objects.shown({}, 1, refocus=refocus)[0].offsets_px[0]
        return cls(objects, compensators_of(objects), reference, refocus, 1 + airy_px**2)

    def judged(self, values: Values) -> Array:
        """Merits (t, m) of trials, in the order of :func:`merit_names`; NaN, but for their number, where rays are lost.

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
        count = len(next(iter(values.values())))
        chunk = COMPILED_CHUNK if backend.is_compiled else CHUNK
        parts = [slice(k, k + chunk) for k in range(0, count, chunk)]
        both = [self._of_some({name: of[part] for name, of in values.items()}) for part in parts]
        return np.concatenate([merits for merits, _ in both]), np.concatenate([moved for _, moved in both])

    def _of_some(self, values: Values) -> tuple[Array, Array]:
        if backend.is_compiled and are_traced_together(self.field.sensor, values):
            states = states_of(self.field.sensor, values)
            if compiled.can_judge(states):
                return compiled.judged(self, states)
        return merits_in_numpy.judged(self, values)
