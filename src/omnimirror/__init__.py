"""Omnidirectional mirror sensors: evaluated, simulated, and their pictures straightened.

The public names below are imported when first used, so that ``import omnimirror`` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .analysis.aperture.blur_check import check_blur as check_blur
    from .analysis.aperture.point_spread import psf as psf
    from .analysis.aperture.relative_illumination import illumination as illumination
    from .analysis.aperture.spot_diagrams import spots as spots
    from .analysis.aperture.transfer import mtf as mtf
    from .analysis.calibration import evaluate_camera as evaluate_camera
    from .analysis.comparison import compare as compare
    from .analysis.evaluation import evaluate as evaluate
    from .analysis.evaluation import field_angles as field_angles
    from .analysis.meridional.focus import best_focus as best_focus
    from .analysis.meridional.viewpoints import best_viewpoint as best_viewpoint
    from .analysis.temperature import at_temperature as at_temperature
    from .analysis.temperature import thermal_motion_px as thermal_motion_px
    from .analysis.wall_reflections import ghosts as ghosts
    from .analysis.wavelength import at_wavelength as at_wavelength
    from .calibrate.conversion import convert as convert
    from .calibrate.estimation import Calibration as Calibration
    from .calibrate.estimation import Motion as Motion
    from .calibrate.estimation import Prior as Prior
    from .calibrate.estimation import Sighting as Sighting
    from .calibrate.estimation import adjust as adjust
    from .calibrate.estimation import calibrate_camera as calibrate_camera
    from .calibrate.estimation import read_surveys as read_surveys
    from .calibrate.estimation import simulate_detections as simulate_detections
    from .calibrate.formats import register_camera_format as register_camera_format
    from .calibrate.lines import LineCalibration as LineCalibration
    from .calibrate.lines import calibrate_lines as calibrate_lines
    from .calibrate.lines import read_lines as read_lines
    from .calibrate.physical import SensorModel as SensorModel
    from .calibrate.physical import mirror_ball_model as mirror_ball_model
    from .calibrate.propagation import direction_uncertainty as direction_uncertainty
    from .calibrate.propagation import floor_uncertainty as floor_uncertainty
    from .calibrate.propagation import uncertainty_map as uncertainty_map
    from .calibrate.rim import FoundRim as FoundRim
    from .calibrate.rim import camera_from_rim as camera_from_rim
    from .calibrate.rim import find_rim as find_rim
    from .calibrate.rim import sensor_from_rim as sensor_from_rim
    from .calibrate.rim import sensors_from_rim as sensors_from_rim
    from .calibrate.targets import Board as Board
    from .calibrate.targets import Detection as Detection
    from .calibrate.targets import choose_frames as choose_frames
    from .calibrate.targets import draw_board as draw_board
    from .calibrate.targets import find_board as find_board
    from .calibrate.targets import find_boards as find_boards
    from .calibrate.targets import refine_corners as refine_corners
    from .calibrate.targets import write_board as write_board
    from .camera_models import DoubleSphere as DoubleSphere
    from .camera_models import EnhancedUnified as EnhancedUnified
    from .camera_models import KannalaBrandt as KannalaBrandt
    from .camera_models import MirrorBall as MirrorBall
    from .camera_models import OCam as OCam
    from .camera_models import RadialSpline as RadialSpline
    from .camera_models import RationalPinhole as RationalPinhole
    from .camera_models import ThinPrismFisheye as ThinPrismFisheye
    from .camera_models import Unified as Unified
    from .camera_models import ViewpointSpline as ViewpointSpline
    from .camera_models import load_ocam as load_ocam
    from .components.apertures import best_apertures as best_apertures
    from .components.catalogue import read_catalogue as read_catalogue
    from .components.selection import choose_parts as choose_parts
    from .components.template import sensor_template as sensor_template
    from .design import FieldRequirements as FieldRequirements
    from .design import Front as Front
    from .design import LensRequirements as LensRequirements
    from .design import Limit as Limit
    from .design import MirrorRequirements as MirrorRequirements
    from .design import Optimum as Optimum
    from .design import PartsRequirements as PartsRequirements
    from .design import Requirements as Requirements
    from .design import SearchOptions as SearchOptions
    from .design import blur_bound as blur_bound
    from .design import design_from_parts as design_from_parts
    from .design import design_sensor as design_sensor
    from .design import format_requirements as format_requirements
    from .design import judge as judge
    from .design import load_front as load_front
    from .design import load_requirements as load_requirements
    from .design import pareto as pareto
    from .design import register_quantity as register_quantity
    from .design import requirements_like as requirements_like
    from .design.construct.survey import mappings as mappings
    from .design.solve.temperatures import temperature_range as temperature_range
    from .dewarp import ColourDewarper as ColourDewarper
    from .dewarp import Dewarper as Dewarper
    from .dewarp import screens as screens
    from .dewarp import views as views
    from .dewarp.views import register_view as register_view
    from .errors import OmnimirrorError as OmnimirrorError
    from .interop.colmap import ColmapProject as ColmapProject
    from .interop.colmap import write_colmap as write_colmap
    from .interop.gateway.serving import serve_views as serve_views
    from .interop.named_views import NamedView as NamedView
    from .interop.named_views import load_views as load_views
    from .interop.ray_tables import RayTable as RayTable
    from .interop.ray_tables import ray_table as ray_table
    from .interop.ray_tables import write_rays as write_rays
    from .interop.ros_bags.dewarping import DewarpedBag as DewarpedBag
    from .interop.ros_bags.dewarping import dewarp_bag as dewarp_bag
    from .interop.view_maps import ViewMap as ViewMap
    from .interop.view_maps import view_map as view_map
    from .interop.view_maps import write_maps as write_maps
    from .manufacturing import Body as Body
    from .manufacturing import export as export
    from .manufacturing import register_format as register_format
    from .manufacturing.metrology.form_errors import FormError as FormError
    from .manufacturing.metrology.form_errors import form_error as form_error
    from .manufacturing.metrology.readers import read_points as read_points
    from .manufacturing.tolerancing.drawing_conflicts import tolerance_conflicts as tolerance_conflicts
    from .manufacturing.tolerancing.mirror_form import as_built as as_built
    from .manufacturing.tolerancing.mirror_form import form_effect as form_effect
    from .manufacturing.tolerancing.perturbation import perturbed as perturbed
    from .manufacturing.tolerancing.sweep import Sweep as Sweep
    from .manufacturing.tolerancing.tolerance_analysis import ToleranceReport as ToleranceReport
    from .manufacturing.tolerancing.tolerance_analysis import TypicalSensor as TypicalSensor
    from .manufacturing.tolerancing.tolerance_analysis import tolerance as tolerance
    from .manufacturing.tolerancing.tolerance_analysis import typical_sensors as typical_sensors
    from .manufacturing.tolerancing.tolerance_file import TolerancePlan as TolerancePlan
    from .manufacturing.tolerancing.tolerance_file import load_tolerances as load_tolerances
    from .manufacturing.tolerancing.tolerance_file import tolerance_template as tolerance_template
    from .manufacturing.tolerancing.tolerances import Tolerance as Tolerance
    from .manufacturing.tolerancing.tolerances import Tolerances as Tolerances
    from .media import read_image as read_image
    from .media import write_image as write_image
    from .mirrors import register_mirror as register_mirror
    from .report import write_demo as write_demo
    from .report.calibration import write_calibration_figures as write_calibration_figures
    from .report.calibration import write_calibration_report as write_calibration_report
    from .report.comparison import write_comparison as write_comparison
    from .report.tolerances import write_tolerances as write_tolerances
    from .reproduce import reproduce_paper as reproduce_paper
    from .sensor import Sensor as Sensor
    from .simulate.datasets.calibration_set import write_calibration_set as write_calibration_set
    from .simulate.datasets.calibration_set import write_video_set as write_video_set
    from .simulate.datasets.learning_set import write_learning_set as write_learning_set
    from .simulate.datasets.truth import ground_truth as ground_truth
    from .simulate.datasets.video import load_path as load_path
    from .simulate.datasets.video import write_video as write_video
    from .simulate.detector import Detector as Detector
    from .simulate.radiometry import Radiometry as Radiometry
    from .simulate.rendering.exposure import expose as expose
    from .simulate.rendering.picture import take_picture as take_picture
    from .simulate.restoration.bracketing import merge_bracket as merge_bracket
    from .simulate.restoration.bracketing import plan_bracket as plan_bracket
    from .simulate.restoration.noise import estimate_noise as estimate_noise
    from .simulate.restoration.sharpening import restore as restore
    from .simulate.round_trip import measure_round_trip as measure_round_trip
    from .simulate.scenes.environment import Environment as Environment
    from .simulate.scenes.posed import Pose as Pose
    from .simulate.scenes.posed import PosedScene as PosedScene
    from .simulate.scenes.sources import load_scene as load_scene
    from .simulate.scenes.worlds.bodies import MovingBox as MovingBox
    from .simulate.scenes.worlds.bodies import load_bodies as load_bodies
    from .simulate.scenes.worlds.hall import Hall as Hall
    from .simulate.scenes.worlds.room import Room as Room
    from .simulate.scenes.worlds.street import Street as Street
    from .specs import bundled_sensors as bundled_sensors
    from .specs import load_camera as load_camera
    from .specs import load_sensor as load_sensor
    from .specs import parse_camera as parse_camera
    from .specs import parse_sensor as parse_sensor
    from .specs import save_camera as save_camera
    from .specs import save_sensor as save_sensor
    from .straighten import Recording as Recording
    from .straighten.folders import dewarp_pictures as dewarp_pictures
    from .straighten.restoring import Restoration as Restoration
    from .straighten.video import dewarp_video as dewarp_video
    from .studio.notebook import LookAround as LookAround
    from .studio.notebook import show as show
    from .thermal import Thermal as Thermal

__version__ = "0.2.0"

_HOMES = {
    "best_focus": "analysis.meridional.focus",
    "best_viewpoint": "analysis.meridional.viewpoints",
    "temperature_range": "design.solve.temperatures",
    "at_temperature": "analysis.temperature",
    "at_wavelength": "analysis.wavelength",
    "thermal_motion_px": "analysis.temperature",
    "Thermal": "thermal",
    "check_blur": "analysis.aperture.blur_check",
    "compare": "analysis.comparison",
    "evaluate": "analysis.evaluation",
    "evaluate_camera": "analysis.calibration",
    "field_angles": "analysis.evaluation",
    "ghosts": "analysis.wall_reflections",
    "illumination": "analysis.aperture.relative_illumination",
    "mtf": "analysis.aperture.transfer",
    "psf": "analysis.aperture.point_spread",
    "spots": "analysis.aperture.spot_diagrams",
    "adjust": "calibrate.estimation",
    "calibrate_camera": "calibrate.estimation",
    "read_surveys": "calibrate.estimation",
    "Calibration": "calibrate.estimation",
    "Motion": "calibrate.estimation",
    "Prior": "calibrate.estimation",
    "Sighting": "calibrate.estimation",
    "simulate_detections": "calibrate.estimation",
    "direction_uncertainty": "calibrate.propagation",
    "floor_uncertainty": "calibrate.propagation",
    "uncertainty_map": "calibrate.propagation",
    "Board": "calibrate.targets",
    "Detection": "calibrate.targets",
    "mirror_ball_model": "calibrate.physical",
    "calibrate_lines": "calibrate.lines",
    "read_lines": "calibrate.lines",
    "LineCalibration": "calibrate.lines",
    "SensorModel": "calibrate.physical",
    "DoubleSphere": "camera_models",
    "EnhancedUnified": "camera_models",
    "KannalaBrandt": "camera_models",
    "convert": "calibrate.conversion",
    "register_camera_format": "calibrate.formats",
    "choose_frames": "calibrate.targets",
    "draw_board": "calibrate.targets",
    "find_board": "calibrate.targets",
    "find_boards": "calibrate.targets",
    "refine_corners": "calibrate.targets",
    "write_board": "calibrate.targets",
    "camera_from_rim": "calibrate.rim",
    "find_rim": "calibrate.rim",
    "sensor_from_rim": "calibrate.rim",
    "sensors_from_rim": "calibrate.rim",
    "FoundRim": "calibrate.rim",
    "load_ocam": "camera_models",
    "OmnimirrorError": "errors",
    "MirrorBall": "camera_models",
    "OCam": "camera_models",
    "RadialSpline": "camera_models",
    "RationalPinhole": "camera_models",
    "ThinPrismFisheye": "camera_models",
    "Unified": "camera_models",
    "ViewpointSpline": "camera_models",
    "best_apertures": "components.apertures",
    "read_catalogue": "components.catalogue",
    "choose_parts": "components.selection",
    "sensor_template": "components.template",
    "blur_bound": "design",
    "design_from_parts": "design",
    "design_sensor": "design",
    "FieldRequirements": "design",
    "format_requirements": "design",
    "judge": "design",
    "Front": "design",
    "LensRequirements": "design",
    "Limit": "design",
    "load_front": "design",
    "load_requirements": "design",
    "MirrorRequirements": "design",
    "PartsRequirements": "design",
    "Optimum": "design",
    "pareto": "design",
    "register_quantity": "design",
    "Requirements": "design",
    "requirements_like": "design",
    "SearchOptions": "design",
    "mappings": "design.construct.survey",
    "ColourDewarper": "dewarp",
    "Dewarper": "dewarp",
    "screens": "dewarp",
    "views": "dewarp",
    "register_view": "dewarp.views",
    "dewarp_bag": "interop.ros_bags.dewarping",
    "DewarpedBag": "interop.ros_bags.dewarping",
    "write_colmap": "interop.colmap",
    "ColmapProject": "interop.colmap",
    "serve_views": "interop.gateway.serving",
    "load_views": "interop.named_views",
    "NamedView": "interop.named_views",
    "ViewMap": "interop.view_maps",
    "view_map": "interop.view_maps",
    "write_maps": "interop.view_maps",
    "RayTable": "interop.ray_tables",
    "ray_table": "interop.ray_tables",
    "write_rays": "interop.ray_tables",
    "Body": "manufacturing",
    "export": "manufacturing",
    "register_format": "manufacturing",
    "read_image": "media",
    "write_image": "media",
    "as_built": "manufacturing.tolerancing.mirror_form",
    "form_effect": "manufacturing.tolerancing.mirror_form",
    "form_error": "manufacturing.metrology.form_errors",
    "FormError": "manufacturing.metrology.form_errors",
    "read_points": "manufacturing.metrology.readers",
    "register_mirror": "mirrors",
    "write_calibration_figures": "report.calibration",
    "write_calibration_report": "report.calibration",
    "write_demo": "report",
    "write_comparison": "report.comparison",
    "write_tolerances": "report.tolerances",
    "reproduce_paper": "reproduce",
    "Sensor": "sensor",
    "Detector": "simulate.detector",
    "Environment": "simulate.scenes.environment",
    "estimate_noise": "simulate.restoration.noise",
    "expose": "simulate.rendering.exposure",
    "merge_bracket": "simulate.restoration.bracketing",
    "PosedScene": "simulate.scenes.posed",
    "plan_bracket": "simulate.restoration.bracketing",
    "Pose": "simulate.scenes.posed",
    "restore": "simulate.restoration.sharpening",
    "Room": "simulate.scenes.worlds.room",
    "Hall": "simulate.scenes.worlds.hall",
    "Street": "simulate.scenes.worlds.street",
    "Radiometry": "simulate.radiometry",
    "ground_truth": "simulate.datasets.truth",
    "take_picture": "simulate.rendering.picture",
    "write_calibration_set": "simulate.datasets.calibration_set",
    "write_video_set": "simulate.datasets.calibration_set",
    "write_learning_set": "simulate.datasets.learning_set",
    "MovingBox": "simulate.scenes.worlds.bodies",
    "load_bodies": "simulate.scenes.worlds.bodies",
    "load_path": "simulate.datasets.video",
    "write_video": "simulate.datasets.video",
    "measure_round_trip": "simulate.round_trip",
    "load_scene": "simulate.scenes.sources",
    "bundled_sensors": "specs",
    "load_camera": "specs",
    "load_sensor": "specs",
    "parse_camera": "specs",
    "parse_sensor": "specs",
    "save_camera": "specs",
    "save_sensor": "specs",
    "Recording": "straighten",
    "dewarp_pictures": "straighten.folders",
    "Restoration": "straighten.restoring",
    "dewarp_video": "straighten.video",
    "LookAround": "studio.notebook",
    "show": "studio.notebook",
    "Tolerance": "manufacturing.tolerancing.tolerances",
    "load_tolerances": "manufacturing.tolerancing.tolerance_file",
    "perturbed": "manufacturing.tolerancing.perturbation",
    "tolerance": "manufacturing.tolerancing.tolerance_analysis",
    "tolerance_conflicts": "manufacturing.tolerancing.drawing_conflicts",
    "tolerance_template": "manufacturing.tolerancing.tolerance_file",
    "TolerancePlan": "manufacturing.tolerancing.tolerance_file",
    "Sweep": "manufacturing.tolerancing.sweep",
    "ToleranceReport": "manufacturing.tolerancing.tolerance_analysis",
    "Tolerances": "manufacturing.tolerancing.tolerances",
    "typical_sensors": "manufacturing.tolerancing.tolerance_analysis",
    "TypicalSensor": "manufacturing.tolerancing.tolerance_analysis",
}
__all__ = ["__version__", *_HOMES]


if not TYPE_CHECKING:  # a checker knows the names above, and should refuse all others

    def __getattr__(name: str) -> Any:
        if name in _HOMES:
            try:
                return getattr(import_module(f".{_HOMES[name]}", __name__), name)
            except ImportError as error:
                explained = import_module(".errors", __name__).explained_import_error(error)
                if explained is error:
                    raise
                raise explained from None
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
