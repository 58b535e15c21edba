"""Limits, the quantities that a requirement can limit, and contrast in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import InvalidType, finite, format_value, number
from ..base.errors import InvalidParameter
from ..base.quantities import QUANTITIES, Quantity, format_part
from ..base.registry import Registry
from ..base.toml_validation import did_you_mean
from .merits import OF_THE_WHOLE, FieldValues

# -- Contrast at a spatial frequency in closed form: diffraction, defocus and pixel ----------------
#
# Transfer function of a circular aperture with a defocus of blur Delta along the pattern (Hopkins,
# Proc. R. Soc. A 231, 91, 1955), with s the frequency nu relative to the cut-off frequency, ``s = nu
# Airy / 2.44``:
#
#     MTF = (4/pi) integral_0^(1-s) sqrt(1 - (x+s)^2) cos(pi Delta nu x) dx
#
# Defocus perpendicular to the modulation has no effect; therefore the tangential contrast depends on
# the tangential blur and the sagittal contrast on the sagittal blur. Further aberrations of the
# mirror, such as coma, are neglected; :func:`omnimirror.mtf` includes them.

Array = NDArray[Any]

AIRY = 2.44  # diameter of the Airy disc in wavelengths times the F-number
NODES, PER_RADIAN = (
    24,
    0.5,
)  # Gauss-Legendre nodes: minimum, and number per radian of phase at the edge


def contrast(blur_px: Array, airy_px: Array, cycles_per_px: float) -> Array:
    """Return the contrast at a spatial frequency, negative for contrast reversal.

    Parameters
    ----------
    blur_px, airy_px : (...,)
        Signed geometric blur along the modulation, and Airy disc, px; or complex arrays, whose
        imaginary parts are derivatives.
    cycles_per_px
        Spatial frequency on the imager.

    Examples
    --------
    Pixel contribution alone, in focus and without diffraction:

    >>> contrast(np.array([0.0]), np.array([1e-9]), 0.5).round(4), round(2 / np.pi, 4)
    (array([0.6366]), 0.6366)
    """
    blur, s = np.broadcast_arrays(blur_px, airy_px * (cycles_per_px / AIRY))
    passes = s.real < 1
    s = np.where(passes, s, 0.5)[..., None]
    phase = np.pi * cycles_per_px * blur[..., None]
    edge = float(np.nan_to_num(np.abs(phase.real)).max(initial=0.0))
    u, weight = np.polynomial.legendre.leggauss(int(NODES + PER_RADIAN * min(edge, 1e3)))
    half = np.arccos(s) / 2
    psi = half * (u + 1)  # the substitution x + s = cos(psi) removes the root
    rows = np.sin(psi) ** 2 * np.cos(phase * (np.cos(psi) - s))
    mtf: Array = (rows * weight).sum(-1) * half[..., 0] * (4 / np.pi) * np.sinc(cycles_per_px)
    return np.where(passes, mtf, 0.0)


# -- Limits, and the quantities that a requirement can limit ---------------------------------------
#
# A quantity is evaluated at its worst field angle in a part of the field. The same definition is used
# for the requirement table of a design and for the constraint rows of an optimiser, real or complex.
#
# Limits of blur refer to the total blur on the imager: the geometric blur (Eq. 28) and the Airy disc,
# added in quadrature, ``sqrt(blur^2 + Airy^2)``; in angle both divided by Dh or Dw. Without the Airy
# disc, a sufficiently small aperture would always satisfy a limit of blur.

Takes = Literal["largest", "smallest", "spread", "ratio"]

REFERENCES = 16
MAX_CYCLES_PER_PX = 10.0  # cycles per pixel
SHARED = 2e-5  # relative, below the reported precision; peaks that differ by less are equal
LEVEL = 1e-9  # relative; smaller differences of neighbours are due to rounding
MAY_BE_0 = ("obscured_to_deg", "obscured_percent")
SHARES = ("mtf", "mtf_t", "mtf_s", "lens_illumination")


@dataclass(frozen=True)
class Limitable:
    """Limitable quantity, and its computation from field values.

    Attributes
    ----------
    parts
        Function of the field values that returns arrays (..., k) over the field angles, or (...,
        1).
    takes
        Reduction at a field angle: the largest or the smallest of the parts. ``"spread"`` and
        ``"ratio"`` have one part and give one value for a part of the field: largest minus
        smallest, smallest divided by largest.
    straight
        Function that returns arrays of smaller curvature that never exceed the largest part; they
        represent its curvature in a linear model.
    is_sharpness
        True if it depends on the focus, except through the image scale.
    is_blur
        True for a blur combined with the Airy disc, which depends on the F-number.
    is_scale
        True if it scales with the image, whose size also depends on the focus.
    of_frequency
        Function that returns ``parts`` for a spatial frequency in cycles per pixel, which is then
        required in limits; None for all other quantities.
    """

    quantity: Quantity
    parts: Callable[[FieldValues], tuple[Array, ...]]
    takes: Takes
    is_sharpness: bool = False
    is_blur: bool = False
    is_scale: bool = False
    of_frequency: Callable[[float], Callable[[FieldValues], tuple[Array, ...]]] | None = None
    straight: Callable[[FieldValues], tuple[Array, ...]] = lambda field: ()

    @property
    def unit(self) -> str:
        return self.quantity.unit

    def values(self, field: FieldValues) -> Array:
        """Return the value at each field angle (..., k), or one value (..., 1)."""
        parts = self.parts(field)
        if self.takes in ("largest", "smallest"):
            value = parts[0]
            for part in parts[1:]:
                is_other = (
                    part.real > value.real if self.takes == "largest" else part.real < value.real
                )
                value = np.where(is_other, part, value)
            return value
        low, high = (
            _at(parts[0], where) for where in (parts[0].real.argmin(-1), parts[0].real.argmax(-1))
        )
        return high - low if self.takes == "spread" else low / high

    def extreme(self, field: FieldValues, largest: bool) -> tuple[float, int | None]:
        """Return the extreme value of one field (k,), and the index of its first field angle.

        A minimax design has its worst value at several angles, equal within the tolerance of the
        search.
        """
        values = self.values(field)
        if values.size == 1:
            return float(values[0]), None
        i = _first_peak(values if largest else -values)
        return float(np.nanmax(values) if largest else np.nanmin(values)), i

    def above(self, field: FieldValues, limit: float) -> Array:
        """Return the excess above a limit as smooth rows (..., r)."""
        if self.takes == "largest":
            return _beside([part - limit for part in (*self.parts(field), *self.straight(field))])
        if self.takes == "spread":
            (part,) = self.parts(field)
            return _beside([part - one - limit for one in _references(part, part.real.argmin(-1))])
        return self.values(field) - limit

    def below(self, field: FieldValues, limit: float) -> Array:
        """Return the shortfall below a limit as smooth rows (..., r)."""
        if self.takes == "smallest":
            return _beside([limit - part for part in self.parts(field)])
        if self.takes == "ratio":
            (part,) = self.parts(field)
            return _beside([limit - part / one for one in _references(part, part.real.argmax(-1))])
        return limit - self.values(field)


def _first_peak(values: Array) -> int:
    """Return the index of the first peak of values (k,) that is as high as the highest one.

    >>> _first_peak(np.array([0.0, 3.0, 1.0, 3.00001])), _first_peak(np.array([2.99998, 3.0, 1.0, 2.0]))
    (1, 1)
    """
    highest = np.nanmax(values)
    level = LEVEL * abs(highest)
    around = np.pad(np.nan_to_num(values, nan=-np.inf), 1, constant_values=-np.inf)
    is_peak = (values >= around[:-2] - level) & (values >= around[2:] - level)
    return int(np.argmax(is_peak & (values >= highest - SHARED * abs(highest))))


def _at(values: Array, where: Array) -> Array:
    """Return the values (..., 1) at indices (...)."""
    return np.take_along_axis(values, np.asarray(where)[..., None], axis=-1)


def _references(part: Array, extreme: Array) -> list[Array]:
    """Return reference values (..., 1) for all others: the extreme one, and candidates for it.

    With the extreme value alone, a linear model would not account for a change of the extreme
    angle.
    """
    some = np.linspace(0, part.shape[-1] - 1, REFERENCES).astype(int)
    return [_at(part, extreme), *(part[..., i : i + 1] for i in some)]


def _beside(rows: list[Array]) -> Array:
    return np.concatenate(np.broadcast_arrays(*rows), axis=-1)


Disc = Callable[[FieldValues], tuple[Array, Array]]
"""Signed blur, and the Airy disc combined with the lens blur in the same unit."""


def _in_quadrature(blur: Array, airy: Array) -> Array:
    length: Array = np.sqrt(blur * blur + airy * airy)
    return length


def _total_blur(name: str, *discs: Disc) -> Limitable:
    """Return the largest total blur of several discs; the signed blurs are the straight rows."""
    return Limitable(
        QUANTITIES[name],
        lambda f: tuple(_in_quadrature(*disc(f)) for disc in discs),
        "largest",
        is_sharpness=True,
        is_blur=True,
        straight=lambda f: tuple(sign * disc(f)[0] for disc in discs for sign in (1, -1)),
    )


def _one(
    name: str,
    takes: Takes,
    part: Callable[[FieldValues], Array],
    is_sharpness: bool = False,
    is_scale: bool = False,
) -> Limitable:
    return Limitable(QUANTITIES[name], lambda f: (part(f),), takes, is_sharpness, is_scale=is_scale)


def _mtf(name: str, *sides: Callable[[FieldValues], Array]) -> Limitable:
    """Return the contrast of each blur at a spatial frequency."""

    def of_frequency(cycles: float) -> Callable[[FieldValues], tuple[Array, ...]]:
        return lambda f: tuple(contrast(side(f), f.airy_px, cycles) for side in sides)

    return Limitable(
        QUANTITIES[name],
        of_frequency(0.0),
        "smallest",
        is_sharpness=True,
        of_frequency=of_frequency,
    )


T_PX: Disc = lambda f: (f.t_px, f.disk_t_px)  # noqa: E731 - a table of four
S_PX: Disc = lambda f: (f.s_px, f.disk_s_px)  # noqa: E731
T_DEG: Disc = lambda f: (f.t_deg, f.disk_t_px / f.dh)  # noqa: E731
S_DEG: Disc = lambda f: (f.s_deg, f.disk_s_px / f.dw)  # noqa: E731


_BUILT_IN: dict[str, Limitable] = {
    limitable.quantity.name: limitable
    for limitable in (
        _total_blur("total_blur_px", T_PX, S_PX),
        _total_blur("total_blur_t_px", T_PX),
        _total_blur("total_blur_s_px", S_PX),
        _total_blur("total_blur_deg", T_DEG, S_DEG),
        _total_blur("total_blur_t_deg", T_DEG),
        _total_blur("total_blur_s_deg", S_DEG),
        _one("floored_area_deg2", "largest", lambda f: np.exp(f.log_area), is_sharpness=True),
        Limitable(
            QUANTITIES["resolution_px_per_deg"], lambda f: (f.dh, f.dw), "smallest", is_scale=True
        ),
        _one("dh_domega_px_per_deg", "smallest", lambda f: f.dh, is_scale=True),
        _one("width_px_per_deg", "smallest", lambda f: f.dw, is_scale=True),
        _one("aspect", "smallest", lambda f: f.dw / f.dh),
        Limitable(
            QUANTITIES["plane_mm_per_px"],
            lambda f: (f.plane_t_mm_per_px, f.object_s_mm_per_px),
            "largest",
            is_scale=True,
        ),
        Limitable(
            QUANTITIES["cylinder_mm_per_px"],
            lambda f: (f.cylinder_t_mm_per_px, f.object_s_mm_per_px),
            "largest",
            is_scale=True,
        ),
        _one("viewpoint_spread_mm", "spread", lambda f: f.viewpoint_z),
        _one("area_ratio", "ratio", lambda f: f.dh * f.dw),
        _one("lens_illumination", "smallest", lambda f: f.light),
        _mtf("mtf", lambda f: f.blur_t_px, lambda f: f.blur_s_px),
        _mtf("mtf_t", lambda f: f.blur_t_px),
        _mtf("mtf_s", lambda f: f.blur_s_px),
        _one("length_mm", "largest", lambda f: f.length),
        _one("sag_mm", "largest", lambda f: f.sag),
        _one("obscured_to_deg", "largest", lambda f: f.obscured_to_deg),
        _one("obscured_percent", "largest", lambda f: f.obscured_percent),
        _one("overall_diameter_mm", "largest", lambda f: f.overall_diameter_mm),
        _one("overall_height_mm", "largest", lambda f: f.overall_height_mm),
        _one("mirror_body_mass_g", "largest", lambda f: f.mirror_body_mass_g),
    )
}


def _check_limitable(name: str, limitable: Any) -> None:
    if not isinstance(limitable, Limitable):
        raise InvalidType(
            f"the quantity must be an omnimirror.design.Limitable; got {format_value(limitable)}"
        )
    if limitable.quantity.name != name:
        raise InvalidParameter(
            f"the entry point must have the name of its quantity, {format_value(limitable.quantity.name)}"
        )


LIMITABLE: Registry[Limitable] = Registry(
    "omnimirror.quantities", "a quantity", _BUILT_IN, _check_limitable
)
"""Limitable quantities by name, including registered ones."""


def register_quantity(limitable: Limitable) -> None:
    """Register a custom quantity for requirements, designs and ``omnimirror check``.

    An installed package registers a quantity without a call by an entry point in its
    ``pyproject.toml``: ``[project.entry-points."omnimirror.quantities"]`` with ``density_px2 =
    "my_package:density"``.

    Parameters
    ----------
    limitable
        Quantity with its description and its computation from field values. Its functions are also
        called with complex arrays, whose imaginary parts provide derivatives for an optimiser;
        ``abs`` and ``max`` must not be used.

    Raises
    ------
    InvalidParameter
        If the name is that of an existing quantity.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.design import Limitable
    >>> from omnimirror.base.quantities import Quantity
    >>> density = Quantity("docs_density_px2", "Δs", "px²", "Pixels", "image of one square degree")
    >>> om.register_quantity(Limitable(density, lambda field: (field.dh * field.dw,), "smallest"))
    >>> om.Limit("docs_density_px2", at_least=4.0).of.unit
    'px²'
    >>> om.design.limits.LIMITABLE.withdraw("docs_density_px2")
    """
    LIMITABLE.register(getattr(getattr(limitable, "quantity", None), "name", ""), limitable)


NEVER_ABOVE = {
    "total_blur_t_px": ("total_blur_px",),
    "total_blur_s_px": ("total_blur_px",),
    "total_blur_t_deg": ("total_blur_deg",),
    "total_blur_s_deg": ("total_blur_deg",),
    "resolution_px_per_deg": ("dh_domega_px_per_deg", "width_px_per_deg"),
    "mtf": ("mtf_t", "mtf_s"),
    "sag_mm": ("length_mm",),
}
"""Quantities that are bounds by definition: each key never exceeds the listed quantities."""


@dataclass(frozen=True)
class Limit:
    """Limit of a quantity, over the whole field or a part of it.

    Parameters
    ----------
    quantity
        Name of the quantity.
    at_most
        Upper limit, in the unit of the quantity.
    at_least
        Lower limit, in the unit of the quantity.
    omega_deg : (low, high), optional
        Part of the field, deg, with equal ends for a single angle; the whole field by default.
    cycles_per_px
        Spatial frequency on the imager, for limits of the MTF.

    Raises
    ------
    InvalidParameter
        If the quantity is unknown, the bound is missing, or the range is empty.

    >>> Limit("total_blur_px", at_most=4.0).label
    'total_blur_px'
    >>> Limit("aspect", at_least=0.8, omega_deg=(20.0, 100.0)).label
    'aspect, 20 to 100 deg'
    >>> Limit("mtf", at_least=0.3, omega_deg=(90.0, 90.0), cycles_per_px=0.25).label
    'mtf at 0.25 cycles/px, at 90 deg'
    """

    quantity: str
    at_most: float | None = None
    at_least: float | None = None
    omega_deg: tuple[float, float] | None = None
    cycles_per_px: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.quantity, str) or self.quantity not in LIMITABLE:
            hint = did_you_mean(str(self.quantity)[:60], LIMITABLE)
            raise InvalidParameter(
                f"limit.quantity must be one of {', '.join(LIMITABLE)}; got {format_value(self.quantity)}{hint}"
            )
        if self.at_most is None and self.at_least is None:
            raise InvalidParameter(f"limit of {self.quantity} must have at_most or at_least")
        self._check_frequency()
        for side in ("at_most", "at_least"):
            if (value := getattr(self, side)) is not None:
                self._check_side(side, value)
        if self.at_most is not None and self.at_least is not None and self.at_least > self.at_most:
            raise InvalidParameter(f"limit of {self.quantity}: at_least must not exceed at_most")
        if self.omega_deg is not None and self.quantity in OF_THE_WHOLE:
            raise InvalidParameter(
                f"limit of {self.quantity}: omega_deg must be omitted, since the quantity concerns the whole sensor"
            )
        if self.omega_deg is not None:
            low, high = finite("limit.omega_deg", self.omega_deg, last=2)
            object.__setattr__(self, "omega_deg", (float(low), float(high)))
            if not 0 <= low <= high:
                raise InvalidParameter(
                    f"limit.omega_deg must be [FROM, TO] with 0 <= FROM <= TO; got {list(self.omega_deg)}"
                )

    def _check_frequency(self) -> None:
        if LIMITABLE[self.quantity].of_frequency is None:
            if self.cycles_per_px is not None:
                raise InvalidParameter(
                    f"limit of {self.quantity}: cycles_per_px requires the quantity mtf, mtf_t or mtf_s"
                )
        elif self.cycles_per_px is None:
            raise InvalidParameter(
                f"limit of {self.quantity} requires a spatial frequency, cycles_per_px, such as 0.25"
            )
        else:
            number("limit.cycles_per_px", self.cycles_per_px, above=0.0, high=MAX_CYCLES_PER_PX)

    def _check_side(self, side: str, value: float) -> None:
        number(f"{side} of {self.quantity}", value)
        if value < 0:
            raise InvalidParameter(
                f"limit of {self.quantity}: {side} must be at least 0; got {value:g}"
            )
        if (
            side == "at_most"
            and value == 0
            and self.of.takes != "spread"
            and self.quantity not in MAY_BE_0
        ):
            raise InvalidParameter(
                f"limit of {self.quantity}: at_most must be greater than 0; got 0"
            )
        if (
            side == "at_least"
            and value > 1
            and (self.of.takes == "ratio" or self.quantity in SHARES)
        ):
            raise InvalidParameter(
                f"limit of {self.quantity}: at_least must be at most 1; got {value:g}"
            )

    def contradicts(self, other: Limit) -> str | None:
        """Return the reason why two limits are contradictory, if their numbers imply it.

        Parameters
        ----------
        other
            Limit of the same or another quantity.

        Returns
        -------
        str or None
            Reason for the contradiction; None if both can be met.
        """
        for low, high in ((self, other), (other, self)):
            if low.at_least is None or high.at_most is None or low.at_least <= high.at_most:
                continue
            if not (
                high.quantity in (low.quantity, *NEVER_ABOVE.get(low.quantity, ()))
                and _are_comparable(low, high)
            ):
                continue
            if low.cycles_per_px != high.cycles_per_px:
                continue
            if low.quantity == high.quantity:
                return f"{low.quantity} at least {low.at_least:g} and at most {high.at_most:g}"
            return (
                f"{low.quantity} at least {low.at_least:g} and {high.quantity} at most "
                f"{high.at_most:g}, which is never smaller"
            )
        return None

    @property
    def of(self) -> Limitable:
        definition = LIMITABLE[self.quantity]
        if definition.of_frequency is None or self.cycles_per_px is None:
            return definition
        return replace(definition, parts=definition.of_frequency(self.cycles_per_px))

    @property
    def scale(self) -> float:
        """Magnitude of the limit, the unit for comparing limits."""
        return max(abs(v) for v in (self.at_least, self.at_most) if v is not None) or 1.0

    @property
    def name(self) -> str:
        """Quantity with its spatial frequency."""
        return self.quantity + (
            f" at {self.cycles_per_px:g} cycles/px" if self.cycles_per_px is not None else ""
        )

    @property
    def label(self) -> str:
        """Quantity with the part of the field."""
        return self.name + format_part(self.omega_deg)

    def missed(self, field: FieldValues) -> Array:
        """Return the largest relative violation (...) of fields (..., k), negative if met.

        Parameters
        ----------
        field
            Values at the field angles.

        Returns
        -------
        (..., k) array
            Relative violations; positive if the limit is violated.
        """
        values = self.of.values(field)
        with np.errstate(invalid="ignore"):
            high = (
                -np.inf if self.at_most is None else np.fmax.reduce(values, axis=-1) - self.at_most
            )
            low = (
                -np.inf
                if self.at_least is None
                else self.at_least - np.fmin.reduce(values, axis=-1)
            )
        share: Array = np.maximum(high, low) / self.scale
        return share

    def excess(self, field: FieldValues, distances: int = 1) -> Array:
        """Return the relative violations as smooth rows (..., r); negative if the limit is met.

        Parameters
        ----------
        field
            Values at the field angles, concatenated over object distances.
        distances
            Number of object distances. A spread or a ratio is evaluated for each of them.

        Returns
        -------
        (..., r) array
            Relative violations; positive if the limit is violated.
        """
        blocks = [field]
        if distances > 1 and self.of.takes in ("spread", "ratio"):
            size = max(values.shape[-1] for values in field) // distances
            blocks = [field.part(slice(i * size, (i + 1) * size)) for i in range(distances)]
        rows = []
        for block in blocks:
            if self.at_most is not None:
                rows.append(self.of.above(block, self.at_most))
            if self.at_least is not None:
                rows.append(self.of.below(block, self.at_least))
        return np.concatenate(rows, axis=-1) / self.scale


def _are_comparable(low: Limit, high: Limit) -> bool:
    """Return whether two limits refer to a common field angle. A spread increases and a ratio
    decreases with the extent of the part of the field.
    """
    (a, b), (c, d) = (limit.omega_deg or (0.0, 180.0) for limit in (low, high))
    match low.of.takes:
        case "spread":
            return c <= a and b <= d
        case "ratio":
            return a <= c and d <= b
        case _:
            return max(a, c) <= min(b, d)
