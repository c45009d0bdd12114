"""Conformance suite for loss terms: tests of the contract of `deux.contracts.LossTerm`.

A plugin's test file subclasses it, and pytest runs the whole suite:

    class TestMyTerm(LossTermSuite):
        def make_term(self) -> LossTerm:
            return MyTerm()

Override `make_extra` as well for a term with an extra (`LossTerm.extras`) that is not a depth map.
"""

from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from deux.contracts import Batch, LossInputs, LossNeed, LossTerm, Prediction, Reconstructions
from deux.errors import kind_of
from deux.geometry.reprojection import reproject
from deux.testing.host_waits import refuse_host_waits

FOCAL_LENGTH = 32.0
PLANE_DEPTH = 2.0
DEPTH_RANGE = (0.1, 10.0)
"""Depth range of the predictions in metres."""

SHIFTS = ((2, 0), (-1, 1))
"""Shift (x, y) of each source image relative to the target, in whole pixels, so that sampling is exact."""


@dataclass
class LossSample:
    """A batch with all inputs and extras of loss terms.

    Args:
        batch: the batch, with ground truth.
        depth: N x 1 x H x W predicted depth in metres.
        target_from_source: N x S x 4 x 4 backward poses.
        extras: further predictions of the model, by name.
    """

    batch: Batch
    depth: Tensor
    target_from_source: Tensor
    extras: dict[str, Tensor] = field(default_factory=dict)


def perfect_sample(batch_size: int = 2, height: int = 24, width: int = 32) -> LossSample:
    """Create a batch of a textured wall at 2 m, seen from three positions, with exact predicted depth."""
    image = _texture((0, 0), height, width).repeat(batch_size, 1, 1, 1)
    sources = torch.stack([_texture(shift, height, width) for shift in SHIFTS]).repeat(batch_size, 1, 1, 1, 1)
    intrinsics = torch.eye(3).repeat(batch_size, 1, 1)
    intrinsics[:, 0, 0] = intrinsics[:, 1, 1] = FOCAL_LENGTH
    intrinsics[:, 0, 2], intrinsics[:, 1, 2] = (width - 1) / 2, (height - 1) / 2
    poses = torch.eye(4).repeat(batch_size, len(SHIFTS), 1, 1)
    poses[:, :, :2, 3] = torch.tensor(SHIFTS) * PLANE_DEPTH / FOCAL_LENGTH
    depth = torch.full((batch_size, 1, height, width), PLANE_DEPTH)
    sparse_depth = torch.zeros_like(depth)
    sparse_depth[..., ::4, ::4] = PLANE_DEPTH
    validity = (sparse_depth > 0).float()
    batch = Batch(image, sources, sparse_depth, validity, sparse_depth.clone(), intrinsics, poses, depth.clone())
    return LossSample(batch, depth, torch.linalg.inv(poses))


def imperfect_sample(batch_size: int = 2, height: int = 24, width: int = 32) -> LossSample:
    """Create a batch of the same wall, whose predicted depth is wavy and too small, with inexact backward poses."""
    sample = perfect_sample(batch_size, height, width)
    rows = torch.arange(height, dtype=torch.float32)[:, None]
    sample.depth = sample.depth - 0.3 + 0.2 * torch.sin(rows + torch.arange(width))
    sample.target_from_source[:, :, 0, 3] += 0.1
    return sample


def evaluate(term: LossTerm, sample: LossSample) -> Tensor:
    """Compute the term with only the inputs that it declares in `needs` and `extras`."""
    batch, reconstructions = sample.batch, None
    if LossNeed.GROUND_TRUTH not in term.needs:
        batch = replace(batch, ground_truth=None)
    if {LossNeed.RECONSTRUCTIONS, LossNeed.BACKWARD_POSES} & term.needs:
        backward = sample.target_from_source if LossNeed.BACKWARD_POSES in term.needs else None
        poses = batch.source_from_target
        assert poses is not None
        images, visible = reproject(batch.sources, sample.depth, batch.intrinsics.float(), poses)
        reconstructions = Reconstructions(images, visible, poses, backward)
    extras = {name: sample.extras[name] for name in term.extras}
    return term(LossInputs(batch, Prediction(sample.depth, extras), reconstructions, DEPTH_RANGE))


class LossTermSuite:
    """Base class of the tests of a loss term. Subclasses define `make_term`.

    Set `perfect_is_zero` to False for a term that is not zero for exact depth and reconstructions, for example one that
    includes pixels which no source frame sees.
    """

    perfect_is_zero: ClassVar[bool] = True

    def make_term(self) -> LossTerm:
        """Create the loss term to test."""
        raise NotImplementedError

    def make_extra(self, name: str, sample: LossSample) -> Tensor:
        """Create an extra that the term declares. Override this for extras that are not depth maps.

        Args:
            name: name of the extra in `LossTerm.extras`.
            sample: batch to which the extra belongs.

        Returns:
            N x C x H x W float32; by default the true depth in metres.
        """
        assert sample.batch.ground_truth is not None
        return sample.batch.ground_truth.clone()

    def test_declares_known_needs(self) -> None:
        """`needs` only contains members of `LossNeed`, and `extras` is a set of names."""
        term = self.make_term()
        assert all(isinstance(need, LossNeed) for need in term.needs), f"not all of {set(term.needs)} are LossNeeds"
        assert not isinstance(term.extras, str), f"extras is the text {term.extras!r}, not a set of names"
        assert all(isinstance(name, str) for name in term.extras), f"not all of {set(term.extras)} are names"

    def test_is_a_finite_float32_scalar(self) -> None:
        """The value is a finite float32 scalar."""
        term = self.make_term()
        _check_value(evaluate(term, self._imperfect(term)))

    def test_is_zero_at_perfection_only(self) -> None:
        """The value is zero for exact depth and positive for wrong depth."""
        if not self.perfect_is_zero:
            pytest.skip("the term declares that it is not zero for exact depth")
        term = self.make_term()
        perfect = self._with_extras(term, perfect_sample())
        assert abs(float(evaluate(term, perfect))) < 1e-4, "not zero for the exact depth"
        assert float(evaluate(term, self._imperfect(term))) > 1e-4, "zero for a wrong depth"

    def test_is_differentiable(self) -> None:
        """The gradients with respect to depth, declared extras and needed poses are finite, and one is not zero."""
        term = self.make_term()
        gradients = _gradients(term, self._imperfect(term))
        assert any(gradient.abs().max() > 0 for gradient in gradients), "no gradient reaches depth, poses or extras"

    def test_frames_without_points(self) -> None:
        """Value and gradients are finite for frames without sparse points."""
        term = self.make_term()
        sample = self._imperfect(term)
        sample.batch.sparse_depth.zero_()
        sample.batch.validity.zero_()
        _check_value(evaluate(term, sample))
        _gradients(term, sample)

    def test_frames_with_nothing_visible(self) -> None:
        """Value and gradients are finite if all points are behind the source cameras."""
        term = self.make_term()
        sample = self._imperfect(term)
        assert sample.batch.source_from_target is not None
        sample.batch.source_from_target[..., 2, 3] = -10.0
        _check_value(evaluate(term, sample))
        _gradients(term, sample)

    def test_is_a_mean_over_the_batch(self) -> None:
        """The value for one sample equals that for a batch of two copies."""
        term = self.make_term()
        alone, doubled = (float(evaluate(term, self._imperfect(term, size))) for size in (1, 2))
        assert alone == pytest.approx(doubled, rel=1e-4), "the value depends on the batch's size"

    def test_leaves_its_inputs_alone(self) -> None:
        """The term does not modify its inputs."""
        term = self.make_term()
        sample = self._imperfect(term)
        before = deepcopy(sample)
        evaluate(term, sample)
        for name in ("depth", "target_from_source"):
            assert torch.equal(getattr(sample, name), getattr(before, name)), f"the term changed {name}"
        for name, extra in sample.extras.items():
            assert torch.equal(extra, before.extras[name]), f"the term changed the extra {name!r}"
        for item in fields(Batch):
            value = getattr(sample.batch, item.name)
            if isinstance(value, Tensor):
                assert torch.equal(value, getattr(before.batch, item.name)), f"the term changed batch.{item.name}"

    def test_rounded_predictions_hardly_change_it(self) -> None:
        """Depth that was rounded to bfloat16, as in mixed precision, changes the value by less than 10 %."""
        term = self.make_term()
        rounded = self._imperfect(term)
        rounded.depth = rounded.depth.bfloat16().float()
        rounded.extras = {name: extra.bfloat16().float() for name, extra in rounded.extras.items()}
        value = evaluate(term, rounded)
        _check_value(value)
        expected = float(evaluate(term, self._imperfect(term)))
        assert float(value) == pytest.approx(expected, rel=0.1), "rounding to bfloat16 changes the value by over 10 %"

    def test_keeps_a_card_busy(self) -> None:
        """Neither the forward nor the backward pass synchronizes with the GPU, except that the first one may."""
        term = self.make_term()
        sample = self._imperfect(term)
        assert sample.batch.source_from_target is not None
        inputs = [sample.depth, sample.batch.source_from_target, sample.target_from_source, *sample.extras.values()]
        for tensor in inputs:
            tensor.requires_grad_()
        evaluate(term, sample)
        with refuse_host_waits():
            evaluate(term, sample).backward()

    def _imperfect(self, term: LossTerm, batch_size: int = 2) -> LossSample:
        return self._with_extras(term, imperfect_sample(batch_size))

    def _with_extras(self, term: LossTerm, sample: LossSample) -> LossSample:
        """Add the extras that the term declares to a batch."""
        return replace(sample, extras={name: self.make_extra(name, sample) for name in sorted(term.extras)})


def _texture(shift: tuple[int, int], height: int, width: int) -> Tensor:
    """Create a 3 x H x W image whose content is shifted by (x, y) whole pixels."""
    x = (torch.arange(width, dtype=torch.float32) - shift[0])[None, :]
    y = (torch.arange(height, dtype=torch.float32) - shift[1])[:, None]
    return torch.stack([0.5 + 0.4 * torch.sin(a * x + b * y) for a, b in ((0.9, 0.4), (0.5, -0.8), (0.3, 1.1))])


def _check_value(value: object) -> None:
    assert isinstance(value, Tensor), f"the value is {kind_of(value)}, not a Tensor"
    assert value.shape == (), f"the value has shape {tuple(value.shape)}, not a scalar's"
    assert value.dtype == torch.float32, f"the value is {value.dtype}, not float32"
    assert bool(torch.isfinite(value)), f"the value is {float(value)}"


def _gradients(term: LossTerm, sample: LossSample) -> list[Tensor]:
    """Gradients of the term with respect to depth, extras and poses, without inputs on which it does not depend.

    Poses are only included if the term needs reconstructions or backward poses; otherwise they are data of the batch.
    """
    assert sample.batch.source_from_target is not None
    inputs = [sample.depth, *sample.extras.values()]
    if {LossNeed.RECONSTRUCTIONS, LossNeed.BACKWARD_POSES} & term.needs:
        inputs += [sample.batch.source_from_target, sample.target_from_source]
    for tensor in inputs:
        tensor.requires_grad_()
    value = evaluate(term, sample)
    assert isinstance(value, Tensor), f"the value is {kind_of(value)}, not a Tensor"
    assert value.requires_grad, "the value does not depend on depth, poses or extras"
    gradients = [g for g in torch.autograd.grad(value, inputs, allow_unused=True) if g is not None]
    assert all(bool(torch.isfinite(gradient).all()) for gradient in gradients), "a gradient is not finite"
    return gradients
