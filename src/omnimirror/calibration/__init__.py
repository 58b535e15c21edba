"""A built sensor measured from its own pictures: rim, targets, estimation, files of other programs."""
