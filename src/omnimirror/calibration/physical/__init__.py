"""Exact mirror sensor model for calibration, with analytic derivatives of its projection."""

from .ball import mirror_ball_model
from .sensor_model import SensorModel
from .tolerances import ParameterPrior

__all__ = ["ParameterPrior", "SensorModel", "mirror_ball_model"]
