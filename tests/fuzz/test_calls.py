"""Public Python functions with unusual arguments: a result, or an omnimirror error."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.arguments import InvalidType
from omnimirror.base.errors import OmnimirrorError
from omnimirror.base.files import TEMPORARY_MARK
from omnimirror.base.parameters import Uncertainty
from omnimirror.calibration.formats import _scaramuzza
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import RadialModel, parse_ocam
from omnimirror.design import parse_requirements
from omnimirror.design.component_selection import best_apertures
from omnimirror.dewarp.request import VideoSettings
from omnimirror.interop.http_server.server import listen
from omnimirror.io import keyframes
from omnimirror.io.image_sequences import first_number
from omnimirror.manufacturing.tolerancing import monte_carlo
from omnimirror.manufacturing.tolerancing.tolerance_file import parse_tolerances
from omnimirror.optics.batch.evaluate import Designs
from omnimirror.optics.batch.families import family
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors import TabulatedMapping
from omnimirror.simulation import pixel_rays, simulated_video
from tests.everyday import few

from . import workflows

SENSOR = om.load_sensor("paper-spherical")
SMALL = replace(SENSOR, imager=Imager(32, 32, 166.4))
BLANK_IMAGE = np.zeros((32, 32, 3), np.uint8)
REQUIREMENTS = om.Requirements(
    field=om.FieldRequirements(omega_max_deg=120.0),
    mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=40.0),
    lens=om.LensRequirements(theta_max_deg=12.0),
)
OCAM = _scaramuzza.write_ocamcalib(
    om.OCam(
        polynomial=(-240.0, 0.0, 1e-3, 0.0, 0.0), centre_px=(320.0, 240.0), image_size=(640, 480)
    )
)

FOCAL = {
    "focal_px": (20.0, 21.0),
    "centre_px": (16.0, 15.0),
    "image_size": (32, 32),
    "skew_px": 0.1,
    "optics": "mirror",
    "rim_radius_px": None,
    "uncertainty": None,
    "mount": Mount(),
}
SPLINE = {
    "radii_px": (5.0, 9.0, 13.0),
    "field_deg": 200.0,
    "centre_px": (16.0, 15.0),
    "image_size": (32, 32),
    "stretch_x": 0.01,
    "shear": 0.0,
    "p1": 1e-5,
    "p2": 0.0,
    "optics": "mirror",
    "rim_radius_px": 12.0,
}


def used(kind: type[RadialModel]) -> Callable[..., None]:
    """Return a function that creates a camera and uses it."""

    def use(**arguments: Any) -> None:
        camera = kind(**arguments)
        camera.image([[1.0, 2.0, -3.0], [0.0, 0.0, 1.0]])
        camera.backproject([[3.0, 4.0], [16.0, 15.0]])
        camera.project([[1.0, 2.0, -3.0]])

    return use


CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "batch.plan": (om.batch.plan, {"job": "job.toml"}),
    "batch.run": (
        om.batch.run,
        {"job": "job.toml", "part": (1, 1), "scheduler": "threads", "retry_failed": False},
    ),
    "batch.status": (om.batch.status, {"job": "job.toml"}),
    "batch.load_job": (
        om.batch.load_job,
        {"path": "job.toml", "changes": {"output": {"format": ".jpg"}}},
    ),
    "spots": (
        om.spots,
        {
            "sensor": SENSOR,
            "omega_deg": [0.0, 60.0],
            "focus_mm": 210.0,
            "azimuth_deg": 0.0,
            "object_distance_mm": np.inf,
        },
    ),
    "psf": (
        om.psf,
        {
            "sensor": SENSOR,
            "omega_deg": 30.0,
            "focus_mm": 210.0,
            "azimuth_deg": 0.0,
            "object_distance_mm": np.inf,
            "kind": "geometric",
            "wavelength_nm": 550.0,
            "width_px": 9.0,
        },
    ),
    "mtf": (
        om.mtf,
        {
            "sensor": SENSOR,
            "omega_deg": [30.0],
            "cycles_per_px": [0.1],
            "focus_mm": 210.0,
            "kind": "geometric",
            "wavelength_nm": 550.0,
        },
    ),
    "illumination": (
        om.illumination,
        {
            "sensor": SENSOR,
            "omega_deg": [30.0],
            "azimuth_deg": 0.0,
            "reflectivity": 0.9,
            "transmission": 0.9,
        },
    ),
    "check_blur": (
        om.check_blur,
        {"sensor": SENSOR, "f_numbers": [4.0], "omega_deg": [30.0], "object_distance_mm": np.inf},
    ),
    "evaluate": (
        om.evaluate,
        {
            "sensor": SENSOR,
            "omega_deg": [30.0],
            "object_distance_mm": np.inf,
            "focus_mm": 210.0,
            "merit": "worst_floored_area_deg2",
            "mode": "exact",
            "wavelength_nm": 550.0,
            "image_radius_px": 500.0,
            "tolerance_px": 1.0,
        },
    ),
    "best_focus": (
        om.best_focus,
        {
            "sensor": SENSOR,
            "merit": "worst_blur_area_deg2",
            "omega_deg": [0.0, 90.0],
            "object_distance_mm": np.inf,
            "mode": "exact",
            "image_radius_px": 500.0,
        },
    ),
    "best_viewpoint": (
        om.best_viewpoint,
        {"sensor": SENSOR, "object_distance_mm": 1e3, "image_radius_px": 500.0},
    ),
    "compare": (om.compare, {"sensors": [SENSOR]}),
    "load_sensor": (om.load_sensor, {"name_or_path": "paper-spherical"}),
    "load_requirements": (om.load_requirements, {"path": "requirements.toml"}),
    "load_ocam": (om.load_ocam, {"path": "calib.txt", "optics": "mirror", "rim_radius_px": 200.0}),
    "read_image": (om.read_image, {"path": "a.png"}),
    "write_image": (om.write_image, {"path": "b.png", "image": BLANK_IMAGE, "panorama": None}),
    "MirrorBall": (
        om.MirrorBall,
        {
            "centre_px": (16.0, 16.0),
            "rim_radius_px": 10.0,
            "image_size": (32, 32),
            "field_deg": 300.0,
        },
    ),
    "OCam": (
        om.OCam,
        {
            "polynomial": (-100.0, 0.0, 0.001),
            "centre_px": (16.0, 16.0),
            "image_size": (32, 32),
            "affine": (1.0, 0.0, 0.0),
            "optics": "mirror",
        },
    ),
    "Unified": (
        used(om.Unified),
        {"xi": 0.9, **FOCAL, "k1": -0.1, "k2": 0.0, "k3": 0.0, "p1": 0.0, "p2": 0.01},
    ),
    "EnhancedUnified": (used(om.EnhancedUnified), {"alpha": 0.6, "beta": 1.1, **FOCAL}),
    "DoubleSphere": (used(om.DoubleSphere), {"xi": -0.2, "alpha": 0.6, **FOCAL}),
    "KannalaBrandt": (
        used(om.KannalaBrandt),
        {**FOCAL, "k1": -0.1, "k2": 0.0, "k3": 0.0, "k4": 0.0},
    ),
    "RadialSpline": (used(om.RadialSpline), SPLINE),
    "ViewpointSpline": (used(om.ViewpointSpline), {"viewpoints_mm": (-1.0, 0.0, 2.0), **SPLINE}),
    "evaluate_camera": (
        om.evaluate_camera,
        {"camera": om.RadialSpline(**SPLINE), "omega_deg": [10.0, 20.0]},
    ),
    "image": (om.RadialSpline(**SPLINE).image, {"points_mm": [[1.0, 2.0, -3.0]]}),
    "with_parameters": (
        om.MirrorBall(
            centre_px=(16.0, 16.0), rim_radius_px=9.0, field_deg=260.0, image_size=(32, 32)
        ).with_parameters,
        {"values": [9.0, 1, 2]},
    ),
    "load_camera": (om.load_camera, {"name_or_path": "calib.txt"}),
    "Limit": (om.Limit, {"quantity": "total_blur_px", "at_most": 1.0}),
    "FieldRequirements": (
        om.FieldRequirements,
        {"omega_max_deg": 120.0, "omega_min_deg": 0.0, "object_distance_mm": (500.0, np.inf)},
    ),
    "MirrorRequirements": (
        om.MirrorRequirements,
        {
            "mapping": "equidistant",
            "rim_radius_mm": 40.0,
            "fit": None,
            "omega_deg": None,
            "conic": None,
            "plane_distance_mm": None,
        },
    ),
    "PartsRequirements": (
        om.PartsRequirements,
        {
            "catalogue": ("a.csv",),
            "mirror": "ball",
            "dome": True,
            "max_price": 100.0,
            "max_height_mm": 200.0,
        },
    ),
    "LensRequirements": (
        om.LensRequirements,
        {"kind": "perspective", "theta_max_deg": 12.0, "f_number": 4.0, "focus_mm": None},
    ),
    "Requirements": (
        om.Requirements,
        {
            "field": REQUIREMENTS.field,
            "mirror": REQUIREMENTS.mirror,
            "lens": REQUIREMENTS.lens,
            "imager": REQUIREMENTS.imager,
            "limits": (),
            "name": "a",
        },
    ),
    "format_requirements": (om.format_requirements, {"requirements": REQUIREMENTS}),
    "check_requirements": (
        om.check_requirements,
        {"requirements": REQUIREMENTS, "sensor": SENSOR, "angles": 11},
    ),
    "Dewarper": (
        lambda **arguments: om.Dewarper(**arguments)(BLANK_IMAGE),
        {
            "camera": SMALL,
            "view": om.screens.Cylinder((36, 12), -40.0, 20.0),
            "interpolation": "linear",
            "viewpoint": "exact",
            "border": 0,
        },
    ),
    "ColourDewarper": (
        lambda **arguments: om.ColourDewarper(**arguments)(BLANK_IMAGE),
        {
            "cameras": (SMALL,) * 3,
            "view": om.screens.Cylinder((36, 12), -40.0, 20.0),
            "interpolation": "linear",
            "viewpoint": "exact",
            "border": 0,
        },
    ),
    "picture": (
        om.Dewarper(SMALL, om.screens.Cylinder((36, 12), -40.0, 20.0)),
        {"image": BLANK_IMAGE, "transparent": False, "out": None},
    ),
    "Cylinder": (
        om.screens.Cylinder,
        {
            "size": (36, 10),
            "tilt_min_deg": -20.0,
            "tilt_max_deg": 20.0,
            "pan_deg": 0.0,
            "span_deg": 360.0,
            "distance_mm": np.inf,
        },
    ),
    "panorama": (om.views.panorama, {"camera": SMALL, "size": (36, 12), "pan_deg": 0.0}),
    "render_image": (
        om.render_image,
        {"camera": SMALL, "scene": om.Room(), "samples": 1, "blur": False, "seed": 0},
    ),
    "plan_bracket": (
        om.plan_bracket,
        {"sensor": SENSOR, "limit_px": 2.0, "object_distance_mm": np.inf},
    ),
    "backproject": (SENSOR.backproject, {"pixels": [[500.0, 500.0]]}),
    "project": (SENSOR.project, {"points_mm": [[100.0, 0.0, 50.0]]}),
    "project_directions": (SENSOR.project_directions, {"directions": [[1.0, 0.0, 0.0]]}),
    "project (ball)": (
        om.MirrorBall(
            centre_px=(16.0, 16.0), rim_radius_px=9.0, field_deg=260.0, image_size=(32, 32)
        ).project,
        {"points_mm": [[1.0, 2.0, -3.0]]},
    ),
    "aperture_rays": (SENSOR.aperture_rays, {"pixels": [[500.0, 500.0]], "pupil": [0.5, 0.0]}),
    "x_from_height_px": (SENSOR.x_from_height_px, {"h_px": [100.0]}),
    "radius_from_centre_px": (SENSOR.radius_from_centre_px, {"pixels": [[500.0, 500.0]]}),
    "to_csv": (om.evaluate(SENSOR, [30.0]).to_csv, {"path": "table.csv"}),
    "to_json": (om.evaluate(SENSOR, [30.0]).to_json, {"path": "table.json"}),
    "Sensor": (
        om.Sensor,
        {
            "mirror": SENSOR.mirror,
            "lens": SENSOR.lens,
            "imager": SENSOR.imager,
            "mirror_distance_mm": 185.93,
        },
    ),
    "convert": (
        om.convert,
        {
            "source": om.Unified(
                xi=0.9, focal_px=(20.0, 20.0), centre_px=(31.5, 23.5), image_size=(64, 48)
            ),
            "target": "out.yaml",
            "to": "kalibr-ds",
            "camera": 0,
            "optics": "mirror",
            "mount": None,
            "image_size": None,
            "rim_radius_px": None,
            "flip": False,
            "tolerance_px": 50.0,
            "distance_mm": [500.0],
            "field_deg": 90.0,
        },
    ),
    "show": (om.show, {"image": BLANK_IMAGE, "camera": SMALL, "height_px": 300}),
    "Imager": (Imager, {"width_px": 32, "height_px": 32, "pixel_pitch_um": 5.0}),
    **workflows.CALLS,
}
OTHER_TESTS = {
    "Body",
    "Calibration",
    "ColmapProject",
    "Detection",
    "DewarpedBag",
    "FormError",
    "Measurement",
    "MirrorOutline",
    "Front",
    "PlumbLineCalibration",
    "plot",
    "torch",
    "InteractiveView",
    "OmnimirrorError",
    "OmnimirrorWarning",
    "RigidTransform",
    "Optimum",
    "Prior",
    "RationalPinhole",
    "RayTable",
    "Observation",
    "ThinPrismFisheye",
    "ToleranceReport",
    "TypicalSensor",
    "ViewMap",
    "bundle_adjust",
    "bundled_sensors",
    "calibrate_plumb_lines",
    "design_from_parts",
    "dewarp_bag",
    "serve_views",
    "design_sensor",
    "load_front",
    "measure_round_trip",
    "pareto",
    "register_camera_format",
    "register_format",
    "register_mirror",
    "register_quantity",
    "register_view",
    "reproduce_paper",
    "requirements_like",
    "screens",
    "sensor_template",
    "tolerance_conflicts",
    "views",
    "write_board",
    "write_calibration_figures",
    "write_calibration_report",
    "write_demo",
    "write_video_dataset",
}
"""Public names without a call here: too slow for hundreds of calls, or results of other functions."""
SLOW_CALLS = (
    "calibrate_camera",
    "write_comparison",
    "convert",
)  # covered sufficiently by ``test_any_values...``
FULL_CALLS = (
    "calibrate_camera",
    "write_calibration_dataset",
    "write_comparison",
    "write_tolerances",
)
ODD = (
    None,
    "",
    "x",
    "x" * 5000,
    "a\0b",
    b"x",
    True,
    0,
    -1,
    10**400,
    1e308,
    -1e308,
    float("nan"),
    float("inf"),
    1j,
    [],
    [[]],
    [float("nan")],
    [60.0, float("inf")],
    [[1, 2], [3]],
    ["a"],
    {},
    (1,),
    object(),
    len,
    np.zeros(0),
    np.zeros((2, 2, 2)),
    np.zeros(3, "datetime64[s]"),
)
NUMBERS = st.one_of(st.floats(), st.integers(), st.floats(-200, 200))
VALUES = st.one_of(
    st.sampled_from(ODD),
    NUMBERS,
    st.lists(NUMBERS, max_size=4),
    st.text(max_size=8),
    st.tuples(NUMBERS, NUMBERS),
)


@pytest.fixture(autouse=True, scope="module")
def _files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("calls")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        (folder / "calib.txt").write_text(OCAM)
        (folder / "requirements.toml").write_text(
            'field.omega_max_deg = 90\nmirror = {mapping = "equidistant", rim_radius_mm = '
            "40.0}\nlens.theta_max_deg = 12.0\n"
        )
        workflows.write_files(folder)
        patch.setattr(simulated_video, "MAX_FRAMES", 20)  # larger values are valid and take hours
        patch.setattr(pixel_rays, "MAX_SAMPLES", 1024)
        patch.setattr(monte_carlo, "MAX_TRIALS", 10_000)
        yield


def call(name: str, changed: dict[str, Any]) -> None:
    function, arguments = CALLS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            function(**arguments | changed)
        except OmnimirrorError as e:
            message = str(e)
            assert "\n" not in message
            assert len(message) < 700, message
    assert not [
        path for path in Path().iterdir() if TEMPORARY_MARK in path.name
    ]  # no partial output remains


@pytest.mark.parametrize("name", few(CALLS, *(name for name in CALLS if name not in FULL_CALLS)))
def test_valid_calls_succeed(name):
    function, arguments = CALLS[name]
    result = function(**arguments)
    if not isinstance(result, str | list):
        assert (
            len(repr(result)) < 15_000
        )  # console output of a result: its numbers, not its thousand angles


def test_every_public_function_is_called():
    called = {name.split(" ")[0].split(".")[0] for name in CALLS}
    assert not {name for name in om.__all__ if not name.startswith("__")} - called - OTHER_TESTS


@pytest.mark.parametrize(
    "name",
    few(
        (name for name in CALLS if name not in SLOW_CALLS),
        *(name for name in CALLS if name not in (*SLOW_CALLS, *FULL_CALLS)),
    ),
)
def test_unusual_values_are_rejected(name):
    numbers = range(
        0, len(ODD), 3
    )  # every third value of each argument, with another offset for the next
    for i, argument in enumerate(CALLS[name][1]):
        for k in numbers:
            value = ODD[(k + i) % len(ODD)]
            try:
                call(name, {argument: value})
            except Exception as e:
                raise AssertionError(f"{name}({argument}={value!r:.60})") from e


@pytest.mark.full
@pytest.mark.parametrize("name", CALLS)
@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_arbitrary_values_are_rejected(name, data):
    names = data.draw(
        st.lists(st.sampled_from(list(CALLS[name][1])), min_size=1, max_size=2, unique=True)
    )
    call(name, {argument: data.draw(VALUES) for argument in names})


@pytest.mark.parametrize(
    ("name", "argument", "value"),
    [
        ("UnitAspect as a part", "theta_max_deg", 5e-324),
        ("GroundPlane as a part", "theta_max_deg", 5e-297),
        ("ViewpointSpline", "field_deg", 2e-281),
        ("direction_uncertainty", "pixels", np.zeros((2, 2, 2))),
        ("floor_uncertainty", "pixels", np.zeros((2, 2, 2))),
        ("tolerance", "seed", -1),
    ],
)
def test_impossible_sensor_values_are_rejected(name, argument, value):
    function, arguments = CALLS[name]
    with pytest.raises(OmnimirrorError, match=rf"{argument} .*must"):
        function(**arguments | {argument: value})


def test_integers_may_exceed_int64():
    assert (
        om.screens.Cylinder((36, 10), -20.0, 20.0, distance_mm=2**64)._placement
        == ", at 1.84467e+19 mm"
    )


@pytest.mark.parametrize(
    ("name", "argument"),
    [("uncertainty_map", "steps"), ("simulate_detections", "count"), ("refine_corners", "passes")],
)
def test_excessive_counts_are_rejected(name, argument):
    function, arguments = CALLS[name]
    with pytest.raises(
        OmnimirrorError, match=f"{argument} must be an integer between .*; got 1000000000"
    ):
        function(**arguments | {argument: 10**9})


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("image", {"points_mm": np.zeros((1, 3), complex)}),
        ("image", {"points_mm": np.ones((1, 2, 3))}),
        ("form_error", {"points_mm": np.ones((9, 9, 3))}),
        ("project", {"points_mm": [["1", "2", "3"]]}),
        ("project_directions", {"directions": [[True, False, False]]}),
        ("Tolerances", {"correlations": {"x": 1.0}}),
        ("perturbed", {"values": {1: 2.0}}),
        ("calibrate_camera", {"priors": (each for each in (1,))}),
        ("SensorModel", {"priors": (each for each in (1,))}),
        ("field_angles", {"step_deg": 1e-9}),
        ("Dewarper", {"view": Path("a.png")}),
        ("write_colmap", {"folder": "requirements.toml"}),
        ("write_training_dataset", {"folder": "requirements.toml"}),
        ("dewarp_video", {"camera": lambda size: size}),
    ],
)
def test_invalid_numbers_lists_pairs_and_cameras(name, changes):
    function, usual = CALLS[name]
    with pytest.raises(
        OmnimirrorError,
        match=r"valid|must|cannot be read as numbers| is not | not a name|Not a directory",
    ):
        function(**usual | changes)


def test_covariance_may_contain_zeros_and_rounding_errors():
    assert Uncertainty(("k1", "k2"), ((0.0, 0.0), (0.0, 4.0))).sigmas == {"k1": 0.0, "k2": 2.0}
    rounded = Uncertainty(("k1", "k2"), ((1.0, 1.0 + 1e-12), (1.0 + 1e-12, 1.0)))
    assert rounded.sigmas == {"k1": 1.0, "k2": 1.0}


BALL = om.MirrorBall(
    centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=280.0, image_size=(64, 64)
)
IMAGE = {"centre_px": (31.5, 23.5), "image_size": (64, 48)}
PINHOLE = {"focal_px": (100.0, 100.0), **IMAGE}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda _: om.mtf(SENSOR, [0.0], wavelength_nm=[500.0, 600.0], weights=[1.0]),
            "weights must have one value for each of the 2 wavelengths; got 1",
        ),
        (
            lambda _: om.mtf(SENSOR, [0.0], wavelength_nm=[550.0, 99.0]),
            "wavelength_nm must be 100 to 20000 nm; got 99",
        ),
        (
            lambda _: om.mtf(SENSOR, [0.0], wavelength_nm=20001.0),
            "wavelength_nm must be 100 to 20000 nm; got 20001",
        ),
        (
            lambda _: om.evaluate(SENSOR, [0.0], wavelength_nm=99.9),
            "wavelength_nm must be 100 to 20000 nm; got 99.9",
        ),
        (
            lambda _: om.evaluate(
                SENSOR, [1.0, 2.0], focus_mm="auto", object_distance_mm=[9.0, 8.0]
            ),
            "focus 'auto' requires one object_distance_mm for all field angles; got several",
        ),
        (
            lambda _: family("spheres", 2),
            "family of meridians must be one of even-polynomial, .*; got 'spheres'",
        ),
        (
            lambda _: family("even-polynomial", 0),
            "terms must be 1 to 12 for even-polynomial; got 0",
        ),
        (
            lambda _: Designs(
                family("even-polynomial", 3), np.ones((2, 2)), 150.0, 44.0, 11.6, 4.0, 5.2
            ),
            r"coefficients must have shape \(n, 3\) for even-polynomial with 3 terms; got \(2, 2\)",
        ),
        (
            lambda _: best_apertures(SENSOR, f_number=(8.0, 2.0)),
            "must be a range with 0 < low <= high; got 8 to 2",
        ),
        (
            lambda _: best_apertures(SENSOR, f_number=0.0),
            "must be a range with 0 < low <= high; got 0 to 0",
        ),
        (
            lambda _: om.Unified(**{**PINHOLE, "xi": 0.9, "image_size": (64, 48, 3)}),
            r"image_size must be two numbers .*; got \(64, 48, 3\)",
        ),
        (
            lambda _: om.Unified(**{**PINHOLE, "xi": 0.9, "centre_px": (1.0,)}),
            r"centre_px must be two numbers \(u, v\); got \(1\.0,\)",
        ),
        (
            lambda _: om.OCam(polynomial=(-9.0, 0.0), **IMAGE, affine=(1.0, 0.0)),
            r"affine must be three numbers .*; got \(1\.0, 0\.0\)",
        ),
        (
            lambda _: om.OCam(polynomial=((-9.0,),), **IMAGE),
            r"polynomial must be numbers of shape \(n,\)",
        ),
        (
            lambda _: om.Unified(xi=0.9, **PINHOLE).with_parameters([1.0]),
            r"values must have the shape \(\d+,\) for the parameters of unified; got shape \(1,\)",
        ),
        (
            lambda _: Uncertainty(("k1", "k1"), ((1.0, 0.0), (0.0, 1.0))),
            "names must be different names of parameters",
        ),
        (
            lambda _: Uncertainty(("k1", "k2"), ((1.0, 0.0), (0.0,))),
            r"covariance must have the shape \(2, 2\)",
        ),
        (
            lambda _: Uncertainty(("k1", "k2"), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))),
            r"covariance must have the shape \(2, 2\)",
        ),
        (
            lambda _: Uncertainty(("k1", "k2"), ((1.0, 0.1), (0.2, 1.0))),
            "covariance must be symmetric",
        ),
        (lambda _: Uncertainty(("k1", "k2"), ((1.0, 2.0), (2.0, 1.0))), "covariance"),
        (lambda _: om.screens.Cylinder((9, 9), [0.0], [1.0]), "^tilt_min_deg "),
        (
            lambda _: om.views.panorama(BALL, (9, 9, 9)),
            r"size must be a tuple of 2 values .*; got \(9, 9, 9\)",
        ),
        (lambda _: om.read_image("a\0.png"), "must have only characters that file names support"),
        (
            lambda _: om.register_format("x", "y"),
            "kind must be an omnimirror.manufacturing.Format; got 'y'",
        ),
        (
            lambda _: om.register_view("panorama", om.views.dome),
            "the name of a view must be unique; got 'panorama'",
        ),
        (
            lambda _: om.find_boards(
                [np.zeros((9, 9), np.uint8)], om.Board("chessboard", 5, 4), names=["a", "b"]
            ),
            "names must have one entry per image; got 2 names for 1 images",
        ),
        (
            lambda _: om.plan_bracket(SENSOR, limit_px=0.01),
            "limit_px must be between 0.05 and 1000 px; got 0.01",
        ),
        (
            lambda _: TabulatedMapping((0.0, 60.0), (0.0, 1.0), 11.0, 40.0),
            "omega_deg must have at least 6 values; got 2",
        ),
        (
            lambda _: keyframes.Keyframes.load("keyframes.txt"),
            r"keyframes must be a \.csv or \.toml file",
        ),
        (
            lambda _: first_number(Path("p%03d.png")),
            "must be numbered without gaps; .*p002.png is missing",
        ),
        (
            lambda _: om.dewarp_video(
                "a.mp4", "b.mp4", camera=BALL, settings=VideoSettings(frame_rate=9.0)
            ),
            "frame_rate must be omitted unless the source is an image sequence; got 9",
        ),
        (
            lambda server_port: listen("127.0.0.1", server_port),
            "cannot listen on 127.0.0.1, port .*: Address already in use",
        ),
    ],
)
def test_errors_name_argument_and_valid_values(call, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("keyframes.txt", "p001.png", "p003.png"):
        (tmp_path / name).write_text("time_s,pan_deg\n0,0\n")
    with closing(listen("127.0.0.1", 0)) as server, pytest.raises(OmnimirrorError, match=message):
        call(server.getsockname()[1])


def test_double_sphere_with_singular_centre_is_defined_on_axis():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera = om.DoubleSphere(xi=-1.0, alpha=0.6, **FOCAL)
        near, on = (camera.image([[x, 0.0, -100.0]]).d_points for x in (1e-6, 0.0))
    np.testing.assert_allclose(on, near, rtol=1e-6, atol=1e-9)


def test_messages_have_limited_length():
    from omnimirror.base.arguments import format_value

    for value in (*ODD, [1.5] * 100_000, "x" * 100_000, 10**5000, np.zeros(10**6)):
        assert len(format_value(value)) <= 60


@pytest.mark.parametrize("name", ["x" * 5000, "a folder\n/" * 500])
def test_messages_shorten_long_names_on_one_line(name):
    readers = (
        om.parse_camera,
        om.parse_sensor,
        keyframes.parse_csv,
        keyframes.parse_toml,
        parse_ocam,
        parse_requirements,
        partial(parse_tolerances, sensor=SENSOR),
    )
    for read in readers:
        for text in ("9 0", "a = [", "a = 1"):
            with pytest.raises(
                OmnimirrorError, match=re.escape(name.splitlines()[0][:20])
            ) as refusal:
                read(text=text, source=name)
            assert len(str(refusal.value)) < 300
            assert "\n" not in str(refusal.value)
    for error in (OmnimirrorError, om.base.errors.SpecError, InvalidType):
        assert (
            len(str(error(f"there is no mirror {name!r} and no file {'/'.join(name.split())}")))
            < 300
        )


def test_messages_keep_start_and_end_of_long_names():
    path = "/home/someone/" + "pictures/" * 30 + "of the lab.png"
    assert str(OmnimirrorError(f"there is no {path}")).startswith(
        "there is no /home/someone/pictures/"
    )
    assert str(OmnimirrorError(f"there is no {path}")).endswith("/of the lab.png")
    prose = "the mirror's rim is hidden, and " * 6 + "the camera's is 'not'"
    assert str(OmnimirrorError(prose)) == prose
