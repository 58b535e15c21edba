"""Exclude scripts that run in other interpreters."""

collect_ignore_glob = ["*/in_*.py"]
