"""Pictures in and out."""

from .images import read_image, write_image

__all__ = ["read_image", "write_image"]
