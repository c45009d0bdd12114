"""What rooms are like, over many draws."""

from collections import Counter

import pytest

from deux_plugins.scenes.houses.character import draw_character, draw_finish
from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.surfaces import Surfaces


def drawn(kind: str, count: int = 300) -> list:
    draws = Draws(0, "test")
    return [draw_character(kind, draws) for _ in range(count)]


@pytest.mark.parametrize("kind", ["study", "dining room", "workroom"])
def test_rooms_of_one_use_are_of_all_characters(kind: str):
    assert len(set(drawn(kind))) == 9
    assert min(Counter(character.surfacing for character in drawn(kind)).values()) > 40


def test_corridors_are_mostly_bare_and_storerooms_never():
    assert Counter(character.clutter for character in drawn("corridor"))["bare"] > 150
    for kind in ("storeroom", "library", "living room", "bedroom", "kitchen", "bathroom", "closet"):
        assert all(character.clutter != "bare" for character in drawn(kind))


@pytest.mark.parametrize(
    ("surfacing", "allowed"),
    [("plain", {"distemper"}), ("repeated", {"damask", "mosaic"})],
)
def test_hard_rooms_have_hard_walls(surfacing, allowed):
    style = Style(Surfaces(0), Draws(0, "style"))
    for kind in ("corridor", "kitchen", "study"):
        finishes = [draw_finish(kind, surfacing, style) for _ in range(30)]
        assert {surface.kind for finish in finishes for surface in (finish.upper, finish.lower)} <= allowed
    assert {draw_finish("kitchen", "rich", style).lower.kind for _ in range(9)} == {"wall tiles"}
