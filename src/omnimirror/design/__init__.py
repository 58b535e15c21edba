"""From requirements to a mirror: mappings, families, fits, and what they cost."""

from .designing import Design, SearchOptions, design_sensor
from .families import FAMILIES
from .fits import Fit, FitForm, fit_mirror
from .lower_bound import BlurBound, blur_bound
from .mappings import MAPPINGS, generated_mirror
from .optimise import Optimum, optimise
from .pareto import Front, load_front, pareto
from .placed import PlacedMirror, Rim
from .problem import DesignProblem
from .quantities import Limit
from .requirements import Requirements, load_requirements, parse_requirements

__all__ = [
    "FAMILIES",
    "MAPPINGS",
    "BlurBound",
    "Design",
    "DesignProblem",
    "Fit",
    "FitForm",
    "Front",
    "Limit",
    "Optimum",
    "PlacedMirror",
    "Requirements",
    "Rim",
    "SearchOptions",
    "blur_bound",
    "design_sensor",
    "fit_mirror",
    "generated_mirror",
    "load_front",
    "load_requirements",
    "optimise",
    "pareto",
    "parse_requirements",
]
