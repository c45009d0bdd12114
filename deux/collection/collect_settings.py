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
        uncertainty: the uncertainty measure for the depth model's predictions (Eq. 8).
        uncertainty_options: options of its constructor.
        correct_depth: correct the predicted depth that explorers receive by the frame's sparse points
            (`deux.geometry.depth_correction`); the uncertainty is still computed for the model's own prediction.
        remembered_frames: number of earlier frames whose sparse points correct that depth as well, where they are
            visible (`deux.collection.point_memory`).
        batch_size: number of robots that explore in lock-step and share each call of the depth model.
        processes: number of parallel processes on this machine if `executor` is "local", each with a copy of the depth
            model; other executors have an option of their own.
        executor: what runs the episodes: "local" for processes of this machine, or "ray".
        executor_options: options of its constructor; the local one has none.
        viewer: "rerun" to record the first episodes for the Rerun viewer; None for no recordings.

    Raises:
        DeuxError: a value is out of its range.
    """

    steps: int
    episodes: int
    uncertainty: str
    batch_size: int
    processes: int
    correct_depth: bool = True
    remembered_frames: int = 30
    executor: str = "local"
    executor_options: Mapping[str, Any] = field(default_factory=dict)
    uncertainty_options: Mapping[str, Any] = field(default_factory=dict)
    viewer: Literal["rerun"] | None = None

    def __post_init__(self) -> None:
        check_range("collect.steps", self.steps, FRAMES_OF_A_TRIPLET)
        check_range("collect.episodes", self.episodes, 1)
        check_range("collect.remembered_frames", self.remembered_frames, 0)
        check_range("collect.batch_size", self.batch_size, 1)
        check_range("collect.processes", self.processes, 1)

    @property
    def measure(self) -> PluginChoice:
        """The uncertainty measure with its options.

        Raises:
            DeuxError: there is no such measure, or it does not have an option.
        """
        return registry().choose("uncertainties", {"name": self.uncertainty, **self.uncertainty_options})

    def make_executor(self) -> Executor:
        """Create the executor that runs the jobs of a collection.

        Raises:
            DeuxError: there is no such executor, an option is wrong, or its libraries are missing.
        """
        return make_executor(self.executor, self.executor_options, self.processes)
