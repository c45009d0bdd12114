import pytest

from deux.errors import DeuxError
from deux.training.schedule import Schedule


def test_default_is_the_papers_schedule_stretched_over_any_run():
    schedule = Schedule()
    assert schedule.learning_rate * schedule.factor(step=99, fraction=99 / 250, epoch=0) == pytest.approx(1e-4)
    assert schedule.learning_rate * schedule.factor(step=100, fraction=100 / 250, epoch=0) == pytest.approx(5e-5)


def test_boundaries_in_epochs():
    schedule = Schedule(5e-5, boundaries=(2, 8, 20), factors=(2.0, 3.0, 0.4), unit="epoch")
    factors = [schedule.factor(step=7, fraction=0.7, epoch=epoch) for epoch in (0, 1, 2, 7, 8, 19, 20, 60)]
    assert factors == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 0.4, 0.4]


def test_warm_up_rises_linearly_to_the_rate():
    schedule = Schedule(boundaries=(), factors=(), warmup_steps=4)
    assert [schedule.factor(step, step / 100, 0) for step in range(6)] == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0, 1.0])


@pytest.mark.parametrize(
    "settings",
    [
        {"learning_rate": 0.0},
        {"learning_rate": float("nan")},
        {"factors": (-1.0,)},
        {"factors": (float("nan"),)},
        {"boundaries": (0.2, 0.4)},
        {"boundaries": (0.4, 0.2), "factors": (1.0, 2.0)},
    ],
)
def test_settings_that_make_no_schedule(settings):
    with pytest.raises(DeuxError):
        Schedule(**settings)


@pytest.mark.parametrize(
    ("unit", "boundaries", "sentence"),
    [
        (
            "fraction",
            (10.0,),
            "training.boundaries is [10.0], and with training.unit=fraction they are parts of the training, between 0 "
            "and 1: training.unit=epoch counts epochs.",
        ),
        (
            "epoch",
            (0.6, 2),
            "training.boundaries is [0.6, 2], and with training.unit=epoch they count finished epochs, whole numbers "
            "from 1 on: training.unit=fraction takes parts of the training.",
        ),
    ],
)
def test_boundaries_in_the_other_unit_are_refused(unit, boundaries, sentence):
    with pytest.raises(DeuxError) as raised:
        Schedule(boundaries=boundaries, factors=(0.5,) * len(boundaries), unit=unit)
    assert str(raised.value) == sentence
