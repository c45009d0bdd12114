"""Files that appear whole or not at all, and what is said where they cannot be written."""

import errno
from pathlib import Path

import pytest

from deux.errors import DeuxError
from deux.io.atomic import read_text_bytes, write_atomically


def test_a_file_appears_whole_and_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    for content in (b"first", b"second"):
        write_atomically(path, content)
        assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("a" * 300, "File name too long"),
        ("file/a.txt", "Not a directory"),
        ("nowhere/a.txt", "No such file or directory"),
    ],
)
def test_what_cannot_be_written_is_one_sentence(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DeuxError) as raised:
        write_atomically(tmp_path / name, b"content")
    assert str(raised.value) == f"{tmp_path / name} cannot be written: {reason}."


def test_a_file_system_that_is_read_only_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """There nothing can be deleted either, which would be the second error while the first is told."""

    def refuse(path: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(DeuxError, match=r"a\.txt cannot be written: Read-only file system\."):
        write_atomically(tmp_path / "a.txt", b"content")


def test_what_was_there_stays_where_a_write_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.txt"
    write_atomically(path, b"old")

    def fill(self: Path, content: bytes) -> int:
        with self.open("wb") as file:
            file.write(content[:2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fill)
    with pytest.raises(DeuxError, match=r"The disk is full: .*a\.txt \(1 kB\) could not be written"):
        write_atomically(path, b"new content")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_byte_order_mark_is_no_part_of_a_text(tmp_path: Path) -> None:
    for encoding in ("utf-8", "utf-8-sig"):
        (tmp_path / "a.txt").write_text("größe\ufeff", encoding)
        assert read_text_bytes(tmp_path / "a.txt") == "größe\ufeff".encode()
