"""Figures of a report: images of the runs side by side, and error against the number of training frames."""

import io
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image

from deux.figures.drawing import hide_ticks, legend_entries, new_figure, save_figure
from deux.io.atomic import make_folder, write_atomically
from deux.metrics.depth_errors import METRICS
from deux.metrics.intervals import estimate
from deux.report.comparable_runs import ComparableRuns
from deux.report.display_names import DisplayNames, Variant
from deux.report.runs import Run

_MAX_WIDTH = 1400
"""Maximal width of a run's image in the report, pixels."""

_MAX_ROW_WIDTH = 4.4
"""Maximal width of a row of images, relative to its height."""

_MARKERS = "osD^vP*Xhd"


@dataclass(frozen=True)
class CaptionedFigure:
    """A figure of the report.

    Args:
        file: the image file.
        caption: its caption.
    """

    file: Path
    caption: str


def draw_runs(runs: ComparableRuns, names: DisplayNames, folder: Path, name: str) -> list[CaptionedFigure]:
    """Draw test frames and trajectories of every explorer, with one depth model and seed, from the runs' images.

    Runs whose images are missing are left out.

    Args:
        runs: the runs, whose folders contain the images.
        names: display names of explorers and models.
        folder: folder of the figures.
        name: prefix of the figures' file names.
    """
    model = _model_with_most_explorers(runs, names)
    explorers = names.ordered_explorers(explorer for explorer, other in runs.cells if other == model)
    shown = {explorer: _first_seed(runs.cells[explorer, model]) for explorer in explorers}
    figures = []
    for explorer, run in shown.items():
        if image := _read(run.path / "figures" / "test_frames.png"):
            part = "_".join(_file_part(text) for text in explorer if text)
            file = folder / f"{name}_frames_{part}.jpg"
            _save_jpeg(image, file)
            trained = f"trained on {names.explorer(explorer)} frames (seed {run.conditions.seed})"
            what = "image, sparse depth, prediction, ground truth, error, uncertainty"
            figures.append(CaptionedFigure(file, f"{names.model(model)} on test frames, {trained}: {what}."))
    paths = {names.explorer(e): image for e, run in shown.items() if (image := _trajectory(run, shown.values()))}
    if paths:
        file = save_figure(_side_by_side(paths), folder / f"{name}_trajectories.png")
        caption = "From above: trajectories coloured by time; black unexplored, green explored"
        guided = f"({names.model(model)} where an explorer is guided by a model)"
        figures.append(CaptionedFigure(file, f"{caption} {guided}."))
    return figures


def draw_error_against_frames(groups: Sequence[ComparableRuns], names: DisplayNames, dataset: str) -> Figure:
    """Draw the MAE on the same test frames against the number of training frames, a panel for each model.

    Args:
        groups: groups of runs that differ in the amount of exploration only.
        names: display names of explorers and models.
        dataset: display name of the test dataset.
    """
    models = names.ordered_models(set().union(*(group.models for group in groups)))
    explorers = names.ordered_explorers(set().union(*(group.explorers for group in groups)))
    figure = new_figure(max(5.0, 3.6 * len(models)), 3.8)
    panels = figure.subplots(1, len(models), squeeze=False, sharey=True)[0]
    for panel, model in zip(panels, models, strict=True):
        for index, explorer in enumerate(explorers):
            points = _points(groups, explorer, model)
            if points:
                frames, mae, interval = np.array(points).T
                style = {"marker": _MARKERS[index % len(_MARKERS)], "markersize": 5, "linewidth": 1.2, "capsize": 3}
                panel.errorbar(frames, mae, interval, color=f"C{index % 10}", label=names.explorer(explorer), **style)
        interpolation = groups[0].baseline.estimates["mae"].mean
        panel.axhline(interpolation, color="0.4", linestyle="--", linewidth=1, label="Interpolation")
        panel.set_title(names.model(model), fontsize=10)
        panel.set_xlabel("training frames")
        panel.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        panel.grid(alpha=0.3)
    panels[0].set_ylim(bottom=max(0.0, panels[0].get_ylim()[0]))
    panels[0].set_ylabel(f"{METRICS['mae'].title} on the {dataset} test set [{METRICS['mae'].unit}]")
    entries = legend_entries(panels)
    labels = [label for label in ("Interpolation", *map(names.explorer, explorers)) if label in entries]
    figure.legend([entries[label] for label in labels], labels, fontsize=7, loc="outside lower center", ncols=2)
    return figure


def _points(groups: Iterable[ComparableRuns], explorer: Variant, model: Variant) -> list[tuple[float, float, float]]:
    """Mean number of frames, mean MAE and half width of its interval (or 0) of each group, sorted by frames."""
    points = []
    for group in groups:
        runs = group.cells.get((explorer, model), {})
        frames = {seed: run.results.frames for seed, run in runs.items() if run.results and run.results.frames}
        if frames:
            mae = estimate([runs[seed].errors["mae"] for seed in frames])
            interval = 0.0 if math.isnan(mae.half_width) else mae.half_width
            points.append((float(np.mean(list(frames.values()))), mae.mean, interval))
    return sorted(points)


def _model_with_most_explorers(runs: ComparableRuns, names: DisplayNames) -> Variant:
    """The model that was trained with the most explorers; of several, the first in display order."""
    count = Counter(model for _, model in runs.cells)
    return max(names.ordered_models(count), key=lambda model: count[model])


def _first_seed(runs: Mapping[int, Run]) -> Run:
    return runs[min(runs)]


def _trajectory(run: Run, others: Iterable[Run]) -> Image.Image | None:
    """The image of a run's trajectory, if possible in a scene that is drawn in all runs."""
    drawn = [{path.name for path in other.path.glob("figures/trajectory_*.png")} for other in others]
    own = {path.name for path in run.path.glob("figures/trajectory_*.png")}
    shared = set.intersection(*(names for names in drawn if names)) if any(drawn) else set()
    return _read(run.path / "figures" / min(shared or own)) if own else None


def _read(path: Path) -> Image.Image | None:
    """Read an image of a run; None if it is missing or damaged."""
    try:
        with Image.open(path) as image:
            return image.convert("RGB")
    except (OSError, SyntaxError, ValueError):
        return None


def _side_by_side(images: Mapping[str, Image.Image]) -> Figure:
    """Arrange images of equal height in rows."""
    rows: list[list[str]] = [[]]
    widths = {title: image.width / image.height for title, image in images.items()}
    for title, width in widths.items():
        if rows[-1] and sum(widths[other] for other in rows[-1]) + width > _MAX_ROW_WIDTH:
            rows.append([])
        rows[-1].append(title)
    full = max(sum(widths[title] for title in row) for row in rows)
    height = min(3.2, 13.0 / full)
    figure = new_figure(full * height, len(rows) * (height + 0.3))
    for row, band in zip(rows, figure.subfigures(len(rows), 1, squeeze=False)[:, 0], strict=True):
        ratios = [widths[title] for title in row]
        rest = full - sum(ratios)
        panels = band.subplots(1, len(row) + (rest > 0.01), width_ratios=ratios + [rest] * (rest > 0.01), squeeze=False)
        for panel, title in zip_longest(panels[0], row):
            hide_ticks(panel)
            panel.set_frame_on(False)
            if title is not None:
                panel.imshow(np.asarray(images[title]))
                panel.set_title(title, fontsize=10)
    return figure


def _save_jpeg(image: Image.Image, path: Path) -> None:
    if image.width > _MAX_WIDTH:
        image = image.resize((_MAX_WIDTH, round(image.height * _MAX_WIDTH / image.width)), Image.Resampling.LANCZOS)
    content = io.BytesIO()
    image.save(content, "JPEG", quality=88)
    make_folder(path.parent)
    write_atomically(path, content.getvalue())


def _file_part(text: str) -> str:
    """Make text from a run's results, which may be untrusted, safe as part of a file name."""
    return "".join(character if character.isalnum() else "_" for character in text)
