"""Modulation transfer function (MTF), tangential and sagittal.

The diffraction MTF is the autocorrelation of the aperture with its phase, the geometric MTF the
Fourier transform of the spot. Both can be multiplied by the MTF of the square pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import choice, finite, number, row
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...optics.sensor import Sensor, check_sensor
from ..evaluation import field_angles
from .bundles import Bundles, trace_bundles
from .point_spread import KINDS, Kind
from .pupil import gaussian
from .pupil_fit import FITTED
from .records import Recorded
from .wavefront import Wavefront, wavefronts

FINEST = 1e6  # cycles per pixel
CELLS = (512, 2048)  # minimum and maximum cells per side of the grid of a vignetted aperture
CELLS_PER_WAVE = 12  # per wavelength of the phase over the aperture
FREQUENCIES = 51  # default samples from 0 to 1 cycle per pixel


@dataclass(frozen=True)
class Mtf(Recorded):
    """Modulation transfer function at k field angles and f spatial frequencies.

    Tangential: for modulation along the radial direction in the image; sagittal: perpendicular to
    it.
    """

    omega_deg: Array
    """Field angles (k,)."""
    azimuth_deg: Array
    """Azimuths (k,)."""
    focus_mm: float
    cycles_per_px: Array
    """Spatial frequencies (f,)."""
    tangential: Array
    """Tangential MTF (k, f); 0 for fully blocked light."""
    sagittal: Array
    """Sagittal MTF (k, f)."""
    pixel_pitch_um: float
    px_per_deg_t: Array
    """Radial image size of one object degree (k,)."""
    px_per_deg_s: Array
    """Azimuthal image size of one object degree (k,)."""
    kind: Kind
    with_pixel: bool

    @property
    def line_pairs_per_mm(self) -> Array:
        """Return the frequencies (f,) on the imager."""
        return self.cycles_per_px / (self.pixel_pitch_um * 1e-3)

    @property
    def cycles_per_deg_t(self) -> Array:
        """Return the object frequencies (k, f) of tangential patterns."""
        return self.px_per_deg_t[:, None] * self.cycles_per_px

    @property
    def cycles_per_deg_s(self) -> Array:
        """Return the object frequencies (k, f) of sagittal patterns."""
        return self.px_per_deg_s[:, None] * self.cycles_per_px

    def first(self, count: int) -> Mtf:
        """Return the MTF at the first ``count`` frequencies."""
        return replace(
            self,
            cycles_per_px=self.cycles_per_px[:count],
            tangential=self.tangential[:, :count],
            sagittal=self.sagittal[:, :count],
        )

    def records(self) -> list[dict[str, float]]:
        """Return one record per field angle and frequency, in all three units of frequency."""
        columns = {
            "omega_deg": self.omega_deg[:, None], "azimuth_deg": self.azimuth_deg[:, None],
            "cycles_per_px": self.cycles_per_px, "lp_per_mm": self.line_pairs_per_mm,
            "cycles_per_deg_t": self.cycles_per_deg_t, "mtf_t": self.tangential,
            "cycles_per_deg_s": self.cycles_per_deg_s, "mtf_s": self.sagittal,
        }  # fmt: skip
        rows = zip(*(np.broadcast_to(c, self.tangential.shape).ravel().tolist() for c in columns.values()), strict=True)
        return [dict(zip(columns, row, strict=True)) for row in rows]


def mtf(
    sensor: Sensor,
    omega_deg: ArrayLike | None = None,
    *,
    cycles_per_px: ArrayLike | None = None,
    focus_mm: float | None = None,
    azimuth_deg: ArrayLike = 0.0,
    object_distance_mm: ArrayLike = np.inf,
    kind: Kind = "diffraction",
    wavelength_nm: ArrayLike = 550.0,
    weights: ArrayLike | None = None,
    pixel: bool = True,
) -> Mtf:
    """Compute tangential and sagittal MTF over the field.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    omega_deg : (n,), optional
        Field angles, deg; by default every 15 deg of the field.
    cycles_per_px : (k,), optional
        Spatial frequencies; by default 0 to 1.
    focus_mm
        Object distance L0 in focus; by default that of the sensor.
    azimuth_deg, object_distance_mm : scalar or (k,)
        Azimuths and distances of the objects.
    kind
        ``"diffraction"``, including defocus and aberrations, or ``"geometric"``.
    wavelength_nm, weights : scalar or (w,)
        Wavelengths and their relative weights, equal by default.
    pixel
        Multiply by the MTF of the square pixel.

    Returns
    -------
    Mtf
        Tangential and sagittal MTF, (n, k), with their scales.

    Raises
    ------
    OutsideField, InvalidParameter
        Field angle outside the field of view; invalid numbers.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.mtf(om.load_sensor("paper-spherical"), [60.0, 120.0], cycles_per_px=[0.0, 0.25, 0.5])
    >>> found.tangential.round(2)
    array([[1.  , 0.73, 0.39],
           [1.  , 0.76, 0.45]])
    """
    check_sensor(sensor)
    choice("kind", kind, KINDS)
    asked = np.linspace(0, 1, FREQUENCIES) if cycles_per_px is None else row("cycles_per_px", cycles_per_px)
    nu = finite("cycles_per_px", asked, 0.0, FINEST)
    waves, shares = _spectrum(wavelength_nm, weights)
    angles = field_angles(sensor, 15.0) if omega_deg is None else omega_deg
    bundles = trace_bundles(sensor, angles, FITTED, azimuth_deg, object_distance_mm)
    focus = sensor.lens.focus_distance_mm if focus_mm is None else number("focus_mm", focus_mm)
    per_mm = nu / sensor.imager.pitch_mm
    found = np.zeros((2, len(bundles.omega_deg), len(nu)))
    for i, wave in enumerate(wavefronts(bundles, focus)):
        if not bundles.passes[i].any():
            continue
        for axis in (0, 1):
            if kind == "geometric":
                found[axis, i] = np.abs(geometric_otf(wave, per_mm, axis))
            else:
                found[axis, i] = np.abs(shares @ [diffraction_otf(wave, per_mm, axis, nm * 1e-6) for nm in waves])
    if pixel:
        found *= _pixel_mtf(bundles, nu)
    px_t, px_s = bundles.px_per_deg()
    return Mtf(
        bundles.omega_deg, bundles.azimuth_deg, focus, nu, found[0], found[1], sensor.imager.pixel_pitch_um,
        px_t, px_s, kind, pixel,
    )  # fmt: skip


def diffraction_otf(wave: Wavefront, per_mm: Array, axis: int, wavelength_mm: float) -> NDArray[np.complex128]:
    """Return the optical transfer function (f,) at frequencies (f,), cycles per mm: the
    autocorrelation of the aperture.

    ``axis`` 0 is tangential, 1 sagittal. The overlap of the full aperture and its shifted copy is
    lens-shaped and integrated by rows with Gauss-Legendre quadrature; a vignetted aperture is
    summed on a grid.
    """
    shift = 2 * wavelength_mm * wave.f_numbers[axis] * per_mm  # in aperture radii
    if wave.is_cut:
        return _grid_otf(wave, shift, axis, wavelength_mm)
    nodes = wave.nodes(wavelength_mm)
    x, weight = np.polynomial.legendre.leggauss(nodes)
    otf = np.zeros(len(per_mm), dtype=complex)
    for i in np.flatnonzero(shift < 2):
        psi = x * np.arccos(shift[i] / 2)
        half = np.cos(psi) - shift[i] / 2
        along = half[:, None] * x
        across = np.broadcast_to(np.sin(psi)[:, None], along.shape)
        area = (np.arccos(shift[i] / 2) * weight * np.cos(psi) * half)[:, None] * weight
        ends = []
        for side in (0.5, -0.5):
            place = (along + side * shift[i], across)
            ends.append(wave.phase_and_amplitude(_points(place, axis)))
        (W1, A1), (W2, A2) = ends
        otf[i] = (area.ravel() * A1 * A2) @ np.exp(2j * np.pi / wavelength_mm * (W1 - W2))
    otf /= _all_light(wave, nodes)
    return otf


def _grid_otf(wave: Wavefront, shift: Array, axis: int, wavelength_mm: float) -> NDArray[np.complex128]:
    """Return the optical transfer function (f,) at shifts (f,), in radii, of a vignetted aperture.

    The autocorrelation of a grid is computed by FFT, with spline interpolation between integer
    shifts. Edges are softened over one cell, which preserves the sum of the amplitudes; the sum of
    the light, their square, is computed separately. The mean slope of the phase is removed first;
    it is a phase factor of the autocorrelation.
    """
    from scipy.interpolate import CubicSpline

    cells = int(np.clip(CELLS_PER_WAVE * wave.waves(wavelength_mm), *CELLS))
    centres = (np.arange(cells) + 0.5) * 2 / cells - 1
    phase, density, share = wave.on_grid(centres)
    field = np.sqrt(density) * share * np.exp(2j * np.pi / wavelength_mm * phase)
    if axis == 1:
        field = field.T
    tilt = float(np.angle((field[1:] * field[:-1].conj()).sum())) * cells / 2  # rad per radius
    field = field * np.exp(-1j * tilt * centres)[:, None]
    power = (np.abs(np.fft.fft(field, 2 * cells, axis=0)) ** 2).sum(axis=1)
    autocorrelation = np.fft.ifft(power)[: cells + 1]
    autocorrelation[0] = (density * share).sum()
    spline = CubicSpline(np.arange(cells + 1) * 2 / cells, autocorrelation / autocorrelation[0])
    inside_both = np.minimum(shift, 2.0)
    otf: NDArray[np.complex128] = np.where(shift < 2, spline(inside_both) * np.exp(1j * tilt * inside_both), 0.0)
    return otf


def geometric_otf(wave: Wavefront, per_mm: Array, axis: int) -> NDArray[np.complex128]:
    """Return the geometric optical transfer function (f,) at frequencies (f,), cycles per mm."""
    _, landing, _ = wave.at(FITTED.points)
    cycles = float(np.ptp(landing[:, axis])) * float(per_mm.max(initial=0.0))
    pupil = gaussian(int(np.clip(12 + 2 * cycles, 16, 200)))
    _, landing, light = wave.at(pupil.points)
    weights = light * pupil.weights
    otf: NDArray[np.complex128] = np.exp(-2j * np.pi * np.outer(per_mm, landing[:, axis])) @ weights / weights.sum()
    return otf


def _all_light(wave: Wavefront, nodes: int) -> float:
    """Return the integral of the light over the whole disk."""
    x, weight = np.polynomial.legendre.leggauss(nodes)
    psi = x * np.pi / 2
    along = np.cos(psi)[:, None] * x
    place = (along, np.broadcast_to(np.sin(psi)[:, None], along.shape))
    area = (np.pi / 2 * weight * np.cos(psi) ** 2)[:, None] * weight
    return float(area.ravel() @ wave.light(_points(place, 0)))


def _points(place: tuple[Array, Array], axis: int) -> Array:
    """Return points (n, 2) of the aperture from coordinates along and perpendicular to an axis."""
    return np.stack(place if axis == 0 else place[::-1], axis=-1).reshape(-1, 2)


def _pixel_mtf(bundles: Bundles, nu: Array) -> Array:
    """Return the pixel MTF (2, k, f) in the tangential and sagittal directions."""
    along = bundles.axes().transpose(1, 0, 2)[:, :, None, :] * nu[:, None]
    transfer: Array = np.abs(np.sinc(along)).prod(axis=-1)
    return transfer


def _spectrum(wavelength_nm: ArrayLike, weights: ArrayLike | None) -> tuple[Array, Array]:
    """Return wavelengths and their weights, with sum 1."""
    waves = row("wavelength_nm", wavelength_nm)
    shares = np.ones(len(waves)) if weights is None else row("weights", weights)
    if len(shares) != len(waves):
        raise InvalidParameter(f"there are {len(shares)} weights for {len(waves)} wavelengths; give as many")
    seen = (waves >= 100) & (waves <= 20000)
    if not seen.all():
        raise InvalidParameter(f"wavelength_nm = {waves[~seen][0]:g} is outside 100 to 20000 nm")
    if not ((shares >= 0).all() and shares.sum() > 0):
        raise InvalidParameter("the weights of wavelengths must not be below 0, nor all 0")
    return waves, shares / shares.sum()
