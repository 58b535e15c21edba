"""``omnimirror rim``: mirror-outline detection."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ....base.files import write_json
from ....calibration.edge_detection import levels_of
from ....calibration.rim import (
    MIN_CONFIDENCE,
    MirrorOutline,
    check_image_sizes,
    detect_mirror_outline,
)
from ....io.batch import READABLE_IMAGE_SUFFIXES, expand_inputs
from .._camera_options import OrientationOptions
from .._declarations import DocumentedCommand, takes
from .._output import (
    FIGURES,
    json_option,
    output_console,
    output_option,
    plain_table,
    say,
    say_written,
)


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=("omnimirror rim picture1.jpg picture2.jpg --figure rim.png --json rim.json",),
)
@click.argument("images", nargs=-1, required=True, metavar="IMAGE...")
@takes(OrientationOptions, "orientation")
@click.option(
    "--each", is_flag=True, help="Process each image separately, as from different sensors."
)
@output_option(
    "--figure", formats=FIGURES, help="Draw the detected outlines on the images (PNG, SVG, PDF)."
)
@json_option("Write the outline, whether it is accepted, and the rejected candidates.")
def command(
    images: tuple[str, ...],
    orientation: OrientationOptions,
    each: bool,
    figure: Path | None,
    json_file: Path | None,
) -> None:
    """Detect the outline of the mirror in IMAGES: image files, folders or file patterns.

    Several images are assumed to be from one sensor and are evaluated together. An outline is an
    ellipse, in px from the centre of the first pixel; its angle is that of the major axis, from
    image right towards image bottom. Below a confidence of 0.6 it is not accepted, but listed as a
    candidate, with the next best circles of the image.
    """
    files = expand_inputs(images, READABLE_IMAGE_SUFFIXES)
    pictures = orientation.read(files)
    if not each:
        check_image_sizes(pictures, [file.name for file in files])
    found = (
        [detect_mirror_outline(picture) for picture in pictures]
        if each
        else [detect_mirror_outline(pictures)]
    )
    singles = found if each else list(found[0].images) or found
    console = output_console()
    numbers = ("centre\npx", "semi-axes\npx", "angle\ndeg", "camera's image\npx", "confidence\n")
    table = plain_table("picture", *numbers, words=("picture",))
    for file, rim in zip(files, singles, strict=True):
        table.add_row(*_row(file.name, rim))
    if len(singles) > len(found):
        table.add_row(*_row("together", found[0]))
    for name, rim in zip(
        [file.name for file in files] if len(singles) == len(found) else ["together"],
        found,
        strict=True,
    ):
        for number, candidate in enumerate(() if rim.is_accepted else rim.candidates[1:], 2):
            table.add_row(*_row(f"{name}, candidate {number}", candidate))
    console.print(table)
    for name, rim in zip(
        [file.name for file in files] if each else ["together"], found, strict=True
    ):
        if not rim.is_accepted:
            who = f"{name}: " if len(files) > 1 else ""
            say(
                f"{who}no rim is sure: the confidence {rim.confidence:.2f} is below {MIN_CONFIDENCE:g}",
                console=console,
            )
    if json_file:
        record = [rim.to_json() for rim in found]
        named = [
            {"name": file.name} | rim.to_json() for file, rim in zip(files, singles, strict=True)
        ]
        whole = record[0] | {"images": named} if len(found) == 1 else {"images": named}
        write_json(json_file, whole)
        say_written(json_file, console=console)
    if figure:
        say_written(_drawn(figure, files, pictures, singles), console=console)


def _drawn(
    figure: Path, files: list[Path], pictures: list[NDArray[Any]], found: list[MirrorOutline]
) -> Path:
    """Write a figure of the images with the detected outlines."""
    from ....analysis.figures import save_figure
    from ....analysis.figures.calibration_results import DrawnRim, found_rims

    drawn = [
        DrawnRim(
            levels_of(picture).astype(np.uint8),
            rim.points(),
            rim.centre_px,
            None
            if rim.camera_image is None
            else (*rim.camera_image.centre_px, rim.camera_image.radius_px),
            rim.is_accepted,
            f"{file.name}: {rim.confidence:.2f}",
        )
        for file, picture, rim in zip(files, pictures, found, strict=True)
    ]
    return save_figure(found_rims(drawn), figure)


def _row(name: str, rim: MirrorOutline) -> tuple[str, ...]:
    (u, v), (a, b) = rim.centre_px, rim.semi_axes_px
    camera = "-" if rim.camera_image is None else f"{rim.camera_image.radius_px:.1f}"
    return (
        name,
        f"{u:.2f}, {v:.2f}",
        f"{a:.2f}, {b:.2f}",
        f"{rim.angle_deg:.1f}",
        camera,
        f"{rim.confidence:.3f}",
    )
