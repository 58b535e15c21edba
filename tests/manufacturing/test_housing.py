"""Obscurations on drawings against rays traced point by point; image shifts against other formulas."""

from __future__ import annotations

from dataclasses import astuple, replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing import Body, image_shifts
from omnimirror.manufacturing.body import parts_of, with_housing
from omnimirror.manufacturing.drawings.sensor_view import Assembly, shell_end_mm
from omnimirror.manufacturing.drawings.tables import obscuration_rows
from omnimirror.optics.housing import CameraBody, Dome, FlatWindow, Housing, Rod, Tube
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import Sphere
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.tracing.shell_transmission import wall_transmission
from tests.conftest import MIRRORS, sensor_of

SPH = om.load_sensor("paper-spherical")


def as_drawn(sensor, housing, body=None):
    """Return the sensor as drawn."""
    return with_housing(parts_of(sensor, body), housing)


def lens_height(sensor):
    m = sensor.mirror_distance_mm
    return -m if np.isfinite(m) else -2.5 * sensor.mirror.rim_radius_mm


def percent(sensor):
    return sum(ring.image_percent for ring in sensor.obscured)


def marched_obscuration(sensor, solid, count=1500):
    """Return obscured field angles (deg) and image fraction (%) by marching chief rays in steps of
    0.05 mm.
    """
    x = np.linspace(1e-6, sensor.mirror.rim_radius_mm, count)
    rays = sensor.meridian.trace(x)
    lens = lens_height(sensor)
    hidden = np.zeros(count, bool)
    for i in range(count):
        t = np.linspace(0, 1, 4000)[1:]
        foot = x[i] if sensor.lens.TELECENTRIC else 0.0
        inner = np.stack([x[i] + t * (foot - x[i]), rays.z[i] + t * (lens - rays.z[i])])
        outer = np.stack(
            [x[i] + 400 * t * np.sin(rays.omega[i]), rays.z[i] - 400 * t * np.cos(rays.omega[i])]
        )
        hidden[i] = any(solid(*leg).any() for leg in (inner, outer))
    h = sensor.image_height_px(rays) / sensor.rim_radius_px
    edges = np.concatenate([[0.0], (h[1:] + h[:-1]) / 2, [1.0]])
    share = 100 * (np.diff(edges**2) * hidden).sum()
    return np.degrees(rays.omega[hidden]), share


@pytest.mark.parametrize(
    "sensor",
    [SPH, om.load_sensor("paper-hyperboloidal"), om.load_sensor("paraboloid-telecentric")],
    ids=lambda s: s.name,
)
def test_rod_obscures_the_centre(sensor):
    (ring,) = as_drawn(sensor, Housing(rod=Rod(4.0, gap_mm=30.0))).obscurations
    foot = lens_height(sensor) + 30.0
    omega, share = marched_obscuration(
        sensor, lambda x, z: (np.abs(x) < 2.0) & (z > foot) & (z < 0)
    )
    assert ring.part == "rod"
    assert ring.omega_deg[0] == 0.0
    assert ring.omega_deg[1] == pytest.approx(omega.max(), abs=0.15)
    assert ring.image_percent == pytest.approx(share, abs=0.05)


@pytest.mark.parametrize("diameter", [100.0, 130.0])
def test_tube_obscures_at_its_ends(diameter):
    body = Body(thickness_mm=5.0)
    sensor = as_drawn(SPH, Housing(shell=Tube(diameter)), body)
    inner, back, lens = diameter / 2 - 3.0, body.back_mm(SPH.mirror), lens_height(SPH)
    rings = sensor.obscurations

    def solid(
        x, z
    ):  # thin discs inside the tube, except the back of the mirror and the position of the lens
        base = (np.abs(z - lens) < 0.06) & (x < inner) & (x > 0.2)
        cap = (np.abs(z - back) < 0.06) & (x < inner) & (x > SPH.mirror.rim_radius_mm)
        return base | cap

    omega, share = marched_obscuration(SPH, solid)
    assert percent(sensor) == pytest.approx(share, abs=0.3)
    assert {r.part for r in rings} == (
        {"tube's base"} if diameter == 100 else {"tube's base", "tube's cap"}
    )
    low = omega[omega < 90].max()
    assert next(r for r in rings if r.part == "tube's base").omega_deg[1] == pytest.approx(
        low, abs=0.3
    )
    if diameter == 130:
        high = omega[omega > 90].min()
        assert next(r for r in rings if r.part == "tube's cap").omega_deg[0] == pytest.approx(
            high, abs=0.3
        )


def test_default_tube_clears_the_rim_ray():
    sensor = as_drawn(SPH, Housing(shell=Tube()))
    tube = sensor.obstructions.housing.shell
    assert tube.diameter_mm == 100.0  # 87.81 and 2 x (3 + 3), rounded up to 1 mm
    assert [r.part for r in sensor.obscurations] == ["tube's base"]
    omega = np.radians(SPH.field_deg[1])
    exit_height = float(SPH.mirror.sag(43.905)) - (50.0 - 43.905) / np.tan(omega)
    assert shell_end_mm(SPH, tube, Body().back_mm(SPH.mirror)) == pytest.approx(exit_height)


def test_flange_obscuration_is_reported():
    flat = Body(thickness_mm=5.0, flange_width_mm=10.0, flange_thickness_mm=5.0)
    (ring,) = as_drawn(SPH, Housing(), flat).obscurations
    assert ring.part == "rim"
    assert ring.omega_deg[1] == pytest.approx(SPH.field_deg[1])
    thick_flange = replace(flat, thickness_mm=20.0)
    assert as_drawn(SPH, Housing(), thick_flange).obscurations == ()


def test_rim_and_flange_are_equivalent():
    for body in (Body(), Body(8.0, flange_width_mm=4.0, flange_thickness_mm=3.0)):
        rim = body.rim(SPH.mirror)
        assert astuple(Body.of(rim, SPH.mirror).rim(SPH.mirror)) == pytest.approx(astuple(rim))
        sensor = replace(SPH, housing=Housing(rim=rim))
        assert parts_of(sensor)[0].body.outer_radius_mm(SPH.mirror) == body.outer_radius_mm(
            SPH.mirror
        )
        assert as_drawn(sensor, None).obscured == sensor.obscured


def test_overlapping_obscurations_count_once():
    combined = as_drawn(SPH, Housing(CameraBody(30.0), Rod(4.0)))
    parts = {r.part: r.image_percent for r in combined.obscurations}
    assert set(parts) == {"rod", "camera"}
    assert percent(combined) == pytest.approx(max(parts.values()))
    assert percent(as_drawn(SPH, Housing())) == 0.0


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_all_mirrors_can_be_supported(kind):
    sensor = sensor_of(kind)
    for housing in (Housing(shell=Tube()), Housing(rod=Rod()), Housing()):
        for ring in as_drawn(sensor, housing).obscurations:
            low, high = ring.omega_deg
            assert sensor.field_deg[0] <= low < high <= sensor.field_deg[1] + 1e-9
            assert 0 < ring.image_percent < 100


@pytest.mark.parametrize(
    ("part", "entries", "message"),
    [
        (Tube, {"diameter_mm": 80.0}, "must be at least 93.81 mm"),
        (Dome, {"diameter_mm": 200.0}, "must be at least 235.05 mm, to enclose the mirror"),
        (Dome, {"diameter_mm": 200.0, "centre_mm": 30.0}, "to reach the plane of the lens"),
        (Dome, {"inner_shift_mm": 3.0}, "must be smaller in magnitude than wall_mm, 3 mm"),
        (Rod, {"gap_mm": 200.0}, "less than 180.429 mm"),
        (Rod, {"diameter_mm": 95.0}, "diameter_mm must be at most 87.81 mm at the mirror.* got 95"),
        (
            Rod,
            {"end_diameter_mm": 87.9},
            "end_diameter_mm must be at most .* at the mirror.* got 87.9",
        ),
        (Tube, {"diameter_mm": 5.0}, "must be less than 2.5 mm, the outer radius of the tube"),
        (Tube, {"refractive_index": 0.9}, r"refractive_index must be between 1 and 4; got 0\.9"),
    ],
)
def test_invalid_support_is_rejected(part, entries, message):
    with pytest.raises(InvalidParameter, match=message):
        as_drawn(SPH, Housing(**{"rod" if part is Rod else "shell": part(**entries)})).obscurations  # noqa: B018


def test_transmission_at_brewsters_angle():
    """Only one polarisation is reflected, by the square of (n^2 - 1)/(n^2 + 1)."""
    n = 1.5
    brewster = 90.0 - np.degrees(np.arctan(n))
    r = ((n**2 - 1) / (n**2 + 1)) ** 2
    assert float(wall_transmission(np.radians(90.0 - brewster), n)) == pytest.approx(
        (1 + (1 - r) / (1 + r)) / 2, rel=1e-12
    )


def test_sheet_states_shift_and_transmission():
    """Shift by Snell's law at a plate, and transmission by Fresnel's equations, for the named
    material.
    """
    sensor = as_drawn(SPH, Housing(shell=Tube(100.0, material="polycarbonate")))
    *_, (label, shift, transmission) = obscuration_rows(sensor)
    i = np.radians(45.0)
    t = np.arcsin(np.sin(i) / 1.5855)
    assert label == "tube at Ω = 135°"
    assert shift == f"shift {3.0 / np.cos(t) * np.sin(i - t):.2f} mm"
    s, p = (np.sin(i - t) / np.sin(i + t)) ** 2, (np.tan(i - t) / np.tan(i + t)) ** 2
    assert float(transmission.split()[0]) == pytest.approx(
        100 * ((1 - s) / (1 + s) + (1 - p) / (1 + p)) / 2, abs=0.06
    )


# -- manufacturing errors
# ------------------------------------------------------------------------------


def shifts_by_name(sensor):
    return {s.name: s for s in image_shifts(sensor)}


@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal", "exact-equidistant"])
def test_distance_shift_matches_a_perturbed_sensor(name):
    sensor = om.load_sensor(name)
    step = 0.01
    omega = np.radians(np.linspace(2.0, 0.985 * sensor.field_deg[1], 301))
    heights = []
    for sign in (1, -1):
        other = replace(sensor, mirror_distance_mm=sensor.mirror_distance_mm + sign * step)
        heights.append(
            other.image_height_px(other.meridian.trace(other.meridian.x_from_omega(omega)))
        )
    motion = np.abs(heights[0] - heights[1]).max() / (2 * step)
    assert shifts_by_name(sensor)["mirror distance"].px_per_unit == pytest.approx(motion, rel=0.02)


IN_WATER = om.Sensor(
    Sphere(28.39142, 22.0),
    Perspective(6.0, 4.0, 81.9085),
    Imager(1920, 1200, 3.0),
    mirror_distance_mm=68.68475,
    housing=Housing(shell=Tube(60.0, 2.0, material="sapphire", medium="water")),
    name="in-water",
)
IN_DOME = replace(SPH, housing=Housing(shell=Dome(300.0, material="polycarbonate")), name="in-dome")
BEFORE_WINDOW = om.Sensor(
    Sphere(80.0, 20.0),
    Perspective(8.0, 4.0, 100.0),
    Imager(1024, 1024, 5.2),
    mirror_distance_mm=90.0,
    housing=Housing(shell=FlatWindow(material="bk7")),
    name="before-window",
)


@pytest.mark.parametrize("sensor", [IN_WATER, IN_DOME, BEFORE_WINDOW], ids=lambda s: s.name)
def test_shift_behind_a_cover_matches_a_perturbed_sensor(sensor):
    """At field angles outside the cover, by the meridian of a displaced mirror in the same cover."""
    step = 0.01
    low, high = sensor.field_deg
    omega = np.radians(np.linspace(low + 0.02 * (high - low), high - 0.02 * (high - low), 301))
    heights = []
    for sign in (1, -1):
        other = replace(sensor, mirror_pose=MirrorPose(displacement_mm=sign * step))
        heights.append(
            other.image_height_px(other.meridian.trace(other.meridian.x_from_omega(omega)))
        )
    motion = np.abs(heights[0] - heights[1]).max() / (2 * step)
    assert shifts_by_name(sensor)["mirror distance"].px_per_unit == pytest.approx(motion, rel=0.03)


def test_tube_obscuration_is_not_attributed_to_the_secondary():
    assert {ring.part for ring in IN_WATER.obscurations} == {"tube's base"}
    folded = om.load_sensor("folded-spherical")
    assert "secondary, bore" in {ring.part for ring in folded.obscurations}


def test_slope_error_doubles_in_reflection():
    omega = np.linspace(2.0, 134.0, 300)
    rate = om.evaluate(SPH, omega).dh_domega_px_per_deg
    assert shifts_by_name(SPH)["surface slope"].px_per_unit == pytest.approx(
        2 * rate.max() * np.degrees(1e-3), rel=1e-3
    )


def test_sphere_tilt_is_equivalent_to_decentre():
    """A tilt moves the centre by R times the angle, to first order."""
    errors = shifts_by_name(SPH)
    decentre_mm = SPH.mirror.radius_mm * np.radians(1.0)
    assert errors["mirror tilt"].px_per_unit == pytest.approx(
        decentre_mm * errors["mirror decentre"].px_per_unit, rel=1e-3
    )


def test_form_shift_is_slope_times_slope_sensitivity():
    errors = shifts_by_name(SPH)
    slope_mrad = np.pi / SPH.mirror.rim_radius_mm  # slope of a bump of 1 um
    assert errors["surface form"].px_per_unit == pytest.approx(
        slope_mrad * errors["surface slope"].px_per_unit, rel=0.1
    )


def test_distance_has_no_effect_on_telecentric_sensors_and_cones():
    assert "mirror distance" not in shifts_by_name(om.load_sensor("paraboloid-telecentric"))
    assert shifts_by_name(sensor_of("cone"))["mirror distance"].tolerance() == np.inf


@pytest.mark.parametrize(
    "name", ["paper-spherical", "paper-hyperboloidal", "paraboloid-telecentric"]
)
@pytest.mark.parametrize(
    ("error", "field", "step"),
    [("mirror decentre", "decentre_x_mm", 1e-3), ("mirror tilt", "tilt_y_deg", 1e-3)],
)
def test_decentre_and_tilt_match_skew_rays(name, error, field, step):
    """The meridian is the azimuth of maximum effect."""
    sensor = om.load_sensor(name)
    omega = sensor.meridian.trace(np.linspace(0.02, 0.99, 121) * sensor.mirror.rim_radius_mm).omega[
        :, None
    ]
    azimuth = np.radians(np.arange(0, 181, 15))
    rays = [
        np.sin(omega) * np.cos(azimuth),
        np.sin(omega) * np.sin(azimuth),
        -np.cos(omega) + 0 * azimuth,
    ]
    directions = np.stack(rays, axis=-1).reshape(-1, 3) @ sensor.mount.rotation().T
    pixels = [
        replace(sensor, mirror_pose=MirrorPose(**{field: sign * step}))
        .project_directions(directions)
        .pixels
        for sign in (1, -1)
    ]
    motion = np.nanmax(np.hypot(*(pixels[0] - pixels[1]).T)) / (2 * step)
    assert shifts_by_name(sensor)[error].px_per_unit == pytest.approx(motion, rel=0.02)


def test_displaced_mirror_is_drawn_and_tilted_mirror_rejected():
    displaced = replace(SPH, mirror_pose=MirrorPose(displacement_mm=2.0))
    assembly = Assembly.of(as_drawn(displaced, Housing(shell=Dome(centre_mm=-80.0))), Body())
    assert (assembly.lens, assembly.base) == pytest.approx((-182.429, -182.429))
    assert assembly.housing.shell.centre_mm == pytest.approx(-82.0)
    with pytest.raises(InvalidParameter, match=r"use sensor.aligned\(\)"):
        as_drawn(replace(SPH, mirror_pose=MirrorPose(tilt_x_deg=1.0)), None).obscurations  # noqa: B018
