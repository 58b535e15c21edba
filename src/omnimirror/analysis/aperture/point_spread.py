"""Point-spread functions: geometric, or with diffraction and aberrations of the wavefront."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import choice, distances, number, shown
from ...base.errors import InvalidParameter, OutsideField
from ...base.typing import Array
from ...optics.sensor import Sensor, check_sensor
from .bundles import trace_bundles
from .pupil import fibonacci
from .pupil_fit import FITTED
from .wavefront import SOFT, Wavefront, wavefronts

Kind = Literal["diffraction", "geometric"]
KINDS = ("diffraction", "geometric")

RAYS = 200_000  # of a geometric PSF
STEPS_PER_AIRY = 6.0  # default samples per Airy diameter
MOST_SAMPLES = 2001
FINE_SAMPLES = 2400  # maximum samples per side of the radial integration


@dataclass(frozen=True)
class Psf:
    """Point-spread function, sampled on a square about the chief ray.

    Columns are tangential (radially outwards), rows sagittal; at azimuth 0 these are the columns
    and rows of the image.
    """

    density: Array
    """Light per square pixel (n, n), with unit integral over the plane."""
    offset_px: Array
    """Tangential offsets of the columns and sagittal offsets of the rows (n,)."""
    omega_deg: float
    azimuth_deg: float
    focus_mm: float
    kind: Kind
    ideal_peak: float
    """Peak density of an aberration-free wavefront through the same aperture."""

    @property
    def strehl(self) -> float:
        """Return the Strehl ratio, up to 1; NaN for a geometric PSF, which excludes diffraction."""
        if self.kind == "geometric":
            return float("nan")
        return min(float(self.density.max()) / self.ideal_peak, 1.0)  # exceeds 1 by rounding only

    @property
    def light_within(self) -> float:
        """Return the share of the light on the square."""
        return float(self.density.sum()) * self._step**2

    def encircled_energy(self, radius_px: ArrayLike) -> Array:
        """Return the encircled energy (r,) within radii (r,) of the centroid."""
        from scipy.interpolate import RectBivariateSpline

        at = self.offset_px
        step = self._step / int(np.clip(FINE_SAMPLES // len(at), 1, 12))
        fine = np.arange(at[0] - self._step / 2 + step / 2, at[-1] + self._step / 2, step)
        light = np.maximum(RectBivariateSpline(at, at, self.density)(fine, fine), 0.0)
        light *= self.light_within / light.sum()
        t0, s0 = (float(light.sum(axis=axis) @ fine) / self.light_within for axis in (0, 1))
        rings = (np.hypot(fine - t0, (fine - s0)[:, None]) / step).astype(int)
        energy = np.concatenate([[0.0], np.cumsum(np.bincount(rings.ravel(), light.ravel()))])
        shares: Array = np.interp(np.asarray(radius_px, dtype=float), step * np.arange(len(energy)), energy)
        return shares

    def on_pixels(self) -> Array:
        """Return the density (n, n) averaged over a pixel at each position."""
        nu = np.fft.fftfreq(len(self.offset_px), self._step)
        azimuth = np.radians(self.azimuth_deg)
        u = nu * np.cos(azimuth) - nu[:, None] * np.sin(azimuth)
        v = nu * np.sin(azimuth) + nu[:, None] * np.cos(azimuth)
        averaged: Array = np.fft.ifft2(np.fft.fft2(self.density) * np.sinc(u) * np.sinc(v)).real
        return averaged

    @property
    def _step(self) -> float:
        return float(self.offset_px[1] - self.offset_px[0])


def psf(
    sensor: Sensor,
    omega_deg: float,
    *,
    focus_mm: float | None = None,
    azimuth_deg: float = 0.0,
    object_distance_mm: float = np.inf,
    kind: Kind = "diffraction",
    wavelength_nm: float = 550.0,
    width_px: float | None = None,
    step_px: float | None = None,
) -> Psf:
    """Compute the point-spread function of one object.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    omega_deg, azimuth_deg, object_distance_mm
        Field angle, azimuth and distance of the object.
    focus_mm
        Object distance L0 in focus; by default that of the sensor.
    kind
        ``"diffraction"``: wave optics with the phase of defocus and aberrations; ``"geometric"``:
        rays only.
    wavelength_nm
        Wavelength of the light.
    width_px, step_px
        Side of the square and sample distance; by default according to the spot size, and 1/6 of
        the Airy diameter.

    Returns
    -------
    Psf
        Intensity on a grid (k, k) around the chief ray, and derived quantities.

    Raises
    ------
    OutsideField, InvalidParameter
        Object outside the field of view; invalid numbers.

    Examples
    --------
    A small aperture in focus produces an Airy disk, with 84 % of the light within the first dark
    ring:

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-hyperboloidal")
    >>> spot = om.psf(sensor, 60.0, focus_mm=om.evaluate(sensor, [60.0]).distance_t_mm[0])
    >>> round(spot.strehl, 2), spot.encircled_energy([sensor.lens.airy_diameter() / 2 / 0.0052]).round(2)
    (1.0, array([0.84]))
    """
    check_sensor(sensor)
    choice("kind", kind, KINDS)
    number("wavelength_nm", wavelength_nm, above=0.0, unit="nm")
    omega_deg, azimuth_deg = number("omega_deg", omega_deg), number("azimuth_deg", azimuth_deg)
    if distances("object_distance_mm", object_distance_mm).ndim:
        raise InvalidParameter(f"object_distance_mm = {shown(object_distance_mm)} is not valid; it is one number")
    bundles = trace_bundles(sensor, [omega_deg], FITTED, azimuth_deg, object_distance_mm)
    if not bundles.passes.any():
        raise OutsideField(f"omega = {omega_deg:.10g} deg must not be hidden; {sensor.name!r} blocks all of its light")
    focus = sensor.lens.focus_distance_mm if focus_mm is None else number("focus_mm", focus_mm)
    (wave,) = wavefronts(bundles, focus)
    pitch, wavelength_mm = sensor.imager.pitch_mm, wavelength_nm * 1e-6
    airy = bundles.focused_at(focus).lens.airy_diameter(wavelength_nm) / pitch
    offset = _offsets(wave, pitch, airy, width_px, step_px)
    if kind == "geometric":
        density = _by_rays(wave, offset, pitch)
    else:
        density = _by_waves(wave, offset * pitch, wavelength_mm) * pitch**2
    F_t, F_s = wave.f_numbers
    # Peak of the Airy pattern per area: aperture area / (lambda b)^2 = pi / (4 lambda^2 F_t F_s).
    ideal = np.pi / (4 * wavelength_mm**2 * F_t * F_s) * pitch**2
    return Psf(density, offset, float(omega_deg), float(azimuth_deg), focus, kind, ideal)


def _offsets(wave: Wavefront, pitch: float, airy: float, width_px: float | None, step_px: float | None) -> Array:
    """Return sample positions (n,) px along each side, symmetric about 0."""
    _, landing, _ = wave.at(FITTED.points)
    width = 2.6 * float(np.abs(landing).max()) / pitch + 6 * airy
    if width_px is not None:
        width = number("width_px", width_px, above=0.0, unit="px")
    step = airy / STEPS_PER_AIRY if step_px is None else number("step_px", step_px, above=0.0, unit="px")
    steps = width / step if width < MOST_SAMPLES * step else np.inf
    half = int(np.ceil(min(steps, MOST_SAMPLES) / 2))
    if 2 * half + 1 > MOST_SAMPLES:
        raise InvalidParameter(
            f"a PSF {width:g} px wide in steps of {step:g} px has more than {MOST_SAMPLES} samples a side; "
            f"up to {MOST_SAMPLES} are valid, so step_px from {width / (MOST_SAMPLES - 1):.2g}"
        )
    return step * np.arange(-half, half + 1, dtype=np.float64)


def _by_rays(wave: Wavefront, offset: Array, pitch: float) -> Array:
    """Return the density (n, n) per square pixel from rays."""
    _, landing, light = wave.at(fibonacci(RAYS).points)
    step = offset[1] - offset[0]
    edges = np.concatenate([offset - step / 2, offset[-1:] + step / 2])
    counts, _, _ = np.histogram2d(landing[:, 1] / pitch, landing[:, 0] / pitch, (edges, edges), weights=light)
    density: Array = counts / light.sum() / step**2
    return density


def _by_waves(wave: Wavefront, offset_mm: Array, wavelength_mm: float) -> Array:
    """Return the density (n, n) per mm^2 of the diffracted wave, a Fourier integral by rows."""
    k = 2 * np.pi / wavelength_mm
    F_t, F_s = wave.f_numbers
    reach = offset_mm[-1] * (1 / F_t + 1 / F_s) / wavelength_mm / 2  # fringes across the aperture at the corner
    nodes = int(min(wave.nodes(wavelength_mm) + 2 * reach, 1200))
    psi = np.pi * np.arange(1, nodes + 1) / (nodes + 1)  # Gauss-Chebyshev of the second kind: rows of the disk
    x, weight = np.polynomial.legendre.leggauss(nodes)
    y = np.cos(psi)
    t, s = np.sin(psi)[:, None] * x, np.broadcast_to(y[:, None], (nodes, nodes))
    area = np.pi / (nodes + 1) * np.sin(psi)[:, None] ** 2 * weight
    points = np.stack([t, s], axis=-1).reshape(-1, 2)
    phase, amplitude = wave.phase_and_amplitude(points, SOFT / nodes)
    field = (area.ravel() * amplitude * np.exp(1j * k * phase)).reshape(nodes, nodes)
    power = float(area.ravel() @ wave.light(points, SOFT / nodes))
    rows = np.empty((nodes, len(offset_mm)), dtype=complex)
    for i in range(nodes):  # along t, with nodes that differ between rows
        rows[i] = np.einsum("j,jn->n", field[i], _powers(k * t[i] / (2 * F_t), offset_mm))
    wave_there = np.exp(1j * k * np.outer(offset_mm, y) / (2 * F_s)) @ rows
    density: Array = np.abs(wave_there) ** 2 / (power * (2 * wavelength_mm) ** 2 * F_t * F_s)
    return density


def _powers(rate: Array, offset: Array) -> NDArray[np.complex128]:
    """Return ``exp(i rate offset)`` (nodes, n) for evenly spaced offsets, by multiplication."""
    powers = np.empty((len(rate), len(offset)), dtype=complex)
    powers[:, 0] = np.exp(1j * rate * offset[0])
    powers[:, 1:] = np.exp(1j * rate * (offset[1] - offset[0]))[:, None]
    return np.multiply.accumulate(powers, axis=1)
