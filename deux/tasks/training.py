"""The training stage: a newly made model on one dataset, laid on its foundation where it is built on one."""

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from lightning import seed_everything

from deux.configuration import user_path
from deux.contracts import DepthModel, Foundation
from deux.deployment.model_files import MODEL_FILE, load_model, load_weights, save_model, weights_file
from deux.errors import DeuxError
from deux.figures.drawing import save_figure
from deux.figures.panel_logger import PanelLogger
from deux.figures.training_curve import draw_training_curve
from deux.io.locking import locked
from deux.metrics.depth_errors import DepthMetrics
from deux.tasks.active_collection import active_collection, show_rounds
from deux.tasks.console import say, training_bar
from deux.tasks.datasets import synthetic_dataset, viewpoint_dataset
from deux.tasks.given import given_model, weights_identity
from deux.tasks.run_folder import RunFolder, short_hash
from deux.tasks.sections import ActiveCollectionSettings
from deux.tasks.settings import PluginChoice, Settings, plugin_choice
from deux.training.fit import TrainingSettings, fit
from deux.training.pose_source import PoseKind
from deux.training.ranks import leads, wait_for_all


class Trainee:
    """A depth model that is to be trained, how it is judged, and what it is built on.

    Args:
        settings: the run's.
        model: the depth model with its options.
        objective: loss terms that override the model's own.
        pose: where relative poses come from.
    """

    def __init__(
        self,
        settings: Settings,
        model: PluginChoice,
        objective: Mapping[str, Any] | None = None,
        pose: PoseKind = "simulator",
    ) -> None:
        self.model = model
        self.objective = objective or {}
        self.pose = pose
        self._settings = settings

    @cached_property
    def foundation(self) -> Path | None:
        """The trained model that this one is built on, as a file; None if it stands alone.

        It is `foundation.checkpoint` if that is given. Otherwise it is trained when it is first asked for, with ground
        truth and its own objective, on frames of generated flats that are none of the run's scenes, as the published
        ScaffNet is on synthetic data: the ground truth of what the robot explores reaches no unsupervised model.
        """
        foundation = self.model.create().foundation()
        settings = self._settings
        if foundation is None:
            return None
        if settings.foundation.checkpoint is not None:
            return weights_file(user_path(settings.foundation.checkpoint))
        say(f"  {self.model.name} is built on {foundation.name}, which learns from synthetic flats first")
        below = Trainee(settings, _choice(foundation))
        chosen = settings.foundation
        training = replace(settings.training, steps=chosen.steps, batch_size=chosen.batch_size)
        return train_once(settings, below, training, synthetic_dataset(settings), "foundations")

    def make(self) -> DepthModel:
        """Make the model, untrained, on its trained foundation."""
        path = self.foundation
        seed_everything(self._settings.seed, workers=True, verbose=False)
        model: DepthModel = self.model.create()
        foundation = model.foundation()
        if path is None or foundation is None:
            return model
        name, trained = given_model(_choice(foundation), str(path))
        if problem := load_weights(foundation.module, trained.state_dict()):
            raise DeuxError(
                f"foundation.checkpoint={path} is a {name} that does not fit the {foundation.name} that "
                f"{self.model.name} is built on: it {problem}."
            )
        return model


def _choice(foundation: Foundation) -> PluginChoice:
    return plugin_choice("depth_models", {"name": foundation.name, **foundation.settings}, foundation.name)


def chosen_trainee(settings: Settings) -> Trainee:
    """The model that the configuration chooses, with the objective that it asks for."""
    return Trainee(settings, settings.model, settings.objective, settings.run.pose)


def train(
    settings: Settings,
    trainee: Trainee,
    training: TrainingSettings,
    dataset: Path,
    run: RunFolder,
    active: ActiveCollectionSettings | None = None,
) -> DepthModel:
    """Train a model from scratch, or take it from the run folder if it is there already.

    Args:
        settings: the run's.
        trainee: the model.
        training: budget and learning rate.
        dataset: frames to train on.
        run: takes `model.safetensors`, checkpoints, logs and the training curve.
        active: when the model explores during its training; None for never.

    Returns:
        The trained model, in eval mode.
    """
    path = run.path / MODEL_FILE
    if path.exists():
        say(f"  trained before: {path}")
        return load_model(path)
    model = trainee.make()
    validation = [viewpoint_dataset(settings, "validation")] if settings.splits.validation else []
    callbacks = [*(bars := training_bar()), *([PanelLogger()] if validation else [])]
    if active is not None:
        callbacks.append(active_collection(settings, active, trainee.model, run, validation, bars))
    fit(
        model,
        training,
        [dataset],
        validation,
        run.path,
        objective=trainee.objective,
        pose=trainee.pose,
        seed=settings.seed,
        metrics=DepthMetrics(settings.camera.min_depth, settings.camera.max_depth) if validation else None,
        trainer_arguments={"enable_progress_bar": bool(training_bar()), **settings.trainer},
        callbacks=callbacks,
    )
    model = model.cpu()
    if leads():
        save_figure(draw_training_curve(run.logs), run.figures / "training.png")
        if active is not None:
            show_rounds(run, active)
        save_model(path, model, trainee.model.name, trainee.model.settings)  # last: it says that training is done
    wait_for_all()
    return model


def train_once(settings: Settings, trainee: Trainee, training: TrainingSettings, dataset: Path, kind: str) -> Path:
    """Train a model that is kept in `outputs/<kind>` for every run that asks for the same; return its file."""
    identity = {
        "model": {"name": trainee.model.name, **trainee.model.settings},
        "objective": dict(trainee.objective),
        "pose": trainee.pose,
        "training": asdict(training),
        "dataset": dataset.name,
        "random_seed": settings.seed,
        "foundation": trainee.foundation and weights_identity(trainee.foundation),
    }
    folder = settings.outputs / kind / f"{trainee.model.name}-{short_hash(identity)}"
    # Processes that train together come here together; the leading one holds the lock for all.
    with locked(folder.with_name(f".{folder.name}.lock")) if leads() else nullcontext():
        if (folder / MODEL_FILE).exists():
            say(f"  trained before: {folder}")
        else:
            train(settings, trainee, training, dataset, RunFolder(folder, identity))
    return folder / MODEL_FILE
