"""The final training with its callbacks, and what active collection explores meanwhile."""

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
    """`callbacks=[active_collection]`: when the model explores during its training, and how much.

    Args:
        steps: actions in an episode of a round.
        episodes: episodes of a round in each training scene.
    """

    steps: int = 50
    episodes: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("callbacks.active_collection.steps", self.steps, FRAMES_OF_A_TRIPLET)
        check_range("callbacks.active_collection.episodes", self.episodes, 1)


class ActiveTraining:
    """Trains the final model with the callbacks that the configuration names.

    Args:
        sections: of these it reads `callbacks` and `explore`.
        datasets: of the run.
        training: trains the model.

    Raises:
        DeuxError: there is no such callback, or an option of one is wrong.
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
        given = "training_data" in sections.names and sections.plain("training_data")
        self._check_callbacks(bool(given or datasets.scenes.validation))

    def train(self, data: Reader, run: RunFolder, validation: Sequence[Reader] | None = None) -> DepthModel:
        """Train the configured model; arguments as of `Training.train`.

        Raises:
            DeuxError: a callback watches what is not logged, as there are no frames to validate on.
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
        """Find what Lightning would stumble over in the middle of the training.

        Args:
            validated: whether there are frames to validate on.
        """
        if not self._callbacks:
            return
        from deux.metrics.depth_errors import METRICS  # slow, like Lightning, which the callbacks have brought
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
        from deux.training.active_collection import ActiveCollection  # Lightning's import, seconds, is left to training

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
            write_json(folder / _ROUNDS_FILE, [asdict(one) for one in rounds])
            _draw(rounds, run)
            say(f"  {_line(rounds[-1])}")

        return ActiveCollection(active, folder, collect, report)


class RoundCollector:
    """Collects a process's part of a round; a deterministic function of the weights that first began the round.

    Args:
        datasets: of the run.
        active: how much is explored.
        explorer: that explores.
        recipe: of the model that is being trained.
        folder: takes the datasets, and each round's weights as a model file.
        validation: frames on which the exploring model is judged; may be none.
        seed: of the run.
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
        """Explore this process's scenes, and judge the model if this is the first process."""
        name = f"round{request.number:02d}"
        weights = self._kept(request, self.folder / f"{name}.safetensors")
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
            "seed": self._seed + request.number * 2**32,  # no seed that a user can give
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

    def _kept(self, request: RoundRequest, file: Path) -> Path:
        """The file of the weights that explore in this round: those with which it was begun first.

        A killed run comes back here by training an epoch again, which on a GPU need not give the same weights to the
        last bit. What had been collected until then stays good.
        """
        with locked(self.folder / ".lock.json", f"keeps the weights of {file.stem}"):
            if not file.exists():
                save_model(file, request.model, self.recipe.model.name, self.recipe.model.settings)
        return file

    def _validation_error(self, predict: DepthPredictor) -> float | None:
        if not self._validation:
            return None
        from deux.data.datamodule import TripletDataModule  # as above
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
    """The rounds of a run; none if it has none."""
    file = run.path / ROUNDS / _ROUNDS_FILE
    return list(read_record(file, list[Round])) if file.exists() else []


def _show_rounds(run: RunFolder, active: ActiveCollectionSettings) -> None:
    """When the training is over: draw the rounds once more, and say so if there were fewer than asked for."""
    rounds = read_rounds(run)
    if rounds:
        _draw(rounds, run)
    if len(rounds) < active.rounds:
        say(
            f"  {len(rounds)} of callbacks.{ACTIVE_COLLECTION}.rounds={active.rounds} rounds took place: they come at "
            f"the end of epochs, and the training was over before. Train for longer, or lower "
            f"callbacks.{ACTIVE_COLLECTION}.every."
        )


def _draw(rounds: Sequence[Round], run: RunFolder) -> None:
    from deux.figures.drawing import save_figure  # matplotlib, which nothing waits for before there are rounds to draw
    from deux.figures.training_curves import draw_rounds

    save_figure(draw_rounds(rounds, run.logs), run.figures / "rounds.png")


def _line(found: Round) -> str:
    known = [counted(found.frames, "frame"), f"{found.area:.1f} m² seen"]
    known += [f"uncertainty {found.uncertainty:.4f}"] if found.uncertainty is not None else []
    known += [f"validation MAE {found.mae:.1f} mm"] if found.mae is not None else []
    return f"Round {found.round}: {', '.join(known)}"
