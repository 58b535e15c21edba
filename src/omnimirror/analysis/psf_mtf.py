"""Point-spread function (PSF) and modulation transfer function (MTF)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import choice, distances, finite, format_value, number, row
from ..base.errors import InvalidParameter, OutsideField
from ..base.results import Columns, FieldResult, Fields, TabularResult
from ..base.typing import Array
from ..optics.sensor import Sensor, check_sensor
from ._wavefront import EDGE_SOFTNESS, FITTED, Wavefront, wavefronts
from .evaluation import field_angles
from .ray_bundles import Bundles, fibonacci, gaussian, trace_bundles

# -- Point-spread function -------------------------------------------------------------------------

Kind = Literal["diffraction", "geometric"]
KINDS = ("diffraction", "geometric")

GEOMETRIC_RAYS = 200_000  # rays of a geometric PSF
STEPS_PER_AIRY = 6.0  # default samples per Airy diameter
MAX_SAMPLES = 2001
MAX_INTEGRATION_SAMPLES = 2400  # maximum samples per side of the radial integration


@dataclass(frozen=True)
class Psf(FieldResult):
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

    def _table(self) -> Columns:
        t, s = np.meshgrid(self.offset_px, self.offset_px)
        return {"t_px": t.ravel(), "s_px": s.ravel(), "density": self.density.ravel()}

    def _fields(self) -> Fields:
        names = ("omega_deg", "azimuth_deg", "focus_mm")
        coordinates = {name: ((), getattr(self, name)) for name in names}
        offsets = {name: ((name,), self.offset_px) for name in ("s_px", "t_px")}
        return Fields(
            {"density": (("s_px", "t_px"), self.density)},
            {**offsets, **coordinates},
            {"kind": self.kind, "strehl": self.strehl},
        )

    @property
    def strehl(self) -> float:
        """Strehl ratio, up to 1; NaN for a geometric PSF, which excludes diffraction."""
        if self.kind == "geometric":
            return float("nan")
        return min(float(self.density.max()) / self.ideal_peak, 1.0)  # exceeds 1 by rounding only

    @property
    def light_within(self) -> float:
        """Fraction of the light on the square."""
        return float(self.density.sum()) * self._step**2

    def encircled_energy(self, radius_px: ArrayLike) -> Array:
        """Return the encircled energy (r,) within radii (r,) of the centroid."""
        from scipy.interpolate import RectBivariateSpline

        radii = self.offset_px
        step = self._step / int(np.clip(MAX_INTEGRATION_SAMPLES // len(radii), 1, 12))
        fine = np.arange(radii[0] - self._step / 2 + step / 2, radii[-1] + self._step / 2, step)
        light = np.maximum(RectBivariateSpline(radii, radii, self.density)(fine, fine), 0.0)
        light *= self.light_within / light.sum()
        t0, s0 = (float(light.sum(axis=axis) @ fine) / self.light_within for axis in (0, 1))
        rings = (np.hypot(fine - t0, (fine - s0)[:, None]) / step).astype(int)
        energy = np.concatenate([[0.0], np.cumsum(np.bincount(rings.ravel(), light.ravel()))])
        fractions: Array = np.interp(
            np.asarray(radius_px, dtype=float), step * np.arange(len(energy)), energy
        )
        return fractions

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
        If an object is outside the field of view, or a number is invalid.

    Examples
    --------
    A small aperture in focus produces an Airy disc, with 84 % of the light within the first dark
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
        raise InvalidParameter(
            f"object_distance_mm must be one number; got {format_value(object_distance_mm)}"
        )
    bundles = trace_bundles(sensor, [omega_deg], FITTED, azimuth_deg, object_distance_mm)
    if not bundles.passes.any():
        raise OutsideField(
            f"omega = {omega_deg:.10g} deg must not be obscured; {sensor.name!r} blocks all of its light"
        )
    focus = sensor.lens.focus_distance_mm if focus_mm is None else number("focus_mm", focus_mm)
    (wave,) = wavefronts(bundles, focus)
    pitch, wavelength_mm = sensor.imager.pitch_mm, wavelength_nm * 1e-6
    airy = bundles.focused_at(focus).lens.airy_diameter(wavelength_nm) / pitch
    offset = _offsets(wave, pitch, airy, width_px, step_px)
    if kind == "geometric":
        density = _geometric_density(wave, offset, pitch)
    else:
        density = _diffraction_density(wave, offset * pitch, wavelength_mm) * pitch**2
    F_t, F_s = wave.f_numbers
    # Peak of the Airy pattern per area: aperture area / (lambda b)^2 = pi / (4 lambda^2 F_t F_s).
    ideal = np.pi / (4 * wavelength_mm**2 * F_t * F_s) * pitch**2
    return Psf(density, offset, float(omega_deg), float(azimuth_deg), focus, kind, ideal)


def _offsets(
    wave: Wavefront, pitch: float, airy: float, width_px: float | None, step_px: float | None
) -> Array:
    """Return sample positions (n,) px along each side, symmetric about 0."""
    _, landing, _ = wave.at(FITTED.points)
    width = 2.6 * float(np.abs(landing).max()) / pitch + 6 * airy
    if width_px is not None:
        width = number("width_px", width_px, above=0.0, unit="px")
    step = (
        airy / STEPS_PER_AIRY
        if step_px is None
        else number("step_px", step_px, above=0.0, unit="px")
    )
    steps = width / step if width < MAX_SAMPLES * step else np.inf
    half = int(np.ceil(min(steps, MAX_SAMPLES) / 2))
    if 2 * half + 1 > MAX_SAMPLES:
        raise InvalidParameter(
            f"step_px must be at least {width / (MAX_SAMPLES - 1):.2g}: a PSF has at most "
            f"{MAX_SAMPLES} samples per side; got {step:g} px for a width of {width:g} px"
        )
    return step * np.arange(-half, half + 1, dtype=np.float64)


def _geometric_density(wave: Wavefront, offset: Array, pitch: float) -> Array:
    """Return the density (n, n) per square pixel from rays."""
    _, landing, light = wave.at(fibonacci(GEOMETRIC_RAYS).points)
    step = offset[1] - offset[0]
    edges = np.concatenate([offset - step / 2, offset[-1:] + step / 2])
    counts, _, _ = np.histogram2d(
        landing[:, 1] / pitch, landing[:, 0] / pitch, (edges, edges), weights=light
    )
    density: Array = counts / light.sum() / step**2
    return density


def _diffraction_density(wave: Wavefront, offset_mm: Array, wavelength_mm: float) -> Array:
    """Return the density (n, n) per mm^2 of the diffracted wave, a Fourier integral by rows."""
    k = 2 * np.pi / wavelength_mm
    F_t, F_s = wave.f_numbers
    fringes = (
        offset_mm[-1] * (1 / F_t + 1 / F_s) / wavelength_mm / 2
    )  # fringes across the aperture at the corner
    nodes = int(min(wave.nodes(wavelength_mm) + 2 * fringes, 1200))
    psi = (
        np.pi * np.arange(1, nodes + 1) / (nodes + 1)
    )  # Gauss-Chebyshev of the second kind: rows of the disc
    x, weight = np.polynomial.legendre.leggauss(nodes)
    y = np.cos(psi)
    t, s = np.sin(psi)[:, None] * x, np.broadcast_to(y[:, None], (nodes, nodes))
    area = np.pi / (nodes + 1) * np.sin(psi)[:, None] ** 2 * weight
    points = np.stack([t, s], axis=-1).reshape(-1, 2)
    phase, amplitude = wave.phase_and_amplitude(points, EDGE_SOFTNESS / nodes)
    field = (area.ravel() * amplitude * np.exp(1j * k * phase)).reshape(nodes, nodes)
    power = float(area.ravel() @ wave.light(points, EDGE_SOFTNESS / nodes))
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


# -- Modulation transfer function ------------------------------------------------------------------
#
# The diffraction MTF is the autocorrelation of the aperture with its phase, the geometric MTF the
# Fourier transform of the spot. Both can be multiplied by the MTF of the square pixel.

MAX_FREQUENCY = 1e6  # cycles per pixel
GRID_CELLS = (512, 2048)  # minimum and maximum cells per side of the grid of a vignetted aperture
CELLS_PER_WAVE = 12  # per wavelength of the phase over the aperture
FREQUENCIES = 51  # default samples from 0 to 1 cycle per pixel


@dataclass(frozen=True)
class Mtf(TabularResult, FieldResult):
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
        """Frequencies (f,) on the imager."""
        return self.cycles_per_px / (self.pixel_pitch_um * 1e-3)

    @property
    def cycles_per_deg_t(self) -> Array:
        """Object frequencies (k, f) of tangential patterns."""
        return self.px_per_deg_t[:, None] * self.cycles_per_px

    @property
    def cycles_per_deg_s(self) -> Array:
        """Object frequencies (k, f) of sagittal patterns."""
        return self.px_per_deg_s[:, None] * self.cycles_per_px

    def _fields(self) -> Fields:
        angle, frequency = ("omega_deg",), ("cycles_per_px",)
        return Fields(
            {
                "mtf_t": (angle + frequency, self.tangential),
                "mtf_s": (angle + frequency, self.sagittal),
            },
            {
                "omega_deg": (angle, self.omega_deg),
                "azimuth_deg": (angle, self.azimuth_deg),
                "cycles_per_px": (frequency, self.cycles_per_px),
                "lp_per_mm": (frequency, self.line_pairs_per_mm),
                "cycles_per_deg_t": (angle + frequency, self.cycles_per_deg_t),
                "cycles_per_deg_s": (angle + frequency, self.cycles_per_deg_s),
                "focus_mm": ((), self.focus_mm),
            },
            {"kind": self.kind, "with_pixel": int(self.with_pixel)},
        )

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
            "omega_deg": self.omega_deg[:, None],
            "azimuth_deg": self.azimuth_deg[:, None],
            "cycles_per_px": self.cycles_per_px,
            "lp_per_mm": self.line_pairs_per_mm,
            "cycles_per_deg_t": self.cycles_per_deg_t,
            "mtf_t": self.tangential,
            "cycles_per_deg_s": self.cycles_per_deg_s,
            "mtf_s": self.sagittal,
        }
        rows = zip(
            *(np.broadcast_to(c, self.tangential.shape).ravel().tolist() for c in columns.values()),
            strict=True,
        )
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
        If a field angle is outside the field of view, or a number is invalid.

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
    frequencies = (
        np.linspace(0, 1, FREQUENCIES)
        if cycles_per_px is None
        else row("cycles_per_px", cycles_per_px)
    )
    nu = finite("cycles_per_px", frequencies, 0.0, MAX_FREQUENCY)
    waves, wave_weights = _spectrum(wavelength_nm, weights)
    angles = field_angles(sensor, 15.0) if omega_deg is None else omega_deg
    bundles = trace_bundles(sensor, angles, FITTED, azimuth_deg, object_distance_mm)
    focus = sensor.lens.focus_distance_mm if focus_mm is None else number("focus_mm", focus_mm)
    per_mm = nu / sensor.imager.pitch_mm
    curves = np.zeros((2, len(bundles.omega_deg), len(nu)))
    for i, wave in enumerate(wavefronts(bundles, focus)):
        if not bundles.passes[i].any():
            continue
        for axis in (0, 1):
            if kind == "geometric":
                curves[axis, i] = np.abs(geometric_otf(wave, per_mm, axis))
            else:
                curves[axis, i] = np.abs(
                    wave_weights @ [diffraction_otf(wave, per_mm, axis, nm * 1e-6) for nm in waves]
                )
    if pixel:
        curves *= _pixel_mtf(bundles, nu)
    px_t, px_s = bundles.px_per_deg()
    return Mtf(
        bundles.omega_deg,
        bundles.azimuth_deg,
        focus,
        nu,
        curves[0],
        curves[1],
        sensor.imager.pixel_pitch_um,
        px_t,
        px_s,
        kind,
        pixel,
    )


def diffraction_otf(
    wave: Wavefront, per_mm: Array, axis: int, wavelength_mm: float
) -> NDArray[np.complex128]:
    """Return the optical transfer function (f,) at frequencies (f,), cycles per mm: the
    autocorrelation of the aperture.

    ``axis`` 0 is tangential, 1 sagittal. The overlap of the full aperture and its shifted copy is
    lens-shaped and integrated by rows with Gauss-Legendre quadrature; a vignetted aperture is
    summed on a grid.
    """
    shift = 2 * wavelength_mm * wave.f_numbers[axis] * per_mm  # in aperture radii
    if wave.is_vignetted:
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
            position = (along + side * shift[i], across)
            ends.append(wave.phase_and_amplitude(_points(position, axis)))
        (W1, A1), (W2, A2) = ends
        otf[i] = (area.ravel() * A1 * A2) @ np.exp(2j * np.pi / wavelength_mm * (W1 - W2))
    otf /= _all_light(wave, nodes)
    return otf


def _grid_otf(
    wave: Wavefront, shift: Array, axis: int, wavelength_mm: float
) -> NDArray[np.complex128]:
    """Return the optical transfer function (f,) at shifts (f,), in radii, of a vignetted aperture.

    The autocorrelation of a grid is computed by FFT, with spline interpolation between integer
    shifts. Edges are softened over one cell, which preserves the sum of the amplitudes; the sum of
    the light, their square, is computed separately. The mean slope of the phase is removed first;
    it is a phase factor of the autocorrelation.
    """
    from scipy.interpolate import CubicSpline

    cells = int(np.clip(CELLS_PER_WAVE * wave.waves(wavelength_mm), *GRID_CELLS))
    centres = (np.arange(cells) + 0.5) * 2 / cells - 1
    phase, density, open_fraction = wave.on_grid(centres)
    field = np.sqrt(density) * open_fraction * np.exp(2j * np.pi / wavelength_mm * phase)
    if axis == 1:
        field = field.T
    tilt = float(np.angle((field[1:] * field[:-1].conj()).sum())) * cells / 2  # rad per radius
    field = field * np.exp(-1j * tilt * centres)[:, None]
    power = (np.abs(np.fft.fft(field, 2 * cells, axis=0)) ** 2).sum(axis=1)
    autocorrelation = np.fft.ifft(power)[: cells + 1]
    autocorrelation[0] = (density * open_fraction).sum()
    spline = CubicSpline(np.arange(cells + 1) * 2 / cells, autocorrelation / autocorrelation[0])
    inside_both = np.minimum(shift, 2.0)
    otf: NDArray[np.complex128] = np.where(
        shift < 2, spline(inside_both) * np.exp(1j * tilt * inside_both), 0.0
    )
    return otf


def geometric_otf(wave: Wavefront, per_mm: Array, axis: int) -> NDArray[np.complex128]:
    """Return the geometric optical transfer function (f,) at frequencies (f,), cycles per mm."""
    _, landing, _ = wave.at(FITTED.points)
    cycles = float(np.ptp(landing[:, axis])) * float(per_mm.max(initial=0.0))
    pupil = gaussian(int(np.clip(12 + 2 * cycles, 16, 200)))
    _, landing, light = wave.at(pupil.points)
    weights = light * pupil.weights
    otf: NDArray[np.complex128] = (
        np.exp(-2j * np.pi * np.outer(per_mm, landing[:, axis])) @ weights / weights.sum()
    )
    return otf


def _all_light(wave: Wavefront, nodes: int) -> float:
    """Return the integral of the light over the whole disc."""
    x, weight = np.polynomial.legendre.leggauss(nodes)
    psi = x * np.pi / 2
    along = np.cos(psi)[:, None] * x
    position = (along, np.broadcast_to(np.sin(psi)[:, None], along.shape))
    area = (np.pi / 2 * weight * np.cos(psi) ** 2)[:, None] * weight
    return float(area.ravel() @ wave.light(_points(position, 0)))


def _points(position: tuple[Array, Array], axis: int) -> Array:
    """Return points (n, 2) of the aperture from coordinates along and perpendicular to an axis."""
    return np.stack(position if axis == 0 else position[::-1], axis=-1).reshape(-1, 2)


def _pixel_mtf(bundles: Bundles, nu: Array) -> Array:
    """Return the pixel MTF (2, k, f) in the tangential and sagittal directions."""
    along = bundles.axes().transpose(1, 0, 2)[:, :, None, :] * nu[:, None]
    transfer: Array = np.abs(np.sinc(along)).prod(axis=-1)
    return transfer


def _spectrum(wavelength_nm: ArrayLike, weights: ArrayLike | None) -> tuple[Array, Array]:
    """Return wavelengths and their weights, normalised to the sum 1."""
    waves = row("wavelength_nm", wavelength_nm)
    spectral_weights = np.ones(len(waves)) if weights is None else row("weights", weights)
    if len(spectral_weights) != len(waves):
        raise InvalidParameter(
            f"weights must have one value for each of the {len(waves)} wavelengths; got {len(spectral_weights)}"
        )
    valid = (waves >= 100) & (waves <= 20000)
    if not valid.all():
        raise InvalidParameter(f"wavelength_nm must be 100 to 20000 nm; got {waves[~valid][0]:g}")
    if not ((spectral_weights >= 0).all() and spectral_weights.sum() > 0):
        raise InvalidParameter(
            "weights must be at least 0, and one must be greater than 0; got "
            f"{format_value(spectral_weights.tolist())}"
        )
    return waves, spectral_weights / spectral_weights.sum()
