"""Search among combinations of parts: necessary conditions, then designs in order of price.

Combinations that violate a necessary condition (:mod:`.combinations`) are not designed. The others
are designed in order of price until the requested number of feasible designs is reached; or all of
them for the front of price and blur, which retains those sharper than every cheaper one.
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

BLOCK = 32  # combinations per task of a process
FEW = 64  # up to this number, no other processes are used


@dataclass(frozen=True)
class PartsSearch:
    """Result of :func:`omnimirror.design_from_parts`.

    Attributes
    ----------
    found
        Feasible designs, cheapest first; for a front those sharper than every cheaper one.
    nearest
        Without a feasible design: the one with the smallest violation, if a design exists.
    combinations
        Number of combinations.
    cut
        Number of combinations rejected before the mirror design, by reason.
    missed
        Number of infeasible designs, by the first missed requirement.
    left
        Number of combinations not evaluated, all of them more expensive.
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
        """Return whether a combination meets all requirements."""
        return bool(self.found)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data for JSON."""
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
    """Design a mirror for each combination of catalogue parts that may meet the requirements.

    Each combination of lens and imager and, if required, mirror ball and dome has its own mirror,
    distance, aperture and focus; lens entries of the requirements (focal length, F-number, focus)
    restrict the choice of lenses.

    Parameters
    ----------
    requirements
        Requirements with ``parts``.
    catalogue
        Catalogue from :func:`omnimirror.read_catalogue`; by default that of the requirements.
    most
        Stop after this number of feasible combinations; cheapest first.
    front
        Alternatively, return all designs sharper than every cheaper one, by worst floored blur
        area.
    processes
        Number of parallel processes.
    on_step
        Callback for progress messages.

    Returns
    -------
    PartsSearch
        Designs, and the number of rejected combinations by reason.

    Raises
    ------
    InvalidParameter
        Requirements without parts, a count below 1, or a required ball or dome missing in the
        catalogue.

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
    """Yield the results of the combinations in their order."""
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
        except BaseException:  # signal, error or sufficient designs: do not wait for the other blocks
            for worker in set(active_children()) - others:
                worker.terminate()
            raise


@contextmanager
def _spared_signals() -> Iterator[None]:
    """Block Ctrl-C and SIGHUP in processes started within the block.

    This process receives the signals at the end of the block and ends the others.
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
    """State of the search."""

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
        """Record the result of the next combination."""
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
        """Return, for a front, the upper limit of the blur area of the next design."""
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
