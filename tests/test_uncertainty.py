import math
from typing import get_args

import pytest
import torch

from deux.uncertainty.measures import MEASURES, MeasureName, frame_uncertainty


def test_every_name_has_its_measure():
    assert tuple(MEASURES) == get_args(MeasureName)


def test_frame_uncertainty_is_equation_eight_over_the_known_pixels():
    uncertainty = torch.tensor([[[0.1, 0.3], [torch.nan, 0.2]], [[torch.nan] * 2] * 2])
    delta = frame_uncertainty(uncertainty)
    assert delta[0].item() == pytest.approx(1.0 - math.exp(-0.2), rel=1e-6)
    assert delta[1].isnan()


@pytest.mark.parametrize("name", MEASURES)
def test_a_measure_is_a_map_that_sees_no_ground_truth(name, make_view):
    points = torch.zeros(2, 1, 48, 64, dtype=torch.bool)
    points[..., 4::8, 4::8] = True
    depth = torch.full((2, 1, 48, 64), 2.0) + torch.rand(2, 1, 48, 64, generator=torch.Generator().manual_seed(0))
    uncertainty = MEASURES[name](make_view(depth, points=points))
    assert uncertainty.shape == (2, 48, 64)
    assert uncertainty.dtype == torch.float32
    known = uncertainty[uncertainty.isfinite()]
    assert len(known) > 0
    assert known.min() >= 0.0
