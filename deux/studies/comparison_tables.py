"""Tables of a comparison of explorers: exploration metrics, rewards, and gains over a baseline."""

import math
from collections.abc import Mapping, Sequence

from deux.metrics.intervals import Estimate
from deux.metrics.tables import Cell, Column, ResultTable, Row
from deux.studies.exploration_meter import REWARD
from deux.studies.explorer_comparison import ExplorerComparison

_MEAN = "mean ± half the 95 % t interval over the scenes"

COLUMNS = {
    "area_seen": Column("area seen", "m²", best="highest"),
    "floor_covered": Column("free floor covered", "%", factor=100.0, best="highest"),
    "objects_seen": Column("objects seen", best="highest"),
    "collisions": Column("collisions", best="lowest"),
    "path_length": Column("way walked", "m"),
    "forward_share": Column("forward share", "%", factor=100.0),
    "parallax_share": Column("frames with parallax", "%", factor=100.0),
}
"""The columns, by the names of the attributes of `Exploration`."""


def exploration_table(comparison: ExplorerComparison) -> ResultTable:
    """The exploration metrics of each explorer; the best of each column is bold."""
    cells = {e: [_cell(comparison.estimate(e, name)) for name in COLUMNS] for e in comparison.explorers}
    return _table(f"What the explorers saw, {_MEAN}", tuple(COLUMNS.values()), cells).ranked(second=False)


def rewards_table(comparison: ExplorerComparison) -> ResultTable:
    """The sum of each reward over an episode; the reward that an explorer was trained with is bold."""
    cells = {
        explorer: [
            _cell(comparison.estimate(explorer, REWARD + reward), comparison.own_rewards.get(explorer) == reward)
            for reward in comparison.rewards
        ]
        for explorer in comparison.explorers
    }
    columns = tuple(Column(reward, digits=2) for reward in comparison.rewards)
    return _table(f"The rewards of an episode, own in bold, {_MEAN}", columns, cells)


def gains_table(comparison: ExplorerComparison, baseline: str) -> ResultTable:
    """Gains of each explorer over a baseline in the same scenes; bold if the whole interval is above 0.

    Args:
        comparison: the episodes.
        baseline: the explorer that the others are compared with.
    """
    shown = {name: column for name, column in COLUMNS.items() if column.best == "highest"}
    cells = {}
    for explorer in comparison.explorers:
        if explorer != baseline:
            own = REWARD + comparison.own_rewards[explorer] if explorer in comparison.own_rewards else ""
            gains = [comparison.gain(explorer, baseline, name) for name in (*shown, own)]
            cells[explorer] = [_cell(gain, gain.mean > gain.half_width) for gain in gains]
    columns = (*shown.values(), Column("own reward", digits=2))
    return _table(
        f"More than {baseline} in the same scene, {_MEAN}, bold where the interval is above 0", columns, cells
    )


def _table(caption: str, columns: tuple[Column, ...], cells: Mapping[str, Sequence[Cell]]) -> ResultTable:
    """A table with a row for each explorer."""
    rows = tuple(Row((explorer,), tuple(of_explorer)) for explorer, of_explorer in cells.items())
    return ResultTable(caption, ("explorer",), columns, (rows,))


def _cell(value: Estimate, highlighted: bool = False) -> Cell:
    """A cell of a table; empty if there is no mean."""
    if math.isnan(value.mean):
        return Cell()
    return Cell(value, "highlighted" if highlighted else None)
