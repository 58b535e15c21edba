"""Slider metadata of the bench, from the parameter descriptions of the parts."""

from __future__ import annotations

import dataclasses
import types
import typing
from functools import cache
from typing import Any

from ....base import quantities
from ....base.parameters import Parameter
from ....base.quantities import Quantity
from ....design.criteria.limits import LIMITABLE
from ....design.criteria.merits import DESIGN_MERITS
from ....optics.batch.bases import FREE_FORMS
from ....optics.image_sensor import Imager
from ....optics.lenses import LENSES
from ....optics.mirrors import MIRRORS, SECONDARIES, Secondary
from ....optics.mirrors.pose import MirrorPose
from ....optics.sensor_files import bundled_sensors
from .messages import BenchStart, ParameterOf, PartOf, QuantityOf

DISTANCE = Parameter("mm", 1e-3, 1e7, "from the lens's principal point to the mirror's vertex (m)")


@cache
def bench_start() -> BenchStart:
    """Return all parts with their parameters, and the quantities available for requirements.

    Examples
    --------
    >>> sphere = next(part for part in bench_start().mirrors if part.kind == "sphere")
    >>> [(p.name, p.unit) for p in sphere.parameters]
    [('radius_mm', 'mm'), ('rim_radius_mm', 'mm')]
    """
    distance = _parameter("mirror_distance_mm", DISTANCE, float, dataclasses.MISSING)
    mirrors = dict(MIRRORS.items())  # without mirrors of other packages that fail to load
    return BenchStart(
        mirrors=tuple(part_of(kind, cls) for kind, cls in mirrors.items()),
        secondaries=tuple(
            part_of(kind, SECONDARIES[kind]) for kind in SECONDARIES if kind in mirrors or kind not in MIRRORS
        ),
        lenses=tuple(part_of(kind, cls) for kind, cls in LENSES.items()),
        imager=part_of("imager", Imager),
        place=part_of("place", Secondary),
        mount=PartOf(kind="mount", parameters=(distance,)),
        pose=part_of("mirror_pose", MirrorPose),
        columns=tuple(map(_quantity, quantities.PER_ANGLE)),
        quantities=tuple(_quantity(limitable.quantity) for limitable in LIMITABLE.values()),
        of_frequency=tuple(name for name, limitable in LIMITABLE.items() if limitable.of_frequency is not None),
        merits=tuple(_quantity(merit.quantity) for merit in DESIGN_MERITS.values()),
        shapes=tuple(FREE_FORMS),
        sensors=tuple(bundled_sensors()),
    )


def _quantity(q: Quantity) -> QuantityOf:
    return QuantityOf(name=q.name, symbol=q.symbol, unit=q.unit, title=q.title, meaning=q.meaning, equation=q.equation)


def part_of(kind: str, cls: type[Any]) -> PartOf:
    """Describe a part from the metadata of its class."""
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls)}
    parameters: dict[str, Parameter] = cls.PARAMETERS
    found = [_parameter(name, p, hints[name], fields[name].default) for name, p in parameters.items()]
    return PartOf(kind=kind, parameters=tuple(found))


def _parameter(name: str, p: Parameter, hint: Any, default: Any) -> ParameterOf:
    inner = typing.get_args(hint)[0] if isinstance(hint, types.UnionType) else hint
    return ParameterOf(
        name=name,
        unit=p.unit,
        low=p.low,
        high=p.high,
        description=p.description,
        choices=p.choices,
        is_list=typing.get_origin(inner) is tuple,
        is_whole=inner is int,
        is_optional=default is not dataclasses.MISSING,
        default=float(default) if isinstance(default, int | float) else None,
    )
