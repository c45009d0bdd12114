import numpy as np
import pytest

from deux.contracts import Need, Reward
from deux.errors import DeuxError
from deux.testing.rewards import RewardSuite
from deux_plugins.rewards.semantic_reconstruction import SemanticReconstructionReward

WALL, CHAIR, TABLE = 0, 1, 2
NAMES = ("wall", "chair", "table")


class TestSemanticReconstructionReward(RewardSuite):
    def make_reward(self) -> Reward:
        return SemanticReconstructionReward()


class TestSemanticReconstructionRewardOfSmallPieces(RewardSuite):
    def make_reward(self) -> Reward:
        return SemanticReconstructionReward(cell=0.2, full_view=0.001, max_range=10.0)


@pytest.fixture
def look(make_experience):
    """A function from the labels of 4 x 4 pixels to the experience of a robot that has them 1 m ahead.

    Its rays pass 0.75 and 0.25 m left and right of it, so from x = 1 columns 0 to 3 lie at x = 0.25, 0.75, 1.25
    and 1.75: each in a half-metre cell of its own.
    """

    def look(labels, depth=1.0, x=1.0, z=1.25):
        depth = np.broadcast_to(np.float32(depth), (4, 4))
        return make_experience(x, z, labels=np.array(labels, np.int32), sensor_depth=depth)

    return look


def image(**columns):
    """Labels by column ("c0" to "c3"), each a label and the number of pixels from the top that have it; else wall."""
    labels = np.full((4, 4), WALL)
    for name, (label, count) in columns.items():
        labels[:count, int(name[1])] = label
    return labels


@pytest.fixture
def reward(make_episode):
    """A piece is fully seen if it fills four of the 16 pixels."""
    reward = SemanticReconstructionReward(full_view=0.25)
    reward.reset(make_episode(*NAMES))
    return reward


def test_is_the_growth_of_what_was_seen_and_how_well_by_hand(reward, look):
    assert reward(look(image())) == 0.0, "walls are no objects"
    assert reward(look(image(c0=(CHAIR, 1)))) == pytest.approx(0.25)
    assert reward(look(image(c0=(CHAIR, 1)))) == 0.0, "no better than before"
    assert reward(look(image(c0=(CHAIR, 3)))) == pytest.approx(0.5), "from a quarter to three quarters"
    assert reward(look(image(c0=(CHAIR, 2)))) == 0.0, "the best frame counts"
    # The chair is seen fully, a table beside it by half.
    assert reward(look(image(c0=(CHAIR, 4), c1=(TABLE, 2)))) == pytest.approx(0.25 + 0.5)


def test_an_object_is_counted_in_pieces_of_the_floor(reward, look):
    assert reward(look(image(c1=(CHAIR, 2), c2=(CHAIR, 2)))) == pytest.approx(1.0)
    # Half a metre to the right: column 0 and 1 now see what columns 1 and 2 saw.
    assert reward(look(image(c0=(CHAIR, 2), c1=(CHAIR, 2)), x=1.5)) == 0.0
    assert reward(look(image(c0=(TABLE, 2)), x=1.5)) == pytest.approx(0.5), "another label over the same cell"


def test_a_piece_is_not_seen_better_than_fully(reward, look):
    # 0.2 m ahead all columns fall into one cell.
    assert reward(look(np.full((4, 4), CHAIR), depth=0.2, x=1.25)) == pytest.approx(1.0)


def test_only_objects_with_depth_and_in_range_count(reward, look):
    everything = np.full((4, 4), CHAIR)
    assert reward(look(everything, depth=0.0)) == 0.0
    assert reward(look(everything, depth=3.5)) == 0.0, "beyond 3 m"
    assert reward(look(np.full((4, 4), -1))) == 0.0, "unlabelled"
    # 2.9 m ahead the outer columns are sqrt(2.9^2 + 2.175^2) = 3.6 m away, the inner ones just below 3.
    assert reward(look(everything, depth=2.9)) == pytest.approx(2.0)


@pytest.mark.parametrize("names", [(), ("wall", "floor", "ceiling", "door", "window")])
def test_scenes_without_objects_say_that_they_cannot(make_episode, names):
    with pytest.raises(DeuxError, match="needs labelled objects, but this scene has none: train in scenes with"):
        SemanticReconstructionReward().reset(make_episode(*names))


def test_it_asks_for_labels():
    assert SemanticReconstructionReward().needs == {Need.LABELS}


@pytest.mark.parametrize("option", ["cell", "full_view", "max_range"])
def test_impossible_options_are_refused(option):
    with pytest.raises(DeuxError, match=rf"semantic_reconstruction's {option} is 0\.0"):
        SemanticReconstructionReward(**{option: 0.0})
