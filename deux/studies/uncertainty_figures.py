"""Figures of a study of uncertainty measures."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from deux.figures.drawing import ERROR_COLORS, UNCERTAINTY_COLORS, hide_ticks, legend_entries, new_figure
from deux.metrics.sparsification import REMOVED
from deux.studies.evaluated_walk import CONTROLS, EvaluatedSample
from deux.studies.uncertainty_study import MOVED, FrameSelection, UncertaintyStudy


def draw_sparsification(study: UncertaintyStudy) -> Figure:
    """Draw the sparsification curves of all measures: over all frames, and over frames whose camera moved."""
    titles: dict[FrameSelection, str] = {"all": "all frames", "moved": f"frames whose camera moved {MOVED} m"}
    shown = {selection: title for selection, title in titles.items() if study.count(selection)}
    figure = new_figure(5.6 * len(shown), 4.4)
    panels = figure.subplots(1, len(shown), squeeze=False).flat
    for axes, (selection, title) in zip(panels, shown.items(), strict=True):
        for name in study.names:
            ause = study.ause(name, selection).mean
            if not np.isfinite(ause):
                continue
            curve, oracle = study.curve(name, selection)
            style = {"linestyle": ":", "color": "0.5"} if name in CONTROLS else {}
            axes.plot(REMOVED, curve, label=f"{name} ({ause:.2f})", **style)
            if name == CONTROLS[-1]:  # it has a value for every pixel
                axes.plot(REMOVED, oracle, "--", color="black", label="the error itself")
        axes.set_title(f"{title} ({study.count(selection)})", fontsize=10)
        axes.set_xlabel("fraction of removed pixels, most uncertain first")
        axes.set_ylabel("mean error of the remaining / all pixels")
        axes.set_ylim(0.0, 1.15)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, title="measure (AUSE)", title_fontsize=8)
    return figure


def draw_frames(study: UncertaintyStudy) -> Figure:
    """Draw the uncertainty of each frame against its true error, a panel for each measure."""
    columns = min(3, len(study.measures))
    rows = math.ceil(len(study.measures) / columns)
    figure = new_figure(3.4 * columns, 3.2 * rows)
    panels = figure.subplots(rows, columns, squeeze=False)
    for axes in panels.flat[len(study.measures) :]:
        axes.set_axis_off()
    for axes, name in zip(panels.flat, study.measures, strict=False):
        for moved, color, label in ((True, "C0", "the camera moved"), (False, "C1", "it turned only")):
            points = [
                (frame.scores[name].delta, frame.error)
                for walk in study.walks
                for frame in walk.frames
                if name in frame.scores and (frame.moved >= MOVED) == moved
            ]
            if points:
                axes.scatter(*zip(*points, strict=True), s=4.0, alpha=0.5, color=color, label=label, linewidths=0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("")
            axis.set_tick_params(labelsize=8)
        correlation = study.frames(name).mean
        text = f"rank correlation {correlation:.2f}" if np.isfinite(correlation) else "no rank correlation"
        axes.set_title(f"{name}: {text}", fontsize=10)
        axes.set_xlabel("uncertainty of the frame (Eq. 8)", fontsize=9)
        axes.set_ylabel("mean error [mm]", fontsize=9)
        axes.grid(alpha=0.3)
    entries = legend_entries(panels.flat)
    panels[0, 0].legend(entries.values(), entries.keys(), fontsize=8, markerscale=3.0)
    return figure


def draw_uncertainty_maps(samples: Sequence[EvaluatedSample]) -> Figure:
    """Draw frames as rows: image, true error, and the maps of all measures, each with its own colour scale."""
    measures = [name for name in samples[0].uncertainties if name not in CONTROLS]
    columns = ("image", "true error", *measures)
    height, width = samples[0].rgb.shape[:2]
    figure = new_figure(1.7 * len(columns), 1.75 * len(samples) * height / width + 0.4)
    panels = figure.subplots(len(samples), len(columns), squeeze=False)
    limits = {name: _upper_limit([sample.uncertainties[name] for sample in samples]) for name in measures}
    limits["true error"] = _upper_limit([sample.error for sample in samples])
    for row, sample in zip(panels, samples, strict=True):
        row[0].imshow(sample.rgb)
        row[1].imshow(sample.error, cmap=ERROR_COLORS, vmin=0.0, vmax=limits["true error"])
        for axes, name in zip(row[2:], measures, strict=True):
            axes.imshow(sample.uncertainties[name], cmap=UNCERTAINTY_COLORS, vmin=0.0, vmax=limits[name])
        for axes in row:
            axes.set_facecolor("0.85")
            hide_ticks(axes)
    for axes, title in zip(panels[0], columns, strict=True):
        axes.set_title(f"{title}\n0 to {limits[title]:.2g}" if title in limits else title, fontsize=9)
    return figure


def _upper_limit(maps: Sequence[np.ndarray]) -> float:
    """Upper limit of a colour scale: the 97th percentile of all finite values."""
    values = np.concatenate([values[np.isfinite(values)] for values in maps])
    return max(1e-6, float(np.percentile(values, 97))) if values.size else 1.0
