"""Printed commands mean what they are made of, to the shell and to Hydra."""

import shlex
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from deux.tasks.command_lines import command_line

VALUES = [
    1,
    0.25,
    1e-06,
    None,
    True,
    "true",
    "1e5",
    "12",
    "2024_01_15",
    "rgbd_folder",
    "/data/old room/a=b, (c)",
    "it's",
    'say "so"',
    ["office", "room 2", 3],
    {"a": [1, None], "b": "x y"},
    [],
    "",
]


@pytest.mark.parametrize("value", VALUES, ids=repr)
def test_an_option_comes_back(value: object) -> None:
    words = shlex.split(command_line({"task": "evaluate", "data.x": value}))
    assert words[:4] == ["python", "-m", "deux", "task=evaluate"]
    assert OverridesParser.create().parse_override(words[4]).value() == value


def test_what_needs_no_quotes_has_none() -> None:
    printed = command_line({"task": "evaluate", "data": "rgbd_folder", "evaluation.data": Path("/data/a-b/lounge.1")})
    assert printed == "python -m deux task=evaluate data=rgbd_folder evaluation.data=/data/a-b/lounge.1"
