"""Cameras from known points and directions at an arbitrary pose, against the true camera."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.estimation.observations import rotation_of
from tests.everyday import few

from .cases import BOARD, NOISE_PX, SIZE, TRUTH, detections

HEADERS = {"points": "image,u_px,v_px,x_mm,y_mm,z_mm", "directions": "image,u_px,v_px,x,y,z"}


def surveyed_points(camera, near: int, far: int, seed: int = 0) -> om.Observation:
    """Return an observation of a room with a corridor of 40 m and of stars, in arbitrary axes."""
    random = np.random.default_rng(seed)
    points = random.normal(size=(8 * (near + far), 3))
    points *= (random.uniform(600, 5000, len(points)) / np.linalg.norm(points, axis=1))[:, None]
    projection, distant_projection = camera.project(points), camera.project_directions(points)
    selected, distant = (
        np.flatnonzero(projection.valid)[:near],
        np.flatnonzero(distant_projection.valid)[-far:] if far else [],
    )
    turn, shift = rotation_of(random.normal(size=3)), random.normal(0, 2000, 3)
    pixels = np.concatenate([projection.pixels[selected], distant_projection.pixels[distant]])
    return om.Observation(
        "room",
        pixels + random.normal(0, NOISE_PX, pixels.shape),
        np.concatenate([points[selected] @ turn.T + shift, points[distant] @ turn.T]),
        is_distant=np.arange(near + far) >= near,
    )


def error_deg(calibration, camera) -> float:
    """Return the RMS direction error after alignment, because the pose is not part of the camera."""
    directions = np.random.default_rng(9).normal(size=(1000, 3))
    projection = camera.project_directions(directions)
    true = (
        directions[projection.valid] / np.linalg.norm(directions[projection.valid], axis=1)[:, None]
    )
    rays = calibration.model.backproject(projection.pixels[projection.valid])
    assert rays.valid.mean() > 0.97  # an unknown mirror ends at its outermost point
    true, measured = true[rays.valid], rays.directions[rays.valid]
    u, _, vt = np.linalg.svd(true.T @ measured)
    assert np.linalg.det(u @ vt) == pytest.approx(1.0)  # not its mirror image
    return float(np.degrees(np.sqrt(np.mean(np.sum((measured @ (u @ vt).T - true) ** 2, axis=1)))))


@pytest.mark.parametrize(
    ("near", "far", "draws"), few([(40, 0, 5), (0, 40, 5), (25, 25, 1)], (25, 25, 1))
)
def test_points_or_stars_recover_camera(near, far, draws):
    """The centre of some draws is excluded: with few points, the outermost one alone can determine
    the lens there."""
    fits = [
        om.calibrate_camera(
            surveys=[surveyed_points(TRUTH, near, far, seed)], image_size=SIZE, model="unified"
        )
        for seed in range(draws)
    ]
    for calibration in fits:
        assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.25)
        assert calibration.rms_px < calibration.held_out_rms_px
        assert calibration.advice == ()  # advice on boards does not apply
    assert (
        np.median([calibration.held_out_rms_px for calibration in fits])
        < 2.5 * np.sqrt(2) * NOISE_PX
    )
    assert np.median([error_deg(calibration, TRUTH) for calibration in fits]) < 0.06


@pytest.mark.full
def test_camera_position_among_points_is_reported():
    observation = surveyed_points(TRUTH, 40, 0)
    turn, translation = rotation_of(np.array([0.3, -0.5, 1.1])), np.array([700.0, -400.0, 1500.0])
    near, stars = (
        om.Observation(s.name, s.pixels, s.points @ turn.T, s.pose, s.is_known, s.is_distant)
        for s in (observation, surveyed_points(TRUTH, 0, 40))
    )
    moved = om.Observation(
        "moved", near.pixels, near.points + translation, is_distant=near.is_distant
    )
    at = [
        om.calibrate_camera(surveys=[s], image_size=SIZE, model="unified").images[0]
        for s in (near, moved, stars)
    ]
    np.testing.assert_allclose(at[1].camera_at_mm - at[0].camera_at_mm, translation, atol=0.1)
    np.testing.assert_allclose(at[1].rotation, at[0].rotation, atol=1e-5)
    pixels = TRUTH.image(near.points @ at[0].rotation.T + at[0].translation_mm).pixels
    assert np.median(np.linalg.norm(pixels - near.pixels, axis=1)) < 1.0
    assert at[2].rotation is not None
    assert at[2].camera_at_mm is None


@pytest.mark.parametrize(
    "model", ["viewpoint-spline", pytest.param("auto", marks=pytest.mark.full)]
)
def test_room_points_recover_noncentral_mirror_and_select_model(
    model,
):
    camera = om.load_sensor("paper-spherical")
    calibration = om.calibrate_camera(
        surveys=[surveyed_points(camera, 90, 30)], image_size=camera.image_size, model=model
    )
    assert model != "auto" or len(calibration.candidates) > 4
    assert calibration.held_out_rms_px < 1.3 * np.sqrt(2) * NOISE_PX
    assert error_deg(calibration, camera) < 0.05


def test_boards_and_stars_are_adjusted_jointly_and_outlier_is_reported():
    sky = surveyed_points(TRUTH, 0, 30, seed=2)
    sky.pixels[7] += [12.0, -9.0]
    calibration = om.calibrate_camera(detections(count=4), BOARD, surveys=[sky], model="unified")
    assert [p.name for p in calibration.images] == [*(f"image {i}" for i in range(1, 5)), "room"]
    assert all(p.used for p in calibration.images)
    (outlier,) = calibration.outliers
    assert (outlier.image, outlier.corner) == ("room", 7)
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)
    boards_only = om.calibrate_camera(detections(count=4), BOARD, model="unified")
    assert error_deg(calibration, TRUTH) < error_deg(boards_only, TRUTH)


def test_board_shape_does_not_affect_surveyed_points():
    """Points of a board bent by 3 mm; surveyed points of a room keep their positions."""
    bent = BOARD.points_mm.copy()
    bent[:, 2] = 3.0 * ((bent[:, 0] - bent[:, 0].mean()) / 150.0) ** 2
    boards = detections(count=6, points_mm=bent)
    calibration = om.calibrate_camera(
        boards, BOARD, surveys=[surveyed_points(TRUTH, 40, 0)], model="unified"
    )
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)
    assert max(abs(v) for v in calibration.shape.values[2:]) > 1.0


@pytest.mark.full
@pytest.mark.long
def test_few_points_are_fitted_with_mirror_model():
    """Any mirror fits 9 of the 28 points; the others then keep residuals of 26 px."""
    camera, random = om.load_sensor("paper-hyperboloidal"), np.random.default_rng(2)
    points = random.normal(0, 1500, (30, 3)) * [1, 1, 0.5]
    projection = camera.project(points)
    pixels = projection.pixels[projection.valid] + random.normal(
        0, NOISE_PX, (projection.valid.sum(), 2)
    )
    observation = om.Observation("room", pixels, points[projection.valid])
    fit = om.calibrate_camera(surveys=[observation], image_size=camera.image_size, model="sensor")
    assert fit.rms_px < np.sqrt(2) * NOISE_PX
    assert fit.held_out_rms_px < 2 * np.sqrt(2) * NOISE_PX


@pytest.mark.parametrize(
    ("make_arguments", "message"),
    [
        (lambda s: {"surveys": [s]}, "must be specified for surveyed points"),
        (
            lambda s: {"surveys": [s], "image_size": (320, 240)},
            r"room: pixels must be inside the image of 320 x 240 px",
        ),
        (
            lambda s: {"surveys": [s.subset(np.arange(8))], "image_size": SIZE},
            "surveys must contain at least 12 points",
        ),
        (
            lambda s: {"surveys": [s, s], "image_size": SIZE},
            "surveys must have different names; got room and room",
        ),
        (
            lambda s: {
                "surveys": [om.Observation("room", s.pixels, s.points * [1, -1, 1])],
                "image_size": SIZE,
            },
            "no camera explains the points and directions.*right-handed",
        ),
        (
            lambda s: {"images": ["a.png"], "image_size": SIZE},
            "board must be specified for images; got 1",
        ),
    ],
)
def test_invalid_surveys_raise(make_arguments, message):
    with pytest.raises(InvalidParameter, match=message):
        om.calibrate_camera(**make_arguments(surveyed_points(TRUTH, 40, 0)), model="unified")


# -- files
# -----------------------------------------------------------------------------------------------


def written_files(folder, survey: om.Observation, *kinds: str) -> list[str]:
    """Return command options for files of observations."""
    options = []
    for kind in kinds:
        rows = survey.distant == (kind == "directions")
        numbers = np.hstack([survey.pixels, survey.points])[rows]
        lines = [f"{survey.name}," + ",".join(f"{x:.6f}" for x in row) for row in numbers]
        (folder / f"{kind}.csv").write_text(
            "\n".join(["# measured on Monday", HEADERS[kind], *lines]) + "\n"
        )
        options += [f"--{kind}", str(folder / f"{kind}.csv")]
    return options


def test_files_return_observations_and_locations(tmp_path):
    survey = surveyed_points(TRUTH, 12, 6)
    written_files(tmp_path, survey, "points", "directions")
    (observation,), locations = om.read_observations(
        [tmp_path / "points.csv"], [tmp_path / "directions.csv"]
    )
    assert observation.name == "room"
    assert observation.points == pytest.approx(survey.points, abs=1e-5)
    assert observation.distant.tolist() == survey.distant.tolist()
    assert locations["room"][0] == "points.csv line 3"
    assert locations["room"][12] == "directions.csv line 3"


def test_azimuths_are_counted_clockwise_from_above(tmp_path):
    """Compass and sextant: north ahead, east to the right of it, which is -Y for Y to the left."""
    (tmp_path / "sky.csv").write_text(
        "u_px,v_px,azimuth_deg,elevation_deg\n1,2,0,0\n3,4,90,0\n5,6,45,90\n"
    )
    ((sky,), _) = om.read_observations(directions=[tmp_path / "sky.csv"])
    assert sky.points == pytest.approx(
        np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]), abs=1e-12
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "contains no points; its first line must be u_px,v_px,x,y,z"),
        (
            "u,v,x,y,z\n1,2,3,4,5\n",
            "line 1 of .*must be u_px,v_px,x,y,z or u_px,v_px,azimuth_deg.*got 'u,v,x,y,z'",
        ),
        (
            "u_px,v_px,x,y,z\n1,2,3,4\n",
            "sky.csv line 2 must have 5 values, as the first line; got 4",
        ),
        (
            "u_px,v_px,x,y,z\n1,2,3,4,north\n",
            "sky.csv line 2: z must be a finite number; got 'north'",
        ),
        ("u_px,v_px,x,y,z\n1,2,0,0,0\n", "sky.csv line 2: the direction must not be zero"),
        (
            "u_px,v_px,azimuth_deg,elevation_deg\n1,2,0,91\n",
            "elevation_deg must be -90 to 90 deg; got 91",
        ),
    ],
)
def test_invalid_file_raises_with_line_number(tmp_path, text, message):
    (tmp_path / "sky.csv").write_text(text)
    with pytest.raises(InvalidParameter, match=message):
        om.read_observations(directions=[tmp_path / "sky.csv"])


def test_command_calibrates_from_files(tmp_path):
    from click.testing import CliRunner

    from omnimirror.apps.cli.commands.calibrate import command

    options = written_files(tmp_path, surveyed_points(TRUTH, 30, 20), "points", "directions")
    out = tmp_path / "camera.toml"
    run = CliRunner().invoke(
        command,
        [
            *options,
            "--image-size",
            "640x480",
            "--model",
            "unified",
            "-o",
            str(out),
            "--report",
            str(tmp_path / "report.html"),
        ],
    )
    assert run.exit_code == 0, run.output
    assert "50 of 50 points in 1 of 1 image" in run.output
    assert om.load_camera(out).xi == pytest.approx(TRUTH.xi, abs=0.1)
    assert "From points in 1 of 1 image" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "IMAGES of a board, --points or --directions must be given"),
        (["a.png"], "IMAGES require --board and --square-mm"),
        (["--board", "11x7", "--square-mm", "30"], "--board requires IMAGES"),
        (["a.png", "--board", "11x7"], "--board and --square-mm must be given together"),
    ],
)
def test_command_reports_missing_input(arguments, message):
    from click.testing import CliRunner

    from omnimirror.apps.cli.commands.calibrate import command

    run = CliRunner().invoke(command, arguments)
    assert run.exit_code == 2
    assert message in " ".join(run.output.split())
