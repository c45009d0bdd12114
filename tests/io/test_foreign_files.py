"""YAML and folders that somebody else made."""

from pathlib import Path

import pytest
import yaml

from deux.io.foreign_files import DEEPEST, MOST_BYTES, read_yaml, walk


def test_plain_values_are_read_and_references_stay_text(tmp_path: Path) -> None:
    content = {"seed": 1, "name": "${oc.env:HOME}", "list": [1.5, None, {"a": "${seed}"}]}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(content))
    assert read_yaml(tmp_path / "config.yaml") == content


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a [x, x]\n" + "".join(f"k{n}: &k{n} [*a, *a]\n" for n in range(9)), "it has YAML anchors"),
        ("a: &a\n  b: *a\n", "it has YAML anchors"),
        (10_000 * "[", f"it has more than {DEEPEST} levels"),
        ("x" * (MOST_BYTES + 1), f"it has more than {MOST_BYTES} bytes"),
        ("a: !!python/object/apply:os.system [touch marker]\n", "could not determine a constructor"),
        ("a: [1\n", "while parsing a flow sequence"),
        ("a: 2026-99-99\n", "month must be in 1..12"),
    ],
)
def test_what_is_no_plain_yaml_is_refused_at_once(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_yaml(tmp_path / "config.yaml")


def test_links_in_circles_are_walked_once(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / ".hidden").mkdir()
    (tmp_path / "a" / "b" / "file").touch()
    for name in ("one", "two", "three"):  # three links up: 3^40 paths before the system stops to follow them
        (tmp_path / "a" / name).symlink_to(tmp_path)
    found = list(walk(tmp_path))
    assert [folder.relative_to(tmp_path).as_posix() for folder, _, _ in found] == [".", "a", "a/b"]
    assert found[-1][2] == ["file"]
