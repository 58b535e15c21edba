"""Initial values of a fit: models of each kind from linear least squares over the field."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.models import (
    CameraModel,
    DoubleSphere,
    EnhancedUnified,
    KannalaBrandt,
    OCam,
    RationalPinhole,
    ThinPrismFisheye,
    Unified,
)
from .sampling import Sample

PINHOLE_END = np.radians(89.9)
ODD = (1, 3, 5, 7)  # powers of the field angle in a smooth rotationally symmetric projection


@dataclass(frozen=True)
class RoundPicture:
    """Projection as matrix, centre, and radius as a function of the field angle."""

    centre_px: tuple[float, float]
    matrix: Array
    """Matrix (2, 2) from the symmetric image to the real one, both (right, down), near identity."""
    omega: Array
    """Field angles (n,), radians."""
    radius: Array
    """Radii (n,) px in the symmetric image."""
    common: dict[str, Any]
    """Common arguments of all models: size, optics, mount."""

    def least_squares(self, law: Array) -> tuple[float, float]:
        """Return the focal length of ``r = f law(Omega)`` and the rms residual in px."""
        f = float(law @ self.radius / (law @ law))
        return f, float(np.sqrt(np.mean((f * law - self.radius) ** 2)))


def round_picture(sample: Sample, image_size: tuple[int, int]) -> RoundPicture:
    """Estimate centre, matrix and radii of a sample by two linear least-squares fits.

    The first fit is rotationally symmetric, the second includes the matrix.
    """
    x, y, _ = sample.in_file.T
    omega = sample.omega
    length = np.maximum(np.hypot(x, y), 1e-300)
    side = np.stack([x / length, y / length], axis=-1)
    powers = (omega[:, None] / omega.max()) ** np.array(ODD)
    n = len(omega)
    columns = np.zeros((n, 2, 2 + len(ODD)))
    columns[:, 0, 0] = columns[:, 1, 1] = 1.0
    columns[:, :, 2:] = side[:, :, None] * powers[:, None, :]
    found = np.linalg.lstsq(columns.reshape(2 * n, -1), sample.pixels.reshape(-1), rcond=None)[0]
    radius = powers @ found[2:]
    flat = np.column_stack([radius[:, None] * side, np.ones(n)])
    solution = np.linalg.lstsq(flat, sample.pixels, rcond=None)[0]
    matrix, centre = solution[:2].T, solution[2]
    if not np.linalg.det(matrix) > 1e-3:
        raise InvalidParameter("the picture does not grow with the field angle around a centre, so no model fits it")
    plane = (sample.pixels - centre) @ np.linalg.inv(matrix).T
    u, v = (float(x) for x in centre)
    common: dict[str, Any] = {
        "centre_px": (u, v),
        "image_size": image_size,
        "optics": "mirror" if sample.looks_back else "fisheye",
        "mount": sample.mount,
    }
    return RoundPicture((u, v), matrix, omega, np.sum(plane * side, axis=1), common)


def start(kind: type[CameraModel], places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    """Yield initial models of a kind, simplest first.

    Parameters
    ----------
    kind
        Class of the camera model.
    places
        Names of parameters that may differ from 0; None for all.
    picture
        Projection to approximate.

    Raises
    ------
    InvalidParameter
        If the kind cannot cover the field; the message states the reason.
    """
    yield from STARTS[kind](places, picture)


def _focal(f: float, places: frozenset[str] | None, picture: RoundPicture) -> dict[str, Any]:
    (a, skew), (_, d) = picture.matrix
    made = {"focal_px": (float(a * f), float(d * f)), **picture.common}
    if places is None or "skew" in places:
        made["skew_px"] = float(skew * f)
    return made


def _kannala_brandt(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    """Yield the fit of ``r = f (Omega + k1 Omega^3 + ...)``, which is linear in f and f k."""
    scale = picture.omega.max()
    powers = 2 * np.arange(5) + 1
    found = np.linalg.lstsq((picture.omega / scale)[:, None] ** powers, picture.radius, rcond=None)[0]
    f, *rest = found / scale**powers
    ks: dict[str, Any] = {f"k{i}": float(value / f) for i, value in enumerate(rest, start=1)}
    kind = ThinPrismFisheye if places is not None and "k6" in places else KannalaBrandt
    yield kind(**_focal(f, places, picture), **ks)


def _unified(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    """Yield models with the best xi below and above 1, or a pinhole if xi is fixed."""
    if places is not None and "xi" not in places:
        yield from _pinhole(Unified, {"xi": 0.0}, places, picture)
        return
    found: list[CameraModel] = []
    refusal = InvalidParameter("")
    for xi in (np.linspace(0.0, 1.0, 41), np.linspace(1.0, 3.0, 41)):
        try:
            found.append(Unified(**_best(picture, places, _unified_law, lambda o, xi: np.cos(o) + xi, {"xi": xi})))
        except InvalidParameter as problem:
            refusal = problem
    if not found:
        raise refusal
    yield from found


def _pinhole(
    kind: Any, fixed: dict[str, float], places: frozenset[str] | None, picture: RoundPicture
) -> Iterator[CameraModel]:
    """Yield the fit of ``r = f (t + k1 t^3 + k2 t^5 + k3 t^7)`` with ``t = tan(Omega)``.

    The number of terms is the maximum for which the projection does not fold within the field.
    """
    if not picture.omega.max() < PINHOLE_END:
        raise InvalidParameter(
            f"reaches less far than the field, {np.degrees(picture.omega.max()):.4g} deg from the axis: a pinhole's "
            "picture is infinitely large at 90 deg"
        )
    tan = np.tan(picture.omega)
    scale = tan.max()
    for terms in (4, 3, 2, 1):
        powers = 2 * np.arange(terms) + 1
        f, *rest = np.linalg.lstsq((tan / scale)[:, None] ** powers, picture.radius, rcond=None)[0] / scale**powers
        if f > 0:
            ks: dict[str, Any] = {f"k{i}": float(value / f) for i, value in enumerate(rest, start=1)}
            model: CameraModel = kind(**fixed, **_focal(float(f), places, picture), **ks)
            if model.image(_edge(picture), distant=True).valid.all():
                yield model
                return


def _edge(picture: RoundPicture) -> Array:
    """Return directions (n, 3) around the boundary of the field, in the camera frame."""
    phi = np.linspace(0, 2 * np.pi, 16)
    ahead = -1.0 if picture.common["optics"] == "mirror" else 1.0
    omega = picture.omega.max()
    return np.stack([np.sin(omega) * np.cos(phi), np.sin(omega) * np.sin(phi), np.full(16, ahead * np.cos(omega))], -1)


def _unified_law(omega: Array, xi: float) -> Array:
    return np.asarray(np.sin(omega) / (np.cos(omega) + xi))


def _rational(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    """Yield a pinhole model without denominator."""
    yield from _pinhole(RationalPinhole, {}, places, picture)


def _enhanced(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    def depth(o: Array, alpha: float, beta: float) -> Array:
        return np.asarray(alpha * np.sqrt(beta * np.sin(o) ** 2 + np.cos(o) ** 2) + (1 - alpha) * np.cos(o))

    grid = {"alpha": np.linspace(0.02, 0.98, 25), "beta": np.geomspace(0.3, 4.0, 25)}
    yield EnhancedUnified(**_best(picture, places, lambda o, a, b: np.sin(o) / depth(o, a, b), depth, grid))


def _double(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    def depth(o: Array, xi: float, alpha: float) -> Array:
        z = xi + np.cos(o)
        return np.asarray(alpha * np.hypot(np.sin(o), z) + (1 - alpha) * z)

    grid = {"xi": np.linspace(-0.9, 0.95, 25), "alpha": np.linspace(0.02, 0.98, 25)}
    yield DoubleSphere(**_best(picture, places, lambda o, xi, a: np.sin(o) / depth(o, xi, a), depth, grid))


def _best(
    picture: RoundPicture,
    places: frozenset[str] | None,
    law: Callable[..., Array],
    depth: Callable[..., Array],
    grid: dict[str, Array],
) -> dict[str, Any]:
    """Return the arguments of the best fit among models with increasing radius over the field."""
    omega = np.linspace(0.0, picture.omega.max(), 200)
    best, arguments = np.inf, None
    for values in product(*grid.values()):
        with np.errstate(all="ignore"):
            grows = (depth(omega, *values) > 1e-3).all() and (np.diff(law(omega, *values)) > 0).all()
        if grows:
            f, left = picture.least_squares(law(picture.omega, *values))
            if left < best:
                best = left
                arguments = {**dict(zip(grid, map(float, values), strict=True)), **_focal(f, places, picture)}
    if arguments is None:
        raise InvalidParameter(
            f"reaches less far than the field, {np.degrees(picture.omega.max()):.4g} deg from the axis"
        )
    return arguments


def _ocam(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    """Yield fits of ``f(rho) sin(Omega) = -rho cos(Omega)``, linear in the coefficients."""
    (a, e), (d, c) = picture.matrix
    rho = a * picture.radius
    scale = rho.max()
    for degree in (4,) if places is not None else (4, 6, 8):
        powers = np.array([0, *range(2, degree + 1)])
        terms = (rho / scale)[:, None] ** powers * np.sin(picture.omega)[:, None]
        found = np.linalg.lstsq(terms, -rho * np.cos(picture.omega), rcond=None)[0] / scale**powers
        polynomial = (float(found[0]), 0.0, *map(float, found[1:]))
        is_round = places is not None and "c" not in places
        affine = (1.0, 0.0, 0.0) if is_round else (float(c / a), float(d / a), float(e / a))
        yield OCam(polynomial, affine=affine, **picture.common)


STARTS: dict[type[Any], Callable[[frozenset[str] | None, RoundPicture], Iterator[CameraModel]]] = {
    KannalaBrandt: _kannala_brandt,
    ThinPrismFisheye: _kannala_brandt,
    RationalPinhole: _rational,
    Unified: _unified,
    EnhancedUnified: _enhanced,
    DoubleSphere: _double,
    OCam: _ocam,
}
