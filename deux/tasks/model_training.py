"""The training stage: a newly made model on one dataset, laid on its foundation where it is built on one."""

import logging
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deux.configuration import in_sweep
from deux.contracts import DepthModel, Foundation, Reader
from deux.data.cache_choice import cache_choice
from deux.data.dataset_reader import DatasetReader
from deux.deployment.model_files import MODEL_FILE, load_model, load_weights, save_model, weights_file
from deux.errors import DeuxError, check_range
from deux.inference.precision import FastPredictor
from deux.inference.weightless import without_weights
from deux.io.layout import SourceChoice
from deux.io.locking import locked
from deux.registry import PluginChoice, registry
from deux.task_sections import MEANS, Sections
from deux.tasks.checkpoints import check_foundation, load_named_model, load_start, named_path, weights_identity
from deux.tasks.console import quieten_trainer, say, watched
from deux.tasks.datasets import Datasets
from deux.tasks.recorded_frames import Needs
from deux.tasks.run_folder import RunFolder, open_run_folder, short_hash
from deux.training.objective import make_objective
from deux.training.pose_source import PoseKind, make_pose_source
from deux.training.ranks import decided_by_leader, leads, starts_the_command_again, wait_for_all
from deux.training.training_settings import TrainingSettings

if TYPE_CHECKING:
    from lightning import Callback

_WITHOUT_EFFECT = (*MEANS["training"], "validations")
"""Options of `training` that the trained weights do not depend on."""

_ALWAYS_TAKEN: dict[str, tuple[Any, ...]] = {"accelerator": ("auto", "cpu"), "devices": (1,)}
"""Values of `trainer` that Lightning takes on every machine: it need not be imported to check them."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Recipe:
    """What a depth model is and how it is trained.

    Args:
        model: the depth model with its options.
        objective: loss terms that override the model's own.
        pose: where relative poses come from.
        training: budget and learning rate.
    """

    model: PluginChoice
    objective: Mapping[str, Any]
    pose: PoseKind
    training: TrainingSettings

    def check(self) -> None:
        """Make once, without memory and time, what only the training needs.

        Raises:
            DeuxError: an option of the model, a loss term or the pose source is wrong.
        """
        with without_weights():
            model = self.model.create()
            make_objective(model, self.objective, self.supervised)
            make_pose_source(self.pose, model)

    def outline(self) -> DepthModel:
        """The model without memory for its weights."""
        with without_weights():
            model: DepthModel = self.model.create()
        return model

    @property
    def supervised(self) -> bool:
        """Whether the objective may read ground truth."""
        return self.outline().supervised or self.training.supervised

    def source_choice(self) -> SourceChoice:
        """How source frames are chosen; "recent" where the objective compares no frames."""
        return self.training.sources if self.needs().sources else "recent"

    def needs(self) -> Needs:
        """What the training reads of its frames."""
        compares = make_objective(self.outline(), self.objective, self.supervised).needs_reconstructions
        truth = self.supervised or self.training.augmentation.draws_points
        return Needs(sources=compares, poses=compares and self.pose == "simulator", ground_truth=truth)


@dataclass(frozen=True)
class FoundationSettings:
    """The supervised model that the chosen one is built on, where it is built on one.

    Args:
        checkpoint: a trained model to take; None trains one.
        source: source of the scenes, none of them the experiment's own, in whose frames it is trained.
        scenes: number of these scenes.
        viewpoints: frames of each scene.
        steps: optimiser steps of its training.
        batch_size: samples in a batch.

    Raises:
        DeuxError: a value is out of its range.
    """

    checkpoint: str | None
    source: str
    scenes: int
    viewpoints: int
    steps: int
    batch_size: int

    def __post_init__(self) -> None:
        for name in ("scenes", "viewpoints", "steps", "batch_size"):
            check_range(f"foundation.{name}", getattr(self, name), 1)


class Training:
    """Trains depth models.

    Args:
        sections: of these it reads `model`, `objective`, `pose`, `training`, `trainer`, `foundation` and `data.cache`.
        datasets: of the run.
        validation_viewpoints: validation frames of each validation scene.

    Raises:
        DeuxError: an option is wrong.
    """

    def __init__(self, sections: Sections, datasets: Datasets, validation_viewpoints: int) -> None:
        self.recipe = Recipe(
            sections.plugin("model"),
            sections.plain("objective"),
            sections.plain("pose"),
            sections.read("training", TrainingSettings),
        )
        self.seed = sections.seed
        self._cache = cache_choice(sections.data_cache)
        self._trainer: dict[str, Any] = sections.plain("trainer")
        self._foundation = sections.read("foundation", FoundationSettings)
        self._datasets = datasets
        self._validation_viewpoints = validation_viewpoints
        self._outputs = sections.outputs
        self._check()

    def predictor(self, model: DepthModel) -> FastPredictor:
        """The model on the trainer's kind of device, for a robot that waits for its depth."""
        return FastPredictor(model, self._trainer.get("accelerator", "auto"))

    def validation_readers(self) -> list[Reader]:
        """Free viewpoints of the validation scenes; none without such scenes."""
        if not self._datasets.scenes.validation:
            return []
        return [DatasetReader(self._datasets.viewpoints("validation", self._validation_viewpoints))]

    def train(
        self,
        recipe: Recipe,
        data: Reader,
        run: RunFolder,
        validation: Sequence[Reader] | None = None,
        callbacks: "Sequence[Callback]" = (),
    ) -> DepthModel:
        """Train a model, or take it from the run folder if it is there already.

        Args:
            recipe: the model and how it is trained.
            data: frames to train on.
            run: takes `model.safetensors`, checkpoints, logs and the training curve.
            validation: frames to validate on; None for `validation_readers`.
            callbacks: further callbacks.

        Returns:
            The trained model, in eval mode.
        """
        path = run.path / MODEL_FILE
        if decided_by_leader(path.exists):
            say(f"  trained before: {path}")
            return load_model(path)
        # Lightning, torchmetrics and matplotlib take seconds to import, which no task waits for before it trains.
        from deux.figures.drawing import save_figure
        from deux.figures.panel_logger import PanelLogger
        from deux.figures.training_curves import draw_training_curve
        from deux.metrics.mean_errors import DepthErrors
        from deux.tasks.training_display import training_display
        from deux.training.fit import fit

        quieten_trainer()
        model = self._make(recipe)
        validation = self.validation_readers() if validation is None else validation
        camera = self._datasets.simulation.camera
        bar = watched() and self._trainer.get("enable_progress_bar", True)
        fit(
            model,
            recipe.training,
            [data],
            validation,
            run.path,
            objective=recipe.objective,
            pose=recipe.pose,
            seed=self.seed,
            metrics=DepthErrors(camera.min_depth, camera.max_depth) if validation else None,
            trainer_arguments={"enable_progress_bar": bar, **self._trainer},
            callbacks=[training_display(bar), *([PanelLogger()] if validation else []), *callbacks],
            cache=self._cache,
        )
        model = model.cpu()
        if leads():
            save_figure(draw_training_curve(run.logs), run.figures / "training.png")
            save_model(path, model, recipe.model.name, recipe.model.settings)  # last: it says that training is done
        wait_for_all()
        return model

    def train_once(self, recipe: Recipe, dataset: Path, kind: str) -> Path:
        """Train a model that is kept in `outputs/<kind>` for every run that asks for the same; return its file.

        It starts from scratch: `training.start` is the final model's.
        """
        recipe = replace(recipe, training=replace(recipe.training, start=None))
        foundation = self._foundation_file(recipe)
        identity = {
            "model": recipe.model.description,
            "objective": dict(recipe.objective),
            "pose": recipe.pose,
            "training": {k: v for k, v in asdict(recipe.training).items() if k not in _WITHOUT_EFFECT},
            "trainer": self._trainer,
            "dataset": dataset.name,
            "seed": self.seed,
            "foundation": foundation and weights_identity(foundation),
        }
        folder = self._outputs / kind / f"{recipe.model.name}-{short_hash(identity)}"
        # Processes that train together come here together; the leading one holds the lock for all.
        lock = locked(folder.with_name(f".{folder.name}.lock.json"), f"trains {kind}/{folder.name}")
        with lock if leads() else nullcontext():
            if decided_by_leader((folder / MODEL_FILE).exists):
                say(f"  trained before: {folder}")
            else:
                with open_run_folder(folder, identity) as run:
                    log.info("training %s", folder)
                    self.train(recipe, DatasetReader(dataset), run)
        return folder / MODEL_FILE

    def _make(self, recipe: Recipe) -> DepthModel:
        """Make the model that is to be trained: as it starts, or untrained on its trained foundation."""
        from lightning import seed_everything  # slow

        start = recipe.training.start
        path = self._foundation_file(recipe) if start is None else None
        seed_everything(self.seed, workers=True, verbose=False)
        model: DepthModel = recipe.model.create()
        if start is not None:
            say(f"  starting from {start}")
            load_weights(model, load_start(recipe.model, start).state_dict())
            return model
        foundation = model.foundation()
        if path is None or foundation is None:
            return model
        name, trained = load_named_model(_choice(foundation), str(path))
        if problem := load_weights(foundation.module, trained.state_dict()):
            raise DeuxError(
                f"foundation.checkpoint={path} is a {name} that does not fit the {foundation.name} that "
                f"{recipe.model.name} is built on: it {problem}."
            )
        return model

    def _foundation_file(self, recipe: Recipe) -> Path | None:
        """The trained model that another one is built on; None if it stands alone.

        It is `foundation.checkpoint` if that is given. Otherwise it is trained when it is first asked for, with ground
        truth and its own objective, on frames of generated scenes that are none of the run's, as the published
        ScaffNet is on synthetic data: the ground truth of what the robot explores reaches no unsupervised model.
        """
        with without_weights():
            foundation = recipe.model.create().foundation()
        if foundation is None:
            return None
        chosen = self._foundation
        if chosen.checkpoint is not None:
            check_foundation(_choice(foundation), recipe.model.name, chosen.checkpoint)
            return weights_file(named_path(chosen.checkpoint))
        say(
            f"  {recipe.model.name} is built on {foundation.name}, which learns from synthetic scenes first "
            f"({chosen.scenes} of foundation.source={chosen.source}); foundation.checkpoint= takes a trained one"
        )
        camera = self._datasets.simulation.camera
        # The crop of recorded frames may be larger than the frames of these scenes.
        height, width = recipe.training.crop or (camera.height, camera.width)
        crop = recipe.training.crop and (min(height, camera.height), min(width, camera.width))
        training = replace(recipe.training, steps=chosen.steps, batch_size=chosen.batch_size, crop=crop)
        below = Recipe(_choice(foundation), {}, "simulator", training)
        return self.train_once(
            below, self._datasets.synthetic(chosen.source, chosen.scenes, chosen.viewpoints), "foundations"
        )

    def _check(self) -> None:
        """Find what is wrong before any work is done."""
        self.recipe.check()
        if self.recipe.training.start is not None:
            load_start(self.recipe.model, self.recipe.training.start)
        if self._foundation.checkpoint is not None:
            weights_file(named_path(self._foundation.checkpoint))
            foundation = self.recipe.outline().foundation()
            if foundation is not None and self.recipe.training.start is None:  # which has one inside already
                check_foundation(_choice(foundation), self.recipe.model.name, self._foundation.checkpoint)
        if self._trainer.keys() <= _ALWAYS_TAKEN.keys() and all(
            value in _ALWAYS_TAKEN[name] for name, value in self._trainer.items()
        ):
            return
        from deux.training.fit import check_trainer  # slow

        quieten_trainer()
        trainer = check_trainer(self.recipe.training, self._trainer)
        if in_sweep() and starts_the_command_again(trainer):
            raise DeuxError(
                f"a sweep (-m) with trainer.devices={trainer.num_devices} would start the whole sweep again in every "
                "process: give each job one device, or run the jobs one by one without -m."
            )


def _choice(foundation: Foundation) -> PluginChoice:
    return registry().choose("depth_models", {"name": foundation.name, **foundation.settings}, foundation.name)
