"""What an augmentation makes of a sample, and the points that `DropPoints` hides."""

import numpy as np
import pytest
import torch
from scipy import stats
from torch import Tensor
from torchvision.transforms import v2

from deux.data.sample_parts import DepthMap, InputSparseDepth
from deux.data.transforms import DropPoints, augment
from deux.errors import DeuxError

HEIGHT, WIDTH = 40, 48
MATRIX = torch.tensor([[30.0, 2.0, 20.0], [0.0, 28.0, 23.5], [0.0, 0.0, 1.0]], dtype=torch.float64)
MOTION = np.eye(4)
MOTION[:3, :3] = [[0.0, 0.0, 1.0], [0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]]
MOTION[:3, 3] = [0.1, -0.2, 0.3]


def sample() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    depth = rng.uniform(1.0, 5.0, (HEIGHT, WIDTH)).astype(np.float32)
    return {
        "images": rng.integers(0, 256, (3, 3, HEIGHT, WIDTH), np.uint8),
        "sparse_depth": np.where(rng.random(depth.shape) < 0.1, depth, np.float32(0.0)),
        "ground_truth": depth,
        "intrinsics": MATRIX.numpy().copy(),
        "source_from_target": np.stack([MOTION, MOTION @ MOTION]),
    }


def test_a_transform_that_forgets_the_camera_is_named() -> None:
    def halve(parts: dict[str, Tensor]) -> dict[str, Tensor]:
        return {**parts, "images": parts["images"][..., ::2, ::2]}

    with pytest.raises(DeuxError, match=r"left images of \(20, 24\) pixels with intrinsics of \(40, 48\) pixels"):
        augment(sample(), (halve,), seed=0)


def test_all_transforms_are_applied_in_order() -> None:
    before = sample()
    after = augment(
        sample(), (v2.RandomHorizontalFlip(p=1.0), v2.CenterCrop((20, 24)), v2.RandomHorizontalFlip(p=1.0)), 0
    )
    np.testing.assert_array_equal(after["images"], before["images"][..., 10:30, 12:36])
    np.testing.assert_array_equal(after["input_sparse_depth"], before["sparse_depth"][10:30, 12:36])
    np.testing.assert_allclose(after["source_from_target"], before["source_from_target"])
    np.testing.assert_allclose(after["intrinsics"][:, 2], [20.0 - 12, 23.5 - 10, 1.0])


def lost(transform: DropPoints, draws: int) -> np.ndarray:
    """The fraction of the points that each of many samples loses."""
    points = np.zeros((HEIGHT, WIDTH), np.float32)
    points.flat[:1000] = 2.0
    shown = torch.from_numpy(points).as_subclass(InputSparseDepth)
    generator = torch.Generator().manual_seed(0)
    left = []
    for _ in range(draws):
        torch.manual_seed(int(torch.randint(2**31, (), generator=generator)))
        left.append(int(transform({"input_sparse_depth": shown})["input_sparse_depth"].count_nonzero()))
    return 1.0 - np.array(left) / 1000.0


def test_half_of_the_samples_keep_all_points_and_the_others_lose_an_even_fraction() -> None:
    fractions = lost(DropPoints((0.30, 0.60), p=0.5), draws=2000)
    dropped = fractions[fractions > 0]
    assert stats.binomtest(len(dropped), 2000, 0.5).pvalue > 0.01
    assert stats.kstest(dropped, stats.uniform(0.30, 0.30).cdf).pvalue > 0.01
    assert (lost(DropPoints((0.30, 0.60), p=1.0), draws=50) > 0).all()
    assert (lost(DropPoints((0.30, 0.60), p=0.0), draws=50) == 0).all()


def test_points_are_dropped_anywhere_from_the_input_alone() -> None:
    parts = {
        "sparse_depth": DepthMap(torch.ones(50, 50)),
        "input_sparse_depth": torch.ones(50, 50).as_subclass(InputSparseDepth),
    }
    torch.manual_seed(0)
    counts = np.zeros((50, 50))
    for _ in range(200):
        after = DropPoints((0.5, 0.5), p=1.0)(parts)
        assert int(after["input_sparse_depth"].count_nonzero()) == 1250
        counts += after["input_sparse_depth"].numpy()
    assert float(parts["input_sparse_depth"].sum()) == float(parts["sparse_depth"].sum()) == 2500
    assert after["sparse_depth"] is parts["sparse_depth"]
    quarters = counts.reshape(2, 25, 2, 25).sum(axis=(1, 3))
    assert np.abs(quarters / quarters.mean() - 1.0).max() < 0.02


@pytest.mark.parametrize(("fraction", "p"), [((0.5, 1.5), 0.5), ((-0.1, 0.5), 0.5), ((0.3, 0.6), 2.0)])
def test_fractions_and_probabilities_lie_between_0_and_1(fraction: tuple[float, float], p: float) -> None:
    with pytest.raises(DeuxError, match="DropPoints"):
        DropPoints(fraction, p)
