import numpy as np
import pytest

from deux.metrics.sparsification import REMOVED, ause, sparsification_curve

ERRORS = np.linspace(0.0, 1.0, 100_001)
"""Evenly spread, so that the mean of the smallest share s of them is s / 2."""


def test_the_oracle_removes_the_largest_errors_first():
    np.testing.assert_allclose(sparsification_curve(ERRORS, ERRORS), (1.0 - REMOVED) / 2.0, atol=1e-4)


def test_only_the_order_of_the_uncertainties_counts():
    shuffled = np.random.default_rng(0).permutation(ERRORS)
    curve = sparsification_curve(shuffled, np.exp(5.0 * shuffled))
    np.testing.assert_allclose(curve, sparsification_curve(ERRORS, ERRORS))


@pytest.mark.parametrize(
    ("uncertainty", "area"),
    [
        (ERRORS, 0.0),
        (np.random.default_rng(0).permutation(ERRORS), 0.95**2 / 2.0),  # the mean stays 1/2: the area under 2 q / 2
        (-ERRORS, 0.95**2),  # the worst order leaves (1 + q) / 2
    ],
)
def test_ause_of_a_perfect_a_random_and_the_worst_order(uncertainty, area):
    oracle = sparsification_curve(ERRORS, ERRORS)
    assert ause(sparsification_curve(ERRORS, uncertainty), oracle) == pytest.approx(area, abs=0.01)


def test_at_least_one_pixel_remains():
    assert np.isfinite(sparsification_curve(np.array([1.0, 3.0]), np.array([0.0, 1.0]))).all()
