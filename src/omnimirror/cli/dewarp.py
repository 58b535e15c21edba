"""``omnimirror dewarp``: straighten a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ..dewarp import Dewarper
from ..dewarp.sampling import INTERPOLATIONS
from ..media.images import format_of, read_image, write_image
from .camera_options import camera_of, camera_options, check_camera_options
from .view_options import check_view_options, view_of, view_options


@click.command()
@click.argument("image", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="The picture to write.")
@camera_options
@view_options
@click.option("--interpolation", type=click.Choice(list(INTERPOLATIONS)), default="linear", show_default=True)
@click.option(
    "--transparent/--black",
    default=None,
    help="Outside the field.  [default: transparent where the file can: PNG, TIFF, WebP]",
)
def command(image: Path, output: Path, interpolation: Any, transparent: bool | None, **options: Any) -> None:
    """Straighten IMAGE, taken with a mirror sensor, a mirror ball or a fisheye.

    Say which camera it was with one of --sensor, --ocam and --ball. The result is drawn as seen from the
    camera's place: never reversed, forward in the middle of a panorama and at the top of a dome.
    """
    given = {name: value for name, value in options.items() if value is not None}
    check_camera_options(given)
    check_view_options(given)
    if output.resolve() == image.resolve():
        raise click.UsageError(f"{output} is the picture to straighten; write to another name")
    can_be_transparent = format_of(output).has_alpha
    if transparent and not can_be_transparent:
        raise click.UsageError(f"{output.suffix} files hold no transparency; write .png, .tif or .webp, or say --black")
    picture = read_image(image)
    camera = camera_of(given, (picture.shape[1], picture.shape[0]))
    dewarp = Dewarper(camera, view_of(camera, given), interpolation, given.get("viewpoint", "exact"))
    straight = dewarp(picture, can_be_transparent if transparent is None else transparent)
    write_image(output, straight)
    height, width = straight.shape[:2]
    click.echo(f"{output}: {dewarp.view}, {width} x {height} px, {_percent(dewarp)} of it inside the field")


def _percent(dewarp: Dewarper) -> str:
    share = 100 * dewarp.valid.mean()
    return "all" if share == 100 else f"{share:.3g} %"
