"""Vocabulary of all quantities that are evaluated, limited, compared, minimised or plotted.

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


# -- real lens, at each field angle ------------------------------------------------------------

OF_LENS = (
    Quantity(
        "lens_blur_t_px",
        "δ_t",
        "px",
        "Own blur T",
        "tangential blur of the lens alone in its own focus, four standard deviations of its rays",
        format=".3f",
    ),
    Quantity(
        "lens_blur_s_px",
        "δ_s",
        "px",
        "Own blur S",
        "sagittal blur of the lens alone in its own focus",
        format=".3f",
    ),
    Quantity(
        "lens_illumination",
        "E/E_0",
        "",
        "Illumination by the lens",
        "illumination of the imager by an even light, over that on the axis",
        format=".3f",
        head="light",
    ),
    Quantity(
        "lateral_colour_px",
        "Δh_λ",
        "px",
        "Lateral colour",
        "image height in the shortest wavelength less that in the longest",
        format=".3f",
        head="colour",
    ),
    Quantity(
        "entrance_pupil_mm",
        "z_p",
        "mm",
        "Entrance pupil",
        "where the chief ray aims, towards the mirror from the lens's reference point",
        format=".3f",
        head="pupil",
    ),
)
"""Quantities in :attr:`omnimirror.analysis.evaluation.Evaluation.of_lens`."""

# -- at each field angle ---------------------------------------------------------------------------

PER_ANGLE = (
    Quantity(
        "omega_deg",
        "Ω",
        "deg",
        "Field angle",
        "angle of what is seen from the direction back past the lens",
        "Ω = 2β + θ, Eq. 4",
        ".6g",
    ),
    Quantity(
        "x_mm", "x", "mm", "Mirror point, radius", "distance of the mirror point from the axis"
    ),
    Quantity(
        "z_mm",
        "z",
        "mm",
        "Mirror point, height",
        "height of the mirror point over the vertex",
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
        "angle of the ray at the lens against its axis",
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
        "distance of the image from the centre, as focused",
        "h = b tan θ, Eq. 7",
    ),
    Quantity(
        "dh_domega_px_per_deg",
        "Δh",
        "px/deg",
        "Resolution T",
        "image of one degree along the image radius, of objects at their distance",
        "Δh = dh/dΩ / (1 + (cos γ / cos β) / (p dΩ/dx)), Eqs. 8, 9",
        ".3f",
    ),
    Quantity(
        "width_px_per_deg",
        "Δw",
        "px/deg",
        "Resolution S",
        "image of one degree around the circle, of objects at their distance",
        "Δw = 2π h / (360 (sin Ω + x/p)), Eq. 10",
        ".3f",
    ),
    Quantity(
        "area_px2", "Δs", "px²", "Image area", "image of one square degree", "Δs = Δh Δw, Eq. 11"
    ),
    Quantity(
        "aspect",
        "Δw/Δh",
        "",
        "Aspect",
        "width to height of the image of a small square",
        "Δw / Δh, Eq. 12",
        ".3f",
        "aspect",
    ),
    Quantity(
        "viewpoint_z_mm",
        "z_v",
        "mm",
        "Viewpoint",
        "height over the vertex at which the chief ray meets the axis",
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
        "height of the tangential virtual image over the vertex",
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
        "height of the sagittal virtual image over the vertex",
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
        "tangential blur in the angle of the object",
        "Δ_t / Δh, Eq. 36",
        ".3f",
        "blur T",
    ),
    Quantity(
        "blur_s_deg",
        "Δ_s/Δw",
        "deg",
        "Blur S",
        "sagittal blur in the angle of the object",
        "Δ_s / Δw, Eq. 37",
        ".3f",
        "blur S",
    ),
    Quantity(
        "blur_area_deg2",
        "T×S",
        "deg²",
        "Blur area",
        "product of both blurs in angle, signed by its factors",
        "Δ_t Δ_s / (Δh Δw), Fig. 9c",
        ".3f",
    ),
    Quantity(
        "floored_area_deg2",
        "A",
        "deg²",
        "Floored blur area",
        "blur area with a pixel and the Airy disk added in quadrature to each side",
        "√((Δ_t² + 1 + Airy²) (Δ_s² + 1 + Airy²)) / (Δh Δw)",
        ".3f",
        "blur area",
    ),
    Quantity(
        "plane_t_mm_per_px",
        "g_t,p",
        "mm/px",
        "Object size T on a plane",
        "length per pixel, along the image radius, on a plane perpendicular to the axis at the object distance",
        "p (π/180) / (Δh |cos Ω|)",
        ".4g",
        "plane T",
    ),
    Quantity(
        "cylinder_t_mm_per_px",
        "g_t,c",
        "mm/px",
        "Object size T on a cylinder",
        "length per pixel, along the image radius, on a cylinder about the axis at the object distance",
        "p (π/180) / (Δh sin Ω)",
        ".4g",
        "cylinder T",
    ),
    Quantity(
        "object_s_mm_per_px",
        "g_s",
        "mm/px",
        "Object size S",
        "length per pixel around the axis at the object distance, on a plane and on a cylinder alike",
        "p (π/180) / Δw = (x + p sin Ω) / h",
        ".4g",
        "object S",
    ),
)
"""Columns of an evaluation, in their order: values at each field angle."""

OF_BOTH_SIDES = (
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
        "larger of both blurs in angle",
        format=".3f",
    ),
    Quantity(
        "blur_rss_deg",
        "√(T² + S²)",
        "deg",
        "Blur, T and S",
        "root of the squares of both blurs in angle",
        format=".3f",
    ),
    Quantity(
        "total_blur_t_px",
        "",
        "px",
        "Total blur T",
        "tangential blur, with the Airy disk in quadrature",
        "√(Δ_t² + Airy²)",
    ),
    Quantity(
        "total_blur_s_px",
        "",
        "px",
        "Total blur S",
        "sagittal blur, with the Airy disk in quadrature",
        "√(Δ_s² + Airy²)",
    ),
    Quantity(
        "total_blur_px",
        "",
        "px",
        "Total blur",
        "larger of both total blurs, each with the Airy disk",
    ),
    Quantity(
        "total_blur_t_deg",
        "",
        "deg",
        "Total blur T",
        "tangential blur in angle, with the Airy disk in quadrature",
        "√(Δ_t² + Airy²) / Δh",
        ".3f",
    ),
    Quantity(
        "total_blur_s_deg",
        "",
        "deg",
        "Total blur S",
        "sagittal blur in angle, with the Airy disk in quadrature",
        "√(Δ_s² + Airy²) / Δw",
        ".3f",
    ),
    Quantity(
        "total_blur_deg",
        "",
        "deg",
        "Total blur",
        "larger of both total blurs in angle, each with the Airy disk",
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

OF_A_CALIBRATION = (
    Quantity(
        "direction_sigma_deg",
        "σ",
        "deg",
        "Error of directions",
        "standard error of a direction, as the covariance of a calibration has it",
        format=".4f",
        head="error",
    ),
)
"""Quantities of a calibrated camera at each field angle, in addition to some columns of an
evaluation.
"""

# -- whole sensor ------------------------------------------------------------------------------

OF_THE_SENSOR = (
    Quantity("mirror", "", "", "Mirror", "kind of the mirror"),
    Quantity("secondary", "", "", "Second mirror", "kind of the second mirror"),
    Quantity(
        "f_number",
        "F",
        "",
        "F-number",
        "of the lens; of a telecentric one on the side of the image",
        format=".3g",
        head="F-number",
    ),
    Quantity(
        "field_from_deg",
        "Ω_min",
        "deg",
        "Field from",
        "least field angle that the mirror shows",
        format=".1f",
    ),
    Quantity("field_to_deg", "Ω_max", "deg", "Field to", "field angle at the rim", format=".1f"),
    Quantity(
        "share_of_sphere_percent",
        "",
        "%",
        "Share of the sphere",
        "directions that are seen, of all",
        "50 (cos Ω_min - cos Ω_max)",
        ".1f",
    ),
    Quantity(
        "rim_radius_px",
        "N",
        "px",
        "Image circle, radius",
        "image height of the mirror's rim",
        format=".1f",
    ),
    Quantity(
        "nonlinearity_percent",
        "",
        "%",
        "Departure from equidistant",
        "largest distance of h(Ω) from the line through centre and rim, of the rim's h",
    ),
    Quantity(
        "viewpoint_spread_mm",
        "",
        "mm",
        "Viewpoints, spread",
        "highest less lowest viewpoint",
        "max z_v - min z_v",
        ".3f",
    ),
    Quantity(
        "one_viewpoint_error_px",
        "",
        "px",
        "One viewpoint, error at 1 m",
        "largest error of the best single viewpoint for objects 1 m away",
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
        "focus with the least worst floored blur area",
        format=".1f",
    ),
    Quantity(
        "depth_of_field_mm",
        "",
        "mm",
        "Depth of field",
        "distances whose blur stays within the permissible one",
        "f² L0 / (f² ∓ δ F (L0 - f)), Eqs. 30, 31",
        ".1f",
    ),
    Quantity("airy_px", "Airy", "px", "Airy disk", "diameter of the Airy disk", "2.44 λ F b0/f"),
    Quantity(
        "length_mm",
        "",
        "mm",
        "Length, lens to far end",
        "along the axis from the lens (or a second mirror before it) to the far end of the mirror; "
        "telecentric: from the vertex",
        format=".1f",
    ),
    Quantity(
        "total_track_mm",
        "",
        "mm",
        "Total track",
        "along the axis from the imager to the far end of the mirror; telecentric: from the vertex",
        format=".1f",
    ),
    Quantity("mirror_diameter_mm", "2M", "mm", "Mirror diameter", "of the rim", format=".1f"),
    Quantity("sag_mm", "", "mm", "Mirror sag", "height of the mirror along its axis", format=".1f"),
    Quantity(
        "hidden_to_deg",
        "",
        "deg",
        "Middle hidden to",
        "field angle up to which what stands around the mirror hides the view from the middle on",
        format=".1f",
    ),
    Quantity(
        "hidden_percent",
        "",
        "%",
        "Picture hidden",
        "share of the image circle in which what stands around the mirror hides the view",
        format=".1f",
    ),
    Quantity(
        "whole_diameter_mm",
        "",
        "mm",
        "Whole, diameter",
        "largest diameter of the mirror, its rim, its cover and the camera's front",
        format=".1f",
    ),
    Quantity(
        "whole_height_mm",
        "",
        "mm",
        "Whole, height",
        "along the axis from the imager to the back of the mirror's body; telecentric: of the mirror's body",
        format=".1f",
    ),
    Quantity(
        "whole_mass_g",
        "",
        "g",
        "Mirror, mass",
        "of the mirror's body, of the material that [thermal] says or else of aluminium",
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

OF_THE_APERTURE = (
    Quantity(
        "chief_px",
        "h",
        "px",
        "Chief ray, image height",
        "where the chief ray lands, from the centre",
        format=".3f",
    ),
    Quantity(
        "rms_radius_px",
        "rms",
        "px",
        "Spot, rms radius",
        "of the rays of a spot about their centroid",
        "√(mean of t² + s²)",
        ".3f",
    ),
    Quantity(
        "rms_t_px",
        "rms T",
        "px",
        "Spot, rms T",
        "rms of a spot along the image radius",
        format=".3f",
    ),
    Quantity(
        "rms_s_px", "rms S", "px", "Spot, rms S", "rms of a spot around the circle", format=".3f"
    ),
    Quantity(
        "extent_t_px",
        "width T",
        "px",
        "Spot, width T",
        "of all rays of a spot along the image radius",
        format=".3f",
    ),
    Quantity(
        "extent_s_px",
        "width S",
        "px",
        "Spot, width S",
        "of all rays of a spot around the circle",
        format=".3f",
    ),
    Quantity(
        "edge_t_px",
        "",
        "px",
        "Edge rays T, error",
        "distance of the two edge rays along the image radius, less the blur",
        format=".4f",
        head="edges T",
    ),
    Quantity(
        "edge_s_px",
        "",
        "px",
        "Edge rays S, error",
        "distance of the two edge rays around the circle, less the blur",
        format=".4f",
        head="edges S",
    ),
    Quantity(
        "offset_t_px",
        "",
        "px",
        "Tangential",
        "along the image radius, from where the chief ray lands",
    ),
    Quantity(
        "offset_s_px", "", "px", "Sagittal", "around the circle, from where the chief ray lands"
    ),
    Quantity(
        "strehl",
        "",
        "",
        "Strehl",
        "peak of the PSF, of that without aberrations",
        format=".3g",
        head="Strehl",
    ),
    Quantity(
        "encircled_energy",
        "",
        "",
        "Encircled energy",
        "share of the light within a radius about the centroid",
    ),
    Quantity(
        "encircled_radius_px",
        "r",
        "px",
        "Radius about the centroid",
        "of the circle whose encircled energy is told",
    ),
    Quantity(
        "ensquared_energy",
        "",
        "",
        "Ensquared energy",
        "largest share of the light that one pixel can hold",
        format=".3f",
        head="in its pixel",
    ),
    Quantity(
        "cycles_per_px",
        "",
        "cycles/px",
        "Spatial frequency",
        "of waves on the imager, in pixels",
        format=".3g",
    ),
    Quantity(
        "lp_per_mm", "", "lp/mm", "Spatial frequency", "of waves on the imager, in mm", format=".4g"
    ),
    Quantity(
        "mtf_t",
        "MTF T",
        "",
        "MTF T",
        "contrast of waves that run along the image radius",
        format=".3f",
    ),
    Quantity(
        "mtf_s", "MTF S", "", "MTF S", "contrast of waves that run around the circle", format=".3f"
    ),
    Quantity(
        "mtf",
        "MTF",
        "",
        "MTF",
        "smaller of tangential and sagittal MTF, by diffraction, defocus and the pixel",
        format=".3f",
    ),
    Quantity(
        "irradiance_sr",
        "E / L",
        "sr",
        "Irradiance",
        "light on the imager, of the radiance of an even world",
        format=".5f",
    ),
    Quantity(
        "relative",
        "",
        "",
        "Relative illumination",
        "irradiance, of the largest over the field",
        format=".4f",
        head="relative",
    ),
    Quantity(
        "reflectance",
        "R",
        "",
        "Reflectance",
        "of the mirror under the angle of incidence",
        format=".4f",
    ),
    Quantity(
        "filled",
        "",
        "",
        "Aperture filled",
        "unvignetted share of the aperture",
        format=".4g",
        head="aperture filled",
    ),
    Quantity(
        "viewpoint_error_px",
        "",
        "px",
        "Error of one viewpoint",
        "how far in the image an object lies from where one viewpoint looks for it",
        "Eq. 23",
    ),
)
"""Quantities from tracing the whole aperture."""

OF_BUILT_SENSORS = (
    Quantity(
        "motion_px",
        "",
        "px",
        "Motion of the picture",
        "farthest that an object is shown from where a sensor without errors shows it",
    ),
    Quantity(
        "motion_rms_px", "", "px", "Motion of the picture, rms", "the same, rms over the field"
    ),
    Quantity(
        "direction_error_deg",
        "",
        "deg",
        "Error of direction",
        "largest angle between an object and where a sensor without errors would look for it",
        format=".3f",
    ),
    Quantity(
        "direction_error_rms_deg",
        "",
        "deg",
        "Error of direction, rms",
        "the same angle, rms over the field",
        format=".3f",
    ),
    Quantity(
        "straightness_deg",
        "",
        "deg",
        "Straightness",
        "largest departure of straight lines of 60 deg from straight ones, in the straightened view",
        format=".3f",
    ),
    Quantity(
        "viewpoint_shift_mm",
        "",
        "mm",
        "Shift of the viewpoint",
        "how far the point nearest to all chief rays is from that of a sensor without errors",
        format=".3f",
    ),
    Quantity(
        "rim_reach_px",
        "",
        "px",
        "Reach of the image circle",
        "from the middle of the imager to the farthest point of the rim's image",
        format=".1f",
    ),
)
"""Quantities of an as-built sensor relative to the nominal one."""

_ALONE = {
    q.name: q
    for q in (
        *PER_ANGLE,
        *OF_LENS,
        *OF_BOTH_SIDES,
        *OF_A_CALIBRATION,
        *OF_THE_SENSOR,
        *OF_THE_APERTURE,
        *OF_BUILT_SENSORS,
    )
}


def _over_the_field(prefix: str, which: str, how: str) -> Callable[..., Quantity]:
    """Reduction of a quantity over the field to one number, named ``{prefix}_{name}``."""

    def of(name: str, **more: str) -> Quantity:
        q = _ALONE[name]
        symbol, title, meaning = f"{which} {q.symbol}", f"{q.title}, {which}", f"{q.meaning}: {how}"
        made = replace(
            q,
            name=f"{prefix}_{name}",
            symbol=symbol,
            title=title,
            meaning=meaning,
            head="",
            equation="",
        )
        return replace(made, **more)

    return of


_worst = _over_the_field("worst", "worst", "the largest over the field, whatever its sign")
_mean = _over_the_field("mean", "mean", "the mean over the solid angle of the field")
_least = _over_the_field("least", "least", "the least over the field")
_largest = _over_the_field("largest", "largest", "the largest over the field")

OVER_THE_FIELD = (
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
        title="Floored blur area there, worst",
        meaning="the least that any focus leaves of the worst",
    ),
    _least("dh_domega_px_per_deg", format=".2f"),
    _largest("dh_domega_px_per_deg", format=".2f"),
    Quantity(
        "dh_domega_ratio", "", "", "Resolution T, least / largest", "1 is equidistant", format=".3f"
    ),
    Quantity(
        "area_ratio",
        "",
        "",
        "Image area, least / largest",
        "smallest over largest image of a square degree: 1 is equiareal",
        "min Δs / max Δs",
        ".3f",
    ),
    Quantity(
        "inverse_area_ratio",
        "",
        "",
        "Image area, largest / least",
        "largest over smallest image of a square degree: 1 is equiareal",
        "max Δs / min Δs",
        ".3f",
    ),
    _least("aspect"),
    _least("plane_mm_per_px"),
    _least("cylinder_mm_per_px"),
    _largest("aspect"),
    Quantity(
        "worst_aspect",
        "",
        "",
        "Aspect, worst either way",
        "longer over shorter side of the image of a small square: 1 is conformal",
        "max(Δw/Δh, Δh/Δw)",
        ".3f",
    ),
)
"""Quantities reduced over the whole field."""

QUANTITIES: dict[str, Quantity] = {**_ALONE, **{q.name: q for q in OVER_THE_FIELD}}
"""All quantities by name."""


def described(quantities: Iterable[Quantity]) -> Callable[[T], T]:
    """Document attributes named after quantities with the vocabulary; class decorator.

    >>> @described([QUANTITIES["h_px"]])
    ... class Seen:
    ...     '''What is seen.'''
    >>> print(Seen.__doc__)
    What is seen.
    <BLANKLINE>
    Attributes
    ----------
    h_px : (n,) px
        Image height: distance of the image from the centre, as focused (h = b tan θ, Eq. 7).
    """

    def decorate(cls: T) -> T:
        lines = [
            f"{q.name} : (n,) {q.unit}".rstrip() + f"\n    {explained(q)}." for q in quantities
        ]
        if cls.__doc__:
            cls.__doc__ = "\n".join([cleandoc(cls.__doc__), "", "Attributes", "----------", *lines])
        return cls

    return decorate


def explained(q: Quantity) -> str:
    """Return title, meaning and equation of a quantity in one line."""
    return f"{q.title}: {q.meaning}" + (f" ({q.equation})" if q.equation else "")
