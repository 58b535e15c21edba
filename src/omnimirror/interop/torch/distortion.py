"""Brown's distortion and its inverse on tensors; see :mod:`omnimirror.lenses.distortion`."""

from __future__ import annotations

from .library import Tensor, torch
from .numbers import plain

STEPS = 20
FAR = 1e6  # a tangent that no lens shows
CLOSE = 1e-9  # the step after one this small leaves its square


def distorted(x: Tensor, y: Tensor, brown: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Where an ideal lens's image points really are, all in tangents."""
    k1, k2, k3, p1, p2 = brown
    s = x * x + y * y
    bend = 1 + s * (k1 + s * (k2 + s * k3))
    return x * bend + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * bend + p1 * (s + 2 * y * y) + 2 * p2 * x * y


def undistorted(x: Tensor, y: Tensor, brown: list[Tensor]) -> tuple[Tensor, Tensor]:
    """The inverse, of which the last step of Newton's rule alone is recorded for gradients: those are exact then.

    Where nothing is sent the ideal lens's place is out of every mirror, and without a gradient.
    """
    with torch.no_grad():
        fixed = [plain(term) for term in brown]
        u, v, wanted = x, y, (x, y)
        for _ in range(STEPS):
            du, dv = _step(u, v, wanted, fixed)
            u, v = u - du, v - dv
            if float(torch.maximum(du.abs().max(), dv.abs().max())) < CLOSE:
                break
        a, b, c = _rates(u, v, fixed)
        det = a * c - b * b
        sent = (du.abs() < CLOSE) & (dv.abs() < CLOSE) & (det > 0)
        u, v, det = torch.where(sent, u, FAR), torch.where(sent, v, FAR), torch.where(sent, det, torch.inf)
    ex, ey = (found - target for found, target in zip(distorted(u, v, brown), (x, y), strict=True))
    return u - (c * ex - b * ey) / det, v - (a * ey - b * ex) / det


def _step(u: Tensor, v: Tensor, wanted: tuple[Tensor, Tensor], brown: list[float]) -> tuple[Tensor, Tensor]:
    ex, ey = (found - target for found, target in zip(distorted(u, v, brown), wanted, strict=True))
    a, b, c = _rates(u, v, brown)
    det = a * c - b * b
    return (c * ex - b * ey) / det, (a * ey - b * ex) / det


def _rates(x: Tensor, y: Tensor, brown: list[float]) -> tuple[Tensor, Tensor, Tensor]:
    """Derivatives dx'/dx, dx'/dy = dy'/dx and dy'/dy."""
    k1, k2, k3, p1, p2 = brown
    s = x * x + y * y
    bend, rate = 1 + s * (k1 + s * (k2 + s * k3)), k1 + s * (2 * k2 + s * 3 * k3)
    return (
        bend + 2 * x * x * rate + 2 * p1 * y + 6 * p2 * x,
        2 * x * y * rate + 2 * p1 * x + 2 * p2 * y,
        bend + 2 * y * y * rate + 6 * p1 * y + 2 * p2 * x,
    )
