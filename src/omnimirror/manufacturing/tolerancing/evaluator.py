"""The compiled way to judge trials: arrays packed as native/src/tolerance has them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...native import backend
from ...sensor import Sensor
from ...tracing.reflection import REFLECTS, RIM_SLACK
from .compensation import LOST, MERITS, ROUNDS, Reference, compensators_of, evaluate_numpy, merit_names
from .object_field import field_of
from .perturbed_states import Values, are_traced_together, states_of
from .requirement_merits import RequiredMerits
from .trial_images import CLOSE, HALVINGS, REFOCUS, STEPS, Refocus, States

Array = NDArray[np.float64]

TERMS = (0, 4, 8, 16)
"""How many coefficients of a polynomial kernels are compiled for; others are filled up with 0."""
POWERS = (1, 15, 28, 91)
"""How many powers of a form."""


def can_judge(states: States) -> bool:
    """Whether there is a kernel for these sensors."""
    return backend.is_compiled and states.surfaces.polynomial.shape[1] <= TERMS[-1]


def evaluate_compiled(reference: Reference, states: States) -> tuple[Array, Array]:
    """Merits (t, m) of trials, and motions (t, 2 n) px, as in NumPy."""
    field, c = reference.field, reference.compensators
    numbers, terms = packed(states)
    merits = np.empty((len(states), MERITS))
    moved = np.full((len(states), 2 * len(field)), np.nan)
    table = states.surfaces.table
    pieces = (np.zeros((0, 6)), 1.0) if table is None else (table.pieces, table.step_mm)
    area = np.abs(np.linalg.det(field.px_per_deg))
    deg_per_px = np.linalg.inv(field.px_per_deg).reshape(-1, 4)
    rows = tuple(np.ascontiguousarray(part) for part in (c.affine, c.basis, c.straight, c.bent, c.radial))
    objects = (field.targets, field.start, reference.reference_px, deg_per_px, area)
    backend.kernels.judge_trials(
        numbers,
        terms,
        bool(states.surfaces.curvature.any()),
        states.surfaces.rim_radius_mm,
        pieces,
        (*(np.ascontiguousarray(part) for part in objects), field.distant),
        (*rows, ROUNDS),
        (STEPS, CLOSE, REFLECTS, RIM_SLACK, HALVINGS),
        REFOCUS.index(reference.refocus),
        reference.floor_px2,
        merits,
        moved,
    )
    merits[:, -2] += states.focal_mm - states.breathing_mm  # from the principal point, not from the pupil
    return merits, moved


def packed(states: States) -> tuple[Array, int]:
    """All numbers of trials (t, n) in the order of ``TrialNumber``, and how many terms the polynomials have."""
    surfaces, count = states.surfaces, len(states)
    pupil = np.einsum("tji,tj->ti", states.rotation, states.pupil - states.shift)
    singles = (surfaces.curvature, surfaces.conic, states.aperture_mm, states.vergence, states.breathing_mm)
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
    """Columns (t, n), and as many of 0 as the next size has more."""
    wanted = next(size for size in sizes if size >= columns.shape[1])
    return np.pad(columns, ((0, 0), (0, wanted - columns.shape[1])))


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
    >>> worst = dict(zip(merit_names(), merits[0], strict=True))
    >>> float(worst["motion_px"].round(2)), float(worst["motion_px after pose"].round(4))
    (1.15, 0.0)
    """

    required: RequiredMerits | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the merits, in the order of their columns."""
        names = merit_names()
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
        if can_judge(states):
            return evaluate_compiled(reference, states)
    return evaluate_numpy(reference, values)
