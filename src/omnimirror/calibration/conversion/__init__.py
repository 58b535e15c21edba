"""Conversion of camera models between the file formats of different programs."""

from .converter import DISTANCES_MM, Conversion, convert
from .fitting import Cost
from .flipping import flipped

__all__ = ["DISTANCES_MM", "Conversion", "Cost", "convert", "flipped"]
