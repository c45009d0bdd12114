import pytest
import torch

from deux.bench.published_training import PublishedSettings, measure_published_training
from deux.bench.rendered_batch import render_batch
from deux.bench.timing import Spread
from deux.geometry.tuned_forms import reference_forms
from deux.registry import registry

TINY = PublishedSettings(batch_size=1, size=32, steps=1, rounds=2)


@pytest.mark.usefixtures("tiny_models")
def test_both_ways_are_measured_in_turns() -> None:
    (table,) = measure_published_training(TINY, "cpu")
    (row,) = table.rows
    assert (row["model"], row["poses"]) == ("tiny", "learned")
    for column in ("as published, s", "deux, s", "times as fast"):
        assert isinstance(row[column], Spread)
        assert row[column].low > 0.0
    assert "demanding is left out" in table.notes[1]


@pytest.mark.parametrize("name", ["kbnet", "voiced", "scaffnet", "fusionnet"])
def test_the_published_training_computes_the_same(name: str) -> None:
    torch.manual_seed(0)
    model = registry().create("depth_models", name, {}).eval()
    batch = render_batch(model, 64, 1)
    given = (batch.image, batch.sparse_depth, batch.validity, batch.intrinsics)
    with torch.no_grad():
        ours = model(*given, **batch.prepared).depth
        with reference_forms():
            theirs = model(*given, **batch.prepared).depth
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-4)
