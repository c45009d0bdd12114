"""The tables of a study of uncertainty."""

import math
from collections.abc import Sequence

from deux.report.sheet import Cell, Sheet, estimate_cell
from deux.studies.judged_scene import CONTROLS
from deux.studies.uncertainty_study import CAUSES, MOVED, Kept, UncertaintyStudy

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
    names = study.names
    numbers = [
        ("ρ pixels", [study.pixels(name, kept) for name in names], 2, max),
        ("AUSE", [study.ause(name, kept) for name in names], 3, min),
        ("ρ frames", [study.frames(name, kept=kept) for name in names], 2, max),
    ]
    if kept == "all":
        numbers.append(("ρ places", [study.places(name) for name in names], 2, max))
    columns = [[estimate_cell(study.coverage(name, kept), 0, factor=100.0) for name in names]]
    for _, values, digits, best in numbers:
        winner = best(
            (value.mean for value in values[: len(study.measures)] if math.isfinite(value.mean)), default=math.nan
        )
        columns.append([estimate_cell(value, digits, bold=value.mean == winner) for value in values])
    frames = _KEPT[kept].format(count=study.count(kept))
    title = f"Uncertainty against the true error (ρ: rank correlation), {frames}, {_MEAN}"
    return _sheet(title, study, ["judged [%]", *(number[0] for number in numbers)], columns)


def causes_sheet(study: UncertaintyStudy) -> Sheet:
    """What a frame's uncertainty goes with."""
    cells = [[estimate_cell(study.frames(name, cause), 2) for name in study.names] for cause in CAUSES]
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
