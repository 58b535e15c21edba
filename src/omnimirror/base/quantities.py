"""Quantities that are evaluated, limited, compared, minimised or plotted.

A quantity has the same name in Python, files, command line and studio; a name with a unit ends with
it. Columns of an evaluation, limits of a requirement, rows of a comparison, merits, table heads and
labels of plots use this vocabulary. Equations are those of the paper (Ohte and Tsuzuki, Opt. Eng.
51(1), 013005, 2012), with its errata corrected.

``_t`` is tangential (along the image radius), ``_s`` sagittal (perpendicular to it).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from inspect import cleandoc
from typing import TypeVar

T = TypeVar("T", bound=type)


@dataclass(frozen=True)
class Quantity:
    """Description of a quantity.

    Attributes
    ----------
    name
        Name in columns, files and options, with its unit.
    symbol
        Symbol in the paper and in plots; ``_t`` is a subscript.
    unit
        Unit for display.
    title
        Title of a plot or of a table row, one or two words.
    meaning
        Description in one line.
    equation
        Formula and equation number of the paper, if any.
    format
        Number format in tables, as for :func:`format`.
    head
        Column head, if the symbol alone is not sufficient.

    Examples
    --------
    >>> h = QUANTITIES["h_px"]
    >>> h.symbol, h.unit, h.title, h.equation, h.text(212.3456)
    ('h', 'px', 'Image height', 'h = b tan θ, Eq. 7', '212.35')
    """

    name: str
    symbol: str
    unit: str
    title: str
    meaning: str
    equation: str = ""
    format: str = ".2f"
    head: str = ""

    @property
    def heading(self) -> str:
        """Column head without the unit."""
        return self.head or self.symbol

    def text(self, value: float) -> str:
        """Format a value for tables."""
        return f"{value:{self.format}}"


# -- Real lens, at each field angle ------------------------------------------------------------

LENS_QUANTITIES = (
    Quantity(
        "lens_blur_t_px",
        "δ_t",
        "px",
        "Lens blur T",
        "tangential blur of the lens without defocus, four standard deviations of its rays",
        format=".3f",
    ),
    Quantity(
        "lens_blur_s_px",
        "δ_s",
        "px",
        "Lens blur S",
        "sagittal blur of the lens without defocus, four standard deviations of its rays",
        format=".3f",
    ),
    Quantity(
        "lens_illumination",
        "E/E_0",
        "",
        "Relative illumination of the lens",
        "illumination of the imager by a uniform scene, relative to the axis",
        format=".3f",
        head="illumination",
    ),
    Quantity(
        "lateral_colour_px",
        "Δh_λ",
        "px",
        "Lateral colour",
        "image height at the shortest wavelength minus that at the longest",
        format=".3f",
        head="lateral colour",
    ),
    Quantity(
        "entrance_pupil_mm",
        "z_p",
        "mm",
        "Entrance pupil",
        "axial position of the entrance pupil from the reference point of the lens, positive towards the mirror",
        format=".3f",
        head="pupil",
    ),
)
"""Quantities in :attr:`omnimirror.analysis.evaluation.Evaluation.of_lens`."""

# -- At each field angle ---------------------------------------------------------------------------

FIELD_QUANTITIES = (
    Quantity(
        "omega_deg",
        "Ω",
        "deg",
        "Field angle",
        "angle of the object direction from the axis, which points from the mirror past the lens",
        "Ω = 2β + θ, Eq. 4",
        ".6g",
    ),
    Quantity(
        "x_mm", "x", "mm", "Mirror point radius", "distance of the mirror point from the axis"
    ),
    Quantity(
        "z_mm",
        "z",
        "mm",
        "Mirror point height",
        "height of the mirror point above the vertex",
        "z = f(x), Eq. 1",
    ),
    Quantity(
        "beta_deg", "β", "deg", "Slope angle", "slope of the mirror", "tan β = z', Eq. 2", ".3f"
    ),
    Quantity(
        "theta_deg",
        "θ",
        "deg",
        "Viewing angle",
        "angle between the ray at the lens and its axis",
        "tan θ = x / (m + z), Eq. 5",
        ".3f",
    ),
    Quantity(
        "gamma_deg",
        "γ",
        "deg",
        "Angle of incidence",
        "angle of incidence and of reflection",
        "γ = β + θ, Eq. 3",
        ".3f",
    ),
    Quantity(
        "h_px",
        "h",
        "px",
        "Image height",
        "distance of the image point from the image centre at the specified focus",
        "h = b tan θ, Eq. 7",
    ),
    Quantity(
        "dh_domega_px_per_deg",
        "Δh",
        "px/deg",
        "Resolution T",
        "image size of one degree in the radial direction, at the object distance",
        "Δh = dh/dΩ / (1 + (cos γ / cos β) / (p dΩ/dx)), Eqs. 8, 9",
        ".3f",
    ),
    Quantity(
        "width_px_per_deg",
        "Δw",
        "px/deg",
        "Resolution S",
        "image size of one degree in the azimuthal direction, at the object distance",
        "Δw = 2π h / (360 (sin Ω + x/p)), Eq. 10",
        ".3f",
    ),
    Quantity(
        "area_px2",
        "Δs",
        "px²",
        "Image area",
        "image area of one square degree",
        "Δs = Δh Δw, Eq. 11",
    ),
    Quantity(
        "aspect",
        "Δw/Δh",
        "",
        "Aspect",
        "width-to-height ratio of the image of a small square",
        "Δw / Δh, Eq. 12",
        ".3f",
        "aspect",
    ),
    Quantity(
        "viewpoint_z_mm",
        "z_v",
        "mm",
        "Viewpoint",
        "height above the vertex at which the chief ray intersects the axis",
        "z_v = z + x / tan Ω, Eq. 6",
        head="viewpoint",
    ),
    Quantity(
        "radius_t_mm",
        "R_t",
        "mm",
        "Tangential radius",
        "radius of curvature in the meridian",
        "R_t = (1 + z'²)^1.5 / z'', Eq. 14",
    ),
    Quantity(
        "radius_s_mm",
        "R_s",
        "mm",
        "Sagittal radius",
        "radius of curvature across the meridian",
        "R_s = x √(1 + z'²) / z', Eq. 18",
    ),
    Quantity(
        "q_t_mm",
        "q_t",
        "mm",
        "Tangential image distance",
        "from the mirror point to the tangential virtual image, positive behind the mirror",
        "1/q_t = 1/p + 2 / (R_t cos γ), Eq. 15",
    ),
    Quantity(
        "q_s_mm",
        "q_s",
        "mm",
        "Sagittal image distance",
        "from the mirror point to the sagittal virtual image, positive behind the mirror",
        "1/q_s = 1/p + 2 cos γ / R_s, Eq. 19",
    ),
    Quantity(
        "image_t_x_mm",
        "x_t",
        "mm",
        "Tangential image, radius",
        "distance of the tangential virtual image from the axis",
        "x_t = x + q_t sin θ, Eq. 16",
    ),
    Quantity(
        "image_t_z_mm",
        "z_t",
        "mm",
        "Tangential image, height",
        "height of the tangential virtual image above the vertex",
        "z_t = z + q_t cos θ, Eq. 17",
    ),
    Quantity(
        "image_s_x_mm",
        "x_s",
        "mm",
        "Sagittal image, radius",
        "distance of the sagittal virtual image from the axis",
        "x_s = x + q_s sin θ, Eq. 20",
    ),
    Quantity(
        "image_s_z_mm",
        "z_s",
        "mm",
        "Sagittal image, height",
        "height of the sagittal virtual image above the vertex",
        "z_s = z + q_s cos θ, Eq. 21",
    ),
    Quantity(
        "distance_t_mm",
        "L_t",
        "mm",
        "Lens to tangential image",
        "from the lens (telecentric: from the vertex) to the tangential virtual image",
        "L_t = m + z_t, Eq. 34",
    ),
    Quantity(
        "distance_s_mm",
        "L_s",
        "mm",
        "Lens to sagittal image",
        "from the lens (telecentric: from the vertex) to the sagittal virtual image",
        "L_s = m + z_s, Eq. 35",
    ),
    Quantity(
        "blur_t_px",
        "Δ_t",
        "px",
        "Blur T",
        "diameter of the tangential blur, positive beyond the focus",
        "Δ_t = (f b0/F) (1/L0 - 1/L_t), Eq. 28; Eq. 29 in the paper's mode",
        head="blur T",
    ),
    Quantity(
        "blur_s_px",
        "Δ_s",
        "px",
        "Blur S",
        "diameter of the sagittal blur, positive beyond the focus",
        "Δ_s = (f b0/F) (1/L0 - 1/L_s), Eq. 28; Eq. 29 in the paper's mode",
        head="blur S",
    ),
    Quantity(
        "blur_t_deg",
        "Δ_t/Δh",
        "deg",
        "Blur T",
        "tangential blur as an object angle",
        "Δ_t / Δh, Eq. 36",
        ".3f",
        "blur T",
    ),
    Quantity(
        "blur_s_deg",
        "Δ_s/Δw",
        "deg",
        "Blur S",
        "sagittal blur as an object angle",
        "Δ_s / Δw, Eq. 37",
        ".3f",
        "blur S",
    ),
    Quantity(
        "blur_area_deg2",
        "T×S",
        "deg²",
        "Blur area",
        "signed product of tangential and sagittal blur as object angles",
        "Δ_t Δ_s / (Δh Δw), Fig. 9c",
        ".3f",
    ),
    Quantity(
        "floored_area_deg2",
        "A",
        "deg²",
        "Floored blur area",
        "blur area with a pixel and the Airy disc added in quadrature to each side",
        "√((Δ_t² + 1 + Airy²) (Δ_s² + 1 + Airy²)) / (Δh Δw)",
        ".3f",
        "blur area",
    ),
    Quantity(
        "plane_t_mm_per_px",
        "g_t,p",
        "mm/px",
        "Object size T on a plane",
        "length per pixel in the radial direction on a plane perpendicular to the axis at the object distance",
        "p (π/180) / (Δh |cos Ω|)",
        ".4g",
        "plane T",
    ),
    Quantity(
        "cylinder_t_mm_per_px",
        "g_t,c",
        "mm/px",
        "Object size T on a cylinder",
        "length per pixel in the radial direction on a cylinder about the axis at the object distance",
        "p (π/180) / (Δh sin Ω)",
        ".4g",
        "cylinder T",
    ),
    Quantity(
        "object_s_mm_per_px",
        "g_s",
        "mm/px",
        "Object size S",
        "length per pixel in the azimuthal direction at the object distance, on a plane or cylinder",
        "p (π/180) / Δw = (x + p sin Ω) / h",
        ".4g",
        "object S",
    ),
)
"""Columns of an evaluation, in their order: values at each field angle."""

DERIVED_QUANTITIES = (
    Quantity(
        "plane_mm_per_px",
        "max(g_t,p, g_s)",
        "mm/px",
        "Object size on a plane",
        "larger of tangential and sagittal length per pixel on a plane perpendicular to the axis",
        format=".4g",
    ),
    Quantity(
        "cylinder_mm_per_px",
        "max(g_t,c, g_s)",
        "mm/px",
        "Object size on a cylinder",
        "larger of tangential and sagittal length per pixel on a cylinder about the axis",
        format=".4g",
    ),
    Quantity("blur_px", "max(Δ_t, Δ_s)", "px", "Blur", "larger of tangential and sagittal blur"),
    Quantity(
        "blur_deg",
        "max(Δ_t/Δh, Δ_s/Δw)",
        "deg",
        "Blur",
        "larger of tangential and sagittal blur as object angles",
        format=".3f",
    ),
    Quantity(
        "blur_rss_deg",
        "√(T² + S²)",
        "deg",
        "Blur, root sum of squares",
        "root sum of squares of tangential and sagittal blur as object angles",
        format=".3f",
    ),
    Quantity(
        "total_blur_t_px",
        "",
        "px",
        "Total blur T",
        "tangential blur, with the Airy disc in quadrature",
        "√(Δ_t² + Airy²)",
    ),
    Quantity(
        "total_blur_s_px",
        "",
        "px",
        "Total blur S",
        "sagittal blur, with the Airy disc in quadrature",
        "√(Δ_s² + Airy²)",
    ),
    Quantity(
        "total_blur_px",
        "",
        "px",
        "Total blur",
        "larger of tangential and sagittal blur, with the Airy disc in quadrature",
    ),
    Quantity(
        "total_blur_t_deg",
        "",
        "deg",
        "Total blur T",
        "tangential blur as an object angle, with the Airy disc in quadrature",
        "√(Δ_t² + Airy²) / Δh",
        ".3f",
    ),
    Quantity(
        "total_blur_s_deg",
        "",
        "deg",
        "Total blur S",
        "sagittal blur as an object angle, with the Airy disc in quadrature",
        "√(Δ_s² + Airy²) / Δw",
        ".3f",
    ),
    Quantity(
        "total_blur_deg",
        "",
        "deg",
        "Total blur",
        "larger of tangential and sagittal blur as object angles, with the Airy disc in quadrature",
        format=".3f",
    ),
    Quantity(
        "resolution_px_per_deg",
        "min(Δh, Δw)",
        "px/deg",
        "Resolution",
        "smaller of tangential and sagittal resolution",
    ),
)
"""Quantities derived from the columns at each field angle."""

CALIBRATION_QUANTITIES = (
    Quantity(
        "direction_sigma_deg",
        "σ",
        "deg",
        "Direction error, 1 sigma",
        "standard deviation of a direction, propagated from the covariance of a calibration",
        format=".4f",
        head="error",
    ),
)
"""Quantities of a calibrated camera at each field angle, in addition to some columns of an
evaluation.
"""

# -- Sensor ------------------------------------------------------------------------------

SENSOR_QUANTITIES = (
    Quantity("mirror", "", "", "Mirror", "shape of the mirror"),
    Quantity("secondary", "", "", "Secondary mirror", "shape of the secondary mirror"),
    Quantity(
        "f_number",
        "F",
        "",
        "F-number",
        "F-number of the lens; image-side F-number of a telecentric lens",
        format=".3g",
        head="F-number",
    ),
    Quantity(
        "field_from_deg",
        "Ω_min",
        "deg",
        "Minimum field angle",
        "smallest field angle in the image",
        format=".1f",
    ),
    Quantity(
        "field_to_deg",
        "Ω_max",
        "deg",
        "Maximum field angle",
        "field angle at the rim",
        format=".1f",
    ),
    Quantity(
        "sphere_coverage_percent",
        "",
        "%",
        "Sphere coverage",
        "fraction of all directions that is in the field",
        "50 (cos Ω_min - cos Ω_max)",
        ".1f",
    ),
    Quantity(
        "rim_radius_px",
        "N",
        "px",
        "Image circle radius",
        "image height of the mirror rim",
        format=".1f",
    ),
    Quantity(
        "nonlinearity_percent",
        "",
        "%",
        "Nonlinearity of the mapping",
        "largest deviation of h(Ω) from the straight line through centre and rim, relative to h at the rim",
    ),
    Quantity(
        "viewpoint_spread_mm",
        "",
        "mm",
        "Viewpoint spread",
        "range of the viewpoints along the axis",
        "max z_v - min z_v",
        ".3f",
    ),
    Quantity(
        "single_viewpoint_error_px",
        "",
        "px",
        "Single-viewpoint error at 1 m",
        "largest error of the best single viewpoint for objects at 1 m",
        "Eq. 23",
    ),
    Quantity(
        "focus_mm", "L0", "mm", "Focus", "object distance in focus", format=".1f", head="focus"
    ),
    Quantity(
        "best_focus_mm",
        "L0",
        "mm",
        "Best focus",
        "focus that minimises the worst floored blur area",
        format=".1f",
    ),
    Quantity(
        "depth_of_field_mm",
        "",
        "mm",
        "Depth of field",
        "range of object distances within the permissible blur",
        "f² L0 / (f² ∓ δ F (L0 - f)), Eqs. 30, 31",
        ".1f",
    ),
    Quantity("airy_px", "Airy", "px", "Airy disc", "diameter of the Airy disc", "2.44 λ F b0/f"),
    Quantity(
        "length_mm",
        "",
        "mm",
        "Length from the lens",
        "axial length from the lens, or a secondary mirror in front of it, to the far end of the mirror; "
        "telecentric: from the vertex",
        format=".1f",
    ),
    Quantity(
        "total_track_mm",
        "",
        "mm",
        "Total track",
        "axial length from the imager to the far end of the mirror; telecentric: from the vertex",
        format=".1f",
    ),
    Quantity(
        "mirror_diameter_mm",
        "2M",
        "mm",
        "Mirror diameter",
        "diameter of the mirror rim",
        format=".1f",
    ),
    Quantity("sag_mm", "", "mm", "Mirror sag", "height of the mirror along its axis", format=".1f"),
    Quantity(
        "obscured_to_deg",
        "",
        "deg",
        "Central obscuration",
        "field angle up to which the housing obscures the view, from the image centre",
        format=".1f",
    ),
    Quantity(
        "obscured_percent",
        "",
        "%",
        "Obscured image fraction",
        "fraction of the image circle that the housing obscures",
        format=".1f",
    ),
    Quantity(
        "overall_diameter_mm",
        "",
        "mm",
        "Overall diameter",
        "largest diameter of mirror, rim, cover and camera front",
        format=".1f",
    ),
    Quantity(
        "overall_height_mm",
        "",
        "mm",
        "Overall height",
        "axial length from the imager to the back of the mirror body; telecentric: of the mirror body",
        format=".1f",
    ),
    Quantity(
        "mirror_body_mass_g",
        "",
        "g",
        "Mirror mass",
        "mass of the mirror body, with the material in [thermal] or aluminium",
        format=".1f",
    ),
    Quantity(
        "rim_slope_deg",
        "",
        "deg",
        "Slope at the rim",
        "slope of the mirror at its rim",
        format=".1f",
    ),
)
"""Quantities of the whole sensor."""

APERTURE_QUANTITIES = (
    Quantity(
        "chief_px",
        "h",
        "px",
        "Chief ray image height",
        "distance of the chief ray from the image centre",
        format=".3f",
    ),
    Quantity(
        "rms_radius_px",
        "rms",
        "px",
        "RMS spot radius",
        "rms distance of the rays of a spot from their centroid",
        "√(mean of t² + s²)",
        ".3f",
    ),
    Quantity(
        "rms_t_px",
        "rms T",
        "px",
        "RMS spot size T",
        "rms size of a spot in the radial direction",
        format=".3f",
    ),
    Quantity(
        "rms_s_px",
        "rms S",
        "px",
        "RMS spot size S",
        "rms size of a spot in the azimuthal direction",
        format=".3f",
    ),
    Quantity(
        "extent_t_px",
        "width T",
        "px",
        "Spot width T",
        "extent of all rays of a spot in the radial direction",
        format=".3f",
    ),
    Quantity(
        "extent_s_px",
        "width S",
        "px",
        "Spot width S",
        "extent of all rays of a spot in the azimuthal direction",
        format=".3f",
    ),
    Quantity(
        "edge_t_px",
        "",
        "px",
        "Edge ray error T",
        "distance of the two edge rays in the radial direction minus the blur",
        format=".4f",
        head="edges T",
    ),
    Quantity(
        "edge_s_px",
        "",
        "px",
        "Edge ray error S",
        "distance of the two edge rays in the azimuthal direction minus the blur",
        format=".4f",
        head="edges S",
    ),
    Quantity(
        "offset_t_px",
        "",
        "px",
        "Tangential",
        "offset from the chief ray in the radial direction",
    ),
    Quantity(
        "offset_s_px", "", "px", "Sagittal", "offset from the chief ray in the azimuthal direction"
    ),
    Quantity(
        "strehl",
        "",
        "",
        "Strehl ratio",
        "peak of the PSF relative to the PSF without aberrations",
        format=".3g",
        head="Strehl",
    ),
    Quantity(
        "encircled_energy",
        "",
        "",
        "Encircled energy",
        "fraction of the light within a radius about the centroid",
    ),
    Quantity(
        "encircled_radius_px",
        "r",
        "px",
        "Radius about the centroid",
        "radius of the circle for the encircled energy",
    ),
    Quantity(
        "ensquared_energy",
        "",
        "",
        "Ensquared energy",
        "largest fraction of the light within one pixel",
        format=".3f",
        head="ensquared",
    ),
    Quantity(
        "cycles_per_px",
        "",
        "cycles/px",
        "Spatial frequency",
        "spatial frequency on the imager, per pixel",
        format=".3g",
    ),
    Quantity(
        "lp_per_mm",
        "",
        "lp/mm",
        "Spatial frequency",
        "spatial frequency on the imager, per mm",
        format=".4g",
    ),
    Quantity(
        "mtf_t",
        "MTF T",
        "",
        "MTF T",
        "contrast of modulation in the radial direction",
        format=".3f",
    ),
    Quantity(
        "mtf_s",
        "MTF S",
        "",
        "MTF S",
        "contrast of modulation in the azimuthal direction",
        format=".3f",
    ),
    Quantity(
        "mtf",
        "MTF",
        "",
        "MTF",
        "smaller of tangential and sagittal MTF, from diffraction, defocus and pixel",
        format=".3f",
    ),
    Quantity(
        "irradiance_sr",
        "E / L",
        "sr",
        "Irradiance",
        "irradiance on the imager relative to the radiance of a uniform scene",
        format=".5f",
    ),
    Quantity(
        "relative",
        "",
        "",
        "Relative illumination",
        "irradiance relative to its maximum over the field",
        format=".4f",
        head="relative",
    ),
    Quantity(
        "reflectance",
        "R",
        "",
        "Reflectance",
        "reflectance of the mirror at the angle of incidence",
        format=".4f",
    ),
    Quantity(
        "filled",
        "",
        "",
        "Unvignetted aperture",
        "unvignetted fraction of the aperture",
        format=".4g",
        head="unvignetted",
    ),
    Quantity(
        "viewpoint_error_px",
        "",
        "px",
        "Single-viewpoint error",
        "image distance between an object and its projection from a single viewpoint",
        "Eq. 23",
    ),
)
"""Quantities from tracing the whole aperture."""

AS_BUILT_QUANTITIES = (
    Quantity(
        "motion_px",
        "",
        "px",
        "Image shift",
        "largest image shift of an object relative to the sensor without errors",
    ),
    Quantity(
        "motion_rms_px",
        "",
        "px",
        "Image shift, rms",
        "rms image shift over the field relative to the sensor without errors",
    ),
    Quantity(
        "direction_error_deg",
        "",
        "deg",
        "Direction error",
        "largest angle between an object and its direction according to the sensor without errors",
        format=".3f",
    ),
    Quantity(
        "direction_error_rms_deg",
        "",
        "deg",
        "Direction error, rms",
        "rms angle over the field between objects and their directions according to the sensor without errors",
        format=".3f",
    ),
    Quantity(
        "straightness_deg",
        "",
        "deg",
        "Straightness",
        "largest deviation of straight lines of 60 deg from straight lines in the dewarped view",
        format=".3f",
    ),
    Quantity(
        "viewpoint_shift_mm",
        "",
        "mm",
        "Viewpoint shift",
        "distance of the point closest to all chief rays from that of the sensor without errors",
        format=".3f",
    ),
    Quantity(
        "rim_reach_px",
        "",
        "px",
        "Image circle extent",
        "distance from the centre of the imager to the farthest point of the image of the rim",
        format=".1f",
    ),
)
"""Quantities of an as-built sensor relative to the nominal one."""

_UNREDUCED = {
    q.name: q
    for q in (
        *FIELD_QUANTITIES,
        *LENS_QUANTITIES,
        *DERIVED_QUANTITIES,
        *CALIBRATION_QUANTITIES,
        *SENSOR_QUANTITIES,
        *APERTURE_QUANTITIES,
        *AS_BUILT_QUANTITIES,
    )
}


def _reduction(prefix: str, which: str, description: str) -> Callable[..., Quantity]:
    """Return a reduction of quantities over the field to one number, named ``{prefix}_{name}``."""

    def reduced(name: str, **changes: str) -> Quantity:
        q = _UNREDUCED[name]
        symbol, title, meaning = (
            f"{which} {q.symbol}",
            f"{q.title}, {which}",
            f"{q.meaning}: {description}",
        )
        quantity = replace(
            q,
            name=f"{prefix}_{name}",
            symbol=symbol,
            title=title,
            meaning=meaning,
            head="",
            equation="",
        )
        return replace(quantity, **changes)

    return reduced


_worst = _reduction("worst", "worst", "largest magnitude over the field")
_mean = _reduction("mean", "mean", "mean over the solid angle of the field")
_minimum = _reduction("min", "min", "minimum over the field")
_maximum = _reduction("max", "max", "maximum over the field")

REDUCED_QUANTITIES = (
    *map(
        _worst,
        (
            "blur_t_px",
            "blur_s_px",
            "blur_t_deg",
            "blur_s_deg",
            "blur_px",
            "blur_deg",
            "blur_rss_deg",
        ),
    ),
    *map(_worst, ("blur_area_deg2", "floored_area_deg2")),
    _mean("floored_area_deg2"),
    replace(
        _worst("floored_area_deg2"),
        name="best_focus_worst_floored_area_deg2",
        title="Floored blur area at best focus, worst",
        meaning="worst floored blur area at the focus that minimises it",
    ),
    _minimum("dh_domega_px_per_deg", format=".2f"),
    _maximum("dh_domega_px_per_deg", format=".2f"),
    Quantity(
        "dh_domega_ratio",
        "",
        "",
        "Resolution T, min / max",
        "ratio of minimum to maximum resolution T: 1 is equidistant",
        format=".3f",
    ),
    Quantity(
        "area_ratio",
        "",
        "",
        "Image area, min / max",
        "ratio of minimum to maximum image area of a square degree: 1 is equiareal",
        "min Δs / max Δs",
        ".3f",
    ),
    Quantity(
        "inverse_area_ratio",
        "",
        "",
        "Image area, max / min",
        "ratio of maximum to minimum image area of a square degree: 1 is equiareal",
        "max Δs / min Δs",
        ".3f",
    ),
    _minimum("aspect"),
    _minimum("plane_mm_per_px"),
    _minimum("cylinder_mm_per_px"),
    _maximum("aspect"),
    Quantity(
        "worst_aspect",
        "",
        "",
        "Aspect, worst",
        "ratio of the longer to the shorter side of the image of a small square: 1 is conformal",
        "max(Δw/Δh, Δh/Δw)",
        ".3f",
    ),
)
"""Quantities reduced over the whole field."""

QUANTITIES: dict[str, Quantity] = {**_UNREDUCED, **{q.name: q for q in REDUCED_QUANTITIES}}
"""All quantities by name."""


def document_attributes(quantities: Iterable[Quantity]) -> Callable[[T], T]:
    """Document attributes named after quantities with the vocabulary; class decorator.

    >>> @document_attributes([QUANTITIES["h_px"]])
    ... class Mapping:
    ...     '''Mapping of a sensor.'''
    >>> print(Mapping.__doc__)
    Mapping of a sensor.
    <BLANKLINE>
    Attributes
    ----------
    h_px : (n,) px
        Image height: distance of the image point from the image centre at the specified focus (h = b tan θ, Eq. 7).
    """

    def decorate(cls: T) -> T:
        lines = [
            f"{q.name} : (n,) {q.unit}".rstrip() + f"\n    {describe_quantity(q)}."
            for q in quantities
        ]
        if cls.__doc__:
            cls.__doc__ = "\n".join([cleandoc(cls.__doc__), "", "Attributes", "----------", *lines])
        return cls

    return decorate


def describe_quantity(q: Quantity) -> str:
    """Return title, meaning and equation of a quantity in one line."""
    return f"{q.title}: {q.meaning}" + (f" ({q.equation})" if q.equation else "")


def format_part(part: tuple[float, float] | None) -> str:
    """Return a part of the field, deg, as a suffix of the name of a quantity."""
    if part is None:
        return ""
    return f", at {part[0]:g} deg" if part[0] == part[1] else f", {part[0]:g} to {part[1]:g} deg"
