import pytest
import torch

from deux.metrics.depth_errors import METRICS
from deux.metrics.mean_errors import DepthErrors
from deux.testing.host_waits import refuse_host_waits


def test_metric_averages_images_not_pixels_and_leaves_out_images_without_truth():
    metric = DepthErrors()
    truth = torch.zeros(3, 1, 1, 4)
    truth[0] = 2.0  # four pixels, error 1 m
    truth[1, ..., 0] = 2.0  # one pixel, error 1 m as well
    predicted = torch.full_like(truth, 3.0)
    predicted[1] = 5.0  # error 3 m
    metric.update(predicted[:1], truth[:1])
    metric.update(predicted[1:], truth[1:])
    assert metric.compute()["mae"].item() == pytest.approx(2000.0)
    assert list(metric.compute()) == list(METRICS)


def test_a_broken_prediction_does_not_leave_the_mean():
    """It once was taken for an image without ground truth, and the worse model looked the better one."""
    metric = DepthErrors()
    truth = torch.full((2, 1, 4, 4), 2.0)
    predicted = torch.full_like(truth, 3.0)
    predicted[1] = torch.nan
    metric.update(predicted, truth)
    with pytest.warns(UserWarning, match="not finite or not above 0 at 16 pixels with ground truth of 2 images"):
        means = metric.compute()
    assert all(mean == torch.inf for mean in means.values())
    metric.reset()
    metric.update(predicted[:1], truth[:1])
    assert metric.compute()["mae"].item() == pytest.approx(1000.0)


def test_only_the_mean_waits_for_the_device():
    truth = torch.full((3, 1, 4, 4), 2.0)
    truth[1] = 0.0
    metric = DepthErrors()
    with refuse_host_waits():
        metric.update(truth + 0.5, truth)
        metric.update(truth + 1.0, truth)
    assert metric.compute()["mae"].item() == pytest.approx(750.0)
