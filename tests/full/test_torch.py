"""Differentiable cameras against NumPy, and their gradients against finite differences (gradcheck)."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import Camera, Mount
from omnimirror.interop.torch import _reflection, differentiable
from omnimirror.optics.housing import Housing, Tube
from omnimirror.optics.image_sensor import ImagerPose
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.conftest import MIRRORS, sensor_of

pytestmark = pytest.mark.full
torch = pytest.importorskip("torch", reason="PyTorch is installed by `make test-full` only")

SPH = om.load_sensor("paper-spherical")
POSE = MirrorPose(1.5, -0.8, 0.6, 1.2, -2.0)
PAIRS = [
    pytest.param(sensor_of(kind, lens), id=f"{kind}/{lens}")
    for kind in sorted(MIRRORS)
    for lens in ("perspective", "orthographic")
    if lens == "perspective" or kind in ("sphere", "paraboloid", "even-polynomial")
]
LENS = replace(SPH.lens, k1=-0.8, k2=3.0, p1=0.004, p2=-0.003)
needs_gpu = pytest.mark.skipif(
    not torch.cuda.is_available(), reason="no GPU is available to PyTorch"
)
DEVICES = ["cpu", pytest.param("cuda", marks=needs_gpu)]
FREE = {
    "sphere": "shape",
    "hyperboloid": "shape",
    "even-polynomial": "shape",
    "conic-asphere": "shape",
    "cone": "shape",
    "slope-spline": "mirror.slopes[60]",
    "equidistant": "shape",
}


def sample_inputs(camera: Camera, count: int = 2000) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(7)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    width, height = camera.image_size
    return {
        "project": directions * rng.uniform(120, 5000, (count, 1)),
        "project_directions": 3 * directions,
        "backproject": rng.uniform(-0.5, [width - 0.5, height - 0.5], (count, 2)),
    }


def compare(camera: Camera, expected: Camera, px: float = 1e-6) -> None:
    for name, inputs in sample_inputs(expected).items():
        result = getattr(camera, name)(torch.from_numpy(inputs))
        truth = getattr(expected, name)(inputs)
        np.testing.assert_array_equal(result.valid.numpy(), truth.valid)
        assert truth.valid.sum() > 100
        for tensor, array in zip(result[:-1], truth[:-1], strict=True):
            np.testing.assert_allclose(
                tensor.detach().numpy()[truth.valid], array[truth.valid], rtol=0, atol=px
            )
            assert not tensor[~result.valid].any()


@pytest.mark.parametrize("sensor", PAIRS)
@pytest.mark.parametrize("pose", [MirrorPose(), POSE], ids=["aligned", "misaligned"])
def test_results_equal_numpy(sensor, pose):
    compare(differentiable(replace(sensor, mirror_pose=pose)), replace(sensor, mirror_pose=pose))


def test_distorted_lens_tilted_mount_and_flipped_image():
    mount = Mount("down", 20.0, image_flipped=True, pitch_deg=4.0)
    sensor = replace(
        SPH, lens=LENS, mount=mount, imager=replace(SPH.imager, centre_px=(500.0, 520.0))
    )
    for pose in (MirrorPose(), POSE):
        compare(
            differentiable(replace(sensor, mirror_pose=pose)), replace(sensor, mirror_pose=pose)
        )


@pytest.mark.parametrize("pose", [MirrorPose(), POSE], ids=["aligned", "misaligned"])
def test_kernels_and_tensors_have_equal_values_and_gradients(pose, monkeypatch):
    """Compiled kernels on CPUs and tensor operations, as on GPUs, in both precisions."""
    sensor = replace(SPH, mirror_pose=pose)
    results = {}
    for method in ("default", "tensors"):
        if method == "tensors":
            monkeypatch.setattr(_reflection, "has_kernels", lambda like: False)
        for dtype in (torch.float64, torch.float32):
            camera = differentiable(sensor, ("focal", "tilt", "shape"), dtype=dtype)
            for name, inputs in sample_inputs(sensor, 500).items():
                valid = getattr(sensor, name)(inputs).valid
                leaf = torch.from_numpy(inputs[valid][:200]).to(dtype).requires_grad_()
                with torch.no_grad():
                    plain = getattr(camera, name)(leaf)[:-1]
                recorded = getattr(camera, name)(leaf)[:-1]
                sum(part.sum() for part in recorded).backward()
                values = [
                    *plain,
                    *recorded,
                    leaf.grad,
                    *(number.grad for number in camera.parameters.values()),
                ]
                results[method, dtype, name] = [value.detach().double().clone() for value in values]
                for number in camera.parameters.values():
                    number.grad = None
    for (method, dtype, name), values in results.items():
        for ours, theirs in zip(values, results["tensors", dtype, name], strict=True):
            limit = 1e-8 if dtype is torch.float64 else 1e-3
            np.testing.assert_allclose(
                ours,
                theirs,
                rtol=limit,
                atol=limit * float(theirs.abs().max()),
                err_msg=f"{method} {name}",
            )


def others() -> list[Camera]:
    tube = replace(SPH, housing=Housing(shell=Tube()))
    return [
        tube,
        om.load_sensor("folded-spherical"),
        replace(SPH, imager_pose=ImagerPose(tilt_x_deg=1.0)),
        om.Unified(
            xi=0.9, focal_px=(300.0, 300.0), centre_px=(511.5, 511.5), image_size=(1024, 1024)
        ),
    ]


@pytest.mark.parametrize("index", range(4), ids=["tube", "two mirrors", "tilted imager", "unified"])
def test_numerical_cameras_have_gradients(index):
    camera = others()[index]
    torch_camera = differentiable(camera)
    compare(torch_camera, camera, 1e-12)
    for name, inputs in sample_inputs(camera, 30).items():
        valid = getattr(camera, name)(inputs).valid
        leaf = torch.from_numpy(inputs[valid][:8]).requires_grad_()
        assert torch.autograd.gradcheck(
            lambda x, name=name: getattr(torch_camera, name)(x)[:-1], leaf, atol=1e-4
        )


@pytest.mark.parametrize("sensor", PAIRS)
def test_gradients_by_inputs(sensor):
    for pose in (MirrorPose(), POSE):
        posed = replace(sensor, mirror_pose=pose)
        camera = differentiable(posed)
        for name, inputs in sample_inputs(posed, 60).items():
            valid = getattr(posed, name)(inputs).valid
            leaf = torch.from_numpy(inputs[valid][:8]).requires_grad_()
            assert torch.autograd.gradcheck(
                lambda x, name=name, camera=camera: getattr(camera, name)(x)[:-1],
                leaf,
                eps=1e-5,
                atol=1e-5,
                rtol=1e-4,
            )


@pytest.mark.parametrize("kind", sorted(FREE))
def test_gradients_by_every_parameter(kind):
    sensor = replace(sensor_of(kind), mirror_pose=POSE)
    if kind == "sphere":
        sensor = replace(sensor, lens=LENS)
    free = (
        FREE[kind],
        "focal",
        "centre",
        "distortion",
        "distance",
        "decentre",
        "tilt",
        "imager.pixel_pitch_um",
    )
    camera = differentiable(sensor, free)
    assert_gradients_are_differences(camera, sensor)


def test_gradients_by_the_parameters_of_a_telecentric_sensor():
    sensor = replace(sensor_of("paraboloid", "orthographic"), mirror_pose=POSE)
    assert_gradients_are_differences(
        differentiable(sensor, ("shape", "focal", "centre", "decentre", "tilt")), sensor
    )


def assert_gradients_are_differences(camera, sensor) -> None:
    """Compare with central differences of NumPy results."""
    from omnimirror.calibration.sensor_parameters import parameter_location, value_of, with_values

    rng = np.random.default_rng(5)
    for method, inputs in sample_inputs(sensor, 80).items():
        inputs = inputs[getattr(sensor, method)(inputs).valid][:12]
        result = getattr(camera, method)(torch.from_numpy(inputs))
        values = torch.cat(result[:-1], dim=-1)
        weights = rng.normal(size=values.shape)
        names = list(camera.parameters)
        gradients = torch.autograd.grad(
            (values * torch.from_numpy(weights)).sum(),
            list(camera.parameters.values()),
            allow_unused=True,
        )
        for name, gradient in zip(names, gradients, strict=True):
            place = parameter_location(sensor, name)
            value = value_of(sensor, place)
            step = 1e-5 * max(abs(value), 1.0)

            def total(
                at: float, place=place, method=method, inputs=inputs, weights=weights
            ) -> float:
                result = getattr(with_values(sensor, [place], [at]), method)(inputs)
                return float((np.concatenate(result[:-1], axis=-1) * weights).sum())

            difference = (total(value + step) - total(value - step)) / (2 * step)
            scale = np.abs(weights).sum() * 1e-3
            assert float(gradient if gradient is not None else 0.0) == pytest.approx(
                difference, rel=2e-5, abs=scale
            )


def test_grid_sample_equals_the_dewarper(beside):
    image = om.render_image(SPH, om.Room(texel_mm=20.0), samples=1)
    ahead = om.screens.Plane((160, 120), hfov_deg=70.0, tilt_deg=-10.0)
    expected = om.Dewarper(SPH, ahead, "linear")(image)
    tensor = torch.from_numpy(image.copy()).permute(2, 0, 1).double()[None]
    camera = differentiable(SPH)
    view = torch.nn.functional.grid_sample(
        tensor, camera.view_grid(ahead)[None], align_corners=False
    )
    samples = camera.sample(
        tensor, camera.project_directions(torch.from_numpy(ahead_targets(ahead))).pixels[None]
    )
    np.testing.assert_allclose(view, samples, atol=1e-9)
    difference = np.abs(view[0].permute(1, 2, 0).numpy() - expected).max()
    label = "view by grid_sample with view_grid, maximum difference in grey levels"
    beside("PyTorch", label, difference, 1.01, "")


@pytest.mark.parametrize("device", DEVICES)
def test_grid_sample_and_sample_at_the_border_of_the_image(device):
    """Views that reach the border of a cropped image equal the Dewarper at all valid pixels."""
    sensor = replace(
        SPH, imager=replace(SPH.imager, width_px=512, height_px=300, pixel_pitch_um=10.4)
    )
    view = om.screens.Plane((320, 240), tilt_deg=-10.0, hfov_deg=100.0)
    image = np.random.default_rng(0).integers(150, 200, (300, 512), dtype=np.uint8)
    expected = om.Dewarper(sensor, view, "linear")(image).astype(float)
    sources = om.Dewarper(sensor, view).coordinates()
    valid = np.isfinite(sources).all(-1)
    with np.errstate(invalid="ignore"):
        assert ((sources < 0) | (sources > [511, 299])).any(-1).sum() > 50
    tensor = torch.from_numpy(image)[None, None].double().to(device)
    camera = differentiable(sensor, device=device)
    grid = torch.nn.functional.grid_sample(
        tensor, camera.view_grid(view)[None], align_corners=False
    )[0, 0]
    pixels, _ = camera.project_directions(torch.from_numpy(ahead_targets(view)).to(device))
    samples = camera.sample(tensor, pixels[None])[0, 0]
    for result in (grid.cpu().numpy(), samples.cpu().numpy()):
        assert np.abs(result - expected)[valid].max() <= 1.01
    assert (grid.cpu().numpy()[~valid] == 0).all()
    flat = (
        camera.sample(torch.full_like(tensor, 7.0), pixels[None], mode="bicubic")[0, 0]
        .cpu()
        .numpy()
    )
    np.testing.assert_allclose(
        flat[valid], 7.0, atol=1e-9
    )  # border pixels are replicated under the kernel
    outside = torch.tensor(
        [[[-0.51, 10.0], [511.51, 10.0], [3.0, 299.6]]], dtype=torch.float64, device=device
    )
    assert (camera.sample(tensor, outside) == 0).all()


def ahead_targets(screen) -> np.ndarray:
    return screen.targets_at(
        *np.meshgrid(np.arange(screen.size[0], dtype=float), np.arange(float(screen.size[1])))
    )


@pytest.mark.parametrize("device", DEVICES)
def test_parameters_are_estimated_from_projections(device):
    """Estimate focal length and mirror pose from the nominal sensor by L-BFGS."""
    nominal = om.load_sensor("paper-equidistant")  # tilt and decentre of a sphere are not separable
    lens = replace(nominal.lens, focal_length_mm=11.68)
    as_built = replace(nominal, lens=lens, mirror_pose=MirrorPose(0.4, -0.3, 0.0, 0.5, -0.7))
    camera = differentiable(nominal, ("focal", "decentre", "tilt"), device=device)
    points = sample_inputs(nominal, 400)["project"]
    truth = as_built.project(points)
    inside = truth.valid & (np.linalg.norm(truth.pixels - 511.5, axis=1) < 470)
    points, pixels = (torch.from_numpy(rows[inside]).to(device) for rows in (points, truth.pixels))
    search = torch.optim.LBFGS(
        camera.parameters.values(), max_iter=200, line_search_fn="strong_wolfe", history_size=30
    )

    def loss_function():
        search.zero_grad()
        result = camera.project(points)
        loss = ((result.pixels - pixels)[result.valid] ** 2).mean()
        loss.backward()
        return loss

    for _ in range(3):
        search.step(loss_function)
    assert float(loss_function().detach()) < 1e-6
    assert camera.sensor.mirror_pose.tilt_y_deg == pytest.approx(-0.7, abs=2e-3)
    assert camera.sensor.lens.focal_length_mm == pytest.approx(11.68, abs=2e-3)


@pytest.mark.parametrize("device", DEVICES)
def test_invalid_inputs_have_zero_gradients(device):
    camera = differentiable(replace(SPH, lens=LENS), ("shape", "tilt", "distortion"), device=device)
    points = torch.tensor(
        [
            [1e3, 0, 0],
            [0, 0, 500.0],
            [0, 0, 20.0],
            [np.nan, 0, 0],
            [np.inf, 1, 1],
            [0, 0, 1],
            [0, 0, -1e3],
        ],
        dtype=torch.float64,
        device=device,
        requires_grad=True,
    )
    projection = camera.project(points)
    assert projection.valid.tolist() == [True, False, False, False, False, False, True]
    pixels = torch.tensor(
        [[0.0, 0.0], [300.0, 500.0], [np.nan, 1.0], [5e6, 0.0]], dtype=torch.float64, device=device
    )
    rays = camera.backproject(pixels.requires_grad_())
    assert rays.valid.tolist() == [False, True, False, False]
    (projection.pixels.sum() + rays.origins.sum() + rays.directions.sum()).backward()
    for leaf in (points, pixels, *camera.parameters.values()):
        assert torch.isfinite(leaf.grad).all()
    assert not points.grad[1:6].any()


def test_batch_dimensions_in_single_precision():
    camera = differentiable(SPH, dtype=torch.float32)
    points = torch.from_numpy(sample_inputs(SPH)["project"]).float().reshape(4, 50, 10, 3)
    result = camera.project(points)
    assert result.pixels.shape == (4, 50, 10, 2)
    assert result.pixels.dtype == torch.float32
    truth = SPH.project(points.numpy())
    both = result.valid.numpy() & truth.valid
    assert both.sum() > 0.99 * truth.valid.sum()
    np.testing.assert_allclose(result.pixels.numpy()[both], truth.pixels[both], atol=2e-3)
    assert camera.project(points[:0]).pixels.shape == (0, 50, 10, 2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: differentiable(SPH, device="quark"),
            "device must be available to PyTorch.*; got 'quark'",
        ),
        (lambda: differentiable(SPH, device="meta"), "device must be available.*; got 'meta'"),
        (
            lambda: differentiable(SPH, dtype=torch.float16),
            "dtype must be torch.float64 or torch.float32; got torch.float16",
        ),
        (lambda: differentiable(SPH, dtype="float"), "; got 'float'"),
        (
            lambda: differentiable(SPH).project([1.0, 2.0, 3.0]),
            r"points_mm must be a tensor .*; got \[1.0, 2.0, 3.0\]",
        ),
        (
            lambda: differentiable(SPH).project(torch.zeros(4, 2)),
            r"points_mm must be .*; got torch.float32 \(4, 2\)",
        ),
        (
            lambda: differentiable(SPH).project_directions(torch.tensor(1.0)),
            r"directions must be .*; got torch.float32 \(\)",
        ),
        (
            lambda: differentiable(SPH).backproject(torch.zeros(4, 2, dtype=torch.int32)),
            "pixels must be a tensor .*; got torch.int32",
        ),
        (
            lambda: differentiable(others()[1]).project(np.zeros((4, 3))),
            r"must be a tensor \(..., 3\) of torch.float64",
        ),
        (
            lambda: differentiable(SPH).project(torch.zeros(4, 3, device="meta")),
            "must be on the device of the camera, cpu; got meta",
        ),
        (
            lambda: differentiable(SPH).view_grid(3),
            "screen must be a screen of omnimirror.screens; got 3",
        ),
        (
            lambda: differentiable(SPH).grid([3.0, 4.0]),
            r"pixels must be a tensor .*; got \[3.0, 4.0\]",
        ),
        (
            lambda: differentiable(SPH).sample(
                torch.zeros(3, 8, 8, dtype=torch.uint8), torch.zeros(5, 2)
            ),
            "got torch.uint8",
        ),
        (
            lambda: differentiable(SPH).sample(torch.zeros(8), torch.zeros(5, 2)),
            "must have the shapes",
        ),
    ],
)
def test_invalid_arguments_raise(call, message):
    with pytest.raises(InvalidParameter, match=message):
        call()


def test_example_of_the_documentation(capsys):
    page = (Path(__file__).parents[2] / "docs" / "interoperability.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"(?ms)^## PyTorch\n.*?^```python\n(.*?)^```", page)
    exec(compile(code, "interoperability.md", "exec"), {})
    assert "'lens.focal_length_mm'" in capsys.readouterr().out
