"""Sweeps of any number of trials, kept in shards: by threads or by a cluster, stopped and gone on with."""

from .sweep import SHARD_TRIALS, WHOLE, Sweep, run_sweep

__all__ = ["SHARD_TRIALS", "WHOLE", "Sweep", "run_sweep"]
