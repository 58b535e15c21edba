"""Point-spread functions: by rays alone, or by the wave that leaves the aperture (diffraction and aberrations)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import choice, distances, number, shown
from ...base.errors import InvalidParameter, OutsideField
from ...optics.sensor import Sensor, check_sensor
from .bundles import trace_bundles
from .pupil import fibonacci
from .pupil_fit import FITTED
from .wavefront import SOFT, Wavefront, wavefronts

Array = NDArray[np.float64]
Kind = Literal["diffraction", "geometric"]
KINDS = ("diffraction", "geometric")

RAYS = 200_000  # of a geometric PSF
STEPS_PER_AIRY = 6.0  # samples per Airy diameter, unless asked for otherwise
MOST_SAMPLES = 2001
FINE_SAMPLES = 2400  # on each side, at most, when light is counted in rings


@dataclass(frozen=True)
class Psf:
    """The image of a point object, sampled on a square about where the chief ray lands.

    Columns run tangentially (away from the optical axis), rows sagittally; at azimuth 0 these are the
    picture's columns and rows.
    """

    density: Array
    """(n, n) share of the light per square pixel; over the whole plane it adds up to 1."""
    offset_px: Array
    """(n,) tangential offsets of the columns, and sagittal ones of the rows."""
    omega_deg: float
    azimuth_deg: float
    focus_mm: float
    kind: Kind
    ideal_peak: float
    """Largest density of a perfect wave through the same aperture."""

    @property
    def strehl(self) -> float:
        """Largest density over that of a perfect wave, up to 1; NaN of rays alone, which know no diffraction."""
        if self.kind == "geometric":
            return float("nan")
        return min(float(self.density.max()) / self.ideal_peak, 1.0)  # above it by rounding alone

    @property
    def light_within(self) -> float:
        """Share of the light that lands on the square."""
        return float(self.density.sum()) * self._step**2

    def encircled_energy(self, radius_px: ArrayLike) -> Array:
        """Share (r,) of all the light within radii (r,) of the centroid."""
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
        """The density (n, n) averaged over a pixel about each place, as the imager samples it."""
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
    """The point-spread function of one object.

    Parameters
    ----------
    sensor
        Such as :func:`omnimirror.load_sensor` gives.
    omega_deg, azimuth_deg, object_distance_mm
        The object.
    focus_mm
        Object distance L0 in focus, the sensor's own by default.
    kind
        ``"diffraction"``: the wave of the aperture with its true phase, defocus and aberrations included;
        ``"geometric"``: rays alone.
    wavelength_nm
        Of the wave.
    width_px, step_px
        Side of the square and distance of the samples; by default as large as the spot needs, and a
        sixth of the Airy disk.

    Returns
    -------
    Psf
        The intensity on a grid (k, k) around the chief ray, and what follows from it.

    Raises
    ------
    OutsideField, InvalidParameter
        An object that is not seen; numbers that are not valid.

    Examples
    --------
    In the middle of its focus a small aperture makes an Airy disk, 84 % of whose light is within its ring:

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
    ideal = np.pi / (4 * wavelength_mm**2 * F_t * F_s) * pitch**2
    return Psf(density, offset, float(omega_deg), float(azimuth_deg), focus, kind, ideal)


def _offsets(wave: Wavefront, pitch: float, airy: float, width_px: float | None, step_px: float | None) -> Array:
    """Places (n,) px of the samples along each side, symmetric about 0."""
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
    """Density (n, n) per square pixel of many rays."""
    _, landing, light = wave.at(fibonacci(RAYS).points)
    step = offset[1] - offset[0]
    edges = np.concatenate([offset - step / 2, offset[-1:] + step / 2])
    counts, _, _ = np.histogram2d(landing[:, 1] / pitch, landing[:, 0] / pitch, (edges, edges), weights=light)
    density: Array = counts / light.sum() / step**2
    return density


def _by_waves(wave: Wavefront, offset_mm: Array, wavelength_mm: float) -> Array:
    """Density (n, n) per mm^2 of the diffracted wave: its Fourier integral over the disk, row by row."""
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
    for i in range(nodes):  # along t, whose nodes differ from row to row
        rows[i] = np.einsum("j,jn->n", field[i], _powers(k * t[i] / (2 * F_t), offset_mm))
    wave_there = np.exp(1j * k * np.outer(offset_mm, y) / (2 * F_s)) @ rows
    density: Array = np.abs(wave_there) ** 2 / (power * (2 * wavelength_mm) ** 2 * F_t * F_s)
    return density


def _powers(rate: Array, offset: Array) -> NDArray[np.complex128]:
    """``exp(i rate offset)`` (nodes, n) for evenly spaced offsets, by multiplication."""
    powers = np.empty((len(rate), len(offset)), dtype=complex)
    powers[:, 0] = np.exp(1j * rate * offset[0])
    powers[:, 1:] = np.exp(1j * rate * (offset[1] - offset[0]))[:, None]
    return np.multiply.accumulate(powers, axis=1)
