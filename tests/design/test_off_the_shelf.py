"""Catalogue search within the design, against separate designs of all combinations."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from omnimirror.design import _parameter_search, format_requirements, parse_requirements
from omnimirror.design import off_the_shelf as parts_search
from omnimirror.design._part_combinations import (
    combinations_of,
    cut,
    nearest_focus_mm,
    requirements_with_parts,
)
from omnimirror.design.catalogue import (
    BallComponent,
    Catalogue,
    DomeComponent,
    ExtraComponent,
    ImagerComponent,
    LensComponent,
    TelecentricComponent,
    read_catalogue,
)
from omnimirror.design.merits import mirror_mass_g, outer_size
from omnimirror.design.off_the_shelf import SLACK
from omnimirror.optics.lenses import SurfaceLens
from omnimirror.optics.mirrors import Sphere
from tests.commands import fails, omnimirror
from tests.optics.lenses import prescriptions

RINGS = (0.5, 1.0)
LENSES = tuple(
    LensComponent(
        f"{f:g} mm", f, F, max_f_number, near, circle, rings, price=price, mass_g=20.0, mount=mount
    )
    for f, F, max_f_number, near, circle, rings, price, mount in (
        (2.8, 2.0, 2.0, 30.0, 6.6, (), 8.0, "M12"),
        (4.0, 1.8, 8.0, 40.0, 7.2, (), 40.0, ""),
        (8.0, 1.4, 16.0, 100.0, 11.0, RINGS, 120.0, "C"),
        (12.0, 1.4, 16.0, 250.0, 11.0, RINGS, 100.0, "C"),
        (25.0, 1.4, 16.0, 300.0, 11.0, (), 95.0, "C"),
    )
)
IMAGERS = (
    ImagerComponent("small", 640, 480, 5.6, price=15.0, mass_g=10.0, mount="C M12"),
    ImagerComponent("fine", 3280, 2464, 1.12, price=25.0, mass_g=10.0, mount="M12"),
    ImagerComponent("large", 2448, 2048, 3.45, price=500.0, mass_g=50.0, mount="C"),
)
SHELF = Catalogue(
    (
        *LENSES,
        TelecentricComponent("wide", 0.1, 8.0, 16.0, 100.0, 11.0, price=1500.0, mass_g=1200.0),
    ),
    IMAGERS,
    (
        BallComponent("ball 50", 50.0, price=5.0, mass_g=30.0),
        BallComponent("ball 80", 80.0, price=9.0, mass_g=60.0),
    ),
    (
        DomeComponent("dome 60", 60.0, 2.0, price=8.0),
        DomeComponent("dome 200", 200.0, 3.0, price=12.0),
    ),
)
REDUCED_SHELF = Catalogue((*SHELF.lenses[:3], SHELF.lenses[-1]), IMAGERS[:2])
BLUR = om.Limit("total_blur_deg", at_most=0.9)
FINE = om.Limit("resolution_px_per_deg", at_least=4.0, omega_deg=(40, 100))


def requirements_of(*limits, mirror=None, lens=None, **parts):
    return om.Requirements(
        field=om.FieldRequirements(
            omega_max_deg=120, omega_min_deg=15, object_distance_mm=(800, np.inf)
        ),
        mirror=mirror or om.MirrorRequirements(family="sphere", rim_radius_mm=30),
        lens=lens or om.LensRequirements(f_number=(1, 32)),
        limits=limits,
        parts=om.PartsRequirements(**parts),
    )


def exhaustive_design(requirements, combination):
    """Return the design of a single combination by the search over ranges; None if infeasible."""
    try:
        _, best = _parameter_search.solve(requirements_with_parts(requirements, combination))
    except OmnimirrorError:
        return None
    return best


CASES = [
    requirements_of(BLUR, FINE),
    requirements_of(
        om.Limit("mtf", at_least=0.25, cycles_per_px=0.2, omega_deg=(20, 90)),
        om.Limit("length_mm", at_most=150),
    ),
    requirements_of(
        BLUR, FINE, mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=30)
    ),
]


SMALL = Catalogue(LENSES[1:2], IMAGERS[:2])


@pytest.mark.parametrize(
    ("requirements", "shelf"),
    [
        pytest.param(CASES[0], REDUCED_SHELF, id="few"),
        pytest.param(CASES[0], SHELF, id="blur", marks=pytest.mark.full),
        pytest.param(CASES[1], SMALL, id="contrast", marks=pytest.mark.full),
        pytest.param(
            CASES[2], Catalogue(LENSES[1:4], IMAGERS), id="mapping", marks=pytest.mark.full
        ),
    ],
)
def test_search_agrees_with_exhaustive_design(requirements, shelf):
    result = om.design_from_parts(requirements, shelf, max_designs=100)
    names = {design.combination.name for design in result.found}
    combinations = combinations_of(shelf, requirements)
    for combination in combinations:
        if combination.lens.mount and not set(combination.lens.mount.split()) & set(
            combination.imager.mount.split()
        ):
            assert combination.name not in names
            continue
        best = exhaustive_design(requirements, combination)
        is_feasible = best is not None and best.verdict.is_met and focuses(combination, best.sensor)
        assert is_feasible == (combination.name in names), combination.name
    assert names
    assert (
        len(names) + sum(result.cut.values()) + sum(result.missed.values())
        == result.combinations
        == len(combinations)
    )


def focuses(combination, sensor):
    lens = combination.lens
    return (
        isinstance(lens, TelecentricComponent)
        or sensor.lens.focus_distance_mm >= nearest_focus_mm(lens) - 1e-6
    )


@pytest.mark.full
@pytest.mark.parametrize("shelf", [Catalogue(LENSES[2:4], IMAGERS), SHELF], ids=["few", "all"])
def test_combinations_excluded_by_bounds_are_infeasible(shelf):
    """Limits close to the values of these parts; bounds exclude some of them and keep others."""
    finer = om.Limit("resolution_px_per_deg", at_least=3.1, omega_deg=(16, 119))
    requirements = requirements_of(
        finer, om.Limit("length_mm", at_most=150), om.Limit("total_blur_deg", at_most=2.0)
    )
    reasons = {
        combination: cut(requirements, combination)
        for combination in combinations_of(shelf, requirements)
    }
    for combination, reason in reasons.items():
        if reason in ("too large", "too few pixels", "too much diffraction"):
            best = exhaustive_design(requirements, combination)
            assert best is None or not best.verdict.is_met, (reason, combination.name)
    assert {"too large", None} <= set(reasons.values())


def test_combinations_limited_by_diffraction_are_excluded():
    dark = replace(LENSES[2], f_number_min=22.0, f_number_max=32.0, mount="")
    requirements = requirements_of(
        om.Limit("mtf", at_least=0.3, cycles_per_px=0.3, omega_deg=(20, 90))
    )
    (combination,) = combinations_of(
        Catalogue((dark,), (replace(IMAGERS[1], mount=""),)), requirements
    )
    assert cut(requirements, combination) == "too much diffraction"
    sensor = om.design_sensor(requirements_with_parts(requirements_of(), combination)).sensor
    sharp = om.mtf(sensor, [30.0], cycles_per_px=[0.3])
    assert sharp.sagittal[0, 0] < 0.3


def test_verdict_of_parts_design_agrees_with_check():
    requirements = CASES[0]
    for design in om.design_from_parts(requirements, SHELF, max_designs=100).found:
        completed = requirements_with_parts(requirements, design.combination)
        assert om.check_requirements(completed, design.design.sensor).is_met
        low, high = design.combination.f_numbers
        assert low <= design.design.sensor.lens.f_number <= high
        assert design.design.sensor.rim_radius_px <= completed.largest_image_px + 0.02


@pytest.mark.full
def test_f_number_minimises_blur():
    requirements = requirements_of(BLUR)
    for design in om.design_from_parts(requirements, SHELF, max_designs=100).found:
        completed, sensor = (
            requirements_with_parts(requirements, design.combination),
            design.design.sensor,
        )
        best = design.design.verdict.limits[0].shortfall
        F = sensor.lens.f_number
        for other in (0.93 * F, 1.07 * F):
            if design.combination.f_numbers[0] <= other <= design.combination.f_numbers[1]:
                verdict = om.design_sensor(completed.changed(f_number=other)).verdict
                assert verdict.limits[0].shortfall >= best - SLACK


def test_designs_are_sorted_by_price_and_limited_in_number():
    result = om.design_from_parts(CASES[0], SHELF, max_designs=2)
    prices = [design.price for design in result.found]
    assert prices == sorted(prices)
    assert len(prices) == 2
    assert result.left > 0
    complete = om.design_from_parts(CASES[0], SHELF, max_designs=100)
    assert [d.combination for d in complete.found[:2]] == [d.combination for d in result.found]
    assert complete.left == 0


def test_pareto_front_holds_no_dominated_designs():
    designs = om.design_from_parts(CASES[0], SHELF, max_designs=100).found
    front = om.design_from_parts(CASES[0], SHELF, front=True).found
    best, expected = np.inf, []
    for design in designs:
        if design.worst_floored_area_deg2 < best:
            best = design.worst_floored_area_deg2
            expected.append(design.combination.name)
    assert [design.combination.name for design in front] == expected


@pytest.mark.parametrize(
    "shelf", [REDUCED_SHELF, pytest.param(SHELF, marks=pytest.mark.full)], ids=["few", "all"]
)
def test_result_is_independent_of_number_of_processes(monkeypatch, shelf):
    monkeypatch.setattr(parts_search, "MAX_SERIAL_COMBINATIONS", 0)
    one, two = (om.design_from_parts(CASES[0], shelf, max_designs=100, processes=n) for n in (1, 2))
    assert [(d.combination, d.worst_floored_area_deg2) for d in one.found] == [
        (d.combination, d.worst_floored_area_deg2) for d in two.found
    ]
    assert one.missed == two.missed


def test_mirror_ranges_are_searched_for_each_combination():
    requirements = requirements_of(
        BLUR, mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=(20, 40))
    )
    catalogue = Catalogue(LENSES[2:3], IMAGERS[:1])
    (design,) = om.design_from_parts(requirements, catalogue).found
    assert 20 <= design.design.sensor.mirror.rim_radius_mm <= 40


# -- balls, domes, size and mass -------------------------------------------------------------------


@pytest.mark.parametrize(
    "shelf",
    [replace(SHELF, lenses=LENSES[1:4]), pytest.param(SHELF, marks=pytest.mark.full)],
    ids=["few", "all"],
)
def test_mirror_ball_is_used_up_to_the_required_field(shelf):
    mirror = om.MirrorRequirements(family="sphere", rim_radius_mm=(10, 60))
    requirements = requirements_of(om.Limit("total_blur_deg", at_most=1.5), mirror=mirror)
    requirements = replace(requirements, parts=om.PartsRequirements(mirror="ball"))
    designs = om.design_from_parts(requirements, shelf, max_designs=100).found
    assert {design.combination.ball.name for design in designs} == {"ball 50", "ball 80"}
    for design in designs:
        sensor = design.design.sensor
        assert isinstance(sensor.mirror, Sphere)
        assert 2 * sensor.mirror.radius_mm == pytest.approx(
            design.combination.ball.ball_diameter_mm, rel=1e-6
        )
        assert sensor.field_deg[1] == pytest.approx(120, abs=1e-4)
        assert design.price == sum(part.price for part in design.combination.parts)


def test_dome_encloses_mirror_where_it_fits():
    requirements = requirements_of(
        om.Limit("total_blur_deg", at_most=2.0, omega_deg=(90, 110)), dome=True
    )
    requirements = replace(
        requirements, field=om.FieldRequirements(omega_max_deg=120, omega_min_deg=89)
    )
    result = om.design_from_parts(requirements, SHELF, max_designs=100)
    assert {design.combination.dome.name for design in result.found} == {
        "dome 200"
    }  # mirror of 60 mm
    for design in result.found:
        assert design.design.sensor.housing.shell.diameter_mm == 200.0
        assert outer_size(design.design.sensor).diameter_mm == 200.0


def test_overall_size_and_mass_are_sums_of_parts():
    sensor = om.load_sensor("paper-spherical")
    diameter, height = outer_size(sensor, (replace(IMAGERS[0], length_mm=30.0, diameter_mm=120.0),))
    assert diameter == 120.0
    top = float(sensor.mirror.sag(sensor.mirror.rim_radius_mm))
    b0 = 1 / (1 / sensor.lens.focal_length_mm - 1 / sensor.lens.focus_distance_mm)
    assert height == pytest.approx(30 + b0 + sensor.mirror_distance_mm + top + 5)
    A, M = sensor.mirror.radius_mm, sensor.mirror.rim_radius_mm
    cap = (
        np.pi * top**2 * (3 * A - top) / 3
    )  # of the sphere; the body is the cap and the plate behind
    assert mirror_mass_g(sensor.mirror, 5.0) == pytest.approx(
        2.7e-3 * (cap + np.pi * M**2 * 5), rel=1e-6
    )


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ({"max_price": 60.0}, "too expensive, or of unknown price"),
        ({"max_mass_g": 25.0}, "too heavy, or of unknown mass"),
        ({"max_diameter_mm": 50.0}, "too large"),
        ({"max_height_mm": 60.0}, "too large"),
    ],
)
def test_combinations_above_overall_limits_are_excluded_and_reported(parts, reason):
    result = om.design_from_parts(
        requirements_of(om.Limit("total_blur_deg", at_most=2.0), **parts), SHELF, max_designs=100
    )
    assert result.cut[reason] > 0
    for design in result.found:
        rows = {row.name: row for row in design.design.rows}
        (name,) = (name for name in rows if name.startswith("whole"))
        assert rows[name].is_met


def test_nearest_design_is_reported_without_feasible_combination():
    result = om.design_from_parts(requirements_of(FINE, om.Limit("aspect", at_most=0.9)), SHELF)
    assert not result.is_met
    assert result.nearest is not None
    assert not result.nearest.is_met
    assert json.dumps(result.to_dict())


# -- files and commands ----------------------------------------------------------------------------

CSV = (
    "name,focal_length_mm,f_number_min,f_number_max,minimum_focus_mm,width_px,height_px,pixel_pitch_um,price,mount\n"
    '"C 8 mm, iris",8,1.4,16,100,,,,120,C\n8 MP,,,,,3840,2160,2.0,90,C\n2 '
    "MP,,,,,1920,1080,2.9,60,C\n"
)
FILE = """
[field]
omega_max_deg = 120
[mirror]
family = "sphere"
rim_radius_mm = 30
[parts]
catalogue = "shelf.csv"
max_price = 400
[[limit]]
quantity = "total_blur_deg"
at_most = 0.8
"""


def test_user_catalogue_from_file_and_command_line(tmp_path):
    (tmp_path / "shelf.csv").write_text(CSV)
    (tmp_path / "asked.toml").write_text(FILE)
    run = omnimirror(
        "design", "asked.toml", "-o", "best.toml", "--json", "found.json", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert "2 combinations; 2 of them listed above" in run.stdout
    rows = json.loads((tmp_path / "found.json").read_text())["found"]
    assert [(f["lens"], f["imager"], f["price"]) for f in rows] == [
        ("C 8 mm, iris", "2 MP", 180.0),
        ("C 8 mm, iris", "8 MP", 210.0),
    ]
    assert om.load_sensor(tmp_path / "best.toml").imager.size == (1920, 1080)
    options = (
        "--omega-max-deg",
        "120",
        "--mirror",
        "sphere",
        "--rim-radius-mm",
        "30",
        "--at-most",
        "total_blur_deg=.8",
    )
    repeated = omnimirror(
        "design", *options, "--parts", "shelf.csv", "--set", "search.max_designs=1", cwd=tmp_path
    )
    assert repeated.returncode == 0, repeated.stderr
    assert "C 8 mm, iris + 2 MP" in repeated.stdout
    assert "1 more expensive combinations not evaluated" in repeated.stdout
    none = omnimirror(
        "design", *options, "--parts", "shelf.csv", "--set", "parts.max_price=10", cwd=tmp_path
    )
    assert none.returncode == 3
    assert "2 too expensive" in none.stdout
    assert "--set search.max_designs requires --parts" in fails(
        "design", *options, "--focal-length-mm", "8", "--set", "search.max_designs=3", cwd=tmp_path
    )


def test_parts_table_round_trip(tmp_path):
    requirements = parse_requirements(FILE, folder=tmp_path)
    assert requirements.parts.catalogue == (str(tmp_path / "shelf.csv"),)
    assert parse_requirements(format_requirements(requirements), folder=tmp_path) == requirements


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'family = "sphere"',
            'optimise = "worst_blur_deg"',
            "mirror.optimise must not be given together with parts",
        ),
        ("max_price = 400", 'mirror = "cone"', "parts.mirror must be one of"),
        ("max_price = 400", "max_price = 0", "parts.max_price must be greater than 0"),
        (
            "rim_radius_mm = 30\n[parts]",
            'rim_radius_mm = 30\nfit = "polynomial:3"\n[parts]\nmirror = "ball"',
            "parts.mirror = .ball. requires mirror.family = .sphere. without a fit",
        ),
        (
            "max_price = 400",
            "dome = true\n[housing.tube]",
            "must not be given together with a cover",
        ),
        ("max_price = 400", "catalog = 3", "unknown entry parts.catalog; did you mean catalogue"),
    ],
)
def test_invalid_parts_entries_are_rejected(old, new, message, tmp_path):
    assert old in FILE
    with pytest.raises(OmnimirrorError, match=message) as e:
        parse_requirements(FILE.replace(old, new), folder=tmp_path)
    assert "\n" not in str(e.value)


def test_search_without_parts_or_balls_is_rejected():
    with pytest.raises(OmnimirrorError, match="must contain parts"):
        om.design_from_parts(
            replace(requirements_of(BLUR), parts=None, lens=om.LensRequirements(theta_max_deg=10))
        )
    requirements = replace(requirements_of(BLUR), parts=om.PartsRequirements(mirror="ball"))
    with pytest.raises(OmnimirrorError, match="the catalogue must contain a ball"):
        om.design_from_parts(requirements, Catalogue(LENSES, IMAGERS))
    with pytest.raises(OmnimirrorError, match=r"max_designs must be .*; got 0"):
        om.design_from_parts(requirements_of(BLUR), SHELF, max_designs=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("price,mount\n", "cost,mount\n"), "line 1: unknown column 'cost'"),
        (("price,mount\n", "price,price\n"), "line 1: columns must be unique; price is repeated"),
        (
            (",8,1.4,16", ",eight,1.4,16"),
            "line 2: column focal_length_mm must be a number; got 'eight'",
        ),
        (
            (",8,1.4,16", ",-8,1.4,16"),
            r"shelf\.csv line 2: C 8 mm, iris: focal_length_mm must be between 0\.1 and 10000 mm; got -8",
        ),
        ((",8,1.4,16", ",8,1.4,"), "line 2: column f_number_max is missing"),
        (
            ("3840,2160", "3840.5,2160"),
            "line 3: column width_px must be an integer number of pixels; got 3840.5",
        ),
        (("8 MP,,", "8 MP,8,"), "line 3: unknown column focal_length_mm; use "),
        (
            ("2 MP,", "8 MP,"),
            "line 4: names must be unique; the imager '8 MP' is also in .* line 3",
        ),
        ((",120,C", ",120,C,more"), "line 2 must have 10 cells, as many as the header; got 11"),
    ],
)
def test_csv_errors_name_line_and_column(tmp_path, change, message):
    assert change[0] in CSV
    (tmp_path / "shelf.csv").write_text(CSV.replace(*change))
    with pytest.raises(OmnimirrorError, match=message):
        read_catalogue(tmp_path / "shelf.csv")


def test_bundled_catalogue_states_sources():
    shelf = read_catalogue()
    parts = (*shelf.lenses, *shelf.imagers, *shelf.balls, *shelf.domes)
    assert all(part.source and part.price and part.mass_g for part in parts)
    assert read_catalogue("typical") == shelf


# -- other off-the-shelf parts, and lenses by their surfaces
# ---------------------------------------------------------


def test_accessories_count_in_price_and_mass():
    extras = (
        ExtraComponent("mat", "heater", price=15.0, mass_g=12.0),
        ExtraComponent("film", "heater", price=9.0, mass_g=20.0),
        ExtraComponent("profile", "arm", price=10.0, mass_g=240.0),
    )
    shelf = replace(SMALL, extras=extras)
    plain, extended = (
        om.design_from_parts(requirements_of(BLUR, **options), shelf, max_designs=1).found[0]
        for options in ({}, {"extras": ("heater", "arm")})
    )
    assert extended.price == plain.price + 19.0
    assert extended.mass_g == pytest.approx(plain.mass_g + 260.0)
    assert extended.to_dict()["extra"] == ["film", "profile"]
    with pytest.raises(
        OmnimirrorError,
        match=r"must contain an extra part with the use 'fan' .* it has heater, arm",
    ):
        om.design_from_parts(requirements_of(BLUR, extras=("fan",)), shelf)


def test_bundled_catalogue_has_heater_arm_and_holder():
    assert {part.use for part in read_catalogue().extras} == {"heater", "arm", "holder"}
    assert all(part.source and part.price and part.mass_g for part in read_catalogue().extras)


def test_catalogue_lens_may_refer_to_surface_file(tmp_path):
    """Its mirror is solved for it: the field is kept behind the glass, unlike with the thin lens of
    the same numbers."""
    (tmp_path / "triplet.zmx").write_text(prescriptions.zmx())
    (tmp_path / "shelf.csv").write_text(
        "name,file,minimum_focus_mm,f_number_max,price,mass_g,width_px,height_px,pixel_pitch_um\n"
        "triplet,triplet.zmx,60,11,80,20,,,\n1 MP,,,,90,30,1024,1024,5.2\n"
    )
    shelf = read_catalogue(tmp_path / "shelf.csv")
    (lens,) = shelf.lenses
    assert lens.focal_length_mm == pytest.approx(11.6, rel=0.01)
    assert (lens.f_number_min, lens.f_number_max) == (pytest.approx(4.0, rel=0.01), 11.0)
    requirements = requirements_of(om.Limit("total_blur_deg", at_most=2.0))
    result = om.design_from_parts(requirements, shelf)
    (design,) = result.found
    sensor = design.design.sensor
    assert isinstance(sensor.lens, SurfaceLens)
    assert sensor.field_deg[1] == pytest.approx(120.0, abs=1e-6)
    assert sensor.rim_radius_px == pytest.approx(512.0, abs=0.03)
    alone = om.design_sensor(requirements_with_parts(requirements, design.combination)).sensor
    assert sensor.mirror.radius_mm == pytest.approx(alone.mirror.radius_mm, rel=1e-6)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("triplet,none.zmx,60,,", "line 2: .*cannot read .*none.zmx"),
        ("triplet,triplet.zmx,60,8,", "line 2: focal_length_mm must be that of triplet.zmx"),
    ],
)
def test_invalid_lens_files_are_named(line, message, tmp_path):
    (tmp_path / "triplet.zmx").write_text(prescriptions.zmx())
    (tmp_path / "shelf.csv").write_text(
        f"name,file,minimum_focus_mm,focal_length_mm,price\n{line}\n"
    )
    with pytest.raises(OmnimirrorError, match=message):
        read_catalogue(tmp_path / "shelf.csv")
