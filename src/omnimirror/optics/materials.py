"""Optical materials: refractive indices of covers, media and glasses, and reflectance of metals.

Covers and media follow a two-term Cauchy formula from n_d and V_d, glasses the formulas of AGF
catalogues, and metals Fresnel's equations with a complex index.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import choice, format_value, number
from ..base.errors import InvalidParameter, SpecError
from ..base.files import read_text
from ..base.typing import Array

# -- Cover materials and surrounding media ---------------------------------------------------------

D_LINE_NM, F_LINE_NM, C_LINE_NM = 587.56, 486.13, 656.27


class Material(NamedTuple):
    """Clear material, or medium around a cover."""

    index_d: float
    """Refractive index at 587.6 nm, relative to air."""
    abbe_number: float | None
    """(n_d - 1)/(n_F - n_C); None if the source does not give it."""
    source: str

    def index_at(self, wavelength_nm: float) -> float:
        """Compute the refractive index by a two-term Cauchy formula from n_d and V_d.

        The error relative to published Sellmeier equations is below 0.0003 from 450 to 700 nm.

        >>> round(MATERIALS["bk7"].index_at(486.13), 4)
        1.5224
        """
        if self.abbe_number is None:
            return self.index_d
        b = (self.index_d - 1) / self.abbe_number / (F_LINE_NM**-2 - C_LINE_NM**-2)
        return self.index_d + b * (wavelength_nm**-2 - D_LINE_NM**-2)


MATERIALS: dict[str, Material] = {
    "air": Material(1.0, None, "reference of all other indices"),
    "acrylic": Material(1.4918, 57.4, "PMMA, as listed in lens design programs"),
    "polycarbonate": Material(1.5855, 29.9, "as listed in lens design programs"),
    "bk7": Material(1.5168, 64.17, "Schott N-BK7, data sheet"),
    "fused_silica": Material(1.45846, 67.82, "Malitson, J. Opt. Soc. Am. 55, 1205 (1965)"),
    "sapphire": Material(1.7682, 72.3, "ordinary ray; Malitson, J. Opt. Soc. Am. 52, 1377 (1962)"),
    "water": Material(1.3331, 55.8, "20 C; Quan and Fry, Appl. Opt. 34, 3477 (1995)"),
    "sea_water": Material(
        1.3395, 54.9, "35 g/kg of salt, 20 C; Quan and Fry, Appl. Opt. 34, 3477 (1995)"
    ),
    "mineral_oil": Material(
        1.467, None, "light paraffin oil, 20 C, typical supplier value; oils differ: measure yours"
    ),
}
"""Materials by their name in sensor files."""

MATERIAL_NAMES = tuple(MATERIALS)


def index_of(material: str, wavelength_nm: float = D_LINE_NM) -> float:
    """Return the refractive index of a material by name.

    Parameters
    ----------
    material
        One of :data:`MATERIALS`.
    wavelength_nm
        Wavelength in air, nm.

    Returns
    -------
    float

    Raises
    ------
    InvalidParameter
        If the name is unknown, or the wavelength is outside the visible and near-visible range.

    Examples
    --------
    >>> index_of("water")
    1.3331
    """
    choice("material", material, MATERIAL_NAMES)
    wavelength_nm = number("wavelength_nm", wavelength_nm, low=300.0, high=1100.0, unit="nm")
    if wavelength_nm == D_LINE_NM:
        return MATERIALS[material].index_d
    return MATERIALS[material].index_at(wavelength_nm)


# -- Glasses ---------------------------------------------------------------------------------------

GLASS_FILE = Path(__file__).with_name("glasses.csv")
LINE_D, LINE_F, LINE_C = 0.5875618, 0.4861327, 0.6562725  # micrometres
SELLMEIER = {2: 3, 6: 4, 11: 5}  # number of terms of the AGF formulas that are sums of poles
POWERS: dict[int, tuple[float, ...]] = {
    1: (0, 2, -2, -4, -6, -8),
    12: (0, 2, -2, -4, -6, -8, 4, 6),
    13: (0, 2, 4, -2, -4, -6, -8, -10, -12),
}
"""Exponents of the AGF formulas that are sums of powers: Schott's, and the extended ones."""


@dataclass(frozen=True)
class Glass:
    """Dispersion of a glass relative to air.

    >>> round(Glass("N-BK7", "sellmeier", (0, 1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945,
    ...                                    103.560653)).index(0.5875618), 4)
    1.5168
    """

    name: str
    formula: str
    coefficients: tuple[float, ...]
    from_um: float = 0.0
    to_um: float = np.inf

    def index(self, wavelength_um: float) -> float:
        """Compute the refractive index.

        Raises
        ------
        InvalidParameter
            If the wavelength is outside the range of the data.
        """
        low, high = self.from_um, self.to_um
        if not low <= wavelength_um <= high:
            raise InvalidParameter(
                f"the wavelength must be {low * 1e3:g} to {high * 1e3:g} nm, the range of "
                f"the data of {self.name}; got {wavelength_um * 1e3:g} nm"
            )
        square, (first, *coefficients_after_first) = wavelength_um**2, self.coefficients
        pairs = list(
            zip(coefficients_after_first[::2], coefficients_after_first[1::2], strict=True)
        )
        if self.formula == "sellmeier":
            return float(np.sqrt(1 + first + sum(a * square / (square - b) for a, b in pairs)))
        if self.formula == "cauchy":
            return float(first + sum(a * wavelength_um**b for a, b in pairs))
        return float(np.sqrt(first + sum(a * wavelength_um**b for a, b in pairs)))


def model_glass(index_d: float, abbe: float) -> Glass:
    """Return a model glass from index and Abbe number: ``n = a + b/lambda^2``.

    >>> glass = model_glass(1.6, 40.0)
    >>> round((glass.index(LINE_D) - 1) / (glass.index(LINE_F) - glass.index(LINE_C)), 6)
    40.0
    """
    # (n_d - 1)/V = n_F - n_C = b (1/lambda_F^2 - 1/lambda_C^2), the definition of the Abbe number V
    spread = LINE_F**-2 - LINE_C**-2
    b = (index_d - 1) / abbe / spread if abbe else 0.0
    return Glass("a model glass", "cauchy", (index_d - b / LINE_D**2, b, -2.0))


class GlassCatalogue(NamedTuple):
    """Glasses by manufacturer and name."""

    glasses: dict[tuple[str, str], Glass]
    source: str

    def find(self, name: str, makers: tuple[str, ...] = ()) -> Glass | None:
        """Return a glass from the first manufacturer that has it, else from any."""
        upper = name.upper()
        others = {maker: None for maker, _ in self.glasses}  # in file order
        for maker in (*makers, *others):
            if (glass := self.glasses.get((maker.upper(), upper))) is not None:
                return glass
        return None


@cache
def bundled_glasses() -> GlassCatalogue:
    """Return the bundled glasses.

    >>> len(bundled_glasses().glasses) > 1000
    True
    """
    glasses = {}
    for line in GLASS_FILE.read_text(encoding="utf-8").splitlines():
        if line.startswith(("#", "maker,")):
            continue
        maker, name, formula, low, high, numbers = line.split(",")
        coefficients = tuple(float(v) for v in numbers.split())
        glasses[maker, name] = Glass(name, formula, coefficients, float(low), float(high))
    return GlassCatalogue(glasses, "the bundled glasses")


def read_agf(path: Path) -> GlassCatalogue:
    """Read a glass catalogue of Zemax (.agf).

    Raises
    ------
    OmnimirrorError
        If the file cannot be read or contains no glass, or a dispersion formula is not supported.
    """
    glasses: dict[tuple[str, str], Glass] = {}
    name, formula, maker = "", 0, path.stem.upper()
    numbers: tuple[float, ...] = ()
    for line_number, line in enumerate(
        read_text(path, "glass catalogue", SpecError).splitlines(), start=1
    ):
        words = line.split()
        try:
            if line.startswith("NM "):
                name, formula = words[1].upper(), int(float(words[2]))
            elif line.startswith("CD ") and name:
                numbers = tuple(float(v) for v in words[1:])
                glasses[maker, name] = _of_agf(name, formula, numbers)
            elif line.startswith("LD ") and (maker, name) in glasses:
                glasses[maker, name] = _of_agf(
                    name, formula, numbers, float(words[1]), float(words[2])
                )
        except (ValueError, IndexError):
            raise SpecError(
                f"{path} line {line_number}: cannot parse {line.strip()!r} as a line of a glass catalogue"
            ) from None
    if not glasses:
        raise SpecError(
            f"{path} contains no glass; a glass catalogue (.agf) must have lines NM and CD for each glass"
        )
    return GlassCatalogue(glasses, str(path))


def _of_agf(
    name: str, formula: int, numbers: tuple[float, ...], low: float = 0.0, high: float = np.inf
) -> Glass:
    numbers = (*numbers, *[0.0] * 12)
    if formula in SELLMEIER:
        return Glass(name, "sellmeier", (0.0, *numbers[: 2 * SELLMEIER[formula]]), low, high)
    if formula in POWERS:
        first, *terms = zip(numbers, POWERS[formula], strict=False)
        return Glass(name, "powers", (first[0], *(v for pair in terms for v in pair)), low, high)
    return Glass(name, f"formula {formula}", (0.0,), low, high)


def glass_named(name: str, makers: tuple[str, ...], catalogue: GlassCatalogue | None) -> Glass:
    """Return a glass by name.

    Raises
    ------
    InvalidParameter
        If no catalogue has it, or its dispersion formula is not supported.
    """
    catalogues = [c for c in (catalogue, bundled_glasses()) if c is not None]
    for source_catalogue in catalogues:
        if (glass := source_catalogue.find(name, makers)) is not None:
            if glass.formula.startswith("formula"):
                raise InvalidParameter(
                    f"the dispersion formula of glass {name} in {source_catalogue.source} "
                    f"must be one of {', '.join(map(str, sorted([*SELLMEIER, *POWERS])))}; "
                    f"got {glass.formula}"
                )
            return glass
    known_names = {n for c in catalogues for _, n in c.glasses}
    close = difflib.get_close_matches(name.upper(), sorted(known_names), n=1, cutoff=0.6)
    hint = f"; did you mean {close[0]}?" if close else ""
    raise InvalidParameter(
        f"unknown glass {name}{hint}; specify the catalogue that contains it (.agf) as glass_catalogue"
    )


# -- Reflectance of a mirror -----------------------------------------------------------------------

Reflectivity: TypeAlias = float | complex | str
"""Constant from 0 to 1, complex refractive index ``n + 1j k`` of a metal, or name of a metal."""

METALS: dict[str, complex] = {
    "aluminium": 0.96 + 6.69j,  # Rakic 1995
    "silver": 0.06 + 3.59j,  # Johnson and Christy 1972
    "gold": 0.43 + 2.46j,  # Johnson and Christy 1972
}
"""Refractive indices of clean metals at 550 nm."""


def reflectance(gamma: ArrayLike, reflectivity: Reflectivity) -> Array:
    """Compute the reflectance for unpolarised light at angles of incidence gamma, radians.

    A constant is independent of the angle; metals follow Fresnel's equations, averaged over
    polarisations.

    Raises
    ------
    InvalidParameter
        If a constant is outside 0 to 1, an index is not that of a metal, or a name is unknown.

    Examples
    --------
    >>> reflectance(np.radians([0.0, 60.0]), "aluminium").round(3)
    array([0.921, 0.907])
    >>> reflectance([0.0], 0.96 + 6.69j).round(3), reflectance([0.5], 0.9)
    (array([0.921]), array([0.9]))
    """
    index = _metal_index(reflectivity)
    cos = np.cos(np.asarray(gamma, dtype=float))
    if isinstance(index, float):
        return np.full_like(cos, index)
    inside = np.sqrt(1 - (1 - cos**2) / index**2)  # cosine in the metal, complex
    # Fresnel's equations, s and p polarisation
    s = (cos - index * inside) / (cos + index * inside)
    p = (index * cos - inside) / (index * cos + inside)
    mean: Array = (np.abs(s) ** 2 + np.abs(p) ** 2) / 2
    return mean


def _metal_index(reflectivity: Reflectivity) -> float | complex:
    """Return a constant as float, or a refractive index as complex."""
    if isinstance(reflectivity, str):
        if reflectivity not in METALS:
            raise InvalidParameter(
                f"reflectivity must be one of {', '.join(METALS)}, or a number; got {format_value(reflectivity)}"
            )
        return METALS[reflectivity]
    if isinstance(reflectivity, complex):
        if not (np.isfinite(reflectivity) and reflectivity.real > 0 and reflectivity.imag >= 0):
            raise InvalidParameter(
                f"reflectivity must be an index n + k j with n > 0 and k >= 0; got {reflectivity}"
            )
        return reflectivity
    fraction = number("reflectivity", reflectivity)
    if not 0 < fraction <= 1:
        raise InvalidParameter(f"reflectivity must be greater than 0, up to 1; got {fraction:g}")
    return fraction
