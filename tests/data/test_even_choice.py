from itertools import pairwise

import pytest

from deux.data.even_choice import evenly_chosen


@pytest.mark.parametrize(("count", "most"), [(1, 5), (5, 5), (6, 5), (100, 7), (3, 1)])
def test_gaps_differ_by_one_at_most_and_both_ends_are_there(count, most):
    chosen = evenly_chosen(range(count), most)
    assert len(chosen) == min(count, most)
    assert chosen[0] == 0
    assert chosen[-1] == count - 1 or most == 1
    gaps = {second - first for first, second in pairwise(chosen)}
    assert not gaps or max(gaps) - min(gaps) <= 1


def test_of_nothing_there_is_nothing():
    assert evenly_chosen([], 4) == []
