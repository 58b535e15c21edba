"""Thermal behaviour of a sensor: expansion of its parts and change of the focal length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..base.arguments import check_fields, choice
from ..base.errors import InvalidParameter
from ..base.parameters import Parameter

EXPANSIONS_PPM: dict[str, float] = {
    "abs": 90.0,
    "acrylic": 70.0,
    "aluminium": 23.6,
    "bk7": 7.1,
    "brass": 19.0,
    "carbon_fibre": 1.0,
    "copper": 16.7,
    "fused_silica": 0.55,
    "invar": 1.3,
    "nickel": 13.3,
    "pla": 68.0,
    "polyamide": 80.0,
    "polycarbonate": 66.0,
    "silicon": 2.6,
    "stainless_steel": 16.5,
    "steel": 12.0,
    "titanium": 8.6,
}
"""Linear expansion near room temperature, 1e-6/K (handbook values); plastics vary by 10 %."""
DENSITIES_G_PER_CM3: dict[str, float] = {
    "abs": 1.05,
    "acrylic": 1.19,
    "aluminium": 2.70,
    "bk7": 2.51,
    "brass": 8.50,
    "carbon_fibre": 1.60,
    "copper": 8.96,
    "fused_silica": 2.20,
    "invar": 8.05,
    "nickel": 8.90,
    "pla": 1.24,
    "polyamide": 1.14,
    "polycarbonate": 1.20,
    "silicon": 2.33,
    "stainless_steel": 7.95,
    "steel": 7.85,
    "titanium": 4.51,
}
"""Densities of the same materials, g/cm^3 (handbook values); alloys and plastics vary by a few per
cent."""
INDEX_RATES_PER_K: dict[str, float] = {
    "acrylic": -1.05e-4,
    "polycarbonate": -1.07e-4,
    "bk7": 1.1e-6,
    "fused_silica": 8.6e-6,
    "sapphire": 1.3e-5,
    "water": -1.0e-4,
    "sea_water": -1.0e-4,
    "mineral_oil": -3.8e-4,
}
"""Temperature coefficients of the refractive index near room temperature, 1/K."""
NAMES = tuple(EXPANSIONS_PPM)
EXPANSION = Parameter("ppm/K", -100.0, 1000.0, "linear expansion, instead of a material")
MATERIAL = Parameter("", 0.0, 0.0, "material of the part", NAMES)


@dataclass(frozen=True)
class Thermal:
    """Thermal model of a sensor, with a material or expansion for each part.

    Parameters
    ----------
    reference_c
        Reference temperature of the sensor's parameters, degrees Celsius.
    mirror_material, mirror_ppm_per_k
        Mirror; its shape expands uniformly.
    spacer_material, spacer_ppm_per_k
        Spacer between lens and mirror.
    mount_material, mount_ppm_per_k
        Mount between lens and imager.
    focal_ppm_per_k
        Relative change of the focal length, from a data sheet or a measurement.
    imager_ppm_per_k
        Expansion of the imager; silicon by default.
    held_at
        Attachment of the mirror to the spacer: "vertex", as with a rod behind it, or "rim", as with
        a tube.

    Raises
    ------
    InvalidParameter
        If a number is outside its range, a material is unknown, or both are given for a part.

    Examples
    --------
    >>> thermal = Thermal(mirror_material="acrylic", spacer_ppm_per_k=23.0)
    >>> thermal.expansion_ppm("mirror"), thermal.expansion_ppm("spacer"), thermal.expansion_ppm("mount")
    (70.0, 23.0, 0.0)
    """

    reference_c: float = 20.0
    mirror_material: str | None = None
    mirror_ppm_per_k: float | None = None
    spacer_material: str | None = None
    spacer_ppm_per_k: float | None = None
    mount_material: str | None = None
    mount_ppm_per_k: float | None = None
    focal_ppm_per_k: float = 0.0
    imager_ppm_per_k: float = EXPANSIONS_PPM["silicon"]
    held_at: str = "vertex"

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "reference_c": Parameter(
            "C", -273.0, 1000.0, "reference temperature of the sensor's parameters"
        ),
        "mirror_material": MATERIAL,
        "mirror_ppm_per_k": EXPANSION,
        "spacer_material": MATERIAL,
        "spacer_ppm_per_k": EXPANSION,
        "mount_material": MATERIAL,
        "mount_ppm_per_k": EXPANSION,
        "focal_ppm_per_k": Parameter("ppm/K", -1e4, 1e4, "relative change of the focal length"),
        "imager_ppm_per_k": EXPANSION,
        "held_at": Parameter(
            "", 0.0, 0.0, "attachment of the mirror to the spacer", ("vertex", "rim")
        ),
    }

    def __post_init__(self) -> None:
        check_fields(self)
        for name, parameter in self.PARAMETERS.items():
            if (value := getattr(self, name)) is not None:
                parameter.check(name, value)
        for part in ("mirror", "spacer", "mount"):
            material, ppm = self._material_and_expansion(part)
            if material is not None and ppm is not None:
                raise InvalidParameter(
                    f"{part}_material and {part}_ppm_per_k must not both be given; got {material!r} "
                    f"and {ppm:g}"
                )

    def _material_and_expansion(self, part: str) -> tuple[str | None, float | None]:
        return getattr(self, f"{part}_material"), getattr(self, f"{part}_ppm_per_k")

    def expansion_ppm(self, part: str) -> float:
        """Return the linear expansion of a part, 1e-6/K.

        Parameters
        ----------
        part
            "mirror", "spacer" or "mount".

        Returns
        -------
        float
            0 if it is not specified.

        Raises
        ------
        InvalidParameter
            If the part is unknown.
        """
        choice("part", part, ("mirror", "spacer", "mount"))
        material, ppm = self._material_and_expansion(part)
        return EXPANSIONS_PPM[material] if material is not None else ppm or 0.0
