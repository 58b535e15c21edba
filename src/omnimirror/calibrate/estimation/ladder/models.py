"""Kinds of models that can be estimated, simple ones first, and where each begins."""

from __future__ import annotations

from collections.abc import Callable

from ....arguments import shown
from ....camera_models.base import CameraModel
from ....camera_models.spheres import Unified
from ....errors import InvalidParameter

KINDS: dict[str, Callable[[Unified], CameraModel]] = {
    "unified": lambda u: u,
}
"""A model of each kind that resembles a unified one, from which it is fitted to it."""
JUDGES = ("unified",)
"""The most flexible kinds, by which outliers are told: each begins where the one before it ended."""


def begun_as(kind: str, unified: Unified) -> CameraModel:
    """A model of a kind, to begin with."""
    if kind not in KINDS:
        raise InvalidParameter(f"model = {shown(kind)} is not known; valid are auto, {', '.join(KINDS)}, and a sensor")
    return KINDS[kind](unified)
