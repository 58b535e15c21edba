"""Cards of cameras for notebooks: what one is at a glance, as HTML that stands by itself, light or dark."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import OmnimirrorError
from .escaping import html_text
from .lenses import GaussianLens, Lens

if TYPE_CHECKING:
    from .camera_models import CameraModel
    from .sensor import Sensor

Array = NDArray[np.float64]
Rows = Mapping[str, str]

NODES = 61  # of a mirror from rim to rim, and of a ring
RAYS = 7  # field angles whose chief rays are drawn
RING_DEG = 30.0  # between rings of the field
TELECENTRIC_AT = 2.5  # rim radii before the vertex where such a lens is drawn; it may stand anywhere
OUTSIDE = 0.8  # rim radii that rays are drawn into the world
TALL, WIDE = 190.0, 230.0  # px of a drawing at most
MARGIN = 5.0
NUMBERS = 12  # of a model that a card shows at most
LOOKS = {
    "strong": 'stroke-width="2.6"',
    "plain": 'stroke-width="1.2"',
    "fine": 'stroke-width="1" stroke-opacity=".45"',
}
BLANK = "background:none;border:0;padding:0 1.2em 0 0;text-align:left;vertical-align:top"


class Line(NamedTuple):
    """A line of a drawing: places to the right and up (n,), and one of :data:`LOOKS`."""

    x: Array
    y: Array
    look: str


def sensor_card(sensor: Sensor) -> str:
    """A sensor: its cross-section with chief rays, and its numbers; why it has none, if it cannot be."""
    straight = sensor.aligned()
    try:
        drawing, seen = drawn(list(_section(straight)), f"Cross-section of {sensor.name}"), _seen(straight)
    except OmnimirrorError as e:
        drawing, seen = "", {"Cannot be used": str(e)}
    lens, imager, mount = sensor.lens, sensor.imager, sensor.mount
    distance = {} if lens.TELECENTRIC else {"Distance": f"{sensor.mirror_distance_mm:.4g} mm from lens to mirror"}
    parts = {
        "Mirror": f"{sensor.mirror.KIND}, rim radius {sensor.mirror.rim_radius_mm:.4g} mm{_second(sensor)}",
        "Lens": f"{lens.KIND}, {_focal(lens)}F/{lens.image_f_number():.3g} at the image",
        **distance,
        "Imager": f"{imager.width_px} × {imager.height_px} px of {imager.pitch_mm * 1e3:.4g} µm",
        "Camera looks": mount.camera_looks + (", the picture reversed" if mount.image_flipped else ""),
    }
    return card(sensor.name, "mirror sensor", drawing, {**seen, **parts, **_out_of_place(sensor)}, _made(sensor))


def model_card(camera: CameraModel) -> str:
    """A calibrated camera: rings of its field in its picture, and its numbers with their standard deviations."""
    width, height = camera.image_size
    symmetry = camera.symmetry
    field = {} if symmetry is None else {"Field": _angles(symmetry.omega_min, symmetry.omega_max)}
    sigmas = camera.uncertainty.sigmas if camera.uncertainty else {}
    shown = camera.parameters[:NUMBERS]
    numbers = {p.name: f"{p.value:.6g}{_sigma(sigmas.get(p.name))} {p.unit}" for p in shown}
    left = len(camera.parameters) - len(shown)
    more = {f"and {left} more": ""} if left else {}
    head = {
        "Optics": camera.optics,
        **field,
        "Picture": f"{width} × {height} px",
        "Camera looks": camera.mount.camera_looks,
    }
    drawing = drawn(list(_rings(camera)), f"Rings of the field every {RING_DEG:g} degrees in the picture")
    return card(camera.KIND, "calibrated camera", drawing, {**head, **numbers, **more}, _made(camera))


def card(title: str, kind: str, drawing: str, rows: Rows, note: str) -> str:
    """The HTML of a card: a drawing, and what is told beside it.

    >>> "<b" in card("mine", "camera", "", {"Field": "0 to 90°"}, "")
    True
    """
    cells = "".join(
        f'<tr style="background:none"><th scope="row" style="{BLANK};font-weight:400;opacity:.75">'
        f'{html_text(name)}</th><td style="{BLANK};max-width:32em">{html_text(value)}</td></tr>'
        for name, value in rows.items()
    )
    below = f'<div style="max-width:44em;opacity:.75">{html_text(note)}</div>' if note else ""
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:.6em 1.6em;align-items:center;font:13px/1.5 system-ui,sans-serif">'
        f'{drawing}<div><b style="font-size:15px">{html_text(title)}</b> '
        f'<span style="opacity:.75">{html_text(kind)}</span>'
        f'<table style="border-collapse:collapse;margin:.3em 0;font-size:13px">{cells}</table>{below}</div></div>'
    )


def drawn(lines: Sequence[Line], label: str) -> str:
    """An SVG of lines to one scale, in the colour of the text around it; without lines none."""
    if not lines:
        return ""
    x, y = (np.concatenate([line[axis] for line in lines]) for axis in (0, 1))
    low, size = (
        (np.nanmin(x), np.nanmax(y)),
        (max(np.ptp(x[np.isfinite(x)]), 1e-9), max(np.ptp(y[np.isfinite(y)]), 1e-9)),
    )
    scale = min(WIDE / size[0], TALL / size[1])
    width, height = (scale * s + 2 * MARGIN for s in size)
    paths = "".join(_path(line, low, scale) for line in lines)
    return (
        f'<svg role="img" aria-label="{html_text(label)}" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" fill="none" stroke="currentColor">{paths}</svg>'
    )


def _path(line: Line, low: tuple[float, float], scale: float) -> str:
    """One line, broken where it is not a number."""
    steps, is_down = [], False
    for u, v in zip(MARGIN + (line.x - low[0]) * scale, MARGIN + (low[1] - line.y) * scale, strict=True):
        is_there = bool(np.isfinite(u) and np.isfinite(v))
        if is_there:
            steps.append(f"{'L' if is_down else 'M'}{u:.1f} {v:.1f}")
        is_down = is_there
    return f'<path d="{"".join(steps)}" {LOOKS[line.look]}/>'


# -- drawings --------------------------------------------------------------------------------------------


def _section(sensor: Sensor) -> Iterator[Line]:
    """Mirrors, lens and chief rays in the meridian, up in the drawing where up is in the world."""
    is_level = abs(sensor.axis[2]) < np.sqrt(0.5)
    sign = 1.0 if is_level or sensor.axis[2] < 0 else -1.0

    def line(x: Array, z: Array, look: str) -> Line:
        return Line(sign * z, x, look) if is_level else Line(x, sign * z, look)

    meridian, second, rim = sensor.meridian, sensor.secondary, sensor.mirror.rim_radius_mm
    x = np.linspace(-rim, rim, NODES)
    yield line(x, sensor.mirror.sag(np.abs(x)), "strong")
    lens = -meridian.m if np.isfinite(meridian.m) else -TELECENTRIC_AT * rim
    if second is not None:
        wide = np.linspace(-second.mirror.rim_radius_mm, second.mirror.rim_radius_mm, NODES)
        yield line(wide, second.height(np.abs(wide)), "strong")
        lens = second.lens_height(meridian.m) if np.isfinite(meridian.m) else rim
    rays = meridian.trace(meridian.x_from_omega(np.linspace(meridian.omega_min, meridian.omega_max, RAYS)))
    first = rays.first.x
    end = first if sensor.lens.TELECENTRIC else np.zeros_like(first)
    half = float(end.max()) or 0.12 * rim
    yield line(np.array([-half, half]), np.full(2, lens), "plain")
    way = np.array([rays.x + OUTSIDE * rim * np.sin(rays.omega), rays.x, end])
    heights = np.array([rays.z - OUTSIDE * rim * np.cos(rays.omega), rays.z, np.full_like(end, lens)])
    if second is not None:
        way, heights = np.insert(way, 2, first, axis=0), np.insert(heights, 2, second.height(first), axis=0)
    for k in range(RAYS):
        for side in (-1, 1):
            yield line(side * way[:, k], heights[:, k], "fine")


def _rings(camera: CameraModel) -> Iterator[Line]:
    """The frame of the picture, and where it shows rings about the axis."""
    width, height = camera.image_size
    yield Line(np.array([0, width, width, 0, 0.0]) - 0.5, 0.5 - np.array([0, 0, height, height, 0.0]), "plain")
    turn = np.linspace(0, 2 * np.pi, NODES)
    right, down = camera.mount.rotation()[:, 0], camera.mount.rotation()[:, 1]
    end = 180.0 if camera.symmetry is None else float(np.degrees(camera.symmetry.omega_max))
    rings = [*np.arange(RING_DEG, end - 1e-9, RING_DEG), end]
    for omega in np.radians(rings):
        around = np.outer(np.cos(turn), right) + np.outer(np.sin(turn), down)
        pixels, valid = camera.project_directions(np.cos(omega) * camera.axis + np.sin(omega) * around)
        if valid.any():
            yield Line(
                np.where(valid, pixels[:, 0], np.nan),
                -np.where(valid, pixels[:, 1], np.nan),
                "fine" if omega < np.radians(end) else "strong",
            )


# -- words -----------------------------------------------------------------------------------------------


def _seen(sensor: Sensor) -> dict[str, str]:
    """What the sensor sees, and how finely."""
    meridian = sensor.meridian
    rays = meridian.trace(meridian.x_from_omega(np.linspace(meridian.omega_min, meridian.omega_max, NODES)))
    rate = np.abs(sensor.image_height_rate_px(rays)) * np.pi / 180
    rate = rate[np.isfinite(rate)]
    found = {
        "Field": _angles(meridian.omega_min, meridian.omega_max),
        "Image of the rim": f"{sensor.rim_radius_px:.4g} px in radius",
        "Resolution": f"{rate.min():.3g} to {rate.max():.3g} px/° along the image radius",
    }
    return {**found, "Hidden": f"{sensor.hidden_percent:.3g} % of the picture"} if sensor.obscured else found


def _angles(low: float, high: float) -> str:
    return f"{np.degrees(low):.4g} to {np.degrees(high):.4g}° from the axis"


def _second(sensor: Sensor) -> str:
    return f", seen in a second one ({sensor.secondary.mirror.KIND})" if sensor.secondary else ""


def _out_of_place(sensor: Sensor) -> dict[str, str]:
    """What of a sensor is not where it was meant; the drawing shows it in its place."""
    if sensor.is_axial:
        return {}
    pose = sensor.mirror_pose
    if pose.is_axial:
        return {"Out of place": "its cover, its imager or the form of its mirror"}
    shift, tilt = (pose.decentre_x_mm, pose.decentre_y_mm), (pose.tilt_x_deg, pose.tilt_y_deg)
    return {"Out of place": "mirror decentred by {:g} and {:g} mm, tilted by {:g} and {:g}°".format(*shift, *tilt)}


def _focal(lens: Lens) -> str:
    return f"{lens.focal_length_mm:.4g} mm, " if isinstance(lens, GaussianLens) else ""


def _sigma(value: float | None) -> str:
    return "" if value is None else f" ± {value:.2g}"


def _made(camera: Sensor | CameraModel) -> str:
    """How it came about: its notes, and whether a calibration told how well its numbers are known."""
    notes = getattr(camera, "notes", "")
    known = camera.uncertainty
    field = f", from 0 to {known.field_deg:.4g} deg" if known and known.field_deg else ""
    calibrated = f"Calibrated: {len(known.names)} numbers with their covariance{field}." if known else ""
    return " ".join(part for part in (notes, calibrated) if part)
