"""Tables of the sheets: surface parameters, sample points, sensor data, obscurations and
tolerances.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from hashlib import sha256
from typing import Any, cast

import numpy as np

from ...optics.housing import Dome, Tube
from ...optics.lenses import GaussianLens, Orthographic
from ...optics.mirrors import Mirror
from ...optics.sensor import Sensor
from ...optics.tracing.shell_transmission import transmit_from_inside
from ..body import Part, omega_of
from ..formats.sag import format_table, table_points
from ..surface_approximation import best_fit_sphere, conic_parameters
from ..workshop import PartSpecification, TitleBlock
from .image_shift import image_shifts
from .mirror_view import fixed_words, length_words, plus_minus

Rows = list[tuple[str, ...]]
MAX_VALUES = 8
"""Maximum number of printed values of a parameter; longer lists are in the data file."""
MAX_LETTERS = 34
"""Maximum length of a printed file name."""
AS_AGREED, GENERAL = "as agreed", "ISO 10110-11"
"""Texts for unspecified entries, without and with an applicable standard."""
FORMULAS = {
    "even-polynomial": ("z = N Σ c_i (x/N)^(2i), i = 1, 2, ...",),
    "conic-asphere": ("z = conic + N Σ c_i (x/N)^(2i+2)", "conic: x²/(R (1 + √(1 - (1+k) x²/R²)))"),
    "cone": ("z = x tan(slope)",),
    "hyperboloid": ("z = b (√(1 + x²/a²) - 1)",),
    "ellipsoid": ("z = b (1 - √(1 - x²/a²))",),
    "paraboloid": ("z = x²/(2R)",),
    "sphere": ("z = R - √(R² - x²)",),
}
WITHOUT_N = (("N Σ", "Σ"), ("(x/N)^", "x^"))
"""Simplification of the formulas for a normalisation radius N of 1 mm, which is not printed."""
SYMBOLS = {
    "radius_mm": "radius R",
    "vertex_radius_mm": "vertex radius R",
    "conic": "conic constant k",
}
"""Labels of parameters that occur in the formulas."""


@dataclass(frozen=True)
class DataFile:
    """Sag table that a sheet references."""

    name: str
    checksum: str
    """SHA-256 checksum of the file."""

    @classmethod
    def of(
        cls,
        part: Part,
        name: str,
        step_mm: float | None = None,
        step_deg: float | None = None,
        digits: int = 6,
    ) -> DataFile:
        """Create the reference to the sag table of a part."""
        text = sag_text(part, step_mm, step_deg, digits)
        return cls(name, sha256(text.encode()).hexdigest())

    def rows(self) -> Rows:
        first, *others = (self.checksum[i : i + 16] for i in range(0, 64, 16))
        name = (
            self.name if len(self.name) <= MAX_LETTERS else f"{self.name[:12]}..{self.name[-20:]}"
        )
        return [("file", name), ("SHA-256", first), *(("", digits) for digits in others)]


def sag_text(part: Part, step_mm: float | None, step_deg: float | None, digits: int) -> str:
    """Format the sag table of a part."""
    x = table_points(part.sensor, step_mm, step_deg, part.is_secondary)
    return format_table(part.sensor, x, digits, part.is_secondary)


def mirror_rows(
    mirror: Mirror, tolerances: Mapping[str, float] | None = None, has_data_file: bool = True
) -> Rows:
    """Return the formula of a mirror, its parameters with tolerances, and the best-fit sphere.

    Lists of more than :data:`MAX_VALUES` values refer to the data file, or to the sag table without one.
    """
    allocated = tolerances or {}
    rows: Rows = [("type", mirror.KIND)]
    for i, formula in enumerate(FORMULAS.get(mirror.KIND, ())):
        if getattr(mirror, "normalization_radius_mm", None) == 1.0:
            for with_n, without in WITHOUT_N:
                formula = formula.replace(with_n, without)
        rows.append(("" if i else "form", formula))
    for f in fields(cast(Any, mirror)):
        value, p = getattr(mirror, f.name), mirror.PARAMETERS[f.name]
        name = SYMBOLS.get(f.name) or f.name.removesuffix("_mm").removesuffix("_deg").replace(
            "_", " "
        )
        name = "N" if f.name == "normalization_radius_mm" else name
        if isinstance(value, tuple):
            rows += _listed(name, value, allocated, has_data_file)
        elif isinstance(value, str):
            rows.append((name, value))
        elif value is not None and not (name == "N" and value == 1.0):
            rows.append(
                (
                    name,
                    plus_minus(f"{value:.9g}", _tolerance_of(f.name, allocated))
                    + f" {p.unit}".rstrip(),
                )
            )
    radius = float(mirror.radius_t(0.0))
    if not mirror.is_pointed and np.isfinite(radius) and not _is_specified(radius, mirror):
        rows.append(
            (
                "vertex radius R",
                plus_minus(f"{radius:.9g}", allocated.get("mirror.vertex_radius_mm")) + " mm",
            )
        )
    if (
        "mirror.conic" in allocated
        and "conic" not in mirror.PARAMETERS
        and (conic := conic_parameters(mirror))
    ):
        rows.append(("conic constant k", plus_minus(f"{conic[1]:.6g}", allocated["mirror.conic"])))
    sphere = best_fit_sphere(mirror)
    if sphere.peak_to_valley_um < 1e-3:
        return rows
    return [
        *rows,
        ("best-fit sphere, radius", f"{sphere.radius_mm:.4f} mm"),
        ("departure, P-V", _departure_words(sphere.peak_to_valley_um)),
        ("RMS", _departure_words(sphere.rms_um)),
    ]


def _tolerance_of(name: str, allocated: Mapping[str, float]) -> float | None:
    """Return the tolerance of a parameter; the radius of a sphere is its vertex radius."""
    return allocated.get("mirror.vertex_radius_mm" if name == "radius_mm" else f"mirror.{name}")


def _listed(
    name: str, values: tuple[float, ...], allocated: Mapping[str, float], has_data_file: bool
) -> Rows:
    if len(values) > MAX_VALUES:
        return [
            (
                name,
                f"{len(values)} values, "
                + ("in the data file" if has_data_file else "see the sag table (csv)"),
            )
        ]
    tolerances = (allocated.get(f"mirror.{name}[{i}]") for i in range(len(values)))
    label = "c" if name == "coefficients" else name
    return [
        (f"{label} {i}", plus_minus(f"{value:.9g}", tolerance))
        for i, (value, tolerance) in enumerate(zip(values, tolerances, strict=True), start=1)
    ]


def _is_specified(radius_mm: float, mirror: Mirror) -> bool:
    """Return whether the vertex radius is a parameter of the mirror."""
    own = (
        getattr(mirror, name)
        for name in ("radius_mm", "vertex_radius_mm")
        if name in mirror.PARAMETERS
    )
    return any(abs(value - radius_mm) < 1e-9 * radius_mm for value in own)


def _departure_words(um: float) -> str:
    return f"{um:.4g} µm" if um < 1000 else f"{um / 1000:.4g} mm"


def sag_rows(part: Part, count: int) -> Rows:
    """Return sample points of the surface for inspection, including the rim."""
    rim = part.mirror.rim_radius_mm
    steps = (a * 10.0**n for n in range(-6, 6) for a in (1, 2, 5))
    step = next(s for s in steps if rim / s <= max(count - 1, 1))
    x = np.append(
        step * np.arange(int(np.ceil(rim / step - 0.2))), rim
    )  # omit a point close to the rim
    z, slope, _ = part.mirror.profile(x)
    omega = omega_of(part.sensor, x, part.is_secondary)
    rows = zip(x, z, np.degrees(np.arctan(slope)), np.degrees(omega), strict=True)
    head = ("x mm", "z mm", "slope °", "Ω °")
    return [
        head,
        *(
            (
                length_words(a),
                fixed_words(b, 4),
                fixed_words(c, 3),
                fixed_words(d, 2) if np.isfinite(d) else "obscured",
            )
            for a, b, c, d in rows
        ),
    ]


def sensor_rows(sensor: Sensor) -> Rows:
    low, high = sensor.field_deg
    if sensor.lens.TELECENTRIC:
        wide = cast(Orthographic, sensor.lens)
        lens = [
            ("lens", f"telecentric, {wide.magnification:g} ×"),
            ("working F-number", f"{wide.working_f_number:g}"),
        ]
        lens.append(("focus distance from the vertex", f"{wide.focus_distance_mm:g} mm"))
    else:
        near = cast(GaussianLens, sensor.lens)
        lens = [("lens", f"f = {near.focal_length_mm:g} mm, F/{near.f_number:g}")]
        lens.append(("focus distance", f"{near.focus_distance_mm:g} mm"))
    imager = sensor.imager
    if sensor.secondary is not None:
        lens.append(("bore for the beam", f"Ø{length_words(beam_in_bore_mm(sensor))}"))
    return [
        *lens,
        ("imager", f"{imager.width_px} × {imager.height_px} of {imager.pixel_pitch_um:g} µm"),
        ("field Ω from the axis", f"{low:.4g}° to {high:.6g}°"),
        ("image radius of the rim", f"{sensor.rim_radius_px:.1f} px"),
    ]


def obscuration_rows(sensor: Sensor) -> Rows:
    """Return the obscurations, and the lateral shift and the transmission of a tube or dome."""
    rows: Rows = [
        (
            ring.part,
            f"Ω {ring.omega_deg[0]:.1f}° to {ring.omega_deg[1]:.1f}°",
            f"{ring.image_percent:.2f} %",
        )
        for ring in sensor.obscurations
    ]
    rows.append(
        (
            "total, all azimuths",
            "",
            f"{sum(ring.image_percent for ring in sensor.obscured):.2f} %",
        )
    )
    shell = sensor.obstructions.housing.shell
    if isinstance(shell, Tube | Dome):
        shell = shell.centred()
        low, high = sensor.field_deg
        for omega in sorted({min(max(90.0, low), high), high}):
            rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians([omega])))
            points = np.stack(
                [rays.x, 0 * rays.x, rays.z + sensor.mirror_pose.displacement_mm], axis=-1
            )
            towards = np.stack(
                [np.sin(rays.reflected), 0 * rays.x, -np.cos(rays.reflected)], axis=-1
            )
            passed = 100 * float(transmit_from_inside(shell, points, towards).passed[0])
            x, z = rays.start
            shift = float(np.hypot(x - rays.x, z - rays.z)[0])
            rows.append(
                (f"{shell.KIND} at Ω = {omega:.4g}°", f"shift {shift:.2f} mm", f"{passed:.1f} %")
            )
    return rows


def tolerance_rows(sensor: Sensor) -> Rows:
    """Return the errors that shift the image by at most 0.5 px."""
    rows: Rows = [("", "", "at Ω")]
    for s in image_shifts(sensor):
        unit = {"um": "µm", "deg": "°"}.get(s.unit, s.unit)
        if s.px_per_unit:
            rows.append((s.name, f"± {s.tolerance(0.5):.3g} {unit}", f"{s.omega_deg:.0f}°"))
        else:
            rows.append((s.name, "no effect", ""))
    return rows


ERROR_WORDS = {
    "mirror.decentre_x_mm": "mirror decentre x",
    "mirror.decentre_y_mm": "mirror decentre y",
    "mirror.displacement_mm": "mirror spacing",
    "mirror.tilt_x_deg": "mirror tilt about x",
    "mirror.tilt_y_deg": "mirror tilt about y",
}
UNITS = {"um": "µm", "deg": "°", "mm": "mm", "px": "px", "ppm": "ppm"}
OF_PART = ("mirror.vertex_radius_mm", "mirror.conic", "mirror.coefficients", "mirror.zernike")
"""Errors whose tolerances are listed on the sheet of the mirror."""


def allocated_rows(tolerances: Mapping[str, float]) -> Rows:
    """Return tolerances of position, lens and imager; shape tolerances are on the part sheet."""
    rows: Rows = []
    for name, value in tolerances.items():
        if name.startswith(OF_PART) or not value:
            continue
        stem, _, unit = name.rpartition("_")
        description = ERROR_WORDS.get(name) or (stem if unit in UNITS else name).replace(
            ".", " "
        ).replace("_", " ")
        rows.append((description, f"± {value:.3g} {UNITS.get(unit, '')}".rstrip()))
    return rows


def form_rms_um(tolerances: Mapping[str, float]) -> float | None:
    """Compute the axial RMS form error of uniformly distributed Zernike terms.

    >>> form_rms_um({"mirror.zernike_4_um": 0.3, "mirror.zernike_11_um": 0.4})
    0.288...
    """
    terms = [value for name, value in tolerances.items() if name.startswith("mirror.zernike")]
    return float(np.sqrt(sum(value * value for value in terms) / 3)) if any(terms) else None


def indication_rows(
    part: Part, specification: PartSpecification, tolerances: Mapping[str, float], title: TitleBlock
) -> Rows:
    """Return the indications of a mirror surface in the codes of ISO 10110."""
    mass = mass_words(part, specification)
    texture = specification.surface_roughness_nm
    return [
        ("material", specification.material or AS_AGREED),
        *([("mass", mass)] if mass else []),
        ("clear aperture", f"Øe {length_words(2 * part.mirror.rim_radius_mm)}"),
        ("form", form_code(specification, tolerances)),
        ("centring to A, B", centring_code(specification, tolerances)),
        (
            "imperfections",
            f"5/{specification.imperfections}" if specification.imperfections else f"5/ {GENERAL}",
        ),
        ("texture", f"Rq {texture:g} nm" if texture is not None else AS_AGREED),
        ("coating", specification.coating or AS_AGREED),
        ("edges broken", f"{specification.chamfer_mm:g} × 45°"),
        ("other sizes", title.general_tolerances),
    ]


def mass_words(part: Part, specification: PartSpecification) -> str:
    """Format the mass of a mirror; empty if its density is unknown."""
    density = specification.density
    return (
        ""
        if density is None
        else f"{_written(density * part.body.volume_mm3(part.mirror) / 1000)} g"
    )


def _written(value: float) -> str:
    """Format a number with three significant digits, without an exponent."""
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def form_code(specification: PartSpecification, tolerances: Mapping[str, float]) -> str:
    """Return code 3/ (ISO 10110-5): the specified peak-to-valley error or the allocated RMS."""
    if specification.form_um is not None:
        return f"3/{1000 * specification.form_um:.4g} nm"
    rms = form_rms_um(tolerances)
    return f"3/ {GENERAL}" if rms is None else f"3/- RMSt < {_written(1000 * rms)} nm"


def centring_code(specification: PartSpecification, tolerances: Mapping[str, float]) -> str:
    """Return code 4/ (ISO 10110-6): specified values, or half of the allocated ones.

    The other half is available to the mount.
    """
    tilt, away = specification.centring_deg, specification.centring_mm
    tilt = _half(tolerances, "mirror.tilt_x_deg", "mirror.tilt_y_deg") if tilt is None else tilt
    away = (
        _half(tolerances, "mirror.decentre_x_mm", "mirror.decentre_y_mm") if away is None else away
    )
    if tilt is None and away is None:
        return f"4/ {GENERAL}"
    angle = "-" if tilt is None else f"{60 * tilt:.3g}'"
    return f"4/{angle}" + ("" if away is None else f" ({away:.3g} mm)")


def _half(tolerances: Mapping[str, float], *names: str) -> float | None:
    allocated = [tolerances[name] for name in names if tolerances.get(name)]
    return min(allocated) / 2 if allocated else None


def beam_in_bore_mm(sensor: Sensor) -> float:
    """Compute the diameter of the light beam at the entrance of the bore, including the pupil."""
    assert sensor.secondary is not None
    bore = sensor.secondary.bore_radius_mm
    lens = sensor.secondary.lens_height(sensor.mirror_distance_mm)
    way = max(lens - float(sensor.mirror.sag(min(bore, sensor.mirror.rim_radius_mm))), 0.0)
    if sensor.lens.TELECENTRIC:
        return 2 * float(sensor.meridian.trace(np.array(sensor.mirror.rim_radius_mm)).first.x)
    near = cast(GaussianLens, sensor.lens)
    return 2 * way * float(np.tan(sensor.meridian.theta_max)) + near.focal_length_mm / near.f_number
