import numpy as np
import pytest

from deux.contracts import FrameReference
from deux.errors import DeuxError
from deux.tasks.depth_completion import CompletedDepth
from deux.tasks.prediction_folder import FrameRecord, PredictionFolder

FRAMES = [
    ("../hall", "0"),
    ("/hall", "0"),
    ("a/../../hall", "0"),
    ("a/../hall", "0"),
    ("hall", "../0"),
    ("hall", ""),
    ("hall", "0" * 250),
]


def written(results: PredictionFolder, sequence: str, name: str) -> None:
    frame = FrameReference(sequence, name)
    completed = CompletedDepth(np.ones((4, 6), np.float32), None)
    results.write([(frame, completed, FrameRecord(sequence, name, (1.0, 1.0, 1.0)))])


@pytest.mark.parametrize("frame", FRAMES)
def test_nothing_is_written_outside_the_folder(tmp_path, frame):
    (tmp_path / "run").mkdir()
    results = PredictionFolder(tmp_path / "run", "png")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(DeuxError, match=r"the frame '.* of '.*' cannot be written to .*run: the reader must return"):
        written(results, *frame)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("sequence", ["hall", "house/hall", "hall.1"])
@pytest.mark.parametrize("name", ["0.5", "0" * 239])
def test_what_is_written_is_found_again(tmp_path, sequence, name):
    written(PredictionFolder(tmp_path, "png"), sequence, name)
    assert (tmp_path / "depth" / sequence / f"{name}.png").is_file()
    assert list(PredictionFolder(tmp_path, "png").records) == [FrameReference(sequence, name)]
