"""Calibration from corners to the camera, against the true camera; insufficient data are rejected
with a reason."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.estimation.observation_checks import coverage, recommendations
from omnimirror.calibration.estimation.observations import Observation
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models.camera_model import direction_covariance

from .cases import BOARD, NOISE_PX, SIZE, TRUTH, detections, directions


def calibrated(observations, **more):
    return om.calibrate_camera(observations, BOARD, **({"model": "unified"} | more))


def test_camera_is_estimated_without_initial_value():
    calibration = calibrated(detections(count=8))
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)
    assert calibration.rms_px < calibration.held_out_rms_px < 1.15 * calibration.rms_px
    assert all(p.used and p.reason is None for p in calibration.images)
    assert calibration.corners == sum(p.found for p in calibration.images)
    assert calibration.outliers == ()
    assert {name for free in calibration.free for name in free.names} <= {
        "xi",
        "fx",
        "fy",
        "k1",
        "k2",
        "k3",
    }


def within_3_sigma(seed: int) -> float:
    """Return the fraction of directions with errors within three standard deviations, in the
    perpendicular plane."""
    calibration = calibrated(detections(count=8, seed=seed), board_shape=False)
    directions_in_world = directions(TRUTH, 100, seed)
    rays = calibration.model.backproject(TRUTH.image(directions_in_world, distant=True).pixels)
    errors = (rays.directions @ calibration.model.mount.rotation() - directions_in_world)[
        rays.valid
    ]
    spread = np.linalg.eigvalsh(
        direction_covariance(
            calibration.model, calibration.covariance, directions_in_world[rays.valid]
        )
    )[:, -1]
    return float((np.linalg.norm(errors, axis=1) < 3 * np.sqrt(spread)).mean())


def test_true_directions_lie_within_three_sigma():
    assert np.mean([within_3_sigma(seed) for seed in range(1)]) >= 0.95


@pytest.mark.full
def test_true_directions_lie_within_three_sigma_over_50_seeds():
    assert np.mean([within_3_sigma(seed) for seed in range(50)]) >= 0.95


@pytest.mark.full
def test_field_ends_at_specified_rim():
    """The region outside is excluded from the camera; its parameters are unchanged."""
    observations = detections(count=4)
    limited, unlimited = (
        calibrated(observations, board_shape=False, **rim) for rim in ({"rim_radius_px": 170.0}, {})
    )
    u, v = limited.model.centre_px
    edge = limited.camera.backproject([[u + 169.0, v], [u + 171.0, v]])
    assert edge.valid.tolist() == [True, False]
    assert unlimited.camera.backproject([[u + 171.0, v]]).valid.all()
    assert limited.model.parameters == unlimited.model.parameters
    with pytest.raises(
        InvalidParameter, match=r"rim_radius_px must be greater than 0 px.*; got -1"
    ):
        calibrated(observations, rim_radius_px=-1.0)


@pytest.mark.full
@pytest.mark.parametrize("shift", [(90.0, 0.0), (-60.0, 50.0)])
def test_axis_far_from_image_centre_is_estimated(shift):
    centre = (319.5 + shift[0], 239.5 + shift[1])
    calibration = calibrated(detections(replace(TRUTH, centre_px=centre), 6), board_shape=False)
    assert calibration.model.centre_px == pytest.approx(centre, abs=1.0)


def test_fisheye_and_flipped_image_are_calibrated():
    for camera in (
        replace(TRUTH, optics="fisheye"),
        replace(TRUTH, mount=Mount("down", 30.0, image_flipped=True)),
    ):
        calibration = calibrated(
            detections(camera, 4), optics=camera.optics, mount=camera.mount, board_shape=False
        )
        assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)
        assert calibration.model.mount == camera.mount


@pytest.mark.full
def test_fisheye_model_is_selected_without_mirror():
    truth = om.KannalaBrandt(
        focal_px=(150.0, 150.0), centre_px=(322.0, 238.0), image_size=SIZE, k1=0.02, k2=-0.004
    )
    calibration = calibrated(
        detections(truth, 5), model="auto", optics="fisheye", board_shape=False
    )
    assert "sensor" not in {candidate.kind for candidate in calibration.candidates}
    assert calibration.held_out_rms_px < 1.15 * np.sqrt(2) * NOISE_PX


def test_only_displaced_corners_are_rejected():
    observations = detections(count=8)
    shifts = {("image 3", 20): 4.0, ("image 7", 5): 1.2, ("image 7", 40): -2.0}
    for (name, corner), shift in shifts.items():
        detection = next(d for d in observations if d.name == name)
        detection.corners_px[list(detection.ids).index(corner)] += [shift, 0.0]
    calibration = calibrated(observations)
    assert {(o.image, o.corner) for o in calibration.outliers} == set(shifts)
    worst = calibration.outliers[0]
    assert (worst.image, worst.corner) == ("image 3", 20)
    assert worst.residual_px == pytest.approx(4.0, abs=0.5)
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)


@pytest.mark.parametrize(
    ("share", "largest_px"),
    [
        (0.04, 1.2),
        pytest.param(0.01, 5.0, marks=pytest.mark.full),
        pytest.param(0.04, 5.0, marks=pytest.mark.full),
        pytest.param(0.08, 4.0, marks=pytest.mark.full),
    ],
)
def test_displaced_corners_are_rejected_or_reported(share, largest_px):
    """Outliers up to 5 % are rejected; a note counts and locates those that remain."""
    random, shifted, observations = np.random.default_rng(0), set(), []
    for detection in detections(count=10, seed=1):
        is_wrong = random.random(len(detection.ids)) < share
        angle = random.uniform(0, 2 * np.pi, len(is_wrong))
        length = is_wrong * random.uniform(0.6, 1.0, len(is_wrong)) * largest_px
        shift = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        shifted |= {(detection.name, int(i)) for i in detection.ids[is_wrong]}
        observations.append(replace(detection, corners_px=detection.corners_px + shift))
    calibration = calibrated(observations)
    rejected = {(o.image, o.corner) for o in calibration.outliers}
    remaining = {(o.image, o.corner) for o in calibration.remaining_outliers}
    assert rejected <= shifted
    assert len(remaining - shifted) <= 1
    assert len(shifted - rejected - remaining) <= 0.1 * len(shifted)
    notes = [note for note in calibration.notes if "residuals above the noise" in note]
    assert len(notes) == (1 if remaining else 0)
    if remaining:
        assert notes[0].startswith(f"{len(remaining)} of the used corners")
        assert calibration.remaining_outliers[0].image in notes[0]
    else:
        assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)
    assert len(calibration.to_dict()["remaining_outliers"]) == len(remaining)


@pytest.mark.parametrize(
    ("xi", "seeds"), [(0.95, 4), pytest.param(0.95, 30, marks=[pytest.mark.full, pytest.mark.long])]
)
def test_reported_deviations_match_scatter_over_seeds(xi, seeds):
    """Free unified model, with a curved valley of xi, focal length and radial terms.

    With the curvature at the estimate, RMS errors of xi were 3 standard deviations, and a
    combination was reported for some seeds only.
    """
    truth = replace(TRUTH, xi=xi, focal_px=(160.0, 160.0), k1=0.0, k2=0.0, p1=0.0, p2=0.0)
    errors = []
    for seed in range(seeds):
        calibration = calibrated(detections(truth, count=8, seed=seed))
        true_values = np.array([p.value for p in truth.parameters])
        sigmas = np.array([p.sigma for p in calibration.parameters[: len(true_values)]])
        errors.append(
            (np.array([p.value for p in calibration.model.parameters]) - true_values) / sigmas
        )
        assert {"xi", "k1"} <= set(calibration.free[0].names)
        assert any(
            "do not determine xi" in note or "do not determine k1" in note
            for note in calibration.notes
        )
        assert calibration.camera.uncertainty.sigmas["xi"] == pytest.approx(
            calibration.parameters[0].sigma
        )
    rms = dict(
        zip(
            (p.name for p in truth.parameters),
            np.sqrt(np.mean(np.square(errors), axis=0)),
            strict=True,
        )
    )
    allowance = 4 / seeds
    for name in ("xi", "fx", "fy", "k1", "cx", "cy"):
        assert 0.4 - 0.3 * allowance < rms[name] < 1.5 + 0.5 * allowance, name
    assert max(rms.values()) < 1.5 + 0.7 * allowance


def test_equal_minimum_contributes_to_deviations():
    """A model with three radial terms and xi = 1.14 fits the corners of a camera with 1.3 equally
    well."""
    truth = replace(TRUTH, xi=1.3, focal_px=(160.0, 160.0), k1=0.0, k2=0.0, p1=0.0, p2=0.0)
    calibration = calibrated(detections(truth, count=12, seed=0))
    xi = calibration.parameters[0]
    assert abs(xi.value - 1.3) < 3 * xi.sigma
    linear = float(np.sqrt(calibration.covariance[0, 0]))
    assert xi.sigma > 2 * linear


@pytest.mark.full
def test_close_minimum_contributes_to_deviations():
    """The fit ends at xi = 1.03; a minimum of equal depth at 1.10, beyond a barrier, is the truth.
    Its error was 10 standard deviations, and no combination was reported."""
    truth = replace(TRUTH, xi=1.1, focal_px=(175.0, 175.0), k1=0.0, k2=0.0, p1=0.0, p2=0.0)
    calibration = calibrated(detections(truth, count=9, seed=102))
    xi = calibration.parameters[0]
    assert abs(xi.value - 1.1) < 3 * xi.sigma < 0.3
    assert {"xi", "k1"} <= set(calibration.free[0].names)


def test_board_numbering_from_any_corner_is_equivalent():
    """Detectors start at either end of 11 x 7 corners, and number them in reverse in a mirror
    image."""
    observations = detections(count=4, points_mm=BOARD.points_mm)
    columns, rows = BOARD.lattice.T
    orders = [
        columns + 11 * rows,
        76 - columns - 11 * rows,
        10 - columns + 11 * rows,
        columns + 11 * (6 - rows),
    ]
    renamed = [replace(d, ids=orders[i % 4][d.ids]) for i, d in enumerate(observations)]
    assert calibrated(renamed).rms_px == pytest.approx(calibrated(observations).rms_px, rel=1e-3)


def test_inconsistent_image_is_rejected():
    observations = detections(count=8)
    random = np.random.default_rng(0)
    observations[4] = replace(
        observations[4],
        corners_px=observations[4].corners_px
        + random.normal(0, 15, observations[4].corners_px.shape),
    )
    observations.append(
        om.Detection(
            "blurred.png", SIZE, reason="blurred.png: no board was found; the image is blurred"
        )
    )
    calibration = calibrated(observations)
    reasons = {p.name: p.reason for p in calibration.images if not p.used}
    assert reasons.keys() == {"image 5", "blurred.png"}
    assert "the median residual of its corners" in reasons["image 5"]
    assert "is blurred" in reasons["blurred.png"]
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)


@pytest.mark.parametrize(
    ("optics", "pattern"),
    [
        ("mirror", "the mirror centre is .* from that in the other images: the mirror moved"),
        ("fisheye", "the optical centre is .* from that in the other images: the lens moved"),
    ],
)
def test_image_with_moved_mirror_is_rejected(optics, pattern):
    """A pose absorbs most of a shift; the residual reveals it."""
    observations = moved(detections(replace(TRUTH, optics=optics), count=8), {4}, [9.0, -4.0])
    calibration = calibrated(observations, optics=optics)
    (rejected,) = [p for p in calibration.images if not p.used]
    assert rejected.name == "image 5"
    assert re.search(pattern, rejected.reason)
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)
    assert calibration.outliers == ()


@pytest.mark.parametrize(
    ("count", "numbers"),
    [
        (5, {2}),
        *(
            pytest.param(*case, marks=pytest.mark.full)
            for case in [(8, {4}), (12, {0}), (9, {1, 2, 3})]
        ),
    ],
)
def test_flipped_images_are_rejected(count, numbers):
    """The mirror image of a chessboard is a chessboard: only the offset between mirror and image
    centres reveals the flip, and camera and poses absorb nearly all of it."""
    calibration = calibrated(flipped(detections(count=count), numbers))
    reasons = {p.name: p.reason for p in calibration.images if not p.used}
    assert reasons.keys() == {f"image {number + 1}" for number in numbers}
    assert set(reasons.values()) == {
        "it fits the other images only after flipping left to right: it was flipped"
    }
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(6))
def test_unflipped_images_are_not_rejected(seed):
    """Also for a mirror without a single viewpoint, with single-viewpoint models."""
    observations = om.simulate_detections(
        om.load_sensor("paper-spherical"), BOARD, 4 + seed, noise_px=NOISE_PX, seed=seed
    )
    for model in ("unified", "auto"):
        assert all(p.used for p in om.calibrate_camera(observations, BOARD, model=model).images)
    assert all(p.used for p in calibrated(detections(count=4 + seed, seed=seed)).images)


@pytest.mark.parametrize(
    ("count", "seed"),
    [
        (5, 2),
        *(
            pytest.param(count, seed, marks=pytest.mark.full)
            for count in (4, 6)
            for seed in range(12)
        ),
    ],
)
def test_few_images_recover_camera(count, seed):
    """Five images led to no solution, with residuals of 1.5 px, if all mirror parameters were free
    too early."""
    random = np.random.default_rng([count, seed])
    middle = (
        (326.0, 236.0) if seed == 2 else tuple(np.array([319.5, 239.5]) + random.uniform(-8, 8, 2))
    )
    calibration = calibrated(detections(replace(TRUTH, centre_px=middle), count=count, seed=seed))
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.15)
    np.testing.assert_allclose(calibration.model.centre_px, middle, atol=3.0)


@pytest.mark.full
def test_overfitting_is_noted():
    calibration = calibrated(
        detections(count=4, seed=1), model="viewpoint-spline", board_shape=False
    )
    assert calibration.held_out_rms_px > 1.25 * calibration.rms_px
    assert any("well above the fit error" in note for note in calibration.notes)


def test_result_file_has_documented_entries(tmp_path):
    calibration = calibrated(detections(count=4))
    text = calibration.to_json(tmp_path / "calibration.json")
    assert (tmp_path / "calibration.json").read_text() == text
    report = json.loads(text)
    assert report["rms_px"] == calibration.rms_px
    assert report.keys() >= {
        "held_out_rms_px",
        "corners",
        "outliers",
        "images",
        "parameters",
        "seconds",
    }
    first = report["images"][0]
    assert first.keys() == {
        "name",
        "found",
        "used",
        "reason",
        "rms_px",
        "rotation",
        "translation_mm",
        "camera_at_mm",
    }
    np.testing.assert_allclose(
        np.array(first["rotation"]) @ first["camera_at_mm"], -np.array(first["translation_mm"])
    )
    assert report["parameters"][0].keys() == {"name", "value", "sigma", "unit"}


@pytest.mark.full
def test_calibration_is_reproducible():
    first, second = (calibrated(detections(count=4), seed=3) for _ in range(2))
    assert replace(first, seconds=0.0).to_json() == replace(second, seconds=0.0).to_json()


def test_cancellation_keeps_partial_result():
    calls = []
    calibration = calibrated(
        detections(),
        should_stop=lambda: len(calls) > 2,
        on_progress=lambda done, total: calls.append(done / total),
    )
    assert not calibration.is_complete
    assert calibration.rms_px < 1.0
    assert any("stopped early" in note for note in calibration.notes)
    assert json.loads(calibration.to_json())["held_out_rms_px"] is None


# -- unusable images
# -------------------------------------------------------------------------------------


def moved(observations, numbers, shift):
    return [
        replace(d, corners_px=d.corners_px + shift) if i in numbers else d
        for i, d in enumerate(observations)
    ]


def flipped(observations, numbers):
    def one(d):
        return replace(d, corners_px=[SIZE[0] - 1, 0] + d.corners_px * [-1, 1])

    return [one(d) if i in numbers else d for i, d in enumerate(observations)]


def one_pose(count: int) -> list[om.Detection]:
    (observation,) = detections(count=1, noise_px=0.0)
    random = np.random.default_rng(0)
    return [
        replace(
            observation,
            name=f"image {i}",
            corners_px=observation.corners_px + random.normal(0, 0.1, observation.corners_px.shape),
        )
        for i in range(count)
    ]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: detections(count=2),
            r"in 2 of 2 images \(image 1 and image 2\); at least 3 are required",
        ),
        (
            lambda: [
                om.Detection(f"{i}.png", SIZE, reason="no board was found; the image is blurred")
                for i in "ab"
            ],
            r"in 0 of 2 images.*a\.png: no board.*b\.png: no board.*blurred",
        ),
        (
            lambda: [
                *detections(count=5),
                replace(detections()[0], name="small.png", image_size=(320, 240)),
            ],
            r"small\.png: 320 x 240 px, the other images: 640 x 480 px",
        ),
        (
            lambda: one_pose(6),
            "the same in all images.*image 0, image 1.*hold it at different positions",
        ),
        pytest.param(
            lambda: moved(detections(), {2, 5, 8, 9}, [9.0, -4.0]),
            "centre in image 3, image 6, image 9 and image 10 is .*the mirror moved",
            marks=pytest.mark.full,
        ),
        pytest.param(
            lambda: flipped(detections(count=8), {1, 2, 5, 6}),
            "half of the images, image 2, image 3, image 6 and image 7, fit the others only after flipping",
            marks=pytest.mark.full,
        ),
        (
            lambda: [replace(d, is_reversed=False) for d in detections(count=4)],
            r"the board's markers, image 1, .* and image 4 are not mirror images.*camera\.image_flipped=true",
        ),
        (
            lambda: [
                replace(
                    d, corners_px=d.corners_px[np.random.default_rng(0).permutation(len(d.ids))]
                )
                for d in detections(count=6)
            ],
            "no camera explains the corners.*check that the board is the specified one",
        ),
    ],
)
def test_unsuitable_images_raise(make, message):
    with pytest.raises(InvalidParameter, match=message):
        calibrated(make())


def test_arguments_are_checked():
    with pytest.raises(
        InvalidParameter,
        match="model must be one of auto, unified, enhanced-unified, double-sphere, kannala-brandt, ocam,",
    ):
        calibrated(detections(count=3), model="unfied")
    with pytest.raises(InvalidParameter, match="model = 'sensor' requires optics = 'mirror'"):
        calibrated(detections(count=3), model="sensor", optics="fisheye")
    with pytest.raises(InvalidParameter, match="optics must be one of mirror, fisheye; got 'lens'"):
        calibrated(detections(count=3), optics="lens")


def test_recommendations_without_poses_use_corners():
    corners = np.stack(
        np.meshgrid(np.linspace(330, 460, 11), np.linspace(200, 280, 7)), axis=-1
    ).reshape(-1, 2)
    view_coverage = coverage([Observation("a", corners, BOARD.points_mm)], (320.0, 240.0), 200.0)
    assert view_coverage.counts.sum() == 77
    messages = recommendations(view_coverage, 1)
    assert messages[0].startswith("Capture more images: 1 is used")
    assert any("lower left, left, upper left" in message for message in messages[1:])
    assert not any("Tilt" in message for message in messages)
