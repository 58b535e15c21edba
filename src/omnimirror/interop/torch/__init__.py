"""PyTorch: differentiable cameras, and dewarping of tensors on any device."""

from ._camera import TorchCamera, TorchProjection, TorchRays
from ._dewarper import TorchDewarper
from ._factory import differentiable

__all__ = ["TorchCamera", "TorchDewarper", "TorchProjection", "TorchRays", "differentiable"]
