"""Conformance suite for depth models: tests of the contract of `deux.contracts.DepthModel`.

A plugin's test file subclasses it, and pytest runs the whole suite:

    class TestMyModel(DepthModelSuite):
        def make_model(self) -> DepthModel:
            return MyModel()
"""

import copy
import inspect
from abc import abstractmethod
from typing import ClassVar

import numpy as np
import pytest
import torch
from torch import Tensor

from deux.contracts import Batch, DepthModel, Prediction
from deux.errors import DeuxError, kind_of
from deux.geometry.sparse_outliers import remove_outliers
from deux.testing.host_waits import refuse_host_waits
from deux.training.objective import make_objective

NEAREST, FARTHEST = 1.0, 5.0
"""Range of the sparse points of `camera_data` in metres."""

INPUTS = ["image", "sparse_depth", "validity", "intrinsics"]
RANGE_SLACK = 0.05
"""Relative tolerance for predictions outside of the declared range; the published formula exceeds it by 1 %."""


def camera_data(size: tuple[int, int], count: int = 2, points: float = 0.05, seed: int = 0) -> dict[str, Tensor]:
    """Synthetic inputs of `DepthModel.predict`: random images and points from `NEAREST` to `FARTHEST`, a camera of 90°.

    Args:
        size: height and width in pixels.
        count: number of samples.
        points: fraction of the pixels that have a sparse point.
        seed: seed of the random numbers.
    """
    generator = torch.Generator().manual_seed(seed)
    height, width = size
    depth = NEAREST + (FARTHEST - NEAREST) * torch.rand(count, 1, height, width, generator=generator)
    has_point = torch.rand(depth.shape, generator=generator) < points
    f = width / 2
    intrinsics = torch.tensor([[f, 0.0, (width - 1) / 2], [0.0, f, (height - 1) / 2], [0.0, 0.0, 1.0]])
    return {
        "image": torch.rand(count, 3, height, width, generator=generator),
        "sparse_depth": torch.where(has_point, depth, 0.0),
        "intrinsics": intrinsics.repeat(count, 1, 1),
    }


def network_inputs(model: DepthModel, data: dict[str, Tensor]) -> dict[str, Tensor]:
    """Create the inputs of the model in training: data, validity of the points and prepared inputs."""
    samples = [model.prepare(depth) for depth in data["sparse_depth"][:, 0].numpy()]
    prepared = {name: torch.from_numpy(np.stack([s[name] for s in samples])) for name in samples[0]}
    return {**data, "validity": remove_outliers(data["sparse_depth"]), **prepared}


def run(model: DepthModel, data: dict[str, Tensor]) -> Prediction:
    """Call the model with the inputs that it gets in training."""
    prediction = model(**network_inputs(model, data))
    assert isinstance(prediction, Prediction), f"`forward` gives {kind_of(prediction)}, not a Prediction"
    return prediction


class DepthModelSuite:
    """Base class of the tests of a depth model. Subclasses define `make_model`, which each test calls."""

    size: ClassVar[tuple[int, int]] = (64, 96)
    """Height and width of the images that most tests use, multiples of the model's `size_multiple`."""

    odd_size: ClassVar[tuple[int, int]] = (49, 83)
    """An image size that is not a multiple of any network stride."""

    @abstractmethod
    def make_model(self) -> DepthModel:
        """Create the model to test, small enough for fast tests."""

    @pytest.fixture
    def model(self) -> DepthModel:
        """The model in eval mode, with the same random weights in every test."""
        torch.manual_seed(0)
        return self.make_model().eval()

    def check_depth(self, model: DepthModel, depth: Tensor, size: tuple[int, int], count: int = 2) -> None:
        """Assert that `depth` is a valid prediction."""
        depth = depth.detach()
        assert depth.shape == (count, 1, *size), f"the depth is {kind_of(depth)}, not N x 1 x H x W"
        assert depth.dtype == torch.float32, f"the depth is {kind_of(depth)}, not float32"
        assert torch.isfinite(depth).all(), "the depth is NaN or infinite in some pixels"
        ends = f"the depth goes from {float(depth.min()):g} to {float(depth.max()):g} m, outside of the declared range"
        assert depth.min() >= model.min_depth * (1 - RANGE_SLACK), f"{ends}: min_depth is {model.min_depth:g}"
        assert depth.max() <= model.max_depth * (1 + RANGE_SLACK), f"{ends}: max_depth is {model.max_depth:g}"

    def test_range_is_declared(self, model: DepthModel) -> None:
        """The model declares its depth range in metres, which includes some depth of `camera_data`."""
        assert 0 < model.min_depth < model.max_depth
        ends = f"min_depth = {model.min_depth:g} to max_depth = {model.max_depth:g}"
        assert model.min_depth < FARTHEST, f"{ends} leaves out all points of a room: the range is in metres"
        assert model.max_depth > NEAREST, f"{ends} leaves out all points of a room: the range is in metres"

    def test_forward_takes_no_ground_truth(self, model: DepthModel) -> None:
        """`forward` only takes the inputs of the contract and those that `prepare` returns."""
        parameters = inspect.signature(model.forward).parameters.values()
        named = [p.name for p in parameters if p.kind is not inspect.Parameter.VAR_KEYWORD]
        prepared = model.prepare(np.ones(self.size, np.float32))
        assert named[: len(INPUTS)] == INPUTS, f"`forward` takes {named}: the first parameters are {INPUTS}"
        further = set(named) - {*INPUTS, *prepared}
        assert not further, f"`forward` takes {sorted(further)}, which `prepare` does not return"

    def test_predicts_depth_within_the_range(self, model: DepthModel) -> None:
        """Depth is finite, float32, of the image's size and within the declared range."""
        self.check_depth(model, run(model, camera_data(self.size)).depth, self.size)

    def test_predicts_without_a_single_point(self, model: DepthModel) -> None:
        """A frame without sparse points has a valid prediction."""
        depth = model.predict(**camera_data(self.size, points=0.0))
        self.check_depth(model, depth, self.size)

    def test_predict_takes_any_size_and_keeps_the_mode(self, model: DepthModel) -> None:
        """`predict` pads its inputs, tracks no gradient, and does not change the training mode of any module."""
        model.train()
        frozen = next(iter(model.children()), model).eval()
        modes = [module.training for module in model.modules()]
        depth = model.predict(**camera_data(self.odd_size))
        self.check_depth(model, depth, self.odd_size)
        assert not depth.requires_grad
        assert not frozen.training
        assert [module.training for module in model.modules()] == modes

    def test_predict_agrees_with_forward(self, model: DepthModel) -> None:
        """`predict` returns the depth of `forward` for the same inputs."""
        data = camera_data(self.size)
        torch.testing.assert_close(model.predict(**data), run(model, data).depth.detach())

    def test_predict_refuses_a_singular_camera(self, model: DepthModel) -> None:
        """Singular intrinsics raise DeuxError."""
        data = camera_data(self.size)
        data["intrinsics"][1, 0, 0] = 0.0
        with pytest.raises(DeuxError, match=r"intrinsics\[1\].*singular"):
            model.predict(**data)

    def test_same_inputs_give_the_same_depth(self, model: DepthModel) -> None:
        """Predictions in eval mode are deterministic and do not depend on the frames that were predicted before."""
        data = camera_data(self.size)
        first, second = (model.predict(**data) for _ in range(2))
        assert torch.equal(first, second), "the same inputs gave another depth: predictions are not deterministic"
        model.predict(**camera_data(self.size, seed=1))
        assert torch.equal(model.predict(**data), first), (
            "after another frame, the same inputs gave another depth: a model keeps nothing from one call to the next"
        )

    def test_samples_do_not_influence_each_other(self, model: DepthModel) -> None:
        """The prediction does not depend on the other samples of the batch."""
        data = camera_data(self.size, count=3)
        alone = torch.cat([model.predict(**{k: v[i : i + 1] for k, v in data.items()}) for i in range(3)])
        torch.testing.assert_close(model.predict(**data), alone, rtol=1e-4, atol=1e-4)

    def test_inputs_are_left_as_they_were(self, model: DepthModel) -> None:
        """`forward` does not modify its inputs, which the losses use as well."""
        inputs = network_inputs(model, camera_data(self.size))
        before = copy.deepcopy(inputs)
        model.train()
        model(**inputs)
        changed = [name for name in inputs if not torch.equal(inputs[name], before[name])]
        assert not changed, f"`forward` changed its inputs: {', '.join(changed)}"

    def test_all_its_tensors_move_to_a_device(self, model: DepthModel) -> None:
        """All tensors that modules keep are parameters or buffers: `model.to(device)` leaves others on the CPU."""
        left = [
            f"{place}.{name}".lstrip(".")
            for place, module in model.named_modules()
            for name, value in vars(module).items()
            if isinstance(value, Tensor)
        ]
        assert not left, f"{', '.join(left)}: model.to(device) would not move these tensors, so use register_buffer"

    def test_its_objective_can_be_computed(self, model: DepthModel) -> None:
        """All loss terms of `objective` are installed and accept their options, and the loss is finite."""
        if not model.objective:
            pytest.skip("the model declares no objective")
        data = camera_data(self.size)
        inputs = network_inputs(model, data)
        image, points, validity = data["image"], data["sparse_depth"], inputs["validity"]
        sources = torch.stack([image, image], dim=1)
        poses = torch.eye(4).repeat(len(image), 2, 1, 1)
        truth = torch.full_like(points, 0.5 * (NEAREST + FARTHEST))
        batch = Batch(image, sources, points, validity, points, data["intrinsics"], poses, truth)
        losses = make_objective(model)(batch, run(model, data))
        not_finite = [name for name, value in losses.terms.items() if not torch.isfinite(value)]
        assert not not_finite, f"not finite: {', '.join(not_finite)}"

    def test_every_trainable_parameter_gets_a_gradient(self, model: DepthModel) -> None:
        """Every parameter with `requires_grad` gets a gradient that is not zero, and all gradients are finite.

        Parameters of published checkpoints that the network does not use must have `requires_grad=False`.
        """
        model.train()
        depth = run(model, camera_data(self.size)).depth
        (depth.log() * torch.rand_like(depth)).sum().backward()
        without = [
            name
            for name, parameter in model.named_parameters()
            if parameter.requires_grad and (parameter.grad is None or not parameter.grad.any())
        ]
        assert without == [], f"no gradient reaches {', '.join(without)}: train them, or set requires_grad=False"
        infinite = [n for n, p in model.named_parameters() if p.grad is not None and not torch.isfinite(p.grad).all()]
        assert infinite == [], f"the gradient is not finite for {', '.join(infinite)}"

    def test_trains_under_bfloat16_autocast(self, model: DepthModel) -> None:
        """Under autocast, depth is float32 and close to that of full precision, and gradients can be computed."""
        data = camera_data(self.size)
        expected = run(model, data).depth.detach()
        with torch.autocast("cpu", dtype=torch.bfloat16):
            prediction = run(model, data)
        self.check_depth(model, prediction.depth, self.size)
        assert ((prediction.depth - expected).abs() / expected).mean() < 0.05
        prediction.depth.mean().backward()

    def test_keeps_a_card_busy(self, model: DepthModel) -> None:
        """Neither the forward nor the backward pass synchronizes with the GPU, except that the first one may."""
        model.train()
        inputs, pose_network = network_inputs(model, camera_data(self.size)), model.pose_network()
        model(**inputs)
        with refuse_host_waits():
            value = model(**inputs).depth.mean()
            if pose_network is not None:
                value = value + pose_network(inputs["image"], inputs["image"].flip(3)).mean()
            value.backward()

    def test_channels_last_gives_the_same_depth(self, model: DepthModel) -> None:
        """The channels-last memory format does not change the result."""
        data = camera_data(self.size)
        expected = model.predict(**data)
        data["image"] = data["image"].contiguous(memory_format=torch.channels_last)
        depth = model.to(memory_format=torch.channels_last).predict(**data)
        torch.testing.assert_close(depth, expected, rtol=1e-4, atol=1e-4)

    def test_state_fills_another_model(self, model: DepthModel) -> None:
        """The state dictionary determines the model completely."""
        torch.manual_seed(1)
        other = self.make_model().eval()
        data = camera_data(self.size)
        different = not torch.equal(other.predict(**data), model.predict(**data))
        assert different, "models with different random weights predict the same depth: it does not depend on them"
        other.load_state_dict(model.state_dict())
        same = torch.equal(other.predict(**data), model.predict(**data))
        assert same, "with the same state dictionary, another model predicts another depth: it lacks some of the state"

    def test_published_modules_cover_the_model(self, model: DepthModel) -> None:
        """`published_modules` is empty or contains all parameters of the model."""
        published = [p for module in model.published_modules().values() for p in module.parameters()]
        assert not published or set(published) == set(model.parameters())

    def test_pose_network_predicts_rigid_motions(self, model: DepthModel) -> None:
        """The pose network, if there is one, returns N x 4 x 4 rigid transforms."""
        network = model.pose_network()
        if network is None:
            pytest.skip("the model has no pose network")
        data = camera_data(self.size)
        pose = network(data["image"], data["image"].flip(3))
        assert pose.shape == (2, 4, 4)
        rotation = pose[:, :3, :3]
        identity = torch.eye(3).expand(2, 3, 3)
        torch.testing.assert_close(rotation @ rotation.transpose(1, 2), identity, rtol=0.0, atol=1e-5)
        torch.testing.assert_close(pose[:, 3], torch.tensor([[0.0, 0.0, 0.0, 1.0]]).expand(2, 4))
