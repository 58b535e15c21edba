"""Bundle adjustment against ground truth: all kinds of observations, outliers, priors, and the
Gauss covariance."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.calibration.estimation._accuracy import uncertainty
from omnimirror.calibration.estimation._bundle_adjustment import bundle_adjust
from omnimirror.calibration.estimation.observations import (
    UNSEEN_PX,
    BoardShape,
    Estimate,
    Linearised,
    Loss,
    Observation,
    RigidTransform,
    eliminate_line_positions,
    linearise,
    moved,
    residuals_at_poses,
    rotation_of,
    slide_steps,
    stacked,
    targets,
)
from omnimirror.cameras.models import Unified
from omnimirror.cameras.models.camera_model import direction_sigma_deg

from .cases import BOARD, SIZE, TRUTH, detections, directions, known_points

START = Unified(xi=1.0, focal_px=(170.0, 170.0), centre_px=(319.5, 239.5), image_size=SIZE)
VALUES = np.array([p.value for p in TRUTH.parameters])


def scene_points(count: int = 300, seed: int = 0) -> np.ndarray:
    """Return points around the camera, mm, in its frame."""
    return directions(TRUTH, count, seed) * np.random.default_rng(seed).uniform(
        500, 3000, (count, 1)
    )


def test_known_points_recover_camera():
    points = scene_points()
    fit = bundle_adjust(START, [known_points(TRUTH.image(points).pixels, points)])
    assert fit.rms_px < 1e-6
    assert [p.value for p in fit.model.parameters] == pytest.approx(VALUES, rel=1e-5, abs=1e-6)


def test_stars_recover_camera_and_orientation():
    stars = directions(TRUTH)
    turn = RigidTransform(rotation_of(np.array([0.3, -0.2, 0.9])), np.zeros(3))
    observation = Observation(
        "night", TRUTH.image(stars, distant=True).pixels, stars @ turn.rotation, is_distant=True
    )
    initial_pose = RigidTransform(rotation_of(np.array([0.25, -0.25, 0.95])), np.zeros(3))
    fit = bundle_adjust(START, [observation.with_pose(initial_pose)])
    assert fit.rms_px < 1e-6
    pose = fit.observations[0].pose
    assert pose is not None
    assert pose.rotation == pytest.approx(turn.rotation, abs=1e-6)
    assert pose.translation_mm == pytest.approx(0.0)  # not determined by stars


def test_points_on_known_lines_recover_camera():
    """Plumb lines: the position of a pixel along its line is unknown and is estimated."""
    random = np.random.default_rng(2)
    on_lines = scene_points(400)
    along = random.normal(size=on_lines.shape)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    shifted_points = on_lines + random.uniform(-60, 60, (len(on_lines), 1)) * along
    observation = known_points(TRUTH.image(on_lines).pixels, shifted_points, along=along)
    fit = bundle_adjust(
        Unified(xi=1.0, focal_px=(162.0, 162.0), centre_px=(325.0, 237.0), image_size=SIZE),
        [observation],
    )
    assert fit.rms_px < 1e-5
    assert [p.value for p in fit.model.parameters] == pytest.approx(VALUES, rel=1e-3, abs=1e-4)


def test_points_follow_target_poses():
    """Residuals vanish for the true motion, and without a motion are those of the camera frame."""
    points = scene_points(20)
    pose = RigidTransform(rotation_of(np.array([0.1, -0.2, 0.3])), np.array([30.0, -20.0, 10.0]))
    pixels = TRUTH.image(pose(points)).pixels
    moved = Observation("moved", pixels, points, pose)
    assert np.abs(residuals_at_poses(TRUTH, [moved]).residuals).max() < 1e-9
    unmoved = residuals_at_poses(TRUTH, [replace(moved, pose=None)])
    np.testing.assert_allclose(
        np.abs(unmoved.residuals), np.abs(TRUTH.image(points).pixels - pixels), atol=1e-9
    )


def linearised_estimate(model=TRUTH, steps=None):
    """Return an estimate with all kinds of quantities, changed by steps (of model, board, marks;
    poses; lines), and its observations: near and distant points, lines, and marks in two images."""
    rng = np.random.default_rng(8)
    points, stars = scene_points(12), directions(TRUTH, 6, 3)
    pose = RigidTransform(rotation_of(np.array([0.1, -0.2, 0.3])), np.array([30.0, -20.0, 10.0]))
    mixed = Observation(
        "mixed",
        np.zeros((18, 2)),
        np.concatenate([points, stars * 2.0]),
        pose,
        is_distant=np.arange(18) // 12 == 1,
        along=np.tile([0.6, 0.0, 0.8], (18, 1)),
    )
    wall = [
        Observation(
            name,
            np.ones((4, 2)),
            points[:4] * [1, 1, 0] - [0, 0, 900.0],
            RigidTransform(pose.rotation, np.array([x, 0.0, 0.0])),
            normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
            is_surveyed=True,
        )
        for name, x in (("left", 40.0), ("right", -60.0))
    ]
    observations = [mixed, *wall]
    shared, poses, line_positions_mm = steps or (
        np.zeros(len(VALUES) + 13),
        np.zeros((3, 6)),
        np.zeros(26),
    )
    names = [p.name for p in model.parameters]
    shape = BoardShape.flat(points).with_values(
        rng.uniform(-0.1, 0.1, 5) + shared[len(names) : len(names) + 5]
    )
    model = model.with_parameters(VALUES + shared[: len(names)])
    moved_poses = moved([o.pose for o in observations], poses)
    marks = rng.uniform(-5, 5, 8) + shared[len(names) + 5 :]
    return Estimate(
        model, moved_poses, shape, rng.uniform(-5, 5, 26) + line_positions_mm, marks
    ), observations


def test_derivatives_match_central_differences():
    """By model, board shape, marks, poses and positions along lines."""
    estimate, observations = linearised_estimate()
    stack = stacked(observations)
    linear = linearise(estimate, stack)
    assert linear.visible.all()
    points = targets(estimate, stack)
    for i, pose in enumerate(estimate.poses):
        for k in range(26)[stack.slices[i]]:
            point = points[k] @ pose.rotation.T + (not stack.distant[k]) * pose.translation_mm
            pixel = estimate.model.image(point[None], distant=bool(stack.distant[k])).pixels[0]
            np.testing.assert_allclose(
                linear.residuals[k], pixel - stack.pixels[k], rtol=1e-12, atol=1e-9
            )
    count = len(VALUES) + 13
    sizes = np.concatenate([1e-5 * np.maximum(np.abs(VALUES), 1e-3), np.full(13, 1e-3)])
    zero = np.zeros(count), np.zeros((3, 6)), np.zeros(26)

    def difference(name, at, size):
        ends = []
        for sign in (1, -1):
            steps = [a.copy() for a in zero]
            steps[name][at] = sign * size
            ends.append(linearise(linearised_estimate(steps=tuple(steps))[0], stack).residuals)
        return (ends[0] - ends[1]) / (2 * size)

    for j in range(count):
        np.testing.assert_allclose(
            linear.d_shared[:, :, j], difference(0, j, sizes[j]), rtol=1e-5, atol=1e-5
        )
    for j in range(6):
        by_pose = difference(1, (slice(None), j), 1e-6 if j < 3 else 1e-3)
        np.testing.assert_allclose(linear.d_pose[:, :, j], by_pose, rtol=1e-5, atol=1e-6)
    assert linear.d_line_position is not None
    np.testing.assert_allclose(
        linear.d_line_position, difference(2, slice(None), 1e-3), rtol=1e-5, atol=1e-6
    )


class HalfFieldModel:
    """Camera model without images of points on the left."""

    def image_clamped(self, points, *, distant=False):
        image, is_hidden = TRUTH.image_clamped(points, distant=distant), points[:, 0] < 0
        hidden = (
            np.where(is_hidden.reshape(-1, *[1] * (a.ndim - 1)), np.nan, a) for a in image[::2]
        )
        pixels, d_points = hidden
        return image._replace(pixels=pixels, valid=image.valid & ~is_hidden, d_points=d_points)


@pytest.mark.parametrize("distant", [False, True, np.arange(12) % 3 == 0])
def test_invisible_points_have_no_residuals(distant):
    """Nor derivatives; near and distant ones, in any order."""
    points = scene_points(12)
    observation = known_points(np.zeros((12, 2)), points, is_distant=distant)
    complete, partial = (residuals_at_poses(m, [observation]) for m in (TRUTH, HalfFieldModel()))
    np.testing.assert_array_equal(partial.visible, points[:, 0] >= 0)
    assert 0 < partial.visible.sum() < 12
    for name in ("residuals", "d_shared", "d_pose"):
        part, full = getattr(partial, name), getattr(complete, name)
        np.testing.assert_array_equal(part[partial.visible], full[partial.visible])
        assert (part[~partial.visible] == 0).all()


def test_steps_along_lines_minimise_linear_residuals():
    """The residual after all steps is perpendicular to the image of each line; points stay."""
    estimate, observations = linearised_estimate()
    stack, rng = stacked(observations), np.random.default_rng(1)
    linear = linearise(estimate, stack)
    shared, poses = rng.normal(size=linear.d_shared.shape[2]), rng.normal(size=(3, 6))
    steps = slide_steps(linear, stack, shared, poses)
    after = linear.residuals + linear.d_shared @ shared + linear.d_line_position * steps[:, None]
    after += np.array([d @ poses[i] for d, i in zip(linear.d_pose, stack.owner, strict=True)])
    assert np.abs(np.sum(after * linear.d_line_position, axis=1)).max() < 1e-9 * np.abs(after).max()
    assert (steps[18:] == 0).all()
    assert (steps[:18] != 0).all()


def test_shape_of_a_board_is_relative_to_its_centre_and_size():
    """Aspect, shear, and terms in x^2, 2 x y and y^2 at 0.5 times the diagonal, here 50 mm."""
    corners = np.array([[x, y, 0.0] for x in (10.0, 90.0) for y in (30.0, 90.0)])
    flat = BoardShape.flat(corners)
    assert flat.centre_mm == (50.0, 60.0)
    assert flat.half_diagonal_mm == 50.0
    assert flat.values == (0.0,) * 5
    np.testing.assert_allclose(flat.sigmas, [0.003, 0.003, 0.5, 0.5, 0.5])  # 0.3 %, 1 % of 50 mm
    points = np.array([[90.0, 40.0, 7.0], [50.0, 60.0, 0.0]])  # (40, -20) mm from the centre
    for values, change in (
        ([0.1, 0, 0, 0, 0], [2.0, 1.0, 0.0]),  # wider by half of 10 %, and lower by the other half
        ([0, 0.1, 0, 0, 0], [-1.0, 2.0, 0.0]),
        ([0, 0, 2.0, 0, 0], [0.0, 0.0, 2.0 * 0.64]),
        ([0, 0, 0, 2.0, 0], [0.0, 0.0, -2.0 * 2 * 0.32]),
        ([0, 0, 0, 0, 2.0], [0.0, 0.0, 2.0 * 0.16]),
    ):
        moves = flat.with_values(values).deformed(points) - points
        np.testing.assert_allclose(moves, [change, [0.0, 0.0, 0.0]], atol=1e-12)
    bent = flat.with_values([0.375, 0, 0, 0, -0.75])  # exact in binary
    assert bent.is_flat_within(np.array([0.125, 1, 1, 1, 0.25]))
    assert not bent.is_flat_within(np.array([0.124, 1, 1, 1, 0.25]))
    assert not bent.is_flat_within(np.array([0.125, 1, 1, 1, 0.249]))


@pytest.mark.parametrize(
    ("kind", "loss"),
    [
        ("squares", lambda r: r**2),
        ("huber", lambda r: np.where(r < 2.0, r**2, 4 * (r - 1.0))),
        ("cauchy", lambda r: 4 * np.log(1 + r**2 / 4)),
    ],
)
def test_weights_are_derivatives_of_losses(kind, loss):
    """By r^2, for a scale of 2 px; all losses equal the squares of small residuals."""
    radii, scaled = np.array([0.0, 1e-3, 0.5, 1.9, 2.1, 3.0, 40.0]), Loss("".join(kind), 2.0)
    residuals = radii[:, None] * [0.6, -0.8]
    assert scaled.sum(residuals) == pytest.approx(loss(radii).sum(), rel=1e-12)
    weights = scaled.weights(residuals)
    rates = (loss(radii + 1e-6) - loss(np.abs(radii - 1e-6))) / (4e-6 * np.maximum(radii, 1e-9))
    np.testing.assert_allclose(weights[1:], rates[1:], rtol=1e-6)
    assert weights[0] == 1.0
    assert Loss() == Loss("squares", 1.0)


def test_invisible_points_have_the_largest_residuals():
    assert np.hypot(*SIZE) < UNSEEN_PX == 1000.0


@pytest.mark.parametrize("rate", [1e-3, 1.0, 50.0])
def test_displacement_along_line_image_is_no_residual(rate):
    """Any pixel displacement per millimetre along the line is supported, including a line imaged
    end-on."""
    line_positions_mm = rate * np.array([[0.6, 0.8], [-0.8, 0.6], [0.0, 0.0]])
    both = np.array([[3.0, 4.0], [3.0, 4.0], [3.0, 4.0]])
    linear = eliminate_line_positions(
        Linearised(
            both,
            np.ones(3, bool),
            both[:, :, None] * [1.0, -2.0],
            np.tile(both[:, :, None], 6),
            line_positions_mm,
        )
    )
    expected = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0]])
    np.testing.assert_allclose(linear.residuals, expected, atol=1e-14)
    np.testing.assert_allclose(linear.d_shared, expected[:, :, None] * [1.0, -2.0], atol=1e-14)
    np.testing.assert_allclose(linear.d_pose, np.tile(expected[:, :, None], 6), atol=1e-14)


def drive(count: int = 6) -> tuple[np.ndarray, list[RigidTransform]]:
    """Return marks on the floor and two walls of a room, mm, and the poses of the room relative to
    a moving camera."""
    random = np.random.default_rng(6)
    marks = random.uniform(-900, 900, (60, 3))
    marks[:30, 2] = -700.0
    marks[30:45, 0], marks[45:, 1] = 1500.0, -1400.0
    turns = [rotation_of(np.array([0.0, 0.0, a])) for a in random.uniform(-3, 3, count)]
    return marks, [
        RigidTransform(t, np.append(random.uniform(-300, 300, 2), 40.0 * i))
        for i, t in enumerate(turns)
    ]


def test_marks_on_known_planes_recover_camera_and_positions():
    """A robot with known trajectory: marks are only known to be on the floor and the walls."""
    marks, poses = drive()
    normals = np.repeat([[0.0, 0.0, 1.0], [2.0, 0.0, 0.0], [0.0, -1.0, 0.0]], [30, 15, 15], axis=0)
    axes = np.stack([np.roll(normals, 1, axis=1), np.roll(normals, 2, axis=1)], axis=1)
    shifts = np.random.default_rng(3).uniform(-30, 30, (60, 1, 2)) @ axes / 2
    ids = 100 + np.arange(60)
    observations = [
        Observation(
            f"{i}",
            TRUTH.image(pose(marks)).pixels,
            marks + shifts[:, 0],
            pose,
            is_known=True,
            normals=normals,
            ids=ids,
        )
        for i, pose in enumerate(poses)
    ]
    fit = bundle_adjust(
        Unified(xi=1.0, focal_px=(162.0, 162.0), centre_px=(325.0, 237.0), image_size=SIZE),
        observations,
    )
    assert fit.rms_px < 1e-5
    assert [p.value for p in fit.model.parameters] == pytest.approx(VALUES, rel=1e-3, abs=1e-4)
    assert fit.observations[2].points == pytest.approx(marks, abs=0.01)
    assert fit.names[-2:] == ("mark 159 x", "mark 159 y")
    assert len(uncertainty(fit).sigmas) == len(VALUES) + 120


def test_marks_in_one_image_or_on_two_planes_raise():
    marks, poses = drive(2)
    up = np.tile([0.0, 0.0, 1.0], (60, 1))
    one, other = (
        Observation(str(i), TRUTH.image(w(marks)).pixels, marks, w, normals=up)
        for i, w in enumerate(poses)
    )
    with pytest.raises(
        om.base.errors.InvalidParameter,
        match="mark 7 on a plane must be observed in at least two images",
    ):
        bundle_adjust(START, [one, other.subset(np.arange(60) != 7)])
    with pytest.raises(om.base.errors.InvalidParameter, match="mark 0 must be on one plane"):
        bundle_adjust(START, [one, replace(other, points=marks + np.array([0.0, 0.0, 5.0]))])


def test_near_and_distant_points_are_adjusted_jointly():
    points, stars = scene_points(100), directions(TRUTH, 100, 3)
    sky = known_points(TRUTH.image(stars, distant=True).pixels, stars, is_distant=True)
    fit = bundle_adjust(START, [known_points(TRUTH.image(points).pixels, points), sky])
    assert fit.rms_px < 1e-6


def test_gross_errors_do_not_move_the_camera():
    points = scene_points()
    pixels = TRUTH.image(points).pixels + np.random.default_rng(1).normal(0, 0.1, (len(points), 2))
    pixels[::10] += 30.0
    robust = bundle_adjust(START, [known_points(pixels, points)], loss="cauchy").model
    squares = bundle_adjust(START, [known_points(pixels, points)]).model
    errors = [
        np.abs(m.image(points).pixels - TRUTH.image(points).pixels).max() for m in (robust, squares)
    ]
    assert errors[0] < 0.15 < 1.0 < errors[1]


def test_fixed_parameters_and_priors():
    points = scene_points()
    observation = known_points(
        TRUTH.image(points).pixels + np.random.default_rng(1).normal(0, 0.1, (len(points), 2)),
        points,
    )
    fixed = bundle_adjust(
        START, [observation], fixed=["k1"], priors=[om.Prior("cx", 330.0, 0.0)]
    ).model
    assert (fixed.k1, fixed.centre_px[0]) == (0.0, 330.0)
    free = bundle_adjust(START, [observation])
    sigma = float(uncertainty(free).sigmas[4])
    middle = free.model.centre_px[0]
    pulled = bundle_adjust(
        START, [observation], priors=[om.Prior("cx", middle + 4 * sigma, sigma)]
    ).model
    assert pulled.centre_px[0] == pytest.approx(
        middle + 2 * sigma, abs=0.15 * sigma
    )  # two sources of equal weight


@pytest.mark.full
def test_covariance_matches_repeated_noise():
    points = scene_points(120)
    axes = directions(TRUTH, 5, 8)
    model, exact = TRUTH, TRUTH.image(points).pixels
    pixels, sigmas, deviations = TRUTH.image(axes).pixels, [], []
    for seed in range(40):
        noisy = exact + np.random.default_rng(seed).normal(0, 0.2, exact.shape)
        fit = bundle_adjust(model, [known_points(noisy, points)])
        spread = uncertainty(fit)
        sigmas.append(spread.sigmas)
        deviations.append(np.array([p.value for p in fit.model.parameters]) - VALUES)
        assert fit.noise_px == pytest.approx(0.2, rel=0.25)
        rays = fit.model.backproject(pixels)
        angle = np.degrees(
            np.linalg.norm(rays.directions @ fit.model.mount.rotation() - axes, axis=1)
        )
        assert (angle < 4 * direction_sigma_deg(fit.model, spread.covariance, axes)).all()
    # The mean is dominated by single draws with a long valley of the weakly determined distortion
    assert np.std(deviations, axis=0) == pytest.approx(np.median(sigmas, axis=0), rel=0.45)


def test_undetermined_combinations_are_reported():
    """Points on a cone about the axis have one radius: focal lengths, xi and distortion are not
    separable."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    cone = np.stack([np.cos(angle), np.sin(angle), np.full(60, -0.3)], axis=1) * 1000
    pixels = TRUTH.image(cone).pixels + np.random.default_rng(0).normal(0, 0.1, (60, 2))
    combinations = uncertainty(bundle_adjust(TRUTH, [known_points(pixels, cone)])).free
    named = {name for combination in combinations for name in combination.names}
    assert {"xi", "k1", "k2"} <= named
    assert not {"cx", "cy"} & named


@pytest.mark.full
@pytest.mark.long
def test_board_shape_is_estimated():
    bent = BoardShape.flat(BOARD.points_mm).with_values([0.002, -0.001, 1.5, 0.8, -0.7])
    observations = detections(count=8, noise_px=0.05, points_mm=bent.deformed(BOARD.points_mm))
    calibration = om.calibrate_camera(observations, BOARD, model="unified")
    assert calibration.shape is not None
    sigmas = np.array([p.sigma for p in calibration.parameters[-5:]])
    assert (np.abs(np.array(calibration.shape.values) - bent.values) < 4 * sigmas).all()
    assert (np.abs(bent.values) > 3.5 * sigmas).all()  # determined by the data, not by the prior
    flat = om.calibrate_camera(observations, BOARD, model="unified", board_shape=False)
    assert flat.held_out_rms_px > 1.3 * calibration.held_out_rms_px


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: bundle_adjust(START, []), "observations must contain"),
        (
            lambda s: bundle_adjust(START, [s], fixed=["k9"]),
            "parameters of the model .*xi, fx.*; got 'k9'",
        ),
        (
            lambda s: bundle_adjust(START, [Observation("room", s.pixels, s.points)]),
            "initial pose; missing for room",
        ),
        (
            lambda s: bundle_adjust(START, [s], loss="tukey"),
            "loss must be one of squares, cauchy, huber; got 'tukey'",
        ),
        (
            lambda s: known_points(s.pixels, s.points[1:]),
            r"room: pixels .* got \(300, 2\) and \(299, 3\)",
        ),
        (
            lambda s: known_points(s.pixels, s.points, along=s.points[1:]),
            r"room: along must be 300 nonzero directions .* got shape \(299, 3\)",
        ),
        (
            lambda s: known_points(s.pixels, s.points, normals=0 * s.points),
            "room: normals .* directions",
        ),
        (
            lambda s: known_points(s.pixels, s.points, normals=s.points, along=s.points),
            "normals must not be combined",
        ),
    ],
)
def test_invalid_adjustments_raise(call, message):
    points = scene_points()
    with pytest.raises(om.base.errors.InvalidParameter, match=message):
        call(known_points(TRUTH.image(points).pixels, points))


SCRIPT = """
import time
import numpy as np
from omnimirror.calibration.estimation._bundle_adjustment import assembled
from omnimirror.calibration.estimation.observations import Observation, stacked
points = np.random.default_rng(0).normal(size=(108, 3))
stack = stacked([Observation(str(i), points[:, :2], points) for i in range(17)])
a, b = np.ones((len(stack.owner), 2, 18)), np.ones((len(stack.owner), 2, 6))
others = time.thread_time() - time.process_time()
for _ in range(300):
    assembled(stack, a[..., 0], a, b, np.ones(len(a)), np.ones(17, bool))
print(others + time.process_time() - time.thread_time())
"""


@pytest.mark.full
def test_normal_equations_start_no_blas_threads():
    """BLAS threads would spin for longer than the products take, and under load all wait for one
    another."""
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True
    )
    assert float(run.stdout) < 1e-3
