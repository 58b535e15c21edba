"""Where a fit begins: a model of each kind from linear least squares over the field, without a guess from the user."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
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

Array = NDArray[np.float64]

PINHOLE_END = np.radians(89.9)
ODD = (1, 3, 5, 7)  # powers of the field angle that a smooth round picture is made of


@dataclass(frozen=True)
class RoundPicture:
    """The picture as a matrix, a centre, and a radius for every field angle."""

    centre_px: tuple[float, float]
    matrix: Array
    """(2, 2), from the round picture to the real one, both (right, down), near 1."""
    omega: Array
    """(n,) field angles, radians."""
    radius: Array
    """(n,) px in the round picture."""
    common: dict[str, Any]
    """What every model is made with: size, optics, mount."""

    def least_squares(self, law: Array) -> tuple[float, float]:
        """The focal length that fits radii ``f law(Omega)``, and what is left, px rms."""
        f = float(law @ self.radius / (law @ law))
        return f, float(np.sqrt(np.mean((f * law - self.radius) ** 2)))


def round_picture(sample: Sample, image_size: tuple[int, int]) -> RoundPicture:
    """Centre, matrix and radii of a sample: two linear least squares, first round, then with a matrix."""
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
    """Models of a kind to begin with, the simplest first.

    Parameters
    ----------
    kind
    places
        The parameters that may differ from 0, None for all.
    picture

    Raises
    ------
    InvalidParameter
        The kind cannot reach over the field; the sentence says why.
    """
    yield from STARTS[kind](places, picture)


def _focal(f: float, places: frozenset[str] | None, picture: RoundPicture) -> dict[str, Any]:
    (a, skew), (_, d) = picture.matrix
    made = {"focal_px": (float(a * f), float(d * f)), **picture.common}
    if places is None or "skew" in places:
        made["skew_px"] = float(skew * f)
    return made


def _kannala_brandt(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    """``r = f (Omega + k1 Omega^3 + ..)`` is linear in f and f k."""
    scale = picture.omega.max()
    powers = 2 * np.arange(5) + 1
    found = np.linalg.lstsq((picture.omega / scale)[:, None] ** powers, picture.radius, rcond=None)[0]
    f, *rest = found / scale**powers
    ks: dict[str, Any] = {f"k{i}": float(value / f) for i, value in enumerate(rest, start=1)}
    kind = ThinPrismFisheye if places is not None and "k6" in places else KannalaBrandt
    yield kind(**_focal(f, places, picture), **ks)


def _unified(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    """The best xi without distortion, up to 1 and from 1 on; a pinhole where there is no place for xi."""
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
    """``r = f (t + k1 t^3 + k2 t^5 + k3 t^7)`` of ``t = tan(Omega)``, with as many terms as do not fold the field."""
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
    """Directions (n, 3) around the end of the field, in the camera frame."""
    phi = np.linspace(0, 2 * np.pi, 16)
    ahead = -1.0 if picture.common["optics"] == "mirror" else 1.0
    omega = picture.omega.max()
    return np.stack([np.sin(omega) * np.cos(phi), np.sin(omega) * np.sin(phi), np.full(16, ahead * np.cos(omega))], -1)


def _unified_law(omega: Array, xi: float) -> Array:
    return np.asarray(np.sin(omega) / (np.cos(omega) + xi))


def _rational(places: frozenset[str] | None, picture: RoundPicture) -> Iterator[CameraModel]:
    """Without a denominator."""
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
    """The arguments of the model whose law fits best, of those that reach over the field with a growing radius."""
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
    """``f(rho) sin(Omega) = -rho cos(Omega)`` is linear in the coefficients of f."""
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
