"""Sensor design from requirements: mappings, families, fits, optimisation and verification."""

from ..optics.mirrors.generated import MAPPINGS
from .construct.families import FAMILIES
from .construct.fits import FitForm, FittedMirror, fit_mirror
from .construct.mappings import generated_mirror
from .construct.rim import MountedMirror, RimRay
from .criteria.like import requirements_like
from .criteria.limits import Limit, Limitable, register_quantity
from .criteria.requirement_file import format_requirements, load_requirements, parse_requirements
from .criteria.requirements import (
    FieldRequirements,
    LensRequirements,
    MirrorRequirements,
    PartsRequirements,
    Requirements,
)
from .optimise.lower_bound import BlurBound, blur_bound
from .optimise.optimiser import Optimum
from .parts.bought import BoughtDesign
from .parts.search import PartsSearch, design_from_parts
from .solve.designer import Design, SearchOptions, design_sensor
from .solve.front import Front, load_front, pareto
from .solve.verdict import Judgement, Verdict, judge

__all__ = [
    "FAMILIES",
    "MAPPINGS",
    "BlurBound",
    "BoughtDesign",
    "Design",
    "FieldRequirements",
    "FitForm",
    "FittedMirror",
    "Front",
    "Judgement",
    "LensRequirements",
    "Limit",
    "Limitable",
    "MirrorRequirements",
    "MountedMirror",
    "Optimum",
    "PartsRequirements",
    "PartsSearch",
    "Requirements",
    "RimRay",
    "SearchOptions",
    "Verdict",
    "blur_bound",
    "design_from_parts",
    "design_sensor",
    "fit_mirror",
    "format_requirements",
    "generated_mirror",
    "judge",
    "load_front",
    "load_requirements",
    "pareto",
    "parse_requirements",
    "register_quantity",
    "requirements_like",
]
