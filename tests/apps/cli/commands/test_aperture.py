"""Commands that analyse the whole aperture."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.commands import fails, omnimirror


def test_spots_table_figure_and_files(tmp_path):
    args = [
        "--omega-deg",
        "0,60,120",
        "--focus-mm",
        "205,215",
        "-o",
        tmp_path / "s.png",
        "--csv",
        tmp_path / "s.csv",
    ]
    run = omnimirror("spots", "paper-spherical", *args)
    assert run.returncode == 0, run.stderr
    table = np.genfromtxt(tmp_path / "s.csv", delimiter=",", names=True)
    result = om.spots(om.load_sensor("paper-spherical"), [0, 60, 120], focus_mm=[205, 215])
    np.testing.assert_allclose(table["rms_radius_px"], result.rms_radius_px().ravel(), rtol=1e-8)
    np.testing.assert_allclose(table["extent_s_px"], result.extent_px()[1].ravel(), rtol=1e-8)
    assert (tmp_path / "s.png").read_bytes()[:4] == b"\x89PNG"
    assert f"{result.rms_radius_px()[2, 1]:.3f}" in run.stdout


def test_spots_f_number_table():
    run = omnimirror(
        "spots", "paper-hyperboloidal", "--set", "check_blur.f_numbers=2,4", "--omega-deg", "105"
    )
    assert run.returncode == 0, run.stderr
    rows = [line.split() for line in run.stdout.splitlines() if line.split()[0] in ("2", "4")]
    assert float(rows[1][3]) == pytest.approx(0.04, abs=0.005)
    assert float(rows[0][3]) == pytest.approx(4 * float(rows[1][3]), rel=0.1)


def test_mtf_units(tmp_path):
    args = [
        "--omega-deg",
        "60",
        "--set",
        "mtf.cycles_per_px=0:0.5:0.1",
        "--csv",
        tmp_path / "m.csv",
        "-o",
        tmp_path / "m.svg",
    ]
    run = omnimirror("mtf", "paper-spherical", *args)
    assert run.returncode == 0, run.stderr
    table = np.genfromtxt(tmp_path / "m.csv", delimiter=",", names=True)
    result = om.mtf(om.load_sensor("paper-spherical"), [60.0], cycles_per_px=np.arange(6) / 10)
    np.testing.assert_allclose(table["mtf_t"], result.tangential[0], atol=1e-9)
    np.testing.assert_allclose(table["lp_per_mm"], np.arange(6) / 10 / 0.0052, rtol=1e-9)
    np.testing.assert_allclose(table["cycles_per_deg_s"], result.cycles_per_deg_s[0], rtol=1e-9)
    assert "<text" in (tmp_path / "m.svg").read_text()


def test_psf_and_encircled_energy_figures(tmp_path):
    images = []
    for content in ("images", "encircled_energy"):
        args = ["--omega-deg", "0,90", "--focus-mm", "auto", "-o", tmp_path / f"{content}.png"]
        run = omnimirror("psf", "paper-spherical", *args, "--set", f"figure.content={content}")
        assert run.returncode == 0, run.stderr
        images.append((tmp_path / f"{content}.png").read_bytes())
    assert images[0] != images[1]


def test_illumination_of_metal(tmp_path):
    run = omnimirror(
        "illumination",
        "paper-spherical",
        "--reflectivity",
        "0.96,6.69",
        "--csv",
        tmp_path / "i.csv",
        "-o",
        tmp_path / "i.png",
    )
    assert run.returncode == 0, run.stderr
    table = np.genfromtxt(tmp_path / "i.csv", delimiter=",", names=True)
    assert table["reflectance"][0] == pytest.approx(0.921, abs=1e-3)
    assert table["relative"][0] == 1


def test_misaligned_sensor(tmp_path):
    from dataclasses import replace

    sensor = replace(
        om.load_sensor("paper-spherical"), mirror_pose=MirrorPose(0.5, 0.0, 0.0, 0.0, 1.0)
    )
    om.save_sensor(sensor, tmp_path / "m.toml")
    for command in ("spots", "mtf"):
        run = omnimirror(
            command, "m.toml", "--omega-deg", "60", "--set", "field.azimuth_deg=90", cwd=tmp_path
        )
        assert run.returncode == 0, run.stderr
    assert "decentred or tilted; specify --omega-deg" in fails("spots", "m.toml", cwd=tmp_path)
    assert "is decentred or tilted" in fails(
        "evaluate", "m.toml", "--focus-mm", "300", cwd=tmp_path
    )


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (
            ["spots", "paper-spherical", "--omega-deg", "150"],
            "omega = 150 deg at azimuth 0 deg must be in the field",
        ),
        (
            ["spots", "paper-spherical", "--set", "pupil.rings=0"],
            "rings must be an integer from 1 to 500; got 0",
        ),
        (
            ["spots", "paper-spherical", "--focus-mm", "200:300:1"],
            "--focus-mm must be at most 15 distances; got 101",
        ),
        (
            ["spots", "paper-spherical", "--set", "check_blur.f_numbers=4", "-o", "a.png"],
            "must not be given together with --output",
        ),
        (
            ["mtf", "paper-spherical", "--set", "light.wavelength_nm=3"],
            "wavelength_nm must be 100 to 20000 nm; got 3",
        ),
        (["mtf", "paper-spherical", "--focus-mm", "2"], "focus_distance_mm must be greater than"),
        (
            ["psf", "paper-spherical", "--omega-deg", "0:130:1"],
            "--omega-deg must be at most 15 field angles; got 131",
        ),
        (
            ["psf", "paper-spherical", "--omega-deg", "0", "-o", "p.gif"],
            "must be one of svg, png, pdf; got gif",
        ),
        (
            ["illumination", "paper-spherical", "--reflectivity", "tin"],
            "must be a fraction from 0 to 1",
        ),
        (
            ["illumination", "paper-spherical", "--reflectivity", "2"],
            "reflectivity must be greater than 0, up to 1; got 2",
        ),
    ],
)
def test_invalid_arguments_print_one_line(args, message, tmp_path):
    assert message in fails(*args, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []
