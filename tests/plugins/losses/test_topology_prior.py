from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from scipy.ndimage import map_coordinates
from torch import Tensor

from deux.contracts import Batch, LossInputs, LossTerm, Prediction, Reconstructions
from deux.errors import DeuxError
from deux.testing.losses import DEPTH_RANGE, LossTermSuite, evaluate, perfect_sample
from deux_plugins.losses.topology_prior import TopologyPrior

Inputs = tuple[Batch, Prediction, Reconstructions]


def value_of(term: LossTerm, inputs: Inputs) -> Tensor:
    return term(LossInputs(*inputs, DEPTH_RANGE))


class TestTopologyPrior(LossTermSuite):
    def make_term(self) -> LossTerm:
        return TopologyPrior()


class TestFusionNetConvention(LossTermSuite):
    def make_term(self) -> LossTerm:
        return TopologyPrior(pixels="all")


def rebuilt_by_hand(source: np.ndarray, depth: np.ndarray, intrinsics: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """A 3 x H x W source image, read where the target's pixels project into it."""
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]].reshape(2, -1)
    points = depth.ravel() * (np.linalg.inv(intrinsics) @ np.stack([columns, rows, np.ones_like(rows)]))
    x, y, z = intrinsics @ (pose[:3, :3] @ points + pose[:3, 3:])
    read = [map_coordinates(channel, [y / z, x / z], order=1, mode="nearest") for channel in source]
    return np.stack(read).reshape(source.shape)


@pytest.fixture
def by_hand(published_case) -> tuple[np.ndarray, np.ndarray]:
    """The published case's maps w and its |d - prior|, each N x H x W, without any code of ours."""
    inputs, _ = published_case("fusionnet")
    batch, prediction, reconstructions = inputs.batch, inputs.prediction, inputs.reconstructions
    arrays = (
        batch.image,
        batch.sources[:, 0],
        batch.intrinsics,
        batch.source_from_target[:, 0],
        reconstructions.images[:, 0],
        prediction.depth[:, 0],
        prediction.extras["prior"][:, 0],
    )
    maps, differences = [], []
    for image, source, intrinsics, pose, rebuilt, depth, prior in zip(
        *(a.double().numpy() for a in arrays), strict=True
    ):
        prior_error = np.abs(image - rebuilt_by_hand(source, prior, intrinsics, pose)).sum(axis=0)
        maps.append(prior_error <= np.abs(image - rebuilt).sum(axis=0))
        differences.append(np.abs(depth - prior))
    return np.stack(maps).astype(float), np.stack(differences)


def one_by_one(inputs: Inputs) -> list[Inputs]:
    """The samples of a batch as batches of one."""
    batch, prediction, reconstructions = inputs
    return [
        (
            _slice(batch, n),
            Prediction(prediction.depth[n : n + 1], {"prior": prediction.extras["prior"][n : n + 1]}),
            _slice(reconstructions, n),
        )
        for n in range(len(batch.image))
    ]


def _slice(whole, n: int):
    return replace(whole, **{name: tensor[n : n + 1] for name, tensor in _tensors(whole).items()})


def _joined(samples):
    parts = [_tensors(sample) for sample in samples]
    return replace(samples[0], **{name: torch.cat([part[name] for part in parts]) for name in parts[0]})


def _tensors(whole) -> dict[str, Tensor]:
    values = {item.name: getattr(whole, item.name) for item in fields(whole)}
    return {name: value for name, value in values.items() if isinstance(value, Tensor)}


def test_the_published_value_by_hand(published_case, by_hand):
    """The published code weights each sample of its batch with the maps of both: by hand, that gives its value."""
    maps, differences = by_hand
    losses = published_case("fusionnet")[1]
    broadcast = [(maps * difference).sum() / maps.sum() for difference in differences]
    assert np.mean(broadcast) == pytest.approx(losses["prior_depth"], rel=1e-4)


def test_each_frame_has_its_own_map(published_case, by_hand):
    """What the published code gives for batches of one, whatever the size of ours."""
    published, losses = published_case("fusionnet")
    inputs = published.batch, published.prediction, published.reconstructions
    term = TopologyPrior(pixels="all")
    expected = [(w * difference).sum() / w.sum() for w, difference in zip(*by_hand, strict=True)]
    values = [float(value_of(term, alone)) for alone in one_by_one(inputs)]
    assert values == pytest.approx(expected, rel=1e-4)
    together = float(value_of(term, inputs))
    assert together == pytest.approx(np.mean(expected), rel=1e-4)
    assert together != pytest.approx(losses["prior_depth"], rel=1e-4)


def stripes() -> Inputs:
    """A frame in four stripes, whose depth and prior differ by 0.5, 1, 2 and 4 m.

    The prior rebuilds all of it with the error 0.03, the prediction the third stripe with 0.015 and the others with
    0.06. The source frames are of one colour each, so that it does not matter where they are read.
    """
    batch = perfect_sample(1).batch
    batch.image = torch.full_like(batch.image, 0.5)
    batch.sources = torch.full_like(batch.sources, 0.51)
    batch.sources[:, 1] = 0.9  # has no part in the term
    images = torch.full_like(batch.sources, 0.52)
    images[..., 16:24] = 0.505
    depth = torch.full_like(batch.sparse_depth, 5.0)
    difference = torch.tensor([0.5, 1.0, 2.0, 4.0]).repeat_interleave(8)
    visible = torch.ones_like(images[:, :, :1], dtype=torch.bool)
    poses = torch.eye(4).repeat(1, 2, 1, 1)
    return batch, Prediction(depth, {"prior": depth - difference}), Reconstructions(images, visible, poses)


def test_the_prior_counts_where_it_explains_the_first_source_frame_as_well():
    assert float(value_of(TopologyPrior(), stripes())) == pytest.approx((0.5 + 1.0 + 4.0) / 3)


def test_the_prior_counts_where_it_explains_the_frame_no_worse():
    """Without motion every depth rebuilds the same frame; to the last bit, if one is twice the other."""
    sample = perfect_sample()
    sample.batch.source_from_target[:] = torch.eye(4)
    sample.extras = {"prior": sample.batch.ground_truth}
    sample.depth = 2 * sample.batch.ground_truth
    assert float(evaluate(TopologyPrior(threshold=3.0), sample)) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, 1.0),
        ({"threshold": 0.038}, 1.0),
        ({"threshold": 0.037}, 0.0),
        ({"pixels": "all"}, 0.0),
        ({"pixels": "all", "threshold": 0.35}, (0.5 + 1.0 + 5.0) / 3),
    ],
)
def test_which_pixels_count(options, expected):
    """The first stripe is out of view with the predicted depth, and badly rebuilt; the last one has no prior."""
    batch, prediction, reconstructions = stripes()
    reconstructions.visible[:, 0, ..., :8] = False
    reconstructions.images[:, 0, ..., :8] = 0.92
    prediction.extras["prior"][..., 24:] = 0.0
    value = value_of(TopologyPrior(**options), (batch, prediction, reconstructions))
    assert float(value) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("pixels", ["visible", "all"])
def test_an_empty_map_costs_nothing(pixels):
    """NaN in the published code."""
    batch, prediction, reconstructions = stripes()
    batch.sources[:, 0] = 0.6
    prediction.depth.requires_grad_()
    value = value_of(TopologyPrior(pixels=pixels), (batch, prediction, reconstructions))
    assert value.item() == 0.0
    assert not torch.autograd.grad(value, prediction.depth)[0].any()


@pytest.mark.parametrize("pixels", ["visible", "all"])
def test_no_frame_depends_on_its_neighbours(pixels):
    """An ordinary frame, one that is above the threshold, one with an empty map, and one of another map."""
    plain, wrong, empty, other = (stripes() for _ in range(4))
    wrong[2].images[:, 0] = 0.9
    empty[0].sources[:, 0] = 0.6
    other[2].images[:, 0, ..., :8] = 0.505
    samples = [plain, wrong, empty, other]
    batches, predictions, reconstructions = zip(*samples, strict=True)
    together = (
        _joined(batches),
        Prediction(
            torch.cat([p.depth for p in predictions]), {"prior": torch.cat([p.extras["prior"] for p in predictions])}
        ),
        _joined(reconstructions),
    )
    term = TopologyPrior(pixels=pixels)
    values = [float(value_of(term, sample)) for sample in samples]
    assert values == pytest.approx([5.5 / 3, 0.0, 0.0, 5.0 / 2])
    assert [float(value_of(term, sample)) for sample in one_by_one(together)] == pytest.approx(values)
    assert float(value_of(term, together)) == pytest.approx(np.mean(values))


def test_gradients_reach_the_prediction_only():
    batch, prediction, reconstructions = stripes()
    leaves = [
        prediction.depth,
        prediction.extras["prior"],
        reconstructions.images,
        reconstructions.source_from_target,
    ]
    for leaf in leaves:
        leaf.requires_grad_()
    value = value_of(TopologyPrior(), (batch, prediction, reconstructions))
    depth, *others = torch.autograd.grad(value, leaves, allow_unused=True)
    expected = torch.tensor([1.0, 1.0, 0.0, 1.0]).repeat_interleave(8) / (24 * 24)
    torch.testing.assert_close(depth, expected.expand_as(depth))
    assert others == [None, None, None]


def test_a_threshold_is_no_less_than_zero():
    with pytest.raises(DeuxError, match=r"topology_prior's threshold is -0\.1: it must be at least 0"):
        TopologyPrior(threshold=-0.1)
