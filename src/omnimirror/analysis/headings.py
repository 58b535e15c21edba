"""How the columns of an evaluation are headed where people read them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from .evaluation import Evaluation


class Heading(NamedTuple):
    """Symbol, unit and number format of a column."""

    symbol: str
    unit: str
    format: str


HEADINGS: dict[str, Heading] = {
    "omega_deg": Heading("Omega", "deg", ".6g"),
    "x_mm": Heading("x", "mm", ".2f"),
    "theta_deg": Heading("theta", "deg", ".3f"),
    "h_px": Heading("h", "px", ".2f"),
    "dh_domega_px_per_deg": Heading("Dh", "px/deg", ".3f"),
    "width_px_per_deg": Heading("Dw", "px/deg", ".3f"),
    "aspect": Heading("aspect", "", ".3f"),
    "viewpoint_z_mm": Heading("viewpoint", "mm", ".2f"),
    "distance_t_mm": Heading("L_t", "mm", ".2f"),
    "distance_s_mm": Heading("L_s", "mm", ".2f"),
    "blur_t_px": Heading("blur T", "px", ".2f"),
    "blur_s_px": Heading("blur S", "px", ".2f"),
    "blur_t_deg": Heading("blur T", "deg", ".3f"),
    "blur_s_deg": Heading("blur S", "deg", ".3f"),
    "floored_area_deg2": Heading("blur area", "deg²", ".3f"),
}
"""The columns that people read, in their order; files hold the others too."""


def formatted(result: Evaluation, names: Sequence[str]) -> dict[str, list[str]]:
    """The named columns as text, one list of cells each."""
    return {name: [f"{v:{HEADINGS[name].format}}" for v in getattr(result, name)] for name in names}
