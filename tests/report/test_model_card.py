"""The card of a model: kept in a file's header, and shown as a page."""

import json

from deux.io.json_files import checked_record
from deux.report.model_card import CardErrors, ModelCard

BETTER = {"mae": 10.0, "rmse": 20.0, "imae": 3.04, "irmse": 8.0}
WORSE = {"mae": 12.5, "rmse": 30.0, "imae": 3.02, "irmse": 9.0}


def card() -> ModelCard:
    errors = tuple(
        CardErrors(frames, 7, "corners", density, 0.02, 0.0, BETTER, WORSE)
        for frames in ("Flats", "Houses")
        for density in (0.01, 0.0025)
    )
    return ModelCard("a", "kbnet", "For rooms.", "rooms", True, "python -m deux", 3, 6000, "0.1.0", "MIT", errors)


def test_a_header_holds_the_whole_card() -> None:
    assert checked_record(json.loads(card().to_json()), ModelCard, "the header") == card()


def test_the_page_tells_all_and_sets_the_lower_error_in_bold() -> None:
    page = card().markdown()
    for text in ("# a\n", "For rooms.", "supervised", "`python -m deux`", "| Seed | 3 |", "6,000", "MIT", 'load("a")'):
        assert text in page
    assert page.index("### Flats") < page.index("### Houses")
    row = "| 0.25 % | corners | 2 % | 0 % | **10.0** / 12.5 | **20.0** / 30.0 | 3.0 / **3.0** | **8.0** / 9.0 |"
    assert page.count(row) == 2
