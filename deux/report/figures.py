"""The report's figures: pictures of the runs side by side, and error against the number of frames."""

import io
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image

from deux.figures.drawing import hide_ticks, new_figure, save_figure
from deux.io.atomic import make_folder, write_atomically
from deux.report.comparison import Comparison
from deux.report.names import Key, Names
from deux.report.runs import Run
from deux.report.summary import summary

_WIDEST = 1400
"""Pixels of a run's picture in the report."""

_WIDEST_ROW = 4.4
"""Of pictures side by side, in heights of one."""

_MARKERS = "osD^vP*Xhd"


@dataclass(frozen=True)
class Picture:
    """A figure of the report.

    Args:
        file: the picture.
        caption: what it shows.
    """

    file: Path
    caption: str


def draw_comparison(comparison: Comparison, names: Names, folder: Path, name: str) -> list[Picture]:
    """Test frames and trajectories of every explorer, with one depth model and one seed; what the runs still have.

    Args:
        comparison: its runs' folders have the pictures.
        names: of explorers and models.
        folder: takes the figures.
        name: begins the figures' names.
    """
    model = _fullest(comparison, names)
    runs = {e: _first(comparison.cells[e, model]) for e in _explorers(comparison, names, model)}
    pictures = []
    for explorer, run in runs.items():
        if image := _read(run.path / "figures" / "test_frames.png"):
            file = folder / f"{name}_frames_{explorer[0]}{'_' * bool(explorer[1])}{_file_part(explorer[1])}.jpg"
            _save_jpeg(image, file)
            what = "image, sparse depth, prediction, ground truth, error, uncertainty"
            pictures.append(Picture(file, f"{names.model(model)} on test frames, {_of(explorer, run, names)}: {what}."))
    paths = {names.explorer(e): image for e, run in runs.items() if (image := _trajectory(run, runs.values()))}
    if paths:
        file = save_figure(_side_by_side(paths), folder / f"{name}_trajectories.png")
        caption = "From above: trajectories coloured by time; black unexplored, green explored"
        pictures.append(Picture(file, f"{caption} ({names.model(model)} where an explorer is guided by a model)."))
    return pictures


def draw_error_against_frames(compared: Sequence[Comparison], names: Names, dataset: str) -> Figure:
    """The MAE on the same test frames against the number of training frames, a panel for each model.

    Args:
        compared: comparisons that differ in how much was explored alone.
        names: of explorers and models.
        dataset: what the test frames are called.
    """
    models = names.ordered_models(set().union(*(c.models for c in compared)))
    explorers = names.ordered_explorers(set().union(*(c.explorers for c in compared)))
    figure = new_figure(max(5.0, 3.6 * len(models)), 3.8)
    panels = figure.subplots(1, len(models), squeeze=False, sharey=True)[0]
    for panel, model in zip(panels, models, strict=True):
        for index, explorer in enumerate(explorers):
            points = _points(compared, explorer, model)
            if points:
                frames, mae, interval = np.array(points).T
                style = {"marker": _MARKERS[index % len(_MARKERS)], "markersize": 5, "linewidth": 1.2, "capsize": 3}
                panel.errorbar(frames, mae, interval, color=f"C{index % 10}", label=names.explorer(explorer), **style)
        panel.axhline(compared[0].baseline[0].mean, color="0.4", linestyle="--", linewidth=1, label="Interpolation")
        panel.set_title(names.model(model), fontsize=10)
        panel.set_xlabel("training frames")
        panel.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        panel.grid(alpha=0.3)
    panels[0].set_ylim(bottom=max(0.0, panels[0].get_ylim()[0]))
    panels[0].set_ylabel(f"MAE on the {dataset} test set [mm]")
    panels[-1].legend(fontsize=7)
    return figure


def _points(compared: Iterable[Comparison], explorer: Key, model: Key) -> list[tuple[float, float, float]]:
    """Mean number of frames, mean MAE and its interval (0 if there is none) for each budget, by frames."""
    points = []
    for comparison in compared:
        runs = comparison.cells.get((explorer, model), {})
        counted = {seed: run.results.frames for seed, run in runs.items() if run.results and run.results.frames}
        if counted:
            mae = summary({seed: runs[seed].errors["mae"] for seed in counted})
            points.append((float(np.mean(list(counted.values()))), mae.mean, mae.interval or 0.0))
    return sorted(points)


def _fullest(comparison: Comparison, names: Names) -> Key:
    """The first of the models that most explorers were run with."""
    count: dict[Key, int] = defaultdict(int)
    for _, model in comparison.cells:
        count[model] += 1
    return max(names.ordered_models(count), key=lambda model: count[model])


def _explorers(comparison: Comparison, names: Names, model: Key) -> list[Key]:
    return names.ordered_explorers(explorer for explorer, other in comparison.cells if other == model)


def _first(runs: dict[int, Run]) -> Run:
    return runs[min(runs)]


def _of(explorer: Key, run: Run, names: Names) -> str:
    return f"trained on {names.explorer(explorer)} frames (seed {run.conditions.seed})"


def _trajectory(run: Run, others: Iterable[Run]) -> Image.Image | None:
    """A run's trajectory, in a scene that all runs drew if there is one."""
    drawn = [{path.name for path in other.path.glob("figures/trajectory_*.png")} for other in others]
    own = {path.name for path in run.path.glob("figures/trajectory_*.png")}
    shared = set.intersection(*(names for names in drawn if names)) if any(drawn) else set()
    return _read(run.path / "figures" / min(shared or own)) if own else None


def _read(path: Path) -> Image.Image | None:
    """A picture of a run; None if it is gone or damaged."""
    try:
        with Image.open(path) as image:
            return image.convert("RGB")
    except (OSError, SyntaxError, ValueError):
        return None


def _side_by_side(images: Mapping[str, Image.Image]) -> Figure:
    """The pictures in rows, all equally high."""
    rows: list[list[str]] = [[]]
    widths = {title: image.width / image.height for title, image in images.items()}
    for title, width in widths.items():
        if rows[-1] and sum(widths[other] for other in rows[-1]) + width > _WIDEST_ROW:
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
    if image.width > _WIDEST:
        image = image.resize((_WIDEST, round(image.height * _WIDEST / image.width)), Image.Resampling.LANCZOS)
    content = io.BytesIO()
    image.save(content, "JPEG", quality=88)
    make_folder(path.parent)
    write_atomically(path, content.getvalue())


def _file_part(text: str) -> str:
    return "".join(character if character.isalnum() else "_" for character in text)
