"""The mirror sensor as a model to be calibrated: its image of points with all derivatives, as it physically is."""

from .ball import mirror_ball_model
from .sensor_model import SensorModel
from .tolerances import ParameterPrior

__all__ = ["ParameterPrior", "SensorModel", "mirror_ball_model"]
