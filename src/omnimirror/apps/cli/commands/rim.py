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
from .._declarations import DocumentedCommand, add_options
from .._output import (
    FIGURES,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_line,
    print_written,
)


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=("omnimirror rim image1.jpg image2.jpg -o rim.png --json rim.json",),
)
@click.argument("images", nargs=-1, required=True, metavar="IMAGE...")
@add_options(OrientationOptions, "orientation")
@click.option(
    "--separately", is_flag=True, help="Process each image separately, as from different sensors."
)
@output_option(
    "-o",
    "--output",
    formats=FIGURES,
    help="Figure of the detected outlines on the images (PNG, SVG, PDF).",
)
@json_option("Write the outline, whether it is accepted, and the rejected candidates.")
def command(
    images: tuple[str, ...],
    orientation: OrientationOptions,
    separately: bool,
    output: Path | None,
    json_file: Path | None,
) -> None:
    """Detect the outline of the mirror in IMAGES: image files, folders or file patterns.

    Several images are assumed to be from one sensor and are evaluated together. An outline is an
    ellipse, in px from the centre of the first pixel; its angle is that of the major axis, from
    image right towards image bottom. Below a confidence of 0.6 it is not accepted, but listed as a
    candidate, with the next best circles of the image.
    """
    files = expand_inputs(images, READABLE_IMAGE_SUFFIXES)
    pixels = orientation.read(files)
    if not separately:
        check_image_sizes(pixels, [file.name for file in files])
    rims = (
        [detect_mirror_outline(image) for image in pixels]
        if separately
        else [detect_mirror_outline(pixels)]
    )
    singles = rims if separately else list(rims[0].images) or rims
    console = output_console()
    numbers = ("centre\npx", "semi-axes\npx", "angle\ndeg", "camera image\npx", "confidence\n")
    table = plain_table("image", *numbers, text_columns=("image",))
    for file, rim in zip(files, singles, strict=True):
        table.add_row(*_row(file.name, rim))
    if len(singles) > len(rims):
        table.add_row(*_row("together", rims[0]))
    for name, rim in zip(
        [file.name for file in files] if len(singles) == len(rims) else ["together"],
        rims,
        strict=True,
    ):
        for number, candidate in enumerate(() if rim.is_accepted else rim.candidates[1:], 2):
            table.add_row(*_row(f"{name}, candidate {number}", candidate))
    console.print(table)
    for name, rim in zip(
        [file.name for file in files] if separately else ["together"], rims, strict=True
    ):
        if not rim.is_accepted:
            prefix = f"{name}: " if len(files) > 1 else ""
            print_line(
                f"{prefix}no rim detected: the confidence must be at least "
                f"{MIN_CONFIDENCE:g}; got {rim.confidence:.2f}",
                console=console,
            )
    if json_file:
        record = [rim.to_json() for rim in rims]
        named = [
            {"name": file.name} | rim.to_json() for file, rim in zip(files, singles, strict=True)
        ]
        document = record[0] | {"images": named} if len(rims) == 1 else {"images": named}
        write_json(json_file, document)
        print_written(json_file, console=console)
    if output:
        print_written(_draw_outlines(output, files, pixels, singles), console=console)


def _draw_outlines(
    figure: Path, files: list[Path], images: list[NDArray[Any]], rims: list[MirrorOutline]
) -> Path:
    """Write a figure of the images with the detected outlines."""
    from ....analysis.figures import save_figure
    from ....analysis.figures.calibration_results import RimDrawing, detected_rims

    drawn = [
        RimDrawing(
            levels_of(image).astype(np.uint8),
            rim.points(),
            rim.centre_px,
            None
            if rim.camera_image is None
            else (*rim.camera_image.centre_px, rim.camera_image.radius_px),
            rim.is_accepted,
            f"{file.name}: {rim.confidence:.2f}",
        )
        for file, image, rim in zip(files, images, rims, strict=True)
    ]
    return save_figure(detected_rims(drawn), figure)


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
