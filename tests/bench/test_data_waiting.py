import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from deux.bench.data_waiting import DataWaiting, WaitingSettings, measure_data_waiting, write_frames
from deux.bench.timing import Spread
from deux.data.dataset_reader import DatasetReader

TINY = WaitingSettings(frames=4, size=32, batch_size=2, epochs=2, rounds=1)


@pytest.mark.usefixtures("tiny_models")
def test_every_cache_is_measured() -> None:
    (table,) = measure_data_waiting(TINY)
    assert [row["data.cache"] for row in table.rows] == ["auto", "device", "memory", "none"]
    assert [row["workers"] for row in table.rows][:3] == ["0", "0", "0"]
    for row in table.rows:
        for column in ("seconds per step", "host seconds per batch", "waiting, %", "in the first epoch, %"):
            value = row[column]
            assert isinstance(value, Spread)
            assert 0.0 < value.median < 100.0


def test_frames_are_written_as_the_reader_expects_them(tmp_path: Path) -> None:
    reader = DatasetReader(write_frames(tmp_path / "f", 3, 32))
    found = [triplet for triplet in reader.triplets("train", (-1, -2)) if triplet.sources]
    assert len(found) == 3
    truth, sparse = reader.ground_truth(found[0].target), reader.sparse_depth(found[0].target)
    assert truth is not None
    assert (sparse[sparse > 0] == truth[sparse > 0]).all()
    assert reader.pose(found[0].target) is not None


def test_the_clock_tells_waiting_from_working(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)
    clock, trainer, module = DataWaiting(warm_up=1), SimpleNamespace(current_epoch=0), SimpleNamespace(device=CPU)
    events: list[tuple[float, Any]] = []
    for epoch in range(2):
        events += [(5.0, lambda epoch=epoch: vars(trainer).update(current_epoch=epoch))]
        events += [(0.0, lambda: clock.on_train_epoch_start(trainer, module))]
        for index in range(2):
            events += [
                (1.0 + epoch, lambda index=index: clock.on_train_batch_start(trainer, module, None, index)),
                (3.0, lambda index=index: clock.on_train_batch_end(trainer, module, None, None, index)),
                (7.0, lambda: clock.on_validation_end(trainer, module)),
            ]
    for seconds, event in events:
        now += seconds
        event()
    assert clock.waits() == [1.0, 2.0, 2.0]  # neither the first step nor the validations
    assert clock.host_waits() == clock.waits()
    assert clock.steps() == [3.0, 3.0, 3.0]
    assert clock.share(first_epoch=1) == pytest.approx(0.4)


class FakeEvent:
    """A card whose clock runs twice as fast as the host's."""

    def __init__(self, enable_timing: bool) -> None:
        assert enable_timing

    def record(self, stream: object) -> None:
        self.time = time.perf_counter() * 2

    def synchronize(self) -> None:
        pass

    def elapsed_time(self, later: "FakeEvent") -> float:
        return 1000.0 * (later.time - self.time)


def test_a_card_and_its_host_have_their_own_times(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)
    monkeypatch.setattr(torch.cuda, "Event", FakeEvent)
    monkeypatch.setattr(torch.cuda, "current_stream", lambda device: None)
    module = SimpleNamespace(device=torch.device("cuda"))
    clock, trainer = DataWaiting(warm_up=0), SimpleNamespace(current_epoch=0)
    clock.on_train_epoch_start(trainer, module)
    now = 3.0
    clock.on_train_batch_start(trainer, module, None, 0)
    now = 7.0
    clock.on_train_batch_end(trainer, module, None, None, 0)
    assert (clock.host_waits(), clock.waits(), clock.steps()) == ([3.0], [6.0], [8.0])


CPU = torch.device("cpu")
