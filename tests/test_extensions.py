"""Extensions from outside the package: by a call, and by entry points of an installed package."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import tomli_w

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.parameters import Parameter
from omnimirror.base.quantities import Quantity
from omnimirror.cameras.camera import Projection, Rays
from omnimirror.design import Limitable
from omnimirror.design.limits import LIMITABLE
from omnimirror.optics.mirrors import MIRRORS, RIM_RADIUS, EvenPolynomial, Flat, Mirror
from omnimirror.optics.sensor_files import load_sensor, save_sensor, tables_of
from omnimirror.optics.testing import check_mirror
from tests.commands import Forks

PACKAGE = '''
"""A package that knows omnimirror, and that omnimirror does not know."""
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from omnimirror.design import Limitable
import omnimirror as om
from omnimirror.calibration.formats import CameraFormat, Layout, CameraEntry
from omnimirror.manufacturing import Content, Format
from omnimirror.optics.mirrors import RIM_RADIUS, Mirror
from omnimirror.base.parameters import Parameter
from omnimirror.base.quantities import Quantity
from omnimirror.screens import Cylinder

@dataclass(frozen=True)
class Bowl(Mirror):
    depth_mm: float
    rim_radius_mm: float
    KIND: ClassVar[str] = "bowl"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "depth_mm": Parameter("mm", 0.1, 1e3, "height of the rim above the vertex"),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self):
        self._check()

    def profile(self, x_mm):
        x, a = np.asarray(x_mm, dtype=float), self.depth_mm / self.rim_radius_mm**2
        return a * x**2, 2 * a * x, np.full_like(x, 2 * a)

def fan(camera, size=(300, 60), pan_deg=0.0):
    return Cylinder(tuple(side or 60 for side in size), -20.0, 20.0, pan_deg, 150.0)

def write(plan, part, path):
    x = np.linspace(0, part.mirror.rim_radius_mm, 3)
    np.savetxt(path, np.stack([x, part.mirror.sag(x)], axis=1), fmt="%.6f")
    return Content("three points", 5e-4)

dots = Format(write, (".dots",))

def centre_of(file, reading):
    u, v, width, height = map(float, file.text.split())
    camera = om.OCam(
        polynomial=(-100.0, 0.0, 0.002),
        centre_px=(u, v),
        image_size=(int(width), int(height)),
        **reading.model_arguments,
    )
    return [CameraEntry("", camera)]

def centre_to(camera, name):
    return "{} {} {} {}".format(*camera.centre_px, *camera.image_size)

centre = CameraFormat(
    "the centre", lambda file: False, centre_of, {"centre": Layout(om.OCam, centre_to, "centre")}, ("*.centre",)
)

pixels = Quantity("density_px2", "n", "px²", "Density", "pixels on a square degree")
density = Limitable(pixels, lambda field: (field.dh * field.dw,), "smallest", is_scale=True)
'''.replace("omnimirror.screens", "omnimirror.dewarp.screens")
ENTRY_POINTS = """[omnimirror.mirrors]
bowl = bowls:Bowl
broken = bowls:NotThere
[omnimirror.views]
fan = bowls:fan
[omnimirror.formats]
dots = bowls:dots
[omnimirror.camera_formats]
centre = bowls:centre
[omnimirror.quantities]
density_px2 = bowls:density
"""


@dataclass(frozen=True)
class Quartic(Mirror):
    """z = depth (x / rim)^4, flat at its vertex with zero curvature."""

    depth_mm: float
    rim_radius_mm: float
    KIND: ClassVar[str] = "quartic"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "depth_mm": Parameter("mm", 0.1, 1e3, "height of the rim above the vertex"),
        "rim_radius_mm": RIM_RADIUS,
    }
    wrong: ClassVar[float] = 1.0

    def __post_init__(self):
        self._check()

    def profile(self, x_mm):
        u, a = (
            np.asarray(x_mm, dtype=float) / self.rim_radius_mm,
            self.depth_mm / self.rim_radius_mm,
        )
        return self.depth_mm * u**4, 4 * a * u**3 * self.wrong, 12 * a / self.rim_radius_mm * u**2


@pytest.fixture
def quartic():
    om.register_mirror(Quartic)
    yield Quartic(20.0, 40.0)
    MIRRORS.withdraw("quartic")


@pytest.fixture(scope="module")
def environment(tmp_path_factory) -> dict[str, str]:
    """Environment of a Python with the package installed."""
    site = tmp_path_factory.mktemp("site")
    (site / "bowls.py").write_text(PACKAGE)
    (site / "bowls-1.0.dist-info").mkdir()
    (site / "bowls-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: bowls\nVersion: 1.0\n"
    )
    (site / "bowls-1.0.dist-info" / "entry_points.txt").write_text(ENTRY_POINTS)
    src = str(Path(om.__file__).parents[1])
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), src])}


@pytest.fixture(scope="module")
def installed(environment) -> Iterator[Forks]:
    """Python environment with a separate process for each command."""
    forks = Forks(environment)
    yield forks
    forks.kill()


def omnimirror(installed: Forks, folder: Path, *args) -> subprocess.CompletedProcess[str]:
    return installed.command(list(map(str, args)), folder)


def sensor_with(mirror: Mirror) -> om.Sensor:
    paper = load_sensor("paper-spherical")
    return om.Sensor(mirror, paper.lens, paper.imager, mirror_distance_mm=180.0, name="mine")


def test_user_mirror_meets_contract(quartic):
    check_mirror(quartic)


def test_contract_detects_wrong_slope(quartic, monkeypatch):
    """The error 0.001 slope is largest at the outermost sample, 0.93 of the rim, with the slope 2 *
    0.93^3."""
    monkeypatch.setattr(Quartic, "wrong", 1.001)
    with pytest.raises(
        AssertionError,
        match=r"^slope at x = 37\.2 mm is 1\.6103.*, but its integral changes by 1\.60871",
    ):
        check_mirror(quartic)
    monkeypatch.setattr(Quartic, "wrong", 1 + 1e-7)  # with_slope_error the tolerance
    check_mirror(quartic)


def with_profile(change):
    """Return a quartic mirror with its profile changed by a function of x / rim, sag, slope and
    curvature."""

    def profile(self, x_mm, own=Quartic.profile):
        return change(np.asarray(x_mm, dtype=float) / self.rim_radius_mm, *own(self, x_mm))

    return {"profile": profile}


def with_check(high, names_it=True):
    """Return a mirror with weaker checks: depth up to ``high`` only, or without the name in the
    message."""

    def post_init(self):
        if not self.depth_mm <= high:
            raise InvalidParameter(
                f"depth_mm = {self.depth_mm:g} is too large" if names_it else "too large"
            )

    return {"__post_init__": post_init}


def with_parameters(**changes):
    """Return other parameter descriptions; None removes one."""
    return {
        "PARAMETERS": {n: p for n, p in (Quartic.PARAMETERS | changes).items() if p is not None}
    }


def with_slope_error(low, high):
    """Return a slope error of 0.01 between two fractions of the rim radius."""
    return with_profile(lambda u, z, s, c: (z, s + 0.01 * ((low < u) & (u < high)), c))


DEPTH, RADIUS = Quartic.PARAMETERS["depth_mm"], Quartic.PARAMETERS["rim_radius_mm"]
BREACHES = {
    "slope in the middle": (with_slope_error(0.1, 0.2), "slope at x = 5.2 mm is"),
    "slope of the inner zone": (with_slope_error(0.25, 0.35), "slope at x = 12.4 mm is"),
    "slope of the zone between": (with_slope_error(0.5, 0.6), "slope at x = 20.8 mm is"),
    "slope of the outer zone": (with_slope_error(0.7, 0.8), "slope at x = 30.8 mm is"),
    "slope of the rim": (with_slope_error(0.9, 0.95), "slope at x = 37.2 mm is"),
    "curvature": (
        with_profile(lambda u, z, s, c: (z, s, 0.999 * c)),
        "curvature at x = 37.2 mm is",
    ),
    "small error of slope": (
        with_profile(lambda u, z, s, c: (z, s * (1 + 5e-6), c)),
        "slope at x = 37.2 mm is",
    ),
    "own sag": (
        {"sag": lambda self, x: self.profile(x)[0] + 1e-9},
        "sag differs from that of profile",
    ),
    "own sag at the first of ten steps": (
        {"sag": lambda self, x: self.profile(x)[0] + 1e-9 * (np.asarray(x) == 4.0)},
        "sag differs from that of profile",
    ),
    "own slope in two dimensions": (
        {"slope": lambda self, x: self.profile(x)[1] + 1e-9 * (np.ndim(x) == 2) * (x == 16.0)},
        "slope differs from that of profile",
    ),
    "own slope of the rim": (
        {"slope": lambda self, x: self.profile(x)[1] + 1e-9 * (np.asarray(x) == 40.0)},
        "slope differs from that of profile",
    ),
    "own curvature of the vertex": (
        {"curvature": lambda self, x: self.profile(x)[2] + 1e-9 * (np.asarray(x) == 0.0)},
        "curvature differs from that of profile",
    ),
    "shape": (
        with_profile(lambda u, z, s, c: (z, s, c.ravel())),
        r"curvature of x with shape \(2, 3\) has shape \(6,\)",
    ),
    "vertex": (
        with_profile(lambda u, z, s, c: (z + 1e-12, s, c)),
        "the vertex must be at z = 0; got 1e-12 mm",
    ),
    "vertex below": (
        with_profile(lambda u, z, s, c: (z - 1e-12, s, c)),
        "the vertex must be at z = 0; got -1e-12 mm",
    ),
    "pointed": ({"is_pointed": True}, "is_pointed is True, but the vertex has slope 0"),
    "sagittal radius": (
        {"radius_s": lambda self, x, own=Mirror.radius_s: own(self, x) * (1 + 1e-9)},
        "radius_s differs from the length of the normal",
    ),
    "radii of the apex": (
        {"radius_t": lambda self, x: np.full_like(np.asarray(x), 50.0)},
        r"the radii at the apex must be equal",
    ),
    "radii of a curved apex": (
        with_profile(lambda u, z, s, c: (z + 20 * u**2, s + u, c + 1 / 40))
        | {"radius_t": lambda self, x, own=Mirror.radius_t: own(self, x) * (1 + 1e-9)},
        r"the radii at the apex must be equal; got \(40\.0, 40\.00000004",
    ),
    "bounds from the axis": ({"bounds": ((0.1, 40.0), (0.0, 20.0))}, r"got 0\.1 mm to 40 mm"),
    "bounds to the rim": ({"bounds": ((0.0, 40.1), (0.0, 20.0))}, r"got 0 mm to 40\.1 mm"),
    "bounds above the vertex": (
        {"bounds": ((0.0, 40.0), (1e-9, 20.0))},
        "start at z = 0 mm, as the meridian; got 1e-09 mm",
    ),
    "bounds above the rim": (
        {"bounds": ((0.0, 40.0), (0.0, 20.1))},
        r"end at z = 20 mm, as the meridian; got 20\.1 mm",
    ),
    "bounds below the rim": (
        {"bounds": ((0.0, 40.0), (0.0, 19.9))},
        r"end at z = 20 mm, as the meridian; got 19\.9 mm",
    ),
    "words": (
        {"__repr__": lambda self: "Quartic(20.0, 41.0)"},
        r"Quartic\(.*\) from Quartic\(20\.0, 41\.0\)",
    ),
    **{
        f"hash by steps of {step}": (
            {"__hash__": lambda self, numbers=numbers: next(numbers)},
            r"equal hashes; those of Quartic\(.*\) differ",
        )
        for step, numbers in ((1, count()), (-1, count(0, -1)))
    },
    "pickle": (
        {"__getstate__": lambda self: {"depth_mm": 21.0, "rim_radius_mm": 40.0}},
        r"must equal the original; got Quartic\(depth_mm=21\.0, .*\)",
    ),
    "no description of a field": (
        with_parameters(depth_mm=None) | {"__post_init__": lambda self: None},
        r"must describe the fields \['depth_mm', 'rim_radius_mm'\]; got \['rim_radius_mm'\]",
    ),
    "another order": (
        {"PARAMETERS": {"rim_radius_mm": RADIUS, "depth_mm": DEPTH}},
        r"must describe the fields .* got \['rim_radius_mm', 'depth_mm'\]",
    ),
    "no words": (
        with_parameters(depth_mm=replace(DEPTH, description="")),
        "depth_mm must have a description",
    ),
    "non-empty range": (
        with_parameters(depth_mm=replace(DEPTH, low=20.0, high=20.0)),
        "depth_mm must have a non-empty range",
    ),
    "unit of a length": (
        with_parameters(rim_radius_mm=replace(RADIUS, unit="")),
        "rim_radius_mm must end with",
    ),
    "no check behind a word": (
        {
            "PARAMETERS": {
                "depth_mm": Parameter("mm", 0.0, 0.0, "one of two", ("a", "b")),
                "rim_radius_mm": RADIUS,
            }
        }
        | {"__post_init__": lambda self: None},
        "rim_radius_mm = 101001 must be rejected",
    ),
    "no check": (with_check(np.inf), "depth_mm = 1011 must be rejected"),
    "a range twice as large": (with_check(2000.0), "depth_mm = 1011 must be rejected"),
    "a range that is 1.2 % larger": (with_check(1012.0), "depth_mm = 1011 must be rejected"),
    "no name": (
        with_check(1000.0, names_it=False),
        "depth_mm = 1011 must contain the name; got: too large",
    ),
    "NaN": (
        {
            "__post_init__": lambda self: DEPTH.check(
                "depth_mm", 20.0 if np.isnan(self.depth_mm) else self.depth_mm
            )
        },
        "depth_mm = nan must be rejected",
    ),
}


@pytest.mark.parametrize(
    ("members", "message"), BREACHES.values(), ids=[k.replace(" ", "-") for k in BREACHES]
)
def test_contract_names_violated_rule(members, message, quartic, monkeypatch):
    for name, member in members.items():
        monkeypatch.setattr(Quartic, name, member)
    with pytest.raises(AssertionError, match=message):
        check_mirror(quartic)


def test_contract_allows_minimum_between_vertex_and_rim(quartic, monkeypatch):
    """z = 20 (u^4 - u^2) mm with its minimum at u = 0.71; bounds are those of the sag at 513
    points."""
    members = with_profile(
        lambda u, z, s, c: (
            20 * (u**4 - u**2),
            20 / 40 * (4 * u**3 - 2 * u),
            20 / 1600 * (12 * u**2 - 2),
        )
    )
    monkeypatch.setattr(Quartic, "profile", members["profile"])
    check_mirror(quartic)


def test_contract_allows_flat_mirrors():
    """With infinite radii; a wrong radius is found where the slope is not 0."""
    check_mirror(Flat(20.0))


def test_contract_requires_units_in_names(monkeypatch):
    parameters = EvenPolynomial.PARAMETERS
    with_unit = replace(parameters["coefficients"], unit="mm")
    monkeypatch.setattr(EvenPolynomial, "PARAMETERS", parameters | {"coefficients": with_unit})
    with pytest.raises(AssertionError, match="coefficients must end with its unit"):
        check_mirror(EvenPolynomial((0.01,), 5.0))


def test_contract_rejects_objects_that_are_not_mirrors():
    with pytest.raises(TypeError, match="mirror must be a mirror; got 3"):
        check_mirror(3)


def test_registered_mirror_is_read_traced_and_evaluated(quartic, tmp_path):
    sensor = sensor_with(quartic)
    save_sensor(sensor, tmp_path / "mine.toml")
    assert load_sensor(tmp_path / "mine.toml") == sensor
    result = om.evaluate(sensor, x_mm=[10.0, 40.0])
    # from the law of reflection alone: Omega = 2 beta + theta
    slope, z = 4 * 20 / 40 * np.array([1 / 64, 1]), 20 * np.array([1 / 256, 1])
    expected = 2 * np.degrees(np.arctan(slope)) + np.degrees(np.arctan2([10, 40], 180 + z))
    np.testing.assert_allclose(result.omega_deg, expected, rtol=1e-12)
    worst = np.maximum(np.abs(result.blur_t_deg), np.abs(result.blur_s_deg)).max()
    assert 0 < om.blur_bound(sensor).blur_deg <= worst
    with pytest.raises(
        om.base.errors.OmnimirrorError,
        match=r"depth_mm must be greater than or equal to 0.1; got 0",
    ):
        om.optics.sensor_files.parse_sensor(
            (tmp_path / "mine.toml").read_text().replace("depth_mm = 20.0", "depth_mm = 0.0")
        )


def test_invalid_mirror_registration_is_rejected(quartic):
    class Plain(Mirror):
        KIND = "plain"

        def profile(self, x_mm):
            raise NotImplementedError

    with pytest.raises(InvalidParameter, match="must be a frozen dataclass"):
        om.register_mirror(Plain)
    with pytest.raises(TypeError, match="a mirror class must be derived"):
        om.register_mirror(3)
    with pytest.raises(InvalidParameter, match="the name of a mirror must be unique; got 'sphere'"):
        om.register_mirror(dataclass(frozen=True)(type("Other", (Quartic,), {"KIND": "sphere"})))
    with pytest.raises(InvalidParameter, match=r"the name of a .* must be unique"):
        om.register_view("panorama", lambda camera: None)
    with pytest.raises(
        InvalidParameter, match="the name of a quantity must be unique; got 'aspect'"
    ):
        om.register_quantity(LIMITABLE["aspect"])
    with pytest.raises(TypeError, match=r"must be an omnimirror\.design\.Limitable"):
        om.register_quantity("aspect")
    with pytest.raises(
        InvalidParameter, match=r"suffixes must not belong to another format; got \.step"
    ):
        om.register_format("other", om.manufacturing.Format(print, (".step",)))


def test_installed_package_adds_mirror(installed, tmp_path):
    bowl = {"kind": "bowl", "depth_mm": 20.0, "rim_radius_mm": 44.0}
    text = tomli_w.dumps(tables_of(load_sensor("paper-spherical")) | {"mirror": bowl})
    (tmp_path / "bowl.toml").write_text(text)
    run = omnimirror(
        installed, tmp_path, "evaluate", "bowl.toml", "--x-mm", "20", "--csv", "bowl.csv"
    )
    assert run.returncode == 0, run.stderr
    rows = np.genfromtxt(tmp_path / "bowl.csv", delimiter=",", names=True)
    assert rows["z_mm"] == pytest.approx(20 * (20 / 44) ** 2, rel=1e-12)
    (tmp_path / "none.toml").write_text(text.replace('"bowl"', '"broken"'))
    run = omnimirror(installed, tmp_path, "evaluate", "none.toml")
    assert run.returncode == 1
    assert "cannot load a mirror 'broken' of bowls (bowls:NotThere): module 'bowls'" in run.stderr
    assert "Traceback" not in run.stderr


def test_unusable_plugins_are_reported_and_omitted(installed, environment, tmp_path):
    run = omnimirror(installed, tmp_path, "init", "-o", "new.toml")
    assert run.returncode == 0, run.stderr
    assert "cannot load a mirror 'broken' of bowls (bowls:NotThere): module 'bowls'" in run.stderr
    assert len(run.stderr.splitlines()) == 1
    assert 'kind = "bowl"' in (tmp_path / "new.toml").read_text()
    form = (
        "from omnimirror.apps.studio._design_sensors import design_start; print([m.kind for m in "
        "design_start().mirrors])"
    )
    run = subprocess.run(
        [sys.executable, "-c", form], env=environment, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    assert "'bowl'" in run.stdout
    assert "'broken'" not in run.stdout


def test_installed_package_adds_view_and_format(installed, tmp_path):
    om.write_image(tmp_path / "a.png", np.full((1024, 1024, 3), 90, np.uint8))
    arguments = (
        "dewarp",
        "a.png",
        "--sensor",
        "paper-spherical",
        "--view",
        "fan",
        "--size",
        "320x80",
    )
    run = omnimirror(
        installed,
        tmp_path,
        *arguments,
        "--pan-deg",
        "30",
        "--set=image.transparent=false",
        "-o",
        "fan.png",
    )
    assert run.returncode == 0, run.stderr
    assert om.read_image(tmp_path / "fan.png").shape == (80, 320, 3)
    run = omnimirror(installed, tmp_path, *arguments, "--set", "view.roll_deg=30", "-o", "no.png")
    assert (
        "--set view.roll_deg requires --view perspective; it does not apply to --view fan"
        in run.stderr
    )
    run = omnimirror(installed, tmp_path, "export", "paper-spherical", "-o", "a.dots")
    assert run.returncode == 0, run.stderr
    x, z = np.loadtxt(tmp_path / "a.dots").T
    np.testing.assert_allclose(z, load_sensor("paper-spherical").mirror.sag(x), atol=1e-6)


LENS = Quantity("lens_mm", "m", "mm", "Distance", "lens to the vertex of the mirror")


@pytest.fixture
def lens_distance():
    om.register_quantity(Limitable(LENS, lambda field: (field.length - field.sag,), "largest"))
    yield LENS.name
    LIMITABLE.withdraw(LENS.name)


def test_user_quantity_is_checked_and_met_by_designs(lens_distance):
    """Lens distance, by the attribute of the sensor; the optimiser's sphere would need 172 mm."""
    sphere = load_sensor("paper-spherical")
    like = om.requirements_like(sphere, optimise="worst_blur_deg", shape="polynomial:3")
    for limit, is_met in (
        (sphere.mirror_distance_mm + 1, True),
        (sphere.mirror_distance_mm - 1, False),
    ):
        (row,) = om.check_requirements(
            replace(like, limits=(om.Limit(lens_distance, at_most=limit),)), sphere
        ).limits
        assert row.reached == pytest.approx(sphere.mirror_distance_mm, rel=1e-9)
        assert (row.is_met, row.unit) == (is_met, "mm")
    near = replace(
        like.changed(theta_max_deg=(10.0, 16.0)), limits=(om.Limit(lens_distance, at_most=150.0),)
    )
    design = om.design_sensor(near, search=om.SearchOptions(starts=1))
    assert design.is_met
    assert design.sensor.mirror_distance_mm <= 150.0 * (1 + 1e-6)


def test_installed_package_adds_quantity(installed, tmp_path):
    least = om.evaluate(load_sensor("paper-spherical"), np.linspace(0, 130, 1001)).area_px2.min()
    lines = ("field.omega_max_deg = 130", 'mirror = {family = "sphere", rim_radius_mm = [43, 44]}')
    limit = "lens.focal_length_mm = 11.6", "[[limit]]", 'quantity = "density_px2"', "at_least = 4.0"
    (tmp_path / "r.toml").write_text("\n".join(lines + limit))
    run = omnimirror(installed, tmp_path, "check", "r.toml", "paper-spherical", "--json", "t.json")
    assert run.returncode == (0 if least >= 4 else 3), run.stderr
    row = json.loads((tmp_path / "t.json").read_text())["requirements"][-1]
    assert (row["name"], row["unit"], row["reached"]) == (
        "density_px2",
        "px²",
        pytest.approx(least, rel=1e-6),
    )


class Staircase:
    """Two pixels per column: horizontal in the upper row, 45 deg down in the lower; without a base
    class of the package."""

    size, is_distant = (4, 2), True

    def __str__(self):
        return "staircase"

    def targets_at(self, u, v):
        turn, tilt = np.radians(90 * np.asarray(u)), -np.pi / 4 * np.asarray(v)
        return np.stack(
            [np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt) + 0 * turn],
            axis=-1,
        )


def test_user_screen_is_rendered_without_registration():
    """Each output pixel has the image value at the projection of its direction."""
    camera, screen = load_sensor("paper-spherical"), Staircase()
    v, u = np.mgrid[:1024, :1024]
    image = np.stack([u / 4, v / 4, np.full_like(u, 77)], axis=-1).astype(np.uint8)
    straight = om.Dewarper(camera, screen, "linear")(image)
    rows, columns = np.mgrid[:2, :4]
    projection = camera.project_directions(screen.targets_at(columns, rows).reshape(-1, 3))
    assert projection.valid.all()
    np.testing.assert_allclose(straight.reshape(-1, 3)[:, :2], projection.pixels / 4, atol=1.0)


class Pinhole:
    """Upward-looking camera with r = f tan(omega), without a base class of the package."""

    image_size, symmetry, focal_px = (101, 101), None, 50.0

    def backproject(self, pixels):
        u, v = np.asarray(pixels, dtype=float).T
        towards = np.stack(
            [-(v - 50) / self.focal_px, -(u - 50) / self.focal_px, np.ones_like(u)], axis=1
        )
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        return Rays(np.zeros_like(towards), towards, np.isfinite(u))

    def project(self, points_mm):
        return self.project_directions(points_mm)

    def project_directions(self, directions):
        x, y, z = np.asarray(directions, dtype=float).T
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = np.stack([50 - self.focal_px * y / z, 50 - self.focal_px * x / z], axis=1)
        valid = (z > 0) & (np.abs(pixels - 50) <= 50.5).all(axis=1)
        return Projection(np.where(valid[:, None], pixels, np.nan), valid)


def test_user_camera_is_dewarped_without_registration():
    camera = Pinhole()
    v, u = np.mgrid[:101, :101]
    image = np.stack([2 * u, 2 * v, np.full_like(u, 77)], axis=-1).astype(np.uint8)
    straight = om.Dewarper(camera, om.screens.DomeMaster((41, 41), 30.0, "zenith"), "linear")(image)
    assert tuple(straight[20, 20]) == (100, 100, 77)  # the zenith is the image centre
    away = 50 * np.tan(np.radians(30.0 * 10 / 20.5))  # r = f tan(omega), 10 px from the centre
    assert 2 * away == pytest.approx(abs(int(straight[10, 20, 1]) - 100), abs=1.5)


def test_installed_package_adds_camera_file_format(installed, tmp_path):
    camera = om.OCam(
        polynomial=(-100.0, 0.0, 0.002), centre_px=(310.5, 240.25), image_size=(640, 480)
    )
    om.save_camera(camera, tmp_path / "a.toml")
    out = omnimirror(installed, tmp_path, "convert", "a.toml", "-o", "a.centre")
    assert out.returncode == 0, out.stderr
    assert (tmp_path / "a.centre").read_text() == "310.5 240.25 640 480"
    out = omnimirror(installed, tmp_path, "convert", "a.centre", "-o", "b.toml", "--from", "centre")
    assert out.returncode == 0, out.stderr
    assert om.load_camera(tmp_path / "b.toml") == camera


def test_camera_format_names_are_unique():
    with pytest.raises(
        InvalidParameter, match="the name of a camera format must be unique; got 'kalibr'"
    ):
        om.register_camera_format(
            "kalibr", om.calibration.formats.CameraFormat("mine", print, print, {})
        )
    with pytest.raises(
        TypeError, match=r"must be an omnimirror\.calibration\.formats\.CameraFormat"
    ):
        om.register_camera_format("mine", print)
