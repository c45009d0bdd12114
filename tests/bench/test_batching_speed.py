import pytest

from deux.bench import bench_scenes
from deux.bench.batching_speed import BatchingSettings, measure_batching
from deux.bench.bench_scenes import renderers
from deux.bench.timing import Spread
from deux.collection import walk
from deux.collection.perception import Perception
from deux.contracts import Frame
from deux.errors import DeuxError
from deux.registry import registry

TINY = BatchingSettings((16,), (1, 3), places=4, seconds=0.01, walk_size=32, walks=(1, 2), steps=2, rounds=2)


@pytest.fixture
def only_embree(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_scenes, "renderers", lambda: {"embree": renderers()["embree"]})


@pytest.mark.usefixtures("tiny_models", "only_embree")
def test_every_size_of_a_batch_is_measured_against_one_by_one() -> None:
    frames, walks = measure_batching(TINY, None)
    assert [(row["renderer"], row["frames"], row["poses in a call"]) for row in frames.rows] == [
        ("embree", "depth and colour", 1),
        ("embree", "depth and colour", 3),
        ("embree", "depth", 1),
        ("embree", "depth", 3),
    ]
    assert [(row["depth model"], row["walks in lock-step"]) for row in walks.rows] == [("tiny", 1), ("tiny", 2)]
    for table, rate in ((frames, "frames per second"), (walks, "steps per second")):
        assert all(isinstance(row[rate], Spread) and row[rate].low > 0.0 for row in table.rows)
        assert table.rows[0]["times one by one"] == Spread(1.0, 1.0, 1.0)


@pytest.mark.usefixtures("tiny_models", "only_embree")
def test_all_walks_are_taken_whatever_the_number_in_lock_step(monkeypatch: pytest.MonkeyPatch) -> None:
    robots: list[int] = []

    class Counting(Perception):
        def __call__(self, histories, intrinsics, memories=None):
            robots.append(len(histories))
            return super().__call__(histories, intrinsics, memories)

    monkeypatch.setattr("deux.bench.batching_speed.Perception", Counting)
    drawn: list[Frame] = []
    observe = walk.Walk.observe
    monkeypatch.setattr(walk.Walk, "observe", lambda self: observe(self) or drawn.append(self.frames[0]))
    list(measure_batching(TINY, None))
    # Each of 1 + 2 measurements: 2 walks of 2 + 2 steps, one after the other or in lock-step.
    assert sorted(robots) == [1] * (3 * 2 * 4) + [2] * (3 * 4)
    assert len({frame.pose.tobytes() for frame in drawn}) <= 2 * 4


@pytest.mark.usefixtures("tiny_models", "only_embree")
def test_walks_are_left_out_where_no_model_is_installed() -> None:
    registry().unregister("depth_models", "tiny")
    _, walks = measure_batching(TINY, None)
    assert walks.rows == ()
    assert walks.notes == ("no depth model is installed.",)


def test_a_model_that_is_not_installed() -> None:
    with pytest.raises(DeuxError, match="no depth model called 'kbnett'"):
        list(measure_batching(TINY, "kbnett"))
