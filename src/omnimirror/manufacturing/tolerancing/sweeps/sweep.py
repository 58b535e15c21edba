"""A sweep: shards that are missing are made, all are read, whatever happened before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ....arguments import check_fields
from ....errors import InvalidParameter, OmnimirrorError
from ..tolerances import BLOCK
from ..yields import Progress, Tally, check_limits, check_trials
from .plans import SweepPlan, claim, write_manifest
from .pools import pool_of
from .shards import CorruptShard, Shard

SHARD_TRIALS = 64 * BLOCK
"""Trials of a shard, unless said: 5 to 10 s of one core, 50 MB."""
ROUNDS = 3  # in which shards that turn out corrupt are made again
WHOLE = (1, 1)


@dataclass(frozen=True)
class Sweep:
    """Where the trials of a sweep are kept, and who makes them.

    Parameters
    ----------
    folder
        Of the shards and their manifest. What an earlier run left there, and other parts, is gone on with.
    part
        (i, n): make the i-th of n parts only, counted from 1, as jobs of an array do; all by default.
    scheduler
        Address of a Dask scheduler whose workers make the shards, into the same folder; threads of this process by
        default.
    shard_trials
        Trials of each shard.

    Raises
    ------
    InvalidParameter
        A part that is none, or shards that are no whole blocks.

    Examples
    --------
    >>> Sweep(Path("trials"), part=(2, 8)).part
    (2, 8)
    """

    folder: Path
    part: tuple[int, int] = WHOLE
    scheduler: str | None = None
    shard_trials: int = SHARD_TRIALS

    def __post_init__(self) -> None:
        check_fields(self)
        i, n = self.part
        if not 1 <= i <= n:
            raise InvalidParameter(f"part {i}/{n} is not valid; valid are 1/{max(n, 1)} to {max(n, 1)}/{max(n, 1)}")
        if self.shard_trials < 1 or self.shard_trials % BLOCK:
            raise InvalidParameter(
                f"shards of {self.shard_trials} trials are not valid; valid are multiples of {BLOCK}, which are drawn "
                "at a time"
            )

    @property
    def is_whole(self) -> bool:
        """Whether this is all of it."""
        return self.part == WHOLE


def run_sweep(
    sweep: Sweep,
    plan: SweepPlan,
    limits: Mapping[str, float],
    *,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> Tally:
    """Make the shards that are missing, and count the trials of all.

    Parameters
    ----------
    sweep
        Where, and who makes them.
    plan
        What is asked; its shards are as large as the sweep's.
    limits
        What a good sensor stays within, by names of merits. Trials are judged by them as shards are read: the same
        shards tell the yield of other limits.
    progress
        Called with the trials that are done and all of them, of the part.
    say
        Called with a sentence for each shard that is corrupt.

    Returns
    -------
    Tally
        Of the trials of the part.

    Raises
    ------
    OmnimirrorError
        The folder belongs to another sweep or cannot be written, or shards do not last; what is done is kept.
    """
    check_limits(limits)
    check_trials(plan.trials)
    i, n = sweep.part
    shards = [Shard(plan, sweep.folder, number) for number in range(i - 1, plan.shards, n)]
    if not shards:
        raise InvalidParameter(
            f"part {i}/{n} has no trials: there are {plan.shards} shards; valid are up to as many parts"
        )
    claim(sweep.folder, plan)
    for _ in range(ROUNDS):
        _make_missing(shards, sweep.scheduler, progress, say)
        tally, checksums = Tally(dict(limits), plan.merits), dict[str, str]()
        for shard in shards:
            try:
                for rows in shard.rows():
                    tally.add(rows.astype(float))
                checksums[shard.path.name] = str(shard.checksum())
            except CorruptShard as e:
                _discard(shard, e, say)
        if len(checksums) < len(shards):
            continue
        if sweep.is_whole:
            write_manifest(sweep.folder, plan, checksums)
        return tally
    raise OmnimirrorError(f"shards in {sweep.folder} are corrupt again and again; its disk is not to be trusted")


def _make_missing(
    shards: list[Shard], scheduler: str | None, progress: Progress | None, say: Callable[[str], None] | None
) -> None:
    missing = []
    for shard in shards:
        try:
            if shard.checksum() is None:
                missing.append(shard)
        except CorruptShard as e:
            _discard(shard, e, say)
            missing.append(shard)
    trials = sum(shard.count for shard in shards)
    done = trials - sum(shard.count for shard in missing)
    if progress:
        progress(done, trials)
    if not missing:
        return
    with pool_of(scheduler) as pool:
        for shard in pool.made(missing):
            done += shard.count
            if progress:
                progress(done, trials)


def _discard(shard: Shard, why: CorruptShard, say: Callable[[str], None] | None) -> None:
    if say:
        say(f"{why}; it is made again")
    try:
        shard.path.unlink(missing_ok=True)
    except OSError as e:
        raise OmnimirrorError(f"cannot remove {shard.path}: {e.strerror}") from None
