import pytest
import torch

from deux.bench.step_limits import LimitSettings, best_bandwidth, best_product_rate, measure_limits
from deux.bench.timing import Spread

TINY = LimitSettings(batch_size=1, size=32, steps=1, repeats=1)


@pytest.mark.usefixtures("tiny_models")
def test_a_step_is_described_by_its_operations_and_what_is_left_over() -> None:
    (table,) = measure_limits(TINY, "cpu")
    (row,) = table.rows
    assert (row["model"], row["poses"]) == ("tiny", "learned")
    # A 3 x 3 convolution of 4 channels to 1 over 32 x 32 pixels and the gradient of its weights; 2 a multiplication.
    assert float(str(row["GFLOP"])) == pytest.approx(2 * 2 * 9 * 4 * 32 * 32 / 1e9, abs=0.06)
    shares = {part: int(str(row[f"{part}, %"])) for part in ("products", "other operations", "rest")}
    assert sum(shares.values()) == pytest.approx(100, abs=2)
    assert min(shares.values()) >= 0
    largest = max(shares, key=shares.__getitem__)
    assert row["limited by"] == {"products": "flops", "other operations": "memory", "rest": "Python"}[largest]
    assert row["limited by"] != "flops"  # there is next to nothing to multiply
    assert isinstance(row["seconds per step"], Spread)
    assert "demanding is left out" in table.notes[1]


def test_best_rates_are_rates_of_a_machine() -> None:
    cpu = torch.device("cpu")
    assert 1.0 < best_product_rate(cpu, torch.float32, 1).median < 1e6
    assert 0.1 < best_bandwidth(cpu, 1).median < 1e4
