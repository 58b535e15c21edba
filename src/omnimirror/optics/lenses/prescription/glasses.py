"""Refractive indices of glasses, from a bundled table or a catalogue file (.agf)."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ....base.errors import InvalidParameter, SpecError
from ....base.files import read_text

BUNDLED = Path(__file__).with_name("glasses.csv")
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
                f"the index of {self.name} is known from {low * 1e3:g} to {high * 1e3:g} nm, and asked for at "
                f"{wavelength_um * 1e3:g} nm"
            )
        square, (first, *rest) = wavelength_um**2, self.coefficients
        pairs = list(zip(rest[::2], rest[1::2], strict=True))
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
            if (found := self.glasses.get((maker.upper(), upper))) is not None:
                return found
        return None


@cache
def bundled_glasses() -> GlassCatalogue:
    """Return the bundled glasses.

    >>> len(bundled_glasses().glasses) > 1000
    True
    """
    found = {}
    for line in BUNDLED.read_text(encoding="utf-8").splitlines():
        if line.startswith(("#", "maker,")):
            continue
        maker, name, formula, low, high, numbers = line.split(",")
        coefficients = tuple(float(v) for v in numbers.split())
        found[maker, name] = Glass(name, formula, coefficients, float(low), float(high))
    return GlassCatalogue(found, "the glasses that come with omnimirror")


def read_agf(path: Path) -> GlassCatalogue:
    """Read a glass catalogue of Zemax (.agf).

    Raises
    ------
    OmnimirrorError
        If the file cannot be read or contains no glass, or a dispersion formula is not supported.
    """
    found: dict[tuple[str, str], Glass] = {}
    name, formula, maker = "", 0, path.stem.upper()
    numbers: tuple[float, ...] = ()
    for number, line in enumerate(read_text(path, "glass catalogue", SpecError).splitlines(), start=1):
        words = line.split()
        try:
            if line.startswith("NM "):
                name, formula = words[1].upper(), int(float(words[2]))
            elif line.startswith("CD ") and name:
                numbers = tuple(float(v) for v in words[1:])
                found[maker, name] = _of_agf(name, formula, numbers)
            elif line.startswith("LD ") and (maker, name) in found:
                found[maker, name] = _of_agf(name, formula, numbers, float(words[1]), float(words[2]))
        except (ValueError, IndexError):
            raise SpecError(f"{path} line {number}: {line.strip()!r} is not a line of a glass catalogue") from None
    if not found:
        raise SpecError(f"{path} holds no glass; a glass catalogue (.agf) has lines NM and CD for each")
    return GlassCatalogue(found, str(path))


def _of_agf(name: str, formula: int, numbers: tuple[float, ...], low: float = 0.0, high: float = np.inf) -> Glass:
    numbers = (*numbers, *[0.0] * 12)
    if formula in SELLMEIER:
        return Glass(name, "sellmeier", (0.0, *numbers[: 2 * SELLMEIER[formula]]), low, high)
    if formula in POWERS:
        first, *others = zip(numbers, POWERS[formula], strict=False)
        return Glass(name, "powers", (first[0], *(v for pair in others for v in pair)), low, high)
    return Glass(name, f"formula {formula}", (0.0,), low, high)


def glass_named(name: str, makers: tuple[str, ...], catalogue: GlassCatalogue | None) -> Glass:
    """Return a glass by name.

    Raises
    ------
    InvalidParameter
        If no catalogue has it, or its dispersion formula is not supported.
    """
    catalogues = [c for c in (catalogue, bundled_glasses()) if c is not None]
    for each in catalogues:
        if (found := each.find(name, makers)) is not None:
            if found.formula.startswith("formula"):
                raise InvalidParameter(
                    f"glass {name} has dispersion {found.formula} in {each.source}; valid are "
                    f"{', '.join(map(str, sorted([*SELLMEIER, *POWERS])))}"
                )
            return found
    known = {n for c in catalogues for _, n in c.glasses}
    close = difflib.get_close_matches(name.upper(), sorted(known), n=1, cutoff=0.6)
    hint = f"; did you mean {close[0]}?" if close else ""
    raise InvalidParameter(
        f"glass {name} is in none of the catalogues known{hint}; give the one that has it (.agf) as glass_catalogue"
    )
