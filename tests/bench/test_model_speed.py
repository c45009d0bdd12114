from itertools import product

import pytest

from deux.bench.model_speed import ModelSettings, measure_models
from deux.bench.rendered_batch import render_batch
from deux.bench.step_clock import PARTS
from deux.bench.timing import Spread
from deux.registry import registry

TINY = ModelSettings(batch_size=1, size=32, steps=2, inference_size=48, rounds=2)


@pytest.mark.usefixtures("tiny_models")
def test_every_precision_and_source_of_poses_is_measured() -> None:
    steps, parts, inference = measure_models(TINY)
    variants = [("tiny", *variant) for variant in product(("float32", "bfloat16"), ("simulator", "learned"))]
    for table in (steps, parts):
        assert [(row["model"], row["precision"], row["poses"]) for row in table.rows] == variants
    for row in parts.rows:
        shares = [row[f"{part}, %"] for part in (*PARTS, "rest")]
        assert all(isinstance(share, Spread) and 0.0 < share.low <= share.high < 100.0 for share in shares)
    assert [(row["model"], row["precision"]) for row in inference.rows] == [("tiny", "float32"), ("tiny", "bfloat16")]
    times = [row["seconds per step"] for row in steps.rows] + [row["seconds per image"] for row in inference.rows]
    assert all(isinstance(time, Spread) and 0.0 < time.low <= time.median <= time.high for time in times)
    assert steps.notes[0].startswith("demanding is left out: ")


@pytest.mark.usefixtures("tiny_models")
def test_samples_are_as_in_the_contract() -> None:
    batch = render_batch(registry().create("depth_models", "tiny", {}), size=40, count=3)
    assert batch.image.shape == (3, 3, 40, 40)
    assert batch.sources.shape == (3, 2, 3, 40, 40)
    assert batch.source_from_target.shape == (3, 2, 4, 4)
    points = batch.sparse_depth > 0
    assert points.sum(dim=(1, 2, 3)).tolist() == [15] * 3  # 1500 / 160000 of the pixels
    assert batch.ground_truth is not None
    assert (batch.sparse_depth[points] == batch.ground_truth[points]).all()
    # The last action turned by 10 degrees on the spot; the one before went forward.
    assert batch.source_from_target[:, 0, :3, 3].abs().max() < 1e-5
    assert batch.source_from_target[:, 1, :3, 3].norm(dim=-1).max() == pytest.approx(0.25, abs=1e-3)
