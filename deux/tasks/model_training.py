"""The training stage: trains a model on one dataset, after its foundation if it is built on one."""

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
from deux.tasks.checkpoints import check_foundation, load_named_model, load_start, model_path, weights_identity
from deux.tasks.console import is_interactive, quieten_trainer, say
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
"""Options of `training` that do not affect the trained weights."""

_ALWAYS_VALID: dict[str, tuple[Any, ...]] = {"accelerator": ("auto", "cpu"), "devices": (1,)}
"""Values of `trainer` that are valid on every machine, so that Lightning need not be imported to check them."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Recipe:
    """A depth model and the settings of its training.

    Args:
        model: the depth model with its options.
        objective: loss terms that override the model's own.
        pose: source of the relative poses.
        training: options of the training.
    """

    model: PluginChoice
    objective: Mapping[str, Any]
    pose: PoseKind
    training: TrainingSettings

    def check(self) -> None:
        """Check the options by constructing model, objective and pose source without allocating weights.

        Raises:
            DeuxError: an option of the model, a loss term or the pose source is wrong.
        """
        with without_weights():
            model = self.model.create()
            make_objective(model, self.objective, self.supervised)
            make_pose_source(self.pose, model)

    def outline(self) -> DepthModel:
        """The model, without allocating its weights."""
        with without_weights():
            model: DepthModel = self.model.create()
        return model

    @property
    def supervised(self) -> bool:
        """Whether the objective may use ground truth."""
        return self.outline().supervised or self.training.supervised

    def source_choice(self) -> SourceChoice:
        """How source frames are chosen; "recent" if the objective uses no source frames."""
        return self.training.sources if self.needs().sources else "recent"

    def needs(self) -> Needs:
        """What the training reads of its frames besides image, sparse points and intrinsics."""
        compares = make_objective(self.outline(), self.objective, self.supervised).needs_reconstructions
        truth = self.supervised or self.training.augmentation.draws_points
        return Needs(sources=compares, poses=compares and self.pose == "simulator", ground_truth=truth)


@dataclass(frozen=True)
class FoundationSettings:
    """Options of the foundation, the supervised model that some depth models are built on.

    Args:
        checkpoint: a trained model to use; None trains one.
        source: scene source of the training scenes, which are not among the experiment's.
        scenes: number of training scenes.
        viewpoints: frames per scene.
        steps: optimiser steps.
        batch_size: samples per batch.

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
        sections: configuration; reads `model`, `objective`, `pose`, `training`, `trainer`, `foundation` and
            `data.cache`.
        datasets: datasets of the run.
        validation_viewpoints: validation frames per validation scene.

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
        """The model on the trainer's device, for fast inference during exploration."""
        return FastPredictor(model, self._trainer.get("accelerator", "auto"))

    def validation_readers(self) -> list[Reader]:
        """Readers of free viewpoints of the validation scenes; empty without validation scenes."""
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
        """Train a model, or load it if the run folder already contains it.

        Args:
            recipe: the model and the settings of its training.
            data: training frames.
            run: output folder of `model.safetensors`, checkpoints, logs and the training curve.
            validation: validation frames; None for `validation_readers`.
            callbacks: further callbacks.

        Returns:
            The trained model, in eval mode.
        """
        path = run.path / MODEL_FILE
        if decided_by_leader(path.exists):
            say(f"  trained before: {path}")
            return load_model(path)
        # Slow imports: Lightning, torchmetrics and matplotlib.
        from deux.figures.drawing import save_figure
        from deux.figures.panel_logger import PanelLogger
        from deux.figures.training_curves import draw_training_curve
        from deux.metrics.mean_errors import DepthErrors
        from deux.tasks.training_display import training_display
        from deux.training.fit import fit

        quieten_trainer()
        model = self._make_model(recipe)
        validation = self.validation_readers() if validation is None else validation
        camera = self._datasets.simulation.camera
        bar = is_interactive() and self._trainer.get("enable_progress_bar", True)
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
            save_model(path, model, recipe.model.name, recipe.model.settings)  # last: it marks the training as done
        wait_for_all()
        return model

    def train_once(self, recipe: Recipe, dataset: Path, kind: str) -> Path:
        """Train a model in `outputs/<kind>`, where all runs with the same settings share it; returns its file.

        It is trained from scratch: `training.start` applies to the final model only.
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
        # Of several processes that train together, rank 0 holds the lock for all.
        lock = locked(folder.with_name(f".{folder.name}.lock.json"), f"trains {kind}/{folder.name}")
        with lock if leads() else nullcontext():
            if decided_by_leader((folder / MODEL_FILE).exists):
                say(f"  trained before: {folder}")
            else:
                with open_run_folder(folder, identity) as run:
                    log.info("training %s", folder)
                    self.train(recipe, DatasetReader(dataset), run)
        return folder / MODEL_FILE

    def _make_model(self, recipe: Recipe) -> DepthModel:
        """Create the model to be trained, with the weights of `training.start` or of its foundation."""
        from lightning import seed_everything  # slow import

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
        name, trained = load_named_model(_plugin_choice(foundation), str(path))
        if problem := load_weights(foundation.module, trained.state_dict()):
            raise DeuxError(
                f"foundation.checkpoint={path} is a {name} that does not fit the {foundation.name} that "
                f"{recipe.model.name} is built on: it {problem}."
            )
        return model

    def _foundation_file(self, recipe: Recipe) -> Path | None:
        """The file of the trained foundation; None for models without one.

        This is `foundation.checkpoint` if it is set. Otherwise the foundation is trained on first use, with its own
        objective and ground truth of generated scenes that are not among the experiment's, like the published ScaffNet
        on synthetic data. Thus, ground truth of the explored scenes does not reach an unsupervised model.
        """
        with without_weights():
            foundation = recipe.model.create().foundation()
        if foundation is None:
            return None
        settings = self._foundation
        choice = _plugin_choice(foundation)
        if settings.checkpoint is not None:
            check_foundation(choice, recipe.model.name, settings.checkpoint)
            return weights_file(model_path(settings.checkpoint))
        say(
            f"  {recipe.model.name} is built on {foundation.name}, which is trained on synthetic scenes first "
            f"({settings.scenes} of foundation.source={settings.source}); set foundation.checkpoint= to use a trained "
            "one"
        )
        camera = self._datasets.simulation.camera
        # The crop of recorded frames may be larger than the rendered frames.
        height, width = recipe.training.crop or (camera.height, camera.width)
        crop = recipe.training.crop and (min(height, camera.height), min(width, camera.width))
        training = replace(recipe.training, steps=settings.steps, batch_size=settings.batch_size, crop=crop)
        frames = self._datasets.synthetic(settings.source, settings.scenes, settings.viewpoints)
        return self.train_once(Recipe(choice, {}, "simulator", training), frames, "foundations")

    def _check(self) -> None:
        """Check the options before any work is done."""
        self.recipe.check()
        if self.recipe.training.start is not None:
            load_start(self.recipe.model, self.recipe.training.start)
        if self._foundation.checkpoint is not None:
            weights_file(model_path(self._foundation.checkpoint))
            foundation = self.recipe.outline().foundation()
            if foundation is not None and self.recipe.training.start is None:  # a start contains its foundation
                check_foundation(_plugin_choice(foundation), self.recipe.model.name, self._foundation.checkpoint)
        if all(value in _ALWAYS_VALID.get(name, ()) for name, value in self._trainer.items()):
            return
        from deux.training.fit import check_trainer  # slow import

        quieten_trainer()
        trainer = check_trainer(self.recipe.training, self._trainer)
        if in_sweep() and starts_the_command_again(trainer):
            raise DeuxError(
                f"a sweep (-m) with trainer.devices={trainer.num_devices} would start the whole sweep again in every "
                "process: give each job one device, or run the jobs one by one without -m."
            )


def _plugin_choice(foundation: Foundation) -> PluginChoice:
    return registry().choose("depth_models", {"name": foundation.name, **foundation.settings}, foundation.name)
