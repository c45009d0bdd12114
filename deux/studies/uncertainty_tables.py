"""Tables of a study of uncertainty measures."""

import math
from collections.abc import Mapping, Sequence

from deux.errors import counted
from deux.metrics.intervals import Estimate
from deux.metrics.tables import Cell, Column, ResultTable, Row
from deux.studies.evaluated_walk import CONTROLS
from deux.studies.uncertainty_study import CAUSES, MOVED, FrameSelection, UncertaintyStudy

_MEAN = "mean ± half the 95 % t interval over the scenes"
_SELECTIONS: dict[FrameSelection, str] = {
    "all": "all {frames}",
    "moved": f"the {{frames}} whose camera moved {MOVED} m",
}
_CAUSES = {
    "error": "true error",
    "moved": "metres moved",
    "distance": "distance",
    "texture": "texture",
}


def agreement_table(study: UncertaintyStudy, selection: FrameSelection = "all") -> ResultTable:
    """Agreement of each measure with the true error; the best measure of each column is bold.

    Args:
        study: the statistics.
        selection: which frames are evaluated.
    """
    names = study.names
    numbers = {
        Column("covered", "%", digits=0, factor=100.0): [study.coverage(name, selection) for name in names],
        Column("ρ pixels", digits=2, best="highest"): [study.pixels(name, selection) for name in names],
        Column("AUSE", digits=3, best="lowest"): [study.ause(name, selection) for name in names],
        Column("ρ frames", digits=2, best="highest"): [study.frames(name, selection=selection) for name in names],
    }
    if selection == "all":
        numbers[Column("ρ places", digits=2, best="highest")] = [study.places(name) for name in names]
    frames = _SELECTIONS[selection].format(frames=counted(study.count(selection), "frame"))
    caption = f"Uncertainty against the true error (ρ: rank correlation), {frames}, {_MEAN}"
    return _table(caption, study, numbers).ranked(second=False)


def causes_table(study: UncertaintyStudy) -> ResultTable:
    """Rank correlation of a frame's uncertainty with its true error and with other quantities of the frame."""
    numbers = {
        Column(_CAUSES[cause], digits=2): [study.frames(name, cause) for name in study.names] for cause in CAUSES
    }
    return _table(f"Rank correlation of a frame's uncertainty with other numbers of the frame, {_MEAN}", study, numbers)


def _table(caption: str, study: UncertaintyStudy, numbers: Mapping[Column, Sequence[Estimate]]) -> ResultTable:
    """A table with a row for each measure and control; controls are in brackets and not ranked.

    Args:
        caption: caption of the table.
        study: the statistics, which determine the rows.
        numbers: a number for each row, by column.
    """
    rows = []
    for name, *values in zip(study.names, *numbers.values(), strict=True):
        control = name in CONTROLS
        cells = tuple(Cell(None if math.isnan(value.mean) else value) for value in values)
        rows.append(Row((f"({name})" if control else name,), cells, ranked=not control))
    return ResultTable(caption, ("measure",), tuple(numbers), (tuple(rows),))
