"""Command ``convert``: output and written files."""

import numpy as np
import pytest
import yaml

import omnimirror as om
from tests.commands import omnimirror


def test_round_trip_between_formats(tmp_path):
    camera = om.Unified(
        xi=0.93,
        focal_px=(260.0, 261.3),
        centre_px=(515.32, 380.29),
        image_size=(1024, 768),
        k1=-0.01,
        p2=-2e-3,
    )
    om.save_camera(camera, tmp_path / "a.toml")
    run = omnimirror("convert", "a.toml", "-o", "b.yaml", "--to", "kalibr-omni", cwd=tmp_path)
    assert run.returncode == 0
    assert run.stdout.startswith("omnimirror to kalibr-omni: exact\nNote: the image is mirrored:")
    assert run.stdout.endswith("Wrote b.yaml\n")
    second_run = omnimirror("convert", "b.yaml", "-o", "c.toml", cwd=tmp_path)
    assert second_run.returncode == 0
    assert om.load_camera(tmp_path / "c.toml") == camera


def test_standard_output(tmp_path):
    run = omnimirror(
        "convert",
        "paper-hyperboloidal",
        "-o",
        "-",
        "--to",
        "kalibr-eucm",
        "--tolerance-px",
        "1",
        cwd=tmp_path,
    )
    assert run.returncode == 0
    assert yaml.safe_load(run.stdout)["cam0"]["camera_model"] == "eucm"
    assert "fitted model" in run.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "set tolerance_px"),
        pytest.param(
            ["--tolerance-px", "0.001"], "at most tolerance_px = 0.001", marks=pytest.mark.full
        ),
        (
            ["--set", "fit.distance_mm=500,near"],
            "must be a distance in mm above 0, or 'inf'; got 'near'",
        ),
        (["--from", "kalibre"], "kalibr"),
    ],
)
def test_invalid_arguments_print_one_line(tmp_path, options, message):
    run = omnimirror(
        "convert",
        "paper-spherical",
        "-o",
        "a.yaml",
        "--to",
        "opencv-omnidir",
        *options,
        cwd=tmp_path,
    )
    assert run.returncode in (1, 2)
    assert message in run.stderr
    assert run.stderr.count("\n") == 1
    assert not (tmp_path / "a.yaml").exists()


def test_command_and_function_write_same_file(tmp_path):
    distance = (700.0, np.inf)
    om.convert(
        "paper-spherical",
        tmp_path / "a.yaml",
        to="kalibr-ds",
        tolerance_px=20,
        distance_mm=distance,
        flip=True,
    )
    options = [
        "--to",
        "kalibr-ds",
        "--tolerance-px",
        20,
        "--set",
        "fit.distance_mm=700,inf",
        "--flip",
    ]
    assert (
        omnimirror("convert", "paper-spherical", "-o", "b.yaml", *options, cwd=tmp_path).returncode
        == 0
    )
    assert (tmp_path / "a.yaml").read_bytes() == (tmp_path / "b.yaml").read_bytes()


def test_inconsistent_file_is_reported(tmp_path):
    """Notes of a conversion, and warnings on standard error when the file is used."""
    om.convert(
        om.OCam(polynomial=(-130.0, 0.0, 1.9e-3), centre_px=(515.0, 380.0), image_size=(1024, 768)),
        tmp_path / "a.txt",
        to="ocamcalib",
    )
    text = (tmp_path / "a.txt").read_text().replace("380.0 515.0", "515.0 380.0")
    (tmp_path / "a.txt").write_text(text)
    message = "the centre (380, 515) is 186 px from the centre of the 1024 x 768 px image"
    run = omnimirror("convert", "a.txt", "-o", "b.toml", cwd=tmp_path)
    assert f"Note: {message}" in run.stdout
    run = omnimirror("evaluate", "a.txt", cwd=tmp_path)
    assert run.returncode == 0
    assert f"Warning: a.txt: {message}" in run.stderr
