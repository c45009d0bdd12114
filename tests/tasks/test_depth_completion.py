"""A model and a measure on recorded frames: against single predictions, and Eq. 8 by OpenCV."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from deux.contracts import Action, DepthModel, FrameReference, Prediction, Uncertainty
from deux.data.frame_stream import RecordedFrame, SourceImage
from deux.geometry.camera import Camera
from deux.geometry.depth_correction import correct_depth
from deux.geometry.poses import source_from_target
from deux.registry import registry
from deux.tasks.depth_completion import DepthCompleter, batches, unusable_measure
from deux.testing.box_world import BoxWorld

CAMERA = Camera(40, 32)


class Wall(DepthModel):
    """Two metres everywhere, and a tenth of the image's red."""

    min_depth = 0.1
    max_depth = 10.0

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(2.0 + 0.1 * image[:, :1])


@pytest.fixture(scope="module")
def walk() -> list[RecordedFrame]:
    """Four frames, the last with the first two as its sources."""
    world = BoxWorld(4.0, 5.0, (), CAMERA)
    world.reset(2.0, 4.5, 0.0)
    found = []
    for action in (Action.FORWARD, Action.FORWARD, Action.LEFT, Action.FORWARD):
        world.step(action)
        seen = world.observe()
        sparse = np.where(np.random.default_rng(0).random(seen.depth.shape) < 0.05, seen.depth, np.float32(0))
        found.append(RecordedFrame(seen.rgb, sparse, CAMERA.intrinsics, seen.depth, seen.pose))
    sources = tuple(SourceImage(source.image, source_from_target(found[3].pose, source.pose)) for source in found[:2])
    return [*found[:3], replace(found[3], sources=sources)]


@pytest.mark.parametrize("measure", [None, "l1"])
def test_the_depth_is_corrected_and_the_confidence_is_the_models(walk, measure):
    measured = measure and registry().create("uncertainties", measure, {})
    plain, corrected = (DepthCompleter(Wall(), measured, corrected)([walk[3]])[0] for corrected in (False, True))
    depth, points = (torch.from_numpy(x)[None, None] for x in (plain.depth, walk[3].sparse_depth))
    np.testing.assert_allclose(corrected.depth, correct_depth(depth, points)[0, 0].numpy(), rtol=1e-5)
    assert np.abs(corrected.depth - plain.depth).max() > 0.1
    if measure:
        np.testing.assert_array_equal(corrected.confidence, plain.confidence)


def test_confidence_is_that_of_the_reconstructions(walk):
    """exp of minus the mean absolute difference from the frames that OpenCV rebuilds."""
    (completed,) = DepthCompleter(Wall(), registry().create("uncertainties", "l1", {}))([walk[3]])
    np.testing.assert_allclose(completed.depth, 2.0 + 0.1 * walk[3].image[..., 0] / 255.0, rtol=1e-6)
    points = CAMERA.rays() * completed.depth[..., None]
    errors, seen = [], np.ones(completed.depth.shape, bool)
    for source in walk[:2]:
        motion = np.linalg.inv(source.pose) @ walk[3].pose
        x, y, z = np.moveaxis((points @ motion[:3, :3].T + motion[:3, 3]) @ source.intrinsics.T, -1, 0)
        x, y = (x / z).astype(np.float32), (y / z).astype(np.float32)
        seen &= (z > 0) & (x >= 0) & (x <= CAMERA.width - 1) & (y >= 0) & (y <= CAMERA.height - 1)
        rebuilt = cv2.remap(source.image.astype(np.float32) / 255.0, x, y, cv2.INTER_LINEAR)
        errors.append(np.abs(rebuilt - walk[3].image / 255.0).mean(axis=-1))
    assert seen.mean() > 0.3
    difference = np.abs(-np.log(completed.confidence[seen]) - np.mean(errors, axis=0)[seen])
    assert np.median(difference) < 1e-3  # OpenCV knows 32 places between two pixels
    assert difference.max() < 0.05


def test_a_frame_without_neighbours_has_no_confidence(walk):
    (completed,) = DepthCompleter(Wall(), registry().create("uncertainties", "l1", {}))([walk[0]])
    assert not completed.confidence.any()
    assert (completed.depth >= 2.0).all()


@pytest.mark.parametrize("name", ["sparse_error", "flip", "hidden_points"])
def test_measures_of_single_frames_need_no_neighbours(walk, name):
    completed = DepthCompleter(Wall(), registry().create("uncertainties", name, {}))(walk[:3])
    assert len(completed) == 3
    for one in completed:
        assert one.confidence.shape == one.depth.shape
        assert 0.0 < one.confidence.min() <= one.confidence.max() <= 1.0


def test_without_a_measure_there_is_no_confidence(walk):
    assert [one.confidence for one in DepthCompleter(Wall())(walk[:2])] == [None, None]


def test_nan_means_no_confidence(walk):
    class Half(Uncertainty):
        needs_sources = False

        def __call__(self, view):
            return torch.where(view.image[:, 0] > 0.5, torch.nan, 0.0)

    (completed,) = DepthCompleter(Wall(), Half())([walk[0]])
    np.testing.assert_array_equal(completed.confidence, np.where(walk[0].image[..., 0] > 127, 0.0, 1.0))


def test_batches_hold_frames_of_one_kind(walk):
    narrow = replace(walk[0], image=walk[0].image[:, 1:])
    frames = [*walk[:3], narrow, narrow, walk[3], walk[0]]
    named = [(FrameReference("a", str(number)), frame) for number, frame in enumerate(frames)]
    found = [[int(name.name) for name, _ in batch] for batch in batches(iter(named), 2)]
    assert found == [[0, 1], [2], [3, 4], [5], [6]]


def test_a_refusal_names_the_measures_that_would_do():
    sentence = str(unusable_measure("l1", "this is one frame"))
    assert sentence.endswith(
        "and this is one frame: choose a measure of single frames, flip or hidden_points or sparse_error."
    )


def test_whoever_completes_frames_has_judged_them(walk, caplog):
    """A task looks at some frames before it begins: no batch is warned of again, and far frames end no long command."""
    matrix = np.diag([1 / CAMERA.width, 1 / CAMERA.height, 1.0]) @ walk[0].intrinsics
    far = replace(walk[0], sparse_depth=20 * walk[0].sparse_depth, intrinsics=matrix)
    assert far.sparse_depth[far.sparse_depth > 0].min() > Wall.max_depth
    assert len(DepthCompleter(Wall())([far, far])) == 2
    assert not caplog.messages
