"""What other programs' Pythons run is no test of ours."""

collect_ignore_glob = ["*/in_*.py"]
