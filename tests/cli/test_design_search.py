"""optimise, apertures and parts as a user runs them."""

from __future__ import annotations

from pathlib import Path

import pytest

import omnimirror as om
from tests.cli.test_evaluate import fails, omnimirror

EXAMPLE = Path(__file__).parents[2] / "docs" / "parts.toml"


def test_optimise_writes_a_sensor_and_shows_convergence(tmp_path):
    run = omnimirror(
        "optimise", "paper-spherical", "--merit", "blur", "--family", "even-polynomial", "--terms", "3,4,5",
        "--starts", 1, "--paper-mode", "--image-radius-px", 500, "-o", "best.toml", cwd=tmp_path,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    values = [float(line.split()[-2]) for line in run.stdout.splitlines()[1:4]]
    assert values == sorted(values, reverse=True)
    sensor = om.load_sensor(tmp_path / "best.toml")
    assert sensor.mirror.KIND == "even-polynomial"
    assert sensor.field_deg[1] == pytest.approx(om.load_sensor("paper-spherical").field_deg[1], abs=1e-9)
    assert "sphere" in run.stdout


def test_optimise_from_options_alone(tmp_path):
    run = omnimirror(
        "optimise", "--omega-max-deg", 120, "--theta-max-deg", "8:12", "--rim-radius-mm", 30, "--focal-length-mm", 16,
        "--f-number", "2:16", "--width-px", 2048, "--height-px", 2048, "--pixel-pitch-um", 3.45, "--terms", 5,
        "--limit", "uniformity=1.5", "--starts", 1, "--checkpoint", "search.json", "-o", "best.toml", cwd=tmp_path,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    sensor = om.load_sensor(tmp_path / "best.toml")
    assert sensor.field_deg[1] == pytest.approx(120.0, abs=1e-9)
    assert (sensor.mirror.rim_radius_mm, sensor.lens.focal_length_mm, sensor.imager.width_px) == (30.0, 16.0, 2048)
    assert (tmp_path / "search.json").exists()


def test_a_front_is_kept_drawn_and_picked_from(tmp_path):
    arguments = (
        "optimise", "--pareto", "blur_area,uniformity", "--family", "even-polynomial", "--terms", 4, "--population", 20,
        "--generations", 20, "--front", "front.parquet",
    )  # fmt: skip
    run = omnimirror(*arguments, "--figure", "front.png", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "SVP" in run.stdout
    assert om.read_image(tmp_path / "front.png").std() > 5
    run = omnimirror(*arguments, "--pick", 1, "-o", "one.toml", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert om.load_sensor(tmp_path / "one.toml").name == "front-blur-area-uniformity-1"
    assert "--pick NUMBER" in fails(*arguments, "-o", "other.toml", cwd=tmp_path)
    assert not (tmp_path / "other.toml").exists()


def test_apertures_and_parts_print_their_tables(tmp_path):
    run = omnimirror("apertures", "paper-spherical", "paper-hyperboloidal", "--f-number", "1.4:16")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("together") == 2
    run = omnimirror("parts", "paper-spherical", EXAMPLE, "-o", "bought.toml", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "overfills" in run.stdout
    bought = om.load_sensor(tmp_path / "bought.toml")
    assert bought.mirror == om.load_sensor("paper-spherical").mirror
    assert "fit, so there is no sensor" in fails(
        "parts", "paper-spherical", EXAMPLE, "--least-fill", 0.999, "-o", "x.toml", cwd=tmp_path
    )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["optimise", "paraboloid-telecentric"], "perspective lenses"),
        (["optimise", "--limit", "uniformity"], "MERIT=NUMBER"),
        (["optimise", "--terms", "few"], "whole numbers"),
        (["optimise", "--terms", "200"], "takes 3 to 60"),
        (["optimise", "--theta-max-deg", "12:x"], "range LOW:HIGH"),
        (["optimise", "--omega-max-deg", "200"], "cannot be reached"),
        (["optimise", "--pareto", "blur"], "two different merits"),
        (["optimise", "--pareto", "blur,aspect", "--starts", "3"], "belongs to --merit"),
        (["optimise", "--population", "3"], "belongs to --pareto"),
        (["apertures", "paper-spherical", "--f-number", "8:4"], "no range"),
        (["parts", "paper-spherical", "nowhere.toml"], "cannot read"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(arguments, sentence):
    assert sentence in fails(*arguments)
