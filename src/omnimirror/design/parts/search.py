"""The search among combinations of parts: bounds first, then designs, the cheapest first.

What a bound cuts (:mod:`.combinations`) is never designed. The others are, in the order of their prices: until so many
were found that keep everything; or, for the front of price against blur, all of them, of which those stay that are
sharper than every cheaper one.
"""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing import active_children, get_context
from typing import Any

import numpy as np

from ...base.arguments import checked, instance, whole
from ...base.errors import InvalidParameter
from ...base.files import json_plain
from ..catalogue.catalogue import Catalogue, read_catalogue
from ..criteria.requirements import Requirements
from .bought import BLURRED, BoughtDesign, check_free, design_bought
from .combinations import PartsCombination, combinations_of, cut

BLOCK = 32  # combinations that a process designs at a time
FEW = 64  # so few are designed without other processes


@dataclass(frozen=True)
class PartsSearch:
    """What :func:`omnimirror.design_from_parts` answers.

    Attributes
    ----------
    found
        The designs that keep everything, the cheapest first; of a front those sharper than every cheaper one.
    nearest
        Where there is none: the design that misses least, if any could be made.
    combinations
        How many there are.
    cut
        How many of them were cut before any mirror was made, by what they cannot keep.
    missed
        How many were designed and miss something, by the first thing that they miss.
    left
        How many, all of them dearer, were not looked at.
    """

    requirements: Requirements
    found: tuple[BoughtDesign, ...]
    nearest: BoughtDesign | None
    combinations: int
    cut: dict[str, int]
    missed: dict[str, int]
    left: int

    @property
    def is_met(self) -> bool:
        """Whether any combination keeps everything."""
        return bool(self.found)

    def to_dict(self) -> dict[str, Any]:
        """As plain data, for JSON."""
        counts = {"combinations": self.combinations, "cut": self.cut, "missed": self.missed, "left": self.left}
        nearest = None if self.nearest is None else self.nearest.to_dict()
        data: dict[str, Any] = json_plain(
            {"found": [design.to_dict() for design in self.found], "nearest": nearest, **counts}
        )
        return data


@checked
def design_from_parts(
    requirements: Requirements,
    catalogue: Catalogue | None = None,
    *,
    most: int = 10,
    front: bool = False,
    processes: int = 1,
    on_step: Callable[[str], None] | None = None,
) -> PartsSearch:
    """Design a mirror for each combination of a catalogue's parts that may keep the requirements.

    Each lens with each imager, and where the requirements ask for them each mirror ball and each dome, gets its own
    mirror, distance, aperture and focus; what is given of the lens (focal length, F-number, focus) bounds which
    lenses are taken.

    Parameters
    ----------
    requirements
        With ``parts``.
    catalogue
        From :func:`omnimirror.read_catalogue`; by default that of the requirements.
    most
        After how many that keep everything to stop; the cheapest come first.
    front
        Instead: all that are sharper than every cheaper one, by worst floored blur area.
    processes
        That design at the same time.
    on_step
        Called with a few words as the search goes on.

    Returns
    -------
    PartsSearch
        The designs, and how many combinations were cut by what.

    Raises
    ------
    InvalidParameter
        Requirements without parts, a count below 1, or no ball or dome in the catalogue where one is asked for.

    Examples
    --------
    >>> import omnimirror as om
    >>> asked = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=120),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=30),
    ...     lens=om.LensRequirements(f_number=(1, 16)),
    ...     limits=[om.Limit("total_blur_deg", at_most=0.6)],
    ...     parts=om.PartsRequirements(most_price=150),
    ... )
    >>> search = om.design_from_parts(asked, most=2)
    >>> [round(design.price) for design in search.found] == sorted(round(design.price) for design in search.found)
    True
    """
    instance("requirements", requirements, Requirements, "requirements")
    if requirements.parts is None:
        raise InvalidParameter("the requirements say nothing of parts; give parts, or design_sensor designs without")
    whole("most", most, 1)
    whole("processes", processes, 1)
    check_free(requirements)
    catalogue = read_catalogue(*requirements.parts.catalogue) if catalogue is None else catalogue
    for name, asked, there in (
        ("ball", requirements.parts.mirror == "ball", catalogue.balls),
        ("dome", requirements.parts.dome, catalogue.domes),
    ):
        if asked and not there:
            raise InvalidParameter(f"there is no {name} in the catalogue, and parts asks for one")
    everything = combinations_of(catalogue, requirements)
    reasons = [cut(requirements, combination) for combination in everything]
    tally = _Tally(requirements, front, most, len(everything), Counter(r for r in reasons if r is not None))
    left = [c for c, reason in zip(everything, reasons, strict=True) if reason is None]
    say = on_step or (lambda words: None)
    for i, answer in enumerate(_designed(requirements, left, processes, tally)):
        tally.take(answer)
        say(f"{i + 1} of {len(left)} combinations, {len(tally.found)} keep everything")
        if tally.is_full:
            break
    return tally.result()


def _designed(
    requirements: Requirements, combinations: list[PartsCombination], processes: int, tally: _Tally
) -> Iterator[BoughtDesign | str]:
    """What becomes of each, in their order."""
    if processes == 1 or len(combinations) <= FEW:
        for combination in combinations:
            yield design_bought(requirements, combination, tally.most_area_deg2)
        return
    others = set(active_children())
    with _spared_signals():  # its queues start the process that tracks their semaphores
        executor = ProcessPoolExecutor(processes, get_context("spawn"))
    with executor as pool:
        blocks = iter([combinations[i : i + BLOCK] for i in range(0, len(combinations), BLOCK)])

        def submit(count: int) -> list[Future[list[BoughtDesign | str]]]:
            with _spared_signals():
                most = tally.most_area_deg2
                return [pool.submit(_block, requirements, block, most) for block in islice(blocks, count)]

        under_way: list[Future[list[BoughtDesign | str]]] = []
        try:
            under_way += submit(processes + 1)
            while under_way:
                answers = under_way.pop(0).result()
                under_way += submit(1)
                yield from answers
        except BaseException:  # a signal, an error or enough designs: nobody waits for the other blocks
            for worker in set(active_children()) - others:
                worker.terminate()
            raise


@contextmanager
def _spared_signals() -> Iterator[None]:
    """Block Ctrl-C and SIGHUP, which a terminal sends to all processes, in those that are started in the block.

    This process, which receives them at the end of the block, ends the others.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _block(
    requirements: Requirements, combinations: list[PartsCombination], most_area_deg2: float
) -> list[BoughtDesign | str]:
    return [design_bought(requirements, combination, most_area_deg2) for combination in combinations]


@dataclass
class _Tally:
    """What was found so far."""

    requirements: Requirements
    front: bool
    most: int
    combinations: int
    cut: Counter[str]
    found: list[BoughtDesign] = field(default_factory=list)
    nearest: BoughtDesign | None = None
    missed: Counter[str] = field(default_factory=Counter)
    taken: int = 0

    def take(self, answer: BoughtDesign | str) -> None:
        """Count what became of the next combination."""
        self.taken += 1
        if isinstance(answer, str):
            self.missed[answer] += 1
        elif not answer.is_met:
            self.missed[answer.design.verdict.missed[0]] += 1
            if self.nearest is None or answer.design.verdict.worst < self.nearest.design.verdict.worst:
                self.nearest = answer
        elif answer.worst_floored_area_deg2 < self.most_area_deg2:
            self.found.append(answer)
        else:
            self.missed[BLURRED] += 1

    @property
    def most_area_deg2(self) -> float:
        """Of a front the blur area that the next, being dearer, has to stay below."""
        areas = [design.worst_floored_area_deg2 for design in self.found] if self.front else []
        return min(areas, default=np.inf)

    @property
    def is_full(self) -> bool:
        return not self.front and len(self.found) >= self.most

    def result(self) -> PartsSearch:
        left = self.combinations - self.cut.total() - self.taken
        nearest = None if self.found else self.nearest
        return PartsSearch(
            self.requirements, tuple(self.found), nearest, self.combinations, dict(self.cut), dict(self.missed), left
        )
