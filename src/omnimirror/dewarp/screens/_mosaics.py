"""Several views in one image: the cube map, and mosaics of arbitrary views."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

import numpy as np

from ...base.arguments import check_fields, validate_arguments
from ...base.errors import InvalidParameter
from ._projections import (
    NO_OFFSET,
    Offset,
    Plane,
    ScreenPart,
    View,
    check_angle,
    check_choice,
    check_size,
    offset_text,
)

Layout = Literal["cross", "strip", "3x2"]

FACES: dict[str, tuple[float, float]] = {
    "right": (90.0, 0.0),
    "left": (-90.0, 0.0),
    "up": (0.0, 90.0),
    "down": (0.0, -90.0),
    "front": (0.0, 0.0),
    "back": (180.0, 0.0),
}
"""Pan and tilt (deg) of the faces of a cube as seen from inside; up and down adjoin the front."""

LAYOUTS: dict[str, tuple[tuple[str, ...], ...]] = {
    "cross": (("", "up", "", ""), ("left", "front", "right", "back"), ("", "down", "", "")),
    "strip": (tuple(FACES),),
    "3x2": (("right", "left", "up"), ("down", "front", "back")),
}
"""Rows of faces. Strip and 3x2 have the order of c6x1 and c3x2 in the v360 filter of ffmpeg."""


@dataclass(frozen=True)
class CubeMap:
    """Cube map: six square views that cover all directions, as seen from inside a cube.

    Parameters
    ----------
    size : (width, height)
        Size of the whole image: a multiple of 4 x 3 for a cross, 6 x 1 for a strip, 3 x 2.
    layout
        ``"cross"`` (left, front, right, back in a row; up and down above and below the front),
        ``"strip"`` (right, left, up, down, front, back) or ``"3x2"`` (the same in two rows).
    pan_deg : deg
        Direction of the front, right of forward.
    distance_mm : mm
        Distance of the faces from the centre of the cube.
    offset_mm : (x, y, z) mm
        Position of the centre relative to the mirror vertex, in the world frame; for a finite cube
        only.

    Raises
    ------
    InvalidParameter
        If the parameters do not define a cube.

    Examples
    --------
    >>> cube = CubeMap((40, 30))
    >>> cube.parts[0]
    ScreenPart(left=10, top=0, view=Plane(size=(10, 10), pan_deg=0.0, tilt_deg=90.0, ...))
    """

    size: tuple[int, int]
    layout: Layout = "cross"
    pan_deg: float = 0.0
    distance_mm: float = np.inf
    offset_mm: Offset = NO_OFFSET

    def __post_init__(self) -> None:
        check_fields(self)
        check_size(self.size)
        check_choice("layout", self.layout, get_args(Layout))
        columns, rows = self.grid(self.layout)
        if self.size[0] * rows != self.size[1] * columns or self.size[0] % columns:
            raise InvalidParameter(
                f"size must be {columns} n x {rows} n px for square faces in the layout "
                f"{self.layout}, for example {columns * 256} x {rows * 256}; got "
                f"{self.size[0]} x {self.size[1]} px"
            )
        check_angle("pan_deg", self.pan_deg)
        self.face("front")  # raises an error for an invalid placement

    @staticmethod
    def grid(layout: Layout) -> tuple[int, int]:
        """Return the numbers of columns and rows of faces in a layout.

        >>> CubeMap.grid("3x2")
        (3, 2)
        """
        return len(LAYOUTS[layout][0]), len(LAYOUTS[layout])

    @property
    def face_px(self) -> int:
        """Side of a face in pixels."""
        return self.size[1] // len(LAYOUTS[self.layout])

    def face(self, name: str) -> Plane:
        """Return one of the faces right, left, up, down, front and back."""
        check_choice("face", name, tuple(FACES))
        pan, tilt = FACES[name]
        side = (self.face_px, self.face_px)
        return Plane(side, self.pan_deg + pan, tilt, 0.0, 90.0, self.distance_mm, self.offset_mm)

    @property
    def parts(self) -> tuple[ScreenPart, ...]:
        """Faces and their positions."""
        n = self.face_px
        rows = enumerate(LAYOUTS[self.layout])
        return tuple(
            ScreenPart(i * n, j * n, self.face(name))
            for j, row in rows
            for i, name in enumerate(row)
            if name
        )

    @validate_arguments
    def zoomed(self, factor: float) -> Self:
        """Raise an error: a cube covers all directions and cannot be zoomed."""
        raise InvalidParameter(
            f"a cube map cannot be zoomed, as it covers all directions; got a factor of {factor:g}"
        )

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the cube rotated with its front farther to the right."""
        if tilt_deg:
            raise InvalidParameter(
                f"tilt_deg must be 0 for a cube map, which is upright; got {tilt_deg:g} deg"
            )
        return replace(self, pan_deg=self.pan_deg + pan_deg)

    def __str__(self) -> str:
        turned = f"pan {self.pan_deg:g} deg, " if self.pan_deg else ""
        position = (
            ""
            if math.isinf(self.distance_mm)
            else f", at {self.distance_mm:g} mm{offset_text(self.offset_mm)}"
        )
        return f"cube map ({turned}{self.layout} of {self.face_px} px faces{position})"


@dataclass(frozen=True)
class Mosaic:
    """Several views in one image, each with its own shape, distance and position.

    Parameters
    ----------
    size : (width, height)
        Size of the whole image.
    parts
        Views as ``(left, top, view)`` with the column and row of the first pixel. Overlapping
        pixels belong to the last view, and pixels outside all views have no target.

    Raises
    ------
    InvalidParameter
        If there are no views, or a view extends beyond the image.

    Examples
    --------
    >>> from omnimirror.dewarp.screens import Cylinder
    >>> views = [Plane((100, 80), pan_deg=pan) for pan in (-90.0, 0.0, 90.0, 180.0)]
    >>> mosaic = Mosaic.panorama_over_views(Cylinder((400, 120), -60.0, 40.0, pan_deg=45.0), views)
    >>> mosaic.size, [part[:2] for part in mosaic.parts]
    ((400, 200), [(0, 0), (0, 120), (100, 120), (200, 120), (300, 120)])
    """

    size: tuple[int, int]
    parts: tuple[ScreenPart, ...]

    def __post_init__(self) -> None:
        check_size(self.size)
        object.__setattr__(self, "parts", tuple(ScreenPart(*part) for part in self.parts))
        if not self.parts:
            raise InvalidParameter("parts must contain at least one view; got none")
        for left, top, view in self.parts:
            right, bottom = left + view.size[0], top + view.size[1]
            if not (0 <= left == int(left) and 0 <= top == int(top)):
                raise InvalidParameter(
                    f"left and top of a view must be integers from 0; got ({left}, {top})"
                )
            if right > self.size[0] or bottom > self.size[1]:
                raise InvalidParameter(
                    f"the views must be within the {self.size[0]} x {self.size[1]} px of "
                    f"the mosaic; got one from ({left}, {top}) to ({right}, {bottom})"
                )

    @classmethod
    def stacked(cls, rows: Sequence[Sequence[View]], gap_px: int = 0) -> Self:
        """Return rows of views, stacked and centred, with ``gap_px`` between neighbours."""
        if not all(rows):
            raise InvalidParameter(
                "each row of the mosaic must contain at least one view; got an empty row"
            )
        widths = [sum(v.size[0] for v in row) + gap_px * (len(row) - 1) for row in rows]
        parts, top = [], 0
        for row, width in zip(rows, widths, strict=True):
            left = (max(widths) - width) // 2
            for view in row:
                parts.append(ScreenPart(left, top, view))
                left += view.size[0] + gap_px
            top += max(v.size[1] for v in row) + gap_px
        return cls((max(widths, default=0), max(top - gap_px, 0)), tuple(parts))

    @classmethod
    def panorama_over_views(cls, panorama: View, views: Sequence[View], gap_px: int = 0) -> Self:
        """Return a panorama with a row of views below it."""
        return cls.stacked([[panorama], views], gap_px)

    def zoomed(self, factor: float) -> Self:
        """Return the mosaic with every view zoomed."""
        return self._each("zoomed", factor)

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the mosaic with every view rotated."""
        return self._each("panned", pan_deg, tilt_deg)

    def _each(self, method: str, *args: float) -> Self:
        for part in self.parts:
            if not hasattr(part.view, method):
                raise InvalidParameter(
                    f"the views of the mosaic must support {method}(); got the {part.view}"
                )
        return replace(
            self, parts=tuple(p._replace(view=getattr(p.view, method)(*args)) for p in self.parts)
        )

    def __str__(self) -> str:
        return f"mosaic of {len(self.parts)} views"
