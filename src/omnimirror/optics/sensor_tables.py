"""Pydantic models of the tables of sensor and camera files that do not describe a part."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, create_model

from ..base.table_models import Table, table_model
from ..cameras.camera import FULL_TURN_DEG, MAX_PITCH_DEG, MAX_ROLL_DEG, CameraLooks
from .mirrors import Mirror, Secondary
from .sensor import MAX_MIRROR_DISTANCE_MM


class MountTable(Table):
    """Orientation of a sensor: optical axis, pitch and roll."""

    camera_looks: CameraLooks = "up"
    forward_azimuth_deg: Annotated[float, Field(ge=-FULL_TURN_DEG, le=FULL_TURN_DEG)] = -90.0
    image_flipped: bool = False
    pitch_deg: Annotated[
        float,
        Field(
            ge=-MAX_PITCH_DEG, le=MAX_PITCH_DEG, description="elevation of the forward direction"
        ),
    ] = 0.0
    roll_deg: Annotated[
        float,
        Field(
            ge=-MAX_ROLL_DEG,
            le=MAX_ROLL_DEG,
            description="clockwise rotation about the forward direction",
        ),
    ] = 0.0


class SensorMountTable(MountTable):
    mirror_distance_mm: Annotated[float, Field(gt=0, le=MAX_MIRROR_DISTANCE_MM)] | None = None


class UncertaintyTable(Table):
    """Covariance of the parameters of a sensor or camera, by rows."""

    names: list[str]
    covariance: list[list[float]]
    field_deg: float | None = None
    marginal_sigmas: list[float] | None = None


def secondary_model(cls: type[Mirror]) -> type[Table]:
    """Create the pydantic model of the table [secondary] of a kind of mirror."""
    return create_model("secondary", __base__=(table_model(cls), table_model(Secondary)))
