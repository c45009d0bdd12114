"""What a comparison of explorers found: its episodes, and each explorer's means with their intervals."""

import csv
import io
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from deux.evaluation.exploration import REWARD, Exploration
from deux.evaluation.intervals import Estimate, estimate
from deux.evaluation.sheet import Cell, Sheet


@dataclass(frozen=True)
class ExplorationEpisode:
    """One explorer's episode.

    Args:
        explorer: its registered name.
        scene: the scene's name.
        episode: number of the episode in this scene.
        seed: of the start and of the explorer.
        exploration: what it came to.
        trajectory: x and z in metres and yaw in radians of each frame.
        seconds: that it took.
    """

    explorer: str
    scene: str
    episode: int
    seed: int
    exploration: Exploration
    trajectory: Sequence[tuple[float, float, float]]
    seconds: float


class Measure(NamedTuple):
    """A column of the table.

    Args:
        title: its heading, with the unit.
        digits: after the decimal point.
        factor: what the number is multiplied by.
        best: whether the highest or the lowest mean stands out.
    """

    title: str
    digits: int = 1
    factor: float = 1.0
    best: Literal["highest", "lowest"] | None = "highest"


MEASURES = {
    "area_seen": Measure("area seen [m²]"),
    "floor_covered": Measure("free floor covered [%]", factor=100.0),
    "objects_seen": Measure("objects seen"),
    "collisions": Measure("collisions", best="lowest"),
    "path_length": Measure("path length [m]", best=None),
}
"""The table's columns, by the name of the number in `Exploration`."""

INTERVAL = "mean ± half the 95 % t interval over the scenes"


class Comparison:
    """The episodes of several explorers in the same scenes.

    Scenes are what differs independently: the episodes of one scene are averaged first, and the intervals are over
    scenes.

    Args:
        episodes: all of them; the explorers keep the order in which they come.
        own_rewards: the reward that an explorer was trained for, by the explorer's name.
    """

    def __init__(self, episodes: Sequence[ExplorationEpisode], own_rewards: Mapping[str, str]) -> None:
        self.episodes = episodes
        self.explorers = tuple(dict.fromkeys(episode.explorer for episode in episodes))
        self.rewards = tuple(dict.fromkeys(name for episode in episodes for name in episode.exploration.rewards))
        self._own_rewards = own_rewards

    def sample(self, explorer: str, name: str) -> list[float]:
        """One number of an explorer's (see `Exploration.values`) in each scene that has it."""
        found = defaultdict(list)
        for episode in self.episodes:
            value = episode.exploration.values().get(name)
            if episode.explorer == explorer and value is not None:
                found[episode.scene].append(value)
        return [sum(values) / len(values) for values in found.values()]

    def estimates(self, explorer: str) -> dict[str, Estimate]:
        """All of an explorer's numbers."""
        names = [*MEASURES, *(REWARD + reward for reward in self.rewards)]
        return {name: estimate(self.sample(explorer, name)) for name in names}

    def sheets(self) -> tuple[Sheet, Sheet]:
        """The table of the explorers, the best of each column in bold, and the table of their rewards, own in bold."""
        found = {explorer: self.estimates(explorer) for explorer in self.explorers}
        best = {name: _best(measure, [found[e][name].mean for e in found]) for name, measure in MEASURES.items()}
        rows = [
            (Cell(e), *(_cell(values[name], m, values[name].mean == best[name]) for name, m in MEASURES.items()))
            for e, values in found.items()
        ]
        measured = Sheet(f"What the explorers saw, {INTERVAL}", _header(m.title for m in MEASURES.values()), (*rows,))
        rows = [
            (Cell(e), *(_cell(values[REWARD + r], Measure(r, 2), self._own_rewards.get(e) == r) for r in self.rewards))
            for e, values in found.items()
        ]
        return measured, Sheet(f"The rewards of an episode, {INTERVAL}", _header(self.rewards), (*rows,))

    def summary(self) -> dict[str, dict[str, dict[str, float | None]]]:
        """Each explorer's numbers as JSON values: their means, and half the width of their intervals."""
        return {
            explorer: {name: {key: _known(x) for key, x in value._asdict().items()} for name, value in found.items()}
            for explorer in self.explorers
            for found in [self.estimates(explorer)]
        }

    def table_csv(self) -> str:
        """One row an explorer: each number's mean, and the ends of its interval."""
        rows = []
        for explorer in self.explorers:
            row: dict[str, object] = {"explorer": explorer}
            for name, (mean, half_width) in self.estimates(explorer).items():
                row |= {name: mean, f"{name}_low": mean - half_width, f"{name}_high": mean + half_width}
            rows.append(row)
        return _csv(rows)

    def episodes_csv(self) -> str:
        """One row an episode."""
        rows = []
        for episode in self.episodes:
            numbers = dict.fromkeys([*MEASURES, *(REWARD + reward for reward in self.rewards)])
            about = {"explorer": episode.explorer, "scene": episode.scene, "episode": episode.episode}
            frames = len(episode.trajectory)
            rows.append({**about, "seed": episode.seed, "frames": frames, **numbers, **episode.exploration.values()})
        return _csv(rows)


def _header(titles: Iterable[str]) -> tuple[str, ...]:
    return ("explorer", *titles)


def _best(measure: Measure, means: Sequence[float]) -> float:
    known = [mean for mean in means if math.isfinite(mean)]
    if not known or measure.best is None:
        return math.nan
    return max(known) if measure.best == "highest" else min(known)


def _cell(value: Estimate, measure: Measure, bold: bool) -> Cell:
    if math.isnan(value.mean):
        return Cell("-")
    mean, half_width = (f"{number * measure.factor:.{measure.digits}f}" for number in value)
    return Cell(mean if math.isnan(value.half_width) else f"{mean} ± {half_width}", bold)


def _csv(rows: Sequence[Mapping[str, object]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _known(value) for key, value in row.items()} for row in rows)  # None is left empty
    return text.getvalue()


def _known(value: Any) -> Any:
    """None in place of NaN, which JSON does not have."""
    return None if isinstance(value, float) and math.isnan(value) else value
