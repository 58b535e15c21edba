"""Panorama metadata: part of the full sphere in an image, its heading and its tilt.

Images contain it as Photo Sphere metadata of Google (GPano,
https://developers.google.com/streetview/spherical-metadata), videos as written by
:mod:`omnimirror.io.mp4`. A mirror never covers all 180 deg of elevation: the image
is always a crop of a hypothetical full panorama.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ..base.errors import InvalidParameter


class Bounds(NamedTuple):
    """Fractions of the full panorama outside the crop, on each side."""

    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True)
class GPano:
    """Equirectangular panorama as a part of the full sphere.

    Parameters
    ----------
    full_size : (width, height) px
        Size of 360 by 180 deg at this resolution.
    cropped_size : (width, height) px
        Size of the image.
    cropped_at : (left, top) px
        Position of the upper left corner of the image in the full panorama.
    heading_deg : deg, optional
        Compass heading of the centre of the full panorama, clockwise from north; None if unknown.
    pitch_deg, roll_deg : deg
        Tilt of a panorama that is not level: elevation of its centre, and clockwise rotation about
        the centre, which turns the horizon counter-clockwise there.

    Raises
    ------
    InvalidParameter
        If the crop is not inside the full panorama, or the tilt is outside -90 to 90 and -180 to
        180 deg.

    Examples
    --------
    >>> panorama = GPano.of_view((1440, 540), elevation_deg=(-90.0, 45.0))
    >>> panorama.full_size, panorama.cropped_size, panorama.cropped_at
    ((1440, 720), (1440, 540), (0, 180))
    """

    full_size: tuple[int, int]
    cropped_size: tuple[int, int]
    cropped_at: tuple[int, int]
    heading_deg: float | None = None
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def __post_init__(self) -> None:
        for full, cropped, at, side in zip(
            self.full_size, self.cropped_size, self.cropped_at, ("width", "height"), strict=True
        ):
            if not (cropped >= 1 and 0 <= at <= full - cropped):
                raise InvalidParameter(
                    f"the crop must be inside the panorama of {full} px {side}; got {cropped} px from {at} px"
                )
        if not (abs(self.pitch_deg) <= 90 and abs(self.roll_deg) <= 180):
            raise InvalidParameter(
                "pitch_deg must be between -90 and 90 deg and roll_deg between -180 and 180 deg; "
                f"got {self.pitch_deg:g} and {self.roll_deg:g}"
            )

    @classmethod
    def of_view(
        cls,
        size: tuple[int, int],
        elevation_deg: tuple[float, float],
        span_deg: float = 360.0,
        heading_deg: float | None = None,
        tilt_deg: tuple[float, float] = (0.0, 0.0),
    ) -> GPano:
        """Return the panorama of a view whose columns are linear in pan and its rows in elevation.

        The centre of the view is the centre of the full panorama, which allows any part without a
        wrap-around; its direction is described by the heading.

        Parameters
        ----------
        size : (width, height) px
        elevation_deg : (lowest, highest) deg
            Elevations of the lower and the upper edge, -90 to 90.
        span_deg : deg
            Width from the left to the right edge, up to 360.
        heading_deg : deg, optional
            Compass heading of the centre of the view.
        tilt_deg : (pitch, roll) deg
            Tilt of a view that is not level, as from
            :meth:`omnimirror.cameras.camera.Mount.view_tilt_deg`.
        """
        low, high = elevation_deg
        if not (-90 <= low < high <= 90 and 0 < span_deg <= 360):
            raise InvalidParameter(
                "span_deg must be greater than 0 and at most 360 deg, and elevation_deg must increase from -90 to "
                f"90 deg; got {span_deg:g} and ({low:g}, {high:g})"
            )
        width, height = size
        full_width = max(width, round(width * 360 / span_deg))
        full_height = max(height, round(height * 180 / (high - low)))
        top = min(round(full_height * (90 - high) / 180), full_height - height)
        return cls(
            (full_width, full_height),
            size,
            ((full_width - width) // 2, top),
            heading_deg,
            *tilt_deg,
        )

    @property
    def bounds(self) -> Bounds:
        """Fractions of the full panorama outside the crop."""
        (full_width, full_height), (width, height), (left, top) = (
            self.full_size,
            self.cropped_size,
            self.cropped_at,
        )
        right, bottom = full_width - width - left, full_height - height - top
        return Bounds(
            left / full_width, top / full_height, right / full_width, bottom / full_height
        )

    @property
    def pose_heading_deg(self) -> float | None:
        """Heading from 0 to 360 deg, as in the formats."""
        return None if self.heading_deg is None else self.heading_deg % 360.0

    def area(self) -> dict[str, object]:
        """Crop in the terms of image and video metadata."""
        return {
            "ProjectionType": "equirectangular",
            "FullPanoWidthPixels": self.full_size[0],
            "FullPanoHeightPixels": self.full_size[1],
            "CroppedAreaImageWidthPixels": self.cropped_size[0],
            "CroppedAreaImageHeightPixels": self.cropped_size[1],
            "CroppedAreaLeftPixels": self.cropped_at[0],
            "CroppedAreaTopPixels": self.cropped_at[1],
        }

    def xmp(self) -> bytes:
        """Return the XMP packet for images, UTF-8.

        >>> b'GPano:CroppedAreaTopPixels="180"' in GPano((1440, 720), (1440, 540), (0, 180)).xmp()
        True
        """
        fields: dict[str, object] = {
            "UsePanoramaViewer": "True",
            **self.area(),
        }
        if self.pose_heading_deg is not None:
            fields["PoseHeadingDegrees"] = f"{self.pose_heading_deg:g}"
        # Written for level panoramas too: without it, the tilt would be unknown.
        fields |= {
            "PosePitchDegrees": f"{self.pitch_deg:g}",
            "PoseRollDegrees": f"{self.roll_deg:g}",
        }
        attributes = "\n   ".join(f'GPano:{name}="{value}"' for name, value in fields.items())
        return (
            '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
            '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
            ' <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
            '  <rdf:Description rdf:about="" xmlns:GPano="http://ns.google.com/photos/1.0/panorama/"\n'
            f"   {attributes}/>\n </rdf:RDF>\n</x:xmpmeta>\n"
            '<?xpacket end="r"?>'
        ).encode()
