import numpy as np

from deux.metrics.baseline import constant


def test_constant_is_the_median_of_the_points():
    sparse = np.zeros((4, 4), np.float32)
    sparse.flat[[0, 5, 9]] = [1.0, 2.0, 7.0]
    assert (constant(sparse) == 2.0).all()


def test_without_points_everything_is_zero():
    assert not constant(np.zeros((5, 6), np.float32)).any()
