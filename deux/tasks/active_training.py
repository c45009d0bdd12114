"""Training of the final model with its callbacks, including rounds of active collection."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deux.callbacks import ACTIVE_COLLECTION, check_monitor, make_callback
from deux.collection.collect_settings import FRAMES_OF_A_TRIPLET
from deux.collection.explored_map import mean_uncertainty
from deux.collection.pipeline import frame_count
from deux.contracts import DepthModel, DepthPredictor, Reader
from deux.deployment.model_files import MODEL_FILE, load_model, save_model
from deux.errors import check_range, counted
from deux.inference.precision import FastPredictor
from deux.io.atomic import make_folder, write_json
from deux.io.json_files import read_record
from deux.io.layout import sequences
from deux.io.locking import locked
from deux.metrics.explored_places import measure_explored_places
from deux.options import construct
from deux.registry import PluginChoice
from deux.task_sections import Sections
from deux.tasks.checkpoints import weights_identity
from deux.tasks.console import say
from deux.tasks.datasets import Datasets, check_robot
from deux.tasks.model_training import Recipe, Training
from deux.tasks.run_folder import ROUNDS, RunFolder
from deux.training.objective import make_objective
from deux.training.ranks import decided_by_leader, leads
from deux.training.rounds import RankResult, Round, RoundRequest, RoundSettings, check_reloading

if TYPE_CHECKING:
    from lightning import Callback

_ROUNDS_FILE = "rounds.json"


@dataclass(frozen=True)
class ActiveCollectionSettings(RoundSettings):
    """Options of `callbacks=[active_collection]`: when the model collects frames during its training, and how many.

    Args:
        steps: actions per episode.
        episodes: episodes per round and training scene.
    """

    steps: int = 50
    episodes: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("callbacks.active_collection.steps", self.steps, FRAMES_OF_A_TRIPLET)
        check_range("callbacks.active_collection.episodes", self.episodes, 1)


class ActiveTraining:
    """Trains the final model with the callbacks of the configuration.

    Args:
        sections: configuration; reads `callbacks`, `explore` and `trainer`.
        datasets: datasets of the run.
        training: trains the model.

    Raises:
        DeuxError: a callback is unknown, or one of its options is wrong.
    """

    def __init__(self, sections: Sections, datasets: Datasets, training: Training) -> None:
        chosen = dict(sections.plain("callbacks"))
        active = chosen.pop(ACTIVE_COLLECTION, None)
        self.active: ActiveCollectionSettings | None = None
        if active is not None:
            self.active = construct(ActiveCollectionSettings, active, f"callbacks.{ACTIVE_COLLECTION}")
        self._callbacks = {name: make_callback(name, options) for name, options in chosen.items()}
        self._explorer = sections.plugin("explore")
        self._datasets = datasets
        self._training = training
        self._trainer: dict[str, Any] = sections.plain("trainer")
        if self.active is not None:
            check_robot(self._explorer, f"callbacks={ACTIVE_COLLECTION}")
            check_reloading(self._trainer.get("reload_dataloaders_every_n_epochs", 1))
        recorded = "training_data" in sections.names and sections.plain("training_data")
        self._check_callbacks(bool(recorded or datasets.scenes.validation))

    def train(self, data: Reader, run: RunFolder, validation: Sequence[Reader] | None = None) -> DepthModel:
        """Train the configured model; the arguments are those of `Training.train`.

        Raises:
            DeuxError: a callback monitors a quantity that is not logged, since there are no validation frames.
        """
        recipe = self._training.recipe
        if validation is not None:
            self._check_callbacks(bool(validation))
        if self.active is None or decided_by_leader((run.path / MODEL_FILE).exists):
            return self._training.train(recipe, data, run, validation, [*self._callbacks.values()])
        validation = self._training.validation_readers() if validation is None else validation
        callback = self._collection(self.active, recipe, run, validation)
        model = self._training.train(recipe, data, run, validation, [callback, *self._callbacks.values()])
        if leads():
            _show_rounds(run, self.active)
        return model

    def _check_callbacks(self, validated: bool) -> None:
        """Check before training what Lightning would only report in the middle of it.

        Args:
            validated: whether there are validation frames.
        """
        if not self._callbacks:
            return
        from deux.metrics.depth_errors import METRICS  # slow import, like Lightning, which the callbacks need anyway
        from deux.training.module import logged_quantities
        from deux.training.weight_averaging import check_one_mean

        recipe = self._training.recipe
        check_one_mean(recipe.training.averaging, [*self._callbacks.values()])
        objective = make_objective(recipe.outline(), recipe.objective, recipe.supervised)
        validated = validated and self._trainer.get("limit_val_batches") != 0
        quantities = logged_quantities(objective, METRICS, validated)
        for name, callback in self._callbacks.items():
            check_monitor(name, callback, quantities)

    def _collection(
        self, active: ActiveCollectionSettings, recipe: Recipe, run: RunFolder, validation: Sequence[Reader]
    ) -> "Callback":
        from deux.training.active_collection import ActiveCollection  # imports Lightning, which takes seconds

        folder = run.path / ROUNDS
        make_folder(folder)
        collector = RoundCollector(
            self._datasets, active, self._explorer, recipe, folder, validation, self._training.seed
        )

        def collect(request: RoundRequest) -> RankResult:
            say(
                f"Round {request.number} of {active.rounds}: {self._explorer.name} explores after "
                f"{counted(request.step, 'step')}"
            )
            return collector(request)

        def report(rounds: Sequence[Round]) -> None:
            write_json(folder / _ROUNDS_FILE, [asdict(completed) for completed in rounds])
            _draw(rounds, run)
            say(f"  {_summary_line(rounds[-1])}")

        return ActiveCollection(active, folder, collect, report)


class RoundCollector:
    """Collects one process's share of a round, deterministically from the weights saved at the start of the round.

    Args:
        datasets: datasets of the run.
        active: options of the rounds.
        explorer: the explorer.
        recipe: recipe of the model that is being trained.
        folder: output folder of the datasets and of each round's weights.
        validation: frames on which the model is evaluated in each round; may be empty.
        seed: seed of the run.
    """

    def __init__(
        self,
        datasets: Datasets,
        active: ActiveCollectionSettings,
        explorer: PluginChoice,
        recipe: Recipe,
        folder: Path,
        validation: Sequence[Reader],
        seed: int,
    ) -> None:
        self.recipe, self.folder = recipe, folder
        self._datasets, self._active, self._explorer = datasets, active, explorer
        self._validation, self._seed = validation, seed

    def __call__(self, request: RoundRequest) -> RankResult:
        """Explore this process's scenes, and evaluate the model if this is the first process."""
        name = f"round{request.number:02d}"
        weights = self._save_once(request, self.folder / f"{name}.safetensors")
        device = next(request.model.parameters()).device
        predict = FastPredictor(load_model(weights), device.type, request.precision)
        mae = self._validation_error(predict) if request.rank == 0 else None
        scenes = self._datasets.scenes.train[request.rank :: request.world_size]
        if not scenes:
            return RankResult(None)
        changes = {
            "name": name,
            "scenes": scenes,
            "steps": self._active.steps,
            "episodes": self._active.episodes,
            "seed": self._seed + request.number * 2**32,  # differs from every seed that a user can set
        }
        identity = f"{weights_identity(weights)} in {request.precision}"
        dataset = self._datasets.explored_in_round(self._explorer, predict, identity, self.folder, changes)
        simulation = self._datasets.simulation
        return RankResult(
            dataset=dataset,
            frames=frame_count(dataset, self.recipe.source_choice()),
            area=measure_explored_places(dataset, simulation.camera, simulation.robot).area,
            uncertainty=mean_uncertainty(sequences(dataset)),
            mae=mae,
        )

    def _save_once(self, request: RoundRequest, file: Path) -> Path:
        """Save the current weights for this round, unless an earlier attempt has done so.

        A resumed run repeats an epoch before the round, which on a GPU need not give bit-identical weights. With the
        weights of the first attempt, the frames collected until then remain valid.
        """
        with locked(self.folder / ".lock.json", f"saves the weights of {file.stem}"):
            if not file.exists():
                save_model(file, request.model, self.recipe.model.name, self.recipe.model.settings)
        return file

    def _validation_error(self, predict: DepthPredictor) -> float | None:
        if not self._validation:
            return None
        from deux.data.datamodule import TripletDataModule  # imports Lightning, which takes seconds
        from deux.metrics.mean_errors import DepthErrors

        training, camera = self.recipe.training, self._datasets.simulation.camera
        data = TripletDataModule(
            self.recipe.model.create(),
            validation=self._validation,
            batch_size=training.batch_size,
            crop=training.crop,
            sources=False,
            poses=False,
        )
        metrics = DepthErrors(camera.min_depth, camera.max_depth, alone=True)
        for batch in data.val_dataloader():
            assert batch.ground_truth is not None
            depth = predict(batch.image, batch.sparse_depth, batch.intrinsics)
            metrics.update(depth.float().cpu(), batch.ground_truth)
        mae = float(metrics.compute()["mae"])
        return mae if math.isfinite(mae) else None


def read_rounds(run: RunFolder) -> list[Round]:
    """The completed rounds of a run; empty if there are none."""
    file = run.path / ROUNDS / _ROUNDS_FILE
    return list(read_record(file, list[Round])) if file.exists() else []


def _show_rounds(run: RunFolder, active: ActiveCollectionSettings) -> None:
    """Draw the rounds once the training is over, and report if there were fewer than configured."""
    rounds = read_rounds(run)
    if rounds:
        _draw(rounds, run)
    if len(rounds) < active.rounds:
        say(
            f"  {len(rounds)} of callbacks.{ACTIVE_COLLECTION}.rounds={active.rounds} rounds took place: rounds take "
            f"place at the end of epochs, and the training ended first. Train for longer, or lower "
            f"callbacks.{ACTIVE_COLLECTION}.every."
        )


def _draw(rounds: Sequence[Round], run: RunFolder) -> None:
    from deux.figures.drawing import save_figure  # imports matplotlib, which is slow
    from deux.figures.training_curves import draw_rounds

    save_figure(draw_rounds(rounds, run.logs), run.figures / "rounds.png")


def _summary_line(completed: Round) -> str:
    parts = [counted(completed.frames, "frame"), f"{completed.area:.1f} m² seen"]
    parts += [f"uncertainty {completed.uncertainty:.4f}"] if completed.uncertainty is not None else []
    parts += [f"validation MAE {completed.mae:.1f} mm"] if completed.mae is not None else []
    return f"Round {completed.round}: {', '.join(parts)}"
