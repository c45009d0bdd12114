import csv

import pytest

from deux.errors import DeuxError
from deux.io.csv_files import number, read_table


def test_rows_come_back_by_name(tmp_path):
    path = tmp_path / "a.csv"
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([["step", "loss"], [1, 0.5], [2, 'a "b"\n,c'], [3]])
    rows = read_table(path, "step")
    assert rows == [{"step": "1", "loss": "0.5"}, {"step": "2", "loss": 'a "b"\n,c'}, {"step": "3", "loss": ""}]
    assert number(rows[0], "loss", path) == 0.5


@pytest.mark.parametrize("content", [b"", b"a\n1\n", b"\xff\xfe", b"step\n" + b"9" * 200_000])
def test_other_tables_are_refused(tmp_path, content):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(DeuxError, match=r"a\.csv is damaged"):
        read_table(tmp_path / "a.csv", "step")


def test_what_is_no_number_is_named(tmp_path):
    with pytest.raises(DeuxError, match="its column loss contains 'x' where a number is expected"):
        number({"loss": "x"}, "loss", tmp_path / "a.csv")
