"""Reads recordings of the Rerun viewer back, where its package is installed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Recording = dict[str, dict[int | None, dict[str, Any]]]
"""What was logged: by entity, then by frame (None where it holds for all), then by component."""


@pytest.fixture
def read_recording() -> Callable[[Path], Recording]:
    """A function from an .rrd file to what is in it; it skips the test where rerun-sdk is not installed."""
    chunks = pytest.importorskip("rerun.chunk")

    def read(path: Path) -> Recording:
        reader = chunks.RrdReader(path)
        (recording,) = reader.recordings()
        found: Recording = {}
        for chunk in reader.stream(store=recording):
            batch = chunk.to_record_batch()
            wanted = [name for name in batch.schema.names if ":" in name or name == "frame"]
            for row in batch.select(wanted).to_pylist():
                frame = row.pop("frame", None)
                logged = {name: value for name, value in row.items() if value is not None}
                found.setdefault(chunk.entity_path, {}).setdefault(frame, {}).update(logged)
        return found

    return read
