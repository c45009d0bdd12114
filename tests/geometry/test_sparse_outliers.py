import numpy as np
import pytest
import torch

from deux.geometry.sparse_outliers import remove_outliers


def by_hand(sparse_depth: np.ndarray, kernel_size: int, threshold: float) -> np.ndarray:
    """One H x W map, point by point."""
    kept = np.zeros_like(sparse_depth)
    reach = kernel_size // 2
    for row, column in zip(*np.nonzero(sparse_depth), strict=True):
        window = sparse_depth[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
        kept[row, column] = window[window > 0].min() >= sparse_depth[row, column] - threshold
    return kept


@pytest.mark.parametrize(("kernel_size", "threshold"), [(7, 1.5), (5, 0.4), (3, 3.0)])
def test_agrees_with_a_loop_over_the_points(kernel_size, threshold):
    generator = np.random.default_rng(0)
    depth = generator.uniform(0.1, 10.0, (2, 1, 40, 50)).astype(np.float32)
    depth[generator.random(depth.shape) > 0.06] = 0.0
    validity = remove_outliers(torch.from_numpy(depth), kernel_size, threshold).numpy()
    for kept, frame in zip(validity[:, 0], depth[:, 0], strict=True):
        np.testing.assert_array_equal(kept, by_hand(frame, kernel_size, threshold))
    assert 0 < validity.sum() < (depth > 0).sum()


def test_no_points_keep_none():
    validity = remove_outliers(torch.zeros(1, 1, 12, 12))
    assert validity.dtype == torch.float32
    assert not validity.any()


@pytest.mark.parametrize("name", ["kbnet", "voiced", "fusionnet"])
def test_agrees_with_the_published_filter(shared_data, name):
    case = np.load(shared_data("cases") / f"{name}.npz")
    validity = remove_outliers(torch.from_numpy(case["sparse_depth"])).numpy()
    np.testing.assert_array_equal(validity, case["filtered_validity_map"])
    np.testing.assert_array_equal(validity * case["sparse_depth"], case["filtered_sparse_depth"])
