"""What every mirror must satisfy, for the tests of whoever makes one: ours and those of other packages alike."""

from .mirrors import MIRROR_CHECKS, check_mirror

__all__ = ["MIRROR_CHECKS", "check_mirror"]
