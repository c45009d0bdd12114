"""The tables of a study of uncertainty."""

import math
from collections.abc import Sequence

from deux.evaluation.intervals import Estimate
from deux.evaluation.judged_scene import CONTROLS
from deux.evaluation.sheet import Cell, Sheet
from deux.evaluation.uncertainty_study import CAUSES, MOVED, Kept, UncertaintyStudy
from deux.uncertainty.measures import MEASURES

_MEAN = "mean ± half the 95 % t interval over the scenes"
_KEPT: dict[Kept, str] = {"all": "all {count} frames", "moved": f"the {{count}} frames whose camera moved {MOVED} m"}
_CAUSES = {
    "error": "true error",
    "moved": "metres moved",
    "distance": "distance",
    "texture": "texture",
}


def measures_sheet(study: UncertaintyStudy, kept: Kept = "all") -> Sheet:
    """How well each measure follows the true error; the best measure of each column in bold."""
    columns = [
        ("judged [%]", [_times(study.share(name, kept), 100.0) for name in study.names], 0, None),
        ("ρ pixels", [study.pixels(name, kept) for name in study.names], 2, max),
        ("AUSE", [study.ause(name, kept) for name in study.names], 3, min),
        ("ρ frames", [study.frames(name, kept=kept) for name in study.names], 2, max),
    ]
    if kept == "all":
        columns.append(("ρ places", [study.places(name) for name in study.names], 2, max))
    cells = []
    for _, values, digits, best in columns:
        found = [value.mean for value in values[: len(MEASURES)] if math.isfinite(value.mean)]
        winner = best(found) if best and found else math.nan
        cells.append([_cell(value, digits, value.mean == winner) for value in values])
    frames = _KEPT[kept].format(count=study.count(kept))
    title = f"Uncertainty against the true error (ρ: rank correlation), {frames}, {_MEAN}"
    return _sheet(title, study, [column[0] for column in columns], cells)


def causes_sheet(study: UncertaintyStudy) -> Sheet:
    """What a frame's uncertainty goes with."""
    cells = [[_cell(study.frames(name, cause), 2) for name in study.names] for cause in CAUSES]
    return _sheet(
        f"Rank correlation of a frame's uncertainty with other numbers of the frame, {_MEAN}",
        study,
        [_CAUSES[cause] for cause in CAUSES],
        cells,
    )


def _sheet(title: str, study: UncertaintyStudy, header: Sequence[str], columns: Sequence[Sequence[Cell]]) -> Sheet:
    names = [f"({name})" if name in CONTROLS else name for name in study.names]
    rows = tuple((Cell(name), *cells) for name, *cells in zip(names, *columns, strict=True))
    return Sheet(title, ("measure", *header), rows)


def _times(value: Estimate, factor: float) -> Estimate:
    return Estimate(factor * value.mean, factor * value.half_width)


def _cell(value: Estimate, digits: int, bold: bool = False) -> Cell:
    if math.isnan(value.mean):
        return Cell("-")
    text = f"{value.mean:.{digits}f}"
    return Cell(text if math.isnan(value.half_width) else f"{text} ± {value.half_width:.{digits}f}", bold)
