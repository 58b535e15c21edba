"""Omnidirectional mirror sensors: evaluated, simulated, and their pictures straightened.

The public names below are imported when first used, so that ``import omnimirror`` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .analysis import best_focus as best_focus
    from .analysis import best_viewpoint as best_viewpoint
    from .analysis import check_blur as check_blur
    from .analysis import compare as compare
    from .analysis import evaluate as evaluate
    from .analysis import illumination as illumination
    from .analysis import mtf as mtf
    from .analysis import psf as psf
    from .analysis import spots as spots
    from .central import MirrorBall as MirrorBall
    from .central import OCam as OCam
    from .central import load_ocam as load_ocam
    from .design import DesignProblem as DesignProblem
    from .design import FieldRequirements as FieldRequirements
    from .design import Front as Front
    from .design import LensRequirements as LensRequirements
    from .design import Limit as Limit
    from .design import MirrorRequirements as MirrorRequirements
    from .design import Optimum as Optimum
    from .design import Requirements as Requirements
    from .design import blur_bound as blur_bound
    from .design import design_sensor as design_sensor
    from .design import format_requirements as format_requirements
    from .design import load_front as load_front
    from .design import load_requirements as load_requirements
    from .design import pareto as pareto
    from .design.optimise.optimiser import optimise as optimise
    from .dewarp import Dewarper as Dewarper
    from .dewarp import screens as screens
    from .dewarp import views as views
    from .dewarp.views import register_view as register_view
    from .manufacture import export as export
    from .manufacture import register_format as register_format
    from .media import read_image as read_image
    from .media import write_image as write_image
    from .mirrors import register_mirror as register_mirror
    from .sensor import Sensor as Sensor
    from .simulate import Environment as Environment
    from .simulate import Room as Room
    from .simulate import estimate_noise as estimate_noise
    from .simulate import expose as expose
    from .simulate import merge_bracket as merge_bracket
    from .simulate import plan_bracket as plan_bracket
    from .simulate import restore as restore
    from .simulate import take_picture as take_picture
    from .specs import load_sensor as load_sensor
    from .specs import save_sensor as save_sensor
    from .straighten import Recording as Recording
    from .straighten import Restoration as Restoration
    from .straighten import dewarp_pictures as dewarp_pictures
    from .straighten.video import dewarp_video as dewarp_video

__version__ = "0.1.0"

_HOMES = {
    "Dewarper": "dewarp",
    "DesignProblem": "design",
    "FieldRequirements": "design",
    "Front": "design",
    "LensRequirements": "design",
    "Limit": "design",
    "MirrorRequirements": "design",
    "Optimum": "design",
    "Requirements": "design",
    "blur_bound": "design",
    "design_sensor": "design",
    "format_requirements": "design",
    "load_front": "design",
    "load_requirements": "design",
    "optimise": "design.optimise.optimiser",
    "pareto": "design",
    "MirrorBall": "central",
    "OCam": "central",
    "load_ocam": "central",
    "read_image": "media",
    "screens": "dewarp",
    "views": "dewarp",
    "write_image": "media",
    "best_focus": "analysis",
    "best_viewpoint": "analysis",
    "compare": "analysis",
    "evaluate": "analysis",
    "export": "manufacture",
    "register_format": "manufacture",
    "register_view": "dewarp.views",
    "check_blur": "analysis",
    "illumination": "analysis",
    "mtf": "analysis",
    "psf": "analysis",
    "spots": "analysis",
    "register_mirror": "mirrors",
    "Sensor": "sensor",
    "Environment": "simulate",
    "Room": "simulate",
    "estimate_noise": "simulate",
    "expose": "simulate",
    "merge_bracket": "simulate",
    "plan_bracket": "simulate",
    "restore": "simulate",
    "take_picture": "simulate",
    "load_sensor": "specs",
    "save_sensor": "specs",
    "Recording": "straighten",
    "Restoration": "straighten",
    "dewarp_pictures": "straighten",
    "dewarp_video": "straighten.video",
}
__all__ = ["__version__", *_HOMES]


if not TYPE_CHECKING:  # a checker knows the names above, and should refuse all others

    def __getattr__(name: str) -> Any:
        if name in _HOMES:
            return getattr(import_module(f".{_HOMES[name]}", __name__), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
