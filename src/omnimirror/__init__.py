"""Omnidirectional mirror sensors: design, evaluation, simulation, calibration and image dewarping.

Public names are imported on first use to keep ``import omnimirror`` fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .analysis.camera_evaluation import evaluate_camera as evaluate_camera
    from .analysis.comparison import compare as compare
    from .analysis.evaluation import evaluate as evaluate
    from .analysis.evaluation import field_angles as field_angles
    from .analysis.focus import best_focus as best_focus
    from .analysis.focus import best_viewpoint as best_viewpoint
    from .analysis.ghost_images import ghosts as ghosts
    from .analysis.operating_conditions import at_temperature as at_temperature
    from .analysis.operating_conditions import at_wavelength as at_wavelength
    from .analysis.operating_conditions import thermal_motion_px as thermal_motion_px
    from .analysis.psf_mtf import mtf as mtf
    from .analysis.psf_mtf import psf as psf
    from .analysis.relative_illumination import illumination as illumination
    from .analysis.spot_diagrams import check_blur as check_blur
    from .analysis.spot_diagrams import spots as spots
    from .apps import plot as plot
    from .apps.reports import write_demo as write_demo
    from .apps.reports.calibration import write_calibration_figures as write_calibration_figures
    from .apps.reports.calibration import write_calibration_report as write_calibration_report
    from .apps.reports.comparison import write_comparison as write_comparison
    from .apps.reports.tolerances import write_tolerances as write_tolerances
    from .apps.reproduction import reproduce_paper as reproduce_paper
    from .apps.studio.pages import InteractiveView as InteractiveView
    from .apps.studio.pages import show as show
    from .base.errors import OmnimirrorError as OmnimirrorError
    from .base.errors import OmnimirrorWarning as OmnimirrorWarning
    from .calibration.conversion import convert as convert
    from .calibration.estimation import Calibration as Calibration
    from .calibration.estimation import Observation as Observation
    from .calibration.estimation import Prior as Prior
    from .calibration.estimation import RigidTransform as RigidTransform
    from .calibration.estimation import bundle_adjust as bundle_adjust
    from .calibration.estimation import calibrate_camera as calibrate_camera
    from .calibration.estimation import read_observations as read_observations
    from .calibration.estimation import simulate_detections as simulate_detections
    from .calibration.formats import register_camera_format as register_camera_format
    from .calibration.measurement import Measurement as Measurement
    from .calibration.measurement import measure as measure
    from .calibration.plumb_lines import PlumbLineCalibration as PlumbLineCalibration
    from .calibration.plumb_lines import calibrate_plumb_lines as calibrate_plumb_lines
    from .calibration.rim import MirrorOutline as MirrorOutline
    from .calibration.rim import camera_from_rim as camera_from_rim
    from .calibration.rim import detect_mirror_outline as detect_mirror_outline
    from .calibration.rim import sensor_from_rim as sensor_from_rim
    from .calibration.rim import sensors_from_rim as sensors_from_rim
    from .calibration.sensor_model import SensorModel as SensorModel
    from .calibration.sensor_model import mirror_ball_model as mirror_ball_model
    from .calibration.straight_edges import read_line_points as read_line_points
    from .calibration.targets import Board as Board
    from .calibration.targets import Detection as Detection
    from .calibration.targets import draw_board as draw_board
    from .calibration.targets import find_board as find_board
    from .calibration.targets import find_boards as find_boards
    from .calibration.targets import refine_corners as refine_corners
    from .calibration.targets import select_frames as select_frames
    from .calibration.targets import write_board as write_board
    from .calibration.uncertainty import direction_uncertainty as direction_uncertainty
    from .calibration.uncertainty import floor_uncertainty as floor_uncertainty
    from .calibration.uncertainty import uncertainty_map as uncertainty_map
    from .cameras.models import DoubleSphere as DoubleSphere
    from .cameras.models import EnhancedUnified as EnhancedUnified
    from .cameras.models import KannalaBrandt as KannalaBrandt
    from .cameras.models import MirrorBall as MirrorBall
    from .cameras.models import OCam as OCam
    from .cameras.models import RadialSpline as RadialSpline
    from .cameras.models import RationalPinhole as RationalPinhole
    from .cameras.models import ThinPrismFisheye as ThinPrismFisheye
    from .cameras.models import Unified as Unified
    from .cameras.models import ViewpointSpline as ViewpointSpline
    from .cameras.models import load_ocam as load_ocam
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
    from .design import check_requirements as check_requirements
    from .design import design_from_parts as design_from_parts
    from .design import design_sensor as design_sensor
    from .design import format_requirements as format_requirements
    from .design import load_front as load_front
    from .design import load_requirements as load_requirements
    from .design import pareto as pareto
    from .design import register_quantity as register_quantity
    from .design import requirements_like as requirements_like
    from .design.catalogue import read_catalogue as read_catalogue
    from .design.component_selection import best_apertures as best_apertures
    from .design.component_selection import choose_parts as choose_parts
    from .design.mirror_construction import mappings as mappings
    from .design.requirement_check import temperature_range as temperature_range
    from .design.sensor_file_template import sensor_template as sensor_template
    from .dewarp import ColourDewarper as ColourDewarper
    from .dewarp import Dewarper as Dewarper
    from .dewarp import screens as screens
    from .dewarp import views as views
    from .dewarp.image_folders import dewarp_images as dewarp_images
    from .dewarp.radiance_maps import LightProbe as LightProbe
    from .dewarp.radiance_maps import light_probe as light_probe
    from .dewarp.radiance_maps import merge_exposures as merge_exposures
    from .dewarp.request import VideoSettings as VideoSettings
    from .dewarp.restoration.deblurring import Restoration as Restoration
    from .dewarp.restoration.deblurring import restore as restore
    from .dewarp.restoration.focus_bracketing import merge_bracket as merge_bracket
    from .dewarp.restoration.focus_bracketing import plan_bracket as plan_bracket
    from .dewarp.restoration.noise import estimate_noise as estimate_noise
    from .dewarp.video_files import dewarp_video as dewarp_video
    from .dewarp.views import register_view as register_view
    from .interop import batch as batch
    from .interop import torch as torch
    from .interop.colmap import ColmapProject as ColmapProject
    from .interop.colmap import write_colmap as write_colmap
    from .interop.file_schemas import schema as schema
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
    from .io import read_image as read_image
    from .io import write_image as write_image
    from .manufacturing import Body as Body
    from .manufacturing import export as export
    from .manufacturing import register_format as register_format
    from .manufacturing.metrology.form_errors import FormError as FormError
    from .manufacturing.metrology.form_errors import form_error as form_error
    from .manufacturing.metrology.readers import read_points as read_points
    from .manufacturing.tolerancing.drawing_conflicts import (
        tolerance_conflicts as tolerance_conflicts,
    )
    from .manufacturing.tolerancing.mirror_form import as_built as as_built
    from .manufacturing.tolerancing.mirror_form import form_effect as form_effect
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
    from .manufacturing.tolerancing.tolerances import perturbed as perturbed
    from .optics.camera_files import load_camera as load_camera
    from .optics.camera_files import parse_camera as parse_camera
    from .optics.camera_files import save_camera as save_camera
    from .optics.mirrors import register_mirror as register_mirror
    from .optics.sensor import Sensor as Sensor
    from .optics.sensor_files import bundled_sensors as bundled_sensors
    from .optics.sensor_files import load_sensor as load_sensor
    from .optics.sensor_files import parse_sensor as parse_sensor
    from .optics.sensor_files import save_sensor as save_sensor
    from .optics.thermal import Thermal as Thermal
    from .simulation.dataset_manifest import CalibrationRecipe as CalibrationRecipe
    from .simulation.dataset_manifest import VideoRecipe as VideoRecipe
    from .simulation.datasets import write_calibration_dataset as write_calibration_dataset
    from .simulation.datasets import write_training_dataset as write_training_dataset
    from .simulation.datasets import write_video_dataset as write_video_dataset
    from .simulation.detector import Detector as Detector
    from .simulation.ground_truth_maps import ground_truth as ground_truth
    from .simulation.radiometry import Radiometry as Radiometry
    from .simulation.rendering import expose as expose
    from .simulation.rendering import render_image as render_image
    from .simulation.round_trip import measure_round_trip as measure_round_trip
    from .simulation.scenes.calibration_hall import Hall as Hall
    from .simulation.scenes.environment import Environment as Environment
    from .simulation.scenes.moving_objects import MovingBox as MovingBox
    from .simulation.scenes.moving_objects import load_bodies as load_bodies
    from .simulation.scenes.room import Room as Room
    from .simulation.scenes.scene import Pose as Pose
    from .simulation.scenes.scene import PosedScene as PosedScene
    from .simulation.scenes.scene_sources import load_scene as load_scene
    from .simulation.scenes.street import Street as Street
    from .simulation.simulated_video import ImageSequence as ImageSequence
    from .simulation.simulated_video import load_path as load_path
    from .simulation.simulated_video import write_video as write_video

__version__ = "0.2.0"

_HOMES = {
    "best_focus": "analysis.focus",
    "best_viewpoint": "analysis.focus",
    "temperature_range": "design.requirement_check",
    "at_temperature": "analysis.operating_conditions",
    "at_wavelength": "analysis.operating_conditions",
    "thermal_motion_px": "analysis.operating_conditions",
    "Thermal": "optics.thermal",
    "check_blur": "analysis.spot_diagrams",
    "compare": "analysis.comparison",
    "evaluate": "analysis.evaluation",
    "evaluate_camera": "analysis.camera_evaluation",
    "field_angles": "analysis.evaluation",
    "ghosts": "analysis.ghost_images",
    "illumination": "analysis.relative_illumination",
    "mtf": "analysis.psf_mtf",
    "psf": "analysis.psf_mtf",
    "spots": "analysis.spot_diagrams",
    "bundle_adjust": "calibration.estimation",
    "calibrate_camera": "calibration.estimation",
    "read_observations": "calibration.estimation",
    "Calibration": "calibration.estimation",
    "RigidTransform": "calibration.estimation",
    "Prior": "calibration.estimation",
    "Observation": "calibration.estimation",
    "simulate_detections": "calibration.estimation",
    "direction_uncertainty": "calibration.uncertainty",
    "floor_uncertainty": "calibration.uncertainty",
    "uncertainty_map": "calibration.uncertainty",
    "Board": "calibration.targets",
    "Detection": "calibration.targets",
    "mirror_ball_model": "calibration.sensor_model",
    "Measurement": "calibration.measurement",
    "measure": "calibration.measurement",
    "calibrate_plumb_lines": "calibration.plumb_lines",
    "read_line_points": "calibration.straight_edges",
    "PlumbLineCalibration": "calibration.plumb_lines",
    "SensorModel": "calibration.sensor_model",
    "DoubleSphere": "cameras.models",
    "EnhancedUnified": "cameras.models",
    "KannalaBrandt": "cameras.models",
    "convert": "calibration.conversion",
    "register_camera_format": "calibration.formats",
    "select_frames": "calibration.targets",
    "draw_board": "calibration.targets",
    "find_board": "calibration.targets",
    "find_boards": "calibration.targets",
    "refine_corners": "calibration.targets",
    "write_board": "calibration.targets",
    "camera_from_rim": "calibration.rim",
    "detect_mirror_outline": "calibration.rim",
    "sensor_from_rim": "calibration.rim",
    "sensors_from_rim": "calibration.rim",
    "MirrorOutline": "calibration.rim",
    "load_ocam": "cameras.models",
    "OmnimirrorError": "base.errors",
    "OmnimirrorWarning": "base.errors",
    "MirrorBall": "cameras.models",
    "OCam": "cameras.models",
    "RadialSpline": "cameras.models",
    "RationalPinhole": "cameras.models",
    "ThinPrismFisheye": "cameras.models",
    "Unified": "cameras.models",
    "ViewpointSpline": "cameras.models",
    "best_apertures": "design.component_selection",
    "read_catalogue": "design.catalogue",
    "choose_parts": "design.component_selection",
    "sensor_template": "design.sensor_file_template",
    "blur_bound": "design",
    "design_from_parts": "design",
    "design_sensor": "design",
    "FieldRequirements": "design",
    "format_requirements": "design",
    "check_requirements": "design",
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
    "mappings": "design.mirror_construction",
    "ColourDewarper": "dewarp",
    "Dewarper": "dewarp",
    "screens": "dewarp",
    "views": "dewarp",
    "register_view": "dewarp.views",
    "LightProbe": "dewarp.radiance_maps",
    "light_probe": "dewarp.radiance_maps",
    "merge_exposures": "dewarp.radiance_maps",
    "dewarp_bag": "interop.ros_bags.dewarping",
    "DewarpedBag": "interop.ros_bags.dewarping",
    "write_colmap": "interop.colmap",
    "ColmapProject": "interop.colmap",
    "serve_views": "interop.gateway.serving",
    "load_views": "interop.named_views",
    "schema": "interop.file_schemas",
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
    "read_image": "io",
    "write_image": "io",
    "as_built": "manufacturing.tolerancing.mirror_form",
    "form_effect": "manufacturing.tolerancing.mirror_form",
    "form_error": "manufacturing.metrology.form_errors",
    "FormError": "manufacturing.metrology.form_errors",
    "read_points": "manufacturing.metrology.readers",
    "register_mirror": "optics.mirrors",
    "write_calibration_figures": "apps.reports.calibration",
    "write_calibration_report": "apps.reports.calibration",
    "write_demo": "apps.reports",
    "write_comparison": "apps.reports.comparison",
    "write_tolerances": "apps.reports.tolerances",
    "reproduce_paper": "apps.reproduction",
    "Sensor": "optics.sensor",
    "Detector": "simulation.detector",
    "Environment": "simulation.scenes.environment",
    "estimate_noise": "dewarp.restoration.noise",
    "expose": "simulation.rendering",
    "merge_bracket": "dewarp.restoration.focus_bracketing",
    "PosedScene": "simulation.scenes.scene",
    "plan_bracket": "dewarp.restoration.focus_bracketing",
    "Pose": "simulation.scenes.scene",
    "restore": "dewarp.restoration.deblurring",
    "Room": "simulation.scenes.room",
    "Hall": "simulation.scenes.calibration_hall",
    "Street": "simulation.scenes.street",
    "Radiometry": "simulation.radiometry",
    "ground_truth": "simulation.ground_truth_maps",
    "render_image": "simulation.rendering",
    "CalibrationRecipe": "simulation.dataset_manifest",
    "VideoRecipe": "simulation.dataset_manifest",
    "write_calibration_dataset": "simulation.datasets",
    "write_video_dataset": "simulation.datasets",
    "write_training_dataset": "simulation.datasets",
    "MovingBox": "simulation.scenes.moving_objects",
    "load_bodies": "simulation.scenes.moving_objects",
    "load_path": "simulation.simulated_video",
    "ImageSequence": "simulation.simulated_video",
    "write_video": "simulation.simulated_video",
    "measure_round_trip": "simulation.round_trip",
    "load_scene": "simulation.scenes.scene_sources",
    "bundled_sensors": "optics.sensor_files",
    "load_camera": "optics.camera_files",
    "load_sensor": "optics.sensor_files",
    "parse_camera": "optics.camera_files",
    "parse_sensor": "optics.sensor_files",
    "save_camera": "optics.camera_files",
    "save_sensor": "optics.sensor_files",
    "VideoSettings": "dewarp.request",
    "dewarp_images": "dewarp.image_folders",
    "Restoration": "dewarp.restoration.deblurring",
    "dewarp_video": "dewarp.video_files",
    "InteractiveView": "apps.studio.pages",
    "show": "apps.studio.pages",
    "Tolerance": "manufacturing.tolerancing.tolerances",
    "load_tolerances": "manufacturing.tolerancing.tolerance_file",
    "perturbed": "manufacturing.tolerancing.tolerances",
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
_MODULES = {
    "batch": "interop.batch",
    "mirrors": "optics.mirrors",
    "plot": "apps.plot",
    "torch": "interop.torch",
}
__all__ = ["__version__", "batch", "plot", "torch", *_HOMES]


if not TYPE_CHECKING:  # type checkers see the names above and must reject all others

    def __getattr__(name: str) -> Any:
        if name in _MODULES:
            value = import_module(f".{_MODULES[name]}", __name__)
        elif name in _HOMES:
            try:
                value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
            except (ImportError, AttributeError) as error:
                explained = import_module(".base.errors", __name__).explain_import_error(error)
                if explained is error:
                    raise
                raise explained from None
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value  # later uses do not call this function
        return value


def __dir__() -> list[str]:
    return sorted(__all__)
