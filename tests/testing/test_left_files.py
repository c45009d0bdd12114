import json
from pathlib import Path

import pytest

from deux.testing.left_files import differences, digests


@pytest.fixture
def write(tmp_path):
    """Write files into a folder: write("run", {"a.png": b"1", ...}) returns the folder."""

    def make(name: str, files: dict[str, bytes]) -> Path:
        for path, content in files.items():
            (tmp_path / name / path).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name / path).write_bytes(content)
        return tmp_path / name

    return make


RUN = {"run/model.safetensors": b"weights", "run/results.json": b'{"mae": 1.5, "seconds": {"train": 3}}'}


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({}, []),
        ({"run/results.json": b'{"mae": 1.5, "seconds": {"train": 4}}'}, []),
        ({"run/results.json": b'{"mae": 1.6, "seconds": {"train": 3}}'}, ["run/results.json differs"]),
        ({"run/model.safetensors": b"Weights"}, ["run/model.safetensors differs"]),
        ({"run/.results.json.tmp": b""}, ["run/.results.json.tmp is left over"]),
        ({"run/.lock.json": b"{}"}, ["run/.lock.json is left over"]),
        ({"run/logs/version_1/metrics.csv": b"", "run/deux.log": b"", "run/seconds.json": b"{}"}, []),
    ],
)
def test_what_differs(write, changes, found):
    assert differences(digests(write("unbroken", RUN)), digests(write("resumed", RUN | changes))) == found


def test_a_file_that_is_missing(write):
    less = {"run/results.json": RUN["run/results.json"]}
    assert differences(digests(write("unbroken", RUN)), digests(write("resumed", less))) == [
        "run/model.safetensors is missing"
    ]


def test_of_a_file_that_varies_only_the_name_counts(write):
    other, varying = RUN | {"run/model.safetensors": b"other"}, ("*/model.safetensors",)
    found = [digests(write(name, files), varying) for name, files in (("unbroken", RUN), ("resumed", other))]
    assert differences(*found) == []
    assert found[0]["run/model.safetensors"] == ""
    del found[1]["run/model.safetensors"]
    assert differences(*found) == ["run/model.safetensors is missing"]


def test_times_are_left_out_at_any_depth(write):
    entries = [{"rounds": [{"seconds": seconds, "frames": 6}]} for seconds in (1, 2)]
    folders = [write(str(number), {"a.json": json.dumps(one).encode()}) for number, one in enumerate(entries)]
    assert digests(folders[0]) == digests(folders[1])
