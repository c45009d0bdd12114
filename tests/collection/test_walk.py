import numpy as np
import pytest
from toy_world import ToyScene, ToySimulator, Wanderer, guided_explorer

from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.collection.perception import Percept
from deux.collection.walk import Walk
from deux.contracts import Action, Need
from deux.io.frames import read_frame


def walked(explorer: Wanderer, seed: int = 5, steps: int = 12) -> list[np.ndarray]:
    walk = Walk(ToySimulator(), explorer, seed, steps)
    poses = []
    while not walk.over:
        frame = walk.frame()
        poses.append(frame.pose)
        walk.act(frame)
    return poses


def test_it_goes_where_the_collector_goes(tmp_path):
    plan = EpisodePlan(tmp_path / "room-00", ToyScene(), seed=5, steps=12)
    explore([plan], ToySimulator, Wanderer)
    poses = walked(Wanderer())
    assert len(poses) == 12
    for step, pose in enumerate(poses):
        np.testing.assert_array_equal(read_frame(plan.paths, step, labels=False).pose, pose)


def test_an_explorer_is_shown_what_it_declared_and_no_more():
    bare, guided = Wanderer(), guided_explorer()
    walked(bare)
    assert bare.episode.free_space is None
    assert (bare.seen[0].sensor_depth, bare.seen[0].labels, bare.episode.label_names) == (None, None, ())
    percept = Percept(np.ones((40, 48), np.float32), np.zeros((40, 48), np.float32), 0.25)
    walk = Walk(ToySimulator(), guided, seed=5, steps=2)
    walk.act(walk.frame(), percept)
    seen = guided.seen[0]
    assert (seen.uncertainty, seen.predicted_depth.mean(), guided.episode.label_names) == (0.25, 1.0, ("x", "y", "z"))
    assert seen.labels.shape == seen.sensor_depth.shape == (40, 48)
    privileged = Wanderer(frozenset({Need.FREE_SPACE}))
    walked(privileged)
    assert privileged.episode.free_space.area == pytest.approx(5.4 * 3.4)


def test_it_ends_when_the_explorer_stops_or_the_steps_are_used_up():
    assert len(walked(Wanderer(stop_after=3))) == 4
    walk = Walk(ToySimulator(), Wanderer(), seed=5, steps=1)
    before = walk.simulator.state
    walk.act(walk.frame())
    assert (walk.over, walk.step, walk.simulator.state) == (True, 1, before)


def test_collisions_are_told(monkeypatch):
    monkeypatch.setattr(Wanderer, "act", lambda self, observation: self.seen.append(observation) or Action.FORWARD)
    explorer = Wanderer()
    poses = walked(explorer, steps=40)  # ten metres ahead, in a room of six
    moved = np.linalg.norm(np.diff([pose[:3, 3] for pose in poses], axis=0), axis=1)
    assert [seen.collided for seen in explorer.seen[1:]] == [bool(distance < 0.249) for distance in moved]
    assert explorer.seen[-1].collided
