"""Workshop files: entries on the sheets, and messages for invalid entries."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from scipy.integrate import quad

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.manufacturing import Body, PartSpecification, Workshop
from omnimirror.manufacturing.tolerancing.tolerance_file import (
    load_allocated_tolerances,
    tolerance_template,
)
from omnimirror.manufacturing.workshop import parse_workshop
from omnimirror.optics.thermal import DENSITIES_G_PER_CM3, EXPANSIONS_PPM
from tests.commands import omnimirror
from tests.conftest import MIRRORS

BODIES = {
    "plain": Body(thickness_mm=5.0),
    "flange": Body(thickness_mm=8.0, flange_width_mm=4.0),
    "drilled": Body(thickness_mm=8.0, bore_diameter_mm=5.0, bore_depth_mm=6.0),
    "through": Body(bore_diameter_mm=6.0, bore_depth_mm=np.inf),
    "counterbore": Body(
        bore_diameter_mm=6.0,
        bore_depth_mm=np.inf,
        counterbore_diameter_mm=14.0,
        counterbore_depth_mm=4.0,
    ),
}


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("kind", ["hyperboloid", "cone", "slope-spline"])
def test_volume_matches_integration_by_shells(kind, body):
    """Integrate ring by ring, independent of the outline."""
    mirror, _ = MIRRORS[kind]
    rim, back = mirror.rim_radius_mm, body.back_mm(mirror)
    shells = quad(
        lambda x: 2 * np.pi * x * (back - float(mirror.sag(x))),
        body.start_mm(),
        rim,
        epsabs=1e-9,
        epsrel=1e-11,
        limit=200,
    )[0]
    shells += np.pi * ((rim + body.flange_width_mm) ** 2 - rim**2) * body.flange_thickness_mm
    if body.bore_mm and not body.bore_goes_through:
        r = body.bore_mm / 2
        shells -= np.pi * r * r * (body.bore_depth_mm + r / np.tan(np.radians(59)) / 3)
    if wide := body.counterbore_diameter_mm / 2:
        shells -= np.pi * (wide**2 - (body.bore_mm / 2) ** 2) * body.counterbore_depth_mm
    assert body.volume_mm3(mirror) == pytest.approx(shells, rel=1e-6)


def test_all_materials_have_a_density():
    assert set(DENSITIES_G_PER_CM3) == set(EXPANSIONS_PPM)
    assert (
        PartSpecification(material="stainless steel 1.4301").density
        == DENSITIES_G_PER_CM3["stainless_steel"]
    )
    assert PartSpecification(material="brass", density_g_per_cm3=8.4).density == 8.4
    assert PartSpecification(material="RSA-6061").density is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[title]\nnumbr = 'A'", "line 2: unknown entry title.numbr; did you mean number"),
        ("[title]\nnumber = 7", "workshop file line 2: number must be a string; got 7"),
        (
            "[title]\nowner = 'x'\ndate = '22.11.2026'",
            "line 3: date must have the format 2026-11-22; got '22.11.2026'",
        ),
        ("[title]\ntitle = '" + 60 * "x" + "'", "printable text of at most 48 characters"),
        (
            "[mirror]\nmaterial = 'brass'\nform_um = -1",
            r"workshop file line 3: form_um must be between 0\.0001 and 10000 um; got -1",
        ),
        ("[mirrors]\nform_um = 1", "unknown entry mirrors; did you mean mirror"),
        ("[mirror", "workshop file"),
    ],
)
def test_invalid_files_are_rejected_with_line(text, message):
    with pytest.raises(SpecError, match=message.replace("[", r"\[")):
        parse_workshop(text)


def test_negative_tolerance_is_rejected():
    with pytest.raises(InvalidParameter, match=r"tolerance of mirror\.conic"):
        Workshop(tolerances={"mirror.conic": -1.0})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"counterbore_diameter_mm": 10.0}, "the diameter of a through bore"),
        (
            {"bore_diameter_mm": 12.0, "bore_depth_mm": np.inf, "counterbore_diameter_mm": 10.0},
            "larger than the diameter of a through bore",
        ),
    ],
)
def test_counterbore_requires_a_through_bore(options, message):
    with pytest.raises(InvalidParameter, match=message):
        Body(**options)


def test_excessive_counterbore_message_states_a_valid_depth():
    mirror, _ = MIRRORS["hyperboloid"]
    bore = {"bore_diameter_mm": 6.0, "bore_depth_mm": np.inf, "counterbore_diameter_mm": 14.0}
    with pytest.raises(InvalidParameter, match=r"a depth of at most 52\.\d+") as error:
        Body(**bore, counterbore_depth_mm=55.0).outline(mirror)
    deepest = float(str(error.value).rsplit(" ", 1)[1])
    floor = Body(**bore, counterbore_depth_mm=deepest).outline(mirror)[3, 1]
    assert floor - float(mirror.sag(7.0)) == pytest.approx(1.0, abs=0.011)


def test_allocated_tolerances_are_read_from_toml_and_json(tmp_path):
    sensor = om.load_sensor("paper-spherical")
    (tmp_path / "t.toml").write_text(tolerance_template(sensor))
    tolerances = load_allocated_tolerances(tmp_path / "t.toml", sensor)
    assert tolerances["mirror.decentre_x_mm"] == 0.05
    rows = [{"name": name, "tolerance": value} for name, value in tolerances.items()]
    for allocation, expected in (
        (None, tolerances),
        ({"tolerances": {"mirror.tilt_x_deg": 0.03}}, {"mirror.tilt_x_deg": 0.03}),
    ):
        (tmp_path / "t.json").write_text(
            json.dumps({"allocation": allocation, "sensitivities": rows})
        )
        assert load_allocated_tolerances(tmp_path / "t.json", sensor) == expected
    for text, message in (
        ("[]", "is not a file of omnimirror tolerance"),
        (
            '{"allocation": {"tolerances": {"mirror.tilt_z_deg": 1}}}',
            "'mirror.tilt_z_deg' is not an error source",
        ),
    ):
        (tmp_path / "t.json").write_text(text)
        with pytest.raises((SpecError, InvalidParameter), match=message):
            load_allocated_tolerances(tmp_path / "t.json", sensor)


def test_command_lists_missing_entries(tmp_path):
    run = omnimirror("export", "paper-spherical", "-o", "mirror.svg", cwd=tmp_path)
    output = " ".join(run.stdout.split())
    assert "Missing entries of the drawing: number, owner, approved_by, mirror.material" in output
    (tmp_path / "w.toml").write_text(
        "[title]\nnumber = 'OM-7'\nowner = 'me'\napproved_by = 'you'\ndate = '2026-11-22'\n"
        "[mirror]\nmaterial = 'brass'\ncoating = 'none'\nsurface_roughness_nm = 8\n"
        "imperfections = '5x0.16'\n"
    )
    run = omnimirror(
        "export", "paper-spherical", "-o", "mirror.svg", "--workshop", "w.toml", cwd=tmp_path
    )
    assert "A shop" not in run.stdout
    assert "OM-7" in (tmp_path / "mirror-mirror.svg").read_text()


SPHERE = om.load_sensor("paper-spherical")


@pytest.mark.parametrize(
    ("process", "tolerances", "message"),
    [
        (
            {"centring_deg": 0.2},
            {"mirror.tilt_x_deg": 0.5, "mirror.tilt_y_deg": 0.1},
            "tilt of the mirror",
        ),
        (
            {"centring_deg": 0.07, "back_flatness_mm": 0.1},
            {"mirror.tilt_x_deg": 0.1},
            "use 0.135 deg of the 0.1 deg",
        ),
        ({"back_flatness_mm": 0.1, "centring_deg": 0.05}, {}, "lets datum A tilt by 0.0652 deg"),
        (
            {"centring_mm": 0.03, "diameter_tolerance_mm": 0.02},
            {"mirror.decentre_y_mm": 0.05},
            "decentre of the mirror",
        ),
        (
            {},
            {"mirror.decentre_x_mm": 0.2},
            r"general tolerance of the diameter \(ISO 2768-m\) uses 0.3 mm",
        ),
        ({"thickness_tolerance_mm": 0.1}, {"mirror.displacement_mm": 0.1}, "spacing of the mirror"),
        (
            {"form_um": 1.0},
            {"mirror.zernike_4_um": 0.3},
            "permits an RMS of 0.605 um along z, and 0.173 um",
        ),
        (
            {"form_um": 1.0},
            {"mirror.vertex_radius_mm": 0.05},
            r"vertex_radius_mm ± 0.05 departs by .* P-V",
        ),
        ({"form_um": 1.0}, {"mirror.conic": 0.005}, r"mirror.conic ± 0.005 departs by .* P-V"),
    ],
)
def test_conflicting_tolerances_are_listed(process, tolerances, message):
    (conflict,) = om.tolerance_conflicts(
        SPHERE, Workshop(mirror=PartSpecification(**process), tolerances=tolerances)
    )
    assert re.search(message, conflict), conflict


@pytest.mark.parametrize(
    ("process", "tolerances"),
    [
        ({}, {}),
        ({"centring_deg": 0.05, "back_flatness_mm": 0.005}, {"mirror.tilt_x_deg": 0.1}),
        ({"centring_mm": 0.02, "diameter_tolerance_mm": 0.02}, {"mirror.decentre_x_mm": 0.05}),
        ({"thickness_tolerance_mm": 0.05}, {"mirror.displacement_mm": 0.1}),
        ({"form_um": 0.2}, {"mirror.zernike_4_um": 0.3, "mirror.vertex_radius_mm": 1e-4}),
    ],
)
def test_consistent_tolerances_have_no_conflict(process, tolerances):
    assert (
        om.tolerance_conflicts(
            SPHERE, Workshop(mirror=PartSpecification(**process), tolerances=tolerances)
        )
        == []
    )


def test_radius_error_zone_matches_brute_force():
    """Search the axial shift in steps, with distances along the nominal normal."""
    tolerances = {"mirror.vertex_radius_mm": 0.05}
    (conflict,) = om.tolerance_conflicts(
        SPHERE, Workshop(mirror=PartSpecification(form_um=1.0), tolerances=tolerances)
    )
    r, R = np.linspace(0, 43.905, 2001), 49.9582
    dz = 1e3 * ((R + 0.05 - np.sqrt((R + 0.05) ** 2 - r**2)) - (R - np.sqrt(R**2 - r**2)))
    zones = [
        2 * np.abs((dz - shift) * np.sqrt(1 - (r / R) ** 2)).max()
        for shift in np.linspace(dz.min(), 0, 4001)
    ]
    assert float(re.search(r"departs by ([\d.]+) um", conflict)[1]) == pytest.approx(
        min(zones), rel=0.01
    )


def test_command_warns_of_conflicting_tolerances(tmp_path):
    (tmp_path / "shop.toml").write_text("[mirror]\ncentring_deg = 0.5\n")
    (tmp_path / "tolerances.toml").write_text(
        '[[error]]\nname = "mirror.tilt_x_deg"\ntolerance = 0.1\n'
    )
    done = omnimirror(
        "export",
        "paper-spherical",
        "-o",
        "a.svg",
        "--workshop",
        "shop.toml",
        "--tolerances",
        "tolerances.toml",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "inconsistent tolerances: mirror.centring_deg = 0.5 uses 0.5 deg" in " ".join(
        done.stdout.split()
    )
