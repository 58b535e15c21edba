"""Straight edges beside boards and points: what they say of a camera, in the form in which a bundle takes it.

An edge has no target whose place could be estimated: it lies in some plane through the viewpoint, which is found for
each trial anew (:mod:`omnimirror.calibration.lines.fitting`). So all that edges say, near a camera, is a quadratic
in its
parameters. It is added to the normal equations like a prior, and formed anew where these lead, until nothing moves:
there the sum of everything is least.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import finite, number
from ....base.errors import InvalidParameter
from ....cameras.models.base import CameraModel
from ...lines.fitting import Knobs, LinesFit, edges_of, fitted_lines
from ...lines.marked import LEAST_POINTS

Array = NDArray[np.float64]

FEWEST = 3  # edges that say something together
INDEPENDENT = 4  # values by which an edge that is not quite straight is off, however many its points are
LEAST_NOISE_PX = 0.05
OUTLYING, LEAST_OUTLYING_PX, MOST_PX = 3.0, 0.4, 3.0  # of the median error of edges; and of any that is straight
NOTHING = 1e-12  # of the largest eigenvalue: a combination of parameters of which edges say nothing


class Knowledge(NamedTuple):
    """What is known of a model's parameters from edges."""

    information: Array
    """(p, p) inverse of a covariance"""
    expected: Array
    """(p,)"""


class Edge(NamedTuple):
    """Points that were marked on one straight edge."""

    picture: str
    number: int
    """in its picture, from 1"""
    pixels: Array
    """(n, 2)"""

    @property
    def name(self) -> str:
        return f"edge {self.number} of {self.picture}"


@dataclass(frozen=True)
class StraightEdges:
    """Edges of all pictures, at a distance that matters to cameras with several viewpoints."""

    edges: tuple[Edge, ...]
    distance_mm: float = np.inf

    @classmethod
    def of(cls, lines: Mapping[str, Sequence[Array]], distance_mm: float, size: tuple[int, int]) -> StraightEdges:
        """Of what :func:`omnimirror.read_lines` gives.

        Raises
        ------
        InvalidParameter
            Too few edges, or one of too few points or outside the pictures.
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
        """How straight a camera sees them, as it is."""
        names = tuple((p.name,) for p in model.parameters)
        nothing = np.zeros(len(names))
        knobs = Knobs(names, np.eye(len(names)), nothing, nothing, np.array([p.scale for p in model.parameters]))
        chains = edges_of([edge.pixels for edge in self.edges])
        return fitted_lines(model, chains, knobs, distance_mm=self.distance_mm, most_steps=0)

    def rms_px(self, model: CameraModel) -> Array:
        """How far (k,) their points are off a straight line's image; infinite where the camera does not see one."""
        return self.fit(model).rms_of(edges_of([edge.pixels for edge in self.edges]))

    def known(self, model: CameraModel) -> Knowledge:
        """What they say of the parameters of a camera near this one.

        Points of one edge are wrong together, where it is not quite straight: they count as a few, however many.
        """
        fit = self.fit(model)
        count = len(model.parameters)
        matrix, gradient, squares, values = np.zeros((count, count)), np.zeros(count), 0.0, 0.0
        for part, weight in zip(edges_of([e.pixels for e in self.edges]).slices, fit.weights, strict=True):
            seen = np.isfinite(fit.residuals[part])
            r, a = fit.residuals[part][seen], fit.rates[part][seen]
            independent = min(len(r) - 2, INDEPENDENT)  # two say where its plane is
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
        """Those that a camera makes straight, and that it does not see, as others may; the rest is round or crooked."""
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
    """The shortest step, in typical changes, to where a gradient vanishes."""
    size = np.asarray(scales)
    inverse = np.linalg.pinv(matrix * size[:, None] * size, rcond=NOTHING, hermitian=True)
    return np.asarray(size * (inverse @ (size * gradient)))
