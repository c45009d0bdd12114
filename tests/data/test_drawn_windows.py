"""Samples whose augmentation is drawn as rows, columns and hidden pixels, against the pixels themselves."""

import numpy as np
import pytest
import torch
from torchvision.transforms import v2

from deux.data.augmentation import RandomScale
from deux.data.device_cache import FrameStack, HostPoints, StoredFrame
from deux.data.drawn_windows import Window, draw, is_drawn
from deux.data.transforms import DropPoints, augment

HEIGHT, WIDTH = 20, 30
FLIPS = (v2.RandomHorizontalFlip(p=0.5), v2.RandomVerticalFlip(p=0.3))


def stored(depth: np.ndarray) -> StoredFrame:
    return StoredFrame(FrameStack(depth, torch.device("cpu")), 0, HostPoints.of(depth))


@pytest.mark.parametrize("density", [0.0, 0.1, 1.0])
def test_windows_are_what_the_transforms_make_of_the_pixels(density: float) -> None:
    rng = np.random.default_rng(0)
    depth = np.where(rng.random((HEIGHT, WIDTH)) < density, rng.uniform(1, 5, (HEIGHT, WIDTH)), 0.0).astype(np.float32)
    augmentation = (
        DropPoints((0.1, 0.5), p=0.5),
        *FLIPS,
        RandomScale((0.5, 2.0), (0.8, 6.0)),
        DropPoints((0.2, 0.9), p=0.7),
        *FLIPS,
    )
    matrix = np.array([[20.0, 1.0, 9.5], [0.0, 21.0, 7.25], [0.0, 0.0, 1.0]])
    motions = rng.normal(size=(2, 4, 4))
    for seed in range(60):
        top, left = seed % 7, seed % 11
        window = Window(np.arange(top, top + 12), np.arange(left, left + 16), matrix, motions)
        draw(window, augmentation, torch.Generator().manual_seed(seed), stored(depth))
        crop = depth[top : top + 12, left : left + 16]
        sample = {
            "images": np.broadcast_to(crop, (3, 3, 12, 16)).copy(),
            "sparse_depth": crop.copy(),
            "intrinsics": matrix.copy(),
            "source_from_target": motions.copy(),
        }
        expected = augment(sample, augmentation, seed)
        cut = depth[np.ix_(window.rows, window.columns)] * np.float32(window.scale)
        np.testing.assert_array_equal(cut, expected["sparse_depth"])
        np.testing.assert_array_equal(np.flatnonzero(expected["input_sparse_depth"]), window.shown(stored(depth)))
        cut.flat[window.hidden] = 0.0
        np.testing.assert_array_equal(cut, expected["input_sparse_depth"])
        np.testing.assert_array_equal(window.intrinsics, expected["intrinsics"])
        np.testing.assert_array_equal(window.motions, expected["source_from_target"])


def test_only_transforms_whose_draws_are_known_are_drawn() -> None:
    class Flip(v2.RandomHorizontalFlip):
        """May do anything."""

    assert is_drawn(())
    assert is_drawn((*FLIPS, RandomScale((0.5, 2.0)), DropPoints((0.3, 0.6))))
    assert not is_drawn((*FLIPS, v2.ColorJitter(0.1)))
    assert not is_drawn((Flip(),))
