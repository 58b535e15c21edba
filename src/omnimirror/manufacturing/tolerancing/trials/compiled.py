"""The compiled way to judge trials: arrays packed as native/src/tolerance has them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....native import backend
from ....tracing.reflection import REFLECTS, RIM_SLACK
from .compensation import ROUNDS
from .merits import MERITS, Reference
from .picture import HALVINGS, REFOCUS
from .tracing import CLOSE, STEPS, States

Array = NDArray[np.float64]

TERMS = (0, 4, 8, 16)
"""How many coefficients of a polynomial kernels are compiled for; others are filled up with 0."""
POWERS = (1, 15, 28, 91)
"""How many powers of a form."""


def can_judge(states: States) -> bool:
    """Whether there is a kernel for these sensors."""
    return backend.is_compiled and states.surfaces.polynomial.shape[1] <= TERMS[-1]


def judged(reference: Reference, states: States) -> tuple[Array, Array]:
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
