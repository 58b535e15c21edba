"""Evaluation of trials by the compiled kernel or in NumPy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.native import backend
from ...base.typing import Array
from ...optics.sensor import Sensor
from ...optics.tracing.reflection import REFLECTION_TOLERANCE, RIM_SLACK
from .compensation import (
    LOST,
    MERITS,
    ROUNDS,
    Reference,
    evaluate_numpy,
    fit_compensators,
    merit_names,
)
from .perturbed_states import States, Values, is_vectorised, states_of
from .requirement_merits import RequiredMerits
from .trial_images import CLOSE, HALVINGS, REFOCUS, STEPS, Refocus, field_of

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


CHUNK = 256  # trials per batch in NumPy, for cache locality
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
