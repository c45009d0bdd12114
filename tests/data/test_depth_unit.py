"""The unit of stored depth, judged by its values."""

import numpy as np
import pytest

from deux.data.depth_unit import (
    likely_scale,
    points_scale,
    ratio_remedy,
    ratio_warning,
    scale_sentence,
    unit_warning,
)


def scene(nearest: float, farthest: float) -> np.ndarray:
    """Metres of a slanted wall, with holes."""
    depth = np.linspace(nearest, farthest, 400).reshape(20, 20)
    depth[::3] = 0.0
    return depth


ROOM, TABLE, HALL, ROAD = scene(0.8, 5.0), scene(0.5, 1.2), scene(2.0, 7.5), scene(5.0, 60.0)


@pytest.mark.parametrize(
    ("depth", "max_depth"), [(ROOM, 10.0), (TABLE, 10.0), (HALL, 10.0), (ROAD, 100.0), (ROOM, 8.0)]
)
@pytest.mark.parametrize("scale", [256.0, 1000.0, 5000.0])
def test_the_right_unit_is_let_through(depth: np.ndarray, max_depth: float, scale: float) -> None:
    stored = np.rint(depth * scale)
    assert likely_scale(stored / scale, scale, max_depth) is None
    assert unit_warning(stored / scale, scale, max_depth, "a.png", "data.scale") is None


@pytest.mark.parametrize(
    ("depth", "right", "wrong"),
    [
        (ROOM, 1000.0, 256.0),
        (HALL, 1000.0, 256.0),
        (ROOM, 5000.0, 256.0),
        (ROOM, 5000.0, 1000.0),
        (TABLE, 256.0, 1000.0),
    ],
)
def test_the_unit_that_fits_is_named(depth: np.ndarray, right: float, wrong: float) -> None:
    read = np.rint(depth * right) / wrong
    assert likely_scale(read, wrong, 10.0) == right
    sentence = unit_warning(read, wrong, 10.0, "points.png", "predict.sparse_scale")
    assert sentence is not None
    median = np.median(depth[depth > 0])
    assert f"would be {median:.2f} m with predict.sparse_scale={right:g}" in sentence


@pytest.mark.parametrize(
    ("depth", "asked"),
    [(1.5 * HALL, "(millimetres): is the unit right?"), (ROAD, ": is the unit right, or max_depth=10 too small?")],
)
def test_beyond_the_largest_depth_it_may_be_that_which_is_wrong(depth: np.ndarray, asked: str) -> None:
    sentence = unit_warning(depth, 256.0, 10.0, "a.png", "data.scale")
    assert sentence is not None
    assert sentence.endswith(asked)


def test_nothing_is_reported_of_no_depth_or_of_what_no_unit_explains() -> None:
    assert likely_scale(np.zeros((4, 4)), 256.0, 10.0) is None
    assert likely_scale(np.full((4, 4), 1e6), 256.0, 10.0) is None


@pytest.mark.parametrize(("factor", "said"), [(1.0, False), (1.2, False), (3.9, True), (0.256, True)])
def test_ground_truth_in_another_unit_is_noticed_at_the_points(factor: float, said: bool) -> None:
    rng = np.random.default_rng(0)
    sparse = np.where(rng.random(ROOM.shape) < 0.2, ROOM * rng.normal(1.0, 0.05, ROOM.shape), 0.0)
    found = ratio_warning(factor * ROOM, sparse, "truth.png", scale_sentence("predict.ground_truth_scale"))
    assert (found is not None) == said
    assert ratio_warning(np.where(sparse > 0, 0.0, 9 * ROOM), sparse, "truth.png", "x") is None  # no pixel in common


def test_the_options_of_a_reader_are_those_that_it_has() -> None:
    class Reader:
        scale = 1000.0

    assert points_scale(Reader()) == (1000.0, "data.scale")
    assert ratio_remedy(Reader()) == ""
    reader = Reader()
    reader.sparse_scale = None  # type: ignore[attr-defined]
    assert points_scale(reader) == (1000.0, "data.scale")
    assert ratio_remedy(reader) == " data.sparse_scale sets the stored values per metre of the sparse points."
    reader.sparse_scale = 256.0  # type: ignore[attr-defined]
    assert points_scale(reader) == (256.0, "data.sparse_scale")
    reader.ground_truth_scale = None  # type: ignore[attr-defined]
    assert ratio_remedy(reader) == " data.ground_truth_scale sets the stored values per metre of the ground truth."
    assert points_scale(object()) is None
