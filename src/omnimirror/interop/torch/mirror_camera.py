"""A sensor of one mirror and an ordinary lens, whose parts are tensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...calibrate.physical.names import DISTANCE, place_of
from ...sensor import Sensor
from .cameras import TorchCamera, TorchProjection, TorchRays, pieces_of
from .distortion import distorted, undistorted
from .library import Tensor, torch
from .numbers import Numbers
from .pieces import Pieces, rate_table
from .reflection import Components, Learned, SurfaceTable, met_by, seen_by

BROWN = ("lens.k1", "lens.k2", "lens.k3", "lens.p1", "lens.p2")
EDGE = 0.5 + 1e-9


class MirrorCamera(TorchCamera):
    """Wherever its mirror sits, traced in space; see :func:`omnimirror.interop.torch.differentiable`."""

    def __init__(self, sensor: Sensor, free: dict[str, Tensor], dtype: object, device: object) -> None:
        self.numbers, self.parameters = Numbers(sensor, free), free
        self.image_size, self.dtype, self.device = sensor.image_size, dtype, device
        self.axes: list[list[float]] = sensor._axes.tolist()
        self._surface: tuple[Sensor, SurfaceTable] | None = None

    @property
    def sensor(self) -> Sensor:
        """The sensor with its parameters as they are now."""
        return self.numbers.present()

    def _rays(self, pixels: Tensor, shape: Sequence[int]) -> TorchRays:
        surface = self._present_surface()
        parts = [self._reflected(surface, pixels[piece]) for piece in pieces_of(len(pixels), pixels.device.type)]
        origins, directions, valid = (torch.cat(part, dim=-1) for part in zip(*parts, strict=True))
        return TorchRays(origins.T.reshape(*shape, 3), directions.T.reshape(*shape, 3), valid.reshape(shape))

    def _projected(self, targets: Tensor, shape: Sequence[int], distant: bool) -> TorchProjection:
        surface, pieces = self._present_surface(), pieces_of(len(targets), targets.device.type)
        parts = [self._image(surface, targets[piece], distant) for piece in pieces]
        pixels, valid = (torch.cat(part, dim=-1) for part in zip(*parts, strict=True))
        return TorchProjection(pixels.T.reshape(*shape, 2), valid.reshape(shape))

    def _present_surface(self) -> SurfaceTable:
        """Tables of the mirror as it is now: made again only after its parameters have changed."""
        sensor = self.sensor
        if self._surface is None or self._surface[0] != sensor:
            self._surface = sensor, self._tabulated(sensor)
        return self._surface[1]

    def _tabulated(self, sensor: Sensor) -> SurfaceTable:
        distance = sensor.mirror_distance_mm + sensor.mirror_pose.displacement_mm - sensor.lens.pupil.at_mm
        surface = SurfaceTable.of(sensor.mirror, distance, self.dtype, self.device)
        learned = []
        for name, value in self.parameters.items():
            if name.startswith("mirror."):
                rates = rate_table(sensor.mirror, place_of(sensor, name))
                learned.append(Learned(value, Pieces(rates, self.dtype, self.device)))
        return replace(surface, learned=tuple(learned))

    # -- from pixels to rays -----------------------------------------------------------------------

    def _reflected(self, surface: SurfaceTable, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Origins (3, n), directions (3, n) and valid (n,) of pixels (n, 2)."""
        u, v = pixels.unbind(-1)
        valid = self._in_picture(u, v)
        if not bool(valid.all()):
            u, v = (torch.where(valid, a, b) for a, b in zip((u, v), self._middle, strict=True))
        start, way = self._lens_rays(u, v)
        met = met_by(surface, start, way)
        (sx, sy), (x, y, z), valid = met.slopes, way, valid & met.valid
        twice = 2 * (x * sx + y * sy - z) / (1 + sx * sx + sy * sy)
        length = torch.rsqrt(x * x + y * y + z * z)
        away = (x - twice * sx) * length, (y - twice * sy) * length, (z + twice) * length
        origins = torch.stack(_turned(self.numbers.to_camera(met.points), self.axes))
        directions = torch.stack(_turned(self.numbers.to_camera(away, distant=True), self.axes))
        if not bool(valid.all()):
            origins, directions = (torch.where(valid, part, 0.0) for part in (origins, directions))
        return origins, directions, valid

    @property
    def _middle(self) -> tuple[float, float]:
        """A pixel that sees something, in place of those outside the picture."""
        width, height = self.image_size
        return 0.25 * width, 0.5 * height

    def _in_picture(self, u: Tensor, v: Tensor) -> Tensor:
        width, height = self.image_size
        return (u >= -EDGE) & (u <= width - 1 + EDGE) & (v >= -EDGE) & (v <= height - 1 + EDGE)

    def _lens_rays(self, u: Tensor, v: Tensor) -> tuple[Components, Components]:
        """Origins and directions from the lens, components in the mirror's frame."""
        numbers, lens = self.numbers, self.numbers.sensor.lens
        if numbers.sensor.mount.image_flipped:
            u = self.image_size[0] - 1 - u
        scale = numbers.pitch_mm / numbers.image_scale
        x, y = ((a - numbers[f"imager.centre_px[{k}]"]) * scale for k, a in enumerate((u, v)))
        if lens.TELECENTRIC:
            ahead = tuple(-a for a in numbers.pupil)
            before = -2 * numbers.sensor.mirror.rim_radius_mm
            return numbers.to_mirror((x, y, before)), tuple(a + 0 * x for a in ahead)
        if not numbers.fixed(*BROWN):
            x, y = undistorted(x, y, [numbers[name] for name in BROWN])
        return numbers.pupil, numbers.to_mirror((x, y, 1.0), distant=True)

    # -- from the world to pixels ------------------------------------------------------------------

    def _image(self, surface: SurfaceTable, targets: Tensor, distant: bool) -> tuple[Tensor, Tensor]:
        """Pixels (2, n) and valid (n,) of targets (n, 3)."""
        valid = torch.isfinite(targets.detach().sum(dim=1))
        if distant:
            valid = valid & (targets != 0).any(dim=1)
        if not bool(valid.all()):
            targets = torch.where(valid[:, None], targets, targets.new_tensor([1e3, 1e3, 0.0]))
        components = _turned(targets.unbind(-1), list(zip(*self.axes, strict=True)))
        if distant:
            length = torch.rsqrt(sum(part * part for part in components))
            components = tuple(part * length for part in components)
        numbers, telecentric = self.numbers, self.numbers.sensor.lens.TELECENTRIC
        met = seen_by(surface, numbers.pupil, numbers.to_mirror(components, distant), telecentric, distant)
        u, v, before = self._lens_image(numbers.to_camera(met.points))
        valid, pixels = valid & met.valid & before & self._in_picture(u, v), torch.stack([u, v])
        return (pixels if bool(valid.all()) else torch.where(valid, pixels, 0.0)), valid

    def _lens_image(self, point: Components) -> Components:
        """Columns and rows of points of the camera frame, and whether they are before the lens."""
        numbers, lens = self.numbers, self.numbers.sensor.lens
        x, y, z = point
        before = torch.ones_like(x, dtype=torch.bool)
        if not lens.TELECENTRIC:
            depth = z + numbers[DISTANCE] - lens.pupil.at_mm
            x, y, before = x / depth, y / depth, depth > 0
            if not numbers.fixed(*BROWN):
                x, y = distorted(x, y, [numbers[name] for name in BROWN])
        scale = numbers.image_scale / numbers.pitch_mm
        u, v = (a * scale + numbers[f"imager.centre_px[{k}]"] for k, a in enumerate((x, y)))
        return (self.image_size[0] - 1 - u if numbers.sensor.mount.image_flipped else u), v, before


def _turned(xyz: Components, rows: Sequence[Sequence[float]]) -> Components:
    """Vectors, by components, turned by a matrix; mounts mostly exchange axes, so that zeros are left out."""

    def sum_of(row: Sequence[float]) -> Tensor:
        return sum(part if share == 1.0 else share * part for share, part in zip(row, xyz, strict=True) if share)

    x, y, z = map(sum_of, rows)
    return x, y, z
