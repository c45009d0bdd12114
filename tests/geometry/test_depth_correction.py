import numpy as np
import pytest
import torch

from deux.geometry.depth_correction import correct_depth
from deux.testing.host_waits import refuse_host_waits

SIZE = 64
SPACING = 8.0


def true_depth() -> torch.Tensor:
    """A floor, a wall and a box before it, 1 x 1 x H x W metres."""
    rows = torch.arange(SIZE, dtype=torch.float32)[:, None].expand(SIZE, SIZE)
    depth = torch.where(rows > SIZE // 2, 60.0 / (rows - 15.0), 3.5)
    depth[10:30, 20:40] = 1.8
    return depth[None, None].clone()


def points(depth: torch.Tensor, seed: int = 0) -> torch.Tensor:
    """One point for each SPACING x SPACING pixels, at random."""
    generator = torch.Generator().manual_seed(seed)
    chosen = torch.randperm(SIZE * SIZE, generator=generator)[: round((SIZE / SPACING) ** 2)]
    sparse = torch.zeros_like(depth)
    sparse.view(-1)[chosen] = depth.reshape(-1)[chosen]
    return sparse


def smooth_field() -> torch.Tensor:
    """A factor between 0.8 and 1.25 that varies over the image."""
    place = torch.linspace(0.0, 1.0, SIZE)
    return torch.exp(0.22 * torch.sin(3.0 * place[:, None] + 2.0 * place))[None, None]


def relative_error(depth: torch.Tensor, truth: torch.Tensor) -> float:
    return float(((depth - truth).abs() / truth).mean())


def test_a_wrong_scale_is_mended_everywhere():
    truth = true_depth()
    corrected = correct_depth(0.8 * truth, points(truth), SPACING)
    assert relative_error(corrected, truth) < 0.015


def test_a_smooth_error_is_mended():
    truth = true_depth()
    predicted = truth * smooth_field()
    before = relative_error(predicted, truth)
    assert relative_error(correct_depth(predicted, points(truth), SPACING), truth) < 0.2 * before


def test_a_right_prediction_stays_and_so_does_one_without_points():
    truth = true_depth()
    torch.testing.assert_close(correct_depth(truth, points(truth), SPACING), truth)
    assert torch.equal(correct_depth(truth, torch.zeros_like(truth), SPACING), truth)


def test_without_a_spacing_each_frame_has_that_of_its_points():
    truth = true_depth()
    predicted = truth * smooth_field()
    many, few = points(truth), points(truth)
    few[..., ::2] = 0.0
    alone = [
        correct_depth(predicted, sparse, (sparse.numel() / int((sparse > 0).sum())) ** 0.5) for sparse in (many, few)
    ]
    together = correct_depth(predicted.expand(2, -1, -1, -1), torch.cat([many, few]))
    torch.testing.assert_close(together, torch.cat(alone))


def test_far_from_all_points_the_depth_stays():
    truth = true_depth()
    sparse = torch.zeros_like(truth)
    sparse[0, 0, 5, 5] = 1.3 * truth[0, 0, 5, 5]
    corrected = correct_depth(truth, sparse, 4.0)
    torch.testing.assert_close(corrected[..., 30:, 30:], truth[..., 30:, 30:])
    assert float(corrected[0, 0, 5, 5] / truth[0, 0, 5, 5]) == pytest.approx(1.3, abs=0.03)


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_outliers_bend_little(factor):
    truth = true_depth()
    sparse = points(truth)
    wrong = torch.nonzero(sparse.view(-1))[::10, 0]
    sparse.view(-1)[wrong] *= factor
    corrected = correct_depth(0.8 * truth, sparse, SPACING)
    # Without weights a tenth of points that are off by this would turn the factor of all around them.
    assert relative_error(corrected, truth) < 0.12
    assert float(np.median(((corrected - truth).abs() / truth).numpy())) < 0.06


def test_a_frame_does_not_depend_on_the_others_of_its_batch():
    truth = true_depth()
    depths = torch.cat([truth * factor for factor in (0.7, 0.9, 1.2)])
    sparse = torch.cat([points(truth, seed) for seed in range(3)])
    together = correct_depth(depths, sparse, SPACING)
    for i in range(3):
        assert torch.equal(together[i : i + 1], correct_depth(depths[i : i + 1], sparse[i : i + 1], SPACING))


def test_images_need_not_be_square():
    truth = true_depth()[..., :48, :]
    corrected = correct_depth(0.8 * truth, points(true_depth())[..., :48, :], SPACING)
    assert corrected.shape == truth.shape
    assert relative_error(corrected, truth) < 0.03


def test_nothing_makes_the_host_wait():
    truth, sparse = true_depth(), points(true_depth())
    with refuse_host_waits():
        correct_depth(truth, sparse, SPACING)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_card_gives_the_same():
    truth = true_depth()
    sparse = points(truth)
    corrected = correct_depth(0.8 * truth.cuda(), sparse.cuda(), SPACING).cpu()
    torch.testing.assert_close(corrected, correct_depth(0.8 * truth, sparse, SPACING), rtol=1e-4, atol=1e-4)
