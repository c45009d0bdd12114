"""The sections of the configuration that belong to the tasks themselves, with the range of each value."""

from dataclasses import dataclass
from typing import Literal

from deux.errors import check_range
from deux.geometry.uncertainty import Metric
from deux.training.pose_source import PoseKind

FRAMES_OF_A_TRIPLET = 3


@dataclass(frozen=True)
class RunSettings:
    """The single values at the top of the configuration.

    Args:
        task: what is run.
        random_seed: of everything random.
        renderer: the renderer's name.
        pose: where the relative poses of training come from.
        training_data: a dataset to train on in place of what the explorer collects.
    """

    task: str
    random_seed: int
    renderer: Literal["embree", "pyrender"]
    pose: PoseKind
    training_data: str | None

    def __post_init__(self) -> None:
        check_range("random_seed", self.random_seed, 0, 2**32 - 1)


@dataclass(frozen=True)
class CollectSettings:
    """How much is explored.

    Args:
        steps: actions in an episode.
        episodes: episodes in each training scene.
        metric: of the uncertainty (Eq. 8).
        together: robots that explore in lock-step.
        processes: processes that collect, for explorers that need no depth model.
    """

    steps: int
    episodes: int
    metric: Metric
    together: int
    processes: int

    def __post_init__(self) -> None:
        check_range("collect.steps", self.steps, FRAMES_OF_A_TRIPLET)
        check_range("collect.episodes", self.episodes, 1)
        check_range("collect.together", self.together, 1)
        check_range("collect.processes", self.processes, 1)


@dataclass(frozen=True)
class SeedSettings:
    """The model whose errors guide the explorer.

    Args:
        checkpoint: a trained model to take; None trains one.
        explore: the explorer that collects its frames.
        steps: optimiser steps of its training.
    """

    checkpoint: str | None
    explore: str
    steps: int

    def __post_init__(self) -> None:
        check_range("seed.steps", self.steps, 1)


@dataclass(frozen=True)
class EvaluationSettings:
    """On what models are evaluated.

    Args:
        viewpoints: test frames of each scene.
        validation_viewpoints: validation frames of each scene.
        checkpoint: the model of `task=evaluate`.
        data: a dataset to evaluate on in place of the test scenes.
    """

    viewpoints: int
    validation_viewpoints: int
    checkpoint: str | None
    data: str | None

    def __post_init__(self) -> None:
        check_range("evaluation.viewpoints", self.viewpoints, 1)
        check_range("evaluation.validation_viewpoints", self.validation_viewpoints, 1)
