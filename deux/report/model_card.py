"""The card of a trained depth model: what it was made from, and its errors beside those of interpolation."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby

from deux.metrics.depth_errors import METRICS


@dataclass(frozen=True)
class CardErrors:
    """The mean errors on some test frames with one kind of points.

    Args:
        frames: what the test frames are.
        images: their number.
        pattern: where the points lie.
        density: number of points as a fraction of the pixels.
        noise: relative standard deviation of their depth.
        outliers: fraction of them that is badly wrong.
        metrics: the model's errors, by the names of `deux.metrics.depth_errors.METRICS`.
        baseline: those of interpolation of the same points.
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
    """What is known of a model that ships. A model file's header holds it as JSON.

    Args:
        name: by which the model is loaded.
        model: the registered name of its architecture.
        summary: one line on what it is for.
        data: what it was trained on.
        supervised: whether it learned from ground truth.
        command: that trains it again.
        seed: of that training.
        steps: optimiser steps.
        version: of deux that trained it.
        licence: of the weights.
        errors: measured on frames that it never saw.
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
        """The card for a file's header."""
        return json.dumps(asdict(self))

    def markdown(self) -> str:
        """The card as a page."""
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
        for frames, group in groupby(self.errors, key=lambda one: (one.frames, one.images)):
            lines += _table(*frames, list(group))
        return "\n".join(lines)


def _table(frames: str, images: int, errors: Sequence[CardErrors]) -> list[str]:
    headings = ["points", "pattern", "noise", "outliers", *(metric.heading for metric in METRICS.values())]
    lines = [f"### {frames}", "", f"{images} frames.", "", _row(headings), _row(["---"] * len(headings))]
    for one in errors:
        what = [f"{100 * one.density:g} %", one.pattern, f"{100 * one.noise:g} %", f"{100 * one.outliers:g} %"]
        lines.append(_row([*what, *(_pair(one.metrics[name], one.baseline[name]) for name in METRICS)]))
    return [*lines, ""]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _pair(mine: float, other: float) -> str:
    first, second = f"{mine:.1f}", f"{other:.1f}"
    return f"**{first}** / {second}" if mine < other else f"{first} / **{second}**"
