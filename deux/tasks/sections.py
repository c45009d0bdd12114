"""The sections of the configuration that belong to the tasks themselves, with the range of each value."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from deux.errors import DeuxError, check_range
from deux.policies.ppo_settings import PPOSettings
from deux.training.pose_source import PoseKind
from deux.training.rounds import RoundSettings
from deux.uncertainty.measures import MeasureName

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
        checkpoint: the model of `task=predict` and `task=export`.
    """

    task: str
    random_seed: int
    renderer: Literal["embree", "pyrender"]
    pose: PoseKind
    training_data: str | None
    checkpoint: str | None

    def __post_init__(self) -> None:
        check_range("random_seed", self.random_seed, 0, 2**32 - 1)


@dataclass(frozen=True)
class CollectSettings:
    """How much is explored.

    Args:
        steps: actions in an episode.
        episodes: episodes in each training scene.
        uncertainty: how the depth model's predictions are judged (Eq. 8).
        together: robots that explore in lock-step.
        processes: processes that collect, for explorers that need no depth model.
    """

    steps: int
    episodes: int
    uncertainty: MeasureName
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
class FoundationSettings:
    """The supervised model that the chosen one is built on, where it is built on one.

    Args:
        checkpoint: a trained model to take; None trains one.
        flats: generated flats, none of them the experiment's own, in whose frames it is trained.
        viewpoints: frames of each flat.
        steps: optimiser steps of its training.
        batch_size: samples in a batch.
    """

    checkpoint: str | None
    flats: int
    viewpoints: int
    steps: int
    batch_size: int

    def __post_init__(self) -> None:
        check_range("foundation.flats", self.flats, 1)
        check_range("foundation.viewpoints", self.viewpoints, 1)
        check_range("foundation.steps", self.steps, 1)
        check_range("foundation.batch_size", self.batch_size, 1)


@dataclass(frozen=True)
class ExplorerTrainingSettings(PPOSettings):
    """How `task=train_explorer` trains a policy, and where.

    Args:
        flats: generated flats, none of them the experiment's own, in which it is trained; None for `scenes.train`.
        reward_options: options of the reward's constructor.
    """

    flats: int | None = 48
    reward_options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.flats is not None:
            check_range("explorer_training.flats", self.flats, 1)


@dataclass(frozen=True)
class ActiveCollectionSettings(RoundSettings):
    """`callbacks=active_collection`: when the model explores during its training, and how much.

    Args:
        steps: actions in an episode of a round.
        episodes: episodes of a round in each training scene.
    """

    steps: int = 50
    episodes: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("callbacks.steps", self.steps, FRAMES_OF_A_TRIPLET)
        check_range("callbacks.episodes", self.episodes, 1)


@dataclass(frozen=True)
class CompareSettings:
    """What `task=compare_explorers` compares, and where.

    Args:
        explorers: their registered names; None for all that are installed.
        flats: number of test scenes; of generated flats there are as many as are asked for.
        steps: actions in an episode.
        seeds: episodes in each scene.
        baseline: the explorer that the others are measured against, scene by scene; None for none.
        figure_scene: number, from 0, of the scene that the trajectories are drawn in.
    """

    explorers: list[str] | None
    flats: int
    steps: int
    seeds: int
    baseline: str | None
    figure_scene: int

    def __post_init__(self) -> None:
        if self.explorers is not None and not self.explorers:
            raise DeuxError("compare.explorers is empty: name some, or null for all that are installed.")
        check_range("compare.flats", self.flats, 1)
        check_range("compare.steps", self.steps, 2)
        check_range("compare.seeds", self.seeds, 1)
        check_range("compare.figure_scene", self.figure_scene, 0, self.flats - 1)


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


@dataclass(frozen=True)
class PredictionSettings:
    """The files of the frame whose depth `task=predict` completes; at the top of the configuration.

    Args:
        image: an 8-bit image.
        sparse: depth of some pixels, as a 16-bit PNG or .npy file.
        sparse_scale: stored values per metre in PNG files.
        intrinsics: a text or .npy file.
        ground_truth: depth to compare with, as `sparse`.
    """

    image: str | None
    sparse: str | None
    sparse_scale: float
    intrinsics: str | None
    ground_truth: str | None

    def __post_init__(self) -> None:
        check_range("sparse_scale", self.sparse_scale, 0, ends=False)


@dataclass(frozen=True)
class ExportSettings:
    """What the exported model takes.

    Args:
        height: of the images, in pixels; None for the camera's.
        width: likewise.
        batch: number of images at a time; None for any.
    """

    height: int | None
    width: int | None
    batch: int | None

    def __post_init__(self) -> None:
        for name, value in (("height", self.height), ("width", self.width), ("batch", self.batch)):
            if value is not None:
                check_range(f"export.{name}", value, 1)


@dataclass(frozen=True)
class ReportSettings:
    """What `task=report` shows.

    Args:
        runs: a folder with runs and sweeps below it.
        first: the dataset of Table I; None for the one on which the most explorers were compared.
        transferred: explorers of which Table II also shows the models that were trained on the first dataset.
        baseline: the explorer that the others of Table I are compared with, seed by seed; None for none.
        models: what each depth model is called, in order of the columns.
        explorers: what each explorer is called, in order of the rows, in parts with a line between them.
    """

    runs: str | None
    first: str | None
    transferred: tuple[str, ...]
    baseline: str | None
    models: Mapping[str, str]
    explorers: tuple[Mapping[str, str], ...]
