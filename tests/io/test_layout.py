"""The folder layout: which files are frames, and in which order."""

from pathlib import Path

import pytest

from deux.io.layout import SequencePaths, natural_order, neighbours, without_suffix


def test_targets_have_all_their_source_frames() -> None:
    assert neighbours(["a", "b", "c", "d"], (-1, -2)) == [("c", "b", "a"), ("d", "c", "b")]
    assert neighbours(["a", "b", "c", "d"], (-1, 1)) == [("b", "a", "c"), ("c", "b", "d")]
    assert neighbours(["a", "b"], (-1, -2)) == []
    assert neighbours([str(i) for i in range(30)], (-10, 10)) == [
        (str(i), str(i - 10), str(i + 10)) for i in range(10, 20)
    ]


@pytest.mark.parametrize(
    "names",
    [
        ["frame_1", "frame_2", "frame_10", "frame_100"],
        ["1552097950.1234", "1552097950.5", "1552097951.0001", "15520979500.1"],
        ["000008", "000009", "000010"],
        ["left", "left1", "left1a", "left2", "right0"],
        ["9.25", "9.3", "10"],
    ],
)
def test_numbers_in_names_count_by_their_value(tmp_path: Path, names: list[str]) -> None:
    assert sorted({*names}, key=natural_order) == names
    (tmp_path / "image").mkdir()
    for number, name in enumerate(names):
        (tmp_path / f"image/{name}{('.png', '.jpg', '.jpeg', '.JPG')[number % 4]}").touch()
    for other in (".killed.png.tmp", ".killed.png", "notes.txt", "depth.npy"):
        (tmp_path / "image" / other).touch()
    assert SequencePaths(tmp_path).frames() == names


def test_names_of_equal_value_have_an_order_of_their_own() -> None:
    assert sorted(["01", "1", "001"], key=natural_order) == ["001", "01", "1"]


def test_an_image_is_found_by_the_name_of_its_frame(tmp_path: Path) -> None:
    paths = SequencePaths(tmp_path)
    (tmp_path / "image").mkdir()
    assert paths.recorded_image("1552097950.5") == tmp_path / "image/1552097950.5.png"
    (tmp_path / "image/1552097950.5.jpeg").touch()
    assert paths.recorded_image("1552097950.5") == tmp_path / "image/1552097950.5.jpeg"
    assert [without_suffix(name) for name in ("a.JPG", "1552097950.5.png", "1552097950.5")] == [
        "a",
        "1552097950.5",
        "1552097950.5",
    ]
