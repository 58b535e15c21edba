"""From requirements to a mirror: mappings, families, fits, and what they cost."""

from .families import FAMILIES
from .fits import Fit, FitForm, fit_mirror
from .mappings import MAPPINGS, generated_mirror
from .placed import PlacedMirror, Rim

__all__ = ["FAMILIES", "MAPPINGS", "Fit", "FitForm", "PlacedMirror", "Rim", "fit_mirror", "generated_mirror"]
