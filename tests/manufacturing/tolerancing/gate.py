"""Worker plug-in that pauses in a shard with a closed gate and writes the process id.

``shut-3`` in the folder of the environment variable SWEEP_GATES closes the gate of shard 3; ``at-3``
then identifies the process. Without the variable, for example in doctests, there are no gates.
"""

import os
import time
from pathlib import Path

from omnimirror.manufacturing.tolerancing.sweep import Shard


def merits(shard):
    gates = Path(os.environ["SWEEP_GATES"])
    for rows in shard.ungated():
        yield rows
        if (gates / f"shut-{shard.number}").exists():
            (gates / f"at-{shard.number}.new").write_text(str(os.getpid()))
            (gates / f"at-{shard.number}.new").rename(gates / f"at-{shard.number}")
        while (gates / f"shut-{shard.number}").exists():
            time.sleep(0.02)


if "SWEEP_GATES" in os.environ and not hasattr(
    Shard, "ungated"
):  # workers load this more than once
    Shard.ungated, Shard.merits = Shard.merits, merits
