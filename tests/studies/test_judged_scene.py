"""A camera that looks along -Z at a wall 2 m away, and a depth that is wrong on the right half of the image."""

import json
from dataclasses import asdict

import numpy as np
import pytest
import torch

from deux.contracts import View
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.studies.judged_scene import CONTROLS, JudgedScene, SceneJudge, rank_correlation
from deux.uncertainty.measures import MEASURES

CAMERA = Camera(width=64, height=48, hfov=60.0)


def view(error: float) -> View:
    """The wall with points on it, predicted `error` metres too far on the right half; image and sources are noise."""
    generator = torch.Generator().manual_seed(0)
    points = torch.zeros(1, 1, 48, 64)
    points[..., 2::5, 2::5] = 2.0
    depth = torch.full((1, 1, 48, 64), 2.0)
    depth[..., 32:] += error
    return View(
        image=torch.rand(1, 3, 48, 64, generator=generator),
        sparse_depth=points,
        intrinsics=torch.from_numpy(CAMERA.intrinsics).float()[None],
        depth=depth,
        sources=torch.rand(1, 2, 3, 48, 64, generator=generator),
        source_from_target=torch.eye(4).repeat(1, 2, 1, 1),
        predict_depth=lambda image, sparse_depth, intrinsics: depth[:1].expand(len(image), -1, -1, -1),
    )


@pytest.fixture
def judged() -> JudgedScene:
    judge = SceneJudge("wall", CAMERA)
    truth = np.full((48, 64), 2.0, np.float32)
    truth[0] = 0.0  # not known
    for step in range(2, 6):
        judge.see(step, view(0.1 * step), truth, camera_pose(0.0, 1.25, 0.0, 0.0), moved=0.25, turned=10.0)
    return judge.result()


def test_frames_hold_the_true_error_and_every_measure(judged):
    assert [frame.step for frame in judged.frames] == [2, 3, 4, 5]
    assert [frame.error for frame in judged.frames] == pytest.approx([100.0, 150.0, 200.0, 250.0], rel=1e-4)
    assert judged.frames[0].distance == pytest.approx(2.1, rel=1e-4)
    # Without motion there is no parallax, and with it nothing that `parallax` could say.
    assert set(judged.frames[0].judgements) == {*MEASURES, *CONTROLS} - {"parallax"}


def test_a_measure_that_finds_the_errors_beats_chance(judged):
    for frame in judged.frames:
        assert frame.judgements["sparse_error"].rank_correlation > 0.8
        assert frame.judgements["sparse_error"].ause < 0.1
        assert abs(frame.judgements["chance"].rank_correlation) < 0.1
        assert frame.judgements["chance"].ause > 0.3
        assert frame.judgements["chance"].share == 1.0
        assert frame.judgements["sparse_error"].curve[0] == pytest.approx(1.0)


def test_places_are_cells_of_the_wall(judged):
    """The wall is 2.3 m wide in the image: five cells of half a metre, those on the right with all the error."""
    places = judged.places["sparse_error"]
    assert 4 <= len(places) <= 6
    errors = sorted(place.error for place in places)
    assert errors[0] == pytest.approx(0.0, abs=1.0)
    assert errors[-1] == pytest.approx(350.0, rel=0.01)  # the mean of 200, 300, 400 and 500
    assert rank_correlation([p.uncertainty for p in places], [p.error for p in places]) > 0.8


def test_it_survives_json(judged):
    assert JudgedScene.from_json(json.loads(json.dumps(asdict(judged)))) == judged


def test_a_frame_without_true_depth_is_passed_over():
    judge = SceneJudge("dark", CAMERA)
    judge.see(2, view(0.1), np.zeros((48, 64), np.float32), camera_pose(0.0, 1.25, 0.0, 0.0), 0.25, 0.0)
    assert judge.result().frames == []


def test_a_constant_orders_nothing():
    assert rank_correlation([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]) == 0.0
    assert rank_correlation([1.0, 2.0, 3.0], [1.0, 4.0, 9.0]) == pytest.approx(1.0)
