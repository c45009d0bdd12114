"""The figures of a study of uncertainty."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from deux.figures.drawing import ERROR_COLORS, UNCERTAINTY_COLORS, hide_ticks, legend_entries, new_figure
from deux.metrics.sparsification import REMOVED
from deux.studies.judged_walk import CONTROLS, JudgedSample
from deux.studies.uncertainty_study import MOVED, Kept, UncertaintyStudy


def draw_sparsification(study: UncertaintyStudy) -> Figure:
    """Draw the curves of all measures: over all frames, and over those whose camera moved."""
    titles: dict[Kept, str] = {"all": "all frames", "moved": f"frames whose camera moved {MOVED} m"}
    shown = {kept: title for kept, title in titles.items() if study.count(kept)}
    figure = new_figure(5.6 * len(shown), 4.4)
    for axes, (kept, title) in zip(figure.subplots(1, len(shown), squeeze=False).flat, shown.items(), strict=True):
        known = [name for name in study.names if np.isfinite(study.ause(name, kept).mean)]
        for name in known:
            curve, oracle = study.curve(name, kept)
            style = {"linestyle": ":", "color": "0.5"} if name in CONTROLS else {}
            axes.plot(REMOVED, curve, label=f"{name} ({study.ause(name, kept).mean:.2f})", **style)
            if name == CONTROLS[-1]:  # it judges every pixel
                axes.plot(REMOVED, oracle, "--", color="black", label="the error itself")
        axes.set_title(f"{title} ({study.count(kept)})", fontsize=10)
        axes.set_xlabel("share of the pixels left out, least certain first")
        axes.set_ylabel("mean error of the rest / of all")
        axes.set_ylim(0.0, 1.15)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, title="measure (AUSE)", title_fontsize=8)
    return figure


def draw_frames(study: UncertaintyStudy) -> Figure:
    """Draw each frame as a point, its uncertainty against its true error, for each measure."""
    columns = min(3, len(study.measures))
    rows = math.ceil(len(study.measures) / columns)
    figure = new_figure(3.4 * columns, 3.2 * rows)
    panels = figure.subplots(rows, columns, squeeze=False)
    for axes in panels.flat[len(study.measures) :]:
        axes.set_axis_off()
    for axes, name in zip(panels.flat, study.measures, strict=False):
        for moved, color, label in ((True, "C0", "the camera moved"), (False, "C1", "it turned only")):
            points = [
                (frame.judgements[name].delta, frame.error)
                for walk in study.walks
                for frame in walk.frames
                if name in frame.judgements and (frame.moved >= MOVED) == moved
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
        known = f"rank correlation {correlation:.2f}" if np.isfinite(correlation) else "no rank correlation"
        axes.set_title(f"{name}: {known}", fontsize=10)
        axes.set_xlabel("uncertainty of the frame (Eq. 8)", fontsize=9)
        axes.set_ylabel("mean error [mm]", fontsize=9)
        axes.grid(alpha=0.3)
    entries = legend_entries(panels.flat)
    panels[0, 0].legend(entries.values(), entries.keys(), fontsize=8, markerscale=3.0)
    return figure


def draw_uncertainty_maps(samples: Sequence[JudgedSample]) -> Figure:
    """Draw frames as rows: the image, the true error, and the maps of all measures, each with its own colour scale."""
    measures = [name for name in samples[0].uncertainties if name not in CONTROLS]
    columns = ("image", "true error", *measures)
    height, width = samples[0].rgb.shape[:2]
    figure = new_figure(1.7 * len(columns), 1.75 * len(samples) * height / width + 0.4)
    panels = figure.subplots(len(samples), len(columns), squeeze=False)
    worst = _high([sample.error for sample in samples])
    highest = {name: _high([sample.uncertainties[name] for sample in samples]) for name in measures}
    for row, sample in zip(panels, samples, strict=True):
        row[0].imshow(sample.rgb)
        row[1].imshow(sample.error, cmap=ERROR_COLORS, vmin=0.0, vmax=worst)
        for axes, name in zip(row[2:], measures, strict=True):
            axes.imshow(sample.uncertainties[name], cmap=UNCERTAINTY_COLORS, vmin=0.0, vmax=highest[name])
        for axes in row:
            axes.set_facecolor("0.85")
            hide_ticks(axes)
    for axes, title in zip(panels[0], columns, strict=True):
        limit = worst if title == "true error" else highest.get(title)
        axes.set_title(title if limit is None else f"{title}\n0 to {limit:.2g}", fontsize=9)
    return figure


def _high(maps: Sequence[np.ndarray]) -> float:
    """The 97th percentile of all known values, above 0."""
    values = np.concatenate([values[np.isfinite(values)] for values in maps])
    return max(1e-6, float(np.percentile(values, 97))) if values.size else 1.0
