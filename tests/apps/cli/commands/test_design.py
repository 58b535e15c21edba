"""Commands ``omnimirror design`` and ``omnimirror mappings``."""

from __future__ import annotations

import json

import numpy as np
import pytest

import omnimirror as om
from tests.commands import fails, omnimirror

COMMON_OPTIONS = [
    "--mapping",
    "equidistant",
    "--omega-max-deg",
    135,
    "--theta-max-deg",
    12,
    "--rim-radius-mm",
    43.9,
]


def test_design_from_options(tmp_path):
    run = omnimirror(
        "design",
        *COMMON_OPTIONS,
        "--focal-length-mm",
        11.6,
        "-o",
        "s.toml",
        "--json",
        "t.json",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    assert om.load_sensor(tmp_path / "s.toml").field_deg[1] == pytest.approx(135, abs=1e-9)
    table = json.loads((tmp_path / "t.json").read_text())
    assert table["is_met"] is True
    assert [r["name"] for r in table["requirements"]][:2] == ["omega_max_deg", "rim_radius_mm"]
    for word in ("requirement", "required", "reached", "margin", "172.28"):
        assert word in run.stdout


def test_infeasible_requirements_print_relaxations_and_exit_with_3(tmp_path):
    (tmp_path / "r.toml").write_text(
        'field.omega_max_deg = 135\nmirror = {family = "sphere", rim_radius_mm = 43.9}\n'
        'lens.theta_max_deg = 12\n[[limit]]\nquantity = "total_blur_px"\nat_most = 4.5\n'
    )
    run = omnimirror("design", "r.toml", "-o", "s.toml", "--json", "t.json", cwd=tmp_path)
    assert run.returncode == 3
    assert "Infeasible requirements: total_blur_px." in run.stdout
    assert "All requirements are met if one of these is relaxed:" in run.stdout
    conflict = json.loads((tmp_path / "t.json").read_text())["conflict"]
    assert {"total_blur_px", "f_number"} <= {
        r["name"] for r in conflict["alone"] if r["needed"] is not None
    }
    assert om.load_sensor(tmp_path / "s.toml").mirror.KIND == "sphere"  # the best feasible choice
    second_run = omnimirror("design", "r.toml", "--f-number", 6, cwd=tmp_path)
    assert second_run.returncode == 0, second_run.stdout


def test_check_of_bundled_sensor(tmp_path):
    """Check the coarsest resolution of the sphere by its own evaluation; violations are also
    reported by the exit code."""
    file = tmp_path / "r.toml"
    mirror = 'mirror = {family = "sphere", rim_radius_mm = [43, 44]}'
    limit = '[[limit]]\nquantity = "dh_domega_px_per_deg"'
    worst = om.evaluate(
        om.load_sensor("paper-spherical"), np.linspace(0, 130, 1001)
    ).dh_domega_px_per_deg.min()
    for min_value, code in ((worst - 1, 0), (worst + 1, 3)):
        lines = (
            "field.omega_max_deg = 130",
            mirror,
            "lens.focal_length_mm = 11.6",
            limit,
            f"at_least = {min_value}",
        )
        file.write_text("\n".join(lines))
        run = omnimirror("check", "r.toml", "paper-spherical", "--json", "t.json", cwd=tmp_path)
        assert run.returncode == code, run.stderr
        assert all(word in run.stdout for word in ("requirement", "required", "reached", "margin"))
        table = json.loads((tmp_path / "t.json").read_text())
        assert table["is_met"] is (code == 0)
        row = table["requirements"][-1]
        assert (row["name"], row["reached"]) == (
            "dh_domega_px_per_deg",
            pytest.approx(worst, rel=1e-6),
        )
        assert row["margin"] == pytest.approx(worst - min_value, rel=1e-5)
    assert json.loads(omnimirror("check", file, "paper-spherical", "--json", "-").stdout) == table
    assert "the lens of the sensor must be" in fails("check", file, "paraboloid-telecentric")
    housed = omnimirror(
        "check", file, "paper-spherical", "--set", "housing.camera.diameter_mm=30", "--json", "-"
    )
    assert json.loads(housed.stdout)["requirements"][-1]["remarks"] != row["remarks"]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ([], "specify a requirement file, or a field and a mirror by options"),
        (["no.toml"], "cannot read the requirement file no.toml: the file does not exist"),
        ([*COMMON_OPTIONS, "--mirror", "spher"], "got mapping and family"),
        (["--mirror", "spher", *COMMON_OPTIONS[2:]], "got 'spher'; did you mean sphere?"),
        ([*COMMON_OPTIONS, "--set", "mirror.fit=poly:3"], "got 'poly:3'"),
        ([*COMMON_OPTIONS, "--f-number", "8:4"], "lens.f_number must be a number"),
        ([*COMMON_OPTIONS[:6], "--theta-max-deg", 60], "is missing|rim_radius_mm is missing"),
        (["--omega-max-deg", 120], "the table [mirror] is missing"),
    ],
)
def test_invalid_arguments_print_one_line(args, message, tmp_path):
    output = fails("design", *args, cwd=tmp_path)
    assert any(part in output for part in message.split("|")), output
    assert list(tmp_path.iterdir()) == []


def test_mappings_table_and_figure(tmp_path):
    run = omnimirror("mappings", "--omega-max-deg", 75, "-o", "m.png", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert (
        "4.2365121" in run.stdout
    )  # far plane to 75 deg at 12 deg, computed separately with 40 digits
    assert (tmp_path / "m.png").read_bytes()[:4] == b"\x89PNG"
    wide = omnimirror("mappings", "--omega-max-deg", 135)
    for number in ("3.9242676", "3.9162533", "3.5500754", "3.556120", "4.0723518"):
        assert number in wide.stdout
    assert "omega_max_deg must be less than 90 deg" in wide.stdout


def test_mappings_of_infeasible_field():
    assert "omega_max_deg must be between" in fails("mappings", "--omega-max-deg", 175)


@pytest.mark.full
@pytest.mark.long
def test_relaxations_are_printed_as_elevations(tmp_path):
    (tmp_path / "watch.toml").write_text(
        '[mount]\ncamera_looks = "up"\n[field]\nelevation_deg = [-60, 20]\n[mirror]\n'
        'family = "sphere"\nrim_radius_mm = 30.0\n[lens]\nfocal_length_mm = 11.6\n'
        '[[limit]]\nquantity = "resolution_px_per_deg"\nat_least = 6.0\nelevation_deg = 0\n'
    )
    output = omnimirror("design", tmp_path / "watch.toml").stdout
    assert "Infeasible requirements: resolution_px_per_deg, elevation 0 deg." in output
    text = output[output.index("Infeasible") :]
    assert "90 deg" not in text
    assert "omega_" not in text
    elevations = [line for line in text.splitlines() if "elevation at the rim: " in line]
    assert all(line.endswith("instead of 20 deg") for line in elevations)
    assert elevations
    assert "f_number" not in text  # does not increase the image
    assert "rim_radius_mm" not in text
