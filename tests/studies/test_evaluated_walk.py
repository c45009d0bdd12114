"""A camera that looks along -Z at a wall 2 m away, and a depth that is wrong on the right half of the image."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from deux.contracts import Uncertainty, View
from deux.frame_uncertainty import make_view
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.registry import registry
from deux.studies.evaluated_walk import CONTROLS, EvaluatedWalk, WalkEvaluator, rank_correlation

CAMERA = Camera(width=64, height=48, hfov=60.0)
MEASURES: dict[str, Uncertainty] = {
    name: registry().create("uncertainties", name, {}) for name in ("l1", "ssim", "parallax", "flip", "sparse_error")
}


def view(error: float) -> View:
    """The wall with points on it, predicted `error` metres too far on the right half; image and sources are noise."""
    generator = torch.Generator().manual_seed(0)
    points = torch.zeros(1, 1, 48, 64)
    points[..., 2::5, 2::5] = 2.0
    depth = torch.full((1, 1, 48, 64), 2.0)
    depth[..., 32:] += error
    return make_view(
        image=torch.rand(1, 3, 48, 64, generator=generator),
        sparse_depth=points,
        intrinsics=torch.from_numpy(CAMERA.intrinsics).float()[None],
        sources=torch.rand(1, 2, 3, 48, 64, generator=generator),
        source_from_target=torch.eye(4).repeat(1, 2, 1, 1),
        predict_depth=lambda image, sparse_depth, intrinsics: depth[:1].expand(len(image), -1, -1, -1),
    )


@pytest.fixture
def walk() -> EvaluatedWalk:
    evaluator = WalkEvaluator("wall", CAMERA, MEASURES)
    truth = np.full((48, 64), 2.0, np.float32)
    truth[0] = 0.0  # not known
    for step in range(2, 6):
        evaluator.add(step, view(0.1 * step), truth, camera_pose(0.0, 1.25, 0.0, 0.0), moved=0.25, turned=10.0)
    return evaluator.result()


def test_frames_hold_the_true_error_and_every_measure(walk):
    assert [frame.step for frame in walk.frames] == [2, 3, 4, 5]
    assert [frame.error for frame in walk.frames] == pytest.approx([100.0, 150.0, 200.0, 250.0], rel=1e-4)
    assert walk.frames[0].distance == pytest.approx(2.1, rel=1e-4)
    # Without motion there is no parallax, and without parallax `parallax` has no values.
    assert set(walk.frames[0].scores) == {*MEASURES, *CONTROLS} - {"parallax"}


def test_a_measure_that_finds_the_errors_beats_chance(walk):
    for frame in walk.frames:
        assert frame.scores["sparse_error"].rank_correlation > 0.8
        assert frame.scores["sparse_error"].ause < 0.1
        assert abs(frame.scores["chance"].rank_correlation) < 0.1
        assert frame.scores["chance"].ause > 0.3
        assert frame.scores["chance"].coverage == 1.0
        assert frame.scores["sparse_error"].curve[0] == pytest.approx(1.0)


def test_places_are_cells_of_the_wall(walk):
    """The wall is 2.3 m wide in the image: five cells of half a metre, those on the right with all the error."""
    places = walk.places["sparse_error"]
    assert 4 <= len(places) <= 6
    errors = sorted(place.error for place in places)
    assert errors[0] == pytest.approx(0.0, abs=1.0)
    assert errors[-1] == pytest.approx(350.0, rel=0.01)  # the mean of 200, 300, 400 and 500
    assert rank_correlation([p.uncertainty for p in places], [p.error for p in places]) > 0.8


def test_it_survives_json(walk):
    upstairs = replace(walk, floor=1)
    assert EvaluatedWalk.from_json(json.loads(json.dumps(asdict(upstairs)))) == upstairs
    earlier = asdict(walk)
    del earlier["floor"]
    for frame in earlier["frames"]:
        frame["judgements"] = frame.pop("scores")
    assert EvaluatedWalk.from_json(json.loads(json.dumps(earlier))) == walk


def test_a_frame_without_true_depth_is_passed_over():
    evaluator = WalkEvaluator("dark", CAMERA, MEASURES)
    assert (
        evaluator.add(2, view(0.1), np.zeros((48, 64), np.float32), camera_pose(0.0, 1.25, 0.0, 0.0), 0.25, 0.0) == {}
    )
    assert evaluator.result().frames == []


def test_what_is_computed_already_is_not_computed_again(walk):
    class Never(Uncertainty):
        def __call__(self, view: View) -> torch.Tensor:
            raise AssertionError("it was computed already")

    given = torch.full((48, 64), 0.3)
    evaluator = WalkEvaluator("wall", CAMERA, {"given": Never(), "flip": MEASURES["flip"]})
    truth = np.full((48, 64), 2.0, np.float32)
    maps = evaluator.add(2, view(0.1), truth, camera_pose(0.0, 1.25, 0.0, 0.0), 0.25, 10.0, {"given": given})
    assert set(maps) == {"given", "flip", *CONTROLS}
    np.testing.assert_array_equal(maps["given"], given.numpy())
    assert evaluator.result().frames[0].scores["given"].delta == pytest.approx(1.0 - np.exp(-0.3))


def test_a_constant_orders_nothing_and_one_value_has_no_order():
    assert rank_correlation([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]) == 0.0
    assert rank_correlation([1.0, 2.0, 3.0], [1.0, 4.0, 9.0]) == pytest.approx(1.0)
    assert np.isnan(rank_correlation([1.0], [2.0]))
    assert np.isnan(rank_correlation([], []))
