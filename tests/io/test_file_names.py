import os

import pytest

from deux.io.file_names import is_file_name, is_frame_path, is_within

NAMES = ("a", "a b.png", "ä", "n" * 255, "n" * 256, "ä" * 200, "", ".", "..", "a/b", "a\0b", ".hidden")


@pytest.mark.parametrize("name", NAMES)
def test_names_are_those_that_the_file_system_takes(tmp_path, name):
    try:
        (tmp_path / name).touch(exist_ok=False)
        made = (tmp_path / name).parent == tmp_path
    except (OSError, ValueError):
        made = False
    assert is_file_name(name) == made


@pytest.mark.parametrize(
    "name",
    ["a", "a/b", "./a", "a/../b", "a/./b", "..", "../a", "a/../../b", "/a", "", ".", "a/../..", f"{'n' * 300}/a"],
)
def test_paths_within_a_folder_stay_there_when_they_are_resolved(tmp_path, name):
    there = os.path.realpath(tmp_path / name)
    below = there.startswith(f"{os.path.realpath(tmp_path)}{os.sep}") and not os.path.isabs(name)
    assert is_within(name) == (below and len(name) < 256)


@pytest.mark.parametrize(
    ("sequence", "name", "whole"),
    [
        ("hall", "1", True),
        ("house/hall", "1.5", True),
        ("./hall", "1", True),
        ("a/../hall", "1", False),
        ("..", "1", False),
        ("/hall", "1", False),
        ("", "1", False),
        ("hall", "..", False),
        ("hall", "a/1", False),
        ("hall", "", False),
        ("hall", "n" * 239, True),
        ("hall", "n" * 240, False),
    ],
)
def test_frames_have_a_file_of_their_own(sequence, name, whole):
    assert is_frame_path(sequence, name) == whole
