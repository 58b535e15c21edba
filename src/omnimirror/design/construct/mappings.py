"""Mirrors for a required mapping, given by name, function or table."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import InvalidParameter
from ...optics.mirrors import Conformal, CylinderMapping, Mirror, TabulatedMapping
from ...optics.mirrors.generated import MAPPINGS
from ...optics.mirrors.generated.base import Mapped
from .rim import MountedMirror, RimRay

OF_FIELD = ("omega_max_deg", "theta_max_deg", "rim_radius_mm")


def generated_mirror(
    mapping: str | Callable[[NDArray[np.float64]], ArrayLike],
    rim: RimRay,
    omega_min_deg: float = 0.0,
    **entries: object,
) -> MountedMirror:
    """Return the mirror with an exact mapping, and its lens distance.

    Parameters
    ----------
    mapping
        Key of :data:`MAPPINGS`, or a function of field angles (n,) in radians that returns image
        heights in any unit, 0 at ``omega_min_deg``.
    omega_min_deg
        Field angle at the image centre; values above 0 give a pointed mirror.
    entries
        Additional parameters of the mapping: ``plane_distance_mm`` of a ground plane,
        ``cylinder_radius_mm`` of a cylinder, ``omega_deg`` and ``height`` of a table.

    Raises
    ------
    InvalidParameter
        Unknown mapping, missing or inapplicable entry, or field beyond the range of the mapping.

    Examples
    --------
    The mirror of the conformal mapping is a hyperboloid, a conic:

    >>> mounted = generated_mirror("conformal", RimRay(135.0, 12.0, 1.0))
    >>> mounted.mirror.KIND, round(mounted.distance_mm, 11)
    ('hyperboloid', 3.55007544592)
    >>> import numpy as np
    >>> mounted = generated_mirror(lambda omega: np.sin(omega / 2), RimRay(135.0, 12.0, 1.0))  # equiareal
    >>> round(mounted.distance_mm, 9)
    4.072351768
    """
    if callable(mapping):
        made = TabulatedMapping.from_function(
            mapping, rim.omega_max_deg, rim.theta_max_deg, rim.rim_radius_mm, omega_min_deg
        )
        return MountedMirror(made, made.design_distance)
    mirror = mapped_mirror(mapping, rim, omega_min_deg, **entries)
    if isinstance(mirror, Conformal):
        return MountedMirror(mirror.surface, mirror.design_distance)
    return MountedMirror(mirror, mirror.design_distance)


def mapped_mirror(mapping: str, rim: RimRay, omega_min_deg: float = 0.0, **entries: object) -> Mapped:
    """Return the mirror of a named mapping, which converts image heights to field angles; arguments
    as :func:`generated_mirror`.
    """
    if mapping not in MAPPINGS:
        raise InvalidParameter(f"mapping = {mapping!r} is not known; valid are {', '.join(MAPPINGS)}")
    cls = MAPPINGS[mapping]
    given = {name: getattr(rim, name) for name in OF_FIELD if name in cls.PARAMETERS} | entries
    if omega_min_deg > 0 and cls is not TabulatedMapping:
        given["omega_min_deg"] = omega_min_deg
    check_entries(mapping, given)
    mirror: Mapped = cls(**given)
    if isinstance(mirror, TabulatedMapping) and abs(mirror.omega_deg[-1] - rim.omega_max_deg) > 1e-9:
        raise InvalidParameter(
            f"the table ends at {mirror.omega_deg[-1]:g} deg and the field at omega_max_deg = {rim.omega_max_deg:g}; "
            "they must agree"
        )
    return mirror


def check_entries(mapping: str, given: Collection[str]) -> None:
    """Check the entries of a mapping for inapplicable and missing ones.

    Raises
    ------
    InvalidParameter
        Inapplicable or missing entry, with its name.
    """
    cls = MAPPINGS[mapping]
    taken = (*cls.PARAMETERS, "omega_min_deg") if cls is TabulatedMapping else cls.PARAMETERS  # start of its table
    if wrong := [name for name in given if name not in taken]:
        raise InvalidParameter(f"{wrong[0]} does not apply to the {mapping} mapping{_instead(wrong[0])}")
    if missing := [name for name in _needed(cls) if name not in (*given, *OF_FIELD)]:
        raise InvalidParameter(f"the {mapping} mapping needs {' and '.join(missing)}")


def _needed(cls: type[Mirror]) -> list[str]:
    """Return the parameters without a default."""
    return [name for name in cls.PARAMETERS if name != "omega_min_deg" or cls is CylinderMapping]


def _instead(name: str) -> str:
    """Return advice on an inapplicable entry of a mapping."""
    if name != "omega_min_deg":
        return f"; it belongs to {' and '.join(kind for kind, cls in MAPPINGS.items() if name in cls.PARAMETERS)}"
    pointed = [kind for kind, cls in MAPPINGS.items() if name in cls.PARAMETERS]
    return f", which begins on the axis; a pointed mirror can be had for {', '.join(pointed)}"
