"""Walking through folders with links."""

from pathlib import Path

from deux.io.folder_walk import walk


def test_links_in_circles_are_walked_once(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / ".hidden").mkdir()
    (tmp_path / "a" / "b" / "file").touch()
    for name in ("one", "two", "three"):  # three links up: 3^40 paths before the system stops to follow them
        (tmp_path / "a" / name).symlink_to(tmp_path)
    found = list(walk(tmp_path))
    assert [folder.relative_to(tmp_path).as_posix() for folder, _, _ in found] == [".", "a", "a/b"]
    assert found[-1][2] == ["file"]
