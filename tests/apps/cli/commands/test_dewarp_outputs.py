"""Output formats of ``omnimirror dewarp`` that differ from the source, and invalid outputs."""

import sys
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.base.colour import linear_from_srgb, srgb_from_linear
from omnimirror.dewarp import request

BALL = (
    "--ball",
    "31.5,31.5,30,280",
    "--view",
    "perspective",
    "--size",
    "32x24",
    "--set=image.transparent=false",
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    colour = np.array([0.9, 0.4, 0.05])
    om.write_image("deep.png", np.full((64, 64, 3), np.rint(65535 * colour), np.uint16))
    om.write_image("light.hdr", np.full((64, 64, 3), colour * [1, 1, 60], np.float32))
    om.write_image("grey.png", np.full((64, 64), 128, np.uint8))
    return tmp_path


def middle(path: str) -> np.ndarray:
    return om.read_image(path)[12, 16]


def error_message(capsys, *args) -> str:
    with pytest.raises(SystemExit, match=r"^[12]$"):
        main(["dewarp", *args])
    output = capsys.readouterr().err
    assert len(output.strip().splitlines()) == 1 or output.startswith("Usage")
    assert "Traceback" not in output
    return output


def test_conversion_to_8_bits_and_srgb(folder, capsys):
    """Transfer curve of IEC 61966-2-1 (omnimirror.base.colour); three times white is clipped to
    white."""
    main(["dewarp", "deep.png", *BALL, "-o", "a.jpg"])
    assert "converted from 16 bits to 8 bits" in capsys.readouterr().out
    assert np.abs(middle("a.jpg") - 255 * np.array([0.9, 0.4, 0.05])).max() <= 2
    main(["dewarp", "light.hdr", *BALL, "-o", "b.png"])
    assert "converted from linear light to 16 bits" in capsys.readouterr().out
    expected = 65535 * srgb_from_linear(om.read_image("light.hdr")[32, 32])
    assert np.abs(middle("b.png") - expected).max() <= 1
    assert middle("b.png")[2] == 65535
    main(["dewarp", "deep.png", *BALL, "-o", "c.hdr"])
    np.testing.assert_allclose(
        middle("c.hdr"), linear_from_srgb([0.9, 0.4, 0.05]), rtol=0.02, atol=2e-3
    )
    main(["dewarp", "grey.png", *BALL, "-o", "d.webp"])
    assert middle("d.webp").tolist() == [128, 128, 128]


@pytest.mark.parametrize(("suffix", "max_px"), [("jpg", "65500"), ("webp", "16383")])
def test_image_too_large_for_format_raises_before_dewarping(folder, capsys, suffix, max_px):
    args = (
        "grey.png",
        "--ball",
        "31.5,31.5,30,280",
        "--size",
        "70000x2",
        "--set=image.transparent=false",
        "-o",
        f"o.{suffix}",
    )
    assert f"images must have at most {max_px} px per side; got 70000 x 2 px" in error_message(
        capsys, *args
    )
    with pytest.raises(om.base.errors.MediaError, match="70000 x 2 px"):
        om.write_image(f"o.{suffix}", np.zeros((2, 70_000, 3), np.uint8))
    assert not Path(f"o.{suffix}").exists()


def test_exr_without_package_raises_before_dewarping(folder, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    monkeypatch.setattr(request, "Dewarper", None)
    assert "OpenEXR must be installed for o.exr" in error_message(
        capsys, "deep.png", *BALL, "-o", "o.exr"
    )


@pytest.mark.parametrize(
    "option", ["--set=view.span_deg=1e-308", "--elevation-deg=0:1e-308", "--set=view.span_deg=1e-9"]
)
def test_empty_views_print_one_line(folder, capsys, option):
    for size in ("64x", "64x8"):
        message = error_message(
            capsys, "grey.png", "--ball", "31.5,31.5,30,280", option, "--size", size, "-o", "o.png"
        )
        assert "must be" in message or "must increase" in message or "valid" in message


def test_circular_links_print_one_line(folder, capsys):
    Path("a.png").symlink_to("b.png")
    Path("b.png").symlink_to("a.png")
    assert "a.png" in error_message(capsys, "a.png", *BALL, "-o", "o.png")
    assert "a.png" in error_message(capsys, "grey.png", *BALL, "-o", "a.png")


def test_alpha_in_format_without_alpha_raises(folder, capsys):
    om.write_image("clear.png", np.full((64, 64, 4), 128, np.uint8))
    assert (
        "cannot write out.jpg: .jpg images must be uint8 with 1 or 3 channels; got uint8 with 4"
        in error_message(capsys, "clear.png", *BALL, "-o", "out.jpg")
    )
    assert not (folder / "out.jpg").exists()
