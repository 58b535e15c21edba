"""Command ``omnimirror rays``."""

from __future__ import annotations

import numpy as np
import pytest

from tests.commands import fails, omnimirror


def test_rays_of_a_sensor(tmp_path):
    run = omnimirror("rays", "paper-spherical", "-o", tmp_path / "rays.npz", "--step", 16)
    assert run.returncode == 0, run.stderr
    assert "64 x 64 rays" in run.stdout
    assert "exact" in run.stdout
    assert np.load(tmp_path / "rays.npz")["weights"].shape == (64, 64)


def test_formats_in_a_folder(tmp_path):
    run = omnimirror(
        "rays", "paper-spherical", "-o", tmp_path, "--format", "npz,newton,mitsuba", "--step", 16
    )
    assert run.returncode == 0, run.stderr
    assert {p.name for p in tmp_path.iterdir()} == {
        f"paper-spherical-{name}" for name in ("npz.npz", "newton.npy", "mitsuba.py", "mitsuba.npy")
    }
    assert "deg: interpolation between rays" in run.stdout


def test_invalid_arguments(tmp_path):
    assert "formats must be given for the folder" in fails(
        "rays", "paper-spherical", "-o", tmp_path
    )
    message = "must be one of exr, npz, mitsuba, blender, newton; got 'obj'"
    assert message in fails("rays", "paper-spherical", "-o", tmp_path, "--format", "obj")
    assert "step must be an integer between 1 and 1024; got 0" in fails(
        "rays", "paper-spherical", "-o", tmp_path / "a.npz", "--step", 0
    )


@pytest.mark.parametrize(
    ("options", "magic"), [((), b"v/1\x01"), (("--format", "npz"), b"PK\x03\x04")]
)
def test_standard_output(options, magic):
    run = omnimirror("rays", "paper-spherical", "--step", 64, "-o", "-", *options, text=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout[:4] == magic


def test_several_files_on_standard_output_raise():
    message = (
        "standard output requires a single file; blender consists of several; specify a folder"
    )
    assert message in fails("rays", "paper-spherical", "-o", "-", "--format", "blender")
