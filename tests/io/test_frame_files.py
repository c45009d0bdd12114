"""Files as the frames of a video: their order, and which belong together."""

from pathlib import Path

import pytest

from deux.errors import DeuxError
from deux.io.frame_files import list_files, matching


def test_files_are_listed_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for name in ("1.png", "12.png", "2.JPG", ".3.png", "4.txt", "depth_5.png"):
        (tmp_path / name).touch()
    assert list(list_files(tmp_path, (".png", ".jpg"))) == ["1", "2", "12", "depth_5"]
    assert set(list_files(tmp_path, (".png",), "depth_*")) == {"depth_5"}
    assert list_files(tmp_path / "none", (".png",)) == {}
    (tmp_path / "1.jpg").touch()
    with pytest.raises(DeuxError, match=r"has both 1\.jpg and 1\.png"):
        list_files(tmp_path, (".png", ".jpg"))


def test_files_belong_to_frames_by_name_and_otherwise_by_number() -> None:
    assert matching(["1", "2"], {"2": Path("b"), "3": Path("c")}) == {"2": Path("b")}
    assert matching(["rgb_1", "rgb_2"], {"d0002": Path("b"), "d0003": Path("c")}) == {"rgb_2": Path("b")}
    assert matching(["rgb_1"], {"d_1": Path("a"), "e_1": Path("b")}) == {}
    assert matching(["rgb_1"], {}) == {}


def test_what_names_leave_is_matched_by_number() -> None:
    depths = {"01": Path("a"), "02": Path("b"), "10": Path("c")}
    assert matching(["1", "2", "10"], depths) == {"1": Path("a"), "2": Path("b"), "10": Path("c")}
    assert list(matching(["1", "2", "10"], depths)) == ["1", "2", "10"]
    # The number of a frame that has its file tells no other one's.
    assert matching(["left_1", "right_1"], {"left_1": Path("a"), "mask_1": Path("b")}) == {"left_1": Path("a")}
    # Of two files with one number neither is taken, and other files do not matter.
    assert matching(["1", "2"], {"1": Path("a"), "02": Path("b"), "002": Path("c")}) == {"1": Path("a")}
    assert matching(["1", "2"], {"1": Path("a"), "02": Path("b"), "x_7": Path("c"), "y_7": Path("d")}) == {
        "1": Path("a"),
        "2": Path("b"),
    }


def test_two_frames_of_one_number_have_no_file_by_it() -> None:
    """Which of the two cameras the depth belongs to, the numbers do not tell."""
    depths = {f"depth_{number}": Path(f"d{number}") for number in (1, 2)}
    assert matching(["left_1", "left_2", "right_1", "right_2"], depths) == {}
    assert matching(["left_1", "left_2", "cover", "back"], depths) == {"left_1": Path("d1"), "left_2": Path("d2")}
