import math

import numpy as np
import pytest
from scipy import stats

from deux.report.summary import summary


@pytest.mark.parametrize("values", [[1.0, 2.0], [3.1, 2.7, 9.4], [5.0] * 4, list(range(10))])
def test_mean_and_interval_are_scipys(values):
    found = summary(dict(enumerate(values)))
    low, high = (
        stats.t.interval(0.95, len(values) - 1, np.mean(values), stats.sem(values)) if np.ptp(values) else (5, 5)
    )
    assert found.mean == pytest.approx(np.mean(values))
    assert found.interval == pytest.approx((high - low) / 2, abs=1e-12)
    assert found.seeds == tuple(range(len(values)))


def test_the_printed_table_of_t():
    assert summary({3: 0.0, 1: 1.0, 2: 2.0}).interval == pytest.approx(4.303 / math.sqrt(3), abs=1e-3)


def test_one_seed_has_no_interval():
    assert summary({4: 2.5}) == summary({4: 2.5})
    assert summary({4: 2.5}).interval is None
