"""YAML files from outside."""

from pathlib import Path

import pytest
import yaml

from deux.errors import DeuxError
from deux.io.yaml_files import DEEPEST, MOST_BYTES, read_yaml


def test_plain_values_are_read_and_references_stay_text(tmp_path: Path) -> None:
    content = {"seed": 1, "name": "${oc.env:HOME}", "list": [1.5, None, {"a": "${seed}"}]}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(content))
    assert read_yaml(tmp_path / "config.yaml") == content


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a [x, x]\n" + "".join(f"k{n}: &k{n} [*a, *a]\n" for n in range(9)), "has YAML anchors"),
        ("a: &a\n  b: *a\n", "has YAML anchors"),
        (10_000 * "[", "nesting"),
        (100 * "[" + 100 * "]", f"has more than {DEEPEST} levels"),
        ("x" * (MOST_BYTES + 1), f"has more than {MOST_BYTES:,} bytes"),
        ("a: !!python/object/apply:os.system [touch marker]\n", "could not determine a constructor"),
        ("a: [1\n", "while parsing a flow sequence"),
        ("a: 2026-99-99\n", "month must be in 1..12"),
    ],
)
def test_what_is_no_plain_yaml_is_refused_at_once(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(DeuxError, match=message):
        read_yaml(tmp_path / "config.yaml")
