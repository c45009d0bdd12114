"""Speed of the depth models' inference."""

from collections.abc import Mapping, Sequence
from functools import partial

import torch
from torch import Tensor

from deux.bench.report import Table, Value
from deux.bench.samples import render_batch
from deux.bench.timing import Spread, Stopwatch, in_turn, times_the_slowest
from deux.contracts import DepthModel

PRECISIONS = {"float32": torch.float32, "bfloat16": torch.bfloat16}
"""What the networks' layers compute in."""


def measure_inference(models: Mapping[str, DepthModel], size: int, rounds: int, notes: Sequence[str]) -> Table:
    """Predict the depth of one image at a time, from points as sampled to metres.

    Args:
        models: the depth models by name.
        size: height and width of the image in pixels.
        rounds: number of times that each is measured.
        notes: for the table.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    calls = {}
    for name, model in models.items():
        batch = render_batch(model, size, count=1)
        inputs = [tensor.to(device) for tensor in (batch.image, batch.sparse_depth, batch.intrinsics)]
        for precision, dtype in PRECISIONS.items():
            calls[name, precision] = partial(_seconds, model.eval().to(device), inputs, dtype)
    for call in calls.values():  # allocates memory and chooses algorithms
        call()
    found = in_turn(calls, rounds)
    ratios = times_the_slowest({variant: [1.0 / second for second in found[variant]] for variant in calls})
    rows: tuple[dict[str, Value], ...] = tuple(
        {
            "model": name,
            "precision": precision,
            "seconds per image": Spread.of(found[name, precision]),
            "times the slowest": ratios[name, precision],
        }
        for name, precision in calls
    )
    return Table("inference", f"Inference: one image of {size} x {size}", rows, tuple(notes))


def _seconds(model: DepthModel, inputs: Sequence[Tensor], dtype: torch.dtype) -> float:
    device = inputs[0].device.type
    watch = Stopwatch(torch.cuda.synchronize if device == "cuda" else lambda: None)
    with torch.autocast(device, dtype, enabled=dtype != torch.float32), watch.measure("prediction"):
        model.predict(*inputs)
    return watch.total("prediction")
