from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch

from deux.contracts import DEPTH, Action, Episode, Observation
from deux.environment.egocentric import Crops
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.policies.learned_explorer import LearnedExplorer
from deux.policies.network import PolicyNetwork
from deux.policies.policy_files import policy_identity, save_policy
from deux.testing.box_world import BoxWorld
from deux.testing.explorers import run, two_rooms
from deux.testing.learned_explorers import untrained_policy

CROPS = Crops(pixels=16)


class Learned(LearnedExplorer):
    reward = "coverage"


def explorer(tmp_path, bias=(0.0, 0.0, 0.0), after_collision=(0.0, 0.0, 0.0), **options):
    """An explorer whose moves have these logits, and others added after a collision."""
    policy = untrained_policy(CROPS)
    network = policy.network
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
        network.encoder.join[0].weight[0, -1] = 1.0  # the first feature is whether the last move was cut short
        network.action.weight[:, 0] = torch.tensor(after_collision)
        network.action.bias[:] = torch.tensor(bias)
    path = tmp_path / "policy.safetensors"
    save_policy(path, policy)
    return Learned(str(path), **options)


def test_moves_are_drawn_as_the_policy_weighs_them(tmp_path):
    chances = np.array([0.5, 0.2, 0.3])
    world = BoxWorld(60.0, 60.0, camera=Camera(8, 8))
    counts = Counter(run(explorer(tmp_path, tuple(np.log(chances).tolist())), world, 600))
    found = np.array([counts[action] for action in (Action.FORWARD, Action.LEFT, Action.RIGHT)]) / 600
    # Four standard deviations of a share are 0.08.
    assert np.abs(found - chances).max() < 0.08
    assert counts[Action.STOP] == 0


def test_the_likeliest_move_is_taken_if_it_is_greedy(tmp_path):
    actions = run(explorer(tmp_path, (0.0, 0.01, -0.01), greedy=True), two_rooms(), 20)
    assert set(actions) == {Action.LEFT}


def test_the_policy_sees_the_last_collision(tmp_path):
    """Forward, but to the right after a collision: it follows the walls."""
    world = BoxWorld(3.0, 3.0)
    collided = []

    def note(observation):
        collided.append(observation.collided)
        return observation

    actions = run(explorer(tmp_path, (9.0, 0.0, 0.0), (-18.0, 0.0, 18.0), greedy=True), world, 40, change=note)
    assert any(collided)
    assert actions == [Action.RIGHT if touched else Action.FORWARD for touched in collided]


def test_it_sees_what_the_environment_shows_in_training(tmp_path, make_environment, monkeypatch):
    """The same moves in the environment, those of the recovery too, give the same views, scaled to [0, 1]."""
    environment = make_environment(steps=200)()
    shown, _ = environment.reset(seed=3)
    simulator = environment.simulator
    views = []

    def record(self, view):
        views.append({name: part[0].numpy() for name, part in view.items()})
        return torch.zeros(1, 3)

    monkeypatch.setattr(PolicyNetwork, "forward", record)
    learned = explorer(tmp_path)
    learned.reset(Episode(0, 200, simulator.camera, simulator.robot))
    collided, asked = False, []
    for step in range(180):
        rgb = np.zeros((1, 1, 3), np.uint8)
        before = len(views)
        action = learned.act(
            Observation(step, simulator.pose, collided, rgb, sensor_depth=simulator.observe(DEPTH).depth)
        )
        asked.append(len(views) > before)
        for name, part in shown.items():
            scale = 255.0 if part.dtype == np.uint8 else 1.0
            if asked[-1]:
                np.testing.assert_array_equal(views[-1][name], (part / scale).astype(np.float32))
        shown, _, _, _, info = environment.step(np.int64(action))
        collided = info["collided"]
    assert any(view["body"][3] for view in views), "it ran into something now and then"
    assert any(np.diff(asked, prepend=True)), "it was stuck, and the policy was asked again afterwards"


def test_the_policy_is_not_asked_while_the_robot_is_stuck(tmp_path):
    """Forward whatever it sees, in a corner: two actions fail, then it turns away; it does not push 30 times."""
    world = BoxWorld(3.0, 3.0)
    world.reset(0.12, 0.12, np.pi / 4.0)
    actions = run(explorer(tmp_path, (9.0, 0.0, 0.0), greedy=True), world, 30)
    assert actions[:2] == [Action.FORWARD, Action.FORWARD]
    assert actions[2] in (Action.LEFT, Action.RIGHT)


def test_crops_and_cells_are_those_of_the_policy_file(tmp_path):
    path = tmp_path / "policy.safetensors"
    save_policy(path, replace(untrained_policy(Crops(near=2.0, far=6.0, pixels=8)), resolution=0.25))
    learned = Learned(str(path))
    run(learned, two_rooms(), 3)
    assert learned.map().frame.resolution == 0.25


def test_its_map_is_that_of_the_rooms(tmp_path):
    learned = explorer(tmp_path, (0.0, 5.0, 0.0))
    run(learned, two_rooms(), 40)
    known = learned.map()
    free = known.occupancy == 2
    rows, columns = np.nonzero(free)
    x, z = known.frame.origin_x + columns * 0.1, known.frame.origin_z + rows * 0.1
    assert free.sum() * 0.01 > 5.0
    assert (two_rooms().clearance(x + 0.05, z + 0.05) > -0.15).mean() > 0.99
    before = known.occupancy.copy()
    learned.act(
        Observation(40, two_rooms().pose, False, np.zeros((1, 1, 3)), sensor_depth=two_rooms().observe(DEPTH).depth)
    )
    np.testing.assert_array_equal(known.occupancy, before)


def test_its_fingerprint_is_that_of_its_policy_file(tmp_path):
    learned = explorer(tmp_path)
    assert learned.fingerprint() == policy_identity(tmp_path / "policy.safetensors")


def test_the_shipped_policy_is_taken_unless_one_is_named(tmp_path, monkeypatch):
    explorer(tmp_path, (0.0, 9.0, 0.0))
    monkeypatch.setattr(Learned, "shipped_weights", tmp_path / "policy.safetensors", raising=False)
    assert set(run(Learned(greedy=True), two_rooms(), 3)) == {Action.LEFT}


def test_a_policy_file_in_the_home_folder_is_found(tmp_path, monkeypatch):
    found = explorer(tmp_path).fingerprint()
    monkeypatch.setenv("HOME", str(tmp_path))
    assert Learned("~/policy.safetensors").fingerprint() == found


def test_a_missing_policy_file_is_reported_when_the_episode_begins(tmp_path):
    learned = Learned(str(tmp_path / "missing.safetensors"))
    for ask in (learned.fingerprint, lambda: run(learned, two_rooms(), 1)):
        with pytest.raises(DeuxError, match=r"there is no policy file .*missing\.safetensors"):
            ask()
