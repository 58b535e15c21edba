"""Mirror families in closed form, for given field, viewing angle and rim radius.

The closed forms replace the trial and error of the paper. A conic of vertex radius R and conic
constant k has the slope ``tan(beta)`` at x = M for

    R = M sqrt(cot(beta)^2 + 1 + k),   beta = (Omega_max - Theta)/2

(Eqs. 2-5 at the rim). The lens distance follows from the viewing angle Theta of the rim, ``m =
M/tan(Theta) - z(M)``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...base.errors import InvalidParameter
from ...optics.mirrors import Cone, Ellipsoid, Hyperboloid, Paraboloid, Sphere
from ...optics.mirrors.generated.distant import conformal_conic
from .rim import MountedMirror, RimRay


def vertex_radius(rim: RimRay, conic: float) -> float:
    """Return the vertex radius R (mm) of the conic with the required slope at the rim.

    Raises
    ------
    InvalidParameter
        Conic constant of a hyperboloid that cannot reach the slope.

    Examples
    --------
    Sphere of Table 1, A = 1.138 M:

    >>> round(vertex_radius(RimRay(135.0, 12.0, 1.0), conic=0.0), 3)
    1.138
    """
    # Slope of a conic: z'(x) = x / sqrt(R^2 - (1 + k) x^2). Setting z'(M) = tan(beta) (Eqs. 2-5)
    # gives (R/M)^2 = cot(beta)^2 + 1 + k.
    square = 1 / rim.slope**2 + 1 + conic
    if square <= 0:
        raise InvalidParameter(
            f"conic = {conic:g} is never as steep as the rim, {rim.slope_angle_deg:.4g} deg; it is valid above "
            f"{-1 - 1 / rim.slope**2:.6g}"
        )
    return rim.rim_radius_mm * float(np.sqrt(square))


def sphere(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the sphere ``A = M / sin(beta)``; it has no free parameter.

    >>> mounted = sphere(RimRay(135.0, 12.0, 1.0))
    >>> round(mounted.mirror.radius_mm, 3), round(mounted.distance_mm, 3)  # Table 1
    (1.138, 4.11)
    """
    _refuse_conic("sphere", conic)
    return rim.place(Sphere(vertex_radius(rim, 0.0), rim.rim_radius_mm))


def paraboloid(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the paraboloid ``s = M / tan(beta)``; it has no free parameter. With an orthographic
    lens it has a single viewpoint.
    """
    _refuse_conic("paraboloid", conic)
    return rim.place(Paraboloid(vertex_radius(rim, -1.0), rim.rim_radius_mm))


def hyperboloid(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the hyperboloid of a given conic constant k < -1, or with a single viewpoint.

    >>> mounted = hyperboloid(RimRay(135.0, 12.0, 1.0))
    >>> round(mounted.mirror.a_mm, 4), round(mounted.mirror.b_mm, 3), round(mounted.distance_mm, 3)  # Table 1
    (0.7407, 1.698, 3.55)
    """
    M = rim.rim_radius_mm
    if conic is None:
        if rim.theta_max_deg == 0:
            raise InvalidParameter(
                "a hyperboloid has no single viewpoint under an orthographic lens; the paraboloid has, or give a "
                "conic below -1"
            )
        mirror = conformal_conic(np.radians(rim.omega_max_deg), np.radians(rim.theta_max_deg), M)
        return rim.place(mirror, (f"conic = {mirror.conic:.6g}, chosen for a single viewpoint",))
    if conic >= -1:
        raise InvalidParameter(f"conic = {conic:g} is no hyperboloid; it is valid below -1")
    R, ratio = vertex_radius(rim, conic), np.sqrt(-1 - conic)  # A/B
    return rim.place(Hyperboloid(float(R / ratio), float(R / ratio**2), M))


def ellipsoid(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the ellipsoid with a given conic constant k > -1: prolate below 0, oblate above 0."""
    if conic is None:
        raise InvalidParameter("an ellipsoid leaves its conic constant free; give conic, above -1 (0 is the sphere)")
    if conic <= -1:
        raise InvalidParameter(f"conic = {conic:g} is no ellipsoid; it is valid above -1")
    R, ratio = vertex_radius(rim, conic), np.sqrt(1 + conic)  # A/B
    return rim.place(Ellipsoid(float(R / ratio), float(R / ratio**2), rim.rim_radius_mm))


def cone(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the cone of constant slope beta, with a field from Omega_max - Theta to Omega_max."""
    _refuse_conic("cone", conic)
    if rim.theta_max_deg == 0:
        raise InvalidParameter(
            "a cone under an orthographic lens shows one field angle alone; give theta_max_deg above 0"
        )
    low = rim.omega_max_deg - rim.theta_max_deg
    return rim.place(
        Cone(rim.slope_angle_deg, rim.rim_radius_mm),
        (f"a cone shows {low:g} to {rim.omega_max_deg:g} deg and no more",),
    )


def _refuse_conic(family: str, conic: float | None) -> None:
    if conic is not None:
        raise InvalidParameter(f"conic = {conic:g} does not apply to a {family}, which is solved without it")


FAMILIES: dict[str, Callable[[RimRay, float | None], MountedMirror]] = {
    "sphere": sphere,
    "hyperboloid": hyperboloid,
    "paraboloid": paraboloid,
    "ellipsoid": ellipsoid,
    "cone": cone,
}
"""Mirror families by name: functions of the rim and of the conic constant, if it is free."""
