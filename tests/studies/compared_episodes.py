"""Episodes for the tests of the comparison of explorers."""

from deux.studies.exploration_meter import Exploration
from deux.studies.explorer_comparison import ExplorationEpisode


def episode(explorer: str, scene: str, area: float, number: int = 0, **changes) -> ExplorationEpisode:
    numbers = {"floor_covered": 0.5, "objects_seen": 3, "collisions": 2, "path_length": 1.5}
    numbers |= {"forward_share": 0.25, "parallax_share": 0.5}
    rewards = {"growth": area / 10.0}
    exploration = Exploration(**{"area_seen": area, "rewards": rewards, **numbers, **changes})
    return ExplorationEpisode(explorer, scene, number, 7, exploration, [(0.0, 0.0, 0.0)] * 4, 1.0)
