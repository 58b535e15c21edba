"""Straight edges as additional observations of a bundle adjustment.

An edge has no target pose: it is in a plane through the viewpoint, which is fitted for each
trial (:mod:`omnimirror.calibration.lines.fitting`). Near a camera, the contribution of edges is
therefore a quadratic form in its parameters. It is added to the normal equations like a prior and
relinearised at each solution until convergence to the minimum of the total sum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ....base.arguments import finite, number
from ....base.errors import InvalidParameter
from ....base.typing import Array
from ....cameras.models.base import CameraModel
from ...lines.fitting import Knobs, LinesFit, edges_of, fitted_lines
from ...lines.marked import LEAST_POINTS

FEWEST = 3  # minimum number of edges
INDEPENDENT = 4  # independent values per edge, whatever its number of points
LEAST_NOISE_PX = 0.05
OUTLYING, LEAST_OUTLYING_PX, MOST_PX = 3.0, 0.4, 3.0  # outlier limits: ratio to median, min and max
NOTHING = 1e-12  # relative to the largest eigenvalue; smaller ones are unconstrained


class Knowledge(NamedTuple):
    """Information on model parameters from edges."""

    information: Array
    """Information matrix (p, p), the inverse of a covariance."""
    expected: Array
    """Expected values (p,)."""


class Edge(NamedTuple):
    """Points marked on one straight edge."""

    picture: str
    number: int
    """Number in its image, from 1."""
    pixels: Array
    """Pixels (n, 2)."""

    @property
    def name(self) -> str:
        return f"edge {self.number} of {self.picture}"


@dataclass(frozen=True)
class StraightEdges:
    """Edges of all images, with a distance that is relevant for cameras with several viewpoints."""

    edges: tuple[Edge, ...]
    distance_mm: float = np.inf

    @classmethod
    def of(cls, lines: Mapping[str, Sequence[Array]], distance_mm: float, size: tuple[int, int]) -> StraightEdges:
        """Create from the result of :func:`omnimirror.read_lines`.

        Raises
        ------
        InvalidParameter
            If there are too few edges or points, or points outside the image.
        """
        number("lines_distance_mm", distance_mm if np.isfinite(distance_mm) else 1.0, above=0.0)
        found = []
        for picture, marked in lines.items():
            for place, points in enumerate(marked, 1):
                edge = Edge(picture, place, finite("lines", points, last=2))
                if edge.pixels.ndim != 2 or len(edge.pixels) < LEAST_POINTS:
                    raise InvalidParameter(
                        f"{edge.name} has the shape {edge.pixels.shape}; valid is (n, 2), n from {LEAST_POINTS} on"
                    )
                outside = np.any((edge.pixels < -0.5) | (edge.pixels > np.array(size) - 0.5), axis=1)
                if outside.any():
                    (u, v), (width, height) = edge.pixels[outside][0], size
                    raise InvalidParameter(f"{edge.name}: pixel {u:g}, {v:g} lies outside of {width} x {height} px")
                found.append(edge)
        if len(found) < FEWEST:
            raise InvalidParameter(f"{len(found)} straight edges say too little; {FEWEST} are the fewest")
        return cls(tuple(found), distance_mm)

    def fit(self, model: CameraModel) -> LinesFit:
        """Evaluate the straightness of the edges for a camera without changing it."""
        names = tuple((p.name,) for p in model.parameters)
        nothing = np.zeros(len(names))
        knobs = Knobs(names, np.eye(len(names)), nothing, nothing, np.array([p.scale for p in model.parameters]))
        chains = edges_of([edge.pixels for edge in self.edges])
        return fitted_lines(model, chains, knobs, distance_mm=self.distance_mm, most_steps=0)

    def rms_px(self, model: CameraModel) -> Array:
        """Return the rms deviation (k,) of each edge from a straight line's image, px.

        It is infinite for invisible edges.
        """
        return self.fit(model).rms_of(edges_of([edge.pixels for edge in self.edges]))

    def known(self, model: CameraModel) -> Knowledge:
        """Return the information on the parameters of a camera, linearised at this camera.

        Errors of points on one edge are correlated if it is not exactly straight: an edge counts as
        a few independent values, whatever its number of points.
        """
        fit = self.fit(model)
        count = len(model.parameters)
        matrix, gradient, squares, values = np.zeros((count, count)), np.zeros(count), 0.0, 0.0
        for part, weight in zip(edges_of([e.pixels for e in self.edges]).slices, fit.weights, strict=True):
            seen = np.isfinite(fit.residuals[part])
            r, a = fit.residuals[part][seen], fit.rates[part][seen]
            independent = min(len(r) - 2, INDEPENDENT)  # two define its plane
            if independent < 1:
                continue
            share = float(weight) * independent / len(r)
            matrix, gradient = matrix + share * a.T @ a, gradient + share * a.T @ r
            squares, values = (
                squares + share * len(r) / (len(r) - 2) * float(r @ r),
                values + float(weight) * independent,
            )
        noise = max(float(np.sqrt(squares / values)) if values else 1.0, LEAST_NOISE_PX)
        start = np.array([p.value for p in model.parameters])
        return Knowledge(matrix / noise**2, start - _solved(matrix, gradient, [p.scale for p in model.parameters]))

    def straight_for(self, model: CameraModel) -> StraightEdges:
        """Return the edges that a camera straightens or does not see; curved edges are removed."""
        rms = self.rms_px(model)
        seen = rms[np.isfinite(rms)]
        limit = min(max(OUTLYING * float(np.median(seen)), LEAST_OUTLYING_PX), MOST_PX) if len(seen) else 0.0
        kept = tuple(edge for edge, r in zip(self.edges, rms, strict=True) if r <= limit or np.isinf(r))
        if (count := int((rms <= limit).sum())) < FEWEST:
            raise InvalidParameter(
                f"of {len(self.edges)} edges {count} can be straight for this camera, and {FEWEST} are the fewest; "
                "see whether they are of its pictures"
            )
        return replace(self, edges=kept)


def _solved(matrix: Array, gradient: Array, scales: Sequence[float]) -> Array:
    """Return the step of minimum norm, in typical parameter changes, to a zero gradient."""
    size = np.asarray(scales)
    inverse = np.linalg.pinv(matrix * size[:, None] * size, rcond=NOTHING, hermitian=True)
    return np.asarray(size * (inverse @ (size * gradient)))
