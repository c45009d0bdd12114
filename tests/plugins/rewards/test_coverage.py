import pytest

from deux.contracts import Reward
from deux.testing.rewards import RewardSuite, judge, rooms
from deux_plugins.rewards.coverage import CoverageReward


class TestCoverageReward(RewardSuite):
    def make_reward(self) -> Reward:
        return CoverageReward()


def test_is_the_growth_of_the_known_area_by_hand(make_experience, make_episode):
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


def test_the_rewards_of_an_episode_add_up_to_what_is_known_at_its_end(make_experience, make_episode):
    reward = CoverageReward()
    values = judge(reward, rooms, 60)
    assert all(value >= 0.0 for value in values)
    assert sum(values[1:]) > 0.5, "square metres that were not in the first look"
    assert sum(values) < 7.0 * 5.0, "the rooms have 6 x 4 m"
