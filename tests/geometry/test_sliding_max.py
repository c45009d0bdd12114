import pytest
import torch
from torch.nn import functional

from deux.geometry.sliding_max import _by_rectangles, _by_rows, sliding_max


@pytest.mark.parametrize("window", [1, 3, 15, 29])
@pytest.mark.parametrize("maximum", [sliding_max, _by_rows, _by_rectangles])
def test_it_equals_the_square_maximum(window, maximum):
    """As it is chosen for the device, and both ways of computing it."""
    x = torch.randn(2, 3, 21, 34)
    assert torch.equal(maximum(x, window), functional.max_pool2d(x, window, 1, window // 2))
