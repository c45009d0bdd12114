"""Where frames are kept, by what is asked for, how many they are and what is free."""

import os

import pytest
import torch

from deux.data import cache_choice as choices
from deux.data.cache_choice import Placement, cache_choice, place
from deux.errors import DeuxError

CARD, CPU = torch.device("cuda", 0), torch.device("cpu")


@pytest.fixture(autouse=True)
def _six_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(6)), raising=False)


@pytest.mark.parametrize(
    ("choice", "size", "device", "expected"),
    [
        ("auto", 10, CARD, Placement("device", 0)),
        ("auto", 200, CARD, Placement("memory", 5)),  # what is in memory has to be cropped and sent
        ("auto", 10, CPU, Placement("memory", 0)),
        ("auto", 2000, CPU, Placement("memory", 5)),  # part of it is read each time
        ("device", 2000, CARD, Placement("device", 0)),
        ("device", 10, CPU, Placement("device", 0)),
        ("memory", 10, CARD, Placement("memory", 5)),
        ("none", 10, CARD, Placement("none", 5)),
        ("none", 10, CPU, Placement("none", 5)),
    ],
)
def test_placement(choice: choices.CacheChoice, size: int, device: torch.device, expected: Placement) -> None:
    assert place(choice, size, device, 100, 1000, num_workers=None) == expected


def test_the_number_of_workers_is_the_users_or_goes_by_the_cores_of_a_process() -> None:
    assert place("none", 10, CARD, 100, 1000, num_workers=3) == Placement("none", 3)
    assert place("device", 10, CARD, 100, 1000, num_workers=3) == Placement("device", 0)  # none could reach the card
    assert place("none", 10, CARD, 100, 1000, num_workers=None, processes=2) == Placement("none", 2)
    assert place("none", 10, CARD, 100, 1000, num_workers=None, processes=8) == Placement("none", 1)


def test_processes_that_train_together_decide_together() -> None:
    asked = []

    def agree(decision: bool) -> bool:
        asked.append(decision)
        return False  # it does not fit on another one's card

    assert place("auto", 10, CARD, 100, 1000, None, 1, agree) == Placement("memory", 5)
    assert asked == [True, True]
    # Whatever is chosen, each is asked equally often, so that none waits for the others' answers.
    for choice in ("device", "memory", "none"):
        asked.clear()
        place(choice, 10, CARD, 100, 1000, None, 1, agree)  # type: ignore[arg-type]
        assert len(asked) == 2


@pytest.mark.parametrize(
    ("wrong", "hint"), [("devices", "did you mean device?"), (None, "did you mean none?"), (1, "there is:")]
)
def test_another_choice_is_one_sentence(wrong: object, hint: str) -> None:
    with pytest.raises(DeuxError, match=r"^data\.cache is .*: ") as caught:
        cache_choice(wrong)
    assert hint in str(caught.value)
    assert cache_choice("memory") == "memory"
