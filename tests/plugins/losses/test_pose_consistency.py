import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from deux.contracts import LossInputs, LossTerm, Prediction, Reconstructions
from deux.testing.losses import DEPTH_RANGE, LossTermSuite, perfect_sample
from deux.training.pose_source import PoseSource
from deux_plugins.losses.pose_consistency import PoseConsistency


class TestPoseConsistency(LossTermSuite):
    def make_term(self) -> LossTerm:
        return PoseConsistency()


def value(forward: torch.Tensor, backward: torch.Tensor) -> float:
    """The term's value for poses N x S x 4 x 4."""
    sample = perfect_sample(len(forward))
    images = sample.batch.sources
    reconstructions = Reconstructions(images, torch.ones_like(images[:, :, :1]) > 0, forward, backward)
    return float(PoseConsistency()(LossInputs(sample.batch, Prediction(sample.depth), reconstructions, DEPTH_RANGE)))


def test_agrees_with_the_published_case(published_case):
    """The term itself is not recorded: it is the remainder of the total, to the total's own rounding."""
    inputs, losses = published_case("voiced")
    value = float(PoseConsistency()(inputs))
    rebuilt = inputs.reconstructions
    there, back = (poses.double().numpy() for poses in (rebuilt.source_from_target, rebuilt.target_from_source))
    expected = sum(np.mean((there[:, s] @ back[:, s] - np.eye(4)) ** 2) for s in (0, 1))
    assert value == pytest.approx(expected, rel=1e-4)
    weights = {"color": 0.2, "structure": 0.8, "sparse_depth": 0.5, "smoothness": 2.0}
    remainder = losses["total"] - sum(weight * losses[name] for name, weight in weights.items())
    assert 0.1 * value == pytest.approx(remainder, abs=float(2 * np.spacing(np.float32(losses["total"]))))


def test_a_rotation_that_is_not_undone():
    """A turn by an angle e differs from the identity by 4 (1 - cos e), summed over the squared entries."""
    errors = np.array([[0.1, 0.3], [0.2, -0.4]])
    forward = torch.eye(4).repeat(2, 2, 1, 1)
    backward = forward.clone()
    for index, error in np.ndenumerate(errors):
        axis = np.array([1.0, 2.0, -2.0]) / 3.0
        forward[index][:3, :3] = torch.from_numpy(Rotation.from_rotvec(0.7 * axis).as_matrix())
        backward[index][:3, :3] = torch.from_numpy(Rotation.from_rotvec((error - 0.7) * axis).as_matrix())
    expected = (4 * (1 - np.cos(errors)) / 16).mean(axis=0).sum()
    assert value(forward, backward) == pytest.approx(expected, rel=1e-4)


def test_the_robots_own_poses_cost_nothing():
    batch = perfect_sample().batch
    turns = Rotation.random(4, rng=np.random.default_rng(0)).as_matrix().reshape(2, 2, 3, 3)
    batch.source_from_target[..., :3, :3] = torch.from_numpy(turns)
    assert value(*PoseSource()(batch, backward=True)) == pytest.approx(0.0, abs=1e-10)
