"""Batch evaluation of designs against separate evaluations, and the compiled evaluator against
NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, NotOneToOne, OmnimirrorError
from omnimirror.base.native import backend
from omnimirror.optics.batch.evaluate import BATCH_COLUMNS, Designs, evaluate_designs
from omnimirror.optics.batch.families import family
from omnimirror.optics.image_sensor import Imager
from tests.everyday import few
from tests.samplers import instructions

M = 43.9
IMAGER = Imager(1024, 1024, 5.2)
BASES = [("exact", None), ("paper", 500.0), ("exact", 500.0), ("paper", None)]


def sphere_like(name: str, count: int, seed: int, **options) -> Designs:
    """Return spheres with random changes of all coefficients, in the parameters of each family."""
    rng = np.random.default_rng(seed)
    A = M / 43.9 * 1.138
    if name == "conic-asphere":
        shape = family(name, 3)
        c = 0.02 * rng.standard_normal((count, 3))
        options |= {
            "vertex_radius_mm": A * M * rng.uniform(0.9, 1.2, count),
            "conic": rng.uniform(-1.0, 0.0, count),
        }
    else:
        shape = family(name, {"even-polynomial": 5, "slope-spline": 9}[name])
        u = shape.slope_places()
        slopes = u / np.sqrt(A**2 - u**2) * (1 + 0.02 * rng.standard_normal((count, u.size)))
        c = slopes @ shape.from_slopes().T
    m, F = M * rng.uniform(3.6, 4.4, count), rng.uniform(2.0, 8.0, count)
    return Designs(shape, c, m, M, 11.6, F, 5.2, **options)


@pytest.mark.parametrize(("mode", "radius"), BASES)
@pytest.mark.parametrize("name", ["even-polynomial", "conic-asphere", "slope-spline"])
@pytest.mark.parametrize("distance", [np.inf, 300.0])
def test_columns_match_evaluation(name, mode, radius, distance):
    designs = sphere_like(
        name, 12, 1, mode=mode, image_radius_px=radius, object_distance_mm=distance
    )
    batch = evaluate_designs(designs)
    assert batch.valid.sum() >= 6
    for i in np.flatnonzero(batch.valid)[:4]:
        sensor = designs.sensor(i, IMAGER, batch.focus_mm[i])
        single = om.evaluate(
            sensor,
            x_mm=np.linspace(0, 1, 100) * M,
            mode=mode,
            image_radius_px=radius,
            object_distance_mm=distance,
        )
        for column in BATCH_COLUMNS:
            expected = getattr(single, column)
            np.testing.assert_allclose(
                getattr(batch, column)[i],
                expected,
                rtol=1e-10,
                atol=1e-12 * np.abs(expected).max(),
                err_msg=column,
            )
        assert batch.worst_floored_area_deg2[i] == pytest.approx(
            single.floored_area_deg2.max(), rel=1e-10
        )


@pytest.mark.parametrize("radius", [None, 500.0])
@pytest.mark.parametrize("name", ["even-polynomial", "conic-asphere", "slope-spline"])
def test_telecentric_columns_match_evaluation(name, radius):
    designs = sphere_like(
        name, 12, 1, magnification=0.06, image_radius_px=radius, object_distance_mm=400.0
    )
    batch = evaluate_designs(designs)
    assert batch.valid.sum() >= 6
    for i in np.flatnonzero(batch.valid)[:4]:
        sensor = designs.sensor(i, IMAGER, batch.focus_mm[i])
        assert sensor.lens.KIND == "orthographic"
        single = om.evaluate(
            sensor,
            x_mm=np.linspace(0, 1, 100) * M,
            image_radius_px=radius,
            object_distance_mm=400.0,
        )
        for column in BATCH_COLUMNS:
            expected = getattr(single, column)
            np.testing.assert_allclose(
                getattr(batch, column)[i],
                expected,
                rtol=1e-10,
                atol=1e-12 * np.abs(expected).max(),
                err_msg=column,
            )
        best = om.best_focus(
            sensor, omega_deg=batch.omega_deg[i], object_distance_mm=400.0, image_radius_px=radius
        )
        assert batch.worst_floored_area_deg2[i] <= best.value * (1 + 1e-9)


def test_object_distance_per_field_angle():
    """Nearest and farthest object at one focus: columns of each alone, and the worst of both."""
    u = np.linspace(0.0, 1.0, 60)
    distances = np.repeat([300.0, np.inf], 60)
    designs = sphere_like("slope-spline", 5, 1, object_distance_mm=distances)
    batch = evaluate_designs(designs, np.tile(u, 2))
    for i in np.flatnonzero(batch.valid):
        sensor = designs.sensor(i, IMAGER, batch.focus_mm[i])
        near, far = (om.evaluate(sensor, x_mm=u * M, object_distance_mm=d) for d in (300.0, np.inf))
        blur = np.concatenate([near.blur_t_px, far.blur_t_px])
        np.testing.assert_allclose(batch.blur_t_px[i], blur, rtol=1e-9, atol=1e-10)
        worst = max(near.floored_area_deg2.max(), far.floored_area_deg2.max())
        assert batch.worst_floored_area_deg2[i] == pytest.approx(worst, rel=1e-10)
    with pytest.raises(InvalidParameter, match="60 field angles"):
        evaluate_designs(designs, u)


@pytest.mark.parametrize(("mode", "radius"), BASES)
@settings(max_examples=20)
@given(
    seed=st.integers(0, 10**6),
    name=st.sampled_from(["even-polynomial", "conic-asphere", "slope-spline"]),
)
def test_batch_focus_equals_best_focus(mode, radius, seed, name):
    """Compared with the scan and golden sections of om.best_focus at the same angles: never worse
    by more than 1e-9."""
    designs = sphere_like(name, 1, seed, mode=mode, image_radius_px=radius)
    batch = evaluate_designs(designs)
    images = np.concatenate([batch.distance_t_mm[0], batch.distance_s_mm[0]])
    if not batch.valid[0] or images.min() < 50 or images.max() > 2000:
        return  # not a usable mirror
    sensor = designs.sensor(0, IMAGER, batch.focus_mm[0])
    angles = np.minimum(batch.omega_deg[0], sensor.field_deg[1])
    best = om.best_focus(
        sensor, "worst_floored_area_deg2", omega_deg=angles, mode=mode, image_radius_px=radius
    )
    assert batch.worst_floored_area_deg2[0] <= best.value * (1 + 1e-9)
    if batch.worst_floored_area_deg2[0] >= best.value * (1 - 1e-9):  # else another valley
        assert batch.focus_mm[0] == pytest.approx(best.focus_mm, rel=1e-5)


@pytest.mark.parametrize(
    "native",
    [
        False,
        pytest.param(True, marks=pytest.mark.skipif(not backend.is_compiled, reason="not built")),
    ],
)
@pytest.mark.parametrize(
    ("name", "mode", "seed", "design"),
    few(
        [("even-polynomial", "exact", 2, 93), ("slope-spline", "exact", 1, 174)],
        ("even-polynomial", "exact", 2, 93),
    ),
)
def test_global_minimum_of_several_valleys(name, mode, seed, design, native):
    """Designs whose lowest valley starts or ends between two scan points: against a scan of 401."""
    designs = sphere_like(name, 300, seed, mode=mode, image_radius_px=500.0).part(
        slice(design, design + 1)
    )
    batch = evaluate_designs(designs, native=native)
    angles = batch.omega_deg[0]
    sensor = designs.sensor(0, IMAGER, batch.focus_mm[0])
    angles = np.minimum(angles, sensor.field_deg[1])
    images = 1 / np.concatenate([batch.distance_t_mm[0], batch.distance_s_mm[0]])
    areas = [
        om.evaluate(
            designs.sensor(0, IMAGER, 1 / v), omega_deg=angles, mode=mode, image_radius_px=500.0
        ).floored_area_deg2.max()
        for v in np.linspace(images.min(), images.max(), 401)
    ]
    assert batch.worst_floored_area_deg2[0] <= min(areas) * (1 + 1e-9)


@pytest.mark.skipif(not backend.is_compiled, reason="the compiled part is not built here")
@pytest.mark.parametrize(("mode", "radius"), BASES)
@pytest.mark.parametrize("name", ["even-polynomial", "conic-asphere", "slope-spline"])
@pytest.mark.parametrize("magnification", [0.0, 0.06])
def test_compiled_results_match_numpy(name, mode, radius, magnification):
    options = {
        "mode": mode,
        "image_radius_px": radius,
        "min_omega_deg": 20.0,
        "magnification": magnification,
    }
    designs = sphere_like(name, 300, 2, **options)
    plain, fast = (evaluate_designs(designs, native=native) for native in (False, True))
    np.testing.assert_array_equal(plain.valid, fast.valid)
    ok = plain.valid
    np.testing.assert_allclose(fast.focus_mm[ok], plain.focus_mm[ok], rtol=1e-11)
    np.testing.assert_allclose(
        fast.worst_floored_area_deg2[ok], plain.worst_floored_area_deg2[ok], rtol=1e-10
    )
    for column, a, b in zip(BATCH_COLUMNS, fast.columns, plain.columns, strict=True):
        if column.startswith("distance"):  # may pass through infinity
            a, b = 1 / a, 1 / b
        scale = np.abs(b[ok]).max(axis=1, keepdims=True)
        assert (np.abs(a[ok] - b[ok]) / scale).max() < 1e-10, column


@pytest.fixture(params=instructions())
def each_instruction_set(request):
    before = backend.kernels.instruction_set()
    backend.kernels.set_instruction_set(request.param)
    yield
    backend.kernels.set_instruction_set(before)


@pytest.mark.usefixtures("each_instruction_set")
@pytest.mark.parametrize("angles", [1, 2, 7, 8, 9, 100])
def test_instruction_sets_match_numpy(angles):
    """Any number of remaining lanes, and slopes of all three pieces of the arctangent: up to 4 at
    the rim."""
    steep = [[0.6409, 0.155, -0.01], [1.0, 0.2, 0.0], [1.2, 0.4, 0.0], [0.2, 0.05, 0.0]]
    designs = Designs(
        family("even-polynomial", 3), steep, 250.0, M, 11.6, 4.0, 5.2, object_distance_mm=500.0
    )
    u = np.linspace(1.0 / angles, 1.0, angles)
    fast, plain = (evaluate_designs(designs, u, native=native) for native in (True, False))
    assert plain.valid.all()
    assert fast.valid.all()
    assert (plain.omega_deg[:, -1] > 90).sum() == 3
    np.testing.assert_allclose(fast.focus_mm, plain.focus_mm, rtol=1e-10)
    for column, a, b in zip(BATCH_COLUMNS, fast.columns, plain.columns, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-9 * np.abs(b).max(), err_msg=column)
    np.testing.assert_allclose(fast.omega_deg, plain.omega_deg, rtol=4e-16)


def test_invalid_designs_marked():
    """Folded, concave and grazing rims, as reported by the sensor itself."""
    shape = family("even-polynomial", 3)
    c = np.array([[0.64, 0.155, -0.01], [0.9, -0.25, 0.0], [-0.3, 0.0, 0.0], [0.5, 0.5, 5.0]])
    designs = Designs(shape, c, 3.9 * M, M, 11.6, 4.0, 5.2)
    for native in {False, backend.is_compiled}:
        assert evaluate_designs(designs, native=native).valid.tolist() == [
            True,
            False,
            False,
            False,
        ]
    with pytest.raises(NotOneToOne, match=r"less than 35.58"):
        om.evaluate(designs.sensor(1, IMAGER, 200.0))
    for i, message in (
        (2, "must increase away from the axis"),
        (3, "less than 31.29"),
    ):
        with pytest.raises(OmnimirrorError, match=message):
            om.evaluate(designs.sensor(i, IMAGER, 200.0))


def test_angles_below_minimum_excluded_from_focus():
    near, far = (
        evaluate_designs(sphere_like("slope-spline", 20, 3, min_omega_deg=minimum_deg))
        for minimum_deg in (0.0, 60.0)
    )
    both = near.valid & far.valid
    assert (
        far.worst_floored_area_deg2[both] <= near.worst_floored_area_deg2[both] * (1 + 1e-12)
    ).all()
    assert (far.worst_floored_area_deg2[both] < 0.999 * near.worst_floored_area_deg2[both]).any()


def test_invalid_batch_arguments_rejected():
    shape = family("even-polynomial", 3)
    with pytest.raises(InvalidParameter, match=r"\(n, 3\)"):
        Designs(shape, np.ones((2, 4)), 170.0, M, 11.6, 4.0, 5.2)
    with pytest.raises(InvalidParameter, match="f_number must be greater than 0; got -4"):
        Designs(shape, np.ones((2, 3)), 170.0, M, 11.6, -4.0, 5.2)
    with pytest.raises(InvalidParameter, match="one per design"):
        Designs(shape, np.ones((2, 3)), np.ones(3), M, 11.6, 4.0, 5.2)
    with pytest.raises(InvalidParameter, match="fraction of the rim radius"):
        evaluate_designs(Designs(shape, np.ones((2, 3)), 170.0, M, 11.6, 4.0, 5.2), [0.0, 1.5])
    with pytest.raises(InvalidParameter, match="must be one of even-polynomial"):
        family("sphere", 3)
    with pytest.raises(InvalidParameter, match="must be 1 to 12"):
        family("even-polynomial", 40)
