"""Sensor design from requirements: mappings, families, fits, optimisation and verification."""

from ..optics.mirrors.mappings import MAPPINGS
from ._blur_bound import BlurBound, blur_bound
from .designer import Design, SearchOptions, design_sensor
from .limits import Limit, Limitable, register_quantity
from .mirror_construction import FAMILIES, MountedMirror, RimRay, generated_mirror
from .mirror_fits import FitForm, FittedMirror, fit_mirror
from .off_the_shelf import PartsDesign, PartsSearch, design_from_parts
from .optimiser import Optimum
from .pareto_front import Front, load_front, pareto
from .requirement_check import RequirementCheck, Verdict, check_requirements
from .requirement_files import (
    format_requirements,
    load_requirements,
    parse_requirements,
    requirements_like,
)
from .requirements import (
    FieldRequirements,
    LensRequirements,
    MirrorRequirements,
    PartsRequirements,
    Requirements,
)

__all__ = [
    "FAMILIES",
    "MAPPINGS",
    "BlurBound",
    "Design",
    "FieldRequirements",
    "FitForm",
    "FittedMirror",
    "Front",
    "LensRequirements",
    "Limit",
    "Limitable",
    "MirrorRequirements",
    "MountedMirror",
    "Optimum",
    "PartsDesign",
    "PartsRequirements",
    "PartsSearch",
    "RequirementCheck",
    "Requirements",
    "RimRay",
    "SearchOptions",
    "Verdict",
    "blur_bound",
    "check_requirements",
    "design_from_parts",
    "design_sensor",
    "fit_mirror",
    "format_requirements",
    "generated_mirror",
    "load_front",
    "load_requirements",
    "pareto",
    "parse_requirements",
    "register_quantity",
    "requirements_like",
]
