"""Camera models of images flipped left to right."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from ...base.errors import InvalidParameter
from ...cameras.models import CameraModel

Model = TypeVar("Model", bound=CameraModel)

TURNED = {"cx", "skew", "shear", "d", "p2", "s1", "s2"}
"""Parameters that change sign under a horizontal flip, for the centre up to a constant."""
ODD = ("skew_px", "shear", "p2", "s1", "s2")  # fields that change sign


def flipped(camera: Model) -> Model:
    """Return the camera of the image flipped left to right: column u becomes width - 1 - u.

    Parameters
    ----------
    camera
        Camera with a centre, and a matrix of two focal lengths and skew or of OCamCalib's c, d and
        e.

    Returns
    -------
    CameraModel
        Camera of the same class, with the flip recorded in its mount.

    Raises
    ------
    InvalidParameter
        If the camera has no centre.

    Examples
    --------
    >>> from omnimirror.cameras.models import OCam
    >>> camera = OCam((-100.0, 0.0, 0.002), (300.0, 240.0), (640, 480))
    >>> flipped(camera).centre_px
    (339.0, 240.0)
    """
    found: Any = camera
    if not hasattr(found, "centre_px"):
        raise InvalidParameter(f"{camera.KIND} cannot be flipped, since it has no centre of the picture")
    (u, v), width = found.centre_px, camera.image_size[0]
    changes: dict[str, Any] = {
        "centre_px": (width - 1 - u, v),
        "mount": replace(camera.mount, image_flipped=not camera.mount.image_flipped),
    }
    changes |= {name: -getattr(found, name) for name in ODD if getattr(found, name, 0.0)}
    if hasattr(found, "affine"):
        c, d, e = found.affine
        changes["affine"] = (c, -d, -e)
    if getattr(found, "uncertainty", None) is not None:
        known = found.uncertainty
        signs = np.array([-1.0 if name in TURNED else 1.0 for name in known.names])
        matrix = np.array(known.covariance) * np.outer(signs, signs)
        changes["uncertainty"] = replace(known, covariance=tuple(map(tuple, matrix.tolist())))
    return replace(found, **changes)  # type: ignore[no-any-return]
