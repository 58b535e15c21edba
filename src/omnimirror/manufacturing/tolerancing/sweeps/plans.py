"""What is asked of a sweep, and the manifest that says so beside its shards."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....errors import OmnimirrorError
from ....files import json_plain, parse_json, read_text, write_text
from ....numerics.lazy import cached_property
from ....specs import tables_of
from ..tolerances import BLOCK, Tolerances
from ..trials.merits import LOST, merit_names
from ..trials.picture import Refocus

FORMAT = 1
MANIFEST = "_manifest.json"
"""Begins so that what reads folders of Parquet files passes it over."""


@dataclass(frozen=True)
class SweepPlan:
    """All that the merits of trials follow from, and how they are cut into shards.

    Attributes
    ----------
    tolerances
        Of a sensor.
    refocus, judged
        As :class:`omnimirror.TolerancePlan` has them.
    trials, seed
        How many sensors are built, from which random numbers.
    shard_trials
        How many of them a shard has: whole blocks.
    required
        Names of merits that are worked out because limits ask for them.
    """

    tolerances: Tolerances
    refocus: Refocus
    judged: Mapping[str, Any]
    trials: int
    seed: int
    shard_trials: int
    required: tuple[str, ...] = ()

    @property
    def shards(self) -> int:
        """How many there are."""
        return -(-self.trials // self.shard_trials)

    @property
    def merits(self) -> tuple[str, ...]:
        """Names of what each trial is judged by, in the order of columns."""
        return (*merit_names()[:-1], *self.required, LOST)

    @cached_property
    def asked(self) -> dict[str, Any]:
        """As the manifest says it."""
        errors = {name: [bound.value, bound.distribution] for name, bound in self.tolerances.errors.items()}
        said = {
            "format": FORMAT,
            "sensor": tables_of(self.tolerances.sensor),
            "errors": errors,
            "correlations": [[*pair, value] for pair, value in self.tolerances.correlations.items()],
            "forms": {name: [form.zernike, form.um] for name, form in self.tolerances.forms.items()},
            "refocus": self.refocus,
            "judged": dict(self.judged),
            "trials": self.trials,
            "seed": self.seed,
            "shard_trials": self.shard_trials,
            "block": BLOCK,
            "merits": self.merits,
        }
        return dict(json.loads(json.dumps(json_plain(said))))

    @cached_property
    def digest(self) -> str:
        """Of what is asked; each shard bears it."""
        return hashlib.blake2b(json.dumps(self.asked).encode(), digest_size=16).hexdigest()


def is_asked(folder: Path, plan: SweepPlan) -> bool:
    """Whether the manifest in a folder is that of a sweep."""
    path = folder / MANIFEST
    return path.exists() and _asked_in(path) == plan.asked


def claim(folder: Path, plan: SweepPlan) -> None:
    """Write the manifest of a sweep into its folder, unless it is there.

    Raises
    ------
    OmnimirrorError
        The folder belongs to another sweep, or cannot be written.
    """
    path = folder / MANIFEST
    if not path.exists():
        return write_manifest(folder, plan, {})
    found = _asked_in(path)
    if found != plan.asked:
        changed = ", ".join(name for name in plan.asked if found.get(name) != plan.asked[name])
        raise OmnimirrorError(f"{folder} holds trials of something else ({changed} differ); name another folder")


def write_manifest(folder: Path, plan: SweepPlan, checksums: Mapping[str, str]) -> None:
    """What was asked, and the checksums of all shards by the names of their files, once all are there."""
    write_text(folder / MANIFEST, json.dumps({"asked": plan.asked, "shards": dict(checksums)}, indent=1) + "\n")


def _asked_in(path: Path) -> dict[str, Any]:
    try:
        return dict(parse_json(read_text(path, "manifest"))["asked"])
    except (ValueError, KeyError, TypeError):
        raise OmnimirrorError(f"{path} is not a manifest that omnimirror wrote; name another folder") from None
