"""From requirements to a mirror: mappings, families, fits, and what they cost."""

from .designing import Design, design_sensor
from .families import FAMILIES
from .fits import Fit, FitForm, fit_mirror
from .mappings import MAPPINGS, generated_mirror
from .placed import PlacedMirror, Rim
from .requirements import Requirements, load_requirements, parse_requirements

__all__ = [
    "FAMILIES",
    "MAPPINGS",
    "Design",
    "Fit",
    "FitForm",
    "PlacedMirror",
    "Requirements",
    "Rim",
    "design_sensor",
    "fit_mirror",
    "generated_mirror",
    "load_requirements",
    "parse_requirements",
]
