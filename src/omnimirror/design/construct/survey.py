"""Comparison of all mappings: the mirror of each for one field and lens."""

from __future__ import annotations

from ...base.arguments import checked
from ...base.errors import OmnimirrorError
from ...optics.mirrors.generated import MAPPINGS
from .mappings import generated_mirror
from .rim import MountedMirror, RimRay


@checked
def mappings(omega_max_deg: float = 75.0, theta_max_deg: float = 12.0) -> dict[str, MountedMirror | OmnimirrorError]:
    """Compute the mirror of each mapping for a field and a lens, with lengths in rim radii.

    Used by ``omnimirror mappings``. The mirrors follow from the law of reflection, dz/dx =
    tan((Omega - theta)/2), with the Omega(theta) of the mapping.

    Parameters
    ----------
    omega_max_deg
        Field angle at the rim, deg.
    theta_max_deg
        Viewing angle of the lens at the rim, deg; 0 for an orthographic lens.

    Returns
    -------
    dict
        Mirror and lens distance by name of the mapping, or the error that prevents its
        construction.

    Raises
    ------
    InvalidParameter
        Invalid combination of angles.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.mappings(120.0)
    >>> print(f"{found['equidistant'].distance_mm:.3f} rim radii")
    4.090 rim radii
    >>> print(found["rectifying"])
    omega_max_deg = 120 cannot be reached by the rectifying mapping; it is valid below 90
    """
    rim = RimRay(omega_max_deg, theta_max_deg, 1.0)
    found: dict[str, MountedMirror | OmnimirrorError] = {}
    for name in MAPPINGS:
        try:
            found[name] = generated_mirror(name, rim)
        except OmnimirrorError as e:
            found[name] = e
    return found
