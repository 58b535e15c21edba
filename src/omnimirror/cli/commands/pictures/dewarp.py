"""``omnimirror dewarp``: straighten pictures, folders of them, and videos."""

from __future__ import annotations

import math
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

import click
import numpy as np

from ....cameras import Camera
from ....dewarp import Dewarper
from ....dewarp.sampling.remap import Border
from ....dewarp.screens import Cylinder, Sphere, View
from ....errors import OmnimirrorError
from ....files import is_same_file, name_of
from ....frames import Mount
from ....media import GPano, read_image, write_image
from ....media.batch import PICTURES as PICTURE_SUFFIXES
from ....media.batch import Job, expand_inputs, outputs_for, run_parallel
from ....media.pictures.images import Image, can_be_panorama, check_size, format_of, read_picture
from ....media.video.sequences import is_sequence
from ....native import backend
from ....sensor import Sensor
from ....simulate.restoration.noise import told_noise
from ....simulate.restoration.round_blur import load_blur
from ....simulate.restoration.sharpening import Restorer
from ...depths import as_held
from ...options.camera import MountedCamera, camera_of, camera_options, camera_words, check_camera_options, drawn_by
from ...options.common import NUMBER, WHOLE, distance, flag
from ...options.sampling import BorderColour, sampling_options
from ...options.view import check_view_options, view_of, view_options
from ...outputs import PICTURES, output_console, say, take_standard_output

VIDEOS = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".ts", ".mpg", ".mpeg")
RESTORE_OPTIONS = ("noise", "object_distance_mm", "blur_px")
PICTURE_OPTIONS = ("restore", *RESTORE_OPTIONS)
VIDEO_OPTIONS = ("frame_rate", "start_s", "duration_s", "codec", "crf", "keyframes", "pixel_format", "preview")
PIPE_FORMATS = ("y4m", "rawvideo")


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    help="What to write: a picture, or a folder for many; of a video also an address (udp://.., rtsp://..), a virtual "
    "camera (/dev/video9) or - for a pipe, and several of them.",
)
@camera_options
@view_options
@sampling_options
@click.option(
    "--skip-existing",
    is_flag=True,
    default=None,
    help="Leave out what has been written already: a folder that was stopped goes on.",
)
@click.option(
    "--transparent/--black",
    default=None,
    help="Pictures, outside the field.  [default: transparent where the file can: PNG, TIFF, WebP]",
)
@click.option(
    "--restore",
    is_flag=True,
    default=None,
    help="Pictures: first sharpen what --sensor is known to blur, or what --blur-px tells.",
)
@click.option("--noise", type=NUMBER, metavar="SHARE", help="With --restore, of full scale.  [default: estimated]")
@click.option(
    "--object-distance-mm",
    type=distance,
    metavar="MM",
    help="With --restore, from the mirror to what is seen.  [default: inf]",
)
@click.option(
    "--blur-px",
    metavar="PX|T,S|FILE",
    help="With --restore, of any camera: blur diameter, tangential and sagittal ones, or a CSV file of radius_px or "
    "omega_deg, t_px and s_px.  [default: the sensor's]",
)
@click.option("--start", "--start-s", "start_s", type=NUMBER, help="Videos: where to begin, in seconds.  [default: 0]")
@click.option(
    "--duration",
    "--duration-s",
    "duration_s",
    type=NUMBER,
    help="Videos: how much to take, in seconds.  [default: the rest]",
)
@click.option("--frame-rate", type=NUMBER, help="Numbered pictures: frames a second.  [default: 25]")
@click.option("--codec", help="Videos: the encoder, by FFmpeg's name.  [default: by the file's suffix]")
@click.option("--crf", type=WHOLE, help="Videos: constant quality, smaller is better.  [default: the encoder's]")
@click.option(
    "--keyframes",
    type=click.Path(path_type=Path),
    help="Videos: pan, tilt, roll, field and distance over time, a CSV or TOML file.",
)
@click.option("--preview", is_flag=True, default=None, help="Videos: show the view in a window; Escape ends it.")
@click.option(
    "--format",
    type=click.Choice([*PIPE_FORMATS, *PICTURES]),
    metavar="NAME",
    help=f"What '-o -' writes to the pipe: {', '.join(PIPE_FORMATS)} or, of a picture, {', '.join(PICTURES)}.  "
    "[default: y4m, png]",
)
@click.option(
    "--viewer",
    type=click.Path(dir_okay=False, path_type=Path),
    help="One picture or video: write an HTML file in which to look around, with everything inside it.",
)
@click.option(
    "--pixel-format",
    help="Videos: what is encoded, by FFmpeg's name.  [default: the source's, as far as the codec can; raw: rgb24]",
)
def command(
    sources: tuple[str, ...],
    outputs: tuple[str, ...],
    interpolation: Any,
    transparent: bool | None,
    viewer: Path | None,
    **options: Any,
) -> None:
    """Straighten each SOURCE, taken with a mirror sensor, a mirror ball or a fisheye.

    A SOURCE is a picture, a folder or pattern of pictures, a video file, or a camera or stream
    (/dev/video0, rtsp://..), numbered pictures as one video (f%04d.png), or a video on standard
    input (-). Say which camera it was with one of --sensor, --ocam and --ball. The
    result is drawn as seen from the camera's place: never reversed, forward in the middle of a
    panorama and at the top of a dome.
    """
    given = {name: value for name, value in options.items() if value is not None}
    check_camera_options(given)
    check_view_options(given)
    if "restore" not in given and (asked := [name for name in RESTORE_OPTIONS if name in given]):
        raise click.UsageError(f"{flag(asked[0])} belongs to --restore")
    if "threads" in given:
        backend.set_threads(given["threads"])
    if viewer is not None:
        write_viewer(sources, viewer, given)
        if not outputs:
            return
    if not outputs and "preview" not in given:
        raise click.UsageError("say what to write with -o or --viewer, or of a video ask for a --preview")
    if "skip_existing" in given and outputs and all(Path(output).is_file() for output in outputs):
        click.echo(f"{', '.join(outputs)}: there already", err=True)
        return
    if len(sources) == 1 and is_video(sources[0]):
        if transparent is not None:
            raise click.UsageError("--transparent and --black belong to pictures; videos have a --border")
        if asked := [name for name in PICTURE_OPTIONS if name in given]:
            raise click.UsageError(
                f"{flag(asked[0])} belongs to pictures, since it takes seconds for each, and {sources[0]} is a video; "
                "a folder of its frames can be restored"
            )
        _video(sources[0], outputs, given, interpolation)
        return
    if transparent is not None and "border" in given:
        raise click.UsageError("--border is the colour outside the field; leave out --transparent and --black")
    if asked := [name for name in VIDEO_OPTIONS if name in given]:
        raise click.UsageError(f"--{asked[0].replace('_', '-')} belongs to videos, and {sources[0]} is none")
    if len(outputs) > 1:
        raise click.UsageError(f"{outputs[1]} is one output too many: several belong to videos")
    output = outputs[0]
    if len(sources) > 1 or Path(output).is_dir() or output.endswith("/") or not _is_one_picture(sources[0]):
        _many(sources, Path(output), given, interpolation, transparent)
    else:
        name = _named(output, given.get("format"))
        say(Straightener(given, interpolation, transparent).straighten(Path(sources[0]), name))


def _named(output: str, kind: str | None) -> Path:
    """The file of one picture; ``-`` gets the suffix of its format."""
    if kind in PIPE_FORMATS:
        raise click.UsageError(f"--format {kind} belongs to videos; of a picture valid are {', '.join(PICTURES)}")
    if output != "-":
        if kind is not None:
            raise click.UsageError("--format says what '-' writes; files are written as their suffix says")
        return Path(output)
    return take_standard_output("--output", kind or PICTURES[0])


def is_video(source: str) -> bool:
    """Whether a source is a video file, a camera or a stream, going by its name.

    >>> [is_video(s) for s in ("room.MP4", "0", "/dev/video2", "rtsp://door/1", "room.png", "*.jpg")]
    [True, True, True, True, False, False]
    """
    is_live = source.isdigit() or source.startswith("/dev/video") or "://" in source
    return is_live or source == "-" or is_sequence(source) or Path(source).suffix.lower() in VIDEOS


def panorama_of(view: View, kept: Mount | None = None) -> GPano | None:
    """What viewers of panoramas must know of a view; None for a view that is no distant panorama linear in tilt.

    ``kept`` is how the sensor leans where the view leans with it.
    """
    if not isinstance(view, Cylinder | Sphere) or not view.is_distant or getattr(view, "rows", "tilt") != "tilt":
        return None
    lean = (0.0, 0.0) if kept is None else kept.lean_of_view(view.pan_deg)
    return GPano.of_view(view.size, (view.tilt_min_deg, view.tilt_max_deg), view.span_deg, lean_deg=lean)


class Straightener:
    """Straightens pictures as the options say; pictures of one size share their map."""

    def __init__(self, given: dict[str, Any], interpolation: Any, transparent: bool | None) -> None:
        self.given, self.interpolation = given, interpolation
        self.border: BorderColour | None = given.get("border")
        self.transparent = False if self.border else transparent
        self.straightening = cache(self._straightening)
        self.restorer = cache(self._restorer)
        self.alone = Lock()  # it needs a lot of memory
        self.left_out: Counter[str] = Counter()
        """What pictures carried that their files cannot hold, and of how many."""

    def _straightening(self, size: tuple[int, int], border: Border) -> tuple[Dewarper, GPano | None]:
        """What straightens pictures of a size, and what its panoramas say of themselves."""
        given = self.given
        stands = camera_of(given, size)
        camera = drawn_by(stands, given)
        view = view_of(camera, given)
        dewarp = Dewarper(camera, view, self.interpolation, given.get("viewpoint", "exact"), border)
        return dewarp, panorama_of(view, stands.mount if "keep_lean" in given else None)

    def _restorer(self, camera: MountedCamera) -> Restorer:
        return restorer_of(camera, self.given)

    def _restored(self, picture: Image, source: Path, camera: Camera) -> tuple[Image, str]:
        """The picture without its blur, and what was found."""
        restorer = self.restorer(camera)  # type: ignore[arg-type]
        told = self.given.get("noise")
        noise = restorer.estimate_noise(picture, source) if told is None else told_noise(told, picture.shape)
        share = restorer.shown_share(picture, noise)
        found = f"; restored at a noise of {100 * noise.share:.2g} % ({noise.kind})"
        if share < 1:
            found += f", and {100 * share:.0f} % of the blur, since the picture shows no more"
        return restorer(picture, noise, share), found

    def straighten(self, source: Path, output: Path) -> str:
        """Read, straighten and write one picture; what was done, in a sentence."""
        if is_same_file(output, source):
            raise OmnimirrorError(f"{output} is the picture to straighten; write to another name")
        kind = format_of(output)
        if self.transparent and not kind.has_alpha:
            raise OmnimirrorError(
                f"{output.suffix} files hold no transparency; write .png, .tif or .webp, or say --black"
            )
        picture, carried = read_picture(source)
        border = self.border.of_picture(picture) if self.border else 0
        dewarp, panorama = self.straightening((picture.shape[1], picture.shape[0]), border)
        check_size(output, dewarp.view.size)
        restored = ""
        if "restore" in self.given:
            with self.alone:
                picture, restored = self._restored(picture, source, dewarp.camera)
        straight = dewarp(picture, kind.has_alpha if self.transparent is None else self.transparent)
        held = as_held(straight, kind)
        recoded = held.dtype != straight.dtype and np.float32 in (held.dtype, straight.dtype)
        kept, left_out = carried.that_fits(output, held, recoded)
        write_image(output, held, panorama if can_be_panorama(output) else None, kept)
        height, width = straight.shape[:2]
        told = _change_of_depth(straight.dtype.name, held.dtype.name)
        if left_out:
            told += f", {left_out}"
            self.left_out[left_out] += 1
        size = f"{width} x {height} px"
        return f"{name_of(output)}: {dewarp.view}, {size}, {_percent(dewarp)} of it inside the field{told}{restored}"


def _change_of_depth(had: str, has: str) -> str:
    """What was lost or found on the way into a file of another depth."""
    words = {"uint8": "8 bits", "uint16": "16 bits", "float32": "light"}
    return "" if had == has else f", {words[had]} written as {words[has]}"


def restorer_of(camera: MountedCamera, given: dict[str, Any]) -> Restorer:
    """What sharpens the pictures of a camera, as the options say."""
    told = given.get("blur_px")
    if told is None and not isinstance(camera, Sensor):
        raise OmnimirrorError("--restore needs to know the lens and the mirror: say --sensor, or --blur-px")
    if told is not None and "object_distance_mm" in given:
        raise click.UsageError("--blur-px tells the blur at any distance; leave out --object-distance-mm")
    return Restorer(camera, given.get("object_distance_mm", math.inf), None if told is None else _blur_of(told, camera))


def _blur_of(told: str, camera: MountedCamera) -> Any:
    """One or two numbers, or the table of a file."""
    try:
        numbers = [float(part) for part in told.split(",")]
    except ValueError:
        return load_blur(told, camera)
    if len(numbers) > 2:
        raise click.UsageError(f"--blur-px {told} has {len(numbers)} numbers; give one, T,S or a file")
    return numbers


def write_viewer(sources: tuple[str, ...], output: Path, given: dict[str, Any]) -> None:
    """Write the page in which to look around in one picture or video."""
    from ....files import write_text
    from ....studio import video_viewer_of, viewer_of

    is_film = is_video(sources[0]) and Path(sources[0]).is_file()
    if len(sources) > 1 or (is_video(sources[0]) and not is_film) or not _is_one_picture(sources[0]):
        raise click.UsageError("--viewer holds one picture, or one video file")
    if "restore" in given:
        raise click.UsageError("--viewer holds the picture as it is; leave out --restore")
    if output.suffix.lower() not in (".html", ".htm"):
        raise click.UsageError(f"--viewer writes an HTML file, such as {output.stem or 'view'}.html, and no {output}")
    name, words = camera_words(given)
    if is_film:
        camera = drawn_by(camera_of(given, _size_of_video(sources[0])), given)
        text = video_viewer_of(camera, name, words, Path(sources[0]), output)
    else:
        picture = read_image(sources[0])
        camera = drawn_by(camera_of(given, (picture.shape[1], picture.shape[0])), given)
        text = viewer_of(camera, name, words, Path(sources[0]), picture)
    write_text(output, text)
    click.echo(f"{output}: open it in a browser to look around in {sources[0]}")


def _size_of_video(source: str) -> tuple[int, int]:
    try:
        from ....media.video.reader import VideoReader
    except ModuleNotFoundError as e:
        if e.name != "av":
            raise
        raise _needs_pyav(source) from None
    return VideoReader(source, with_sound=False).size


def _needs_pyav(source: str) -> OmnimirrorError:
    return OmnimirrorError(f"{source} is a video, which needs PyAV: pip install 'omnimirror[video]'")


def _is_one_picture(source: str) -> bool:
    return not Path(source).is_dir() and (Path(source).exists() or not set("*?[") & set(source))


def _many(
    sources: tuple[str, ...], folder: Path, given: dict[str, Any], interpolation: Any, transparent: bool | None
) -> None:
    """Pictures into a folder, side by side; those that fail are named and the others done."""
    if folder.exists() and not folder.is_dir():
        raise click.UsageError(f"{folder} is a file, and several pictures need a folder")
    if not folder.is_dir() and folder.suffix.lower() in (*PICTURE_SUFFIXES, *VIDEOS):
        raise click.UsageError(f"{folder} is the name of one file, and several pictures need a folder")
    paths = expand_inputs(sources)
    straightener = Straightener(given, interpolation, transparent)
    found = list(zip(paths, outputs_for(paths, folder), strict=True))
    pairs = [(s, o) for s, o in found if not ("skip_existing" in given and o.exists())]
    was_there = f", {len(found) - len(pairs)} were there" if "skip_existing" in given else ""
    jobs = [Job(str(s), lambda s=s, o=o: straightener.straighten(s, o)) for s, o in pairs]  # type: ignore[misc]
    console = output_console()
    with console.status("Straightening") as status:
        results = run_parallel(
            jobs, given.get("threads"), lambda done, of: status.update(f"Straightening: {done} of {of}")
        )
    for name, sentence in results.failed.items():
        click.echo(f"omnimirror: {name}: {sentence}", err=True)
    click.echo(f"{folder}: {len(results.done)} of {len(jobs)} pictures straightened{was_there}")
    for why, count in straightener.left_out.items():
        click.echo(f"{folder}: {count} of them {why}")
    sys.exit(results.exit_code)


def _video(source: str, outputs: tuple[str, ...], given: dict[str, Any], interpolation: Any) -> None:
    try:
        from .dewarp_video import straighten_video
    except ModuleNotFoundError as e:
        if e.name != "av":
            raise
        raise _needs_pyav(source) from None
    straighten_video(source, outputs, given, interpolation)


def _percent(dewarp: Dewarper) -> str:
    share = 100 * dewarp.valid.mean()
    return "all" if share == 100 else f"{share:.3g} %"
