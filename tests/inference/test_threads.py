import os
import threading
from contextlib import suppress

import cv2
import pytest
import torch
from torch.nn import functional

from deux.inference.precision import FastPredictor
from deux.inference.threads import each_frame_apart, limit_threads, one_thread
from deux.registry import registry


@pytest.fixture(autouse=True)
def threads():
    """threads(n): let the process have n threads; undone afterwards."""
    before = torch.get_num_threads(), cv2.getNumThreads()
    yield torch.set_num_threads
    torch.set_num_threads(before[0])
    cv2.setNumThreads(before[1])


def test_one_thread_for_a_while(threads):
    threads(2)
    with suppress(ValueError), one_thread():
        assert torch.get_num_threads() == 1
        raise ValueError
    assert torch.get_num_threads() == 2


def test_limits_lower_and_never_raise(threads, monkeypatch):
    monkeypatch.setattr(os, "environ", {})
    threads(3)
    limit_threads(2)
    assert (torch.get_num_threads(), cv2.getNumThreads()) == (2, 2)
    limit_threads(8)
    assert (torch.get_num_threads(), cv2.getNumThreads()) == (2, 2)
    assert os.environ == {"LP_NUM_THREADS": "2"}


@pytest.mark.parametrize("count", [1, 2, 5])
def test_frames_are_predicted_apart_at_the_same_time_and_come_back_in_order(threads, count):
    threads(3)
    together = threading.Barrier(min(count, 3))

    def predict(image, depth):
        assert image.shape == (1, 3, 4, 4)
        assert torch.get_num_threads() == 1
        together.wait(10)
        return depth + image.mean()

    image, depth = torch.rand(3, 3, 4, 4), torch.rand(3, 1, 4, 4)
    if count == 2:
        image, depth = image[:2], depth[:2]
    found = each_frame_apart(predict, (image, depth), count)
    torch.testing.assert_close(found, depth + image.flatten(1).mean(1)[:, None, None, None])
    assert torch.get_num_threads() == 3


@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
@pytest.mark.parametrize("name", ["kbnet", "voiced", "scaffnet", "fusionnet"])
def test_a_prediction_depends_on_neither_threads_nor_batch(threads, name, precision):
    torch.manual_seed(0)
    model = registry().create("depth_models", name, {}).eval()
    image = functional.interpolate(torch.rand(2, 3, 12, 16), size=(96, 128), mode="bilinear")
    points = torch.where(torch.rand(2, 1, 96, 128) < 0.02, 1.0 + torch.rand(2, 1, 96, 128), 0.0)
    camera = torch.tensor([[64.0, 0.0, 63.5], [0.0, 64.0, 47.5], [0.0, 0.0, 1.0]]).expand(2, 3, 3)
    found = []
    for count in (1, 2):
        threads(count)
        found.append(FastPredictor(model, "cpu", precision)(image, points, camera))
    with one_thread():
        found.append(FastPredictor(model, "cpu", precision)(image[1:], points[1:], camera[1:]))
    assert torch.equal(found[0], found[1])
    assert torch.equal(found[0][1:], found[2])
