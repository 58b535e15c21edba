"""Omnidirectional mirror sensors: evaluated, simulated, and their pictures straightened.

The public names below are imported when first used, so that ``import omnimirror`` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .analysis import best_focus as best_focus
    from .analysis import best_viewpoint as best_viewpoint
    from .analysis import evaluate as evaluate
    from .sensor import Sensor as Sensor
    from .specs import load_sensor as load_sensor
    from .specs import save_sensor as save_sensor

__version__ = "0.1.0"

_HOMES = {
    "best_focus": "analysis",
    "best_viewpoint": "analysis",
    "evaluate": "analysis",
    "Sensor": "sensor",
    "load_sensor": "specs",
    "save_sensor": "specs",
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
