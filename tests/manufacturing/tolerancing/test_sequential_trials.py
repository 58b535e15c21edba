"""Sensors of all types with all errors: as files, and sequential against vectorised trials."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SelfObstruction
from omnimirror.manufacturing.tolerancing.compensation import merit_names
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from omnimirror.manufacturing.tolerancing.perturbed_states import is_vectorised
from omnimirror.manufacturing.tolerancing.tolerances import error_sources, perturbed
from omnimirror.manufacturing.tolerancing.trial_images import REFOCUS, field_of, sequential_images
from omnimirror.optics.housing import Dome, FlatWindow, Housing, Tube
from omnimirror.optics.image_sensor import ImagerPose
from omnimirror.optics.mirrors.mirror import MirrorForm
from omnimirror.optics.tracing.reflection import RayEndpoints

SPH = om.load_sensor("paper-spherical")
WARM = om.Thermal(
    mirror_material="acrylic",
    spacer_material="aluminium",
    mount_material="brass",
    focal_ppm_per_k=20.0,
    held_at="rim",
)
SENSORS = ("paper-spherical", "paper-hyperboloidal", "paper-equidistant", "exact-equidistant")
OTHERS = {
    "tube": replace(SPH, housing=Housing(shell=Tube(110.0, 3.0, medium="water"))),
    "dome": replace(SPH, housing=Housing(shell=Dome(260.0, 5.0, inner_shift_mm=1.0))),
    "window": replace(
        SPH, housing=Housing(shell=FlatWindow()), mirror=om.mirrors.Sphere(49.96, 28.0)
    ),
    "telecentric": om.load_sensor("paraboloid-telecentric"),
    "two mirrors": om.load_sensor("folded-hyperboloidal"),
    "warm tube": replace(SPH, housing=Housing(shell=Tube(110.0, material="acrylic")), thermal=WARM),
}


def warm(name):
    sensor = om.load_sensor(name)
    return replace(
        sensor, thermal=replace(WARM, mirror_material=None) if name.startswith("exact") else WARM
    )


def random_errors(sensor, count, seed=0, share=1.0):
    """Draw all errors of a sensor at the medium grade, with every fifth Zernike term."""
    rng, sources = np.random.default_rng(seed), error_sources(sensor)
    names = [name for name in sources if "zernike" not in name or rng.random() < 0.2]
    return {
        name: share * rng.normal(size=count) * sources[name].typical_tolerances["medium"]
        for name in names
    }


def one(values, k=0):
    return {name: float(of[k]) for name, of in values.items()}


@pytest.mark.parametrize("name", SENSORS)
def test_saved_trial_reproduces_its_images(name, tmp_path):
    sensor = warm(name)
    values = random_errors(sensor, 1, seed=3)
    assert {"imager.tilt_x_deg", "imager.rotation_deg", "temperature.warmer_k"} < set(values)
    om.save_sensor(perturbed(sensor, one(values)), tmp_path / "built.toml")
    built, field = om.load_sensor(tmp_path / "built.toml"), field_of(sensor)
    projection = built.project_directions(field.targets @ sensor._axes.T)
    pixels = field.images(values).offsets_px[0] + sensor.imager.centre
    assert projection.valid.sum() > 80
    np.testing.assert_allclose(
        projection.pixels[projection.valid], pixels[projection.valid], atol=1e-8
    )
    rays = built.backproject(projection.pixels[projection.valid])
    towards = np.einsum(
        "ni,ni->n", rays.directions, (field.targets @ sensor._axes.T)[projection.valid]
    )
    assert rays.valid.all()
    np.testing.assert_allclose(towards, 1.0, atol=1e-13)


@pytest.mark.parametrize("refocus", REFOCUS)
@pytest.mark.parametrize("name", SENSORS)
def test_sequential_and_vectorised_trials_agree(name, refocus):
    """Sequential trials use rays through the aperture, vectorised ones second derivatives of the
    path.
    """
    sensor = warm(name)
    values = random_errors(sensor, 2, seed=2)
    if (
        refocus != "none"
    ):  # in this case, points of a tilted imager are focused together with its centre, to 0.02 px
        values["imager.tilt_x_deg"] = values["imager.tilt_y_deg"] = np.zeros(2)
    field = field_of(sensor, angles=4, azimuths=7)
    images, invalid, focus = field.images_and_focus(values, refocus=refocus)
    sequential, invalid_sequential, focus_sequential = sequential_images(
        sensor, values, 2, RayEndpoints(field.targets, field.distant), refocus=refocus
    )
    assert not invalid.any()
    assert not invalid_sequential.any()
    close = 1e-4 if refocus == "worst" else 2e-5
    np.testing.assert_allclose(
        sequential.offsets_px, images.offsets_px, atol=1e-9 if refocus == "none" else close
    )
    signs = np.sign((sequential.blur_px * images.blur_px).sum(axis=(-2, -1)))[..., None, None]
    np.testing.assert_allclose(sequential.blur_px * signs, images.blur_px, atol=close)
    np.testing.assert_allclose(focus_sequential, focus, rtol=1e-6 if refocus != "worst" else 1e-5)


def test_blur_on_a_tilted_imager_matches_a_thin_lens():
    """A ray through p with slope a is at ``b (a + p/f) - p`` at depth b behind a thin lens."""
    values = {"imager.tilt_x_deg": np.array([1.5]), "imager.tilt_y_deg": np.array([-0.7])}
    field, lens = field_of(SPH, angles=4, azimuths=5), SPH.lens
    blur = field.images(values).blur_px[0]
    plane = ImagerPose(1.5, -0.7)._plane()
    targets, small = RayEndpoints(field.targets, True), 0.01
    hits = []
    for pupil in small * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]):
        reflection = SPH.optical_train.posed_mirror.specular(
            SPH.optical_train.entrance_pupil_points(pupil[None]), targets
        )
        slope, p = (
            reflection.to_pupils[:, :2] / reflection.to_pupils[:, 2:],
            lens.aperture_radius * pupil,
        )
        # (b (a + p/f) - p) = plane[:2] e,  b = b0 + plane[2] e
        straight = slope + p / lens.focal_length_mm
        system = plane[:2] - straight[:, :, None] * plane[2]
        right = lens.image_distance * straight - p
        hits.append(np.linalg.solve(system, right[..., None])[..., 0] / SPH.imager.pitch_mm)
    expected = np.stack([hits[0] - hits[1], hits[2] - hits[3]], axis=-1) / small
    np.testing.assert_allclose(np.abs(blur), np.abs(expected), atol=2e-4)
    square = field.images({}, 1).blur_px[0]
    assert np.abs(blur - square).max() > 1.0  # different from that of a square one


@pytest.mark.parametrize("kind", OTHERS)
def test_other_sensors_match_forward_projection(kind):
    sensor = OTHERS[kind]
    assert not is_vectorised(sensor)
    values = random_errors(sensor, 1, seed=5, share=0.5)
    low, high = sensor.clear_field_deg
    field = field_of(
        sensor, field_deg=(low + 0.1 * (high - low), low + 0.9 * (high - low)), angles=3, azimuths=5
    )
    images, invalid, _ = field.images_and_focus(values)
    built = perturbed(sensor, one(values))
    projection = built.project_directions(field.targets @ sensor._axes.T)
    assert projection.valid.all()
    assert not invalid.any()
    np.testing.assert_allclose(
        projection.pixels, images.offsets_px[0] + sensor.imager.centre, atol=1e-7
    )
    nominal = om.evaluate(sensor, omega_deg=field.omega_deg[::5])
    plain = field.images({}, 1).blur_px[0, ::5]
    worst = np.maximum(np.abs(nominal.blur_t_px), np.abs(nominal.blur_s_px))
    np.testing.assert_allclose(
        np.linalg.svd(plain, compute_uv=False)[:, 0], worst, rtol=2e-3, atol=2e-3
    )
    along = np.hypot(*field.px_per_deg[::5, :, 0].T)
    np.testing.assert_allclose(along, np.abs(nominal.dh_domega_px_per_deg), rtol=1e-5)


@pytest.mark.parametrize(
    "kind",
    [
        "telecentric",
        *(pytest.param(kind, marks=pytest.mark.full) for kind in ("dome", "two mirrors")),
    ],
)
def test_tolerance_analysis_of_other_sensors(kind):
    sensor = OTHERS[kind]
    sources = error_sources(sensor)
    names = [name for name in sources if "zernike" not in name and "tilt" not in name][::6]
    tolerances = om.Tolerances(
        sensor, {name: om.Tolerance(sources[name].typical_tolerances["medium"]) for name in names}
    )
    plan = om.TolerancePlan(
        tolerances, {"motion_px after affine": 5.0}, objects={"angles": 2, "azimuths": 3}
    )
    analysis = om.tolerance(sensor, plan, trials=20, seed=1)
    assert analysis.statistics.trials == 20
    assert analysis.statistics.quantile("motion_px", 0.95) > analysis.statistics.quantile(
        "motion_px after affine", 0.95
    )


def test_intersecting_cover_is_a_reject():
    merits = TrialEvaluator.of(OTHERS["tube"], angles=2, azimuths=3).evaluate(
        {"cover.decentre_x_mm": np.array([0.0, 40.0])}
    )
    assert merits[0, -1] == 0
    assert merits[1, -1] > 0
    assert np.isnan(merits[1, 0])


def test_perturbed_folded_sensor_keeps_the_field():
    """A perturbed secondary mirror vignettes the rim of the primary mirror."""
    sensor = OTHERS["two mirrors"]
    values = {
        "mirror.displacement_mm": [-0.25],
        "secondary.displacement_mm": [-0.25],
        "mirror.conic": [-0.02],
    }
    values = {name: np.array(of) for name, of in values.items()}
    with pytest.raises(SelfObstruction, match="the secondary must image the mirror up to its rim"):
        _ = perturbed(sensor, one(values)).field_deg
    field = field_of(sensor, angles=3, azimuths=4)
    images, invalid, _ = field.images_and_focus(values)
    assert not invalid.any()
    assert 0.5 < np.abs(images.offsets_px[0] - field.offsets_px).max() < 20.0


def test_temperature_matches_thermal_model():
    sensor = warm("paper-hyperboloidal")
    evaluator = TrialEvaluator.of(sensor, azimuths=3)
    merits = evaluator.evaluate({"temperature.warmer_k": np.array([40.0])})[0]
    motion_px = om.thermal_motion_px(sensor, 60.0, omega_deg=evaluator.field.omega_deg[::3])
    assert merits[merit_names().index("motion_px")] == pytest.approx(motion_px, rel=1e-3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: MirrorForm((5, 5), (1.0, 1.0)),
            r"zernike must contain different indices of terms; got \[5, 5\]",
        ),
        (
            lambda: MirrorForm((5, 8), (1.0,)),
            "um must have one amplitude for each of the 2 terms; got 1",
        ),
        (lambda: MirrorForm((500,), (1.0,)), r"zernike\[0\] must be between 1 and 91; got 500"),
        (
            lambda: replace(OTHERS["telecentric"], imager_pose=ImagerPose(1.0)),
            "behind lenses of kind orthographic",
        ),
        (
            lambda: replace(OTHERS["two mirrors"], mirror_form=MirrorForm((5,), (1.0,))),
            "with a secondary",
        ),
        (
            lambda: om.evaluate(replace(SPH, mirror_form=MirrorForm((5,), (1.0,)))),
            "the form error of the mirror of",
        ),
        (
            lambda: om.spots(replace(SPH, imager_pose=ImagerPose(1.0)), [90.0]),
            "that of 'paper-spherical' is tilted by 1",
        ),
        (
            lambda: om.SensorModel(replace(SPH, imager_pose=ImagerPose(1.0))),
            r"without \[mirror_form\]",
        ),
    ],
)
def test_unsupported_perturbations_are_rejected(make, message):
    with pytest.raises(InvalidParameter, match=message):
        make()
