"""What identifies many files: it changes with any of them, and with nothing else."""

import os
from pathlib import Path

import pytest

from deux.io.file_digest import file_digest


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("images/1.png", "images/2.png", "K.txt"):
        file = tmp_path / "video" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(name)
    return tmp_path / "video"


def test_it_changes_with_the_name_size_and_time_of_a_file(folder: Path) -> None:
    found = [file_digest([folder])]
    assert file_digest([folder]) == found[0]
    (folder / "K.txt").write_text("another matrix")
    found.append(file_digest([folder]))
    os.utime(folder / "K.txt", ns=(0, 5))  # corrected to the same size
    found.append(file_digest([folder]))
    (folder / "images/2.png").rename(folder / "images/3.png")
    found.append(file_digest([folder]))
    (folder / "images/1.png").unlink()
    found.append(file_digest([folder]))
    assert len(set(found)) == len(found)


def test_a_file_counts_by_itself_and_one_that_is_not_there_does_not(folder: Path) -> None:
    alone = file_digest([folder / "K.txt", folder / "none", Path("x" * 5000)])
    assert alone == file_digest([folder / "K.txt"]) != file_digest([])
    (folder / "K.txt").write_text("another matrix")
    assert file_digest([folder / "K.txt"]) != alone


def test_hidden_files_links_to_nowhere_and_what_commands_leave_there_do_not_count(folder: Path) -> None:
    found = file_digest([folder])
    (folder / "lost.png").symlink_to(folder / "none.png")
    for name in (".DS_Store", ".cache/1.png", "outputs/runs/a.json", "given/.hydra/config.yaml", "given/model"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    assert file_digest([folder], [folder / "outputs"]) == found
    assert file_digest([folder]) != found


def test_a_linked_folder_counts_and_a_circle_ends(folder: Path) -> None:
    (folder / "again").symlink_to(folder)
    found = file_digest([folder])
    link = folder.parent / "link"
    link.symlink_to(folder)
    assert file_digest([link]) == found
