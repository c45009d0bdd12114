"""The model card of a trained depth model: its training, and its errors compared with interpolation."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby

from deux.metrics.depth_errors import METRICS


@dataclass(frozen=True)
class CardErrors:
    """Mean errors on test frames with one distribution of sparse points.

    Args:
        frames: description of the test frames.
        images: number of test frames.
        pattern: spatial pattern of the points.
        density: number of points as a fraction of the pixels.
        noise: relative standard deviation of the points' depth.
        outliers: fraction of outliers among the points.
        metrics: the model's errors, by the names of `deux.metrics.depth_errors.METRICS`.
        baseline: the errors of interpolating the same points.
    """

    frames: str
    images: int
    pattern: str
    density: float
    noise: float
    outliers: float
    metrics: Mapping[str, float]
    baseline: Mapping[str, float]


@dataclass(frozen=True)
class ModelCard:
    """The card of a shipped model; stored as JSON in the header of its model file.

    Args:
        name: name of the model, by which it is loaded.
        model: registered name of its architecture.
        summary: its purpose in one line.
        data: its training data.
        supervised: whether it was trained with ground truth.
        command: command that reproduces the training.
        seed: seed of the training.
        steps: optimiser steps.
        version: version of deux that trained it.
        licence: licence of the weights.
        errors: errors on held-out frames.
    """

    name: str
    model: str
    summary: str
    data: str
    supervised: bool
    command: str
    seed: int
    steps: int
    version: str
    licence: str
    errors: Sequence[CardErrors]

    def to_json(self) -> str:
        """The card as JSON, for the header of a model file."""
        return json.dumps(asdict(self))

    def markdown(self) -> str:
        """The card as a Markdown page."""
        how = "supervised, by the depth of generated scenes" if self.supervised else "without ground truth"
        facts = {
            "Architecture": f"`{self.model}`",
            "Training": how,
            "Data": self.data,
            "Command": f"`{self.command}`",
            "Seed": str(self.seed),
            "Optimiser steps": f"{self.steps:,}",
            "Version": f"deux {self.version}",
            "Licence": self.licence,
        }
        lines = [f"# {self.name}", "", self.summary, ""]
        lines += ["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in facts.items()), ""]
        lines += ["```python", "import deux", "", f'model = deux.load("{self.name}")']
        lines += ["depth = deux.predict(image, sparse_depth, intrinsics, model=model)", "```", ""]
        lines += ["## Errors", "", "The model / linear interpolation of the same points; the lower one is bold.", ""]
        for frames, group in groupby(self.errors, key=lambda entry: (entry.frames, entry.images)):
            lines += _table(*frames, list(group))
        return "\n".join(lines)


def _table(frames: str, images: int, errors: Sequence[CardErrors]) -> list[str]:
    headings = ["points", "pattern", "noise", "outliers", *(metric.heading for metric in METRICS.values())]
    lines = [f"### {frames}", "", f"{images} frames.", "", _row(headings), _row(["---"] * len(headings))]
    for entry in errors:
        points = [
            f"{100 * entry.density:g} %",
            entry.pattern,
            f"{100 * entry.noise:g} %",
            f"{100 * entry.outliers:g} %",
        ]
        lines.append(_row([*points, *(_pair(entry.metrics[name], entry.baseline[name]) for name in METRICS)]))
    return [*lines, ""]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _pair(error: float, baseline: float) -> str:
    first, second = f"{error:.1f}", f"{baseline:.1f}"
    return f"**{first}** / {second}" if error < baseline else f"{first} / **{second}**"
