import math

import numpy as np
import pytest

from deux.contracts import Reward
from deux.environment.egocentric import Crops
from deux.environment.memory import ExplorationMemory
from deux.testing.box_world import BoxWorld
from deux.testing.rewards import RewardSuite, rewards_of, rooms
from deux_plugins.rewards.coverage import CoverageReward, SmoothCoverageReward


class TestCoverageReward(RewardSuite):
    def make_reward(self) -> Reward:
        return CoverageReward()


class TestSmoothCoverageReward(RewardSuite):
    def make_reward(self) -> Reward:
        return SmoothCoverageReward()


def test_coverage_is_the_growth_of_the_known_area_by_hand(make_experience, make_episode):
    reward = CoverageReward()
    reward.reset(make_episode())
    reward(make_experience(occupancy=[[0, 2], [1, 0]], resolution=0.5))
    # A wall and a free cell more: two cells of 0.25 square metres.
    assert reward(make_experience(occupancy=[[2, 2], [1, 1]], resolution=0.5)) == pytest.approx(0.5)
    # What is known may change its mind; that is no growth.
    assert reward(make_experience(occupancy=[[1, 2], [2, 1]], resolution=0.5)) == 0.0
    # The grid grew around the four known cells, and one cell became known.
    grown = [[0, 0, 0, 0], [0, 1, 2, 0], [0, 2, 1, 1], [0, 0, 0, 0]]
    assert reward(make_experience(occupancy=grown, resolution=0.5)) == pytest.approx(0.25)


def test_the_coverage_of_an_episode_adds_up_to_what_is_known_at_its_end(make_experience, make_episode):
    reward = CoverageReward()
    values = rewards_of(reward, rooms, 60)
    assert all(value >= 0.0 for value in values)
    assert sum(values[1:]) > 0.5, "square metres that were not in the first look"
    assert sum(values) < 7.0 * 5.0, "the rooms have 6 x 4 m"


def test_smooth_coverage_is_the_mean_over_the_cells_now_seen_by_hand(make_experience, make_episode):
    reward = SmoothCoverageReward()
    reward.reset(make_episode())
    views, seen = [[1, 4], [9, 100]], [[True, True], [True, False]]
    # (1 + 1/2 + 1/3) / 3; the cell with a hundred views is not seen now.
    assert reward(make_experience(views=views, seen=seen)) == pytest.approx(11.0 / 18.0)
    assert reward(make_experience(views=views, seen=np.zeros((2, 2)))) == 0.0


def test_the_nth_look_at_one_place_is_worth_one_over_the_root_of_n(make_experience, make_episode):
    """With the map's own counts: a wall and a floor that are looked at again and again."""
    world = BoxWorld(4.0, 4.0)
    memory = ExplorationMemory(world.camera, world.robot, Crops())
    reward = SmoothCoverageReward()
    reward.reset(make_episode())
    for look in range(1, 6):
        memory.see(world.observe().depth, world.pose, False)
        known = memory.occupancy
        value = reward(make_experience(occupancy=known.cells, views=known.views, seen=known.seen))
        assert value == pytest.approx(1.0 / math.sqrt(look))
