import math

import numpy as np
import pytest
from scipy import stats

from deux.metrics.intervals import Estimate, estimate


def test_the_interval_is_students():
    values = np.random.default_rng(0).normal(3.0, 2.0, 20)
    mean, half_width = estimate(values.tolist())
    reference = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert (mean - half_width, mean + half_width) == pytest.approx((reference.low, reference.high))


def test_it_holds_the_true_mean_19_times_in_20():
    rng = np.random.default_rng(1)
    found = [estimate(rng.normal(1.0, 1.0, 5).tolist()) for _ in range(2000)]
    assert np.mean([abs(mean - 1.0) <= half_width for mean, half_width in found]) == pytest.approx(0.95, abs=0.015)


def test_one_value_has_no_spread_and_no_value_has_no_mean():
    assert estimate([4.0]).mean == 4.0
    assert math.isnan(estimate([4.0]).half_width)
    assert math.isnan(estimate([]).mean)


def test_the_printed_table_of_t():
    assert estimate([0.0, 1.0, 2.0]).half_width == pytest.approx(4.303 / math.sqrt(3), abs=1e-3)


@pytest.mark.parametrize("value", [math.inf, math.nan])
def test_a_value_that_is_not_finite_stays_in_the_mean_and_leaves_no_interval(value):
    found = estimate([1.0, value, 2.0])
    assert str(found.mean) == str(value)
    assert math.isnan(found.half_width)
    assert math.isnan(Estimate(1.0).half_width)
