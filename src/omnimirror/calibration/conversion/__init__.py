"""From one program's camera file to another's."""

from .converter import DISTANCES_MM, Conversion, convert
from .fitting import Cost
from .flipping import flipped

__all__ = ["DISTANCES_MM", "Conversion", "Cost", "convert", "flipped"]
