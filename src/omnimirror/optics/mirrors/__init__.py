"""Mirrors: sag, slope and curvature of one meridian. One class per shape, one registry."""

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from ...base.arguments import InvalidType, format_value
from ...base.errors import InvalidParameter
from ...base.registry import Registry
from .mappings import (
    MAPPINGS,
    Conformal,
    CylinderMapping,
    Equiangular,
    Equiareal,
    Equidistant,
    GroundPlane,
    Rectifying,
    TabulatedMapping,
    UnitAspect,
)
from .mirror import (
    RIM_RADIUS,
    Cone,
    ConicAsphere,
    Ellipsoid,
    EvenPolynomial,
    Flat,
    Hyperboloid,
    Mirror,
    Paraboloid,
    Secondary,
    Sphere,
)
from .splines import SampledProfile, SlopeSpline

M = TypeVar("M", bound=Mirror)


def _check(name: str, cls: Any) -> None:
    """Check that an object is a mirror class with this kind."""
    if not (isinstance(cls, type) and issubclass(cls, Mirror)):
        raise InvalidType(
            f"a mirror class must be derived from omnimirror.optics.mirrors.Mirror; got {format_value(cls)}"
        )
    dataclass_parameters = vars(cls).get("__dataclass_params__")
    if dataclass_parameters is None or not dataclass_parameters.frozen:
        raise InvalidParameter(f"{cls.__name__} must be a frozen dataclass of its parameters")
    if (kind := getattr(cls, "KIND", None)) != name:
        raise InvalidParameter(
            f"{cls.__name__}.KIND must be {name!r}, its registered name; got {format_value(kind)}"
        )
    names = [f.name for f in fields(cls)]  # type: ignore[arg-type]  # subclasses are dataclasses
    if list(getattr(cls, "PARAMETERS", {})) != names or "rim_radius_mm" not in names:
        raise InvalidParameter(
            f"{cls.__name__}.PARAMETERS must describe the fields {', '.join(names)} in "
            "their order, including rim_radius_mm"
        )


SHAPES: tuple[type[Mirror], ...] = (
    Sphere,
    Hyperboloid,
    Paraboloid,
    Ellipsoid,
    Cone,
    EvenPolynomial,
    ConicAsphere,
    SampledProfile,
    SlopeSpline,
)

MIRRORS: Registry[type[Mirror]] = Registry(
    "omnimirror.mirrors", "a mirror", {cls.KIND: cls for cls in SHAPES} | MAPPINGS, _check
)
"""Mirror classes by their name in sensor files. Add a class to this list, or from another package
by :func:`register_mirror` or an entry point."""

# Bundled first: a name missing in MIRRORS would be searched among the entry points of all packages
SECONDARIES: Mapping[str, type[Mirror]] = ChainMap({Flat.KIND: Flat}, MIRRORS)  # type: ignore[arg-type]  # only read
"""Mirrors that may be secondaries: a flat mirror, and all registered ones."""


def register_mirror(cls: type[M]) -> type[M]:
    """Register a custom mirror class by its ``KIND``.

    The mirror is then available in sensor files, evaluation, design, exports and the studio. An
    installed package registers it without a call, by an entry point in its ``pyproject.toml``:
    ``[project.entry-points."omnimirror.mirrors"]`` with ``bowl = "my_package:Bowl"``.

    Parameters
    ----------
    cls
        Frozen dataclass derived from :class:`omnimirror.optics.mirrors.Mirror`, with ``KIND``,
        ``PARAMETERS`` and ``profile(x_mm)``, which returns sag (mm), slope (1) and curvature
        (1/mm), each of the shape of x. :func:`omnimirror.optics.testing.check_mirror` checks the
        contract.

    Returns
    -------
    type
        The class itself, for use as a decorator.

    Raises
    ------
    InvalidParameter
        If another mirror has this kind, or the class does not describe its parameters.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> from dataclasses import dataclass
    >>> from typing import ClassVar
    >>> from omnimirror.optics.mirrors import RIM_RADIUS, Mirror
    >>> from omnimirror.base.parameters import Parameter
    >>> @om.register_mirror
    ... @dataclass(frozen=True)
    ... class Bowl(Mirror):
    ...     '''z = depth (x / rim)^4, flat at its vertex.'''
    ...
    ...     depth_mm: float
    ...     rim_radius_mm: float
    ...     KIND: ClassVar[str] = "docs-bowl"
    ...     PARAMETERS: ClassVar[dict[str, Parameter]] = {
    ...         "depth_mm": Parameter("mm", 0.1, 1e3, "height of the rim above the vertex"),
    ...         "rim_radius_mm": RIM_RADIUS,
    ...     }
    ...     def profile(self, x_mm):
    ...         u = np.asarray(x_mm, dtype=float) / self.rim_radius_mm
    ...         return self.depth_mm * u**4, 4 * self.depth_mm / self.rim_radius_mm * u**3, (
    ...             12 * self.depth_mm / self.rim_radius_mm**2 * u**2)
    >>> sensor = om.load_sensor("paper-spherical")
    >>> bowl = om.Sensor(Bowl(20.0, 40.0), sensor.lens, sensor.imager, mirror_distance_mm=180.0)
    >>> print(f"{bowl.field_deg[1]:.1f} deg")
    138.2 deg
    >>> MIRRORS.withdraw("docs-bowl")
    """
    MIRRORS.register(getattr(cls, "KIND", ""), cls)
    return cls


__all__ = [
    "MIRRORS",
    "RIM_RADIUS",
    "SECONDARIES",
    "Cone",
    "Conformal",
    "ConicAsphere",
    "CylinderMapping",
    "Ellipsoid",
    "Equiangular",
    "Equiareal",
    "Equidistant",
    "EvenPolynomial",
    "Flat",
    "GroundPlane",
    "Hyperboloid",
    "Mirror",
    "Paraboloid",
    "Rectifying",
    "SampledProfile",
    "Secondary",
    "SlopeSpline",
    "Sphere",
    "TabulatedMapping",
    "UnitAspect",
    "register_mirror",
]
