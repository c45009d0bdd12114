"""The card of a model: kept in a file's header, and shown as a page."""

import pytest

from deux.errors import DeuxError
from deux.report.model_card import CardErrors, ModelCard

BETTER = {"mae": 10.0, "rmse": 20.0, "imae": 3.04, "irmse": 8.0}
WORSE = {"mae": 12.5, "rmse": 30.0, "imae": 3.02, "irmse": 9.0}


def card() -> ModelCard:
    errors = [
        CardErrors(frames, 7, "corners", density, 0.02, 0.0, BETTER, WORSE)
        for frames in ("Flats", "Houses")
        for density in (0.01, 0.0025)
    ]
    return ModelCard("a", "kbnet", "For rooms.", "rooms", True, "python -m deux", 3, 6000, "0.1.0", "MIT", errors)


def test_a_card_goes_through_a_header() -> None:
    assert ModelCard.from_json(card().to_json()).to_json() == card().to_json()
    assert ModelCard.from_json(card().to_json()).errors[3].density == 0.0025


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"errors": 3}', '{"errors": [], "name": "a"}'])
def test_what_is_no_card_is_one_sentence(text: str) -> None:
    with pytest.raises(DeuxError, match="card") as error:
        ModelCard.from_json(text)
    assert "\n" not in str(error.value)


def test_the_page_tells_all_and_sets_the_lower_error_in_bold() -> None:
    page = card().markdown()
    for text in ("# a\n", "For rooms.", "supervised", "`python -m deux`", "| Seed | 3 |", "6,000", "MIT", 'load("a")'):
        assert text in page
    assert page.index("### Flats") < page.index("### Houses")
    row = "| 0.25 % | corners | 2 % | 0 % | **10.0** / 12.5 | **20.0** / 30.0 | 3.0 / **3.0** | **8.0** / 9.0 |"
    assert page.count(row) == 2
