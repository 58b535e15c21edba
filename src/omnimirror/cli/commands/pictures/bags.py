"""The part of ``omnimirror dewarp`` that straightens recordings of robots."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import click

from ....straighten import Straightening
from ...options.declared import Options, flag, option
from ...options.view import ViewOptions
from ...outputs import frame_bar, notice, say


@dataclass(frozen=True)
class BagOptions(Options):
    """What is asked of recordings alone."""

    topic: str | None = option(metavar="TOPIC", help="Recordings: whose pictures.  [default: the only one's]")
    views: Path | None = option(
        type=click.Path(path_type=Path), help="Recordings: a TOML file of several views, each with its name."
    )
    keep_topics: tuple[str, ...] | None = option(
        "--keep-topic", multiple=True, metavar="PATTERN",
        help="Recordings: pass another topic through, or all that fit, such as '/odom*'; '*' for all.",
    )  # fmt: skip
    frame: str | None = option(
        metavar="NAME",
        help="Recordings: the robot's frame that is the mirror's, x forward, y left, z up.  "
        "[default: a new one, below that of the pictures]",
    )

    def refuse(self, source: str) -> None:
        """Refuse them of what is no recording."""
        if asked := self.changed:
            name = "keep_topic" if asked[0] == "keep_topics" else asked[0]
            raise click.UsageError(f"{flag(name)} belongs to recordings of robots, and {source} is none")


def dewarp_recording(
    sources: tuple[str, ...], outputs: tuple[str, ...], how: Straightening, view: ViewOptions, bag: BagOptions
) -> None:
    """Straighten a recording under a progress bar, and say what became of it."""
    from ....interop.bags.dewarping import Chosen, straighten_bag
    from ....interop.named_views import load_views

    if len(sources) > 1 or len(outputs) != 1:
        raise click.UsageError("recordings are straightened one by one, each into one other")
    if bag.views is not None and view.given:
        raise click.UsageError(f"{flag(next(iter(view.given)))} is for one view, and --views says what is seen")
    views = {view.preset or view.view or "panorama": how.view} if bag.views is None else load_views(bag.views)
    chosen = Chosen(views, bag.topic, bag.keep_topics or (), bag.frame)
    with frame_bar() as progress:
        done = straighten_bag(Path(sources[0]), Path(outputs[0]), how, chosen, progress)
    for note in done.notes:
        notice(note)
    passed = f", {done.passed} other messages" if done.passed else ""
    say(f"{outputs[0]}: {done.pictures} pictures of {done.topic}{passed}")
    for topic in done.topics:
        say(f"  {topic}")
    if done.exit_code:
        notice(f"stopped; {outputs[0]} holds what was done")
        sys.exit(done.exit_code)
