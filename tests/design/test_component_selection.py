"""Best aperture against plain enumeration, and parts against the lens equation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.design.catalogue import (
    BallComponent,
    Catalogue,
    DomeComponent,
    ExtraComponent,
    ImagerComponent,
    LensComponent,
    TelecentricComponent,
    mounts_fit,
    read_catalogue,
)
from omnimirror.design.component_selection import best_apertures, choose_parts, rings_for
from omnimirror.optics.lenses import Perspective
from tests.everyday import few
from tests.optics.lenses import prescriptions

SPHERE = om.load_sensor("paper-spherical")


def worst_blur_at(sensor, side, F, focus, mode="exact"):
    """Return the largest root sum of squares of blur and Airy disc over the field, by the evaluation."""
    name = "f_number" if isinstance(sensor.lens, Perspective) else "working_f_number"
    sensor = replace(sensor, lens=replace(sensor.lens, **{name: float(F)}))
    r = om.evaluate(sensor, np.linspace(*sensor.field_deg, 301), focus_mm=float(focus), mode=mode)
    t, s = np.hypot(r.blur_t_px, r.airy_px).max(), np.hypot(r.blur_s_px, r.airy_px).max()
    return {"tangential": t, "sagittal": s, "together": max(t, s)}[side]


@pytest.mark.parametrize("mode", ["exact", "paper"])
@pytest.mark.parametrize(
    "name",
    few(
        ["paper-spherical", "paper-equidistant", "paper-hyperboloidal", "paraboloid-telecentric"],
        "paper-spherical",
    ),
)
def test_f_number_and_focus_are_optimal(name, mode):
    sensor = om.load_sensor(name)
    for best in best_apertures(sensor, mode=mode):
        blur_px = worst_blur_at(sensor, best.side, best.f_number, best.focus_mm, mode)
        assert blur_px == pytest.approx(best.worst_px, rel=1e-4)
        assert best.worst_px == pytest.approx(np.hypot(best.blur_px, best.airy_px), rel=1e-12)
        for F in best.f_number * np.array([0.8, 0.99, 1.01, 1.25]):
            for focus in best.focus_mm + np.array([-5.0, -0.2, 0.0, 0.2, 5.0]):
                assert worst_blur_at(sensor, best.side, F, focus, mode) >= best.worst_px * (
                    1 - 1e-4
                )


def test_apertures_stay_within_the_lens():
    wide, narrow = best_apertures(SPHERE, (1.4, 2.8)), best_apertures(SPHERE, (16.0, 22.0))
    assert [b.f_number for b in wide] == [2.8, 2.8, 2.8]
    assert [b.f_number for b in narrow] == [16.0, 16.0, 16.0]
    with pytest.raises(InvalidParameter, match=r"must be a range with 0 < low <= high; got 8 to 4"):
        best_apertures(SPHERE, (8.0, 4.0))
    with pytest.raises(InvalidParameter, match="omega_min_deg must be less than 135"):
        best_apertures(SPHERE, omega_min_deg=150.0)


def test_bundled_catalogue_has_lens_for_sphere_and_reasons_for_exclusions():
    shelf = read_catalogue()
    choices = choose_parts(SPHERE, shelf)
    assert len(choices) == len(shelf.lenses) * len(shelf.imagers)
    fits = [c.fits for c in choices]
    assert fits == sorted(fits, reverse=True)
    assert any(fits)
    best = [c.worst_floored_area_deg2 for c in choices if c.fits]
    assert best == sorted(best)
    for c in choices:
        assert c.fits != bool(c.reasons)
        if c.fits:
            assert 0.6 <= c.fill <= 1.0
            assert c.sensor.rim_radius_px == pytest.approx(c.fill * min(c.sensor.imager.size) / 2)
            r = om.evaluate(c.sensor, np.linspace(*c.sensor.field_deg, 1001))
            assert r.floored_area_deg2.max() == pytest.approx(c.worst_floored_area_deg2, rel=1e-3)
        if c.lens.startswith("telecentric"):
            assert "requires a perspective lens" in c.reasons[0]


def test_telecentric_lens_must_be_as_wide_as_mirror():
    sensor = om.load_sensor("paraboloid-telecentric")
    width = 2 * sensor.mirror.rim_radius_mm
    imager = ImagerComponent("imager", 2448, 2048, 3.45)
    lenses = [
        TelecentricComponent(f"front {d:g}", 0.1, 8.0, 16.0, d) for d in (width * 0.99, width)
    ]
    ordinary = LensComponent("12 mm", 12.0, 2.0, 8.0, 100.0)
    wide, narrow = choose_parts(sensor, Catalogue((*lenses, ordinary), (imager,)))[:2]
    assert wide.fits
    assert f"is less than that of the mirror, {width:g} mm" in narrow.reasons[0]


def test_extension_rings_reach_focus_of_lens_equation():
    """Lens at its closest focus plus the extension ring: 1/f = 1/L + 1/b."""
    lens = LensComponent("lens", 16.0, 1.4, 16.0, 300.0, extension_rings_mm=(0.5, 1.0, 5.0))
    nearest = 1 / (1 / 16.0 - 1 / 300.0)
    for focus in (1e5, 310.0, 299.0, 240.0, 205.0, 180.0, 60.0):
        ring, reasons = rings_for(lens, focus)
        b = 1 / (1 / 16.0 - 1 / focus)
        assert reasons or 16.0 + ring <= b <= nearest + ring + 1e-12
    assert rings_for(lens, 240.0)[0] == 0.5
    _, (message,) = rings_for(lens, 100.0)
    assert "requires extension rings of 2.15 to 3.05 mm" in message
    assert rings_for(replace(lens, extension_rings_mm=()), 240.0)[1] == [
        "minimum focus 300 mm, required 240 mm"
    ]


LENS_TABLE = (
    "[[lens]]\nname = 'A'\nfocal_length_mm = 12\nf_number_min = 1.4\nf_number_max = "
    "16\nminimum_focus_mm = 100\n"
)
IMAGER_TABLE = "[[imager]]\nname = 'A'\nwidth_px = 640\nheight_px = 480\npixel_pitch_um = 3\n"
BALL_TABLE = "[[ball]]\nname = 'A'\nball_diameter_mm = 60\n"


def test_catalogue_contains_all_kinds_of_parts(tmp_path, monkeypatch):
    """One TOML file with kinds by table, and one CSV file with kinds by columns."""
    (tmp_path / "parts.toml").write_text(
        LENS_TABLE
        + "extension_rings_mm = [5, 0.5]\nmount = 'C CS'\nsource = 'data sheet'\nprice = 120\nmass_g = 63.5\n"
        + "[[lens]]\nname = 'T'\nmagnification = 0.1\nf_number_min = 8\nf_number_max = 8\nfront_diameter_mm = 90\n"
        + IMAGER_TABLE
        + BALL_TABLE
        + "[[dome]]\nname = 'A'\ndome_diameter_mm = 110\nwall_mm = 3\nmaterial = 'polycarbonate'\n"
        + "[[extra]]\nname = 'A'\nuse = 'heater'\ndiameter_mm = 20\nlength_mm = 5\n"
    )
    (tmp_path / "parts.CSV").write_bytes(
        "\ufeffname, focal_length_mm,f_number_min,f_number_max,minimum_focus_mm,extension_rings_mm,mount,source,price,"
        "mass_g,magnification,front_diameter_mm,width_px,height_px,pixel_pitch_um,ball_diameter_mm,dome_diameter_mm,"
        "wall_mm,material,use,diameter_mm,length_mm\r\n"
        "A,12,1.4,16,100,5 0.5,C CS,data sheet,120,63.5\r\n"
        "T,,8,8,,,,,,,0.1,90\r\n"
        ",,,,,,,\r\n"
        "\r\n"
        "A,,,,,,,,,,,,640,480,3\r\n"
        "A,,,,,,,,,,,,,,,60\r\n"
        "A,,,,,,,,,,,,,,,,110,3,polycarbonate\r\n"
        "A,,,,,,,,,,,,,,,,,,,heater, 20 ,5\r\n".encode()
    )
    expected = Catalogue(
        (
            LensComponent(
                "A",
                12.0,
                1.4,
                16.0,
                100.0,
                None,
                (5.0, 0.5),
                "C CS",
                price=120.0,
                mass_g=63.5,
                source="data sheet",
            ),
            TelecentricComponent("T", 0.1, 8.0, 8.0, 90.0),
        ),
        (ImagerComponent("A", 640, 480, 3.0),),
        (BallComponent("A", 60.0),),
        (DomeComponent("A", 110.0, 3.0, "polycarbonate"),),
        (ExtraComponent("A", "heater", diameter_mm=20.0, length_mm=5.0),),
    )
    for name in ("parts.toml", "parts.CSV"):
        catalogue = read_catalogue(tmp_path / name)
        assert catalogue == expected
        assert isinstance(catalogue.imagers[0].width_px, int)
    monkeypatch.chdir(tmp_path)
    for name in (
        "parts",
        "zoo.TXT",
    ):  # TOML unless the suffix is .csv; after "typical" in the alphabet
        (tmp_path / name).write_text((tmp_path / "parts.toml").read_text())
        assert read_catalogue(name) == expected
    assert read_catalogue(Path("typical")) == read_catalogue()
    (tmp_path / "more.toml").write_text(BALL_TABLE.replace("'A'", "'B'"))
    assert [
        b.name
        for b in read_catalogue(tmp_path / "more.toml", "typical", tmp_path / "parts.toml").balls
    ][-1] == "A"


@pytest.mark.parametrize(
    ("lens", "imager", "fit"),
    [
        ("C", "C", True),
        ("C CS", "M12 CS", True),
        ("C", "CS", False),
        ("M12", "C CS", False),
        ("", "C", True),
        ("C", "", True),
        ("", "", True),
    ],
)
def test_parts_of_catalogue_fit_by_common_mount(lens, imager, fit):
    camera = ImagerComponent("imager", 640, 480, 3.0, mount=imager)
    assert mounts_fit(LensComponent("lens", 8.0, 2.0, 2.0, 70.0, mount=lens), camera) is fit
    assert mounts_fit(TelecentricComponent("lens", 0.1, 8.0, 8.0, 90.0, mount=lens), camera) is fit


LENS = LensComponent("a", 12.0, 1.4, 16.0, 100.0)
TELECENTRIC = TelecentricComponent("a", 0.1, 8.0, 16.0, 90.0)
IMAGER = ImagerComponent("a", 640, 480, 3.0)
DOME = DomeComponent("a", 110.0, 3.0)


@pytest.mark.parametrize(
    ("part", "name", "low", "high"),
    [
        *((BallComponent("a", 60.0), *row) for row in (("price", 0.0, 1e7), ("mass_g", 0.0, 1e6))),
        *((DOME, name, 0.1, 10_000.0) for name in ("diameter_mm", "length_mm")),
        (replace(LENS, minimum_focus_mm=10_001.0), "focal_length_mm", 0.1, 10_000.0),
        (LENS, "minimum_focus_mm", 12.001, 1e6),
        (LENS, "image_circle_mm", 0.1, 1000.0),
        (replace(LENS, f_number_max=1000.0), "f_number_min", 0.1, 1000.0),
        (LENS, "f_number_max", 1.4, 1000.0),
        (TELECENTRIC, "f_number_max", 8.0, 1000.0),
        (TELECENTRIC, "magnification", 1e-5, 1000.0),
        (TELECENTRIC, "front_diameter_mm", 0.1, 10_000.0),
        (TELECENTRIC, "image_circle_mm", 0.1, 1000.0),
        (IMAGER, "width_px", 1, 100_000),
        (IMAGER, "height_px", 1, 100_000),
        (IMAGER, "pixel_pitch_um", 0.01, 10_000.0),
        (BallComponent("a", 60.0), "ball_diameter_mm", 0.1, 10_000.0),
        (DOME, "dome_diameter_mm", 1.0, 10_000.0),
        (DOME, "wall_mm", 0.001, 1000.0),
    ],
)
def test_catalogue_ranges_include_their_ends(part, name, low, high):
    for value in (low, high):
        assert getattr(replace(part, **{name: value}), name) == value
    for value in (low - 0.001 * (abs(low) or 1), high + min(0.001 * high, 0.5)):
        with pytest.raises(InvalidParameter, match=f"^a: {name} must be "):
            replace(part, **{name: value})


def test_extension_rings_of_a_catalogue_are_within_their_range():
    for value in (0.001, 1000.0):
        assert replace(LENS, extension_rings_mm=(5.0, value)).extension_rings_mm == (5.0, value)
    for value in (0.0009, 1000.1):
        with pytest.raises(
            InvalidParameter,
            match=r"^a: extension_rings_mm\[1\] must be between 0\.001 and 1000 mm",
        ):
            replace(LENS, extension_rings_mm=(5.0, value))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "name,pixel_pitch,sort\nA,3,4\n",
            r"parts\.csv line 1: unknown column 'pixel_pitch'; did you mean pixel_pitch_um",
        ),
        (
            "name,use,mass_g,use,mass_g\nA,arm\n",
            r"parts\.csv line 1: columns must be unique; use is repeated",
        ),
        (
            "name,use\nA,arm\nB,arm,3\n",
            r"parts\.csv line 3 must have 2 cells, as many as the header; got 3",
        ),
        (
            "name,use\nA,arm\n\nA,heater\n",
            r"parts\.csv line 4: names must be unique; the extra 'A' is also in .*parts\.csv line 2",
        ),
        (
            "name,use,mass_g\nA,arm,heavy\n",
            r"parts\.csv line 2: column mass_g must be a number; got 'heavy'",
        ),
        (
            "name,use,mass_g\nA,arm,3 4\n",
            r"parts\.csv line 2: column mass_g must be a number; got '3 4'",
        ),
        (
            "name,ball_diameter_mm,use\nA,60,arm\n",
            r"parts\.csv line 2: unknown column use; use name",
        ),
        ("name,mass_g\nA,3\n", r"parts\.csv line 2: column focal_length_mm is missing"),
        ("", "at least one lens is required"),
    ],
)
def test_invalid_lines_of_csv_catalogue_are_rejected(tmp_path, text, message):
    (tmp_path / "parts.csv").write_text(text)
    with pytest.raises(OmnimirrorError, match=message):
        read_catalogue(tmp_path / "parts.csv")


def test_catalogue_lens_takes_data_from_its_file(tmp_path):
    """Focal length by refraction and transfer matrices; a difference of less than 1 % is due to
    rounding."""
    n, power = prescriptions.indices(), np.eye(2)
    for k, (radius, gap) in enumerate(zip(prescriptions.RADII, prescriptions.GAPS, strict=True)):
        refraction = [[1.0, 0.0], [(n[k] - n[k + 1]) / radius, 1.0]]
        power = np.array([[1.0, gap / n[k + 1]], [0.0, 1.0]]) @ refraction @ power
    f = -1 / power[1, 0]
    stop = f / (11.6 / prescriptions.F_NUMBER)
    (tmp_path / "own.zmx").write_text(prescriptions.zmx())

    def lens(**entries):
        entries = {"name": "'L'", "file": "'own.zmx'", "minimum_focus_mm": 1e4, **entries}
        lines = [f"{key} = {value}" for key, value in entries.items()]
        (tmp_path / "parts.toml").write_text("\n".join(["[[lens]]", *lines, IMAGER_TABLE]))
        return read_catalogue(tmp_path / "parts.toml").lenses[0]

    part = lens()
    assert (part.focal_length_mm, part.f_number_min, part.f_number_max) == pytest.approx(
        (f, stop, stop), rel=1e-9
    )
    assert part.optics.focal_length_mm == pytest.approx(f, rel=1e-9)
    assert LENS.optics is None
    assert lens(f_number_max=22.0).f_number_max == 22.0
    for share in (0.991, 1.009):
        assert lens(focal_length_mm=share * f).focal_length_mm == pytest.approx(f, rel=1e-9)
    for share in (0.989, 1.011, -1.0):
        with pytest.raises(
            OmnimirrorError, match=r"lens 1: focal_length_mm must be that of own\.zmx, 11\..*; omit"
        ):
            lens(focal_length_mm=share * f)
    with pytest.raises(OmnimirrorError, match=r"lens 1: .*other\.zmx"):
        lens(file="'other.zmx'")
    (tmp_path / "parts.csv").write_text("name,file,minimum_focus_mm\nL,own.zmx,1e4\n")
    (tmp_path / "imager.csv").write_text("name,width_px,height_px,pixel_pitch_um\nA,640,480,3\n")
    assert read_catalogue(tmp_path / "parts.csv", tmp_path / "imager.csv").lenses == (part,)


def test_catalogues_as_csv(tmp_path):
    (tmp_path / "lenses.csv").write_text(
        "name,focal_length_mm,f_number_min,f_number_max,minimum_focus_mm,extension_rings_mm,"
        "image_circle_mm\nA,12,1.4,16,250,0.5 1,\nB,16,1.4,16,300,,11\n"
    )
    (tmp_path / "imagers.csv").write_text(
        "name,width_px,height_px,pixel_pitch_um\nC,1280,1024,5.2\n"
    )
    catalogue = read_catalogue(tmp_path / "lenses.csv", tmp_path / "imagers.csv")
    assert catalogue.lenses == (
        LensComponent("A", 12.0, 1.4, 16.0, 250.0, None, (0.5, 1.0)),
        LensComponent("B", 16.0, 1.4, 16.0, 300.0, 11.0, ()),
    )
    assert catalogue.imagers == (ImagerComponent("C", 1280, 1024, 5.2),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[lens]]\nname = 'A'\n", "focal_length_mm is missing"),
        ("[[lens]]\nname = 'A'\nfocal = 3\nsort = 4\n", "unknown entry focal; use"),
        ("[[camera]]\nname = 'A'\n", "got camera"),
        ("lens = 3\n", "got lens"),
        (
            "[[imager]]\nname = 'A'\nwidth_px = 'wide'\nheight_px = 3\npixel_pitch_um = 3\n",
            "must be a number; got 'wide'",
        ),
        (
            "[[imager]]\nname = 'A'\nwidth_px = 3\nheight_px = 3\npixel_pitch_um = -3\n",
            r"parts\.toml, imager 1: A: pixel_pitch_um must be between 0\.01 and 10000 um; got -3",
        ),
        (
            "[[imager]]\nname = 'A'\nwidth_px = 3\nheight_px = 3\npixel_pitch_um = 3\n",
            "at least one lens is required",
        ),
        (
            "[[lens",
            r"parts\.toml must be valid TOML: Expected '\]\]' at the end of an array declaration \(at end of",
        ),
        (
            "[lens]\nname = 'A'\n",
            r"tables must be \[\[lens\]\], \[\[imager\]\], \[\[ball.*; got lens",
        ),
        ("lens = [3]\n", r"parts\.toml: lens 1 must be a table, one of \[\[lens\]\]"),
        (
            BALL_TABLE + "[[ball]]\nname = 'B'\nwall_mm = 2\n",
            r"parts\.toml, ball 2: unknown entry wall_mm; use",
        ),
        (
            BALL_TABLE + BALL_TABLE,
            r"parts\.toml, ball 2: names must be unique; the ball 'A' is also in .*parts\.toml, ball 1",
        ),
        (
            BALL_TABLE.replace("ball]", "dome]"),
            r"parts\.toml, dome 1 has the entries of a ball; move it .* \[\[ball\]\]",
        ),
        (
            "[[extra]]\nname = 'A'\n",
            r"extra 1: use is missing; the name and all dimensions of the part are required",
        ),
        ("[[extra]]\nname = ''\nuse = 'arm'\n", r"extra 1: name must be a name; got ''"),
        ("[[extra]]\nname = 3\nuse = 'arm'\n", r"extra 1: name must be a name; got 3"),
        (
            IMAGER_TABLE.replace("= 640", "= 640.5"),
            r"imager 1: width_px must be an integer number of pixels; got 640\.5",
        ),
        (
            IMAGER_TABLE.replace("= 640", "= -640.5"),
            r"imager 1: width_px must be an integer number of pixels; got -640\.5",
        ),
        (
            IMAGER_TABLE.replace("= 480", "= 480.5"),
            r"imager 1: height_px must be an integer number of pixels; got 480\.5",
        ),
        (
            IMAGER_TABLE.replace("= 480", "= true"),
            r"imager 1: height_px must be a number; got True",
        ),
        (IMAGER_TABLE.replace("= 480", "= inf"), r"imager 1: height_px must be a number; got inf"),
        (IMAGER_TABLE.replace("= 480", "= [480]"), "at least one lens is required"),
        (
            IMAGER_TABLE.replace("= 480", "= [480, 2]"),
            r"imager 1: height_px must be a number; got \[480, 2\]",
        ),
        (IMAGER_TABLE.replace("= 480", "= []"), r"imager 1: height_px must be a number; got \[\]"),
        (LENS_TABLE + "file = 3\n", "lens 1: file must be a name; got 3"),
        (LENS_TABLE + "file = ''\n", "lens 1: file must be a name; got ''"),
        (LENS_TABLE, "at least one imager is required"),
        (
            LENS_TABLE + "extension_rings_mm = [1, 'b']\n",
            r"lens 1: extension_rings_mm must be a number; got \[1, 'b'\]",
        ),
        (
            LENS_TABLE + "extension_rings_mm = [1.0, 0.0]\n",
            r"parts\.toml, lens 1: A: extension_rings_mm\[1\] must be between 0\.001 and 1000 mm; got 0",
        ),
        (
            LENS_TABLE.replace("100", "12"),
            "A: minimum_focus_mm must be greater than the focal length, 12 mm; got 12",
        ),
        (
            LENS_TABLE.replace("= 16", "= 1.3"),
            r"A: f_number_max must be at least f_number_min = 1\.4; got 1\.3",
        ),
    ],
)
def test_invalid_catalogues_are_rejected_with_entry(tmp_path, text, message):
    (tmp_path / "parts.toml").write_text(text)
    with pytest.raises(OmnimirrorError, match=message):
        read_catalogue(tmp_path / "parts.toml")
    with pytest.raises(OmnimirrorError, match="cannot read"):
        read_catalogue(tmp_path / "nowhere.toml")


@pytest.mark.parametrize("mode", ["Exact", "PAPER", "", None])
def test_unknown_blur_mode_is_rejected(mode):
    with pytest.raises(InvalidParameter, match="mode must be one of exact, paper; got "):
        best_apertures(om.load_sensor("paper-spherical"), mode=mode)


@pytest.mark.parametrize("distance", [0, 0.0, -5.0])
def test_invalid_object_distance_is_rejected(distance):
    for select in (
        lambda **options: choose_parts(SPHERE, read_catalogue(), **options),
        lambda **options: best_apertures(SPHERE, **options),
    ):
        with pytest.raises(
            InvalidParameter,
            match=f"object_distance_mm must be at least 1e-09 mm, or inf; got {distance:g}",
        ):
            select(object_distance_mm=distance)
