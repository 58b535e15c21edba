"""The best aperture against plain enumeration, and parts against the lens equation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.components.apertures import best_apertures
from omnimirror.components.catalogue import (
    Catalogue,
    ImagerComponent,
    LensComponent,
    TelecentricComponent,
    read_catalogue,
)
from omnimirror.components.selection import choose_parts, rings_for
from omnimirror.errors import InvalidParameter, OmnimirrorError
from omnimirror.lenses import Perspective
from tests.everyday import few

SPHERE = om.load_sensor("paper-spherical")


def at(sensor, side, F, focus, mode="exact"):
    """Worst root of the squares of blur and Airy disk over the field, by the evaluation."""
    name = "f_number" if isinstance(sensor.lens, Perspective) else "working_f_number"
    sensor = replace(sensor, lens=replace(sensor.lens, **{name: float(F)}))
    r = om.evaluate(sensor, np.linspace(*sensor.field_deg, 301), focus_mm=float(focus), mode=mode)
    t, s = np.hypot(r.blur_t_px, r.airy_px).max(), np.hypot(r.blur_s_px, r.airy_px).max()
    return {"tangential": t, "sagittal": s, "together": max(t, s)}[side]


@pytest.mark.parametrize("mode", ["exact", "paper"])
@pytest.mark.parametrize(
    "name",
    few(["paper-spherical", "paper-equidistant", "paper-hyperboloidal", "paraboloid-telecentric"], "paper-spherical"),
)
def test_no_other_aperture_and_focus_is_better(name, mode):
    sensor = om.load_sensor(name)
    for best in best_apertures(sensor, mode=mode):
        there = at(sensor, best.side, best.f_number, best.focus_mm, mode)
        assert there == pytest.approx(best.worst_px, rel=1e-4)
        assert best.worst_px == pytest.approx(np.hypot(best.blur_px, best.airy_px), rel=1e-12)
        for F in best.f_number * np.array([0.8, 0.99, 1.01, 1.25]):
            for focus in best.focus_mm + np.array([-5.0, -0.2, 0.0, 0.2, 5.0]):
                assert at(sensor, best.side, F, focus, mode) >= best.worst_px * (1 - 1e-4)


def test_apertures_stay_within_the_lens():
    wide, narrow = best_apertures(SPHERE, (1.4, 2.8)), best_apertures(SPHERE, (16.0, 22.0))
    assert [b.f_number for b in wide] == [2.8, 2.8, 2.8]
    assert [b.f_number for b in narrow] == [16.0, 16.0, 16.0]
    with pytest.raises(InvalidParameter, match="no range"):
        best_apertures(SPHERE, (8.0, 4.0))
    with pytest.raises(InvalidParameter, match="leaves no field"):
        best_apertures(SPHERE, omega_min_deg=150.0)


def test_the_bundled_catalogue_has_a_lens_for_the_sphere_and_reasons_against_the_others():
    shelf = read_catalogue()
    found = choose_parts(SPHERE, shelf)
    assert len(found) == len(shelf.lenses) * len(shelf.imagers)
    fits = [c.fits for c in found]
    assert fits == sorted(fits, reverse=True)
    assert any(fits)
    best = [c.worst_floored_area_deg2 for c in found if c.fits]
    assert best == sorted(best)
    for c in found:
        assert c.fits != bool(c.reasons)
        if c.fits:
            assert 0.6 <= c.fill <= 1.0
            assert c.sensor.rim_radius_px == pytest.approx(c.fill * min(c.sensor.imager.size) / 2)
            r = om.evaluate(c.sensor, np.linspace(*c.sensor.field_deg, 1001))
            assert r.floored_area_deg2.max() == pytest.approx(c.worst_floored_area_deg2, rel=1e-3)
        if c.lens.startswith("telecentric"):
            assert "not a telecentric one" in c.reasons[0]


def test_a_telecentric_lens_has_to_be_as_wide_as_the_mirror():
    sensor = om.load_sensor("paraboloid-telecentric")
    width = 2 * sensor.mirror.rim_radius_mm
    imager = ImagerComponent("imager", 2448, 2048, 3.45)
    lenses = [TelecentricComponent(f"front {d:g}", 0.1, 8.0, 16.0, d) for d in (width * 0.99, width)]
    ordinary = LensComponent("12 mm", 12.0, 2.0, 8.0, 100.0)
    wide, narrow = choose_parts(sensor, Catalogue((*lenses, ordinary), (imager,)))[:2]
    assert wide.fits
    assert f"narrower than the mirror, {width:g} mm" in narrow.reasons[0]


def test_rings_reach_what_the_lens_equation_says():
    """The lens in its nearest position plus the ring: 1/f = 1/L + 1/b."""
    lens = LensComponent("lens", 16.0, 1.4, 16.0, 300.0, extension_rings_mm=(0.5, 1.0, 5.0))
    nearest = 1 / (1 / 16.0 - 1 / 300.0)
    for focus in (1e5, 310.0, 299.0, 240.0, 205.0, 180.0, 60.0):
        ring, reasons = rings_for(lens, focus)
        b = 1 / (1 / 16.0 - 1 / focus)
        assert reasons or 16.0 + ring <= b <= nearest + ring + 1e-12
    assert rings_for(lens, 240.0)[0] == 0.5
    _, (sentence,) = rings_for(lens, 100.0)
    assert "takes rings of 2.15 to 3.05 mm" in sentence
    assert rings_for(replace(lens, extension_rings_mm=()), 240.0)[1] == [
        "its nearest focus is 300 mm, the images need 240 mm"
    ]


def test_catalogues_as_csv(tmp_path):
    (tmp_path / "lenses.csv").write_text(
        "name,focal_length_mm,f_number_min,f_number_max,minimum_focus_mm,extension_rings_mm,image_circle_mm\n"
        "A,12,1.4,16,250,0.5 1,\nB,16,1.4,16,300,,11\n"
    )
    (tmp_path / "imagers.csv").write_text("name,width_px,height_px,pixel_pitch_um\nC,1280,1024,5.2\n")
    read = read_catalogue(tmp_path / "lenses.csv", tmp_path / "imagers.csv")
    assert read.lenses == (
        LensComponent("A", 12.0, 1.4, 16.0, 250.0, None, (0.5, 1.0)),
        LensComponent("B", 16.0, 1.4, 16.0, 300.0, 11.0, ()),
    )
    assert read.imagers == (ImagerComponent("C", 1280, 1024, 5.2),)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[[lens]]\nname = 'A'\n", "focal_length_mm is missing"),
        ("[[lens]]\nname = 'A'\nfocal = 3\n", "focal is not known"),
        ("[[camera]]\nname = 'A'\n", "camera is not known"),
        ("lens = 3\n", "lens is not known"),
        ("[[imager]]\nname = 'A'\nwidth_px = 'wide'\nheight_px = 3\npixel_pitch_um = 3\n", "'wide' is not a number"),
        ("[[imager]]\nname = 'A'\nwidth_px = 3\nheight_px = 3\npixel_pitch_um = -3\n", "outside 0.01 to 10000 um"),
        ("[[imager]]\nname = 'A'\nwidth_px = 3\nheight_px = 3\npixel_pitch_um = 3\n", "there is no lens"),
        ("[[lens", "not valid TOML"),
    ],
)
def test_wrong_catalogues_are_refused_with_the_entry(tmp_path, text, sentence):
    (tmp_path / "parts.toml").write_text(text)
    with pytest.raises(OmnimirrorError, match=sentence):
        read_catalogue(tmp_path / "parts.toml")
    with pytest.raises(OmnimirrorError, match="cannot read"):
        read_catalogue(tmp_path / "nowhere.toml")


@pytest.mark.parametrize("mode", ["Exact", "PAPER", "", None])
def test_an_unknown_mode_of_blur_is_refused(mode):
    with pytest.raises(InvalidParameter, match="valid are exact, paper"):
        best_apertures(om.load_sensor("paper-spherical"), mode=mode)


@pytest.mark.parametrize("distance", [0, 0.0, -5.0])
def test_an_object_nowhere_is_refused(distance):
    for ask in (
        lambda **at: choose_parts(SPHERE, read_catalogue(), **at),
        lambda **at: best_apertures(SPHERE, **at),
    ):
        with pytest.raises(InvalidParameter, match=r"object_distance_mm = .* is not a distance; it is valid above 0"):
            ask(object_distance_mm=distance)
