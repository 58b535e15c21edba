"""Batch evaluation of designs: mapping, images and blur, each design at its own best focus.

:func:`omnimirror.evaluate` analyses one sensor in full; this module evaluates many sensors of one
family at common fractions of their rim radius, limited to the quantities of the optimiser. Results
agree with ``evaluate`` to rounding. The compiled evaluator is used if the native part is built,
NumPy otherwise, with 12 identical digits.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.native import backend, kernel_array
from ...base.typing import Array
from ..housing import Housing
from ..image_sensor import Imager
from ..lenses import BlurMode, FieldLens, Lens, Orthographic, Perspective
from ..mirrors.mirror import conic_profile
from ..sensor import Sensor
from .best_focus import FOCUS_SEARCH, AreaModel, IdealAreas, RealAreas, best_vergences
from .closed_forms import (
    DEGREE,
    FocusedCamera,
    LensTables,
    MirrorPointOptics,
    PerspectiveCamera,
    RealCamera,
    TelecentricCamera,
    WallArrays,
    aim_of,
    as_rim,
    built_optics,
    node_optics,
    tables_of,
    telecentric_optics,
    walls_of,
)
from .families import Family

Numbers = Any
"""One number, or an array with one value per design; always an array in :class:`Designs`."""

ROUNDING = 1e-12  # relative tolerance of a rim at the end of a lens's field
BLOCK = 256  # designs per block: their arrays of 100 angles fit in the cache
BATCH_COLUMNS = (
    "omega_deg",
    "h_px",
    "dh_domega_px_per_deg",
    "width_px_per_deg",
    "viewpoint_z_mm",
    "distance_t_mm",
    "distance_s_mm",
    "blur_t_px",
    "blur_s_px",
    "floored_area_deg2",
)
"""Quantities computed at every angle, named as in ``evaluate``."""


@dataclass(frozen=True, eq=False)
class Designs:
    """n sensors with mirrors of one family, lenses of one kind and equal pixels.

    Attributes
    ----------
    coefficients : (n, terms)
        In units of the rim radius, as for the mirrors of the family.
    rim_radius_mm, mirror_distance_mm, focal_length_mm, f_number : (n,)
        Scalars apply to all designs.
    vertex_radius_mm, conic : (n,)
        Parameters of the conic of an even asphere; ignored by other families.
    magnification : (n,)
        Magnification of telecentric lenses, with image-side F-number; distance and focal length are
        then ignored. 0 for perspective lenses.
    mode, image_radius_px, wavelength_nm
        As in :func:`omnimirror.evaluate`.
    object_distance_mm
        Distance from mirror to object; or one distance per field angle.
    min_omega_deg
        Field angles below this are excluded from the best focus.
    lens
        Real lens of all designs, from a table or surfaces; distances refer to its reference point.
    housing
        Housing of the mirrors: each design is evaluated with refraction by the tube, dome or
        window.
    """

    family: Family
    coefficients: Array
    mirror_distance_mm: Numbers
    rim_radius_mm: Numbers
    focal_length_mm: Numbers
    f_number: Numbers
    pixel_pitch_um: float
    vertex_radius_mm: Numbers = np.inf
    conic: Numbers = 0.0
    magnification: Numbers = 0.0
    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0
    object_distance_mm: float | Array = np.inf
    min_omega_deg: float = 0.0
    lens: FieldLens | None = None
    housing: Housing = field(default_factory=Housing)

    def __post_init__(self) -> None:
        self._check_built()
        c = kernel_array(np.atleast_2d(np.asarray(self.coefficients, dtype=float)))
        if c.ndim != 2 or c.shape[1] != self.family.terms:
            raise InvalidParameter(
                f"coefficients must have shape (n, {self.family.terms}) for {self.family.name} "
                f"with {self.family.terms} terms; got {c.shape}"
            )
        object.__setattr__(self, "coefficients", c)
        for name in _NUMBERS:
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape not in ((), (len(c),)):
                raise InvalidParameter(
                    f"{name} must be one number, or one per design; got shape {value.shape}"
                )
            value = np.ascontiguousarray(np.broadcast_to(value, len(c)))
            if name not in ("vertex_radius_mm", "conic", "magnification") and not (value > 0).all():
                raise InvalidParameter(
                    f"{name} must be greater than 0; got {value[~(value > 0)][0]:g}"
                )
            object.__setattr__(self, name, value)
        if (self.magnification > 0).any() and not (self.magnification > 0).all():
            raise InvalidParameter(
                "magnification must be 0 for all designs, or greater than 0 for all; got both"
            )
        if not np.all(np.asarray(self.object_distance_mm) > 0):
            raise InvalidParameter(
                f"object_distance_mm must be greater than 0; got {self.object_distance_mm}"
            )

    def _check_built(self) -> None:
        """Check for values defined by a real lens, and for configurations without a meridian."""
        shell = self.housing.shell
        if shell is not None and not shell.is_axial:
            raise InvalidParameter(
                f"the {shell.KIND} must be aligned: designs are evaluated in the meridian; got "
                "a decentred or tilted one"
            )
        if self.lens is None:
            return
        if (
            self.mode != "exact"
            or self.image_radius_px is not None
            or np.any(np.asarray(self.magnification) > 0)
        ):
            raise InvalidParameter(
                "a lens given by its field requires mode = 'exact', no image_radius_px and no "
                f"magnification; got mode = {self.mode!r}, image_radius_px = "
                f"{self.image_radius_px}"
            )
        object.__setattr__(self, "focal_length_mm", self.lens.focal_length_mm)
        object.__setattr__(self, "f_number", self.lens.f_number)

    @property
    def is_bare(self) -> bool:
        """True for an ideal lens and mirrors without a clear cover."""
        return self.lens is None and self.housing.shell is None

    @cached_property
    def tables(self) -> LensTables | None:
        """Tables of the real lens."""
        return None if self.lens is None else tables_of(self.lens)

    def walls(self, rim_sag_mm: Array) -> WallArrays | None:
        """Return the walls of designs whose rims have heights (n,), mm."""
        m = np.full(len(self), np.inf) if self.is_telecentric else self.mirror_distance_mm
        return walls_of(self.housing, m[:, None], rim_sag_mm[:, None], self.rim_radius_mm[:, None])

    def __len__(self) -> int:
        return len(self.coefficients)

    def part(self, rows: slice | Array) -> Designs:
        """Return a subset of the designs."""
        chosen = {name: getattr(self, name)[rows] for name in ("coefficients", *_NUMBERS)}
        return replace(self, **chosen)

    @property
    def is_telecentric(self) -> bool:
        return bool((self.magnification > 0).all())

    def camera(self, rim_ray: Array) -> PerspectiveCamera | TelecentricCamera | RealCamera:
        """Return the camera in columns (n, 1), given the rim's ray coordinate (n, 1)."""
        pitch = self.pixel_pitch_um * 1e-3
        mu, f, F = (v[:, None] for v in (self.magnification, self.focal_length_mm, self.f_number))
        if self.tables is not None:
            return RealCamera(self.tables, pitch, self.wavelength_nm)
        if self.is_telecentric:
            return TelecentricCamera(
                mu, F, rim_ray, pitch, self.image_radius_px, self.wavelength_nm
            )
        return PerspectiveCamera(
            f, F, rim_ray, pitch, self.mode, self.image_radius_px, self.wavelength_nm
        )

    def sensor(self, i: int, imager: Imager, focus_mm: float, name: str = "design") -> Sensor:
        """Create design i as a sensor focused at an object distance."""
        R, k = (float(v[i]) for v in (self.vertex_radius_mm, self.conic))
        mirror = self.family.mirror(self.coefficients[i], float(self.rim_radius_mm[i]), R, k)
        F = float(self.f_number[i])
        lens: Lens
        if self.lens is not None:
            lens = self.lens.focused_at(float(focus_mm))
        elif self.is_telecentric:
            lens = Orthographic(float(self.magnification[i]), F, float(focus_mm))
        else:
            lens = Perspective(float(self.focal_length_mm[i]), F, float(focus_mm))
        distance = float(self.mirror_distance_mm[i])
        return Sensor(
            mirror, lens, imager, mirror_distance_mm=distance, name=name, housing=self.housing
        )


WALL_KINDS = ("none", "plane", "cylinder", "sphere")
"""Wall kinds in the order of the compiled evaluator."""
_NUMBERS = (
    "mirror_distance_mm",
    "rim_radius_mm",
    "focal_length_mm",
    "f_number",
    "vertex_radius_mm",
    "conic",
    "magnification",
)
"""Per-design numbers in the order of the compiled evaluator."""


@dataclass(frozen=True, eq=False)
class BatchEvaluation:
    """Evaluation of n designs at k field angles, each design at its own best focus.

    Attributes
    ----------
    columns : (10, n, k)
        In the order of :data:`BATCH_COLUMNS`; also available as attributes.
    focus_mm, worst_floored_area_deg2 : (n,)
        Focus with the smallest maximum floored blur area, and that area.
    valid : (n,)
        True if the front of a design's surface faces the lens and its mapping is one-to-one from
        node to node; :func:`omnimirror.evaluate` also checks between nodes. The other values of
        invalid designs are meaningless.
    """

    columns: Array
    focus_mm: Array
    worst_floored_area_deg2: Array
    valid: NDArray[np.bool_]

    def __getattr__(self, name: str) -> Any:
        if name in BATCH_COLUMNS:
            return self.columns[BATCH_COLUMNS.index(name)]
        raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")


def evaluate_designs(
    designs: Designs, angles: int | ArrayLike = 100, native: bool | None = None
) -> BatchEvaluation:
    """Evaluate mapping, images and blur of many designs, each at its own best focus.

    Parameters
    ----------
    angles
        Number of field angles (in equal steps from the axis to the rim of the mirror), or fractions
        (k,) of the rim radius.
    native
        True to require, False to avoid the compiled evaluator; by default it is used if available.

    Raises
    ------
    InvalidParameter
        If fractions are outside 0 to 1, or the compiled evaluator is required but missing.

    Examples
    --------
    Two mirrors of the paper's equidistant shape, at two distances from the lens:

    >>> from omnimirror.optics.batch.families import family
    >>> c = [[0.6409, 0.1550, -0.01]] * 2
    >>> designs = Designs(family("even-polynomial", 3), c, [172.0, 180.0], 43.9, 11.6, 4.0, 5.2)
    >>> result = evaluate_designs(designs)
    >>> result.focus_mm.round(1), result.blur_t_px.shape
    (array([205.3, 213.1]), (2, 100))
    """
    u = (
        np.linspace(0.0, 1.0, angles)
        if isinstance(angles, int)
        else np.asarray(angles, dtype=float).ravel()
    )
    if not (u.size and (u >= 0).all() and (u <= 1).all()):
        raise InvalidParameter(
            "angles must contain at least one fraction of the rim radius, from 0 to 1"
        )
    if np.shape(designs.object_distance_mm) not in ((), u.shape):
        raise InvalidParameter(
            f"object_distance_mm must be one number, or one for each of the {u.size} field angles"
        )
    if native and not backend.is_compiled:
        raise InvalidParameter(
            "the compiled evaluator is not available; install omnimirror with a C++20 compiler"
        )
    if backend.is_compiled if native is None else native:
        return _compiled(designs, u)
    blocks = [_block(designs.part(slice(i, i + BLOCK)), u) for i in range(0, len(designs), BLOCK)]
    return BatchEvaluation(
        np.concatenate([b.columns for b in blocks], axis=1),
        *(
            np.concatenate([getattr(b, n) for b in blocks])
            for n in ("focus_mm", "worst_floored_area_deg2", "valid")
        ),
    )


def _profiles(d: Designs, u: Array) -> tuple[Array, ...]:
    """Return x, z, z', z'' and z'/x, (n, k), in mm."""
    basis, M = d.family.basis(u), d.rim_radius_mm[:, None]
    x = u * M
    z, slope, curvature = (d.coefficients @ part for part in basis)
    z, curvature = z * M, curvature / M
    if d.family.has_conic:
        R, k = (v[:, None] for v in (d.vertex_radius_mm, d.conic))
        z, slope, curvature = (
            a + b for a, b in zip((z, slope, curvature), conic_profile(x, R, k), strict=True)
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        slope_over_x = np.where(x > 0, slope / x, curvature)
    return x, z, slope, curvature, slope_over_x


def _optics(d: Designs, u: Array) -> MirrorPointOptics:
    x, z, slope, curvature, slope_over_x = _profiles(d, u)
    near = 1 / np.asarray(d.object_distance_mm, dtype=float)
    if not d.is_bare:
        m = np.full((len(d), 1), np.inf) if d.is_telecentric else d.mirror_distance_mm[:, None]
        rim_sag = _profiles(d, np.ones(1))[1][:, 0]
        aim = aim_of(x, m + z, d.tables)
        return as_rim(
            built_optics(x, z, slope, curvature, slope_over_x, aim, near, d.walls(rim_sag))
        )
    if d.is_telecentric:
        return telecentric_optics(x, z, slope, curvature, slope_over_x, near)
    return node_optics(x, z, slope, curvature, slope_over_x, d.mirror_distance_mm[:, None], near)


def _block(d: Designs, u: Array) -> BatchEvaluation:
    """Evaluate a few designs in NumPy; see :func:`evaluate_designs`."""
    with np.errstate(all="ignore"):
        o = _optics(d, u)
        camera = d.camera(o.ray[:, -1:])
        counts = np.broadcast_to(o.visible & (o.omega >= d.min_omega_deg * DEGREE), o.omega.shape)
        in_field = d.tables is None or (o.ray <= d.tables.end * (1 + ROUNDING)).all(axis=1)
        usable = (o.domega_dx > 0) & (o.cos_incidence > 0) & (o.magnification_s > 0)
        valid: Any = (usable | ~np.broadcast_to(o.visible, usable.shape)).all(axis=1) & in_field
        v, max_area = best_vergences(_areas(d, o, camera, counts))
        image, v = camera.at(o, v[:, None]), v[:, None]
        floor = 1 + image.airy_px**2
        sides = image.t_px**2 + image.own_t_px**2 + floor, image.s_px**2 + image.own_s_px**2 + floor
        area = np.sqrt(sides[0] * sides[1]) / (image.dh * image.dw)
        origin = 0.0 if d.tables is None else d.tables.at(o.ray).pupil_position
        distance: Any = np.negative if d.is_telecentric else np.reciprocal
        columns = (
            o.omega / DEGREE,
            camera.height_px(o.ray, v),
            image.dh,
            image.dw,
            o.viewpoint_z,
            distance(o.vergence_t) + origin,
            distance(o.vergence_s) + origin,
            image.t_px,
            image.s_px,
            area,
        )
        table = np.where(o.visible, np.stack(np.broadcast_arrays(*columns)), np.nan)
        focus = distance(v[:, 0]) + (0.0 if d.tables is None else d.tables.pupil_mm)
        return BatchEvaluation(table, focus, max_area, valid)


def _areas(
    d: Designs, o: MirrorPointOptics, camera: FocusedCamera, counts: Array
) -> IdealAreas | RealAreas:
    """Return the floored areas of designs at any focus."""
    if isinstance(camera, RealCamera):
        return RealAreas.of(o, camera, counts)
    assert isinstance(camera, PerspectiveCamera | TelecentricCamera)
    density = np.where(counts, 1 / (o.magnification_t * o.magnification_s) ** 2, 0.0)
    return IdealAreas(o.vergence_t, o.vergence_s, density, AreaModel.of(camera, len(d)))


def _compiled(d: Designs, u: Array) -> BatchEvaluation:
    """Evaluate all designs with the threads of the compiled evaluator; see :func:`_block`."""
    columns, results = np.empty((len(BATCH_COLUMNS), len(d), u.size)), np.empty((3, len(d)))
    numbers = np.stack([getattr(d, name) for name in _NUMBERS], axis=1)
    basis = np.ascontiguousarray(np.stack(d.family.basis(u)))
    near = np.ascontiguousarray(
        np.broadcast_to(1 / np.asarray(d.object_distance_mm, dtype=float), u.size)
    )
    backend.kernels.evaluate_designs(
        d.coefficients,
        numbers,
        basis,
        kernel_array(u),
        d.family.has_conic,
        d.mode == "paper",
        d.pixel_pitch_um * 1e-3,
        d.image_radius_px or 0.0,
        d.wavelength_nm,
        near,
        d.min_omega_deg * DEGREE,
        FOCUS_SEARCH,
        *_of_lens(d),
        *_of_walls(d),
        columns,
        results,
    )
    focus, max_area, valid = results
    return BatchEvaluation(columns, focus, max_area, valid > 0)


def _of_lens(d: Designs) -> tuple[Array, tuple[float, ...]]:
    """Return the real lens as arguments of the compiled evaluator."""
    if (t := d.tables) is None:
        return np.empty((0, 2, 1)), (0.0,) * 7
    numbers = t.end, t.focal_length_mm, t.f_number, t.pupil_from_principal_mm, t.pupil_mm
    return t.values, (*numbers, *t.bounds)


def _of_walls(d: Designs) -> tuple[Array, tuple[int, float, float]]:
    """Return the walls as arguments of the compiled evaluator."""
    walls = None if d.housing.shell is None else d.walls(_profiles(d, np.ones(1))[1][:, 0])
    if walls is None:
        return np.empty((0, 1)), (0, 1.0, 1.0)
    inner, outer = walls.sides
    ends = (0.0, 0.0) if walls.ends is None else walls.ends
    rows = (inner.radius, outer.radius, inner.height, outer.height, *ends, walls.fits)
    numbers = np.hstack(
        [np.broadcast_to(np.asarray(row, dtype=float), (len(d), 1)) for row in rows]
    )
    return np.ascontiguousarray(numbers), (WALL_KINDS.index(inner.kind), *walls.indices)
