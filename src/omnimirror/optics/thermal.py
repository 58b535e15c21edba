"""Thermal behaviour of a sensor: expansion of its parts and change of the focal length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..base.arguments import check_fields, choice
from ..base.errors import InvalidParameter
from ..base.parameters import Parameter

# Sources of expansions and densities: ASM Handbook, volume 2, for aluminium 6061 (20 to 100 C),
# copper C11000, nickel 200 and titanium grade 2; Carpenter Invar 36 (25 to 93 C); stainless steel:
# mean of AISI 304 (17.2) and 316 (15.9); Schott N-BK7 (-30 to 70 C); Corning 7980; sapphire:
# Crystran, mean of both axes; silicon: CRC Handbook; acrylic: Plexiglas GS. Brass, carbon fibre,
# steel and the other plastics depend on grade and filler: mean values of data sheets.
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
    "sapphire": 5.3,
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
    "sapphire": 3.98,
    "silicon": 2.33,
    "stainless_steel": 7.95,
    "steel": 7.85,
    "titanium": 4.51,
}
"""Densities of the same materials, g/cm^3 (handbook values); alloys and plastics vary by a few per
cent."""
# The indices of optics/housing/materials.py are relative to air, and so are these rates. A data sheet
# that lists dn/dT in vacuum requires dn_rel/dT = dn_abs/dT - n dn_air/dT with dn_air/dT = -0.92e-6/K at
# 20 C and constant pressure (Schott TIE-19); this adds 1.4e-6/K to glass, and is negligible for plastics
# and liquids.
INDEX_RATES_PER_K: dict[str, float] = {
    "acrylic": -1.05e-4,  # 589 nm, 20 C; Waxler, Horowitz and Feldman, Appl. Opt. 18, 101 (1979)
    "polycarbonate": -1.07e-4,  # value of acrylic
    "bk7": 3.0e-6,  # 546 nm, 20 to 40 C; Schott N-BK7 (1.6e-6 in vacuum)
    "fused_silica": 1.0e-5,  # 589 nm, 20 C; 8.6e-6 in vacuum: Leviton and Frey, Proc. SPIE 6273, 62732K (2006)
    "sapphire": 1.31e-5,  # ordinary ray, 546 nm; Crystran
    "water": -1.0e-4,  # 589 nm, 20 to 25 C; CRC Handbook
    "sea_water": -1.0e-4,  # 35 g/kg, 589 nm, 20 C; Quan and Fry, Appl. Opt. 34, 3477 (1995)
    "mineral_oil": -3.8e-4,  # 589 nm, 25 C; Cargille immersion oils
}
"""Temperature coefficients of the refractive index relative to air, visible light, 1/K."""
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
                    f"{part}_material and {part}_ppm_per_k must not both be given; got {material!r} and {ppm:g}"
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
