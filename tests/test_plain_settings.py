"""Settings as OmegaConf holds them, made plain."""

import pytest
from omegaconf import OmegaConf

from deux.errors import DeuxError
from deux.plain_settings import plain, plain_options, references_resolved


def test_references_are_followed_and_missing_values_left_out() -> None:
    node = OmegaConf.create(
        {"camera": {"width": 64, "height": "${camera.width}"}, "root": "???", "ids": [1, "${ids[0]}"]}
    )

    assert plain(node, "run") == {"camera": {"width": 64, "height": 64}, "ids": [1, 1]}


def test_plain_values_stay_as_they_are() -> None:
    assert plain(3, "steps") == 3
    assert plain({1: "a", "b": "???"}, "names") == {"1": "a"}


@pytest.mark.parametrize(
    ("node", "sentence"),
    [
        ({"a": "${nowhere}"}, r"a refers by \$\{...\} to an option that is not there: .* write \\\$\{...\}\."),
        ({"a": "${b}", "b": "${a}"}, "run cannot be resolved: Recursive interpolation"),
        ({"a": "${b}", "b": "???"}, "run cannot be resolved: .*Missing mandatory value: b"),
        ({"a": "${unknown_resolver:1}"}, "run cannot be resolved: .*unknown_resolver"),
    ],
)
def test_a_reference_that_cannot_be_followed_is_reported_in_one_sentence(node: dict[str, str], sentence: str) -> None:
    with pytest.raises(DeuxError, match=sentence) as caught:
        plain(OmegaConf.create(node), "run")

    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [3, "text", [1, 2], None])
def test_options_by_name_are_a_mapping(value: object) -> None:
    with pytest.raises(DeuxError, match=r"camera holds options by name, as in camera\.<option>=<value>"):
        plain_options(value, "camera")


def test_a_reference_in_what_is_read_inside_is_reported_too() -> None:
    node = OmegaConf.create({"width": "${nowhere}"})

    with pytest.raises(DeuxError, match="width refers by"), references_resolved("camera"):
        _ = node.width
