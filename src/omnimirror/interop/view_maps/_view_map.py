"""Maps between a fixed view and the source image of a camera, in both directions.

The inverse mapping intersects the rays of source pixels with the screens of the view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...base.arguments import instance
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.results import Columns, Result, pixel_grid
from ...base.typing import Array
from ...cameras.camera import Camera, perpendicular_axes
from ...dewarp import Dewarper
from ...dewarp.screens import Screen, View, parts_of
from ...dewarp.view_geometry import Viewpoint, centre_of_projection

# -- Inverse mapping -------------------------------------------------------------------------------

GRID_NODES = 160
"""Largest number of steps along the longer side of the grid of initial values."""
MAX_ITERATIONS = 8
"""Newton iterations; convergence is quadratic."""
TOLERANCE_PX = 1e-6
DIFFERENCE_PX = 1e-3
"""Step of the forward differences for the Jacobian."""
CHUNK_RAYS = 1 << 16


def view_pixels(camera: Camera, view: View, viewpoint: Viewpoint) -> Array:
    """Return the pixel of a view for each source pixel.

    Parameters
    ----------
    camera
        Camera of the source images.
    view
        Screen or composition of screens.
    viewpoint
        Viewpoint mode, as for :class:`omnimirror.Dewarper`.

    Returns
    -------
    (height, width, 2) array
        Pixels (u, v) of the view; NaN for source pixels outside it.
    """
    width, height = camera.image_size
    grid = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack(grid, axis=2).reshape(-1, 2).astype(float)
    mapped = np.full_like(pixels, np.nan)
    for left, top, screen in parts_of(view):
        centre = centre_of_projection(camera, screen, viewpoint)
        for first in range(0, len(pixels), CHUNK_RAYS):
            chunk = slice(first, first + CHUNK_RAYS)
            rays = camera.backproject(pixels[chunk])
            origins = rays.origins
            if centre is not None:
                origins = np.broadcast_to(centre, origins.shape)
            hits = np.full((len(rays.valid), 2), np.nan)
            hits[rays.valid] = intersect_screen(
                screen, origins[rays.valid], rays.directions[rays.valid]
            )
            inside = np.isfinite(hits[:, 0])
            mapped[chunk][inside] = hits[inside] + (left, top)
    return mapped.reshape(height, width, 2)


def intersect_screen(screen: Screen, origins: Array, directions: Array) -> Array:
    """Intersect rays with a screen by Newton iteration on the parametrisation of the screen.

    Initial values are the nearest nodes of a coarse grid in direction. On a panorama of 360 deg
    the iteration can leave one end; such rays are repeated from the other end.

    Parameters
    ----------
    screen
        Projection surface.
    origins, directions
        Rays (n, 3), mm, and (n, 3) unit vectors.

    Returns
    -------
    (n, 2) array
        Pixels (u, v) of the screen; NaN for rays that miss it.
    """
    width, height = screen.size
    if not len(directions):
        return np.empty((0, 2))
    initial, candidate = _nearest_nodes(screen, origins, directions)
    pixels = np.full_like(initial, np.nan)
    pixels[candidate] = _newton(
        screen, initial[candidate], origins[candidate], directions[candidate]
    )
    for axis, side in enumerate((width, height)):
        column = pixels[:, axis]
        beyond = (column < -0.5) | (column > side - 0.5)
        if beyond.any():
            wrapped = pixels[beyond]
            wrapped[:, axis] += np.where(wrapped[:, axis] < 0, side, -side)
            pixels[beyond] = _newton(screen, wrapped, origins[beyond], directions[beyond])
    inside = (pixels >= -0.5).all(1) & (pixels <= np.array([width, height]) - 0.5).all(1)
    pixels[~inside] = np.nan
    return pixels


def _nearest_nodes(
    screen: Screen, origins: Array, directions: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the grid nodes (n, 2) nearest to rays in direction, and which rays are candidates.

    Nodes are seen from the mean of the ray origins. A ray is a candidate if the angle to its
    nearest node does not exceed one grid cell plus the parallax of the ray origins.
    """
    width, height = screen.size
    step = max(width, height, GRID_NODES) / GRID_NODES
    # A quarter of a pixel from the edges, which may be poles: two nodes for a side of one pixel.
    sides = (
        np.linspace(-0.25, side - 0.75, int(np.ceil((side - 0.5) / step)) + 1)
        for side in (width, height)
    )
    u, v = np.meshgrid(*sides)
    nodes = np.stack([u.ravel(), v.ravel()], axis=1)
    targets, centre = _targets(screen, nodes), origins.mean(axis=0)
    if not screen.is_distant:
        targets = targets - centre
    length = np.linalg.norm(targets, axis=1)
    exists = np.isfinite(length) & (length > 0)
    heading = np.where(exists, targets.T / np.where(exists, length, 1.0), np.nan).T
    grid = heading.reshape(*u.shape, 3)
    cells = [np.linalg.norm(np.diff(grid, axis=axis), axis=2) for axis in (0, 1)]
    reach = sum(float(np.nanmax(cell, initial=0.0)) for cell in cells)
    if not screen.is_distant:
        parallax_mm = float(np.linalg.norm(origins - centre, axis=1).max())
        reach += 2 * (parallax_mm / length[exists].min())
    _, nearest = cKDTree(heading[exists]).query(directions, distance_upper_bound=reach)
    candidate = np.asarray(nearest < exists.sum())
    return nodes[exists][np.where(candidate, nearest, 0)], candidate


def _targets(screen: Screen, pixels: Array) -> Array:
    """Return the points or directions (n, 3) of pixels (n, 2) of a screen."""
    return np.asarray(screen.targets_at(pixels[:, 0], pixels[:, 1])).reshape(len(pixels), 3)


def _newton(screen: Screen, pixels: Array, origins: Array, directions: Array) -> Array:
    """Return the pixels (n, 2) whose targets lie on the rays; NaN without convergence."""
    axes = perpendicular_axes(directions).transpose(0, 2, 1)
    pixels, solution = pixels.copy(), np.full_like(pixels, np.nan)
    active = np.arange(len(pixels))
    with np.errstate(all="ignore"):  # rays that miss the screen diverge
        for _ in range(MAX_ITERATIONS):
            rays = origins[active], axes[active], directions[active]
            step, ahead = _newton_step(screen, pixels[active], *rays)
            pixels[active] -= step
            length = np.linalg.norm(step, axis=1)
            converged = ahead & (length < TOLERANCE_PX)
            solution[active[converged]] = pixels[active[converged]]
            active = active[~converged & (length < 2 * max(screen.size))]
            if not len(active):
                break
    return solution


def _newton_step(
    screen: Screen, pixels: Array, origins: Array, axes: Array, directions: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Return a Newton step (n, 2) and whether the targets are in front of the ray origins."""

    def residual(positions: Array) -> tuple[Array, Array]:
        """Return the components (n, 2) of target directions perpendicular to the rays and (n,)
        along.
        """
        heading = _targets(screen, positions)
        if not screen.is_distant:
            heading = heading - origins
        heading = heading / np.linalg.norm(heading, axis=1, keepdims=True)
        across = np.einsum("nij,nj->ni", axes, heading)
        return across, np.einsum("nj,nj->n", heading, directions)

    # Jacobian [[a, b], [c, d]] by forward differences, inverted by Cramer's rule.
    value, ahead = residual(pixels)
    (a, c), (b, d) = (
        ((residual(pixels + shift)[0] - value) / DIFFERENCE_PX).T
        for shift in DIFFERENCE_PX * np.eye(2)
    )
    step = np.stack([d * value[:, 0] - b * value[:, 1], a * value[:, 1] - c * value[:, 0]], axis=1)
    return step / (a * d - b * c)[:, None], np.asarray(ahead > 0)


# -- View map --------------------------------------------------------------------------------------

MAX_SIDE_PX = 65534
"""Maximum image side of formats with 16-bit coordinates; 65535 marks missing pixels."""


@dataclass(frozen=True, eq=False, repr=False)
class ViewMap(Result):
    """Map between the pixels of a view and the pixels of the source image.

    Attributes
    ----------
    camera, view, viewpoint
        Camera, view and viewpoint mode, as for :class:`omnimirror.Dewarper`.
    name
        Name of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> ahead = om.view_map(sensor, om.screens.Plane((320, 240), hfov_deg=80.0))
    >>> ahead.dewarp_map.shape, ahead.dewarp_map[120, 160].round(1)
    ((240, 320, 2), array([510.5, 115.9]))
    >>> ahead.warp_map[116, 510].round(1)  # inverse
    array([160.2, 120.1])
    """

    camera: Camera
    view: View
    viewpoint: Viewpoint = "exact"
    name: str = "camera"

    def _table(self) -> Columns:
        width, height = self.size
        view = {f"view_{k}": v for k, v in pixel_grid(np.arange(width), np.arange(height)).items()}
        u, v = self.dewarp_map.reshape(-1, 2).T
        return {**view, "source_u_px": u, "source_v_px": v}

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the view, px."""
        return self.view.size

    @property
    def source_size(self) -> tuple[int, int]:
        """(width, height) of the source image, px."""
        return self.camera.image_size

    @property
    def sizes(self) -> str:
        """Sizes of the view and the source image as text."""
        return "{} x {} px of {} x {}".format(*self.size, *self.source_size)

    @property
    def template_values(self) -> dict[str, object]:
        """Values common to all script templates."""
        (width, height), (source_width, source_height) = self.size, self.source_size
        return {
            "camera": self.name,
            "view": self.view,
            "width": width,
            "height": height,
            "source_width": source_width,
            "source_height": source_height,
        }

    @cached_property
    def dewarp_map(self) -> Array:
        """(height, width, 2) source pixel (u, v) of each pixel of the view; NaN outside the
        field."""
        return Dewarper(self.camera, self.view, viewpoint=self.viewpoint).coordinates()

    @property
    def border_clamped_dewarp_map(self) -> Array:
        """:attr:`dewarp_map` with coordinates clamped to the centres of the border pixels.

        Bilinear sampling at clamped coordinates equals the replication of border pixels in
        :class:`omnimirror.Dewarper`, also in programs that continue images with a constant.
        """
        return np.clip(self.dewarp_map, 0.0, np.array(self.source_size) - 1.0)

    @cached_property
    def warp_map(self) -> Array:
        """(height, width, 2) pixel (u, v) of the view of each source pixel; NaN outside the
        view."""
        return view_pixels(self.camera, self.view, self.viewpoint)

    def __repr__(self) -> str:
        return f"ViewMap({self.name}, {self.view}, {self.sizes})"


def check_16_bit_size(size: tuple[int, int], name: str) -> None:
    """Raise InvalidParameter if 16-bit coordinates cannot represent all pixels of an image."""
    if max(size) > MAX_SIDE_PX:
        raise InvalidParameter(
            f"the sides of the {name} must be at most {MAX_SIDE_PX} px; got {max(size)} px"
        )


def view_map(camera: Camera, view: View, viewpoint: Viewpoint = "exact") -> ViewMap:
    """Return the map of a fixed view for programs that resample images themselves.

    Parameters
    ----------
    camera
        Sensor, aligned or misaligned, or calibrated camera.
    view
        Screen of :mod:`omnimirror.screens` or view of :mod:`omnimirror.views`.
    viewpoint
        Viewpoint mode, as for :class:`omnimirror.Dewarper`.

    Returns
    -------
    ViewMap
        Maps in both directions, computed on first access.

    Raises
    ------
    InvalidParameter
        If the camera, view or viewpoint is invalid.
    OutsideField
        If no pixel of the view is inside the field of the camera.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> panorama = om.view_map(sensor, om.views.panorama(sensor, (720, None)))
    >>> panorama.size, f"{np.isfinite(panorama.dewarp_map).all(-1).mean():.3f}"
    ((720, 270), '1.000')
    """
    instance("camera", camera, Camera, "a camera (see om.load_sensor)")
    Dewarper(camera, view, viewpoint=viewpoint)  # validates view and viewpoint
    mapping = ViewMap(camera, view, viewpoint, getattr(camera, "name", "camera"))
    mapping.dewarp_map  # noqa: B018 - raises OutsideField now rather than on first access
    return mapping
