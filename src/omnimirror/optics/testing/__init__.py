"""Contract checks for mirror classes, for the tests of this and other packages."""

from .mirrors import MIRROR_CHECKS, check_mirror

__all__ = ["MIRROR_CHECKS", "check_mirror"]
