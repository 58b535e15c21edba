"""A shard: some blocks of trials in a Parquet file, which says itself whether it is whole.

A row is a trial: its number and its merits in single precision, which tallies count in as well. What was asked, and a
checksum of all columns, stand in the file's metadata; it appears under its name when it is complete. So whatever is
killed, a shard is there once and right, or not at all.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import OmnimirrorError
from ....files import check_file, parse_json, replacing
from ..tolerances import BLOCK
from ..trials.judge import Judge
from .plans import MANIFEST, SweepPlan, is_asked

Rows = NDArray[np.float32]
KEY = "omnimirror"
TRIAL = "trial"


class CorruptShard(OmnimirrorError):
    """A shard does not hold what was written."""


@dataclass(frozen=True)
class Shard:
    """One file of a sweep, and what belongs into it; a pure function of this makes it, on any machine.

    Attributes
    ----------
    plan
        What was asked.
    folder
        Of all shards.
    number
        Of this one, from 0.
    """

    plan: SweepPlan
    folder: Path
    number: int

    @property
    def path(self) -> Path:
        """Of its file."""
        return self.folder / f"shard-{self.number:05}.parquet"

    @property
    def first(self) -> int:
        """Number of its first trial."""
        return self.number * self.plan.shard_trials

    @property
    def count(self) -> int:
        """How many trials it has."""
        return min(self.plan.shard_trials, self.plan.trials - self.first)

    def merits(self) -> Iterator[Rows]:
        """Merits (t, m) of its trials, block by block."""
        judge = Judge.of(self.plan.tolerances.sensor, self.plan.refocus, self.plan.required, **self.plan.judged)
        for trial in range(self.first, self.first + self.count, BLOCK):
            count = min(BLOCK, self.first + self.count - trial)
            yield judge.judged(self.plan.tolerances.drawn(self.plan.seed, trial // BLOCK, count)).astype(np.float32)

    def make(self, goes_on: Callable[[], bool] = lambda: True) -> None:
        """Compute it and write its file.

        Raises
        ------
        OmnimirrorError
            The folder is not that of this sweep on this machine, or cannot be written.
        """
        if not is_asked(self.folder, self.plan):
            raise OmnimirrorError(
                f"{self.folder / MANIFEST} of this sweep is not there, or another, on a machine that works for it; "
                "give a folder that all machines share"
            )
        pa, pq = _parquet()
        types = [(TRIAL, pa.int64()), *((name, pa.float32()) for name in self.plan.merits)]
        digest, trial = _checksum(), self.first
        plain: Any = {"use_dictionary": False, "compression": "none", "write_statistics": False}
        with replacing(self.path) as temporary, pq.ParquetWriter(temporary, pa.schema(types), **plain) as writer:
            for rows in self.merits():
                if not goes_on():
                    raise KeyboardInterrupt
                numbers = np.arange(trial, trial + len(rows))
                digest.update(_bytes_of(numbers, rows))
                columns = [numbers, *np.ascontiguousarray(rows.T)]
                writer.write_table(pa.table(columns, schema=pa.schema(types)))
                trial += len(rows)
            writer.add_key_value_metadata({KEY: json.dumps(self._about | {"checksum": digest.hexdigest()})})

    def checksum(self) -> str | None:
        """Return the checksum of its rows that its file holds; None if there is no file.

        Raises
        ------
        CorruptShard
            The file cannot be read, or is not this one.
        """
        if not self.path.exists():
            return None
        pa, pq = _parquet()
        try:
            check_file(self.path, self._largest)
            about = parse_json(pq.read_metadata(self.path).metadata[KEY.encode()])
            checksum = str(about.pop("checksum"))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, pa.ArrowException):
            raise CorruptShard(f"{self.path} is corrupt") from None
        if about != self._about:
            raise CorruptShard(f"{self.path} is not the shard that its name says")
        return checksum

    def rows(self) -> Iterator[Rows]:
        """Merits (t, m) of its trials, block by block, from its file.

        Raises
        ------
        CorruptShard
            After the last block, or before: they are not what was written.
        """
        expected, digest, count = self.checksum(), _checksum(), 0
        pa, pq = _parquet()
        try:
            with pq.ParquetFile(self.path) as file:
                for batch in file.iter_batches(BLOCK, columns=[TRIAL, *self.plan.merits]):
                    numbers, *merits = (column.to_numpy() for column in batch.columns)
                    rows = np.stack(merits, axis=-1)
                    digest.update(_bytes_of(numbers, rows))
                    count += len(rows)
                    if count > self.count:
                        break
                    yield rows
        except (OSError, ValueError, pa.ArrowException):
            raise CorruptShard(f"{self.path} is corrupt") from None
        if digest.hexdigest() != expected or count != self.count:
            raise CorruptShard(f"{self.path} is corrupt: its rows are not those that were written")

    @property
    def _largest(self) -> int:
        """Bytes that its file may have: its rows are not compressed, and the rest describes each block of them."""
        return 2 * self.count * (8 + 4 * len(self.plan.merits)) + (1 << 20)

    @property
    def _about(self) -> dict[str, Any]:
        return {"asked": self.plan.digest, "shard": self.number, "trials": self.count}


def _bytes_of(numbers: NDArray[np.int64], rows: Rows) -> bytes:
    """Return what the checksum covers of some trials, row by row: numbers (t,) and merits (t, m).

    >>> len(_bytes_of(np.arange(3), np.zeros((3, 2), np.float32)))
    48
    """
    table = np.empty(len(rows), [("trial", "<i8"), ("merits", "<f4", rows.shape[1])])
    table["trial"], table["merits"] = numbers, rows
    return table.tobytes()


def _checksum() -> Any:
    return hashlib.blake2b(digest_size=16)


def _parquet() -> tuple[Any, Any]:
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise OmnimirrorError(
            "shards of trials need pyarrow, which is not installed: pip install 'omnimirror[design]'"
        ) from None
