import pytest
import torch
from torch.nn import functional

from deux.geometry.sliding_max import sliding_max


@pytest.mark.parametrize("window", [1, 3, 15, 29])
def test_it_equals_the_square_maximum(window):
    x = torch.randn(2, 3, 21, 34)
    assert torch.equal(sliding_max(x, window), functional.max_pool2d(x, window, 1, window // 2))
