"""Common parts of all figures: colour maps, creation and saving."""

import io
from collections.abc import Iterable
from pathlib import Path

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from deux.io.atomic import make_folder, write_atomically

DEPTH_COLORS = "turbo"
ERROR_COLORS = "magma"
TIME_COLORS = "plasma"
UNCERTAINTY_COLORS = "viridis"


def new_figure(width: float, height: float) -> Figure:
    """Create a figure of width x height inches that is not registered in pyplot, so that it is freed automatically."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def hide_ticks(axes: Axes) -> None:
    """Remove the ticks, since pixel coordinates are not informative."""
    axes.set_xticks([])
    axes.set_yticks([])


def legend_entries(panels: Iterable[Axes]) -> dict[str, Artist]:
    """Legend handles of several panels by label, without duplicates."""
    return {label: handle for panel in panels for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)}


def save_figure(figure: Figure, path: Path, dpi: int = 130) -> Path:
    """Write a PNG file atomically."""
    content = io.BytesIO()
    figure.savefig(content, dpi=dpi, format="png")
    make_folder(path.parent)
    write_atomically(path, content.getvalue())
    return path
