"""Blur, depth of field and best focus against ray cones, definitions and the corrected paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.analysis import focus
from omnimirror.analysis.focus import (
    FOCUS_MERITS,
    FocusedBlur,
    FocusStudy,
    ImagingCharacteristics,
    _focusable_interval,
    focus_function,
    virtual_images,
)
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.optimisation import minimise_scalar
from omnimirror.design import RimRay, generated_mirror
from omnimirror.design.component_selection import best_apertures
from omnimirror.optics.housing import Housing, Tube
from omnimirror.optics.lenses import Orthographic, Perspective, SurfaceLens
from omnimirror.optics.mirrors import EvenPolynomial
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import bundled_sensors
from tests.conftest import sensor_of

SPH, EDI, SVP = (
    om.load_sensor(f"paper-{n}") for n in ("spherical", "equidistant", "hyperboloidal")
)
LENS = Perspective(11.6, 4.0, 212.0)


@pytest.mark.parametrize("L", [150.0, 205.0, 212.0, 230.0, 4000.0])
def test_blur_is_cone_width_at_imager(L):
    """Image the point with the lens equation, and intersect its cone of light at b0 (Eqs. 25-27)."""
    f, D = 11.6, 11.6 / 4
    b0, b = 1 / (1 / f - 1 / 212.0), 1 / (1 / f - 1 / L)
    assert float(LENS.blur(L)) == pytest.approx(D * (b0 - b) / b, rel=1e-12, abs=1e-15)


def test_paper_blur_neglects_focal_length():
    assert float(LENS.blur(220.0, mode="paper")) == pytest.approx(
        11.6**2 / 4 * (220 - 212) / (212 * 220), rel=1e-12
    )
    ratio = LENS.blur(220.0, mode="paper") / LENS.blur(220.0)
    assert 1 - float(ratio) == pytest.approx(11.6 / 212, rel=1e-12)  # 5.5 % too small


@pytest.mark.parametrize("mode", ["exact", "paper"])
@pytest.mark.parametrize(
    "lens", [LENS, Orthographic(0.06, 4.0, 20.0)], ids=["perspective", "orthographic"]
)
def test_depth_of_field_limits_match_tolerance(lens, mode):
    near, far = lens.depth_of_field(0.0052, mode)
    assert near < lens.focus_distance_mm < far
    np.testing.assert_allclose(lens.blur([near, far], mode=mode), [-0.0052, 0.0052], rtol=1e-10)


def test_depth_of_field_beyond_hyperfocal_is_infinite():
    assert Perspective(11.6, 4.0, 7000.0).depth_of_field(0.0052).far == np.inf
    assert LENS.hyperfocal_distance(0.0052) == pytest.approx(6469.2, abs=0.1)


def test_airy_disk():
    assert om.evaluate(SPH, [0.0]).airy_px == pytest.approx(1.09, abs=0.005)


def test_exact_axial_blur_of_sphere():
    """Erratum 11: -1.036 px at L0 = 212, so not every tangential point is within the depth of
    field."""
    assert om.evaluate(SPH, [0.0]).blur_t_px[0] == pytest.approx(-1.036, abs=5e-4)


@pytest.mark.parametrize(
    ("sensor", "merit", "focus", "value"),
    [
        (SPH, "worst_blur_area_deg2", 212.4, 0.0751),
        (EDI, "worst_blur_area_deg2", 206.0, 0.566),
        (SVP, "worst_blur_area_deg2", 172.5, 1.52),
        (SPH, "worst_floored_area_deg2", 215.5, 0.704),
        (SPH, "worst_blur_deg", 219.5, 0.596),
    ],
)
def test_best_focus_of_paper_mirrors(sensor, merit, focus, value):
    best = om.best_focus(
        sensor, merit, omega_deg=np.linspace(0, 135, 1001), mode="paper", image_radius_px=500
    )
    assert best.focus_mm == pytest.approx(focus, abs=0.05)
    assert best.value == pytest.approx(value, rel=2e-3)


def test_paper_svp_focus_from_outer_field():
    best = om.best_focus(
        SVP,
        "worst_blur_area_deg2",
        omega_deg=np.linspace(82, 135, 1001),
        mode="paper",
        image_radius_px=500,
    )
    assert best.focus_mm == pytest.approx(189.7, abs=0.05)


def cap_shares(omega):
    """Return weights of field angles (n,): the solid angle closest to each."""
    borders = np.concatenate([omega[:1], (omega[1:] + omega[:-1]) / 2, omega[-1:]])
    return -np.diff(np.cos(borders)) / (np.cos(omega[0]) - np.cos(omega[-1]))


def test_solid_angle_weights_are_exact_for_linear_functions():
    """Integral of omega sin(omega), for any nodes; equal nodes share their weight."""
    omega = np.array([2.0, 0.3, 1.1, 1.1])
    weights = focus.solid_angle_weights(omega)
    integral = np.sin(2.0) - 2.0 * np.cos(2.0) - np.sin(0.3) + 0.3 * np.cos(0.3)
    assert weights.sum() == pytest.approx(1.0, rel=1e-12)
    assert weights @ omega == pytest.approx(integral / (np.cos(0.3) - np.cos(2.0)), rel=1e-12)
    assert weights[2] == weights[3]
    assert focus.solid_angle_weights(np.array([1.2, 1.2])).tolist() == [0.5, 0.5]


MEANS = [(SPH, 212.3896, 0.2436625), (EDI, 201.0575, 0.3048491), (SVP, 169.6890, 0.8185778)]
"""Best focus by the mean, with that mean: integrals of 200 Gauss nodes over the field."""


def spacings(low, high):
    rng = np.random.default_rng(5)
    yield "even", np.linspace(low, high, 1001), 1e-5
    yield (
        "dense centre",
        np.concatenate([np.linspace(low, 20, 300), np.linspace(20, high, 101)[1:]]),
        1e-3,
    )
    yield (
        "dense rim",
        np.concatenate([np.linspace(low, high - 10, 51)[:-1], np.linspace(high - 10, high, 350)]),
        1e-3,
    )
    yield "any", np.concatenate([[low, high], rng.uniform(low, high, 400)]), 1e-3
    yield "backwards", np.linspace(high, low, 1001), 1e-5
    yield "twice", np.repeat(np.linspace(low, high, 501), 2), 1e-4


@pytest.mark.parametrize(("sensor", "focus", "value"), MEANS, ids=["SPH", "E-DI", "SVP"])
def test_mean_merit_is_solid_angle_mean(sensor, focus, value):
    for name, omega, within in spacings(*sensor.field_deg):
        best = om.best_focus(sensor, "mean_floored_area_deg2", omega_deg=omega)
        assert best.value == pytest.approx(value, rel=within), name
        assert best.focus_mm == pytest.approx(focus, abs=1e-4 if within < 1e-4 else 5e-3), name
    assert om.best_focus(sensor, "mean_floored_area_deg2").value == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize("mode", ["exact", "paper"])
@pytest.mark.parametrize("radius", [None, 500.0])
@pytest.mark.parametrize("merit", FOCUS_MERITS)
def test_focus_function_matches_evaluation(merit, mode, radius):
    """The merit as a sum of functions of the focus, and its derivative, against plain evaluations."""
    lens = replace(SPH.lens, k1=-0.4, k2=1.0)
    for sensor in (replace(SPH, lens=lens), om.load_sensor("paraboloid-telecentric")):
        omega = np.linspace(0.0, 0.99 * sensor.field_deg[1], 60)
        rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
        study = FocusStudy(sensor, rays, virtual_images(rays, 400.0), mode, radius, 550.0)
        middle, unit = (24.0, 3.0) if sensor.lens.TELECENTRIC else (1 / 215.0, 1e-4)
        function = focus_function(study, FOCUS_MERITS[merit], middle, unit)
        u = np.array([-1.0, -0.3, 0.4, 1.0])
        result, slope, _ = function(u)
        focus = sensor.lens.focus_coordinate(middle + unit * u)
        expected = np.array([FOCUS_MERITS[merit].value(study.at(f)) for f in focus])
        np.testing.assert_allclose(
            result, expected if merit.startswith("mean") else expected**2, rtol=1e-10
        )
        h = 1e-6
        np.testing.assert_allclose(
            slope, (function(u + h)[0] - function(u - h)[0]) / (2 * h), rtol=1e-5
        )


@pytest.mark.parametrize("merit", FOCUS_MERITS)
def test_focus_function_includes_lens_blur(merit):
    """At the current focus of the lens: elsewhere focus breathing applies, which only the last step
    of the search includes."""
    columns = (0.0, 1 / 6.0, 0.0), (0.5, 2.0, 0.0), (1.0, 1.5168, 1.0)
    sensor = replace(SPH, lens=SurfaceLens(4.0, 215.0, *columns, 1, field_max_deg=20.0))
    omega = np.linspace(0.0, 0.99 * sensor.field_deg[1], 60)
    assert (
        min(om.evaluate(sensor, omega).of_lens["lens_blur_t_px"]) > 1.5
    )  # for a difference between squares and cubes
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    study = FocusStudy(sensor, rays, virtual_images(rays, 400.0), "exact", None, 550.0)
    middle = float(sensor.lens.focus_coordinate(sensor.lens.focus_distance_mm))
    blur = study.at(sensor.lens.focus_distance_mm)
    lens_blur = sensor.lens.own_blur(study.ideal_height(sensor.lens))
    np.testing.assert_allclose(
        [blur.own_t_px, blur.own_s_px], np.array(lens_blur) / 5.2e-3, rtol=1e-12
    )
    (result,) = focus_function(study, FOCUS_MERITS[merit], middle, 1e-4)(np.zeros(1))[0]
    expected = FOCUS_MERITS[merit].value(study.at(sensor.lens.focus_distance_mm))
    assert result == pytest.approx(expected if merit.startswith("mean") else expected**2, rel=1e-10)


@pytest.mark.parametrize("distance", [100.0, 400.0])
@pytest.mark.parametrize("shell", [None, Tube(110.0, 4.0)])
def test_resolution_at_object_distance(shell, distance):
    """Objects at a distance along the chief ray, through a wall of 51 to 55 mm by Snell's law: the image
    of one degree, seen from the mirror point, by differences along and across the meridian."""
    sensor = replace(SPH, housing=Housing(shell=shell))
    step = 1e-3
    angles = np.array([30.0, 60.0, 90.0, 110.0])
    r, low, high = (
        om.evaluate(sensor, angles + d, object_distance_mm=distance) for d in (0.0, -step, step)
    )

    def object_point(row, omega):
        """Radius and distance past the lens, in the meridian."""
        x, z, path = row.x_mm, -row.z_mm, distance
        if shell is not None:
            radial_mm = (51.0 - x) / np.sin(omega)
            sine = np.cos(omega) / 1.49
            wall = 4.0 / np.sqrt(1 - sine**2)
            x, z, path = (
                55.0,
                z + radial_mm * np.cos(omega) + wall * sine,
                path - radial_mm - wall,
            )
        return np.stack([x + path * np.sin(omega), z + path * np.cos(omega)])

    omega = np.radians(angles)
    radius = object_point(r, omega)[0]
    np.testing.assert_allclose(
        r.width_px_per_deg, r.h_px * np.radians(1.0) * distance / radius, rtol=1e-9
    )
    shift = object_point(high, omega + np.radians(step)) - object_point(
        low, omega - np.radians(step)
    )
    transverse = shift[0] * np.cos(omega) - shift[1] * np.sin(omega)
    np.testing.assert_allclose(
        r.dh_domega_px_per_deg,
        (high.h_px - low.h_px) * np.radians(distance) / transverse,
        rtol=1e-6,
    )
    if shell is None:
        axis = om.evaluate(sensor, [0.0], object_distance_mm=distance)
        near = om.evaluate(sensor, [1e-3], object_distance_mm=distance)
        assert axis.width_px_per_deg == pytest.approx(near.width_px_per_deg, rel=1e-6)
        assert axis.width_px_per_deg == pytest.approx(axis.dh_domega_px_per_deg, rel=1e-12)


@pytest.mark.parametrize("mode", ["Exact", "rubbish", "", None])
def test_unknown_mode_rejected(mode):
    for call in (
        lambda: om.best_focus(SPH, "worst_blur_px", mode=mode),
        lambda: om.evaluate(SPH, [0.0], mode=mode),
        lambda: LENS.blur(220.0, mode=mode),
        lambda: LENS.depth_of_field(0.0052, mode=mode),
        lambda: Orthographic(0.06, 4.0, 20.0).blur(22.0, mode=mode),
        lambda: Orthographic(0.06, 4.0, 20.0).depth_of_field(0.0052, mode=mode),
        lambda: best_apertures(SPH, mode=mode),
    ):
        with pytest.raises(InvalidParameter, match="mode must be one of exact, paper; got "):
            call()


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        (
            {"image_radius_px": -5.0},
            r"image_radius_px must be greater than 0 px and at most 1e\+09 px; got -5\.0",
        ),
        (
            {"image_radius_px": 0},
            r"image_radius_px must be greater than 0 px and at most 1e\+09 px; got 0",
        ),
        (
            {"image_radius_px": 1e-165},
            r"image_radius_px must be greater than 0 px and at most 1e\+09 px; got 1e-165",
        ),
        (
            {"image_radius_px": float("nan")},
            r"image_radius_px must be greater than 0 px and at most 1e\+09 px; got nan",
        ),
        ({"image_radius_px": "500"}, "image_radius_px must be a number; got '500'"),
        ({"omega_deg": []}, "omega_deg must contain at least one number"),
        (
            {"omega_deg": [[0.0, 1.0]]},
            r"omega_deg must be a number or have the shape \(n,\); got shape \(1, 2\)",
        ),
        ({"omega_deg": [10**400]}, r"omega_deg must be numbers of shape \(n,\)"),
        (
            {"omega_deg": np.ma.masked_array([9.0, 10.0], [False, True])},
            r"omega_deg must be numbers of shape \(n,\)",
        ),
        ({"object_distance_mm": [100.0, 200.0]}, "each of the 1001 field angles; got 2"),
        (
            {"object_distance_mm": -1.0},
            "object_distance_mm must be at least 1e-09 mm, or inf; got -1",
        ),
        (
            {"object_distance_mm": 2e-309},
            "object_distance_mm must be at least 1e-09 mm, or inf; got 2e-309",
        ),
        (
            {"merit": "sharpest"},
            "merit must be one of worst_floored_area_deg2, mean_floored_area_deg2, worst_blur_area_deg2",
        ),
    ],
)
def test_invalid_focus_arguments_rejected(kwargs, message):
    with pytest.raises(InvalidParameter, match=message):
        om.best_focus(SPH, **kwargs)


@pytest.mark.parametrize(
    ("coordinates", "expected"),
    [
        ([10.0, 20.0], (9.5, 20.5)),  # 5 % of the range on both sides
        ([10.0], (9.5, 10.5)),  # 5 % of the value without a range
        ([3.0, 23.0, np.nan], (2.0, 24.0)),
        ([2.1, 22.1], (2.0, 23.1)),  # not below the minimum
        ([-50.0, 12.0], (2.0, 12.5)),  # values before the first count as the first
        ([10.0, 29.9], (9.005, 30.0)),  # not above the maximum
        ([10.0, 20.0, 30.0, 99.0], (9.5, 20.5)),  # values after the last are excluded
        ([40.0, 99.0], (28.5, 30.0)),  # unless no others exist
    ],
)
def test_focus_search_range(coordinates, expected):
    assert _focusable_interval(np.array(coordinates), 2.0, 30.0) == pytest.approx(
        expected, abs=1e-12
    )


def test_best_focus_requires_images():
    with pytest.raises(InvalidParameter, match="best focus requires virtual images; got none"):
        _focusable_interval(np.array([np.nan]), 2.0, 30.0)


def test_single_angle_focus_between_images():
    best, row = (
        om.best_focus(SPH, "worst_blur_px", omega_deg=90),
        om.evaluate(SPH, [90.0]).columns(),
    )
    near, far = sorted((row["distance_t_mm"][0], row["distance_s_mm"][0]))
    assert near < best.focus_mm < far
    assert 1 / best.focus_mm == pytest.approx(
        (1 / near + 1 / far) / 2, rel=1e-9
    )  # blur is linear in 1/L


def test_cone_tip_has_no_best_focus():
    """The tip is named, in any order; by default the central 10 % of the image radius are excluded."""
    cone = sensor_of("cone")
    low, high = cone.field_deg
    for merit in ("worst_blur_deg", "worst_floored_area_deg2"):
        for angles in ([low, high], [high, low, high]):
            with pytest.raises(
                InvalidParameter, match=rf"^omega_deg = {low:.6g} has no finite blur at any focus"
            ):
                om.best_focus(cone, merit, omega_deg=angles)
    inner = om.evaluate(cone, h_px=[0.1 * cone.rim_radius_px]).omega_deg[0]
    best = om.best_focus(cone)
    expected = om.best_focus(cone, omega_deg=np.linspace(inner, high, 1001))
    assert best.focus_mm == pytest.approx(expected.focus_mm, rel=1e-9)
    assert best.value == pytest.approx(expected.value, rel=1e-9)
    assert best.merit == "worst_floored_area_deg2"


def test_blur_at_a_cone_tip_is_infinite():
    """With its sign; one degree has no width there."""
    columns = [2.0] * 3, [0.0, 0.0, 4.0], [0.0, 0.0, 8.0], [0.0, 0.0, 2.0]
    imaging = ImagingCharacteristics(*map(np.array, columns))
    t_px, s_px = np.array([3.0, -3.0, 3.0]), np.array([-1.0, -1.0, 2.0])
    blur = FocusedBlur(t_px, s_px, imaging, np.zeros(3), 2.0)
    assert blur.s_deg.tolist() == [-np.inf, -np.inf, 0.5]
    assert blur.product().tolist() == [-np.inf, np.inf, 0.75]
    # 3^2 + 2^2 + 1^2 and 2^2 + 2^2 + 1^2 px^2, without blur of the lens
    assert blur.floored_area()[2] == pytest.approx(np.sqrt(14.0 * 9.0) / 8.0, rel=1e-12)


def test_best_focus_defaults():
    angles = np.linspace(*SPH.field_deg, 1001)
    assert om.best_focus(SPH) == om.best_focus(
        SPH,
        "worst_floored_area_deg2",
        omega_deg=angles,
        object_distance_mm=np.inf,
        mode="exact",
        image_radius_px=None,
        wavelength_nm=550.0,
    )
    assert om.best_focus(SPH, object_distance_mm=[400.0]) == om.best_focus(
        SPH, object_distance_mm=np.full(1001, 400.0)
    )
    mean = "mean_floored_area_deg2"
    best = om.best_focus(SPH, mean, omega_deg=90)
    assert om.best_focus(SPH, mean, omega_deg=[90, 90, 90]).value == pytest.approx(best.value)
    result = om.evaluate(SPH, [90.0], focus_mm=best.focus_mm)
    assert best.value == pytest.approx(result.floored_area_deg2[0], rel=1e-12)


def test_focus_moves_with_a_displaced_mirror():
    """A telecentric lens is focused at distances from the nominal vertex."""
    telecentric = om.load_sensor("paraboloid-telecentric")
    displaced = replace(telecentric, mirror_pose=MirrorPose(displacement_mm=0.7))
    assert om.best_focus(displaced).focus_mm == pytest.approx(
        om.best_focus(telecentric).focus_mm + 0.7
    )


def test_blocks_do_not_change_the_focus(monkeypatch):
    """Coefficients may exceed the limit of products; then each focus is a block."""
    best = om.best_focus(SPH)
    for limit in (100, 30_000):
        monkeypatch.setattr(focus, "MAX_SINGLE_THREAD_PRODUCTS", limit)
        blockwise = om.best_focus(SPH)
        assert (blockwise.focus_mm, blockwise.value) == pytest.approx(
            (best.focus_mm, best.value), rel=1e-9
        )


DEFAULT_SENSORS = ("paper-spherical", "paraboloid-telecentric")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=() if n in DEFAULT_SENSORS else pytest.mark.full)
        for n in bundled_sensors()
    ],
)
def test_best_focus_is_global_minimum(name):
    """The search for each merit against plain enumeration of evaluations."""
    bundled = om.load_sensor(name)
    angles = np.linspace(*bundled.field_deg, 1001)
    shares = cap_shares(np.radians(angles))

    def values(focus):
        r = om.evaluate(bundled, angles, focus_mm=focus)
        return {
            "worst_floored_area_deg2": r.floored_area_deg2.max(),
            "mean_floored_area_deg2": r.floored_area_deg2 @ shares,
            "worst_blur_area_deg2": np.abs(r.blur_t_deg * r.blur_s_deg).max(),
            "worst_blur_px": max(np.abs(r.blur_t_px).max(), np.abs(r.blur_s_px).max()),
            "worst_blur_deg": max(np.abs(r.blur_t_deg).max(), np.abs(r.blur_s_deg).max()),
            "worst_blur_rss_deg": np.hypot(r.blur_t_deg, r.blur_s_deg).max(),
        }

    r = om.evaluate(bundled, angles)
    L = np.concatenate([r.distance_t_mm, r.distance_s_mm])
    merits = [values(focus) for focus in np.linspace(L.min(), L.max(), 150)]
    for merit in FOCUS_MERITS:
        best = om.best_focus(bundled, merit)
        best_merit = values(best.focus_mm)[merit]
        # the mean over caps assigns each angle its whole neighbourhood, and is thus accurate to
        # second order only
        assert best_merit == pytest.approx(
            best.value, rel=1e-4 if merit.startswith("mean") else 1e-12
        ), merit
        assert best_merit <= min(value[merit] for value in merits) * (1 + 1e-9), merit


def test_floored_area_lower_bound():
    r = om.evaluate(SPH, np.linspace(0, 135, 50))
    floor = (1 + r.airy_px**2) / r.area_px2
    assert np.all(r.floored_area_deg2 >= floor)
    sides = [np.sqrt(r.blur_t_px**2 + 1 + r.airy_px**2), np.sqrt(r.blur_s_px**2 + 1 + r.airy_px**2)]
    np.testing.assert_allclose(r.floored_area_deg2, sides[0] * sides[1] / r.area_px2, rtol=1e-12)


@pytest.mark.parametrize("name", ["paper-spherical", "paraboloid-telecentric"])
@pytest.mark.parametrize("curvature", [1e-5, 1e-7, 1e-9, 1e-12])
def test_best_focus_of_nearly_flat_mirror(name, curvature):
    """z = c x^2 images distant objects at 1/(4 c), finally farther than the maximum focus distance."""
    sensor = replace(om.load_sensor(name), mirror=EvenPolynomial((curvature,), 20.0))
    best = om.best_focus(sensor)
    assert om.evaluate(sensor, focus_mm=best.focus_mm).focus_mm == best.focus_mm
    max_focus_mm = sensor.lens.PARAMETERS["focus_distance_mm"].high
    assert best.focus_mm == pytest.approx(min(1 / (4 * curvature), max_focus_mm), rel=0.05)


def test_best_focus_with_images_beyond_infinity():
    """The far-plane mirror to 80 deg has tangential images behind the lens; no focus of a fine scan
    is better."""
    mirror = generated_mirror("rectifying", RimRay(80.0, 12.0, 43.9))
    sensor = replace(SPH, mirror=mirror.mirror, mirror_distance_mm=mirror.distance_mm)
    angles = np.linspace(0, sensor.field_deg[1], 301)
    best = om.best_focus(sensor, omega_deg=angles)
    result = om.evaluate(sensor, angles)
    assert result.distance_t_mm.min() < 0 < 5e3 < result.distance_t_mm.max()
    for distance in 1 / np.linspace(1e-7, 1 / 60, 60):
        values = om.evaluate(sensor, angles, focus_mm=distance).floored_area_deg2
        assert values.max() >= best.value * (1 - 1e-9)


def test_auto_focus_equals_best_focus():
    assert om.evaluate(SPH, [0.0], focus_mm="auto").focus_mm == om.best_focus(SPH).focus_mm


def test_minimiser_finds_global_minimum():
    assert minimise_scalar(
        lambda x: abs(np.sin(3 * x)) + 0.01 * (x - 2) ** 2, 0.5, 9.0
    ) == pytest.approx(2 * np.pi / 3, abs=1e-6)
    assert minimise_scalar(lambda x: x, 1.0, 1.0) == 1.0


def test_angular_blur_is_blur_over_resolution():
    r = om.evaluate(SPH, [20.0, 100.0])
    np.testing.assert_allclose(r.blur_t_deg * r.dh_domega_px_per_deg, r.blur_t_px, rtol=1e-12)
    np.testing.assert_allclose(r.blur_s_deg * r.width_px_per_deg, r.blur_s_px, rtol=1e-12)
    np.testing.assert_allclose(r.blur_area_deg2, r.blur_t_deg * r.blur_s_deg, rtol=1e-12)


@pytest.mark.parametrize("sensor", [SPH, EDI, SVP], ids=["SPH", "E-DI", "SVP"])
def test_blur_matches_real_ray_cone(sensor):
    """Section 6: marginal rays of the aperture, traced from a distant object over the real mirror,
    hit the imager within a few 0.01 px of the predicted blur."""
    lens, m, mirror = sensor.lens, sensor.mirror_distance_mm, sensor.mirror
    angles = np.array([15.0, 60.0, 105.0, 130.0])
    result = om.evaluate(sensor, angles)
    radius = lens.focal_length_mm / lens.f_number / 2
    for i, omega in enumerate(np.radians(angles)):
        positions = []
        for side in (
            -radius,
            radius,
        ):  # the ray through (side, -m) with the incident direction omega
            low, high = result.x_mm[i] - 5.0, min(result.x_mm[i] + 5.0, mirror.rim_radius_mm * 1.02)

            def offset(x, side=side, omega=omega):
                theta = np.arctan2(x - side, m + float(mirror.sag(x)))
                return 2 * np.arctan(float(mirror.slope(x))) + theta - omega

            for _ in range(60):
                middle = (low + high) / 2
                low, high = (low, middle) if offset(middle) > 0 else (middle, high)
            tangent = (low - side) / (m + float(mirror.sag(low)))
            # a thin lens deflects a ray at s by -s/f, and inverts the image
            b0 = lens.image_distance
            positions.append(b0 * tangent - side * (1 - b0 / lens.focal_length_mm))
        real_px = abs(positions[1] - positions[0]) / sensor.imager.pitch_mm
        assert real_px == pytest.approx(abs(result.blur_t_px[i]), abs=0.05)
