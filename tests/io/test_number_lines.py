"""Text files of numbers, as several programs write them."""

from pathlib import Path

import numpy as np
import pytest

from deux.errors import DeuxError
from deux.io.number_lines import as_numbers, read_lines, read_numbers


@pytest.mark.parametrize("text", ["1 2\n3 4\n", "1,2\n3, 4", "# two rows\n1\t2\r\n\r\n 3 4", "\ufeff1 2 3 4"])
def test_blanks_commas_comments_and_byte_order_marks(tmp_path: Path, text: str) -> None:
    (tmp_path / "K.txt").write_text(text)
    np.testing.assert_array_equal(read_numbers(tmp_path / "K.txt"), [1, 2, 3, 4])


def test_lines_are_kept_apart(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_text("# x, y\n1,2\n\n3 4\n")
    assert read_lines(path) == [["1", "2"], ["3", "4"]]
    np.testing.assert_array_equal(as_numbers(read_lines(path), path), [[1, 2], [3, 4]])


@pytest.mark.parametrize("content", [b"fx 525", b"\xff\xfe\x00", b"[1, 2]"])
def test_what_is_no_number_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "K.txt").write_bytes(content)
    with pytest.raises(DeuxError, match=r"K\.txt is not a text file of numbers\."):
        read_numbers(tmp_path / "K.txt")
