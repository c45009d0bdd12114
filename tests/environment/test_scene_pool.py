from dataclasses import replace

import numpy as np
import pytest

from deux.contracts import COLOR, DEPTH, Action, Channel, Floor
from deux.environment.scene_pool import ScenePool
from deux.errors import DeuxError
from deux.simulator.starts import random_starts


def placed(simulator, seed=0):
    simulator.reset(*random_starts(simulator.free_space(), 1, np.random.default_rng(seed))[0])
    return simulator


def test_robots_of_one_scene_share_it_and_move_on_their_own(references, simulation):
    pool = ScenePool(simulation)
    first, second = pool.simulator(references[0]), pool.simulator(references[0])
    assert references[0].asked == ["a"], "loaded once"
    assert first.scene is second.scene
    assert first.free_space() is second.free_space()
    placed(first, 0), placed(second, 1)
    pose, depth = second.pose, second.observe(DEPTH).depth
    for _ in range(3):
        first.step(Action.LEFT)
        first.observe(DEPTH)
    np.testing.assert_array_equal(second.pose, pose)
    np.testing.assert_array_equal(second.observe(DEPTH).depth, depth)
    with pytest.raises(DeuxError, match=r"call reset\(\)"):
        pool.simulator(references[0]).observe(DEPTH)


def test_the_scene_that_was_used_longest_ago_makes_room(references, simulation):
    pool = ScenePool(simulation, most=2)
    a, b, c = references
    for reference in (a, b, a, c, a, b):
        pool.simulator(reference)
    assert (len(a.asked), len(b.asked), len(c.asked)) == (1, 2, 1)


def test_a_flat_without_its_textures_has_the_same_depth_and_labels(references, simulation):
    whole, bare = (
        placed(ScenePool(simulation, colors).simulator(references[0])).observe(COLOR | {Channel.LABELS})
        for colors in (True, False)
    )
    np.testing.assert_array_equal(whole.depth, bare.depth)
    np.testing.assert_array_equal(whole.labels, bare.labels)
    assert not np.array_equal(whole.rgb, bare.rgb)
    assert any(material.texture is not None for material in references[0].scene.mesh.materials), "it is a copy"


def test_a_scene_without_floor_is_reported_when_a_robot_is_put_there(references, simulation):
    reference = replace(references[0], scene=replace(references[0].scene, floors=(Floor(50.0, 1.0),)))
    with pytest.raises(DeuxError, match="floor"):
        placed(ScenePool(simulation).simulator(reference))
