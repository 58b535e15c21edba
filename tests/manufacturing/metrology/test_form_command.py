"""``omnimirror form``: from measured points to the as-built sensor."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

import omnimirror as om
from tests.commands import omnimirror

from .clouds import in_machine, on


def test_command_writes_numbers_figure_and_sensor(tmp_path):
    mirror = om.load_sensor("paper-hyperboloidal").mirror
    points = in_machine(on(mirror, {6: 1.0, 11: 0.5}, 0.1, count=3000), above=True)
    np.savetxt(tmp_path / "cmm.csv", 1e3 * points, delimiter=",", header="x,y,z", fmt="%.4f")
    done = omnimirror(
        "form",
        "paper-hyperboloidal",
        tmp_path / "cmm.csv",
        "--unit",
        "um",
        "-o",
        tmp_path / "made.toml",
        "--figure",
        tmp_path / "form.png",
        "--json",
        tmp_path / "form.json",
    )
    assert done.returncode == 0, done.stderr
    assert "axes rotated by 180 deg about x" in done.stdout
    numbers = json.loads((tmp_path / "form.json").read_text())
    terms = {term["name"]: term for term in numbers["terms"] if abs(term["um"]) > 0.2}
    assert set(terms) == {"astigmatism", "spherical"}
    assert terms["spherical"]["um"] == pytest.approx(
        0.5, abs=3 * terms["spherical"]["sigma_um"] + 0.01
    )
    assert numbers["noise_um"] == pytest.approx(0.1, rel=0.2)
    assert (
        numbers["image"]["as_built"]["motion_px"]
        > numbers["image"]["as_built"]["motion_px after pose"]
    )
    assert cv2.imread(str(tmp_path / "form.png")).std() > 20
    sag = om.load_sensor(tmp_path / "made.toml").mirror.sag(40.0) - mirror.sag(40.0)
    assert 1e3 * abs(sag) > 0.1


def test_asymmetric_terms_are_written_on_request(tmp_path):
    """Projections of the written sensor agree with the true sensor within 5 % of the effect of the
    form.
    """
    from dataclasses import replace

    from omnimirror.optics.mirrors.mirror import MirrorForm, MirrorPose

    nominal = om.load_sensor("paper-hyperboloidal")
    truth = replace(nominal, mirror_form=MirrorForm((6, 9), (10.0, 4.0)))
    np.savetxt(
        tmp_path / "cmm.csv", on(nominal.mirror, {6: 10.0, 9: 4.0}, 0.1, count=4000), delimiter=","
    )
    for name, more in (("about.toml", []), ("whole.toml", ["--set", "as_built.asymmetric=true"])):
        done = omnimirror(
            "form", "paper-hyperboloidal", tmp_path / "cmm.csv", "-o", tmp_path / name, *more
        )
        assert done.returncode == 0, done.stderr
    turn = np.radians(np.arange(0, 360, 15.0))
    towards = np.concatenate(
        [
            np.stack(
                [np.sin(o) * np.cos(turn), np.sin(o) * np.sin(turn), -np.cos(o) + 0 * turn], -1
            )
            for o in (0.6, 1.4, 2.1)
        ]
    )
    about, whole = (om.load_sensor(tmp_path / name) for name in ("about.toml", "whole.toml"))
    pixels = {
        s: c.project_directions(towards).pixels
        for s, c in {"meant": nominal, "truth": truth, "about": about, "whole": whole}.items()
    }
    effect_px = np.abs(pixels["truth"] - pixels["meant"]).max()
    assert effect_px > 0.2
    # machine coordinates do not contain the mount of the mirror; a small shift and tilt account for
    # the difference
    poses = [
        MirrorPose(**{name: 0.01})
        for name in ("decentre_x_mm", "decentre_y_mm", "tilt_x_deg", "tilt_y_deg")
    ]
    moves = [
        replace(nominal, mirror_pose=pose).project_directions(towards).pixels - pixels["meant"]
        for pose in poses
    ]
    columns = np.stack([move.ravel() for move in moves], axis=1)

    def left_of(name):
        differences = (pixels[name] - pixels["truth"]).ravel()
        return np.abs(
            differences - columns @ np.linalg.lstsq(columns, differences, rcond=None)[0]
        ).max()

    assert left_of("whole") < 0.05 * effect_px
    assert left_of("about") > 0.5 * effect_px
    assert whole.mirror_form.zernike
    assert (
        "as_built.asymmetric requires --output"
        in omnimirror(
            "form", "paper-hyperboloidal", tmp_path / "cmm.csv", "--set", "as_built.asymmetric=true"
        ).stderr
    )


def test_telecentric_sensors_are_supported(tmp_path):
    mirror = om.load_sensor("paraboloid-telecentric").mirror
    np.savetxt(tmp_path / "cmm.xyz", on(mirror, {6: 1.0}, 0.1, count=2000))
    done = omnimirror(
        "form", "paraboloid-telecentric", tmp_path / "cmm.xyz", "--json", tmp_path / "form.json"
    )
    assert done.returncode == 0, done.stderr
    numbers = json.loads((tmp_path / "form.json").read_text())
    assert (
        numbers["image"]["as_built"]["motion_px"]
        > numbers["image"]["as_built"]["motion_px after pose"]
        > 0
    )
    assert {t["name"] for t in numbers["terms"] if abs(t["um"]) > 0.1} == {"astigmatism"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("missing.csv",), "missing.csv"),
        (("few.csv",), "must have at least 50 points; got 3"),
        (("few.csv", "--unit", "ell"), "ell"),
        (("few.csv", "--set", "fit.order=1"), "order must be an integer between 2 and 12; got 1"),
    ],
)
def test_invalid_input_prints_one_message_and_writes_no_file(arguments, message, tmp_path):
    (tmp_path / "few.csv").write_text("1,2,3\n4,5,6\n7,8,9\n")
    done = omnimirror(
        "form",
        "paper-spherical",
        tmp_path / arguments[0],
        *arguments[1:],
        "-o",
        tmp_path / "made.toml",
    )
    assert done.returncode not in (0, 70)
    assert message in done.stderr
    assert not (tmp_path / "made.toml").exists()
