import math

import pytest

from deux.contracts import Reward
from deux.errors import DeuxError
from deux.testing.rewards import RewardSuite
from deux_plugins.rewards.novelty import NoveltyReward


class TestNoveltyReward(RewardSuite):
    def make_reward(self) -> Reward:
        return NoveltyReward()


def test_is_one_over_the_root_of_the_visits_by_hand(make_experience, make_episode):
    reward = NoveltyReward()
    reward.reset(make_episode())
    visits = [
        ((0.1, 0.1), 1.0),
        ((0.4, 0.3), 1.0 / math.sqrt(2.0)),  # the same half-metre cell
        ((0.6, 0.3), 1.0),  # its neighbour along x
        ((0.1, 0.7), 1.0),  # and along z
        ((-0.1, 0.1), 1.0),  # across the origin
        ((-0.1, -0.1), 1.0),
        ((0.49, 0.49), 1.0 / math.sqrt(3.0)),
        ((-0.4, 0.4), 1.0 / math.sqrt(2.0)),
    ]
    for (x, z), expected in visits:
        assert reward(make_experience(x, z)) == pytest.approx(expected)


def test_the_first_look_is_a_visit_and_turning_on_the_spot_is_another(make_experience, make_episode):
    reward = NoveltyReward()
    reward.reset(make_episode())
    reward(make_experience(1.0, 1.0, action=None))
    values = [reward(make_experience(1.0, 1.0, action=1)) for _ in range(3)]
    assert values == pytest.approx([1 / math.sqrt(2), 1 / math.sqrt(3), 1 / 2])


def test_the_cell_is_an_option(make_experience, make_episode):
    reward = NoveltyReward(cell=1.0)
    reward.reset(make_episode())
    assert [reward(make_experience(x, 0.5)) for x in (0.2, 0.7, 1.2)] == pytest.approx([1.0, 1 / math.sqrt(2), 1.0])


@pytest.mark.parametrize("cell", [0.0, -1.0, math.nan])
def test_an_impossible_cell_is_refused(cell):
    with pytest.raises(DeuxError, match=r"cell is (0\.0|-1\.0|nan)"):
        NoveltyReward(cell=cell)
