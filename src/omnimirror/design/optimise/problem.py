"""Problem definition of a mirror optimisation: given values, free values and limits."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...base.arguments import choice, image_radius
from ...base.errors import InvalidParameter
from ...optics.batch.bases import family
from ...optics.housing import Housing
from ...optics.image_sensor import Imager
from ...optics.lenses import BLUR_MODES, BlurMode, FieldLens
from ..criteria.limits import Limit
from ..criteria.ranges import Range, ends

LENS_KINDS = ("perspective", "orthographic")
OF_LENS = ("theta_max_deg", "focal_length_mm")


@dataclass(frozen=True)
class DesignProblem:
    """Field, size, lens and pixels of the candidate sensors; ranges are free variables.

    Parameters
    ----------
    omega_max_deg, rim_radius_mm
        Field angle at the rim, and rim radius M.
    theta_max_deg, focal_length_mm
        Viewing angle of the lens at the rim, which determines the distance m, and focal length. One
        of them may be None and then follows from a rim image that fills the imager. A telecentric
        lens has neither; its magnification then follows from a rim image that fills the imager.
    f_number
        F-number; for a telecentric lens the image-side working F-number.
    magnification
        Magnification of a telecentric lens, if the imager is not to be filled.
    imager
        Pixels and their pitch.
    largest_image_px
        Largest radius of the rim image; by default that of the largest circle on the imager.
    lens
        ``"perspective"`` or ``"orthographic"`` (telecentric, as wide as the mirror).
    omega_min_deg
        Inner end of the evaluated field; the camera obscures smaller angles.
    housing
        Housing of the mirror. The evaluated field starts at the end of the obscuration by the
        camera, if this is beyond ``omega_min_deg``; for ``omega_min_deg`` above 0, an unobscured
        view from there is a constraint. Other parts of the housing are included in the requirement
        check, not in the search.
    object_distance_mm
        Object distance from the mirror, or the nearest and the farthest distance; both are
        evaluated.
    focus_mm
        Focus distance, or its range; None for a free focus.
    mode, image_radius_px, wavelength_nm
        As in :func:`omnimirror.evaluate`.
    family, terms
        Kind of mirror, and number of shape parameters.
    limits
        Additional limits. If theta or the focal length is a range, the size of the rim image is
        also a constraint.
    mirror_material
        Material of the mirror body, for limits of the mass; aluminium by default.
    optics
        Real lens, which determines focal length and F-number.

    Raises
    ------
    InvalidParameter
        Values without a valid mirror, and empty ranges.

    Examples
    --------
    >>> DesignProblem(omega_max_deg=120.0, terms=8).free
    []
    """

    omega_max_deg: Range = 135.0
    theta_max_deg: Range | None = 12.0
    rim_radius_mm: Range = 43.9
    focal_length_mm: Range | None = 11.6
    magnification: Range | None = None
    f_number: Range = 4.0
    imager: Imager = field(default_factory=lambda: Imager(1024, 1024, 5.2))
    largest_image_px: float | None = None
    lens: str = "perspective"
    omega_min_deg: float = 0.0
    housing: Housing = field(default_factory=Housing)
    object_distance_mm: Range = np.inf
    focus_mm: Range | None = None
    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0
    family: str = "slope-spline"
    terms: int = 12
    limits: tuple[Limit, ...] = ()
    mirror_material: str | None = None
    optics: FieldLens | None = None

    def __post_init__(self) -> None:
        if self.lens not in LENS_KINDS:
            raise InvalidParameter(f"lens = {self.lens!r} is not known; valid are {', '.join(LENS_KINDS)}")
        if self.optics is not None:
            object.__setattr__(self, "focal_length_mm", self.optics.focal_length_mm)
            object.__setattr__(self, "f_number", self.optics.f_number)
            if self.is_telecentric or self.mode != "exact" or self.image_radius_px is not None:
                raise InvalidParameter(
                    f"lens = {self.lens!r}, mode = {self.mode!r} or image_radius_px does not apply to a real lens; "
                    'valid is lens = "perspective" and mode = "exact"'
                )
        if self.is_telecentric:
            for name in OF_LENS:
                object.__setattr__(self, name, None)
        elif self.theta_max_deg is None and self.focal_length_mm is None:
            raise InvalidParameter("a perspective lens needs theta_max_deg or focal_length_mm, a number or a range")
        choice("mode", self.mode, BLUR_MODES)
        if self.image_radius_px is not None:
            image_radius(self.image_radius_px)
        self._check_ranges()
        self._check_focus()
        self._check_field()
        family(self.family, self.terms)

    @property
    def is_telecentric(self) -> bool:
        return self.lens == "orthographic"

    @property
    def distances_mm(self) -> tuple[float, ...]:
        """Return the distinct object distances."""
        return tuple(sorted(set(ends(self.object_distance_mm))))

    @property
    def free(self) -> list[str]:
        """Return the names of the ranges, the free variables in addition to shape and focus."""
        names = (
            "omega_max_deg", "theta_max_deg", "rim_radius_mm", "focal_length_mm", "magnification", "f_number"
        )  # fmt: skip
        return [n for n in names if (v := getattr(self, n)) is not None and ends(v)[0] < ends(v)[1]]

    @property
    def has_image_to_fit(self) -> bool:
        """Return whether the size of the rim image depends on free variables."""
        if self.is_telecentric:
            return self.magnification is not None
        return None not in (self.theta_max_deg, self.focal_length_mm) and any(n in self.free for n in OF_LENS)

    @property
    def image_radius_mm(self) -> float:
        """Return the largest radius of the rim image."""
        radius = self.imager.inscribed_radius_px if self.largest_image_px is None else self.largest_image_px
        return radius * self.imager.pitch_mm

    @property
    def has_view_to_clear(self) -> bool:
        """Return whether an unobscured view past the camera is required from a field angle on."""
        return self.housing.camera is not None and self.omega_min_deg > 0 and not self.is_telecentric

    def _check_ranges(self) -> None:
        for name in ("omega_max_deg", "theta_max_deg", "rim_radius_mm", "focal_length_mm", "magnification", "f_number",
                     "object_distance_mm"):  # fmt: skip
            if (value := getattr(self, name)) is None:
                continue
            low, high = ends(value)
            if not 0 < low <= high:
                said = f"{low:g}" if low == high else f"{low:g} to {high:g}"
                raise InvalidParameter(f"{name} = {said} is no range or number above 0; it needs 0 < low <= high")

    def _check_focus(self) -> None:
        if self.focus_mm is None:
            return
        low, high = ends(self.focus_mm)
        object.__setattr__(self, "focus_mm", low if low == high else (low, high))
        if not (np.isfinite([low, high]).all() and low <= high and (low > 0 or self.is_telecentric)):
            raise InvalidParameter(
                f"focus_mm = {low:g} to {high:g} is no distance or range of distances; it needs 0 < low <= high"
            )

    def _check_field(self) -> None:
        least, omega = ends(self.omega_max_deg)
        most = 0.0 if self.theta_max_deg is None else ends(self.theta_max_deg)[1]
        if not (most < least and omega < 180 - most):
            raise InvalidParameter(
                f"omega_max_deg = {omega:g} cannot be reached with theta_max_deg = {most:g}; it is "
                f"valid between {most:g} and {180 - most:g}, where the rim would be seen edge-on"
            )
        if not 0 <= self.omega_min_deg < least:
            raise InvalidParameter(f"omega_min_deg = {self.omega_min_deg:g} is not valid from 0 to below {least:g}")
