"""Lazy import of PyTorch: the package is imported when one of its names is first used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ...base.errors import OmnimirrorError, extra_remedy


class _LazyTorch:
    """Proxy of the module ``torch`` that caches each name."""

    def __getattr__(self, name: str) -> Any:
        try:
            value = getattr(import_module("torch"), name)
        except ImportError:
            raise OmnimirrorError(f"om.torch requires PyTorch: {extra_remedy('torch')}") from None
        self.__dict__[name] = value
        return value


torch: Any = _LazyTorch()
Tensor = Any
"""A torch.Tensor, or a float for constants."""
