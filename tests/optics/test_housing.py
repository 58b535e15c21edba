"""Obscurations of a housing: equal angles in drawing, image, ground truth, evaluation and verdict."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.design.requirement_check import evaluable_field
from omnimirror.manufacturing.body import parts_of, with_housing
from omnimirror.optics.housing import (
    NO_HOUSING,
    CameraBody,
    Dome,
    Envelope,
    FlatWindow,
    Housing,
    Rim,
    Rod,
    Tube,
    wall_description,
)
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.materials import MATERIALS, index_of
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.pixel_rays import trace_pixels
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.environment import Environment

SPH = om.load_sensor("paper-spherical")
TELECENTRIC = om.load_sensor("paraboloid-telecentric")
CASES = {
    "camera": replace(SPH, housing=Housing(CameraBody(60.0, height_mm=4.0))),
    "rod": replace(SPH, housing=Housing(rod=Rod(6.0, 2.0, gap_mm=45.0))),
    "tube": replace(SPH, housing=Housing(shell=Tube(130.0))),
    "dome": replace(SPH, housing=Housing(shell=Dome())),
    "all": replace(SPH, housing=Housing(CameraBody(40.0), Rod(3.0), Tube(130.0))),
    "telecentric rod": replace(TELECENTRIC, housing=Housing(rod=Rod(5.0))),
    "telecentric tube": replace(TELECENTRIC, housing=Housing(shell=Tube(90.0))),
}
EDGE_DEG = 0.01
WIDTH = 61


WALLS = {
    "diameter_mm": (1e-3, 1e5),
    "wall_mm": (1e-3, 1e3),
    "refractive_index": (1.0, 4.0),
    "medium_index": (1.0, 4.0),
    "decentre_x_mm": (-1e4, 1e4),
    "decentre_y_mm": (-1e4, 1e4),
    "tilt_x_deg": (-45.0, 45.0),
    "tilt_y_deg": (-45.0, 45.0),
}
LIMITS = {
    Tube: WALLS,
    Dome: WALLS | {"centre_mm": (-1e5, 1e5), "inner_shift_mm": (-1e3, 1e3)},
    FlatWindow: WALLS | {"height_mm": (-1e5, 1e5)},
    CameraBody: {"diameter_mm": (1e-3, 1e5), "height_mm": (-1e5, 1e5), "lens_diameter_mm": (1e-3, 1e5)},
    Rod: {"diameter_mm": (1e-3, 1e5), "end_diameter_mm": (0.0, 1e5), "gap_mm": (0.0, 1e5)},
    Rim: {"width_mm": (0.0, 1e4), "setback_mm": (0.0, 1e4), "thickness_mm": (1e-3, 1e4)},
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind, limits in LIMITS.items() for name in limits]
)
def test_sizes_are_limited(kind, name):
    """Values at the limits are valid, values just beyond are not."""
    low, high = LIMITS[kind][name]
    required = {"diameter_mm": 1.0} if kind is CameraBody else {}
    for value in (low - 1e-4, high + 0.1):
        with pytest.raises(
            InvalidParameter, match=re.escape(f"{name} must be between {low:g} and {high:g}")
        ):
            kind(**required | {name: value})
    for value in (low, high):
        kind.PARAMETERS[name].check(name, value)


@pytest.mark.parametrize(
    ("part", "defaults"),
    [
        (CameraBody(60.0), {"height_mm": 0.0, "lens_diameter_mm": 24.0}),
        (Rod(), {"diameter_mm": 4.0, "end_diameter_mm": None, "gap_mm": None}),
        (Rim(), {"width_mm": 0.0, "setback_mm": 0.0, "thickness_mm": 5.0}),
        (Housing(), dict.fromkeys(("camera", "rod", "shell", "rim", "secondary_rim"))),
    ],
)
def test_part_defaults(part, defaults):
    """As documented in docs/sensor-file.md."""
    assert {name: getattr(part, name) for name in defaults} == defaults


def test_rod_fits_between_lens_and_mirror():
    """The foot is at a quarter of the distance by default; the end is as wide as the mirror at most."""
    envelope = Envelope(-180.0, -180.0, 20.0, 45.0)
    fitted = Rod(6.0).fitted(envelope)
    assert (fitted.end_diameter_mm, fitted.gap_mm) == (6.0, 45.0)
    rim_mm = TELECENTRIC.mirror.rim_radius_mm  # a telecentric lens is assumed at 2.5 rim radii
    rod = CASES["telecentric rod"].obstructions.housing.rod
    assert rod.gap_mm == pytest.approx(2.5 * rim_mm / 4, rel=1e-12)
    assert Rod(6.0, 0.0, 0.0).fitted(envelope) == Rod(6.0, 0.0, 0.0)
    assert Rod(90.0, gap_mm=179.9).fitted(envelope) == Rod(90.0, 90.0, 179.9)
    assert Rod(100.0, 90.0).fitted(envelope).end_diameter_mm == 90.0
    for rod, message in (
        (Rod(gap_mm=180.0), "gap_mm must be less than 180 mm, the distance from lens to mirror; got 180"),
        (Rod(90.5), "diameter_mm must be at most 90 mm at the mirror, the diameter of the mirror; got 90.5"),
        (Rod(4.0, 91.0), "end_diameter_mm must be at most 90 mm at the mirror, .*; got 91"),
    ):  # fmt: skip
        with pytest.raises(InvalidParameter, match=rf"^{message}$"):
            rod.fitted(envelope)


def test_second_mirror_excludes_parts():
    envelope = Envelope(-180.0, -120.0, 20.0, 45.0, has_secondary=True)
    for housing, message in (
        (Housing(rod=Rod()), "housing.rod is not supported with a secondary, whose view"),
        (Housing(shell=Dome()), "housing.dome is not supported with a secondary; use a tube"),
        (Housing(shell=FlatWindow()), "housing.window is not supported with a secondary; use a tube"),
        (Housing(CameraBody(61.5)), r"camera's front \(diameter_mm = 61.5\)"),
    ):  # fmt: skip
        with pytest.raises(InvalidParameter, match=message):
            housing.fitted(envelope)
        assert housing != NO_HOUSING
    assert Housing(shell=Tube()).fitted(envelope) == Housing(shell=Tube(102.0))
    assert NO_HOUSING.fitted(envelope) == NO_HOUSING
    assert Envelope(-180.0, -180.0, 20.0, 45.0).has_secondary is False
    fitted = Housing(CameraBody(61.5), Rod(), FlatWindow()).fitted(Envelope(*envelope[:4]))
    assert (fitted.rod.gap_mm, fitted.shell.height_mm) == (45.0, -185.0)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"camera": Rod()}, "camera must be an instance of CameraBody"),
        ({"rod": CameraBody(1.0)}, "rod must be an instance of Rod"),
        ({"shell": Rod()}, "shell must be an instance of Tube or Dome or FlatWindow"),
        ({"rim": Rod()}, "rim must be an instance of Rim"),
        ({"secondary_rim": 0}, "secondary_rim must be an instance of Rim"),
    ],
)
def test_parts_of_other_types_rejected(parts, message):
    with pytest.raises(InvalidParameter, match=message):
        Housing(**parts)


@pytest.mark.parametrize("kind", [Tube, Dome, FlatWindow])
def test_one_entry_for_an_index(kind):
    """With a material name, only the default index is accepted."""
    for value in (1.3, 1.6):
        with pytest.raises(InvalidParameter, match=f"both be given; got {value:g} and 'bk7'"):
            kind(material="bk7", refractive_index=value)
    with pytest.raises(InvalidParameter, match=r"both be given; got 1.2 and 'water'"):
        kind(medium="water", medium_index=1.2)
    named = kind(
        material="bk7", medium="water", refractive_index=float("1.49"), medium_index=float("1.0")
    )
    assert (named.index, named.outer_index) == (
        MATERIALS["bk7"].index_d,
        MATERIALS["water"].index_d,
    )
    blue = named.at_wavelength(450.0)
    assert (blue.material, blue.medium) == (None, None)
    assert blue.index == index_of("bk7", 450.0) > named.index
    assert blue.outer_index == index_of("water", 450.0) > named.outer_index
    measured = kind(refractive_index=1.7, medium_index=1.2)
    assert measured.at_wavelength(450.0) == measured
    assert (measured.index, measured.outer_index) == (1.7, 1.2)


def test_wall_description_names_materials():
    assert wall_description(Tube(medium="air")) == "n = 1.49"
    assert wall_description(Dome(material="fused_silica")) == "fused silica, n = 1.45846"
    assert (
        wall_description(FlatWindow(refractive_index=1.7, medium_index=1.2))
        == "n = 1.7, in a medium of n = 1.2"
    )


def test_wall_leaves_space():
    for kind in (Tube, Dome):
        assert kind(100.0, 49.9).radii_mm == (pytest.approx(0.1), 50.0)
        with pytest.raises(
            InvalidParameter,
            match=f"wall_mm must be less than 50 mm, the outer radius of the {kind.KIND}; got 50",
        ):
            kind(100.0, 50.0)
    assert FlatWindow(4.0, 2.0).wall_mm == 2.0  # a pane has no inside
    for shift in (3.0, -3.0):
        with pytest.raises(
            InvalidParameter,
            match=f"inner_shift_mm must be smaller in magnitude than wall_mm, 3 mm; got {shift:g}",
        ):
            Dome(inner_shift_mm=shift)
    assert Dome(wall_mm=0.5, inner_shift_mm=-0.4).inner_shift_mm == -0.4


def test_cover_default_sizes():
    """Minimum diameters by Pythagoras, from the back of the mirror; default diameters have a
    clearance of 3 mm, rounded up to 1 mm."""
    envelope = Envelope(-180.0, -180.0, 20.0, 45.0)
    tube, dome = Tube(wall_mm=4.0), Dome(wall_mm=4.0, centre_mm=-50.0)
    assert tube.diameters(45.0) == (98.0, 104.0)
    assert dome.diameters(-180.0, 20.0, 45.0)[0] == pytest.approx(
        2 * (np.hypot(45.0, 70.0) + 4.0), rel=1e-12
    )
    assert dome.diameters(-180.0, 20.0, 45.0)[1] == np.ceil(2 * (np.hypot(48.0, 130.0) + 4.0))
    for shell, min_diameter_mm in ((tube, 98.0), (dome, 2 * (np.hypot(45.0, 70.0) + 4.0))):
        with pytest.raises(
            InvalidParameter, match=f"diameter_mm .* must be at least {min_diameter_mm:.4g}"
        ):
            replace(shell, diameter_mm=min_diameter_mm - 0.01).fitted(envelope)
    assert replace(tube, diameter_mm=98.0).fitted(envelope).diameter_mm == 98.0
    assert tube.fitted(envelope).diameter_mm == 104.0
    assert Tube(wall_mm=4.0).fitted(envelope).inner_radius_mm(7.0) == 48.0
    middle = Dome(wall_mm=4.0).fitted(envelope)
    assert middle.centre_mm == -80.0  # halfway between the lens and the back
    assert middle.diameter_mm == np.ceil(2 * (np.hypot(48.0, 100.0) + 4.0))
    low = Dome(wall_mm=4.0, centre_mm=-150.0)  # closer to the lens than to the back
    assert low.diameters(-180.0, 20.0, 45.0)[1] == np.ceil(2 * (np.hypot(48.0, 170.0) + 4.0))
    # a triangle of 5, 12 and 13: exact minimum, and a dome that just reaches the lens
    exact, near = Dome(wall_mm=1.0, centre_mm=0.0), Envelope(-12.5, -12.5, 12.0, 5.0)
    assert replace(exact, diameter_mm=28.0).fitted(near).diameter_mm == 28.0
    with pytest.raises(
        InvalidParameter,
        match=r"^diameter_mm of the dome must be at least 28 mm, to enclose the mirror \(centre at 0 mm, "
        r"wall of 1 mm\); got 27.9$",
    ):
        replace(exact, diameter_mm=27.9).fitted(near)
    with pytest.raises(
        InvalidParameter,
        match=r"^diameter_mm of the tube must be at least 12 mm, to enclose the mirror with a wall of 1 mm; got 11$",
    ):
        Tube(11.0, 1.0).fitted(near)
    window = FlatWindow().fitted(envelope)
    assert window.heights_mm == (-185.0, -188.0)  # 5 mm beyond the lens
    assert FlatWindow(height_mm=-180.0).fitted(envelope).height_mm == -180.0
    with pytest.raises(
        InvalidParameter,
        match=r"height_mm must be at most -180 mm, the plane of the lens: .*; got -179.5",
    ):
        FlatWindow(height_mm=-179.5).fitted(envelope)
    with pytest.raises(
        InvalidParameter,
        match=r"greater than 268 mm, to reach the plane of the lens at -180 mm \(centre at -50 mm\); got 268$",
    ):
        replace(dome, diameter_mm=268.0).fitted(envelope)
    assert replace(dome, diameter_mm=268.1).fitted(envelope).diameter_mm == 268.1


@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_dome_inner_radius(shift):
    dome = Dome(200.0, 5.0, centre_mm=-40.0, inner_shift_mm=shift)
    for height in (-100.0, -40.0, 0.0, 30.0):
        assert dome.inner_radius_mm(height) == pytest.approx(
            np.sqrt(95.0**2 - (height + 40.0 - shift) ** 2), rel=1e-12
        )
    assert dome.inner_radius_mm(80.0) == 0.0


@pytest.fixture(params=CASES)
def sensor(request):
    return CASES[request.param]


def test_obscured_angles_consistent(sensor):
    low, high = sensor.clear_field_deg
    assert (low, high) != sensor.field_deg
    assert with_housing(parts_of(sensor)).clear_field_deg == pytest.approx((low, high), abs=1e-9)
    assert om.evaluate(sensor, [90.0]).summary()["clear_field_deg"] == [low, high]
    evaluable = evaluable_field(om.FieldRequirements(omega_max_deg=100.0), sensor)
    assert (evaluable.obscured_to_deg, evaluable.obscured_from_deg) == (low, high)


def magnified(sensor, omega_deg):
    """Return the sensor with a row of pixels of 0.002 deg, centred at a field angle."""
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians([omega_deg])))
    height, rate = sensor.image_height_px(rays)[0], np.radians(sensor.image_height_rate_px(rays)[0])
    pitch = sensor.imager.pixel_pitch_um * rate * 0.002
    centre = WIDTH // 2 - height * sensor.imager.pixel_pitch_um / pitch, 0.0
    return replace(sensor, imager=Imager(WIDTH, 1, pitch, centre))


def test_image_dark_at_obscured_angles(sensor):
    """Agreement to 0.01 deg, in the compiled kernels and in the ground truth."""
    white, edges = (
        Environment(np.ones((4, 8, 3), np.float32)),
        set(sensor.clear_field_deg) - set(sensor.field_deg),
    )
    for edge in edges:
        near = magnified(sensor, edge)
        light = (
            expose(near, white, samples=1, radiometry=Radiometry(housing_light=0.0))[0, :, 0] > 0.3
        )
        dark_first = edge == sensor.clear_field_deg[0]
        hidden = trace_pixels(near, np.stack([np.arange(WIDTH), np.zeros(WIDTH)], axis=-1)).hidden
        for dark in (~light, hidden):
            assert dark[0] == dark_first
            (at,) = np.flatnonzero(np.diff(dark.astype(int)))
            assert abs(at + 0.5 - WIDTH // 2) * 0.002 < EDGE_DEG


@pytest.mark.parametrize("name", ["camera", "rod", "rod in mirror", "tube", "dome", "all"])
def test_misaligned_image_dark_at_obscured_pixels(name):
    rod = replace(SPH, housing=Housing(rod=Rod(0.5, 16.0, gap_mm=160.0)))
    sensor = replace(CASES.get(name, rod), mirror_pose=MirrorPose(1.5, -1.0, 0.7, 0.4, -0.6))
    if (
        name == "rod in mirror"
    ):  # the vertex is inside the rod end, from which rays pass the rest of it
        sensor = replace(sensor, mirror_pose=replace(sensor.mirror_pose, displacement_mm=-0.7))
    sensor = replace(sensor, imager=Imager(200, 200, 5.2 * 1024 / 200))
    pixels = (
        np.stack(np.meshgrid(np.arange(200), np.arange(200)), axis=-1).reshape(-1, 2).astype(float)
    )
    hidden = np.any([*sensor.obscured_by(pixels).values()], axis=0)
    np.testing.assert_array_equal(trace_pixels(sensor, pixels).hidden, hidden)
    light = expose(
        sensor,
        Environment(np.ones((4, 8, 3), np.float32)),
        samples=1,
        radiometry=Radiometry(housing_light=0.0),
    )
    is_valid = sensor.backproject(pixels).valid
    dark = light[..., 0].ravel() < 0.3
    assert hidden.sum() > 100
    assert (dark[is_valid] != hidden[is_valid]).sum() <= 2, "single precision, at edges"


@pytest.mark.parametrize("kind", [Tube, Dome, FlatWindow])
def test_wall_defaults(kind):
    shell = kind()
    assert (shell.wall_mm, shell.index, shell.outer_index) == (3.0, 1.49, 1.0)
    assert shell.diameter_mm is None
    assert shell.material is None
    assert shell.medium is None
    assert shell.is_axial
    assert Dome().inner_shift_mm == 0.0
    for name in ("decentre_x_mm", "decentre_y_mm", "tilt_x_deg", "tilt_y_deg"):
        for value in (-0.5, 0.5):
            moved = kind(**{name: value})
            assert not moved.is_axial
            assert moved.centred() == shell
