"""Sensors as differentiable operations of PyTorch: project, backproject and sample."""

from .cameras import TorchCamera, TorchProjection, TorchRays
from .differentiable_camera import differentiable

__all__ = ["TorchCamera", "TorchProjection", "TorchRays", "differentiable"]
