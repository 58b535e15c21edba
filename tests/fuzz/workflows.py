"""Valid calls of public functions of calibration, design, simulation and media, for the fuzz tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import av
import numpy as np

import omnimirror as om
from omnimirror.cameras.camera import Mount
from omnimirror.design.catalogue import Catalogue, ImagerComponent, LensComponent
from omnimirror.io.keyframes import Keyframes
from omnimirror.manufacturing import Tool, tool_path
from omnimirror.optics.camera_files import format_camera
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Orthographic, Perspective
from omnimirror.optics.mirrors import Sphere
from omnimirror.simulation.ground_truth_maps import ground_truth
from omnimirror.simulation.radiometry import Radiometry
from tests.conftest import MIRRORS

CAMERA = om.Unified(xi=0.9, focal_px=(20.0, 20.0), centre_px=(31.5, 31.5), image_size=(64, 64))
COVARIANCE = np.eye(len(CAMERA.parameters)) * 1e-4
BOARD = om.Board("chessboard", 7, 5, 25.0)
DETECTIONS = om.simulate_detections(CAMERA, BOARD, 3)
SENSOR = om.Sensor(
    Sphere(50.0, 44.0),
    Perspective(11.6, 4.0, 218.0),
    Imager(32, 32, 166.4),
    mirror_distance_mm=185.93,
)
RIM = om.MirrorOutline((16.0, 16.0), (14.0, 14.0), 0.0, 0.9, (32, 32))
ROOM = om.Room(40.0)
IMAGE = np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8)
LARGER = np.zeros((64, 64, 3), np.uint8)
PARTS = Catalogue(
    (LensComponent("l", 8.0, 1.4, 16.0, 100.0),), (ImagerComponent("i", 1000, 1000, 5.0),)
)
MOTION = Keyframes({"x_mm": ((0.0, 0.0), (1.0, 9.0))})
SEQUENCE = om.ImageSequence(SENSOR, ROOM, MOTION, frame_rate=5.0, duration_s=0.0, samples=1)
TOLERANCES = om.Tolerances(SENSOR, {"lens.k1": om.Tolerance(0.01)})
REPORT = om.tolerance(SENSOR, om.TolerancePlan(TOLERANCES, {"blur_px": 20.0}), trials=20)
VIEW = om.views.panorama(SENSOR, size=(36, 12))
ON_MIRROR = [
    [x, y, float(SENSOR.mirror.sag((x * x + y * y) ** 0.5))]
    for x in range(-30, 31, 4)
    for y in range(-30, 31, 4)
]
REQUIREMENTS = om.Requirements(
    field=om.FieldRequirements(omega_max_deg=120.0),
    mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=43.9),
    lens=om.LensRequirements(theta_max_deg=12.0),
)
WARM = replace(SENSOR, thermal=om.Thermal(mirror_material="acrylic"))
FORM = om.form_error(SENSOR.mirror, ON_MIRROR)


def write_files(folder: Path) -> None:
    """Write the input files of the calls."""
    om.write_image(folder / "a.png", IMAGE)
    (folder / "survey.csv").write_text("u_px,v_px,x_mm,y_mm,z_mm\n1,2,3,4,5\n")
    (folder / "stars.csv").write_text("u_px,v_px,azimuth_deg,elevation_deg\n1,2,3,4\n")
    (folder / "cmm.csv").write_text("1,2,3\n4,5,6\n")
    (folder / "edges.csv").write_text(
        "line,u_px,v_px\n" + "".join(f"a,{100 + 9 * i},300\n" for i in range(9))
    )
    (folder / "views.toml").write_text("[door]\npan_deg = 40\nsize = [64, 48]\n")
    (folder / "tolerances.toml").write_text(om.tolerance_template(SENSOR))
    (folder / "poses.csv").write_text("time_s,x_mm,pan_deg\n0,0,0\n.2,100,10\n")
    (folder / "bodies.toml").write_text(
        "[cart]\nsize_mm = [90, 80, 70]\nkeyframe = [{ time_s = 0, x_mm = 900 }]\n"
    )
    om.save_sensor(SENSOR, folder / "sensor.toml")
    (folder / "job.toml").write_text(
        'inputs.files = ["a.png"]\nsensor = [{ file = "sensor.toml" }]\n'
        'view.north = { size = [36, 12] }\noutput.url = "batch"\n'
    )
    om.batch.plan(folder / "job.toml")
    om.batch.run(folder / "job.toml", scheduler="threads")
    (folder / "parts.toml").write_text(
        '[[imager]]\nname = "i"\nwidth_px = 9\nheight_px = 9\npixel_pitch_um = 5.0\n'
        '[[lens]]\nname = "l"\nfocal_length_mm = 8.0\nf_number_min = 1.4\nf_number_max = '
        "16.0\nminimum_focus_mm = 100.0\n"
    )
    with av.open(str(folder / "v.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        for _ in range(2):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(IMAGE)))
        container.mux(stream.encode(None))


CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "read_points": (om.read_points, {"path": "cmm.csv", "unit": "mm"}),
    "form_error": (
        om.form_error,
        {"mirror": SENSOR.mirror, "points_mm": ON_MIRROR, "order": None, "are_departures": False},
    ),
    "form_at": (FORM.at, {"x_mm": [1.0, 2.0], "y_mm": [0.0, 3.0]}),
    "form_effect": (om.form_effect, {"sensor": SENSOR, "form": FORM}),
    "as_built": (om.as_built, {"sensor": SENSOR, "form": FORM}),
    "read_observations": (
        om.read_observations,
        {"points": ["survey.csv"], "directions": ["stars.csv"]},
    ),
    "read_line_points": (om.read_line_points, {"paths": ["edges.csv"]}),
    "load_views": (om.load_views, {"path": "views.toml"}),
    "NamedView": (
        om.NamedView,
        {"name": "door", "kind": "panorama", "options": {"size": (64, 48)}, "steerable": False},
    ),
    "write_tolerances": (om.write_tolerances, {"report": REPORT, "path": "order.html"}),
    "typical_sensors": (
        om.typical_sensors,
        {
            "sensor": SENSOR,
            "plan": om.TolerancePlan(TOLERANCES),
            "merit": "motion_px",
            "quantiles": (0.5,),
            "trials": 20,
            "seed": 0,
        },
    ),
    "Thermal": (
        om.Thermal,
        {
            "reference_c": 20.0,
            "mirror_material": None,
            "mirror_ppm_per_k": 70.0,
            "spacer_material": "aluminium",
            "spacer_ppm_per_k": None,
            "mount_material": None,
            "mount_ppm_per_k": None,
            "focal_ppm_per_k": 1.0,
            "imager_ppm_per_k": 2.6,
            "held_at": "rim",
        },
    ),
    "at_wavelength": (om.at_wavelength, {"sensor": WARM, "wavelength_nm": 450.0}),
    "at_temperature": (om.at_temperature, {"sensor": WARM, "temperature_c": 60.0}),
    "thermal_motion_px": (
        om.thermal_motion_px,
        {"sensor": WARM, "temperature_c": 60.0, "omega_deg": [10.0, 90.0]},
    ),
    "temperature_range": (
        om.temperature_range,
        {"requirements": REQUIREMENTS, "sensor": WARM, "coldest_c": 10.0, "warmest_c": 30.0},
    ),
    "Sweep": (
        om.Sweep,
        {"folder": Path("trials"), "part": (1, 2), "scheduler": None, "shard_trials": 65536},
    ),
    "Tool": (
        Tool,
        {
            "radius_mm": 0.5,
            "feed_um": 2.0,
            "tolerance_nm": 5.0,
            "spindle_rpm": 1000.0,
            "clearance_mm": 1.0,
            "x_is_diameter": False,
        },
    ),
    "tool_path": (tool_path, {"mirror": SENSOR.mirror, "tool": Tool(), "digits": 6}),
    "Tolerance": (om.Tolerance, {"value": 0.1, "distribution": "normal"}),
    "Tolerances": (
        om.Tolerances,
        {"sensor": SENSOR, "errors": {"lens.k1": om.Tolerance(0.1)}, "correlations": {}},
    ),
    "TolerancePlan": (
        om.TolerancePlan,
        {"tolerances": TOLERANCES, "limits": {"blur_px": 20.0}, "refocus": "none"},
    ),
    "load_tolerances": (om.load_tolerances, {"path": "tolerances.toml", "sensor": SENSOR}),
    "tolerance_template": (om.tolerance_template, {"sensor": SENSOR, "grade": "fine"}),
    "schema": (om.schema, {"kind": "views"}),
    "perturbed": (om.perturbed, {"sensor": SENSOR, "values": {"lens.k1": 0.01}}),
    "tolerance": (
        om.tolerance,
        {
            "sensor": SENSOR,
            "plan": TOLERANCES,
            "limits": {"blur_px": 20.0},
            "trials": 20,
            "seed": 0,
            "target_yield": None,
        },
    ),
    "field_angles": (om.field_angles, {"sensor": SENSOR, "step_deg": 5.0}),
    "simulate_detections": (
        om.simulate_detections,
        {
            "camera": CAMERA,
            "board": BOARD,
            "count": 1,
            "noise_px": 0.1,
            "seed": 0,
            "points_mm": None,
        },
    ),
    "calibrate_camera": (
        om.calibrate_camera,
        {
            "images": DETECTIONS,
            "board": BOARD,
            "model": "unified",
            "mount": None,
            "centre_px": None,
            "fixed": (),
            "priors": (),
            "seed": 0,
            "board_shape": False,
            "optics": "mirror",
        },
    ),
    "direction_uncertainty": (
        om.direction_uncertainty,
        {"camera": CAMERA, "pixels": [[40.0, 40.0]], "covariance": COVARIANCE},
    ),
    "floor_uncertainty": (
        om.floor_uncertainty,
        {"camera": CAMERA, "pixels": [[40.0, 40.0]], "height_mm": 1000.0, "covariance": COVARIANCE},
    ),
    "measure": (
        om.measure,
        {
            "camera": CAMERA,
            "pixels": [[40.0, 40.0], [30.0, 40.0]],
            "height_mm": 1000.0,
            "covariance": COVARIANCE,
        },
    ),
    "uncertainty_map": (
        om.uncertainty_map,
        {"camera": CAMERA, "height_mm": None, "covariance": COVARIANCE, "steps": 8},
    ),
    "Board": (
        om.Board,
        {
            "kind": "charuco",
            "columns": 7,
            "rows": 5,
            "square_mm": 30.0,
            "marker_mm": 20.0,
            "spacing": 0.3,
            "family": None,
            "legacy": False,
        },
    ),
    "mirror_ball_model": (
        om.mirror_ball_model,
        {
            "image_size": (64, 64),
            "centre_px": (32.0, 32.0),
            "rim_radius_px": 28.0,
            "focal_px": 200.0,
            "ball_radius_mm": 40.0,
            "mount": None,
        },
    ),
    "SensorModel": (om.SensorModel, {"sensor": SENSOR, "free": ("focal", "tilt"), "priors": None}),
    "select_frames": (
        om.select_frames,
        {
            "video": "v.mp4",
            "board": BOARD,
            "count": 1,
            "every_s": 0.1,
            "start_s": 0.0,
            "duration_s": None,
            "camera": None,
        },
    ),
    "draw_board": (om.draw_board, {"board": BOARD, "px_per_mm": 1.0, "margin_mm": None}),
    "find_board": (
        om.find_board,
        {"image": IMAGE, "board": BOARD, "name": "a", "camera": None},
    ),
    "find_boards": (
        om.find_boards,
        {"images": ["a.png"], "board": BOARD, "names": None, "several": False},
    ),
    "refine_corners": (
        om.refine_corners,
        {"image": LARGER, "detection": DETECTIONS[0], "board": BOARD, "passes": 1},
    ),
    "camera_from_rim": (om.camera_from_rim, {"rim": RIM, "mirror": "one-shot", "mount": None}),
    "detect_mirror_outline": (om.detect_mirror_outline, {"images": LARGER}),
    "sensor_from_rim": (om.sensor_from_rim, {"rim": RIM, "sensor": SENSOR}),
    "sensors_from_rim": (om.sensors_from_rim, {"rim": RIM, "sensor": SENSOR}),
    "best_apertures": (
        om.best_apertures,
        {
            "sensor": SENSOR,
            "f_number": 4.0,
            "object_distance_mm": np.inf,
            "wavelength_nm": 550.0,
            "omega_min_deg": 0.0,
        },
    ),
    "read_catalogue": (lambda path: om.read_catalogue(path), {"path": "parts.toml"}),
    "choose_parts": (
        om.choose_parts,
        {"sensor": SENSOR, "catalogue": PARTS, "min_fill": 0.1, "object_distance_mm": np.inf},
    ),
    "blur_bound": (
        om.blur_bound,
        {
            "sensor": SENSOR,
            "object_distance_mm": np.inf,
            "omega_min_deg": None,
            "image_radius_px": None,
        },
    ),
    "SearchOptions": (
        om.SearchOptions,
        {"starts": 1, "seed": 0, "resume": None, "image_radius_px": None},
    ),
    "mappings": (om.mappings, {"omega_max_deg": 75.0, "theta_max_deg": 12.0}),
    "export": (
        om.export,
        {
            "sensor": SENSOR,
            "path": "e",
            "formats": ["csv"],
            "chord_tolerance_um": 10.0,
            "step_mm": None,
            "digits": 6,
            "grid_points": 33,
            "sheet": "A3",
            "scale": None,
        },
    ),
    "write_comparison": (
        om.write_comparison,
        {"comparison": om.compare([SENSOR]), "path": "c.html", "scene": ROOM},
    ),
    "Detector": (
        om.Detector,
        {
            "exposure": 1.0,
            "full_well_e": 1e4,
            "read_noise_e": 5.0,
            "bits": 8,
            "curve": "srgb",
            "bayer": "none",
            "black_level_dn": None,
        },
    ),
    "Environment": (om.Environment, {"light": np.ones((8, 16, 3), np.float32), "heading_deg": 0.0}),
    "estimate_noise": (om.estimate_noise, {"image": IMAGE, "file": None, "where": None}),
    "expose": (
        om.expose,
        {
            "camera": SENSOR,
            "scene": ROOM,
            "samples": 1,
            "blur": False,
            "distant": False,
            "radiometry": None,
            "seed": 0,
            "workers": 1,
        },
    ),
    "ground_truth": (ground_truth, {"camera": SENSOR, "scene": ROOM, "radiometry": None}),
    "light_probe": (
        om.light_probe,
        {
            "image": IMAGE,
            "camera": SENSOR,
            "width_px": 64,
            "pan_deg": 0.0,
            "reflectance": 0.9,
        },
    ),
    "LightProbe": (
        om.LightProbe,
        {"radiance": np.ones((8, 16, 3), np.float32), "visible": np.ones((8, 16), np.bool_)},
    ),
    "merge_exposures": (
        om.merge_exposures,
        {"images": [IMAGE, IMAGE], "exposures_s": [0.1, 0.01]},
    ),
    "merge_bracket": (
        om.merge_bracket,
        {
            "sensor": SENSOR,
            "images": [IMAGE, IMAGE],
            "focus_mm": [200.0, 220.0],
            "object_distance_mm": np.inf,
        },
    ),
    "PosedScene": (om.PosedScene, {"scene": ROOM, "pose": om.Pose()}),
    "Pose": (om.Pose, {"x_mm": 0.0, "pan_deg": 0.0, "tilt_deg": 0.0}),
    "restore": (
        om.restore,
        {
            "camera": SENSOR,
            "image": IMAGE,
            "noise": 0.01,
            "blur": None,
            "object_distance_mm": np.inf,
        },
    ),
    "Room": (om.Room, {"texel_mm": 40.0, "other_texel_mm": None}),
    "Hall": (om.Hall, {"texel_mm": 40.0}),
    "Street": (om.Street, {"texel_mm": 80.0}),
    "Radiometry": (Radiometry, {f.name: getattr(Radiometry(), f.name) for f in fields(Radiometry)}),
    "write_calibration_dataset": (
        lambda folder, **arguments: om.write_calibration_dataset(
            om.CalibrationRecipe(**arguments), folder
        ),
        {
            "folder": "set",
            "sensor": SENSOR,
            "views": 1,
            "samples": 1,
            "blur": False,
            "seed": 0,
            "truth": False,
        },
    ),
    "CalibrationRecipe": (
        om.CalibrationRecipe,
        {"sensor": SENSOR, "samples": 1, "blur": False, "seed": 0, "views": 1},
    ),
    "VideoRecipe": (
        om.VideoRecipe,
        {"sensor": SENSOR, "scene": ROOM, "path": MOTION, "frame_rate": 5.0, "samples": 1},
    ),
    "load_path": (om.load_path, {"path": "poses.csv"}),
    "load_bodies": (om.load_bodies, {"path": "bodies.toml"}),
    "ImageSequence": (
        om.ImageSequence,
        {
            "camera": SENSOR,
            "scene": ROOM,
            "path": MOTION,
            "bodies": (),
            "frame_rate": 5.0,
            "duration_s": 0.0,
            "samples": 1,
            "blur": False,
            "seed": 0,
        },
    ),
    "write_video": (om.write_video, {"sequence": SEQUENCE, "output": "o.mp4"}),
    "MovingBox": (
        om.MovingBox,
        {"size_mm": (90.0, 80.0, 70.0), "path": MOTION, "colour": "#aabbcc", "name": "cart"},
    ),
    "write_training_dataset": (
        om.write_training_dataset,
        {"sequence": SEQUENCE, "folder": "learn", "per_shard": 2},
    ),
    "load_scene": (
        om.load_scene,
        {
            "name": "room",
            "texel_mm": 40.0,
            "heading_deg": 0.0,
            "unit_mm": None,
            "up": None,
            "background": None,
        },
    ),
    "parse_camera": (
        om.parse_camera,
        {"text": format_camera(CAMERA), "source": "a", "folder": None},
    ),
    "parse_sensor": (
        om.parse_sensor,
        {"text": format_camera(SENSOR), "source": "a", "folder": None},
    ),
    "save_camera": (om.save_camera, {"camera": CAMERA, "path": "c2.toml", "notes": "x"}),
    "save_sensor": (om.save_sensor, {"sensor": SENSOR, "path": "s2.toml"}),
    "ray_table": (om.ray_table, {"camera": SENSOR, "step": 4}),
    "write_rays": (
        om.write_rays,
        {"camera": SENSOR, "path": "rays.npz", "formats": ["npz"], "step": 4},
    ),
    "view_map": (om.view_map, {"camera": SENSOR, "view": VIEW, "viewpoint": "exact"}),
    "write_maps": (
        om.write_maps,
        {
            "camera": SENSOR,
            "view": VIEW,
            "path": "maps.npy",
            "formats": ["vpi"],
            "viewpoint": "exact",
        },
    ),
    "write_colmap": (
        om.write_colmap,
        {
            "camera": SENSOR,
            "images": ["a.png"],
            "folder": "colmap",
            "views_around": 2,
            "hfov_deg": 75.0,
            "tilt_deg": 0.0,
            "size": 16,
            "distance_mm": np.inf,
            "panorama": False,
            "every": 1,
            "poses": [om.Pose()],
        },
    ),
    "dewarp_images": (
        om.dewarp_images,
        {
            "sources": "a.png",
            "folder": "out",
            "camera": SENSOR,
            "view": VIEW,
            "border": None,
            "transparent": None,
            "restoration": None,
            "keep_tilt": False,
            "wavelengths_nm": None,
            "skip_existing": False,
            "threads": 1,
        },
    ),
    "dewarp_video": (
        partial(om.dewarp_video, view=VIEW),
        {
            "source": "v.mp4",
            "outputs": "dv.mp4",
            "camera": SENSOR,
            "border": None,
            "keep_tilt": False,
            "settings": None,
        },
    ),
    "VideoSettings": (
        om.VideoSettings,
        {"start_s": 0.0, "codec": "libx264", "crf": 20, "keyframes": None, "preview": False},
    ),
    "Restoration": (om.Restoration, {"noise": 0.01, "object_distance_mm": 500.0, "blur_px": None}),
    "ghosts": (
        om.ghosts,
        {"sensor": replace(SENSOR, housing=Housing(shell=Dome(260.0))), "omega_deg": [60.0]},
    ),
    "Mount": (
        Mount,
        {"camera_looks": "up", "forward_azimuth_deg": -90.0, "pitch_deg": 0.0, "roll_deg": 1.0},
    ),
    "cube": (
        om.views.cube,
        {"camera": SENSOR, "size": (32, 24), "layout": "cross", "pan_deg": 0.0},
    ),
    "sphere": (
        om.views.sphere,
        {"camera": SENSOR, "size": (36, 18), "span_deg": 360.0, "elevation_deg": (-90.0, 90.0)},
    ),
    "dome": (om.views.dome, {"camera": SENSOR, "size": (16, 16), "omega_deg": None}),
    "resolution": (om.views.resolution, {"camera": SENSOR, "view": VIEW}),
    "CubeMap": (om.screens.CubeMap, {"size": (48, 36), "layout": "cross", "pan_deg": 0.0}),
}
OBJECTS = [mirror for mirror, _ in MIRRORS.values()]
OBJECTS += [Orthographic(0.1, 4.0, 50.0), Perspective(11.6, 4.0, 218.0), CameraBody(40.0, -30.0)]
OBJECTS += [Rod(10.0), Tube(120.0), Dome(160.0), Rim(2.0)]
for instance in OBJECTS:
    arguments = {f.name: getattr(instance, f.name) for f in fields(instance) if f.init}
    CALLS[f"{type(instance).__name__} as a part"] = (type(instance), arguments)
