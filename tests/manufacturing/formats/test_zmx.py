"""OpticStudio files with an independent reader: sag by mpmath, chief rays by reflection."""

from __future__ import annotations

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing import fit_asphere, format_grid_sag
from omnimirror.manufacturing.formats.sag import grid_deviation_um, write_grid_sag
from omnimirror.manufacturing.formats.zmx import field_angles, format_zmx, write_zmx
from omnimirror.optics.housing import Housing
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import Cone, ConicAsphere, EvenPolynomial, Rectifying, SampledProfile
from tests.conftest import MIRRORS, SURFACES_OF_LENS_FILES, sensor_of
from tests.everyday import FEW_MIRRORS, few
from tests.manufacturing.test_housing import IN_DOME, IN_WATER


def parse_zmx(path):
    """Parse system lines and surfaces of a .zmx file."""
    system, surfaces = {}, []
    for line in path.read_text(encoding="utf-16").splitlines():
        key, *values = line.split()
        if key == "SURF":
            assert int(values[0]) == len(surfaces)
            surfaces.append({"PARM": {}, "XDAT": {}})
        elif not surfaces:
            system.setdefault(key, values)
        elif key in ("PARM", "XDAT"):
            surfaces[-1][key][int(values[0])] = mp.mpf(values[1])
        else:
            surfaces[-1][key] = values
    return system, surfaces


def sag_of(surface):
    """Evaluate the textbook formula of an even or odd asphere with 30 digits.

    Extended aspheres have number of terms, normalization radius and terms in the extra data.
    """
    c, k = mp.mpf(surface["CURV"][0]), mp.mpf(surface["CONI"][0])
    step, extended = {
        "EVENASPH": (2, False),
        "ODDASPHE": (1, False),
        "XASPHERE": (2, True),
        "XOSPHERE": (1, True),
    }[surface["TYPE"][0]]
    unit, terms = mp.mpf(1), surface["PARM"]
    if extended:
        assert not terms
        count, unit = surface["XDAT"][1], surface["XDAT"][2]
        terms = {i - 2: a for i, a in surface["XDAT"].items() if i > 2}
        assert sorted(terms) == list(range(1, int(count) + 1))

    def sag(r):
        return c * r**2 / (1 + mp.sqrt(1 - (1 + k) * c**2 * r**2)) + mp.fsum(
            a * (r / unit) ** (step * i) for i, a in terms.items()
        )

    return sag


@pytest.fixture(autouse=True)
def thirty_digits():
    with mp.workdps(30):
        yield


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_surface_matches_the_mirror_within_the_stated_deviation(kind, tmp_path):
    sensor = sensor_of(kind)
    stated = write_zmx(tmp_path / "s.zmx", sensor)[0].deviation_um
    _, surfaces = parse_zmx(tmp_path / "s.zmx")
    sag, mirror = sag_of(surfaces[2]), sensor.mirror
    for r in np.linspace(0.013, 1, 40) * mirror.rim_radius_mm:
        z, slope, _ = mirror.profile(r)
        off_um = 1e3 * abs(float(sag(mp.mpf(float(r))) - mp.mpf(float(z)))) / np.hypot(1, slope)
        assert off_um <= 1.01 * stated + 1e-6
    assert stated < 0.005
    if kind in SURFACES_OF_LENS_FILES:
        assert stated == 0
    assert surfaces[2]["GLAS"][0] == "MIRROR"
    assert float(surfaces[2]["DIAM"][0]) == mirror.rim_radius_mm


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_chief_rays_have_the_listed_field_angles(kind, tmp_path):
    """Trace from each field point through the centre of the stop to the reflection at the surface."""
    sensor = sensor_of(kind)
    write_zmx(tmp_path / "s.zmx", sensor)
    system, surfaces = parse_zmx(tmp_path / "s.zmx")
    assert system["FTYP"][:4] == ["1", "0", "7", "1"]
    assert float(system["ENPD"][0]) == pytest.approx(11.6 / 4)
    assert [s.get("TYPE") for s in surfaces[:2]] == [["STANDARD"], ["PARAXIAL"]]
    assert "STOP" in surfaces[1]
    assert surfaces[1]["PARM"] == {1: mp.mpf("11.6")}
    within_deg = (
        1e-6 if kind in SURFACES_OF_LENS_FILES else 1.01 * fit_asphere(sensor.mirror).ray_deg + 1e-6
    )
    assert within_deg < 1e-3
    b, m, sag = mp.mpf(surfaces[0]["DISZ"][0]), mp.mpf(surfaces[1]["DISZ"][0]), sag_of(surfaces[2])
    for omega, height in zip(field_angles(sensor), system["YFLN"], strict=False):
        slope = -mp.mpf(height) / b  # y over z behind the lens, undeviated at its centre
        y = mp.findroot(lambda y: y - slope * (m + sag(y)), slope * m) if slope else mp.mpf(0)  # noqa: B023
        beta, theta = mp.atan(mp.diff(sag, y)), mp.atan(slope)
        assert float(mp.degrees(2 * beta + theta)) == pytest.approx(omega, abs=within_deg)


def test_convex_mirror_has_positive_radius(tmp_path):
    """Light travels along +z from the lens, and the centre of curvature is beyond the vertex."""
    write_zmx(tmp_path / "s.zmx", sensor_of("sphere"))
    _, surfaces = parse_zmx(tmp_path / "s.zmx")
    assert 1 / float(surfaces[2]["CURV"][0]) == pytest.approx(49.9582)
    assert float(surfaces[1]["DISZ"][0]) > 0


def test_telecentric_chief_rays_are_axial(tmp_path):
    sensor = sensor_of("paraboloid", "orthographic")
    write_zmx(tmp_path / "s.zmx", sensor)
    system, surfaces = parse_zmx(tmp_path / "s.zmx")
    assert system["FTYP"][:2] == ["1", "1"]
    # from the focal plane, 22 mm behind the vertex, to the lens and to the mirror
    assert float(surfaces[0]["DISZ"][0]) + float(surfaces[1]["DISZ"][0]) == pytest.approx(-22.0)
    sag = sag_of(surfaces[2])
    for omega, height in zip(field_angles(sensor), system["YFLN"], strict=False):
        assert float(mp.degrees(2 * mp.atan(mp.diff(sag, mp.mpf(height))))) == pytest.approx(
            omega, abs=1e-9
        )


def test_missing_lens_distortion_is_noted(tmp_path):
    sensor = sensor_of("sphere")
    bent = replace(sensor, lens=replace(sensor.lens, k1=-0.2))
    systems = []
    for name, s in (("straight", sensor), ("bent", bent)):
        write_zmx(tmp_path / name, s)
        systems.append(parse_zmx(tmp_path / name)[0])
    np.testing.assert_allclose(*(np.array(s["YFLN"], float) for s in systems), rtol=1e-14)
    counts = [
        (tmp_path / name).read_text(encoding="utf-16").count("distortion")
        for name in ("straight", "bent")
    ]
    assert counts == [0, 1]


def test_focus_matches_the_sensor(tmp_path):
    """The imager is in focus: 1/f = 1/b0 + 1/L0."""
    sensor = sensor_of("sphere")
    write_zmx(tmp_path / "s.zmx", sensor)
    _, surfaces = parse_zmx(tmp_path / "s.zmx")
    lens: Perspective = sensor.lens
    assert 1 / float(surfaces[0]["DISZ"][0]) + 1 / lens.focus_distance_mm == pytest.approx(
        1 / 11.6, rel=1e-14
    )


def test_extended_asphere_represents_many_terms_exactly(tmp_path):
    sensor = sensor_of("even-polynomial")
    nine = EvenPolynomial((0.64, 0.1, 0, 0, 0, 0, 0, 0, 0.002), 40.0, 40.0)
    eight = EvenPolynomial((*nine.coefficients[:7], 0.002), 40.0, 40.0)
    for mirror, kind in ((eight, "EVENASPH"), (nine, "XASPHERE")):
        assert write_zmx(tmp_path / "s.zmx", replace(sensor, mirror=mirror))[0].deviation_um == 0
        _, surfaces = parse_zmx(tmp_path / "s.zmx")
        assert surfaces[2]["TYPE"] == surfaces[3]["TYPE"] == [kind]
        sag = sag_of(surfaces[2])
        for r in (7.0, 23.0, 40.0):
            assert float(sag(mp.mpf(r))) == pytest.approx(float(mirror.sag(r)), rel=1e-14)


@pytest.mark.parametrize("kind", ["rectifying", "ground-plane", "cylinder"])
def test_insufficient_terms_select_an_extended_asphere(kind, tmp_path):
    (form,) = write_zmx(tmp_path / "s.zmx", sensor_of(kind))
    text = (tmp_path / "s.zmx").read_text(encoding="utf-16")
    assert form.is_extended
    assert f"{kind} mirror as extended {form.kind} asphere of 16 terms" in text
    assert '  XDAT 1 16.0 0 0 1 0 0 ""' in text


def test_wide_ground_plane_mapping_is_accurate():
    """A ground-plane mapping up to 80 deg has the largest curvature of all mirrors."""
    form = fit_asphere(Rectifying(80.0, 12.0, 43.9))
    assert form.ray_deg < 0.005


def test_deviation_includes_measured_bumps():
    x = np.linspace(0, 40, 81)
    bumps = 0.005 * np.sin(x) ** 2  # 5 um
    mirror = SampledProfile(tuple(x), tuple(50 - np.sqrt(2500 - x**2) + bumps))
    assert 1.5 < fit_asphere(mirror).deviation_um < 6


def test_cone_and_conic_asphere_are_exact():
    assert fit_asphere(Cone(45.0, 20.0)).kind == "odd"
    form = fit_asphere(ConicAsphere(40.0, -0.6, 30.0, (0.03, 0.01), 30.0))
    assert (form.curvature, form.conic) == (1 / 40.0, -0.6)
    assert form.coefficients[:3] == pytest.approx((0.0, 0.03 / 30**3, 0.01 / 30**5), rel=1e-14)


# -- grid sag ------------------------------------------------------------------------------------------


def read_grid(text):
    first, *lines = text.splitlines()
    nx, ny, dx, dy, unit, xdec, ydec = map(float, first.split())
    assert (unit, xdec, ydec) == (0, 0, 0)
    table = np.array([line.split() for line in lines], dtype=float).reshape(int(ny), int(nx), 5)
    x = dx * (np.arange(nx) - (nx - 1) / 2)
    return x, -dy * (np.arange(ny) - (ny - 1) / 2), table


def bicubic(x, y, table, px, py):
    """Evaluate the bicubic Hermite patch of the cell of each point."""
    i = np.clip(np.searchsorted(x, px) - 1, 0, len(x) - 2)
    j = np.clip(np.searchsorted(-y, -py) - 1, 0, len(y) - 2)
    hx, hy = x[1] - x[0], y[1] - y[0]
    u, v = (px - x[i]) / hx, (py - y[j]) / hy
    value = [lambda t: (1 + 2 * t) * (1 - t) ** 2, lambda t: t * t * (3 - 2 * t)]
    slope = [lambda t: t * (1 - t) ** 2, lambda t: t * t * (t - 1)]
    total = np.zeros_like(px)
    for a in (0, 1):
        for b in (0, 1):
            z, zx, zy, zxy, _ = table[j + b, i + a].T
            total += value[a](u) * value[b](v) * z + slope[a](u) * value[b](v) * hx * zx
            total += value[a](u) * slope[b](v) * hy * zy + slope[a](u) * slope[b](v) * hx * hy * zxy
    return total


@pytest.mark.parametrize("kind", few(sorted(MIRRORS), *FEW_MIRRORS))
def test_grid_matches_the_mirror_within_the_stated_deviation(kind, tmp_path):
    mirror, _ = MIRRORS[kind]
    stated = write_grid_sag(tmp_path / "s.dat", mirror, 65)
    x, y, table = read_grid((tmp_path / "s.dat").read_text())
    assert x[0] < 0 < y[0]
    assert x[-1] == pytest.approx(y[0])
    assert not table[..., 4].any()

    gx, gy = np.meshgrid(x, y)
    on = np.hypot(gx, gy) <= mirror.rim_radius_mm
    np.testing.assert_allclose(table[on][:, 0], mirror.sag(np.hypot(gx, gy)[on]), atol=1e-12)

    rng = np.random.default_rng(3)
    r, phi = mirror.rim_radius_mm * np.sqrt(rng.random(20000)), 2 * np.pi * rng.random(20000)
    z, slope, _ = mirror.profile(r)
    off_um = (
        1e3
        * np.abs(bicubic(x, y, table, r * np.cos(phi), r * np.sin(phi)) - z)
        / np.hypot(1, slope)
    )
    # a smooth patch has its largest error at the cell centre; that at the tip of a cone is not
    # smooth
    beyond = r > 2 * (x[1] - x[0]) if kind == "cone" else np.ones_like(r, bool)
    assert off_um[beyond].max() <= 1.05 * stated + 1e-6


def test_grid_derivatives_match_differences():
    """Compare with central differences of neighbouring heights."""
    mirror, _ = MIRRORS["hyperboloid"]
    x, y, table = read_grid(format_grid_sag(mirror, 257))
    h = x[1] - x[0]
    z, zx, zy, zxy, _ = np.moveaxis(table, -1, 0)
    gx, gy = np.meshgrid(x, y)
    on = (np.hypot(gx, gy) < mirror.rim_radius_mm - 2 * h)[1:-1, 1:-1]
    np.testing.assert_allclose(
        zx[1:-1, 1:-1][on], ((z[1:-1, 2:] - z[1:-1, :-2]) / (2 * h))[on], atol=2e-3
    )
    np.testing.assert_allclose(
        zy[1:-1, 1:-1][on], ((z[:-2, 1:-1] - z[2:, 1:-1]) / (2 * h))[on], atol=2e-3
    )
    mixed = (z[:-2, 2:] - z[:-2, :-2] - z[2:, 2:] + z[2:, :-2]) / (4 * h * h)
    np.testing.assert_allclose(zxy[1:-1, 1:-1][on], mixed[on], atol=2e-3)
    assert np.abs(mixed[on]).max() > 0.01


def test_grid_deviation_decreases_with_the_fourth_power():
    mirror, _ = MIRRORS["hyperboloid"]
    assert grid_deviation_um(mirror, 65) / grid_deviation_um(mirror, 129) == pytest.approx(
        16, rel=0.4
    )


@pytest.mark.parametrize("points", [8, 128, 7, 3001])
def test_invalid_grid_size_is_rejected(points):
    with pytest.raises(InvalidParameter, match=f"grid_points must .* got {points}"):
        format_grid_sag(MIRRORS["sphere"][0], points)


@pytest.mark.parametrize(
    "sensor",
    [*map(om.load_sensor, ("paper-spherical", "folded-spherical")), IN_WATER, IN_DOME],
    ids=lambda s: s.name,
)
def test_notes_list_angles_and_omissions(sensor):
    notes = [line for line in format_zmx(sensor).splitlines() if line.startswith("NOTE")]
    (angles,) = (note for note in notes if "Omega = " in note)
    assert angles.count("180 deg") == (0 if sensor.secondary else 1)
    listed = [float(a) for a in angles.split("deg: ")[-1].rstrip(".").split(", ")]
    x = sensor.meridian.x_from_omega(np.radians(field_angles(sensor)))
    bare = replace(sensor, housing=Housing())
    if sensor.secondary is None:  # the file has no cover
        np.testing.assert_allclose(
            listed, np.degrees(bare.meridian.trace(x).omega), rtol=6e-4, atol=1e-9
        )
    assert any("is not included" in note for note in notes) == (sensor.housing.shell is not None)
