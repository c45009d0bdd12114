"""The section `collect` of the configuration: how much is explored, and how."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from deux.collection.executors import make_executor
from deux.collection.jobs import Executor
from deux.errors import check_range
from deux.registry import PluginChoice, registry

FRAMES_OF_A_TRIPLET = 3


@dataclass(frozen=True)
class CollectSettings:
    """How much is explored.

    Args:
        steps: actions in an episode.
        episodes: episodes in each training scene.
        uncertainty: the measure by which the depth model's predictions are judged (Eq. 8).
        uncertainty_options: options of its constructor.
        correct_depth: correct the predicted depth that explorers are given by the sparse points of the frame
            (`deux.geometry.depth_correction`); the uncertainty stays that of the model's own prediction.
        batch_size: robots that explore in lock-step, sharing each call of the depth model.
        processes: processes of this machine that explore at the same time where `executor` is "local", each with a copy
            of the depth model; other executors have an option of their own for it.
        executor: what hands out the episodes: "local" for processes of this machine, or "ray".
        executor_options: options of its constructor; the local one has none.
        viewer: "rerun" for recordings of the first episodes that its viewer plays; None for none.

    Raises:
        DeuxError: a value is out of its range.
    """

    steps: int
    episodes: int
    uncertainty: str
    batch_size: int
    processes: int
    correct_depth: bool = True
    executor: str = "local"
    executor_options: Mapping[str, Any] = field(default_factory=dict)
    uncertainty_options: Mapping[str, Any] = field(default_factory=dict)
    viewer: Literal["rerun"] | None = None

    def __post_init__(self) -> None:
        check_range("collect.steps", self.steps, FRAMES_OF_A_TRIPLET)
        check_range("collect.episodes", self.episodes, 1)
        check_range("collect.batch_size", self.batch_size, 1)
        check_range("collect.processes", self.processes, 1)

    @property
    def measure(self) -> PluginChoice:
        """The measure of uncertainty with its options.

        Raises:
            DeuxError: there is no such measure, or an option that it does not have.
        """
        return registry().choose("uncertainties", {"name": self.uncertainty, **self.uncertainty_options})

    def make_executor(self) -> Executor:
        """What hands out the jobs of an exploration.

        Raises:
            DeuxError: there is no such executor, an option is wrong, or its libraries are missing.
        """
        return make_executor(self.executor, self.executor_options, self.processes)
