"""JSON files: values as they are, and records by the types of a dataclass."""

from dataclasses import dataclass, field

import pytest

from deux.errors import DeuxError
from deux.io.json_files import read_json, read_json_object, read_record


@dataclass(frozen=True)
class Place:
    """What the files of these tests hold."""

    name: str
    size: tuple[float, float]
    counts: dict[str, int] = field(default_factory=dict)
    inner: "list[dict[str, float]]" = field(default_factory=list)


def test_values_and_records_are_read(tmp_path):
    (tmp_path / "a.json").write_text('{"name": "hall", "size": [1, 2.5], "counts": {"door": 2}, "inner": [{"a": 1}]}')
    assert read_json(tmp_path / "a.json")["size"] == [1, 2.5]
    assert read_record(tmp_path / "a.json", Place) == Place("hall", (1.0, 2.5), {"door": 2}, [{"a": 1.0}])
    (tmp_path / "b.json").write_text('{"a": 1}')
    assert read_record(tmp_path / "b.json", dict[str, float]) == {"a": 1.0}
    (tmp_path / "c.json").write_text('[{"name": "hall", "size": [1, 2]}]')
    assert read_record(tmp_path / "c.json", list[Place]) == [Place("hall", (1.0, 2.0))]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is damaged or not JSON"),
        ('{"a": 1', "is damaged or not JSON"),
        ("[" * 100_000, "is damaged: its JSON is nested too deeply"),
        ("9" * 10_000, "is damaged or not JSON"),
        ("[]", "contains a list where a JSON object is expected"),
        ("null", "contains null where a JSON object is expected"),
    ],
)
def test_what_is_no_object_is_refused(tmp_path, text, said):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(DeuxError, match=rf"a\.json {said}"):
        read_json_object(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"size": [1, 2]}', "needs a value for name"),
        ('{"name": 3, "size": [1, 2]}', "name must be text, but is 3"),
        ('{"name": "a", "size": [1]}', "size must be a list of 2 values"),
        ('{"name": "a", "size": [1, 2], "counts": [1]}', "counts must be names, each with a whole number"),
        ('{"name": "a", "size": [1, 2], "counts": {"door": 0.5}}', "counts must be names"),
        ('{"name": "a", "size": [1, 2], "seize": 1}', "seize is not an option of Place: did you mean size"),
        ("3", "it must be names with values, but is 3"),
    ],
)
def test_a_record_of_other_types_is_refused(tmp_path, text, said):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(DeuxError, match=rf"a\.json is damaged or of another version of deux: .*{said}"):
        read_record(tmp_path / "a.json", Place)
