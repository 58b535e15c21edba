"""Differentiable sensor with one mirror and an ideal lens, with Brown's distortion on tensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...calibration.sensor_parameters import DISTANCE, parameter_location
from ...optics.sensor import Sensor
from ._camera import TorchCamera, TorchProjection, TorchRays, chunk_slices
from ._library import Tensor, torch
from ._parameters import Components, SensorParameters, float_value
from ._reflection import FreeShapeParameter, SurfaceTable, intersect_rays, reflect_targets
from ._tables import PiecewiseCubic, shape_derivative_table

DISTORTION = ("lens.k1", "lens.k2", "lens.k3", "lens.p1", "lens.p2")
HALF_PIXEL = 0.5 + 1e-9
"""Distance of the image edge from the border pixel centres, px, with rounding."""


class MirrorCamera(TorchCamera):
    """Sensor with one mirror in any pose; see :func:`omnimirror.interop.torch.differentiable`."""

    def __init__(
        self, sensor: Sensor, free: dict[str, Tensor], dtype: object, device: object
    ) -> None:
        self.values, self.parameters = SensorParameters(sensor, free), free
        self.image_size, self.dtype, self.device = sensor.image_size, dtype, device
        self.axes: list[list[float]] = sensor._axes.tolist()
        self._surface: tuple[Sensor, SurfaceTable] | None = None

    @property
    def sensor(self) -> Sensor:
        """Sensor with the current values of the parameters."""
        return self.values.current_sensor()

    def _backproject_rows(self, pixels: Tensor, shape: Sequence[int]) -> TorchRays:
        surface = self._current_surface()
        slices = chunk_slices(len(pixels), pixels.device.type)
        chunks = [self._backproject(surface, pixels[chunk]) for chunk in slices]
        origins, directions, valid = (torch.cat(part, dim=-1) for part in zip(*chunks, strict=True))
        return TorchRays(
            origins.T.reshape(*shape, 3), directions.T.reshape(*shape, 3), valid.reshape(shape)
        )

    def _project_rows(
        self, targets: Tensor, shape: Sequence[int], distant: bool
    ) -> TorchProjection:
        surface = self._current_surface()
        slices = chunk_slices(len(targets), targets.device.type)
        chunks = [self._project(surface, targets[chunk], distant) for chunk in slices]
        pixels, valid = (torch.cat(part, dim=-1) for part in zip(*chunks, strict=True))
        return TorchProjection(pixels.T.reshape(*shape, 2), valid.reshape(shape))

    def _current_surface(self) -> SurfaceTable:
        """Return the tables of the current mirror, recomputed after parameter changes."""
        sensor = self.sensor
        if self._surface is None or self._surface[0] != sensor:
            self._surface = sensor, self._tabulate(sensor)
        return self._surface[1]

    def _tabulate(self, sensor: Sensor) -> SurfaceTable:
        distance_mm = sensor.mirror_distance_mm + sensor.mirror_pose.displacement_mm
        pupil_distance_mm = distance_mm - sensor.lens.pupil.at_mm
        surface = SurfaceTable.of(sensor.mirror, pupil_distance_mm, self.dtype, self.device)
        free = []
        for name, value in self.parameters.items():
            if name.startswith("mirror."):
                table = shape_derivative_table(sensor.mirror, parameter_location(sensor, name))
                derivatives = PiecewiseCubic(table, self.dtype, self.device)
                free.append(FreeShapeParameter(value, derivatives))
        return replace(surface, free=tuple(free))

    # -- back-projection -------------------------------------------------------------------------

    def _backproject(self, surface: SurfaceTable, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return origins (3, n), directions (3, n) and validity (n,) of pixels (n, 2)."""
        u, v = pixels.unbind(-1)
        valid = self._is_in_image(u, v)
        if not bool(valid.all()):
            # Substitute a pixel inside the field, so that all values and gradients are finite.
            width, height = self.image_size
            u = torch.where(valid, u, 0.25 * width)
            v = torch.where(valid, v, 0.5 * height)
        start, direction = self._lens_rays(u, v)
        hits = intersect_rays(surface, start, direction)
        (sx, sy), (x, y, z), valid = hits.slopes, direction, valid & hits.valid
        # Law of reflection d - 2 (d n) n with the normal n = (sx, sy, -1) / sqrt(1 + sx^2 + sy^2).
        twice = 2 * (x * sx + y * sy - z) / (1 + sx * sx + sy * sy)
        scale = torch.rsqrt(x * x + y * y + z * z)
        reflected = (x - twice * sx) * scale, (y - twice * sy) * scale, (z + twice) * scale
        values = self.values
        origins = torch.stack(_rotate(values.to_camera(hits.points), self.axes))
        directions = torch.stack(_rotate(values.to_camera(reflected, distant=True), self.axes))
        if not bool(valid.all()):
            origins = torch.where(valid, origins, 0.0)
            directions = torch.where(valid, directions, 0.0)
        return origins, directions, valid

    def _is_in_image(self, u: Tensor, v: Tensor) -> Tensor:
        width, height = self.image_size
        inside_u = (u >= -HALF_PIXEL) & (u <= width - 1 + HALF_PIXEL)
        return inside_u & (v >= -HALF_PIXEL) & (v <= height - 1 + HALF_PIXEL)

    def _lens_rays(self, u: Tensor, v: Tensor) -> tuple[Components, Components]:
        """Return origins and directions of rays from the lens in the mirror frame."""
        values, lens = self.values, self.values.sensor.lens
        if values.sensor.mount.image_flipped:
            u = self.image_size[0] - 1 - u
        scale = values.pitch_mm / values.image_scale
        x, y = ((a - values[f"imager.centre_px[{k}]"]) * scale for k, a in enumerate((u, v)))
        if lens.TELECENTRIC:
            start_z = -2 * values.sensor.mirror.rim_radius_mm
            px, py, pz = values.pupil
            direction = -px + 0 * x, -py + 0 * x, -pz + 0 * x
            return values.to_mirror((x, y, start_z)), direction
        if not values.are_zero(*DISTORTION):
            x, y = undistort(x, y, [values[name] for name in DISTORTION])
        return values.pupil, values.to_mirror((x, y, 1.0), distant=True)

    # -- projection ------------------------------------------------------------------------------

    def _project(
        self, surface: SurfaceTable, targets: Tensor, distant: bool
    ) -> tuple[Tensor, Tensor]:
        """Return pixels (2, n) and validity (n,) of targets (n, 3)."""
        valid = torch.isfinite(targets.detach().sum(dim=1))
        if distant:
            valid = valid & (targets != 0).any(dim=1)
        if not bool(valid.all()):
            substitute = targets.new_tensor([1e3, 1e3, 0.0])
            targets = torch.where(valid[:, None], targets, substitute)
        components = _rotate(targets.unbind(-1), list(zip(*self.axes, strict=True)))
        if distant:
            scale = torch.rsqrt(sum(part * part for part in components))
            components = tuple(part * scale for part in components)
        values, telecentric = self.values, self.values.sensor.lens.TELECENTRIC
        mirror_targets = values.to_mirror(components, distant)
        hits = reflect_targets(surface, values.pupil, mirror_targets, telecentric, distant)
        u, v, in_front = self._lens_image(values.to_camera(hits.points))
        valid = valid & hits.valid & in_front & self._is_in_image(u, v)
        pixels = torch.stack([u, v])
        if not bool(valid.all()):
            pixels = torch.where(valid, pixels, 0.0)
        return pixels, valid

    def _lens_image(self, point: Components) -> Components:
        """Return pixel coordinates u, v of points in the camera frame, and whether in front."""
        values, lens = self.values, self.values.sensor.lens
        x, y, z = point
        in_front = torch.ones_like(x, dtype=torch.bool)
        if not lens.TELECENTRIC:
            depth = z + values[DISTANCE] - lens.pupil.at_mm
            x, y, in_front = x / depth, y / depth, depth > 0
            if not values.are_zero(*DISTORTION):
                x, y = distort(x, y, [values[name] for name in DISTORTION])
        scale = values.image_scale / values.pitch_mm
        u, v = (a * scale + values[f"imager.centre_px[{k}]"] for k, a in enumerate((x, y)))
        if values.sensor.mount.image_flipped:
            u = self.image_size[0] - 1 - u
        return u, v, in_front


def _rotate(xyz: Components, rows: Sequence[Sequence[float]]) -> Components:
    """Multiply vectors by a matrix; rows of mounts mostly hold 0 and 1, which are skipped."""

    def product(row: Sequence[float]) -> Tensor:
        terms = zip(row, xyz, strict=True)
        return sum(part if share == 1.0 else share * part for share, part in terms if share)

    x, y, z = map(product, rows)
    return x, y, z


# -- lens distortion (Brown), see omnimirror.optics.lenses.lens -----------------------------------

MAX_ITERATIONS = 20
UNREACHABLE_TANGENT = 1e6
TOLERANCE = 1e-9
"""Newton step after which the error is its square."""


def distort(x: Tensor, y: Tensor, coefficients: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Apply Brown's distortion (k1, k2, k3, p1, p2) to tangents of field angles."""
    k1, k2, k3, p1, p2 = coefficients
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def undistort(x: Tensor, y: Tensor, coefficients: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Invert :func:`distort` by Newton's method.

    Only the last step is recorded for gradients, which makes them exact (implicit function
    theorem). Tangents without a solution are replaced by 1e6, outside every mirror.
    """
    with torch.no_grad():
        fixed = [float_value(term) for term in coefficients]
        u, v, target = x, y, (x, y)
        for _ in range(MAX_ITERATIONS):
            du, dv = _newton_step(u, v, target, fixed)
            u, v = u - du, v - dv
            if float(torch.maximum(du.abs().max(), dv.abs().max())) < TOLERANCE:
                break
        a, b, c = _jacobian(u, v, fixed)
        det = a * c - b * b
        solved = (du.abs() < TOLERANCE) & (dv.abs() < TOLERANCE) & (det > 0)
        u = torch.where(solved, u, UNREACHABLE_TANGENT)
        v = torch.where(solved, v, UNREACHABLE_TANGENT)
        det = torch.where(solved, det, torch.inf)
    distorted = distort(u, v, coefficients)
    ex, ey = distorted[0] - x, distorted[1] - y
    return u - (c * ex - b * ey) / det, v - (a * ey - b * ex) / det


def _newton_step(
    u: Tensor, v: Tensor, target: tuple[Tensor, Tensor], coefficients: list[float]
) -> tuple[Tensor, Tensor]:
    distorted = distort(u, v, coefficients)
    ex, ey = distorted[0] - target[0], distorted[1] - target[1]
    a, b, c = _jacobian(u, v, coefficients)
    det = a * c - b * b
    return (c * ex - b * ey) / det, (a * ey - b * ex) / det


def _jacobian(x: Tensor, y: Tensor, coefficients: list[float]) -> tuple[Tensor, Tensor, Tensor]:
    """Return the derivatives dx'/dx, dx'/dy = dy'/dx and dy'/dy of :func:`distort`."""
    k1, k2, k3, p1, p2 = coefficients
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2 * k2 + r2 * 3 * k3)  # derivative of radial with respect to r2
    return (
        radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
        2 * x * y * slope + 2 * p1 * x + 2 * p2 * y,
        radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
    )
