"""Overhead per image of a folder in addition to reading, sampling and writing: counted, not timed."""

from __future__ import annotations

import numpy as np

import omnimirror as om


def test_field_mask_is_computed_once_per_image_size(tmp_path, monkeypatch):
    calls = []
    valid = om.Dewarper.valid.fget
    monkeypatch.setattr(
        om.Dewarper, "valid", property(lambda dewarp: calls.append(dewarp) or valid(dewarp))
    )
    sizes = [(64, 64)] * 3 + [(96, 96)] * 2
    for i, (width, height) in enumerate(sizes):
        om.write_image(tmp_path / f"{i}.png", np.full((height, width, 3), 90, np.uint8))
    om.dewarp_images(
        tmp_path,
        tmp_path / "straight",
        threads=1,
        camera=lambda size: om.MirrorBall(
            centre_px=(size[0] / 2, size[1] / 2),
            rim_radius_px=size[0] / 2 - 2,
            field_deg=260.0,
            image_size=size,
        ),
    )
    assert len(list((tmp_path / "straight").iterdir())) == len(sizes)
    assert len(calls) == len(set(sizes))
