"""Dewarping of ROS bags by ``omnimirror dewarp``."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import click

from .....dewarp.pipelines import Straightening
from ...options.declared import Options, flag, option
from ...options.view import ViewOptions
from ...outputs import frame_bar, notice, say


@dataclass(frozen=True)
class BagOptions(Options):
    """Options for ROS bags."""

    topic: str | None = option(metavar="TOPIC", help="ROS bag: image topic.  [default: the only one]")
    views: Path | None = option(type=click.Path(path_type=Path), help="ROS bag: TOML file of several named views.")
    keep_topics: tuple[str, ...] | None = option(
        "--keep-topic", multiple=True, metavar="PATTERN",
        help="ROS bag: topics to copy unchanged, such as '/odom*' or '*' (repeatable).",
    )  # fmt: skip
    mirror_frame: str | None = option(
        metavar="NAME",
        help="ROS bag: existing TF frame of the mirror, x forward, y left, z up.  [default: a new frame]",
    )

    def refuse(self, source: str) -> None:
        """Raise UsageError if options for ROS bags are given for another source."""
        if changed := self.changed:
            name = "keep_topic" if changed[0] == "keep_topics" else changed[0]
            raise click.UsageError(f"{flag(name)} requires a ROS bag; got {source}")


def dewarp_recording(
    sources: tuple[str, ...], outputs: tuple[str, ...], how: Straightening, view: ViewOptions, bag: BagOptions
) -> None:
    """Dewarp a ROS bag with a progress bar and print the written topics."""
    from .....interop.named_views import load_views
    from .....interop.ros_bags.dewarping import BagSelection, run_bag_dewarping

    if len(sources) > 1 or len(outputs) != 1:
        raise click.UsageError("a ROS bag must be dewarped alone, into one output")
    if bag.views is not None and view.given:
        raise click.UsageError(f"{flag(next(iter(view.given)))} must not be given with --views")
    views = {view.preset or view.view or "panorama": how.view} if bag.views is None else load_views(bag.views)
    selection = BagSelection(views, bag.topic, bag.keep_topics or (), bag.mirror_frame)
    with frame_bar() as progress:
        result = run_bag_dewarping(Path(sources[0]), Path(outputs[0]), how, selection, progress)
    for note in result.notes:
        notice(note)
    copied = f", {result.copied} copied messages" if result.copied else ""
    say(f"{outputs[0]}: {result.images} images of {result.topic}{copied}")
    for topic in result.output_topics:
        say(f"  {topic}")
    if result.exit_code:
        notice(f"stopped; {outputs[0]} contains the messages dewarped so far")
        sys.exit(result.exit_code)
