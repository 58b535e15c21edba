"""Differentiable cameras beside NumPy's, and their gradients beside differences (PyTorch's own gradcheck)."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.cameras import Camera
from omnimirror.errors import InvalidParameter
from omnimirror.frames import Mount
from omnimirror.housing import Housing, Tube
from omnimirror.imagers import ImagerPose
from omnimirror.interop.torch import differentiable, reflection
from omnimirror.mirrors.pose import MirrorPose
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
on_card = pytest.mark.skipif(not torch.cuda.is_available(), reason="PyTorch finds no graphics card here")
DEVICES = ["cpu", pytest.param("cuda", marks=on_card)]
FREE = {
    "sphere": "shape",
    "hyperboloid": "shape",
    "even-polynomial": "shape",
    "conic-asphere": "shape",
    "cone": "shape",
    "slope-spline": "mirror.slopes[60]",
    "equidistant": "shape",
}


def asked(camera: Camera, count: int = 2000) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(7)
    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1)[:, None]
    width, height = camera.image_size
    return {
        "project": away * rng.uniform(120, 5000, (count, 1)),
        "project_directions": 3 * away,
        "backproject": rng.uniform(-0.5, [width - 0.5, height - 0.5], (count, 2)),
    }


def compare(camera: Camera, ours: Camera, px: float = 1e-6) -> None:
    for name, what in asked(ours).items():
        found, right = getattr(camera, name)(torch.from_numpy(what)), getattr(ours, name)(what)
        np.testing.assert_array_equal(found.valid.numpy(), right.valid)
        assert right.valid.sum() > 100
        for tensor, array in zip(found[:-1], right[:-1], strict=True):
            np.testing.assert_allclose(tensor.detach().numpy()[right.valid], array[right.valid], rtol=0, atol=px)
            assert not tensor[~found.valid].any()


@pytest.mark.parametrize("sensor", PAIRS)
@pytest.mark.parametrize("pose", [MirrorPose(), POSE], ids=["aligned", "misaligned"])
def test_it_is_what_numpy_traces(sensor, pose):
    compare(differentiable(replace(sensor, mirror_pose=pose)), replace(sensor, mirror_pose=pose))


def test_so_it_is_through_a_lens_that_distorts_in_a_sensor_that_leans_and_delivers_flipped_pictures():
    mount = Mount("down", 20.0, image_flipped=True, pitch_deg=4.0)
    sensor = replace(SPH, lens=LENS, mount=mount, imager=replace(SPH.imager, centre_px=(500.0, 520.0)))
    for pose in (MirrorPose(), POSE):
        compare(differentiable(replace(sensor, mirror_pose=pose)), replace(sensor, mirror_pose=pose))


@pytest.mark.parametrize("pose", [MirrorPose(), POSE], ids=["aligned", "misaligned"])
def test_kernels_and_pytorch_alone_give_the_same_values_and_gradients(pose, monkeypatch):
    """Compiled, where that is, and by tensors alone, as on graphics cards; single precision too."""
    sensor = replace(SPH, mirror_pose=pose)
    found = {}
    for way in ("as here", "by tensors"):
        if way == "by tensors":
            monkeypatch.setattr(reflection, "serves", lambda like: False)
        for dtype in (torch.float64, torch.float32):
            camera = differentiable(sensor, ("focal", "tilt", "shape"), dtype=dtype)
            for name, what in asked(sensor, 500).items():
                there = torch.from_numpy(what[getattr(sensor, name)(what).valid][:200]).to(dtype).requires_grad_()
                with torch.no_grad():
                    silent = getattr(camera, name)(there)[:-1]
                recorded = getattr(camera, name)(there)[:-1]
                sum(part.sum() for part in recorded).backward()
                values = [*silent, *recorded, there.grad, *(number.grad for number in camera.parameters.values())]
                found[way, dtype, name] = [value.detach().double().clone() for value in values]
                for number in camera.parameters.values():
                    number.grad = None
    for (way, dtype, name), values in found.items():
        for ours, theirs in zip(values, found["by tensors", dtype, name], strict=True):
            limit = 1e-8 if dtype is torch.float64 else 1e-3
            np.testing.assert_allclose(
                ours, theirs, rtol=limit, atol=limit * float(theirs.abs().max()), err_msg=f"{way} {name}"
            )


def others() -> list[Camera]:
    tube = replace(SPH, housing=Housing(shell=Tube()))
    return [
        tube,
        om.load_sensor("folded-spherical"),
        replace(SPH, imager_pose=ImagerPose(tilt_x_deg=1.0)),
        om.Unified(0.9, (300.0, 300.0), (511.5, 511.5), (1024, 1024)),
    ]


@pytest.mark.parametrize("index", range(4), ids=["tube", "two mirrors", "leaning imager", "unified"])
def test_every_other_camera_has_gradients_too(index):
    camera = others()[index]
    torch_camera = differentiable(camera)
    compare(torch_camera, camera, 1e-12)
    for name, what in asked(camera, 30).items():
        valid = getattr(camera, name)(what).valid
        some = torch.from_numpy(what[valid][:8]).requires_grad_()
        assert torch.autograd.gradcheck(lambda x, name=name: getattr(torch_camera, name)(x)[:-1], some, atol=1e-4)


@pytest.mark.parametrize("sensor", PAIRS)
def test_gradients_by_what_is_asked(sensor):
    for pose in (MirrorPose(), POSE):
        posed = replace(sensor, mirror_pose=pose)
        camera = differentiable(posed)
        for name, what in asked(posed, 60).items():
            valid = getattr(posed, name)(what).valid
            some = torch.from_numpy(what[valid][:8]).requires_grad_()
            assert torch.autograd.gradcheck(
                lambda x, name=name, camera=camera: getattr(camera, name)(x)[:-1], some, eps=1e-5, atol=1e-5, rtol=1e-4
            )


@pytest.mark.parametrize("kind", sorted(FREE))
def test_gradients_by_every_parameter(kind):
    sensor = replace(sensor_of(kind), mirror_pose=POSE)
    if kind == "sphere":
        sensor = replace(sensor, lens=LENS)
    free = (FREE[kind], "focal", "centre", "distortion", "distance", "decentre", "tilt", "imager.pixel_pitch_um")
    camera = differentiable(sensor, free)
    assert_gradients_are_differences(camera, sensor)


def test_gradients_by_the_parameters_of_a_telecentric_sensor():
    sensor = replace(sensor_of("paraboloid", "orthographic"), mirror_pose=POSE)
    assert_gradients_are_differences(differentiable(sensor, ("shape", "focal", "centre", "decentre", "tilt")), sensor)


def assert_gradients_are_differences(camera, sensor) -> None:
    """Of NumPy's answers, which know nothing of gradients."""
    from omnimirror.calibrate.physical.names import changed, place_of, value_of

    rng = np.random.default_rng(5)
    for method, what in asked(sensor, 80).items():
        what = what[getattr(sensor, method)(what).valid][:12]
        answer = getattr(camera, method)(torch.from_numpy(what))
        values = torch.cat(answer[:-1], dim=-1)
        weights = rng.normal(size=values.shape)
        names = list(camera.parameters)
        pulled = torch.autograd.grad(
            (values * torch.from_numpy(weights)).sum(), list(camera.parameters.values()), allow_unused=True
        )
        for name, gradient in zip(names, pulled, strict=True):
            place = place_of(sensor, name)
            value = value_of(sensor, place)
            step = 1e-5 * max(abs(value), 1.0)

            def total(at: float, place=place, method=method, what=what, weights=weights) -> float:
                found = getattr(changed(sensor, [place], [at]), method)(what)
                return float((np.concatenate(found[:-1], axis=-1) * weights).sum())

            difference = (total(value + step) - total(value - step)) / (2 * step)
            scale = np.abs(weights).sum() * 1e-3
            assert float(gradient if gradient is not None else 0.0) == pytest.approx(difference, rel=2e-5, abs=scale)


def test_a_view_by_grid_sample_is_the_straightened_picture():
    picture = om.take_picture(SPH, om.Room(texel_mm=20.0), samples=1)
    ahead = om.screens.Plane((160, 120), hfov_deg=70.0, tilt_deg=-10.0)
    ours = om.Dewarper(SPH, ahead, "linear")(picture)
    tensor = torch.from_numpy(picture.copy()).permute(2, 0, 1).double()[None]
    camera = differentiable(SPH)
    view = torch.nn.functional.grid_sample(tensor, camera.view_grid(ahead)[None], align_corners=False)
    again = camera.sample(tensor, camera.project_directions(torch.from_numpy(ahead_targets(ahead))).pixels[None])
    np.testing.assert_allclose(view, again, atol=1e-9)
    assert np.abs(view[0].permute(1, 2, 0).numpy() - ours).max() <= 1.01


def ahead_targets(screen) -> np.ndarray:
    return screen.targets_at(*np.meshgrid(np.arange(screen.size[0], dtype=float), np.arange(float(screen.size[1]))))


@pytest.mark.parametrize("device", DEVICES)
def test_a_sensor_is_learned_from_where_points_appear(device):
    """As a network would: by steps along gradients, from a wrong sensor to the one that took the pictures."""
    drawn = om.load_sensor("paper-equidistant")  # a tilted ball would be one that is decentred
    lens = replace(drawn.lens, focal_length_mm=11.68)
    built = replace(drawn, lens=lens, mirror_pose=MirrorPose(0.4, -0.3, 0.0, 0.5, -0.7))
    camera = differentiable(drawn, ("focal", "decentre", "tilt"), device=device)
    points = asked(drawn, 400)["project"]
    truth = built.project(points)
    inside = truth.valid & (np.linalg.norm(truth.pixels - 511.5, axis=1) < 470)
    points, pixels = (torch.from_numpy(rows[inside]).to(device) for rows in (points, truth.pixels))
    search = torch.optim.LBFGS(camera.parameters.values(), max_iter=200, line_search_fn="strong_wolfe", history_size=30)

    def missed():
        search.zero_grad()
        found = camera.project(points)
        loss = ((found.pixels - pixels)[found.valid] ** 2).mean()
        loss.backward()
        return loss

    for _ in range(3):
        search.step(missed)
    assert float(missed().detach()) < 1e-6
    assert camera.sensor.mirror_pose.tilt_y_deg == pytest.approx(-0.7, abs=2e-3)
    assert camera.sensor.lens.focal_length_mm == pytest.approx(11.68, abs=2e-3)


@pytest.mark.parametrize("device", DEVICES)
def test_what_is_out_of_view_does_not_spoil_gradients(device):
    camera = differentiable(replace(SPH, lens=LENS), ("shape", "tilt", "distortion"), device=device)
    points = torch.tensor(
        [[1e3, 0, 0], [0, 0, 500.0], [0, 0, 20.0], [np.nan, 0, 0], [np.inf, 1, 1], [0, 0, 1], [0, 0, -1e3]],
        dtype=torch.float64,
        device=device,
        requires_grad=True,
    )
    found = camera.project(points)
    assert found.valid.tolist() == [True, False, False, False, False, False, True]
    pixels = torch.tensor([[0.0, 0.0], [300.0, 500.0], [np.nan, 1.0], [5e6, 0.0]], dtype=torch.float64, device=device)
    rays = camera.backproject(pixels.requires_grad_())
    assert rays.valid.tolist() == [False, True, False, False]
    (found.pixels.sum() + rays.origins.sum() + rays.directions.sum()).backward()
    for leaf in (points, pixels, *camera.parameters.values()):
        assert torch.isfinite(leaf.grad).all()
    assert not points.grad[1:6].any()


def test_batches_keep_their_shape_and_small_numbers_are_enough_for_learning():
    camera = differentiable(SPH, dtype=torch.float32)
    points = torch.from_numpy(asked(SPH)["project"]).float().reshape(4, 50, 10, 3)
    found = camera.project(points)
    assert found.pixels.shape == (4, 50, 10, 2)
    assert found.pixels.dtype == torch.float32
    right = SPH.project(points.numpy())
    both = found.valid.numpy() & right.valid
    assert both.sum() > 0.99 * right.valid.sum()
    np.testing.assert_allclose(found.pixels.numpy()[both], right.pixels[both], atol=2e-3)
    assert camera.project(points[:0]).pixels.shape == (0, 50, 10, 2)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda: differentiable(SPH, device="quark"), "device = 'quark' is none that PyTorch can use here"),
        (lambda: differentiable(SPH, device="meta"), "device = 'meta' is none"),
        (lambda: differentiable(SPH, dtype=torch.float16), "dtype = torch.float16; valid are torch.float64 and"),
        (lambda: differentiable(SPH, dtype="float"), "dtype = 'float'; valid are"),
        (lambda: differentiable(SPH).project([1.0, 2.0, 3.0]), r"points_mm = \[1.0, 2.0, 3.0\]; valid is a tensor"),
        (lambda: differentiable(SPH).project(torch.zeros(4, 2)), r"points_mm = torch.float32 \(4, 2\); valid is a"),
        (lambda: differentiable(SPH).project_directions(torch.tensor(1.0)), r"directions = torch.float32 \(\); valid"),
        (lambda: differentiable(SPH).backproject(torch.zeros(4, 2, dtype=torch.int32)), "pixels = torch.int32"),
        (
            lambda: differentiable(others()[1]).project(np.zeros((4, 3))),
            r"valid is a tensor \(.., 3\) of torch.float64",
        ),
        (lambda: differentiable(SPH).project(torch.zeros(4, 3, device="meta")), "on meta and the camera is on cpu"),
        (lambda: differentiable(SPH).view_grid(3), "screen = 3 is not a screen"),
        (lambda: differentiable(SPH).grid([3.0, 4.0]), r"pixels = \[3.0, 4.0\]; valid"),
        (lambda: differentiable(SPH).sample(torch.zeros(3, 8, 8, dtype=torch.uint8), torch.zeros(5, 2)), "torch.uint8"),
        (lambda: differentiable(SPH).sample(torch.zeros(8), torch.zeros(5, 2)), "do not belong together"),
    ],
)
def test_what_is_no_argument_is_refused_in_a_sentence(wrong, sentence):
    with pytest.raises(InvalidParameter, match=sentence):
        wrong()


def test_the_recipe_of_the_docs_runs(capsys):
    page = (Path(__file__).parents[2] / "docs" / "interoperability.md").read_text(encoding="utf-8")
    (recipe,) = re.findall(r"(?ms)^## PyTorch\n.*?^```\n(.*?)^```", page)
    exec(compile(recipe, "interoperability.md", "exec"), {})
    assert "'lens.focal_length_mm'" in capsys.readouterr().out
