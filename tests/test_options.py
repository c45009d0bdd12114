from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
from omegaconf import OmegaConf

from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.options import REQUIRED, construct, converted, describe, full_settings, options, without_defaults

if TYPE_CHECKING:
    from somewhere import Unknown


@dataclass(frozen=True)
class Lens:
    focal_length: float = 2.0


@dataclass(frozen=True)
class Everything:
    count: int
    gain: float = 1.0
    label: str = "a"
    fast: bool = False
    mode: Literal["near", "far"] = "near"
    limit: float | None = None
    size: tuple[int, int] = (4, 4)
    weights: Sequence[float] = ()
    names: list[str] = field(default_factory=list)
    folder: Path = Path(".")
    lens: Lens = Lens()
    spare: Lens | None = None
    lenses: tuple[Lens, ...] = ()


class Undeclared:
    def __init__(self, value, *, other: "Unknown" = None):  # type: ignore[no-untyped-def]
        self.value = value
        self.other = other


class Open:
    def __init__(self, known: int = 1, **more: Any) -> None:
        self.settings = {"known": known, **more}


def test_constructs_a_dataclass_of_the_framework_from_a_configuration_node() -> None:
    node = OmegaConf.create({"width": 64, "height": "${.width}", "hfov": 79})
    camera = construct(Camera, node, "camera")
    assert camera == Camera(width=64, height=64, hfov=79.0)
    assert isinstance(camera.hfov, float)


@pytest.mark.parametrize("annotation", [int | float, float | int, int | float | None])
def test_of_two_types_a_number_keeps_its_own(annotation: Any) -> None:
    for number in (1, 1.0, 2.5):
        assert type(converted(number, annotation, "share")) is type(number)


def test_simple_types_are_converted() -> None:
    settings = {
        "count": 3.0,
        "gain": 2,
        "limit": 5,
        "size": OmegaConf.create([8, 6]),
        "weights": [1, 2],
        "names": ["x"],
        "folder": "here",
        "lens": {"focal_length": 3},
    }
    made = construct(Everything, settings, "everything")
    assert made == Everything(3, 2.0, "a", False, "near", 5.0, (8, 6), (1.0, 2.0), ["x"], Path("here"), Lens(3.0))
    assert type(made.count) is int
    assert type(made.limit) is float
    assert construct(Everything, {"count": 1, "limit": None}, "everything").limit is None


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"cuont": 3}, "box.cuont is not an option of Everything: did you mean count?"),
        ({}, "Everything needs a value for box.count."),
        ({"count": "???"}, "Everything needs a value for box.count."),
        ({"count": 1.5}, "box.count must be a whole number, but is 1.5."),
        ({"count": True}, "box.count must be a whole number, but is True."),
        ({"count": 1, "gain": "high"}, "box.gain must be a number, but is 'high'."),
        ({"count": 1, "gain": float("inf"), "fast": 1}, "box.fast must be true or false, but is 1."),
        ({"count": 1, "label": 3}, "box.label must be text, but is 3."),
        ({"count": 1, "mode": "fra"}, "box.mode cannot be 'fra': did you mean far?"),
        ({"count": 1, "mode": 3}, "box.mode must be 'near' or 'far', but is 3."),
        ({"count": 1, "limit": "x"}, "box.limit must be a number or null, but is 'x'."),
        (
            {"count": 1, "size": [1, 2, 3]},
            "box.size must be a list of 2 values (a whole number, a whole number)",
        ),
        ({"count": 1, "lens": 3}, "box.lens must be options by name (focal_length), but is 3."),
        ({"count": 1, "spare": 3}, "box.spare must be options by name (focal_length) or null, but is 3."),
        ({"count": 1, "lenses": [{}, 3]}, "box.lenses must be a list (each options by name (focal_length))"),
        ({"count": 1, "lenses": [{}, {"focal_length": "x"}]}, "box.lenses[1].focal_length must be a number, but is"),
        ({"count": 1, "weights": "12"}, "box.weights must be a list (each a number), but is '12'."),
        ({"count": 1, "folder": 2}, "box.folder must be a path, but is 2."),
        (
            {"count": 1, "lens": {"focal": 2}},
            "box.lens.focal is not an option of Lens: did you mean focal_length?",
        ),
    ],
)
def test_mistakes_are_reported_in_one_sentence(settings: dict[str, Any], sentence: str) -> None:
    with pytest.raises(DeuxError) as caught:
        construct(Everything, settings, "box")
    assert str(caught.value).startswith(sentence)
    assert "\n" not in str(caught.value)


def test_infinity_is_no_whole_number() -> None:
    with pytest.raises(DeuxError, match="must be a whole number"):
        construct(Everything, {"count": float("inf")}, "box")


def test_an_interpolation_that_leads_nowhere_is_the_users_mistake() -> None:
    with pytest.raises(DeuxError, match=r"^width refers by \$\{\.\.\.\} to an option that is not there"):
        construct(Camera, OmegaConf.create({"width": "${nowhere}"}), "box")


def test_parameters_without_known_types_take_anything() -> None:
    made = construct(Undeclared, {"value": [1, "x"], "other": 2}, "it")
    assert (made.value, made.other) == ([1, "x"], 2)


def test_a_constructor_with_open_keywords_takes_any_option() -> None:
    assert construct(Open, {"known": 2, "new": 3}, "it").settings == {"known": 2, "new": 3}
    assert full_settings(Open, {"new": (3,)}) == {"known": 1, "new": [3]}


def test_full_settings_hold_the_defaults_and_do_not_depend_on_how_values_are_written() -> None:
    full = full_settings(Everything, {"count": 1, "gain": 2, "size": [8, 6]})
    assert full == full_settings(Everything, OmegaConf.create({"size": (8, 6), "gain": 2.0, "count": 1.0}))
    assert full["size"] == [8, 6]
    assert full["lens"] == {"focal_length": 2.0}
    assert full["folder"] == "."
    assert list(full)[:3] == ["count", "gain", "label"]
    with pytest.raises(DeuxError, match=r"settings\.cuont"):
        full_settings(Everything, {"cuont": 1})


def test_options_are_those_of_the_constructor() -> None:
    known = options(Everything)
    assert list(known)[:2] == ["count", "gain"]
    assert known["count"].default is REQUIRED
    assert known["gain"].default == 1.0
    assert describe(known["limit"].annotation) == "a number or null"
    assert options(object) == {}


class Color(Enum):
    RED = "red"
    BLUE = "blue"


class Own:
    def __init__(
        self,
        color: Color = Color.RED,
        labels: frozenset[str] = frozenset({"b", "a", "c"}),
        weights: np.ndarray = np.ones(3),  # noqa: B008
        count: int = np.int64(3),  # type: ignore[assignment]
        gain: float = np.float64(0.5),
    ) -> None:
        self.given = (color, labels, weights, count, gain)


class Lazy:
    def __init__(self, gain: float = 1.0, shape: Any = lambda x: x) -> None:
        self.shape = shape


def test_defaults_that_json_cannot_hold_are_written_alike_at_each_start():
    full = full_settings(Own, {})
    assert full == {
        "color": "RED",
        "labels": ["a", "b", "c"],
        "weights": [1.0, 1.0, 1.0],
        "count": 3,
        "gain": 0.5,
    }
    assert [type(full[name]) for name in ("count", "gain")] == [int, float]
    assert without_defaults(Own, full | {"gain": 0.25}) == {"gain": 0.25}


@pytest.mark.parametrize("value", [lambda x: x, object(), [object()]])
def test_a_value_whose_text_holds_an_address_is_refused(value):
    with pytest.raises(DeuxError, match=r"^explore\.shape of Lazy is .* at 0x\w+>\]?, whose text differs at each"):
        full_settings(Lazy, {"shape": value}, "explore")
    with pytest.raises(DeuxError, match=r"^explore\.shape of Lazy is <function .*> by default, whose text differs"):
        full_settings(Lazy, {"gain": 2}, "explore")
    assert without_defaults(Lazy, {"shape": "x"}) == {"shape": "x"}


@pytest.mark.parametrize("written", ["BLUE", "blue", Color.BLUE])
def test_an_enums_member_is_chosen_by_its_name_or_value(written):
    assert construct(Own, {"color": written}, "").given[0] is Color.BLUE
    assert full_settings(Own, {"color": written})["color"] == "BLUE"


@pytest.mark.parametrize(
    ("written", "sentence"),
    [("bleu", r"^explore\.color cannot be 'bleu': there is: BLUE, RED"), (3, r"must be RED or BLUE, but is 3\.$")],
)
def test_what_is_no_member_is_reported_with_the_members(written, sentence):
    with pytest.raises(DeuxError, match=sentence):
        construct(Own, {"color": written}, "explore")
