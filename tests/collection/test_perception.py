from contextlib import nullcontext

import numpy as np
import pytest
import torch
from torch import Tensor
from toy_world import CAMERA, GuessingModel, ToySimulator

from deux.collection.perception import SOURCES, Perception, on_host
from deux.collection.sparse import SparseSettings, sample_sparse
from deux.collection.transfers import download
from deux.contracts import COLOR, Frame, Need, Uncertainty, View
from deux.geometry.depth_correction import correct_depth
from deux.geometry.poses import source_from_target
from deux.inference.precision import FastPredictor
from deux.registry import registry
from deux_plugins.uncertainties.photometric import L1Residual


def history(length: int = 3, x: float = 0.0) -> list[Frame]:
    """What a robot saw that walks forward, newest first."""
    simulator, frames = ToySimulator(), []
    for number in range(length):
        simulator.reset(x, 1.0 - 0.25 * number, 0.3)
        frames.append(simulator.observe(COLOR))
    return frames[::-1]


class Noted(Uncertainty):
    """Says that every pixel is off by 0.5 and keeps the views."""

    def __init__(self) -> None:
        self.views: list[View] = []

    def __call__(self, view: View) -> Tensor:
        self.views.append(view)
        return torch.full_like(view.depth[:, 0], 0.5)


def test_the_view_holds_the_frame_and_those_before_it():
    frames = history()
    (percept,) = Perception(GuessingModel(), SparseSettings(0.02))([frames], CAMERA.intrinsics)
    view = percept.view
    np.testing.assert_array_equal(view.image[0].permute(1, 2, 0) * 255.0, frames[0].rgb)
    np.testing.assert_array_equal(view.sources[0, 1].permute(1, 2, 0) * 255.0, frames[2].rgb)
    sparse = sample_sparse(frames[0].rgb, frames[0].depth, SparseSettings(0.02))
    np.testing.assert_array_equal(view.sparse_depth[0, 0], sparse)
    for number in range(SOURCES):
        expected = source_from_target(frames[0].pose, frames[1 + number].pose)
        np.testing.assert_allclose(view.source_from_target[0, number], expected, atol=1e-6)
    np.testing.assert_allclose(view.intrinsics[0], CAMERA.intrinsics)


@pytest.mark.parametrize("corrected", [False, True])
def test_all_robots_are_seen_in_one_call_and_each_as_if_alone(corrected):
    histories = [history(x=x) for x in (-1.0, 0.0, 1.5)]
    model, others = GuessingModel(), {"uncertainty": L1Residual(), "correct_depth": corrected}
    batched = Perception(model, **others)(histories, CAMERA.intrinsics)
    assert model.batch_sizes == [3]
    for one, frames in zip(batched, histories, strict=True):
        (alone,) = Perception(GuessingModel(), **others)([frames], CAMERA.intrinsics)
        torch.testing.assert_close(one.predicted_depth, alone.predicted_depth)
        torch.testing.assert_close(one.residual, alone.residual, equal_nan=True)
        torch.testing.assert_close(one.uncertainty, alone.uncertainty)
        assert one.view.image.shape == (1, 3, CAMERA.height, CAMERA.width)


def test_a_measure_is_asked_from_the_third_frame_on():
    measure = Noted()
    perception = Perception(GuessingModel(), uncertainty=measure)
    for length in (1, 2):
        (percept,) = perception([history(length)], CAMERA.intrinsics)
        assert percept.residual.isnan().all()
        assert percept.uncertainty.isnan()
        assert percept.view.sources.shape[1] == length - 1
    assert measure.views == []
    (percept,) = perception([history(3)], CAMERA.intrinsics)
    assert len(measure.views) == 1
    assert percept.uncertainty.item() == pytest.approx(1.0 - np.exp(-0.5))


def test_without_a_measure_there_is_no_residual():
    (percept,) = Perception(GuessingModel())([history()], CAMERA.intrinsics)
    assert (percept.residual, percept.uncertainty) == (None, None)
    assert percept.predicted_depth.shape == (CAMERA.height, CAMERA.width)


def test_the_depth_that_explorers_get_is_corrected_and_the_judged_one_is_not():
    frames, sparse = history(), SparseSettings(0.02)
    (plain,) = Perception(GuessingModel(), sparse, L1Residual())([frames], CAMERA.intrinsics)
    (percept,) = Perception(GuessingModel(), sparse, L1Residual(), correct_depth=True)([frames], CAMERA.intrinsics)
    (given,) = on_host([percept], {Need.PREDICTED_DEPTH, Need.RESIDUAL})
    spacing = (CAMERA.width * CAMERA.height / np.count_nonzero(plain.view.sparse_depth)) ** 0.5
    expected = correct_depth(plain.view.depth, plain.view.sparse_depth, spacing)
    np.testing.assert_array_equal(given.predicted_depth, expected[0, 0])
    np.testing.assert_array_equal(percept.view.depth, plain.view.depth)
    np.testing.assert_array_equal(percept.residual, plain.residual)
    assert percept.uncertainty == plain.uncertainty
    truth = frames[0].depth
    known = truth > 0  # the guess is one depth for all the frame
    corrected, before = (
        np.abs(given.predicted_depth - truth)[known],
        np.abs(plain.predicted_depth.numpy() - truth)[known],
    )
    assert corrected.mean() < 0.9 * before.mean()


def test_remembered_points_improve_the_depth_that_explorers_get_and_nothing_else():
    frames, sparse = history(), SparseSettings(0.02)
    truth = frames[0].depth
    known, errors = truth > 0, {}
    for remembered in (0, 5):
        perception = Perception(GuessingModel(), sparse, L1Residual(), correct_depth=True, remembered_frames=remembered)
        memory = perception.memory()
        for length in (1, 2):
            perception([frames[-length:]], CAMERA.intrinsics, [memory])
        (percept,) = perception([frames], CAMERA.intrinsics, [memory])
        errors[remembered] = np.abs(percept.predicted_depth.numpy() - truth)[known].mean()
        (alone,) = Perception(GuessingModel(), sparse, L1Residual())([frames], CAMERA.intrinsics)
        np.testing.assert_array_equal(percept.view.sparse_depth, alone.view.sparse_depth)
        np.testing.assert_array_equal(percept.residual, alone.residual)
        assert percept.depth_error == alone.depth_error
    assert errors[5] < 0.9 * errors[0]


@pytest.mark.parametrize(
    "needs", [set(), {Need.PREDICTED_DEPTH}, {Need.RESIDUAL}, {Need.PREDICTED_DEPTH, Need.RESIDUAL}, {Need.LABELS}]
)
def test_the_host_is_given_what_is_needed_in_one_transfer(needs, monkeypatch):
    transfers = []
    monkeypatch.setattr("deux.collection.perception.download", lambda tensors: transfers.append(1) or download(tensors))
    percepts = Perception(GuessingModel(), uncertainty=L1Residual())(
        [history(x=x) for x in (0.0, 1.5)], CAMERA.intrinsics
    )
    given = on_host(percepts, needs)
    assert transfers == [1]
    for percept, one in zip(percepts, given, strict=True):
        assert (one.predicted_depth is None) == (Need.PREDICTED_DEPTH not in needs)
        assert (one.residual is None) == (one.uncertainty is None) == (Need.RESIDUAL not in needs)
        if one.predicted_depth is not None:
            np.testing.assert_array_equal(one.predicted_depth, percept.predicted_depth)
            points = percept.view.sparse_depth[0, 0].numpy()
            errors = np.abs(percept.view.depth[0, 0].numpy() - points)[points > 0] / points[points > 0]
            assert one.depth_error == pytest.approx(np.median(errors), rel=0.1)
        if one.residual is not None:
            np.testing.assert_array_equal(one.residual, percept.residual)
            assert one.uncertainty == percept.uncertainty.item()


def test_without_a_measure_nothing_of_it_is_given():
    percepts = Perception(GuessingModel())([history()], CAMERA.intrinsics)
    (given,) = on_host(percepts, {Need.RESIDUAL})
    assert (given.predicted_depth, given.residual, given.uncertainty) == (None, None, None)


class OnDevice(GuessingModel):
    """A model on a device of which no value can be read, so that whatever leaves it is an error."""

    device = torch.device("meta")

    def __call__(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        assert {image.device, sparse_depth.device, intrinsics.device} == {self.device}
        return super().__call__(image, sparse_depth, intrinsics)


@pytest.mark.parametrize("length", [1, 3])
def test_all_is_computed_on_the_models_device_and_stays_there(length, monkeypatch):
    monkeypatch.setattr(torch, "autocast", lambda *_, **__: nullcontext())  # that device has none
    percepts = Perception(OnDevice(), uncertainty=L1Residual())([history(length)] * 2, CAMERA.intrinsics)
    for percept in percepts:
        tensors = [value for value in vars(percept.view).values() if isinstance(value, Tensor)]
        assert len(tensors) == 8
        assert {t.device for t in (*tensors, percept.residual, percept.uncertainty)} == {OnDevice.device}
        assert percept.residual.shape == percept.predicted_depth.shape == (CAMERA.height, CAMERA.width)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_on_a_gpu_all_stays_there_and_agrees_with_the_cpu():
    percepts = {}
    for accelerator in ("gpu", "cpu"):
        torch.manual_seed(0)
        predictor = FastPredictor(registry().create("depth_models", "kbnet", {}), accelerator)
        predictor.precision = "32-true"
        (percepts[accelerator],) = Perception(predictor, uncertainty=L1Residual())([history()], CAMERA.intrinsics)
    here, there = percepts["cpu"], percepts["gpu"]
    assert {there.predicted_depth.device.type, there.residual.device.type, there.uncertainty.device.type} == {"cuda"}
    assert there.view.rebuilt.device.type == "cuda"
    torch.testing.assert_close(there.predicted_depth.cpu(), here.predicted_depth, rtol=1e-2, atol=1e-2)
    assert there.uncertainty.item() == pytest.approx(here.uncertainty.item(), rel=1e-2)
