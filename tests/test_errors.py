"""The parts that sentences share: counts and the words that go with them."""

import pytest

from deux.errors import counted, plural


@pytest.mark.parametrize(("count", "expected"), [(0, "0 runs are"), (1, "1 run is"), (2, "2 runs are")])
def test_words_go_with_their_number(count, expected):
    assert f"{counted(count, 'run')} {plural('is', count)}" == expected


def test_verbs_and_the_last_word_of_a_noun():
    assert [plural(word, 3) for word in ("has", "does", "test frame")] == ["have", "do", "test frames"]
    assert [plural(word, 1) for word in ("has", "does", "test frame")] == ["has", "does", "test frame"]
