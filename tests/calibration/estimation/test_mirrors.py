"""Physical calibration of mirror sensors: misalignment up to 2 mm and 2 deg, against ground truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import omnimirror as om
from omnimirror.calibration.estimation.observations import rotation_of
from omnimirror.optics.mirrors.mirror import MirrorPose

from .cases import BOARD, NOISE_PX

USUAL = ("focal", "distance", "decentre", "tilt")
SHAPE_PARAMETERS = ("shape", *USUAL)
CASES = [
    ("paper-spherical", USUAL),
    ("paper-spherical", SHAPE_PARAMETERS),
    ("paper-hyperboloidal", SHAPE_PARAMETERS),
    ("paper-equidistant", USUAL),
    ("prototype-spherical", SHAPE_PARAMETERS),
    (
        "paraboloid-telecentric",
        ("shape", "focal", "decentre", "tilt"),
    ),  # a distance that is not observable
]


def misaligned(design: om.Sensor, random: np.random.Generator) -> om.Sensor:
    x, y, tilt_x, tilt_y = random.uniform(-2, 2, 4)
    return replace(design, mirror_pose=MirrorPose(x, y, 0.0, tilt_x, tilt_y))


def shares_within_3_sigma(model, covariance, truth: om.Sensor, random) -> tuple[float, float]:
    """Return the fractions of directions and of points at 0.3 to 2 m that agree with the true
    camera.

    Within three standard deviations of the pixel, from the parameter covariance.
    """
    directions = random.normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    to_camera = truth.mount.rotation()
    shares = []
    for points, project, distant in (
        (directions, truth.project_directions, True),
        (directions * random.uniform(300, 2000, (400, 1)), truth.project, False),
    ):
        true = project(points)
        image = model.image(points[true.valid] @ to_camera, distant=distant)
        error = np.linalg.norm(image.pixels - true.pixels[true.valid], axis=1)
        spread = image.d_parameters @ covariance @ image.d_parameters.transpose(0, 2, 1)
        shares.append(float((error < 3 * np.sqrt(np.linalg.eigvalsh(spread)[:, -1])).mean()))
    return shares[0], shares[1]


def calibrated(design: om.Sensor, free, seed: int):
    random = np.random.default_rng(seed)
    truth = misaligned(design, random)
    observations = om.simulate_detections(truth, BOARD, 12, noise_px=NOISE_PX, seed=seed)
    calibration = om.calibrate_camera(
        observations, BOARD, model=om.SensorModel(design, free), board_shape=False
    )
    return truth, calibration, random


def test_misaligned_mirror_is_estimated_from_drawing():
    truth, calibration, random = calibrated(om.load_sensor("paper-spherical"), USUAL, 1)
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)
    assert (
        min(shares_within_3_sigma(calibration.model, calibration.covariance, truth, random)) >= 0.95
    )
    assert isinstance(calibration.camera, om.Sensor)
    true = {p.name: p.value for p in om.SensorModel(truth, USUAL).parameters}
    assert all(abs(p.value - true[p.name]) < 4 * p.sigma for p in calibration.parameters)


@pytest.mark.full  # a mirror of the initial size; unknown mirrors are tested below
@pytest.mark.parametrize("scale", [0.3, 2.5])
def test_mirror_size_is_estimated(scale):
    """The size follows from the variation of its viewpoint; distant objects are then as accurate as
    the boards."""
    design = om.load_sensor("paper-spherical")
    mirror, distance = design.mirror, scale * design.mirror_distance_mm
    truth = replace(
        design,
        mirror=replace(
            mirror, radius_mm=scale * mirror.radius_mm, rim_radius_mm=scale * mirror.rim_radius_mm
        ),
        mirror_distance_mm=distance,
        lens=replace(design.lens, focus_distance_mm=distance),
    )
    board = om.Board("chessboard", 11, 7, 60.0)
    calibration = om.calibrate_camera(
        om.simulate_detections(truth, board, 12, seed=3), board, model="sensor"
    )
    assert calibration.held_out_rms_px < 1.1 * np.sqrt(2) * NOISE_PX
    radius = next(p for p in calibration.parameters if p.name == "mirror.vertex_radius_mm")
    assert abs(radius.value - truth.mirror.radius_mm) < 3 * radius.sigma
    assert abs(radius.value - mirror.radius_mm) > 5 * radius.sigma  # not the initial size
    assert radius.sigma < 0.3 * truth.mirror.radius_mm


@pytest.mark.full  # test_surveys covers the same mirror with fewer points
def test_mirror_with_nearly_single_viewpoint_is_estimated_without_size():
    observations = om.simulate_detections(
        om.load_sensor("paper-hyperboloidal"), BOARD, 12, noise_px=NOISE_PX, seed=1
    )
    calibration = om.calibrate_camera(observations, BOARD, model="sensor")
    assert calibration.held_out_rms_px < 1.1 * np.sqrt(2) * NOISE_PX


@pytest.mark.full  # uncertainties of a known mirror, above, use the same code
def test_unknown_mirror_has_consistent_uncertainty():
    """Distance and focal length are conventions; unobservable parameters are reported, and the
    uncertainty covers the error."""
    design = om.load_sensor("paper-spherical")
    truth = replace(design, mirror_pose=MirrorPose(0.8, -0.5, 0.0, 0.6, 0.0))
    board = om.Board("chessboard", 11, 7, 60.0)
    observations = om.simulate_detections(truth, board, 14, noise_px=NOISE_PX, seed=2)
    calibration = om.calibrate_camera(observations, board, model="sensor", board_shape=False)
    assert calibration.held_out_rms_px < 1.15 * np.sqrt(2) * NOISE_PX
    pitch = (
        calibration.camera.imager.pixel_pitch_um / truth.imager.pixel_pitch_um
    )  # a convention that scales the lens
    true = {
        "mirror.vertex_radius_mm": design.mirror.radius_mm,
        "lens.focal_length_mm": pitch * design.lens.focal_length_mm,
        "mount.mirror_distance_mm": design.mirror_distance_mm,
    }
    estimates = {p.name: p for p in calibration.parameters}
    assert all(
        abs(estimates[name].value - value) < 3 * estimates[name].sigma
        for name, value in true.items()
    )
    free, *others = calibration.free  # from the least to better determined combinations
    assert set(free.names) == {"lens.focal_length_mm", "mount.mirror_distance_mm"}
    assert all(free.sigma_px > other.sigma_px for other in others), others
    note, *_ = [n for n in calibration.notes if n.startswith("The images do not determine")]
    assert "mount.mirror_distance_mm larger by" in note
    assert " mm (one standard deviation) fits nearly as well." in note


@pytest.mark.full  # test_surveys covers an unknown mirror with fewer points
def test_unknown_mirror_under_telecentric_lens_has_consistent_uncertainty():
    pose = MirrorPose(1.0, -1.2, 0.0, 1.5, -0.8)
    truth = replace(om.load_sensor("paraboloid-telecentric"), mirror_pose=pose)
    observations = om.simulate_detections(truth, BOARD, 14, noise_px=NOISE_PX, seed=3)
    calibration = om.calibrate_camera(observations, BOARD, model="sensor", board_shape=False)
    assert calibration.held_out_rms_px < 1.1 * np.sqrt(2) * NOISE_PX


def test_spline_models_follow_mirror_with_low_rim_resolution():
    observations = om.simulate_detections(
        om.load_sensor("paper-hyperboloidal"), BOARD, 12, noise_px=NOISE_PX, seed=1
    )
    calibration = om.calibrate_camera(observations, BOARD, model="radial-spline", board_shape=False)
    assert calibration.held_out_rms_px < 1.1 * np.sqrt(2) * NOISE_PX


def aligned_shares_within_3_sigma(
    model, covariance, truth: om.Sensor, random
) -> tuple[float, float]:
    """Return the same for a camera with an arbitrary frame: aligned to the truth at the boards, 0.3
    to 2 m away.

    The six parameters of the alignment, found by least squares, are projected out of the covariance
    too. The field of the model ends at the outermost corners of the boards; points beyond it are
    not compared.
    """
    directions = random.normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    near, to_camera = directions * random.uniform(300, 2000, (400, 1)), truth.mount.rotation()
    true_near, true_far = truth.project(near), truth.project_directions(directions)
    near, far = near[true_near.valid] @ to_camera, directions[true_far.valid] @ to_camera

    def image(pose, points, distant):
        return model.image(
            points @ rotation_of(pose[:3]).T + (0 if distant else 100 * pose[3:]), distant=distant
        )

    def pixel_differences(pose):
        return np.nan_to_num(
            image(pose, near, False).pixels - true_near.pixels[true_near.valid], nan=50.0
        ).ravel()

    starts = [np.array([0, 0, 0, 0, 0, shift]) for shift in np.linspace(-3, 3, 61)]
    initial_pose = min(
        starts, key=lambda pose: np.sum(np.clip(pixel_differences(pose), -20, 20) ** 2)
    )
    pose = least_squares(
        pixel_differences, least_squares(pixel_differences, initial_pose, loss="soft_l1").x
    ).x

    def compared(points, pixels, distant):
        """Return image and pose derivatives of the points in the field, and their true pixels."""
        steps = 1e-4 * np.eye(6)
        moved = [
            [image(pose + sign * s, points, distant).pixels for sign in (1, -1)] for s in steps
        ]
        derivatives = np.stack([(a - b) / 2e-4 for a, b in moved], axis=-1)
        in_field = np.isfinite(derivatives).all(axis=(1, 2))
        assert in_field.mean() > 0.8
        projection = image(pose, points[in_field], distant)
        return projection, derivatives[in_field].reshape(-1, 6), pixels[in_field]

    count = len(covariance)
    near_pixels, far_pixels = true_near.pixels[true_near.valid], true_far.pixels[true_far.valid]
    near_image, near_derivatives, near_pixels = compared(near, near_pixels, False)
    pose_response = np.linalg.pinv(near_derivatives) @ near_image.d_parameters.reshape(-1, count)
    shares = []
    for projection, derivatives, pixels in (
        compared(far, far_pixels, True),
        (near_image, near_derivatives, near_pixels),
    ):
        residual_derivatives = (
            projection.d_parameters.reshape(-1, count) - derivatives @ pose_response
        ).reshape(-1, 2, count)
        sigma = np.sqrt(
            np.linalg.eigvalsh(
                residual_derivatives @ covariance @ residual_derivatives.transpose(0, 2, 1)
            )[:, -1]
        )
        length = np.linalg.norm(projection.pixels - pixels, axis=1)
        shares.append(float((length < 3 * sigma).mean()))
    return shares[0], shares[1]


@pytest.mark.full
@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal"])
@pytest.mark.parametrize("part", range(3))
def test_truth_lies_within_3_sigma_of_unknown_mirror(part, name):
    """Unknown kind and size, with an estimated principal point."""
    shares = []
    for seed in range(4 * part, 4 * part + 4):
        random = np.random.default_rng(seed)
        truth = misaligned(om.load_sensor(name), random)
        observations = om.simulate_detections(truth, BOARD, 12, noise_px=NOISE_PX, seed=seed)
        calibration = om.calibrate_camera(observations, BOARD, model="sensor", board_shape=False)
        shares.append(
            aligned_shares_within_3_sigma(calibration.model, calibration.covariance, truth, random)
        )
    assert (np.mean(shares, axis=0) >= 0.95).all(), shares


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "free"), CASES, ids=lambda case: "-".join(case) if isinstance(case, tuple) else case
)
def test_truth_lies_within_3_sigma_over_50_seeds(name, free):
    shares, deviations = [], []
    for seed in range(50):
        truth, calibration, random = calibrated(om.load_sensor(name), free, seed)
        shares.append(
            shares_within_3_sigma(calibration.model, calibration.covariance, truth, random)
        )
        true = {p.name: p.value for p in om.SensorModel(truth, free).parameters}
        deviations += [abs(p.value - true[p.name]) / p.sigma for p in calibration.parameters]
    assert (np.mean(shares, axis=0) >= 0.95).all(), shares
    assert np.mean(np.array(deviations) < 3) >= 0.95


@pytest.mark.full
def test_tangential_distortion_does_not_replace_mirror_pose():
    truth, calibration, _ = calibrated(om.load_sensor("paper-hyperboloidal"), SHAPE_PARAMETERS, 4)
    observations = om.simulate_detections(truth, BOARD, 12, noise_px=NOISE_PX, seed=4)
    for substitute in ("unified", "radial-spline", "viewpoint-spline"):
        other = om.calibrate_camera(observations, BOARD, model=substitute, board_shape=False)
        assert calibration.held_out_rms_px < 0.8 * other.held_out_rms_px, substitute


@pytest.mark.full
def test_mirror_model_is_selected_without_priors():
    truth = misaligned(om.load_sensor("paper-hyperboloidal"), np.random.default_rng(3))
    observations = om.simulate_detections(truth, BOARD, 14, noise_px=NOISE_PX, seed=3)
    calibration = om.calibrate_camera(observations, BOARD)
    assert calibration.model.KIND == "sensor"
    assert calibration.held_out_rms_px < 1.1 * np.sqrt(2) * NOISE_PX
    by_kind = {candidate.kind: candidate for candidate in calibration.candidates}
    assert by_kind["sensor"].rms_px < by_kind["radial-spline"].rms_px
