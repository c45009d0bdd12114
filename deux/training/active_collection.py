"""Active collection: the model explores during training, and continues to train with the frames that it collects."""

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
"""Collects this process's part of a round. Called again after a kill, it reuses finished episodes: equal results."""

Report = Callable[[Sequence[Round]], None]
"""Called with all rounds so far after each new one, in the leading process only."""


class ActiveCollection(Callback):
    """At the end of some epochs, collects frames with the current model, and adds them to the training data.

    Checkpoints contain the completed rounds, so that a resumed training uses exactly the frames of an uninterrupted
    one. If several processes train together, each explores some of the scenes; then all read the same datasets.

    Args:
        settings: when to collect, and how to use the frames.
        folder: folder of the rounds' datasets.
        collect: collects this process's part of a round.
        report: called after each round.

    Raises:
        DeuxError: at the start of the training, if the trainer would not read new frames; on resuming, if a round's
            frames are missing.
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
        """Remember the datasets that the training begins with."""
        self._initial = list(_data(trainer).train)
        check_reloading(getattr(trainer, "reload_dataloaders_every_n_epochs", 0))

    def state_dict(self) -> dict[str, Any]:
        """The completed rounds as plain values."""
        return {"rounds": [asdict(one) for one in self.rounds]}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the completed rounds of a checkpoint."""
        self.rounds = [Round(**one) for one in state_dict["rounds"]]

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Add the frames of the restored rounds to the training data."""
        lost = [folder for one in self.rounds for name in one.datasets if not (folder := self.folder / name).is_dir()]
        if lost:
            raise DeuxError(
                f"{lost[0]} is missing, whose frames the training used: delete its run folder to begin anew."
            )
        self._set_training_data(trainer)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Collect a round if one is due; the checkpoint of this epoch is written afterwards."""
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
        """Set the datasets that the data module reads from the next epoch on."""
        replace = self.settings.mode == "replace"
        rounds = self.rounds[-1:] if replace else self.rounds
        found: list[Reader] = [DatasetReader(self.folder / name) for one in rounds for name in one.datasets]
        _data(trainer).train = found if rounds and replace else [*self._initial, *found]


def _data(trainer: Trainer) -> TripletDataModule:
    data = trainer.datamodule  # type: ignore[attr-defined]
    assert isinstance(data, TripletDataModule)
    return data


def _progress(trainer: Trainer) -> tuple[int, float]:
    """Finished epochs, including the one that is ending, and the fraction of the training that is done."""
    return trainer.current_epoch + 1, training_progress(trainer).fraction


def _clear_progress_bar(trainer: Trainer) -> None:
    """Remove the trainer's progress bar during collection; Lightning draws a new one in the next epoch."""
    bar = trainer.progress_bar_callback
    if isinstance(bar, RichProgressBar) and bar.progress is not None:
        bar.progress.stop()


def _log(trainer: Trainer, found: Round) -> None:
    known = {name: value for name, value in found.summary().items() if value is not None and name != "step"}
    for logger in trainer.loggers:
        logger.log_metrics({f"rounds/{name}": float(value) for name, value in known.items()}, found.step)
