"""Lens by surfaces, against independently traced rays through glass and mirror."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.optics.lenses import SurfaceLens
from omnimirror.optics.lenses._sequential_tracing import Sequence
from omnimirror.optics.materials import Glass, glass_named, read_agf
from omnimirror.optics.mirrors import Sphere
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import format_sensor
from omnimirror.simulation.pixel_rays import sampling_plan
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import trace_bundle
from tests.commands import omnimirror
from tests.optics.lenses import prescriptions

A, RIM, M = 50.0, 44.0, 182.0
PITCH = 5.2e-3
OMEGA = np.array([0.0, 20.0, 45.0, 70.0, 90.0, 110.0, 130.0])


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("lens") / "triplet.zmx"
    path.write_text(prescriptions.zmx(), encoding="utf-16")
    return path


def lens_of(path, **more):
    return SurfaceLens.from_file(path, **{"focus_distance_mm": prescriptions.FOCUS, **more})


def sensor_with(lens, pose=None):
    imager = om.load_sensor("paper-spherical").imager
    return om.Sensor(
        Sphere(A, RIM),
        lens,
        imager,
        mirror_distance_mm=M,
        mirror_pose=MirrorPose() if pose is None else pose,
    )


@pytest.fixture(scope="module")
def sensor(file):
    return sensor_with(lens_of(file))


def truth(omega_deg, stop_at=(0.0, 0.0), wavelength_um=0.5875618):
    n = prescriptions.indices(wavelength_um)
    to_imager = prescriptions.imager_place(prescriptions.indices())
    return np.array(
        [
            prescriptions.image_of_direction(np.radians(o), np.array(stop_at), n, A, M, to_imager)
            for o in np.atleast_1d(omega_deg)
        ]
    )


def test_chief_rays_match_sequential_trace(sensor):
    """Within 0.001 px, from the axis to the rim."""
    h_px = om.evaluate(sensor, OMEGA).h_px
    assert np.abs(h_px - truth(OMEGA)[:, 0] / PITCH).max() < 1e-3
    rate = (truth(90.001)[0, 0] - truth(89.999)[0, 0]) / PITCH / 0.002
    assert om.evaluate(sensor, [90.0]).dh_domega_px_per_deg[0] == pytest.approx(rate, rel=1e-5)


def test_imager_and_stop_of_lens(sensor):
    """The imager behind all surfaces; positions in the stop relative to its radius, and direction
    cosines on the imager, of rays from the mirror."""
    lens, n = sensor.lens, prescriptions.indices()
    to_imager = prescriptions.imager_place(n)
    assert lens.imager_mm == pytest.approx(prescriptions.GAPS[:-1].sum() + to_imager, abs=1e-6)
    edge = [lens.aperture_radius, 0.0, prescriptions.FOCUS - lens.pupil.at_mm]
    radius = prescriptions.through([0, 0, -prescriptions.FOCUS], edge, n, to_imager)[0][0]
    assert radius > 0  # upright
    rng = np.random.default_rng(4)
    aims = np.concatenate([rng.uniform(-0.2, 0.2, (2, 3, 2)), np.ones((2, 3, 1))], axis=2)
    directions = aims * rng.uniform(0.5, 2.0, (2, 3, 1))
    points = np.concatenate([rng.uniform(-1, 1, (2, 3, 2)), np.zeros((2, 3, 1))], axis=2)
    points = points + 30.0 * aims
    at_stop, cosines = lens.stop_points(points, directions), lens.image_cosines(points, directions)
    images = lens.image_of(points, directions)
    assert at_stop.shape == cosines.shape == images.shape == (2, 3, 2)
    for k in np.ndindex(2, 3):
        start, direction = points[k] * [1, 1, -1], -directions[k] * [1, 1, -1]
        stop, image = prescriptions.through(start, direction, n, to_imager)
        further = prescriptions.through(start, direction, n, to_imager + 1.0)[1] - image
        np.testing.assert_allclose(at_stop[k], stop / radius, rtol=1e-6)
        np.testing.assert_allclose(images[k], -image, rtol=1e-6, atol=1e-6)
        expected = -further / np.sqrt(1 + further @ further)
        np.testing.assert_allclose(cosines[k], expected, rtol=1e-6, atol=1e-9)


def test_pupil_motion_included(sensor):
    """Precondition of the preceding test."""
    pupils = sensor.lens.field.nodes.pupil
    assert np.ptp(pupils) > 0.1
    fixed = replace(
        om.load_sensor("paper-spherical").lens,
        focal_length_mm=sensor.lens.focal_length_mm,
        focus_distance_mm=prescriptions.FOCUS - sensor.lens.principal_point_mm,
        entrance_pupil_mm=sensor.lens.pupil_from_principal,
    )
    fixed_pupil = replace(sensor, lens=fixed, mirror_distance_mm=M - sensor.lens.principal_point_mm)
    away = om.evaluate(fixed_pupil, OMEGA).h_px - om.evaluate(sensor, OMEGA).h_px
    assert 0.05 < np.abs(away).max() < 3


def test_blur_matches_bundles_through_glass(file):
    """Tangential and sagittal, by rays through the edges of a stop of F/400 without spherical
    aberration."""
    sensor = sensor_with(lens_of(file, f_number=400.0))
    evaluation = om.evaluate(sensor, OMEGA[1:])
    # stop radius, from a ray to the edge of the entrance pupil, traced here
    edge = sensor.lens.focal_length_mm / 800.0
    pupil = sensor.lens.pupil.at_mm
    direction = np.array([edge, 0.0, prescriptions.FOCUS - pupil])
    r = prescriptions.through(
        [0, 0, -prescriptions.FOCUS], direction, prescriptions.indices(), 0.0
    )[0][0]
    for axis, blur in ((0, evaluation.blur_t_px), (1, evaluation.blur_s_px)):
        ends = [truth(OMEGA[1:], np.eye(2)[axis] * s * r)[:, axis] for s in (1, -1)]
        assert np.abs(blur) == pytest.approx(np.abs(ends[0] - ends[1]) / PITCH, rel=1e-3, abs=1e-5)


def test_spots_match_rays_through_stop(sensor):
    """At F/4: combined aberrations of lens and mirror, within 5 % of their size."""
    edge, pupil = sensor.lens.aperture_radius, sensor.lens.pupil.at_mm
    r = prescriptions.through(
        [0, 0, -prescriptions.FOCUS],
        [edge, 0.0, prescriptions.FOCUS - pupil],
        prescriptions.indices(),
        0.0,
    )[0][0]
    rings = [
        (np.sqrt((i + 0.5) / 8), t)
        for i in range(8)
        for t in (np.arange(8) + 0.5 * (i % 2)) * np.pi / 4
    ]
    stop = r * np.array([[q * np.cos(t), q * np.sin(t)] for q, t in rings])
    for omega in (40.0, 120.0):
        image = np.concatenate([truth(omega, at) for at in stop]) / PITCH
        for axis, size in enumerate(om.spots(sensor, [omega]).rms_px()):
            assert size[0, 0] == pytest.approx(image[:, axis].std(), rel=0.05)


def test_three_wavelength_indices(sensor):
    """Lateral colour in the field functions."""
    evaluation = om.evaluate(sensor, OMEGA[1:])
    theta = np.tan(np.radians(evaluation.theta_deg))
    for name, wave in (("short", 0.4861327), ("long", 0.6562725)):
        # the same object and pupil in another colour; the angle of its chief ray differs slightly
        away = sensor.lens.field.odd(theta)[name]
        traced = truth(OMEGA[1:], wavelength_um=wave)[:, 0] - truth(OMEGA[1:])[:, 0]
        assert np.abs(away - traced).max() < 2e-5 + 0.05 * np.abs(traced).max()


@pytest.mark.parametrize("nm", [486.1327, 546.07, 656.2725, 700.0])
def test_rays_at_other_wavelength(sensor, nm):
    """Indices of the wavelength with fixed stop and imager; interpolation and extrapolation by
    Cauchy's formula."""
    colour = om.at_wavelength(sensor, nm)
    assert colour.lens.imager_mm == pytest.approx(sensor.lens.imager_mm, abs=1e-9)
    assert colour.lens.aperture_radius == pytest.approx(sensor.lens.aperture_radius, rel=1e-12)
    h_px = om.evaluate(colour, OMEGA).h_px
    expected = truth(OMEGA, wavelength_um=nm / 1e3)[:, 0] / PITCH
    assert np.abs(h_px - expected).max() < 5e-4
    assert np.abs(expected - om.evaluate(sensor, OMEGA).h_px).max() > 0.01


@pytest.mark.parametrize(
    "pose", [MirrorPose(), MirrorPose(decentre_x_mm=0.7, displacement_mm=-1.0)]
)
def test_pixel_round_trip_and_apertures(file, pose):
    sensor = sensor_with(lens_of(file), pose)
    rng = np.random.default_rng(3)
    turn, r = rng.uniform(0, 2 * np.pi, 40), 460 * np.sqrt(rng.uniform(0, 1, 40))
    pixels = 511.5 + (r * np.stack([np.cos(turn), np.sin(turn)])).T
    rays = sensor.backproject(pixels)
    assert rays.valid.all()
    for projection in (
        sensor.project(rays.origins + 120.0 * rays.directions),
        sensor.project_directions(rays.directions),
    ):
        assert np.abs(projection.pixels - pixels).max() < 1e-3
    chief = sensor.aperture_rays(pixels, np.zeros(2))
    assert np.abs(np.degrees(chief.directions - rays.directions)).max() < 2e-4


def test_rendered_rays_reach_their_pixels(sensor):
    """Rays of the renderer, traced back through the glass from their mirror points."""
    plan = sampling_plan(8, True)
    bundle = trace_bundle(sensor, plan, Radiometry(), slice(300, 301), slice(400, 420))
    assert (bundle.outcome == 1).all()
    rng = np.random.default_rng(0)
    image, pupil = rng.uniform(-2, 2, (50, 2)), 0.9 * rng.uniform(-0.7, 0.7, (50, 2))
    origins, directions = sensor.lens.rays(image, pupil)
    n, to_imager = prescriptions.indices(), prescriptions.imager_place(prescriptions.indices())
    for k in range(50):
        p, d = origins[k] * [1, 1, -1], directions[k] * [1, 1, -1]
        position = prescriptions.through(p - 100 * d, d if d[2] > 0 else -d, n, to_imager)[1]
        if d[2] < 0:
            position = prescriptions.through(p + 100 * d, -d, n, to_imager)[1]
        assert np.abs(-position - image[k]).max() < 1e-8


def test_focus_breathing(file):
    """The imager moves, the surfaces are fixed: traced heights of another focus."""
    near = sensor_with(lens_of(file).focused_at(150.0))
    n = prescriptions.indices()
    to_imager = prescriptions.imager_place(n, 150.0)
    expected = np.array(
        [
            prescriptions.image_of_direction(np.radians(o), np.zeros(2), n, A, M, to_imager)[0]
            for o in OMEGA
        ]
    )
    assert np.abs(om.evaluate(near, OMEGA).h_px - expected / PITCH).max() < 1e-3


def test_even_asphere_intersections():
    """Intersections are on the surface, with the slope of the sag by finite differences."""
    c, k, a = 0.02, -0.7, np.array([[1e-4, -3e-6, 2e-8]])
    one = Sequence(
        np.array([c]),
        np.array([k]),
        a,
        np.zeros(1),
        np.array([1.0, 1.5]),
        np.full(1, np.inf),
        np.full(1, np.inf),
        0,
    )

    def sag(r):
        return c * r**2 / (1 + np.sqrt(1 - (1 + k) * c**2 * r**2)) + a[0] @ [r**2, r**4, r**6]

    start, slope, to_imager = 7.0, 0.1, 30.0
    r = brentq(lambda r: start + slope * sag(r) - r, 6, 9)
    steep = (sag(r + 1e-5) - sag(r - 1e-5)) / 2e-5
    incidence = np.arctan(slope) + np.arctan(steep)
    after = np.arcsin(np.sin(incidence) / 1.5) - np.arctan(steep)
    image = one.trace(np.array([[start, 0.0]]), np.array([[slope, 0.0]]), to_imager).image
    assert image[0, 0] == pytest.approx(r + (to_imager - sag(r)) * np.tan(after), abs=1e-8)


PLANO = {
    "thickness_mm": (10.0, 4.0, 0.0),
    "index": (1.0, 1.5168, 1.0),
    "stop_surface": 1,
    "field_max_deg": 25.0,
}
CURVED = (0.0, 1 / 25.84, 0.0)


def plano_convex(curvature_per_mm=CURVED, f_number=8.0, focus_distance_mm=1e6, **columns):
    return SurfaceLens(f_number, focus_distance_mm, curvature_per_mm, **{**PLANO, **columns})


def test_paraboloid_equals_first_asphere():
    """z = c r^2 / 2 as a conic with constant -1, and as the r^2 coefficient of a plane."""
    conic = plano_convex(conic=(0.0, -1.0, 0.0))
    asphere = plano_convex((0.0, 0.0, 0.0), aspheres=(0.0, 0.0, 0.5 / 25.84, 0.0, 0.0, 0.0))
    for one, other in zip(conic.field.nodes, asphere.field.nodes, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)
    assert asphere.focal_length_mm == pytest.approx(50.0, abs=1e-3)
    assert max(conic.field.nodes.own_t) < max(plano_convex().field.nodes.own_t)  # unlike a sphere


@pytest.mark.parametrize("focal_length", [0.5, 1e6])
def test_extreme_focal_lengths_valid(focal_length):
    lens = plano_convex((0.0, 50.0 / (25.84 * focal_length), 0.0), thickness_mm=(0.1, 0.04, 0.0))
    assert lens.focal_length_mm == pytest.approx(focal_length, rel=1e-4)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            {"curvature_per_mm": (0.0, 0.0, 0.0)},
            "the focal length of the surfaces must be greater than 0; got -?inf mm",
        ),
        (
            {"curvature_per_mm": (0.0, -1 / 25.84, 0.0)},
            "the focal length of the surfaces must be greater than 0; got -50 mm",
        ),
        (
            {"index": (1.0, 1.5168, 1.33)},
            "index must end with 1, the air in front of the imager; got 1.33",
        ),
        ({"index": (1.0, 1.5168)}, "index must have one value for each of the 3 surfaces; got 2"),
        (
            {"aspheres": (1e-9,) * 4},
            "aspheres must have the same number of values for each of the 3 surfaces; got 4",
        ),
        (
            {"aspheres": (0.0, -1.001e9, 0.0)},
            r"aspheres\[1\] must be between -1e\+09 and 1e\+09; got -1\.001e\+09",
        ),
        (
            {"aspheres": (0.0, 0.0, 1.001e9)},
            r"aspheres\[2\] must be between -1e\+09 and 1e\+09; got 1\.001e\+09",
        ),
        ({"stop_surface": 4}, "stop_surface must be a surface number from 1 to 3; got 4"),
        ({"stop_surface": 1.5}, "stop_surface must be a surface number from 1 to 3; got 1.5"),
        (
            {"focus_distance_mm": 39.9},
            "focus_distance_mm must be greater than 40 mm, the front focus .* got 39.9",
        ),
        (  # front surface of f = 8 mm in glass
            {
                "curvature_per_mm": (0.25, 0.01, 0.0),
                "thickness_mm": (8.0, 1.0, 0.0),
                "index": (2.0, 2.0, 1.0),
                "stop_surface": 2,
            },
            "the entrance pupil must be at a finite distance; the stop, surface 2, is in the focal plane",
        ),
        (
            {
                "curvature_per_mm": (0.0, 0.8136, 0.0),
                "thickness_mm": (10.0, 6.4656, 0.0),
                "stop_surface": 2,
                "field_max_deg": 80.0,
            },
            r"rays through the edge of the pupil must pass all surfaces; some at 4\d.* increase f_number or reduce",
        ),
    ],
)
def test_invalid_surfaces_rejected_without_warning(columns, message):
    with pytest.raises(InvalidParameter, match=message):
        plano_convex(**columns)


BOUNDS = {
    "curvature_per_mm": (-1e3, 1e3), "thickness_mm": (-1e4, 1e4), "index": (1.0, 5.0), "conic": (-1e4, 1e4),
    "edge_mm": (0.0, 1e4), "clear_mm": (0.0, 1e4), "index_short": (1.0, 5.0), "index_long": (1.0, 5.0),
    "wavelengths_nm": (100.0, 2e4),
}  # fmt: skip


@pytest.mark.parametrize("name", BOUNDS)
def test_surface_columns_out_of_bounds_rejected(name):
    low, high = BOUNDS[name]
    described = SurfaceLens.PARAMETERS[name]
    assert (described.low, described.high) == (low, high)
    for value in (low - 1e-4, high + 0.1):
        with pytest.raises(
            InvalidParameter, match=re.escape(f"must be between {low:g} and {high:g}")
        ):
            plano_convex(**{name: (value,) * 3})


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("f_number", 0.1, 1e3),
        ("focus_distance_mm", 1e-3, 1e7),
        ("stop_surface", 1, 1000),
        ("field_max_deg", 1.0, 80.0),
    ],
)
def test_numbers_out_of_bounds_rejected(name, low, high):
    for value in (0.9 * low, 1.001 * high):
        with pytest.raises(
            InvalidParameter, match=re.escape(f"{name} must be between {low:g} and {high:g}")
        ):
            plano_convex(**{name: value})


def test_limits_of_lens_are_included():
    """Coefficients to 1e9, which messages round; first and last surface as stop; 1 and 80 deg (the
    default); not the focus itself."""
    lens, coefficients = plano_convex(), SurfaceLens.PARAMETERS["aspheres"]
    assert (coefficients.low, coefficients.high) == (-1e9, 1e9)
    assert SurfaceLens.field_max_deg == 80.0
    for stop in (1, 3, 2.0):
        assert plano_convex(stop_surface=stop).stop_surface == stop
    assert np.degrees(np.arctan(plano_convex(field_max_deg=1.0).field.end)) == pytest.approx(1.0)
    with pytest.raises(InvalidParameter, match="focus_distance_mm must be greater than 40 mm"):
        plano_convex(focus_distance_mm=lens.principal_point_mm + lens.focal_length_mm)
    unknown = plano_convex(edge_mm=(0.0, 0.0, 0.0), conic=(0.0, 0.0, 0.0), clear_mm=(0.0, 0.0, 0.0))
    for one, other in zip(lens.field.nodes, unknown.field.nodes, strict=True):
        np.testing.assert_array_equal(one, other)
    narrow = plano_convex(edge_mm=(0.0, 3.0, 0.0)).field
    assert 0.28 < narrow.end < 0.3 * 1.15  # a chief ray at 3 mm, 10 mm behind the stop
    assert lens.field.end == pytest.approx(np.tan(np.radians(25.0)))


@pytest.mark.parametrize("missing", ["wavelengths_nm", "index_short", "index_long"])
def test_other_wavelengths_require_three_indices(missing):
    optics = {
        "wavelengths_nm": (486.1, 587.6, 656.3),
        "index_short": (1.0, 1.5224, 1.0),
        "index_long": (1.0, 1.5143, 1.0),
    }
    assert plano_convex(focus_distance_mm=300.0, **optics).at_wavelength(656.3).index[
        1
    ] == pytest.approx(1.5143, abs=1e-12)
    with pytest.raises(InvalidParameter, match="the indices at 700 nm are unknown; specify"):
        plano_convex(
            **{name: value for name, value in optics.items() if name != missing}
        ).at_wavelength(700.0)
    for wavelengths in ((486.1, 656.3), (486.1, 546.1, 587.6, 656.3)):
        lens = plano_convex(**{**optics, "wavelengths_nm": wavelengths})
        with pytest.raises(InvalidParameter, match="the indices at 700 nm are unknown; specify"):
            lens.at_wavelength(700.0)


def test_narrow_aperture_reduces_illumination(file, tmp_path):
    """A front aperture vignettes the bundle as traced."""
    text = prescriptions.zmx(per_surface={1: ["  CLAP 0 1.75 0"], 6: ["  CLAP 0 1.55 0"]})
    (tmp_path / "cut.zmx").write_text(text)
    full, narrow = lens_of(file).field.nodes, lens_of(tmp_path / "cut.zmx").field.nodes
    assert narrow.illumination[0] == pytest.approx(1.0)
    i = len(narrow.tangent) // 2
    assert narrow.width_t[i] < 0.97 * np.interp(narrow.tangent[i], full.tangent, full.width_t)
    assert narrow.illumination[i] < 0.97 * np.interp(
        narrow.tangent[i], full.tangent, full.illumination
    )


def test_dewarping_through_real_lens(sensor):
    """Distances from the image centre of distant targets, against traced rays."""
    screen = om.screens.Cylinder((720, 270), tilt_min_deg=-60, tilt_max_deg=35)
    coordinates = om.Dewarper(sensor, screen).coordinates()
    rows, columns = np.array([5, 80, 150, 200, 260]), np.array([30, 200, 360, 500, 700])
    directions = screen.targets_at(columns.astype(float), rows.astype(float))
    omega = np.degrees(np.arccos(directions @ sensor.axis / np.linalg.norm(directions, axis=-1)))
    radius = np.hypot(*(coordinates[rows, columns] - 511.5).T)
    assert np.abs(radius - truth(omega)[:, 0] / PITCH).max() < 0.01


def test_evaluation_includes_lens_blur(file, sensor, tmp_path):
    evaluation = om.evaluate(sensor, [0.0, 90.0])
    assert list(evaluation.of_lens) == [
        "lens_blur_t_px",
        "lens_blur_s_px",
        "lens_illumination",
        "lateral_colour_px",
        "entrance_pupil_mm",
    ]
    assert evaluation.of_lens["lens_illumination"][0] == pytest.approx(1.0)
    assert evaluation.of_lens["lateral_colour_px"][0] == 0.0
    evaluation.to_csv(tmp_path / "table.csv")
    assert (
        (tmp_path / "table.csv")
        .read_text()
        .splitlines()[0]
        .endswith("lateral_colour_px,entrance_pupil_mm")
    )
    assert om.evaluate(om.load_sensor("paper-spherical"), [0.0]).of_lens == {}


def test_command_line_accepts_lens_file(file):
    run = omnimirror("evaluate", "paper-spherical", "--lens", file, "--omega-deg", "90")
    assert run.returncode == 0, run.stderr
    assert "surfaces lens" in run.stdout
    assert "pupil" in run.stdout
    missing = omnimirror("evaluate", "paper-spherical", "--lens", "nothing.zmx")
    assert missing.returncode
    assert "cannot read nothing.zmx" in missing.stderr


# -- files -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", ["utf-8", "utf-16", "utf-8-sig", "latin-1"])
def test_lens_file_encodings(code, file, tmp_path):
    (tmp_path / "triplet.zmx").write_bytes(
        prescriptions.zmx().replace("Cooke", "Cooké" * (code != "latin-1")).encode(code)
    )
    assert lens_of(tmp_path / "triplet.zmx") == lens_of(file)


DIAMETERS = {
    i: [f'  DIAM {radius} {flag} 0 0 1 ""']
    for i, (radius, flag) in enumerate(
        zip((1.2, 1.2, 0.8, 0.8, 1.1, 1.1), (0, 0, 0, 0, 1, 1), strict=True), start=1
    )
}


@pytest.mark.parametrize(
    "diameters", [None, DIAMETERS, {i: ["  DIAM 40 0 0 0 1"] for i in range(1, 7)}]
)
@pytest.mark.parametrize(
    ("fields", "widest_deg"),
    [
        ("FTYP 0 0 3 3 0 0 0\nXFLN 0 0 0\nYFLN 0 14 20", 20.0),
        (
            "FTYP 0 0 2 3 0 0 0\nXFLN 0 3 0\nYFLN 0 -4 77",
            4.99417,
        ),  # both axes, with the count of FTYP
        ("FTYP 2 0 2 3\nXFLN 0 0\nYFLN 0 3", 14.5),  # paraxial image height of 3 mm, f = 11.6 mm
        (
            "FTYP 3 0 2 3\nXFLN 0 0\nYFLN 0 3",
            14.5,
        ),  # real image height: the triplet has little distortion
    ],
)
def test_lens_file_field(fields, widest_deg, diameters, tmp_path):
    """OpticStudio writes DIAM lines by default; they vignette rays and do not change the field."""
    text = prescriptions.zmx(per_surface=diameters)
    start, end = text.index("FTYP"), text.index("WAVM 1")
    (tmp_path / "lens.zmx").write_text(text[:start] + fields + "\n" + text[end:])
    lens = lens_of(tmp_path / "lens.zmx", focus_distance_mm=1e6)
    assert lens.field_max_deg == pytest.approx(
        1.05 * widest_deg, rel=0.03 if widest_deg == 14.5 else 1e-4
    )
    if diameters is not DIAMETERS:
        assert np.degrees(np.arctan(lens.field.end)) == pytest.approx(lens.field_max_deg)


def test_field_beyond_lens_file_rejected(file, tmp_path):
    with pytest.raises(
        OmnimirrorError, match=r"ends at 10 deg; .* increase field_max_deg \(now 10\)"
    ):
        _ = (
            sensor_with(lens_of(file, field_max_deg=10.0)).field_deg,
            om.evaluate(sensor_with(lens_of(file, field_max_deg=10.0)), OMEGA),
        )


def test_lens_file_in_inches(file, tmp_path):
    text = prescriptions.zmx(
        radii=prescriptions.RADII / 25.4, gaps=prescriptions.GAPS / 25.4
    ).replace("UNIT MM", "UNIT IN")
    (tmp_path / "inches.zmx").write_text(
        text.replace(f"ENPD {11.6 / 4!r}", f"ENPD {11.6 / 4 / 25.4!r}")
    )
    assert lens_of(tmp_path / "inches.zmx").focal_length_mm == pytest.approx(
        lens_of(file).focal_length_mm, rel=1e-12
    )


def test_sensor_file_names_lens_file(file, sensor, tmp_path):
    text = format_sensor(om.load_sensor("paper-spherical"))
    head, tail = text.split("[lens]\n")
    tail = tail[tail.index("[imager]") :]
    path = tmp_path / "mine.toml"
    (tmp_path / "triplet.zmx").write_bytes(file.read_bytes())
    path.write_text(
        f'{head}[lens]\nkind = "surfaces"\nfile = "triplet.zmx"\nfocus_distance_mm = 212.0\n\n{tail}'
    )
    sensor_of_file = om.load_sensor(path)
    assert sensor_of_file.lens == sensor.lens
    assert om.parse_sensor(format_sensor(sensor_of_file)) == sensor_of_file
    with pytest.raises(OmnimirrorError, match=r"lens\.file must not name a file"):
        om.parse_sensor(path.read_text())


BAD = {
    "unknown glass": (
        prescriptions.zmx(glasses=["N-SK61", "", "F2", "", "N-SK16", ""]),
        "N-SK61.*did you mean N-SK16",
    ),
    "missing surfaces": ("MODE SEQ\nUNIT MM\nSURF 0\nSURF 1\n", "got 2 surfaces"),
    "no stop": (prescriptions.zmx(stop=99), r"the stop \(STOP\); got 0"),
    "wrong unit": (
        prescriptions.zmx().replace("UNIT MM", "UNIT FURLONG"),
        "UNIT must be one of MM",
    ),
    "save one configuration separately": (
        prescriptions.zmx(head="MNUM 3 1"),
        "save one configuration separately",
    ),
    "non-sequential": (
        prescriptions.zmx().replace("MODE SEQ", "MODE NSC"),
        r"MODE must be SEQ \(sequential\); got NSC",
    ),
    "a shape": (
        prescriptions.zmx().replace("TYPE STANDARD", "TYPE TOROIDAL"),
        "TYPE must be STANDARD or EVENASPH; got TOROIDAL",
    ),
    "a mirror": (
        prescriptions.zmx(glasses=["MIRROR", "", "F2", "", "N-SK16", ""]),
        "lenses with mirror surfaces",
    ),
    "not a number": (
        prescriptions.zmx().replace("DISZ INFINITY", "DISZ far"),
        "cannot parse the line",
    ),
    "vignettes all": (
        prescriptions.zmx(per_surface={3: ["  CLAP 0 1e-6 0"]}),
        "must reach the imager",
    ),
    "too wide": (
        prescriptions.zmx().replace(f"ENPD {11.6 / 4!r}", "ENPD 40"),
        "must not exceed the surfaces",
    ),
    "wavelength": (
        prescriptions.zmx().replace("WAVM 3 0.6562725", "WAVM 3 9.6"),
        "the range of the data of N-SK16",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_lens_files_rejected(case, tmp_path):
    text, message = BAD[case]
    (tmp_path / "bad.zmx").write_text(text)
    with pytest.raises(OmnimirrorError, match=message) as error:
        lens_of(tmp_path / "bad.zmx")
    assert "\n" not in str(error.value)


def test_missing_lens_file_rejected(tmp_path):
    with pytest.raises(OmnimirrorError, match=r"cannot read .*nothing\.zmx"):
        lens_of(tmp_path / "nothing.zmx")


# -- glasses ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "index", "abbe"),
    [
        ("N-BK7", 1.51680, 64.17),
        ("N-SF11", 1.78472, 25.68),
        ("F2", 1.62004, 36.37),
        ("N-SK16", 1.62041, 60.32),
        ("S-BSL7", 1.51633, 64.14),
        ("S-TIH53", 1.84666, 23.78),
        ("H-K9L", 1.51680, 64.20),
        ("PMMA", 1.4914, 57.4),
        ("POLYCARB", 1.5848, 29.9),
    ],
)
def test_glass_indices_match_data_sheets(name, index, abbe):
    glass = glass_named(name, (), None)
    d, f, c = (glass.index(w) for w in (0.5875618, 0.4861327, 0.6562725))
    assert d == pytest.approx(index, abs=1.5e-5 if name[0] != "P" else 2e-3)
    assert (d - 1) / (f - c) == pytest.approx(abbe, abs=0.02 if name[0] != "P" else 5.0)


def test_catalogue_file_takes_precedence(tmp_path):
    lines = [
        "CC test",
        "NM N-SK16 2 0 1.5 60 0 1",
        "CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653",
    ]
    (tmp_path / "mine.agf").write_text("\n".join([*lines, "LD 0.3 2.5"]))
    glass = glass_named("N-SK16", (), read_agf(tmp_path / "mine.agf"))
    assert glass.index(0.5875618) == pytest.approx(1.5168, abs=1e-5)
    (tmp_path / "bad.agf").write_text("NM X\n")
    with pytest.raises(OmnimirrorError, match=r"cannot parse .* as a line of a glass catalogue"):
        read_agf(tmp_path / "bad.agf")


def test_schott_dispersion_formula():
    """n^2 = a0 + a1 l^2 + a2 l^-2 + ..., coefficients of the old BK7 data sheet."""
    a = (2.2718929, -1.0108077e-2, 1.0592509e-2, 2.0816965e-4, -7.6472538e-6, 4.9240991e-7)
    powers = (a[0], a[1], 2.0, a[2], -2.0, a[3], -4.0, a[4], -6.0, a[5], -8.0)
    assert Glass("BK7", "powers", powers).index(0.5875618) == pytest.approx(1.5168, abs=1e-5)


def test_zmx_export_contains_ideal_lens(sensor, tmp_path):
    [export] = om.export(sensor, tmp_path, formats=["zmx"])
    text = export.path.read_text(encoding="utf-16")
    assert (
        "The lens is ideal, with the focal length, entrance pupil and focus of the sensor." in text
    )


@pytest.mark.parametrize("curvature", [1e-6, 1e-12, 0.0, 5e-324, 1e3])
@pytest.mark.parametrize("thickness", [3.0, 1e4])
def test_extreme_curvatures_without_warning(curvature, thickness):
    try:
        lens = SurfaceLens(4.0, 1e7, (curvature, -curvature), (thickness, 0.0), (1.5, 1.0), 1)
    except InvalidParameter:
        return
    thick = 0.5 * curvature * (2 - 0.5 * thickness * curvature / 1.5)  # lensmaker's equation
    assert lens.focal_length_mm == pytest.approx(1 / thick, rel=1e-9)


def test_aperture_clearances():
    """(c^2 - r^2) / 2c of parallel rays through a stop and a plano-convex lens, by Snell's law at
    its curved face."""
    lens = SurfaceLens(
        8.0,
        1e6,
        (0.0, 1 / 25.84, 0.0),
        (10.0, 4.0, 0.0),
        (1.0, 1.5168, 1.0),
        1,
        clear_mm=(5.0, 0.0, 6.0),
    )
    heights = np.array([0.0, 1.0, 3.0, -2.0])
    points = np.stack([heights, 0 * heights, 7.0 + 0 * heights], axis=-1)
    clearances = lens.clearances(points, np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert list(clearances) == ["lens surface 1", "lens surface 3"]
    np.testing.assert_allclose(clearances["lens surface 1"], (25.0 - heights**2) / 10.0, rtol=1e-12)
    sag = 25.84 - np.sqrt(25.84**2 - heights**2)
    turn = np.arcsin(heights / 25.84) - np.arcsin(heights / 25.84 / 1.5168)
    behind = heights - (4.0 - sag) * np.tan(turn)
    np.testing.assert_allclose(clearances["lens surface 3"], (36.0 - behind**2) / 12.0, rtol=1e-9)
