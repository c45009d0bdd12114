import numpy as np
import pytest
import torch

from deux.metrics.depth_errors import METRICS, depth_errors, invalid_pixels


def test_errors_of_one_pixel_by_hand():
    errors = depth_errors(torch.full((1, 1, 1, 1), 2.5), torch.full((1, 1, 1, 1), 2.0))
    assert errors["mae"].item() == pytest.approx(500.0)
    assert errors["rmse"].item() == pytest.approx(500.0)
    assert errors["imae"].item() == pytest.approx(100.0)  # 1/0.0020 - 1/0.0025 km
    assert errors["irmse"].item() == pytest.approx(100.0)


def rms(values: list[float]) -> float:
    return (sum(value * value for value in values) / len(values)) ** 0.5


def test_errors_agree_with_a_loop_over_pixels():
    rng = np.random.default_rng(0)
    truth = rng.uniform(-1.0, 12.0, (3, 1, 7, 5)).clip(0).astype(np.float32)
    predicted = rng.uniform(0.2, 9.0, truth.shape).astype(np.float32)
    errors = depth_errors(torch.from_numpy(predicted), torch.from_numpy(truth), 0.2, 5.0)
    for image in range(3):
        pairs = [(p, t) for p, t in zip(predicted[image].flat, truth[image].flat, strict=True) if 0.2 < t < 5.0]
        absolute = [abs(float(p) - float(t)) * 1e3 for p, t in pairs]
        inverse = [abs(1 / float(p) - 1 / float(t)) * 1e3 for p, t in pairs]
        assert errors["mae"][image].item() == pytest.approx(sum(absolute) / len(pairs))
        assert errors["rmse"][image].item() == pytest.approx((sum(a * a for a in absolute) / len(pairs)) ** 0.5)
        assert errors["imae"][image].item() == pytest.approx(sum(inverse) / len(pairs))
        assert errors["irmse"][image].item() == pytest.approx((sum(i * i for i in inverse) / len(pairs)) ** 0.5)


def test_the_range_is_open_at_both_ends():
    truth = torch.tensor([0.1, 10.0, 1.0]).reshape(1, 1, 1, 3)
    assert depth_errors(truth + 1.0, truth, 0.1, 10.0)["mae"].item() == pytest.approx(1000.0)
    assert depth_errors(torch.ones(1, 1, 1, 2), truth[..., :2], 0.1, 10.0)["mae"].isnan().all()


def test_the_names_and_units_are_those_of_the_paper():
    assert [metric.heading for metric in METRICS.values()] == ["MAE [mm]", "RMSE [mm]", "iMAE [1/km]", "iRMSE [1/km]"]
    assert list(METRICS) == [metric.title.lower() for metric in METRICS.values()]


INVALID = (float("nan"), float("inf"), -float("inf"), 0.0, -1.5)


@pytest.mark.parametrize("value", INVALID)
def test_a_prediction_that_is_no_depth_has_an_infinite_error(value):
    truth = torch.full((2, 1, 2, 3), 2.0)
    truth[:, :, 0, 0] = 0.0
    predicted = torch.full_like(truth, 2.5)
    predicted[1, 0, 1, 2] = value
    for name, errors in depth_errors(predicted, truth).items():
        assert errors.isfinite().tolist() == [True, False], name
        assert errors[1] == torch.inf
    assert invalid_pixels(predicted, truth).tolist() == [0, 1]


@pytest.mark.parametrize("value", INVALID)
def test_where_there_is_no_ground_truth_the_prediction_does_not_matter(value):
    truth = torch.full((1, 1, 2, 2), 2.0)
    truth[..., 0] = 0.0
    predicted = torch.where(truth > 0, 2.5, value)
    assert depth_errors(predicted, truth)["mae"].item() == pytest.approx(500.0)
    assert invalid_pixels(predicted, truth).tolist() == [0]


def test_float32_errors_are_those_of_float64():
    generator = torch.Generator().manual_seed(0)
    truth = 0.2 + 9.0 * torch.rand(2, 1, 64, 64, generator=generator)
    predicted = truth * (1.0 + 0.01 * torch.randn(truth.shape, generator=generator))
    difference = 1000.0 * (predicted.double() - truth.double())
    inverse = 1000.0 / predicted.double() - 1000.0 / truth.double()
    expected = {"mae": difference.abs(), "rmse": difference.square(), "imae": inverse.abs(), "irmse": inverse.square()}
    for name, values in depth_errors(predicted, truth).items():
        mean = expected[name].mean(dim=(1, 2, 3))
        torch.testing.assert_close(values, mean if "mae" in name else mean.sqrt(), rtol=1e-5, atol=0.0)
