"""PyTorch, imported when something of it is first asked for."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ...errors import OmnimirrorError


class _Library:
    """What stands before it: each name is looked up once."""

    def __getattr__(self, name: str) -> Any:
        try:
            found = getattr(import_module("torch"), name)
        except ImportError:
            raise OmnimirrorError(
                "differentiable cameras need PyTorch, which is not installed: pip install 'omnimirror[torch]'"
            ) from None
        self.__dict__[name] = found
        return found


torch: Any = _Library()
Tensor = Any
"""A torch.Tensor, or where a number does not change a float."""
