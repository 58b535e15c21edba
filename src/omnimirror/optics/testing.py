"""Contract checks of mirror classes, for the tests of this and other packages."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from ..base.arguments import instance
from ..base.errors import OmnimirrorError
from ..base.table_models import table_model
from ..base.typing import Array
from .mirrors import MIRRORS, Mirror

__all__ = ["MIRROR_CHECKS", "check_mirror"]


# -- Contract of mirror classes --------------------------------------------------------------------

SHARES = np.array([0.13, 0.31, 0.52, 0.77, 0.93])
"""Positions of derivative checks, relative to the rim radius."""
STEP = 1e-3
"""Finite-difference step, relative to the rim radius."""
DIFFERENCE = 1e-6
"""Tolerance between fourth-order differences and derivatives, relative to the largest value."""


def check_mirror(mirror: Mirror) -> None:
    """Check the mirror contract, required by tracing, evaluation, sensor files and exports.

    Sag, slope and curvature are consistent derivatives (fourth-order differences, tolerance 1e-6);
    the vertex is the origin; parameters are described and out-of-range values rejected; ``repr``
    and pickling are reversible.

    Parameters
    ----------
    mirror
        Instance of the class to check.

    Raises
    ------
    AssertionError
        If a check fails; the message names the location.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Sphere
    >>> check_mirror(Sphere(50.0, 40.0))
    """
    instance("mirror", mirror, Mirror, "a mirror")
    for check in MIRROR_CHECKS:
        check(mirror)


def check_profile_components(mirror: Mirror) -> None:
    """Check that ``sag``, ``slope`` and ``curvature`` equal ``profile`` and have the shape of x."""
    for x in (
        np.linspace(0, mirror.rim_radius_mm, 11),
        np.full((2, 3), 0.4 * mirror.rim_radius_mm),
    ):
        for name, part in zip(("sag", "slope", "curvature"), mirror.profile(x), strict=True):
            value = np.asarray(getattr(mirror, name)(x))
            assert np.shape(part) == x.shape, (
                f"{name} of x with shape {x.shape} has shape {np.shape(part)}"
            )
            assert np.array_equal(np.asarray(part), value), f"{name} differs from that of profile"


def check_derivatives(mirror: Mirror) -> None:
    """Check that ``slope`` is the derivative of ``sag``, and ``curvature`` that of ``slope``."""
    x, h = SHARES * mirror.rim_radius_mm, STEP * mirror.rim_radius_mm
    for name, function, derivative in (
        ("slope", mirror.sag, mirror.slope(x)),
        ("curvature", mirror.slope, mirror.curvature(x)),
    ):
        difference = (
            8 * (function(x + h) - function(x - h)) - function(x + 2 * h) + function(x - 2 * h)
        ) / (12 * h)
        scale = np.abs(difference).max() + 1 / mirror.rim_radius_mm
        error = np.abs(derivative - difference) / scale
        largest_error = int(error.argmax())
        assert error[largest_error] < DIFFERENCE, (
            f"{name} at x = {x[largest_error]:g} mm is {derivative[largest_error]:.9g}, but its integral changes by "
            f"{difference[largest_error]:.9g}"
        )


def check_vertex(mirror: Mirror) -> None:
    """Check that the sag of the vertex is 0, and its slope too for a mirror without an apex."""
    assert abs(float(mirror.sag(0.0))) < 1e-13, (
        f"the vertex must be at z = 0; got {float(mirror.sag(0.0)):g} mm"
    )
    slope = float(mirror.slope(0.0))
    assert mirror.is_pointed == (slope != 0.0), (
        f"is_pointed is {mirror.is_pointed}, but the vertex has slope {slope:g}"
    )


def check_radii(mirror: Mirror) -> None:
    """Check R_s (Eq. 18) against the normal, and the radii at a smooth apex."""
    x = SHARES * mirror.rim_radius_mm
    slope: Array = mirror.slope(x)
    normal = np.where(
        slope == 0, np.inf, np.hypot(x, np.divide(x, slope, where=slope != 0, out=np.zeros_like(x)))
    )
    length = np.abs(np.asarray(mirror.radius_s(x)))
    assert np.allclose(length[slope != 0], normal[slope != 0], rtol=1e-12), (
        "radius_s differs from the length of the normal"
    )
    if not mirror.is_pointed:
        apex = float(mirror.radius_s(0.0)), float(mirror.radius_t(0.0))
        assert np.isclose(*apex, rtol=1e-12), f"the radii at the apex must be equal; got {apex}"


def check_bounds(mirror: Mirror) -> None:
    """Check that ``bounds`` extend from the vertex to the rim."""
    (x0, x1), (z0, z1) = mirror.bounds
    z = np.asarray(mirror.sag(np.linspace(0, mirror.rim_radius_mm, 513)))
    assert (x0, x1) == (0.0, mirror.rim_radius_mm), (
        f"bounds must extend from x = 0 to the rim; got {x0:g} mm to {x1:g} mm"
    )
    assert abs(z0 - z.min()) < 1e-12, (
        f"bounds must start at z = {z.min():g} mm, as the meridian; got {z0:g} mm"
    )
    assert abs(z1 - z.max()) < 1e-12, (
        f"bounds must end at z = {z.max():g} mm, as the meridian; got {z1:g} mm"
    )


def check_serialisation(mirror: Mirror) -> None:
    """Check equality and hash after ``eval(repr(...))`` and after pickling."""
    classes = {cls.__name__: cls for cls in MIRRORS.values()} | {
        type(mirror).__name__: type(mirror)
    }
    copy = eval(repr(mirror), classes)
    assert copy == mirror, f"eval(repr(mirror)) must equal the mirror; got {copy!r} from {mirror!r}"
    assert hash(copy) == hash(mirror), (
        f"equal mirrors must have equal hashes; those of {mirror!r} differ"
    )
    unpickled = pickle.loads(pickle.dumps(mirror))
    assert unpickled == mirror, (
        f"an unpickled mirror must equal the original; got {unpickled!r} from {mirror!r}"
    )


def check_parameter_descriptions(mirror: Mirror) -> None:
    """Check that ``PARAMETERS`` describes unit and range of each field, in their order."""
    names = [f.name for f in fields(mirror)]  # type: ignore[arg-type]  # subclasses are dataclasses
    assert list(mirror.PARAMETERS) == names, (
        f"PARAMETERS must describe the fields {names}; got {list(mirror.PARAMETERS)}"
    )
    for name, p in mirror.PARAMETERS.items():
        assert p.description, f"{name} must have a description"
        assert p.choices or p.low < p.high, f"{name} must have a non-empty range"
        assert name.endswith(("_mm", "_deg")) == (p.unit in ("mm", "deg")), (
            f"{name} must end with its unit"
        )
    entries = set(table_model(type(mirror)).model_fields)
    assert entries == set(names), (
        f"the entries of a sensor file must be the fields {names}; got {sorted(entries)}"
    )


def check_parameter_ranges(mirror: Mirror) -> None:
    """Check that a parameter out of range, or NaN, raises an error that names it."""
    for name, p in mirror.PARAMETERS.items():
        if p.choices or name in ("x_mm", "z_mm"):  # columns of points are rejected as a whole
            continue
        is_many = isinstance(getattr(mirror, name), tuple)
        for number in (p.high * 1.01 + 1, np.nan):
            message = _refusal(mirror, **{name: (number,) if is_many else number})
            assert message is not None, f"{name} = {number:g} must be rejected"
            assert name in message, (
                f"the error for {name} = {number:g} must contain the name; got: {message}"
            )


def _refusal(mirror: Mirror, **change: object) -> str | None:
    """Return the error message of a changed mirror; None without an error."""
    try:
        replace(mirror, **change)  # type: ignore[type-var]  # all implementations are dataclasses
    except OmnimirrorError as e:
        return str(e)
    return None


MIRROR_CHECKS: tuple[Callable[[Mirror], None], ...] = (
    check_profile_components,
    check_derivatives,
    check_vertex,
    check_radii,
    check_bounds,
    check_serialisation,
    check_parameter_descriptions,
    check_parameter_ranges,
)
"""Individual checks of :func:`check_mirror`."""
