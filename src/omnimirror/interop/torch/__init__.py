"""Differentiable cameras for PyTorch: projection, back-projection and image sampling on tensors."""

from ._camera import TorchCamera, TorchProjection, TorchRays
from ._factory import differentiable

__all__ = ["TorchCamera", "TorchProjection", "TorchRays", "differentiable"]
