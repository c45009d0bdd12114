"""Active collection in a run: where the rounds' frames are kept, how they are judged and what is shown of them."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from lightning import Callback
from torch import Tensor

from deux.collection.explored_map import mean_uncertainty, seen_area
from deux.collection.pipeline import read_manifest
from deux.contracts import DepthPredictor
from deux.data.datamodule import TripletDataModule
from deux.deployment.model_files import load_model, save_model
from deux.figures.drawing import save_figure
from deux.figures.round_curve import draw_rounds
from deux.io.atomic import make_folder, write_json
from deux.io.layout import sequences
from deux.io.locking import locked
from deux.metrics.depth_errors import DepthMetrics
from deux.tasks.console import say, stop_bars
from deux.tasks.datasets import round_dataset
from deux.tasks.given import weights_identity
from deux.tasks.run_folder import ROUNDS, RunFolder
from deux.tasks.sections import ActiveCollectionSettings
from deux.tasks.settings import PluginChoice, Settings
from deux.training.active_collection import ActiveCollection
from deux.training.rounds import Round, RoundRequest, Share

_ROUNDS_FILE = "rounds.json"


class RoundCollector:
    """Collects a process's share of a round; a deterministic function of the weights that first began the round.

    Args:
        settings: the run's.
        chosen: how much is explored.
        model: the model that is being trained, by name and options.
        folder: takes the datasets, and each round's weights as a model file.
        validation: datasets on which the exploring model is judged; may be none.
    """

    def __init__(
        self,
        settings: Settings,
        chosen: ActiveCollectionSettings,
        model: PluginChoice,
        folder: Path,
        validation: Sequence[Path],
    ) -> None:
        self.settings, self.chosen, self.model = settings, chosen, model
        self.folder, self.validation = folder, validation

    def __call__(self, request: RoundRequest) -> Share:
        """Explore this process's scenes, and judge the model if this is the first process."""
        name = f"round{request.number:02d}"
        weights = self._kept(request, self.folder / f"{name}.safetensors")
        model = load_model(weights).to(next(request.model.parameters()).device)

        def predict(image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
            with request.context():
                return model.predict(image, sparse_depth, intrinsics)

        mae = self._validation_error(predict) if request.share == 0 else None
        scenes = self.settings.splits.train[request.share :: request.shares]
        if not scenes:
            return Share(None)
        changes = {
            "scenes": scenes,
            "steps": self.chosen.steps,
            "episodes": self.chosen.episodes,
            "seed": self.settings.seed + request.number * 2**32,  # no seed that a user can give
        }
        identity = f"{weights_identity(weights)} in {request.precision}"
        dataset = round_dataset(self.settings, self.folder, name, changes, predict, identity)
        found = sequences(dataset)
        return Share(
            dataset=dataset,
            frames=read_manifest(dataset)["triplets"],
            area=sum(seen_area(sequence, self.settings.camera, self.settings.robot) for sequence in found),
            uncertainty=mean_uncertainty(found),
            mae=mae,
        )

    def _kept(self, request: RoundRequest, file: Path) -> Path:
        """The file of the weights that explore in this round: those with which it was begun first.

        A killed run comes back here by training an epoch again, which on a GPU need not give the same weights to the
        last bit. What had been collected until then stays good.
        """
        with locked(self.folder / ".lock"):
            if not file.exists():
                save_model(file, request.model, self.model.name, self.model.settings)
        return file

    def _validation_error(self, predict: DepthPredictor) -> float | None:
        if not self.validation:
            return None
        training, camera = self.settings.training, self.settings.camera
        data = TripletDataModule(
            self.model.create(), validation=self.validation, batch_size=training.batch_size, crop=training.crop
        )
        metrics = DepthMetrics(camera.min_depth, camera.max_depth, alone=True)
        for batch in data.val_dataloader():
            assert batch.ground_truth is not None
            depth = predict(batch.image, batch.sparse_depth, batch.intrinsics)
            metrics.update(depth.float().cpu(), batch.ground_truth)
        return float(metrics.compute()["mae"])


def active_collection(
    settings: Settings,
    chosen: ActiveCollectionSettings,
    model: PluginChoice,
    run: RunFolder,
    validation: Sequence[Path],
    bars: Sequence[Callback] = (),
) -> ActiveCollection:
    """The callback that keeps its frames in the run folder and shows each round.

    Args:
        settings: the run's.
        chosen: when and how much is explored.
        model: the model that is trained, by name and options.
        run: takes the rounds, their figure and `rounds.json`.
        validation: datasets on which the exploring model is judged; may be none.
        bars: the training's progress bars, which give way to those of the exploration.
    """
    folder = run.path / ROUNDS
    make_folder(folder)
    collector = RoundCollector(settings, chosen, model, folder, validation)

    def collect(request: RoundRequest) -> Share:
        stop_bars(bars)
        say(f"Round {request.number} of {chosen.rounds}: {settings.explorer.name} explores after {request.step} steps")
        return collector(request)

    def report(rounds: Sequence[Round]) -> None:
        write_json(folder / _ROUNDS_FILE, [asdict(one) for one in rounds])
        save_figure(draw_rounds(rounds, run.logs), run.figures / "rounds.png")
        say(f"  {_line(rounds[-1])}")

    return ActiveCollection(chosen, folder, collect, report)


def show_rounds(run: RunFolder, chosen: ActiveCollectionSettings) -> None:
    """When the training is over: draw the rounds once more, and say so if there were fewer than asked for."""
    rounds = read_rounds(run)
    if rounds:
        save_figure(draw_rounds(rounds, run.logs), run.figures / "rounds.png")
    if len(rounds) < chosen.rounds:
        say(
            f"  {len(rounds)} of callbacks.rounds={chosen.rounds} rounds took place: they come at the end of epochs, "
            "and the training was over before. Train for longer, or lower callbacks.every."
        )


def read_rounds(run: RunFolder) -> list[Round]:
    """The rounds of a run; none if it has none."""
    file = run.path / ROUNDS / _ROUNDS_FILE
    return [Round(**one) for one in json.loads(file.read_text())] if file.exists() else []


def _line(found: Round) -> str:
    known = [f"{found.frames} frames", f"{found.area:.1f} m² seen"]
    known += [f"uncertainty {found.uncertainty:.4f}"] if found.uncertainty is not None else []
    known += [f"validation MAE {found.mae:.1f} mm"] if found.mae is not None else []
    return f"Round {found.round}: {', '.join(known)}"
