from dataclasses import replace

import numpy as np
import pytest

from deux.contracts import Action, Robot
from deux.environment.scene_pool import ScenePool
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.simulator.starts import random_starts

CAMERA = Camera(32, 32)


def placed(simulator, seed=0):
    simulator.reset(*random_starts(simulator.free_space(), 1, np.random.default_rng(seed))[0])
    return simulator


def test_robots_of_one_scene_share_it_and_move_on_their_own(references):
    pool = ScenePool(CAMERA, Robot())
    first, second = pool.simulator(references[0]), pool.simulator(references[0])
    assert references[0].asked == ["a"], "loaded once"
    assert first.scene is second.scene
    assert first.free_space() is second.free_space()
    placed(first, 0), placed(second, 1)
    pose, depth = second.pose, second.depth()
    for _ in range(3):
        first.step(Action.LEFT)
        first.depth()
    np.testing.assert_array_equal(second.pose, pose)
    np.testing.assert_array_equal(second.depth(), depth)
    with pytest.raises(DeuxError, match="call reset"):
        pool.simulator(references[0]).depth()


def test_the_scene_that_was_used_longest_ago_makes_room(references):
    pool = ScenePool(CAMERA, Robot(), most=2)
    a, b, c = references
    for reference in (a, b, a, c, a, b):
        pool.simulator(reference)
    assert (len(a.asked), len(b.asked), len(c.asked)) == (1, 2, 1)


def test_a_flat_without_its_textures_has_the_same_depth_and_labels(references):
    whole, bare = (placed(ScenePool(CAMERA, Robot(), textured).simulator(references[0])) for textured in (True, False))
    ours, theirs = whole.observe(labels=True), bare.observe(labels=True)
    np.testing.assert_array_equal(ours.depth, theirs.depth)
    np.testing.assert_array_equal(ours.labels, theirs.labels)
    assert not np.array_equal(ours.rgb, theirs.rgb)
    textures = [material.texture for material in bare.scene.mesh.materials]
    assert textures == [None] * len(whole.scene.mesh.materials)
    assert any(material.texture is not None for material in references[0].scene.mesh.materials), "it is a copy"


def test_a_scene_without_floor_is_told_when_it_is_asked_for(references):
    reference = replace(references[0], scene=replace(references[0].scene, floor_height=50.0))
    with pytest.raises(DeuxError, match="floor"):
        ScenePool(CAMERA, Robot()).simulator(reference)
