"""Active collection: the model explores while it trains, and trains on with the frames that it finds."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import RichProgressBar
from lightning.pytorch.utilities.seed import isolate_rng

from deux.contracts import DepthModel, Reader
from deux.data.datamodule import TripletDataModule
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.inference.prediction import eval_mode
from deux.training.module import DepthCompletion
from deux.training.rounds import RankResult, Round, RoundRequest, RoundSettings, check_reloading, merge_results
from deux.training.training_progress import training_progress

Collect = Callable[[RoundRequest], RankResult]
"""Collects this process's part of a round. Called again after a kill, it takes what is complete and gives the same."""

Report = Callable[[Sequence[Round]], None]
"""Called with all rounds so far whenever there is a new one, in the leading process only."""


class ActiveCollection(Callback):
    """Collects frames with the model that is being trained at the end of some epochs, and trains on with them.

    The complete rounds are part of the checkpoints, so that a resumed run has exactly the frames of an unbroken one.
    Where several processes train together, each explores its part of the scenes; all wait for each other and then read
    the same list of datasets.

    Args:
        settings: when rounds come and what becomes of their frames.
        folder: of the rounds' datasets.
        collect: collects this process's part of a round.
        report: is called after each round.

    Raises:
        DeuxError: at the start of the training, if the trainer would not read new frames; on resume, if a round's
            frames are gone.
    """

    def __init__(
        self, settings: RoundSettings, folder: Path, collect: Collect, report: Report = lambda rounds: None
    ) -> None:
        self.settings = settings
        self.folder = folder
        self.rounds: list[Round] = []
        self._collect, self._report = collect, report
        self._initial: list[Reader] = []

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Keep the list of datasets that the training begins with."""
        self._initial = list(_data(trainer).train)
        check_reloading(getattr(trainer, "reload_dataloaders_every_n_epochs", 0))

    def state_dict(self) -> dict[str, Any]:
        """The complete rounds as plain values."""
        return {"rounds": [asdict(one) for one in self.rounds]}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the complete rounds of a checkpoint."""
        self.rounds = [Round(**one) for one in state_dict["rounds"]]

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Add the frames of the restored rounds to the training data."""
        lost = [folder for one in self.rounds for name in one.datasets if not (folder := self.folder / name).is_dir()]
        if lost:
            raise DeuxError(
                f"{lost[0]} is missing, whose frames the training went on with: delete its run folder to begin anew."
            )
        self._set_training_data(trainer)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Collect a round if it is time; the checkpoint of this epoch is written after it."""
        assert isinstance(pl_module, DepthCompletion)
        if not trainer.should_stop and self.settings.due(len(self.rounds) + 1, *_progress(trainer)):
            self.rounds.append(self._round(trainer, pl_module.model))
            self._set_training_data(trainer)
            if trainer.is_global_zero:
                _log(trainer, self.rounds[-1])
                self._report(self.rounds)

    def _round(self, trainer: Trainer, model: DepthModel) -> Round:
        request = RoundRequest(
            number=len(self.rounds) + 1,
            step=trainer.global_step,
            model=model,
            precision=str(trainer.precision),
            rank=trainer.global_rank,
            world_size=trainer.world_size,
        )
        _clear_progress_bar(trainer)
        with isolate_rng(), eval_mode(model):
            result = self._collect(request)
        trainer.strategy.barrier("active collection")
        results = [trainer.strategy.broadcast(result, src=rank) for rank in range(trainer.world_size)]
        return merge_results(request, results, self.folder)

    def _set_training_data(self, trainer: Trainer) -> None:
        """Set what the data module reads from the next epoch on."""
        replace = self.settings.mode == "replace"
        rounds = self.rounds[-1:] if replace else self.rounds
        found: list[Reader] = [DatasetReader(self.folder / name) for one in rounds for name in one.datasets]
        _data(trainer).train = found if rounds and replace else [*self._initial, *found]


def _data(trainer: Trainer) -> TripletDataModule:
    data = trainer.datamodule  # type: ignore[attr-defined]
    assert isinstance(data, TripletDataModule)
    return data


def _progress(trainer: Trainer) -> tuple[int, float]:
    """Epochs that are done, the one that is ending included, and the fraction of the training."""
    done, steps = training_progress(trainer)
    return trainer.current_epoch + 1, done / steps


def _clear_progress_bar(trainer: Trainer) -> None:
    """Take the trainer's bar from the screen while the robots explore; Lightning draws a new one in the next epoch."""
    bar = trainer.progress_bar_callback
    if isinstance(bar, RichProgressBar) and bar.progress is not None:
        bar.progress.stop()


def _log(trainer: Trainer, found: Round) -> None:
    known = {name: value for name, value in found.summary().items() if value is not None and name != "step"}
    for logger in trainer.loggers:
        logger.log_metrics({f"rounds/{name}": float(value) for name, value in known.items()}, found.step)
