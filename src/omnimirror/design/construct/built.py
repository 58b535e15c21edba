"""Mirrors corrected for the real lens and cover: pupil aberration, distortion and refraction.

A mirror of a family is designed for the field angle inside the cover that refraction converts to
the requested angle. For a mirror of a mapping, the mapping is corrected for lens and cover: the
field angle of selected mirror points is compared with the nominal angle at their image height, and
the angle inside is corrected iteratively.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...optics.housing import Housing, Tube
from ...optics.lenses import Lens
from ...optics.mirrors import TabulatedMapping
from ...optics.mirrors.generated.base import Mapped
from ...optics.tracing.covers import Cover
from ...optics.tracing.meridian import ChiefRays, trace_chief_rays
from ...optics.tracing.obscuration import Obstructions, cover_of
from .rim import MountedMirror, RimRay

NODES = 65  # mirror points of the mapping correction
STEPS = 12
CLOSE = 1e-10  # radians
ENDS_STEPS = 25  # maximum iterations for a pointed mirror behind a cover
MIN_CENTRE_DEG, MAX_STEP_DEG = 1.0, 10.0  # smallest inner field angle at the centre, largest step


@dataclass(frozen=True)
class LensAndCover:
    """Focused lens and housing of the mirror."""

    lens: Lens
    housing: Housing

    @property
    def are_ideal(self) -> bool:
        """Return whether the camera is an ideal pinhole without a cover."""
        return self.lens.IS_THIN and self.housing.shell is None

    @property
    def keep_mapping(self) -> bool:
        """Return whether all field angles of a mapping can be reached; a tube with another outer
        medium excludes those near the axis.
        """
        shell = self.housing.shell
        return not (isinstance(shell, Tube) and shell.outer_index != 1.0)

    def mounted(self, made: MountedMirror, theta_max_deg: float) -> MountedMirror:
        """Return a mirror designed for a pinhole, at the lens distance of equal viewing angle."""
        place = float(self.lens.pupil.place(np.array([np.tan(np.radians(theta_max_deg))]))[0])
        return MountedMirror(made.mirror, made.distance_mm + place, made.notes)

    def rays(self, made: MountedMirror, x: Array) -> ChiefRays:
        """Trace the chief rays (n,) of mirror points to the outside; not finite if blocked."""
        return self._tracer(made)(x)

    def _cover(self, made: MountedMirror) -> Cover | None:
        """Return the cover around a mirror; None without one."""
        if self.housing.shell is None:
            return None
        return cover_of(Obstructions.of(self.housing, made.mirror, None, made.distance_mm))

    def _tracer(self, made: MountedMirror) -> Callable[[Array], ChiefRays]:
        """Return the function that traces chief rays (n,) from one mirror to the outside."""
        with np.errstate(all="ignore"):
            cover = self._cover(made)

        def trace(x: Array) -> ChiefRays:
            with np.errstate(all="ignore"):
                rays = trace_chief_rays(made.mirror, made.distance_mm, x, self.lens.pupil)
                return rays if cover is None else cover.left_by(rays)

        return trace

    def heights(self, rays: ChiefRays) -> Array:
        """Return image heights (n,) relative to that of the last ray."""
        h = self.lens.image_height(rays.x, rays.w)
        share: Array = h / h[-1]
        return share

    def made_for_rim(self, make: Callable[[RimRay], MountedMirror], rim: RimRay) -> MountedMirror:
        """Return the mirror with the requested field angle at the rim outside the cover."""
        inside = rim.omega_max_deg
        for _ in range(STEPS):
            own = RimRay(inside, rim.theta_max_deg, rim.rim_radius_mm)
            found = self.mounted(make(own), rim.theta_max_deg)
            if self.housing.shell is None:
                return found
            rays = self.rays(found, np.array([rim.rim_radius_mm]))
            missed = rim.omega_max_deg - float(np.degrees(rays.omega[0]))
            _check_out(missed, rim, self.housing)
            if abs(missed) < np.degrees(CLOSE):
                return found
            inside += missed * float(_inside_rate(rays)[0])
        return found

    def made_for_ends(
        self, make: Callable[[RimRay, float], MountedMirror], rim: RimRay, low_deg: float
    ) -> MountedMirror:
        """Return the pointed mirror with a field from ``low_deg`` outside the cover.

        Parameters
        ----------
        make
            Function of the rim and of the field angle at the centre, both inside the cover, that
            returns a mirror.
        low_deg
            Smallest field angle outside, deg: at the centre or, if the base of a tube blocks the
            rays of the centre, at the first mirror point with rays through the wall. An angle
            excluded by refraction is approached as closely as possible.
        """
        wanted = np.array([low_deg, rim.omega_max_deg])
        shell = self.housing.shell
        index = 1.0 if shell is None else shell.outer_index
        # Snell's law at parallel walls is exact for a tube and the initial value for a dome.
        cosines = np.clip(index * np.cos(np.radians(wanted)), -1.0, np.cos(np.radians(MIN_CENTRE_DEG)))
        inside, before = np.degrees(np.arccos(cosines)), None
        for _ in range(ENDS_STEPS):
            own = RimRay(float(inside[1]), rim.theta_max_deg, rim.rim_radius_mm)
            found = self.mounted(make(own, float(inside[0])), rim.theta_max_deg)
            missed, rate = self._missed_at_ends(found, wanted)
            _check_out(float(np.abs(missed).max()), rim, self.housing)
            if np.abs(missed).max() < np.degrees(CLOSE):
                break
            step = missed * rate
            # The first point with rays through the wall depends on the angle at the centre; a
            # secant step accounts for this.
            if before is not None and (change := missed[0] - before[1]):
                step[0] = float(np.clip(-missed[0] * (inside[0] - before[0]) / change, -MAX_STEP_DEG, MAX_STEP_DEG))
            before = inside[0], missed[0]
            inside = inside + step
            is_settled = abs(missed[1]) < np.degrees(CLOSE) and before[0] == MIN_CENTRE_DEG and inside[0] <= before[0]
            if is_settled:  # the angle cannot be reached
                break
            inside[0] = np.clip(inside[0], MIN_CENTRE_DEG, inside[1] - MIN_CENTRE_DEG)
        return found

    def _missed_at_ends(self, made: MountedMirror, wanted_deg: Array) -> tuple[Array, Array]:
        """Return field angle errors at both ends of the field, deg, and d(inside)/d(outside)."""
        begin, rim, cover, trace = 0.0, made.mirror.rim_radius_mm, self._cover(made), self._tracer(made)
        if cover is not None:
            begin = cover.first_seen(trace, 0.0, rim)
        rays = trace(np.array([begin, rim]))
        return wanted_deg - np.degrees(rays.omega), _inside_rate(rays)

    def made_for_mapping(self, exact: Mapped, rim: RimRay) -> MountedMirror:
        """Return the mirror that has a given mapping with lens and cover.

        Raises
        ------
        InvalidParameter
            Rays blocked by the cover.
        """
        x = rim.rim_radius_mm * np.linspace(0.0, 1.0, NODES)
        mirror: Mapped = exact
        inside: Array | None = None
        for _ in range(STEPS):
            made = MountedMirror(mirror, mirror.design_distance)
            tau = x if rim.theta_max_deg == 0 else x / (made.distance_mm + np.asarray(mirror.sag(x)))
            tau = tau / tau[-1]
            inside = mirror.mapping(tau)[0]
            found = self.mounted(made, rim.theta_max_deg)
            rays = self.rays(found, x)
            missed = exact.mapping(self.heights(rays))[0] - rays.omega
            _check_out(float(np.abs(missed).max()), rim, self.housing)
            if np.abs(missed).max() < CLOSE:
                break
            wanted = np.degrees(inside + missed * _inside_rate(rays))
            mirror = TabulatedMapping.sketched(wanted, tau, rim.theta_max_deg, rim.rim_radius_mm)
        if isinstance(found.mirror, TabulatedMapping):
            found.mirror.checked()
        return found


def _inside_rate(rays: ChiefRays) -> Array:
    """Return the derivative (n,) of the angle inside a cover with respect to the angle outside."""
    return rays.dreflected_dx() / rays.domega_dx()


def _check_out(missed: float, rim: RimRay, housing: Housing) -> None:
    if not np.isfinite(missed):
        kind = "cover" if housing.shell is None else housing.shell.KIND
        raise InvalidParameter(
            f"the {kind} does not let out rays of a mirror to omega_max_deg = {rim.omega_max_deg:g}; a smaller "
            "field, or a wider or thinner wall is valid"
        )


def departure(lens_and_cover: LensAndCover, made: MountedMirror, exact: Mapped, angles: int) -> float:
    """Return the largest deviation of the image height from a mapping, in rim heights."""
    x = made.mirror.rim_radius_mm * np.linspace(0.0, 1.0, angles)
    rays = lens_and_cover.rays(made, x)
    tau = lens_and_cover.heights(rays)
    wanted, rate = exact.mapping(tau)
    seen = np.isfinite(rays.omega) & (rate > 0)
    return float(np.abs((rays.omega - wanted) / np.where(rate > 0, rate, 1.0))[seen].max())
