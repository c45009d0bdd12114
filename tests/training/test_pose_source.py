import pytest
import torch
from torch import nn

from deux.contracts import Batch, DepthModel, Prediction
from deux.errors import DeuxError
from deux.testing.losses import perfect_sample
from deux.training.pose_source import LearnedPoseSource, make_pose_source


class TranslationNetwork(nn.Module):
    """Estimates a motion along z: the brightness of the target less that of the source."""

    def __init__(self) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.ones(()))

    def forward(self, target: torch.Tensor, source: torch.Tensor) -> torch.Tensor:
        pose = torch.eye(4).repeat(len(target), 1, 1)
        pose[:, 2, 3] = self.scale * (target - source).mean(dim=(1, 2, 3))
        return pose


class Model(DepthModel):
    def __init__(self, network: nn.Module | None) -> None:
        super().__init__()
        self.network = network

    def pose_network(self) -> nn.Module | None:
        return self.network

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared) -> Prediction:
        return Prediction(sparse_depth)


@pytest.fixture
def batch() -> Batch:
    return perfect_sample(2).batch


def test_simulator_gives_the_robots_poses_and_their_inverses(batch):
    poses = make_pose_source("simulator", Model(None))(batch, backward=True)
    assert torch.equal(poses.source_from_target, batch.source_from_target)
    torch.testing.assert_close(
        poses.target_from_source @ poses.source_from_target,
        torch.eye(4).expand(2, 2, 4, 4),
        atol=1e-6,
        rtol=0,
    )
    assert make_pose_source("simulator", Model(None))(batch).target_from_source is None


def test_learned_poses_pair_each_source_with_its_target(batch):
    source = make_pose_source("learned", Model(TranslationNetwork()))
    assert isinstance(source, LearnedPoseSource)
    batch.sources = batch.image[:, None] + torch.tensor([[0.1, 0.2], [0.3, 0.4]])[..., None, None, None]
    poses = source(batch, backward=True)
    expected = torch.tensor([[-0.1, -0.2], [-0.3, -0.4]])
    torch.testing.assert_close(poses.source_from_target[..., 2, 3], expected)
    torch.testing.assert_close(poses.target_from_source[..., 2, 3], -expected)
    poses.source_from_target.sum().backward()
    assert source.network.scale.grad is not None


def test_the_way_back_from_a_source_of_another_camera(batch):
    stretch = torch.eye(4)
    stretch[:2, :3] = torch.tensor([[1.2, 0.1, -0.05], [0.0, 0.9, 0.02]])  # K_target^-1 K_source
    batch.source_from_target = stretch @ batch.source_from_target
    poses = make_pose_source("simulator", Model(None))(batch, backward=True)
    torch.testing.assert_close(poses.target_from_source, torch.linalg.inv(poses.source_from_target))


def test_frames_without_poses_have_them_learned(batch):
    recorded, learned = (make_pose_source(kind, Model(TranslationNetwork())) for kind in ("simulator", "learned"))
    batch.source_from_target = None
    with pytest.raises(DeuxError, match=r"pose=simulator needs the poses .*: use pose=learned, or .* absolute_pose/"):
        recorded(batch)
    assert learned(batch).source_from_target.shape == (2, 2, 4, 4)


def test_learned_poses_need_a_network():
    with pytest.raises(DeuxError, match="Model has none: use pose=simulator"):
        make_pose_source("learned", Model(None))


def test_unknown_kind_of_poses():
    with pytest.raises(DeuxError, match="did you mean learned"):
        make_pose_source("learnt", Model(None))


def test_the_inverses_are_exact_where_the_networks_compute_in_bfloat16(batch):
    with torch.autocast("cpu", torch.bfloat16):
        poses = make_pose_source("simulator", Model(None))(batch, backward=True)
    identity = torch.eye(4).expand(2, 2, 4, 4)
    assert poses.target_from_source.dtype == torch.float32
    torch.testing.assert_close(poses.target_from_source @ poses.source_from_target, identity, atol=1e-6, rtol=0)


class OneImage(nn.Module):
    def forward(self, pair: torch.Tensor) -> torch.Tensor:
        return torch.eye(4).repeat(len(pair), 1, 1)


@pytest.mark.parametrize(
    ("network", "told"),
    [
        (OneImage(), r"a OneImage whose `forward` takes \(pair: torch\.Tensor\) -> torch\.Tensor"),
        (torch.eye(4), "Tensor of 4 x 4, float32"),
        (TranslationNetwork, "a value of the type type"),
    ],
)
def test_the_model_is_named_for_a_pose_network_that_does_not_take_two_images(network, told):
    model = Model(None)
    model.pose_network = lambda: network  # type: ignore[method-assign]
    sentence = rf"^the `pose_network` of the depth model Model gives {told}: it must be an nn\.Module whose `forward`"
    with pytest.raises(DeuxError, match=sentence):
        make_pose_source("learned", model)


@pytest.mark.parametrize(
    ("found", "told"),
    [(lambda n: None, "None"), (lambda n: torch.zeros(n, 6), "Tensor of 4 x 6, float32")],
)
def test_the_model_is_named_for_a_pose_network_that_gives_no_poses(batch, found, told):
    class Odd(nn.Module):
        def forward(self, target: torch.Tensor, source: torch.Tensor) -> torch.Tensor:
            return found(len(target))  # type: ignore[no-any-return]

    source = make_pose_source("learned", Model(Odd()))
    sentence = (
        f"^the `pose_network` of the depth model Model gives a network that answers 4 pairs of images with {told}:"
    )
    with pytest.raises(DeuxError, match=sentence):
        source(batch)
