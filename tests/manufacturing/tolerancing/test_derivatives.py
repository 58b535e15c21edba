"""Derivatives of all merits by all errors against finite real rays of an independent tracer.

A ray starts at a point of the entrance pupil, meets the perturbed mirror (height from independent
formulas, normal by differences), is reflected, and is iterated until it comes from the object. Lens and
imager are planes in space. Polynomials through images at several error sizes, and through their
merits, yield derivatives at 0.
"""

import numpy as np
import pytest
from scipy.special import eval_jacobi

import omnimirror as om
from omnimirror.base.numerics import zernike_terms
from omnimirror.manufacturing.tolerancing.compensation import CALIBRATIONS, POSE, after, merit_names
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from omnimirror.manufacturing.tolerancing.sensitivity import merit_rates
from omnimirror.manufacturing.tolerancing.tolerances import error_sources
from omnimirror.optics.mirrors import EvenPolynomial

NODES = np.arange(7.0)
PUPIL = 0.3 * np.array(
    [
        [0, 0],
        *((side, 0) for side in (1, -1, 2, -2, 3, -3)),
        *((0, side) for side in (1, -1, 2, -2, 3, -3)),
    ]
)
"""mm; derivatives over the pupil are of sixth order."""
NEAR = np.vander(0.05 * NODES, increasing=True) @ np.linalg.inv(np.vander(NODES, increasing=True))
"""Extrapolation of motions at the nodes to values near 0 by the interpolating polynomial: the worst
object at 0."""
AT_ZERO = np.linalg.inv(np.vander(NODES, increasing=True))[1:3]
"""Coefficients 1 and 2 of the polynomial through values at the nodes."""


def noll(j):
    n = 0
    while (n + 1) * (n + 2) // 2 < j:
        n += 1
    satisfies_limit = j - n * (n + 1) // 2
    m = (satisfies_limit // 2) * 2 if n % 2 == 0 else ((satisfies_limit - 1) // 2) * 2 + 1
    return n, m, j % 2 == 0


def zernike(j, x, y):
    n, m, even = noll(j)
    r, phi = np.hypot(x, y), np.arctan2(y, x)
    k = (n - m) // 2
    radial = (-1) ** k * r**m * eval_jacobi(k, m, 0, 1 - 2 * r * r) * np.sqrt(n + 1)
    return (
        radial if m == 0 else radial * np.sqrt(2) * (np.cos(m * phi) if even else np.sin(m * phi))
    )


class Rays:
    """Sensor with one error: error sizes, pupil points and objects along the array axes."""

    def __init__(self, sensor, name, sizes):
        self.sensor, self.name, self.sizes = sensor, name, sizes[:, None, None]

    def of(self, name, nominal=0.0):
        return nominal + (self.sizes if name == self.name else 0 * self.sizes)

    def height(self, x, y):
        mirror, s = self.sensor.mirror, x * x + y * y
        if isinstance(mirror, EvenPolynomial):
            rim = mirror.normalization_radius_mm
            terms = (
                (self.of(f"mirror.coefficients[{i}]", c), 2 * i + 2)
                for i, c in enumerate(mirror.coefficients)
            )
            z = sum(c * rim * (np.sqrt(s) / rim) ** power for c, power in terms)
        else:
            c = 1 / self.of("mirror.vertex_radius_mm", mirror.vertex_radius)
            z = c * s / (1 + np.sqrt(1 - (1 + self.of("mirror.conic", mirror.conic)) * c * c * s))
        if "zernike" in self.name:
            rim = mirror.rim_radius_mm
            z = z + self.sizes * 1e-3 * zernike(int(self.name.split("_")[1]), x / rim, y / rim)
        return z

    def slopes(self, x, y, h=0.15):
        steps = h * np.array([1, 2, 3, -1, -2, -3])[:, None, None, None]

        def along(heights):
            at = heights[:3] - heights[3:]
            return (45 * at[0] - 9 * at[1] + at[2]) / (60 * h)

        return along(self.height(x + steps, y)), along(self.height(x, y + steps))

    def tilted(self, part):
        a, b = (np.radians(self.of(f"{part}.tilt_{axis}_deg")) for axis in "xy")
        one, zero = np.ones_like(a), np.zeros_like(a)
        about_x = np.stack(
            [one, zero, zero, zero, np.cos(a), -np.sin(a), zero, np.sin(a), np.cos(a)], -1
        )
        about_y = np.stack(
            [np.cos(b), zero, np.sin(b), zero, one, zero, -np.sin(b), zero, np.cos(b)], -1
        )
        return about_y.reshape(*a.shape, 3, 3) @ about_x.reshape(*a.shape, 3, 3)

    def reflected(self, tangents):
        """Return object directions (..., 3) of rays with tangents (..., 2) at the pupil."""
        turn = self.tilted("mirror")
        names = ("decentre_x_mm", "decentre_y_mm", "displacement_mm")
        shift = np.stack([self.of(f"mirror.{n}") for n in names], -1)
        position = (
            self.of("lens.entrance_pupil_mm", self.sensor.lens.entrance_pupil_mm)
            - self.sensor.mirror_distance_mm
        )
        start = (
            np.stack(np.broadcast_arrays(PUPIL[:, 0, None], PUPIL[:, 1, None], position), -1)
            - shift
        )
        start = np.einsum("...ji,...j->...i", turn, start)
        d = np.concatenate([tangents, np.ones_like(tangents[..., :1])], -1)
        d = np.einsum("...ji,...j->...i", turn, d / np.linalg.norm(d, axis=-1, keepdims=True))
        s = (0 * self.sizes + self.sensor.mirror_distance_mm) / d[..., 2]
        for _ in range(12):
            x, y, z = np.moveaxis(start + s[..., None] * d, -1, 0)
            gx, gy = self.slopes(x, y)
            step = (z - self.height(x, y)) / (d[..., 2] - gx * d[..., 0] - gy * d[..., 1])
            s = s - step
            if np.abs(step).max() < 1e-9:  # mm; the next step would be its square
                break
        x, y, _ = np.moveaxis(start + s[..., None] * d, -1, 0)
        gx, gy = self.slopes(x, y)
        normal = (
            np.stack([gx, gy, -np.ones_like(gx)], -1) / np.sqrt(1 + gx * gx + gy * gy)[..., None]
        )
        away = d - 2 * (d * normal).sum(-1, keepdims=True) * normal
        return np.einsum("...ij,...j->...i", turn, away)

    def tangents(self, targets, start):
        """Return tangents of rays from distant objects."""
        side = np.cross(targets, [0.3, 0.5, 0.8])
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        sides = np.stack([side, np.cross(targets, side)], -2)
        t = np.broadcast_to(start, (len(NODES), len(PUPIL), *start.shape)).copy()

        def miss(t):
            return np.einsum("nki,...ni->...nk", sides, self.reflected(t))

        for _ in range(7):
            error, h = miss(t), 1e-6
            if np.abs(error).max() < 1e-14:
                break
            rate = np.stack([(miss(t + step) - error) / h for step in h * np.eye(2)], -1)
            t -= np.linalg.solve(rate, error[..., None])[..., 0]
        assert np.abs(miss(t)).max() < 1e-12
        return t

    def imaged(self, t, vergence):
        """Return pixels relative to the axis of rays through the pupil, with the imager in focus."""
        lens, pitch = self.sensor.lens, self.sensor.imager.pitch_mm
        x, y = np.moveaxis(t + PUPIL[:, None, :] * vergence[..., None], -1, 0)
        k1, k2, k3, p1, p2 = (
            self.of(f"lens.{k}", v)
            for k, v in zip(("k1", "k2", "k3", "p1", "p2"), lens.brown, strict=True)
        )
        s = x * x + y * y
        scale = 1 + k1 * s + k2 * s**2 + k3 * s**3
        ray = np.stack(
            [
                x * scale + 2 * p1 * x * y + p2 * (s + 2 * x * x),
                y * scale + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
                np.ones_like(s),
            ],
            -1,
        )
        f, at = (
            self.of("lens.focal_length_mm", lens.focal_length_mm),
            self.of("lens.entrance_pupil_mm", lens.entrance_pupil_mm),
        )
        far = f / (1 - (f - at) * vergence)
        axes, turn = self.tilted("imager"), np.radians(self.of("imager.rotation_deg"))
        u = np.cos(turn)[..., None] * axes[..., 0] + np.sin(turn)[..., None] * axes[..., 1]
        v = np.cos(turn)[..., None] * axes[..., 1] - np.sin(turn)[..., None] * axes[..., 0]
        normal = axes[..., 2]
        intersection = ray * (far * normal[..., 2] / (ray * normal).sum(-1))[..., None]
        intersection[..., 2] -= far
        pixels = (
            np.stack([(intersection * u).sum(-1), (intersection * v).sum(-1)], -1)
            / (pitch * (1 + 1e-6 * self.of("imager.pitch_ppm")))[..., None]
        )
        return pixels + np.stack([self.of("imager.shift_x_px"), self.of("imager.shift_y_px")], -1)

    def on_tilted(self, t):
        """Return the same for a tilted imager: rays ``b (t + p/f) - p`` at depth b intersect its
        plane.
        """
        lens, axes = self.sensor.lens, self.tilted("imager")
        pupil = np.broadcast_to(PUPIL[:, None, :], t.shape)
        slope = t + pupil / lens.focal_length_mm
        plane = np.broadcast_to(axes[..., :2], (*t.shape[:-1], 3, 2))
        system = plane[..., :2, :] - slope[..., None] * plane[..., 2:, :]
        right = lens.image_distance * slope - pupil
        return np.linalg.solve(system, right[..., None])[..., 0] / self.sensor.imager.pitch_mm

    def shown(self, targets, start):
        """Return pixels (k, n, 2) and blurs (k, n, 2, 2) per aperture diameter, px."""
        lens = self.sensor.lens
        focus = self.of("lens.focus_distance_mm", lens.focus_distance_mm)
        vergence = 1 / (focus - self.of("lens.entrance_pupil_mm", lens.entrance_pupil_mm))
        tangents, is_tilted = self.tangents(targets, start), self.name.startswith("imager.tilt")
        pixels = self.on_tilted(tangents) if is_tilted else self.imaged(tangents, vergence)
        weights = np.array([45, -45, -9, 9, 1, -1]) / (60 * PUPIL[1, 0])
        sides = [np.einsum("p,kpni->kni", weights, pixels[:, k : k + 6]) for k in (1, 7)]
        f, number = (
            self.of("lens.focal_length_mm", lens.focal_length_mm),
            self.of("lens.f_number", lens.f_number),
        )
        return pixels[:, 0], np.stack(sides, -1) * (f / number)[..., None]


def merits_of(evaluator, rays):
    """Return merits of finite rays by name: values (k,) and the number of steps between them."""
    field = evaluator.field
    start = (
        field.offsets_px
        * evaluator.field.sensor.imager.pitch_mm
        / evaluator.field.sensor.lens.principal_distance
    )
    pixels, blur = rays.shown(field.targets, start)
    pixels = np.tensordot(NEAR, pixels, 1)
    motion = (pixels - pixels[:1]).transpose(0, 2, 1).reshape(len(pixels), -1)
    x, y = field.offsets_px.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    shifts = np.array([np.append(one, zero), np.append(zero, one)])
    affine = np.vstack([shifts, *([np.append(c, zero), np.append(zero, c)] for c in (x, y))])
    left = evaluator.compensators.left(
        motion
    )  # residuals of pose and mapping are compared with a full fit elsewhere
    for k, columns in ((1, shifts), (2, affine)):
        left[k] = motion - (columns.T @ np.linalg.lstsq(columns.T, motion.T, rcond=None)[0]).T
    merits_by_name = {}
    for depth, vectors in zip(CALIBRATIONS, left, strict=True):
        px = np.stack(np.split(vectors, 2, axis=1), -1)
        deg = np.linalg.solve(field.px_per_deg, px[..., None])[..., 0]
        for name, of in (("motion{}_px", px), ("direction_error{}_deg", deg)):
            lengths = np.hypot(*np.moveaxis(of, -1, 0))
            merits_by_name[after(name.format("_rms"), depth)] = (
                np.sqrt((lengths**2).mean(axis=1)),
                0.05,
            )
            merits_by_name[after(name.format(""), depth)] = lengths.max(axis=1), 0.05
    sizes = np.linalg.svd(blur, compute_uv=False)
    merits_by_name["blur_px"] = sizes[..., 0].max(axis=1), 1.0
    square_px = np.sqrt(((sizes**2) + evaluator.floor_px2).prod(axis=-1))
    merits_by_name["floored_area_deg2"] = (
        (square_px / np.abs(np.linalg.det(field.px_per_deg))).max(axis=1),
        1.0,
    )
    return merits_by_name


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("paper-spherical", 2),
        pytest.param("paper-spherical", 4, marks=pytest.mark.full),
        *(
            pytest.param(f"paper-{n}", 6, marks=pytest.mark.full)
            for n in ("spherical", "hyperboloidal", "equidistant")
        ),
    ],
)
def test_derivatives_match_finite_rays(name, order):
    sensor = om.load_sensor(name)
    evaluator = TrialEvaluator.of(sensor, angles=2, azimuths=7)
    for error, kind in error_sources(sensor).items():
        if "zernike" in error and int(error.split("_")[1]) > zernike_terms(order):
            continue  # the same sums; over the aperture of finite rays such fine terms are nonlinear
        share = (
            0.1 if error.startswith("imager.tilt") else 0.2
        )  # beyond 0.16 deg another object is the worst one
        step = share * kind.typical_tolerances["medium"]
        rates = merit_rates(evaluator, error, step)
        assert set(rates) == set(merit_names()[:-1])
        merits = merits_of(evaluator, Rays(sensor, error, step * NODES))
        for merit, (values, steps) in merits.items():
            near = steps * step
            first, second = AT_ZERO @ values / [near, near**2 / 2]
            if (name, merit) == ("paper-hyperboloidal", "blur_px"):
                continue  # T and S images differ by 1e-4 px: a kink within the steps
            deep = merit.endswith(("pose", "radial"))
            if deep and error in POSE:
                first = second = 0.0  # the residual of a pose is of third order
            scale = np.ptp(merits["motion_px" if deep else merit][0]) / (near * NODES[-1])
            close = 1e-5 * scale + 1e-8 / step
            assert rates[merit].first == pytest.approx(first, rel=1e-5, abs=close), (error, merit)
            assert rates[merit].second == pytest.approx(second, rel=1e-5, abs=close / step), (
                error,
                merit,
            )
        expected = {"lens.focus_distance_mm": 1.0}.get(error, 0.0)
        rounding = 1e-12 * sensor.lens.focus_distance_mm
        assert rates["focus_distance_mm"].first == pytest.approx(expected, abs=rounding / step)
        assert rates["focus_distance_mm"].second == pytest.approx(0.0, abs=rounding / step**2)
