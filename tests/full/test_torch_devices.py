"""Differentiable cameras on a graphics card, beside the processor's answers; skipped where PyTorch finds none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter
from omnimirror.interop.torch import differentiable
from omnimirror.mirrors.pose import MirrorPose
from tests.conftest import sensor_of

torch = pytest.importorskip("torch", reason="PyTorch is installed by `make test-full` only")
from tests.full.test_torch import FREE, LENS, PAIRS, POSE, SPH, asked, on_card, others  # noqa: E402

pytestmark = pytest.mark.full

CARD = "cuda"


def compare(sensor, px: float = 1e-6, dtype=torch.float64, share: float = 1.0) -> None:
    """Of a card with NumPy, which knows nothing of PyTorch."""
    camera = differentiable(sensor, dtype=dtype, device=CARD)
    for name, what in asked(sensor).items():
        right, found = getattr(sensor, name)(what), getattr(camera, name)(torch.from_numpy(what).to(CARD, dtype))
        assert all(part.is_cuda for part in found)
        both = found.valid.cpu().numpy() & right.valid
        assert both.sum() >= share * max(right.valid.sum(), found.valid.sum().item()) > 100
        for tensor, array in zip(found[:-1], right[:-1], strict=True):
            np.testing.assert_allclose(tensor.detach().cpu().numpy()[both], array[both], rtol=0, atol=px)
            assert not tensor[~found.valid].any()


@on_card
@pytest.mark.parametrize("sensor", PAIRS)
@pytest.mark.parametrize("pose", [MirrorPose(), POSE], ids=["aligned", "misaligned"])
def test_a_card_finds_what_numpy_traces(sensor, pose):
    compare(replace(sensor, mirror_pose=pose))


@on_card
def test_so_it_does_in_single_precision_and_through_a_lens_that_distorts():
    compare(replace(SPH, mirror_pose=POSE), px=2e-3, dtype=torch.float32, share=0.99)
    compare(replace(SPH, lens=LENS, mirror_pose=POSE))


@on_card
@pytest.mark.parametrize("index", range(4), ids=["tube", "two mirrors", "leaning imager", "unified"])
def test_cameras_that_numpy_traces_answer_where_they_were_asked(index):
    compare(others()[index], 1e-12)


@on_card
@pytest.mark.parametrize("kind", sorted(FREE))
def test_gradients_are_the_processors(kind):
    """By what is asked and by every parameter; the processor's are held to differences by ``test_torch``."""
    sensor = replace(sensor_of(kind), mirror_pose=POSE)
    free = (FREE[kind], "focal", "centre", "distortion", "distance", "decentre", "tilt")
    for name, what in asked(sensor, 400).items():
        there = what[getattr(sensor, name)(what).valid][:150]
        pulled = []
        for device in ("cpu", CARD):
            camera = differentiable(sensor, free, device=device)
            leaf = torch.from_numpy(there).to(device).requires_grad_()
            values = torch.cat(getattr(camera, name)(leaf)[:-1], dim=-1)
            weights = torch.linspace(0.5, 1.5, values.numel(), dtype=torch.float64).reshape(values.shape).to(device)
            (values * weights).sum().backward()
            numbers = [leaf.grad, *(number.grad for number in camera.parameters.values())]
            pulled.append([0.0 if number is None else number.cpu().numpy() for number in numbers])
        for ours, theirs in zip(*pulled, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-8 * max(np.abs(theirs).max(), 1.0))


@on_card
def test_cameras_without_gradients_of_their_own_have_them_on_a_card_too():
    camera, sensor = (differentiable(others()[1], ("focal",), device=device) for device in ("cpu", CARD)), others()[1]
    what = asked(sensor, 60)["project"]
    there = what[sensor.project(what).valid][:8]
    rates = []
    for one in camera:
        leaf = torch.from_numpy(there).to(one.device).requires_grad_()
        one.project(leaf).pixels.sum().backward()
        rates.append([leaf.grad.cpu().numpy(), *(float(number.grad) for number in one.parameters.values())])
    for ours, theirs in zip(*rates, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)


@on_card
def test_a_view_on_a_card_is_the_straightened_picture():
    picture = om.take_picture(SPH, om.Room(texel_mm=20.0), samples=1)
    ahead = om.screens.Plane((160, 120), hfov_deg=70.0, tilt_deg=-10.0)
    tensor = torch.from_numpy(picture.copy()).permute(2, 0, 1).to(CARD, torch.float64)[None]
    camera = differentiable(SPH, device=CARD)
    view = torch.nn.functional.grid_sample(tensor, camera.view_grid(ahead)[None], align_corners=False)
    assert np.abs(view[0].permute(1, 2, 0).cpu().numpy() - om.Dewarper(SPH, ahead, "linear")(picture)).max() <= 1.01


@on_card
def test_what_is_asked_from_elsewhere_is_refused_in_a_sentence():
    points = torch.ones(3, 3, dtype=torch.float64)
    for asks, camera in ((points.to(CARD), differentiable(SPH)), (points, differentiable(SPH, device=CARD))):
        with pytest.raises(InvalidParameter, match=r"both have to be on one device: differentiable\(\.\., device="):
            camera.project(asks)
    with pytest.raises(InvalidParameter, match="'cuda:99' is none that PyTorch can use here"):
        differentiable(SPH, device="cuda:99")
