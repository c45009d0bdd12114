"""Active collection: while a model trains, it explores again and again, and goes on with the frames that it finds."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.utilities.seed import isolate_rng
from torch import nn

from deux.contracts import DepthModel, Reader
from deux.data.datamodule import TripletDataModule
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.training.module import DepthCompletion
from deux.training.rounds import Round, RoundRequest, RoundSettings, Share, together

Collect = Callable[[RoundRequest], Share]
"""Collects this process's share of a round. Asked again after a crash, it takes what it finds and ends alike."""

Report = Callable[[Sequence[Round]], None]
"""Told all rounds so far whenever there is a new one, in the leading process only."""


class ActiveCollection(Callback):
    """Lets the model that is being trained explore again, and trains on with what it finds.

    The rounds that were completed are part of the checkpoints, so that a resumed run has exactly the frames of an
    unbroken one. Under several processes each explores its share of the scenes; all wait for all and then read the same
    list of datasets.

    Args:
        settings: when rounds come and what becomes of their frames.
        folder: of the rounds' datasets.
        collect: collects a round.
        report: is told of each round.

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
        self._first: list[Reader] = []

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Keep the list of datasets that the training begins with."""
        self._first = list(_data(trainer).train)
        epochs = getattr(trainer, "reload_dataloaders_every_n_epochs", 0)
        if epochs != 1:
            raise DeuxError(
                f"trainer.reload_dataloaders_every_n_epochs={epochs} would pass over frames that are collected during "
                "the training: with callbacks=active_collection it has to be 1."
            )

    def state_dict(self) -> dict[str, Any]:
        """The rounds as plain values."""
        return {"rounds": [asdict(one) for one in self.rounds]}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take up the rounds of a checkpoint."""
        self.rounds = [Round(**one) for one in state_dict["rounds"]]

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Give a resumed training the frames of its rounds.

        Only now, when the optimiser is made: where the schedule is measured in epochs it looks at the number of frames,
        and must see those that the training began with.
        """
        lost = [folder for one in self.rounds for name in one.datasets if not (folder := self.folder / name).is_dir()]
        if lost:
            raise DeuxError(
                f"{lost[0]} is missing, on which the training went on: delete its run folder to begin anew."
            )
        self._hand_over(trainer)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Explore if it is time; the checkpoint of this epoch is written after it."""
        assert isinstance(pl_module, DepthCompletion)
        if not trainer.should_stop and self.settings.due(len(self.rounds) + 1, *_progress(trainer)):
            self.rounds.append(self._round(trainer, pl_module.model))
            self._hand_over(trainer)
            if trainer.is_global_zero:
                _log(trainer, self.rounds[-1])
                self._report(self.rounds)

    def _round(self, trainer: Trainer, model: DepthModel) -> Round:
        request = RoundRequest(
            number=len(self.rounds) + 1,
            step=trainer.global_step,
            model=model,
            precision=str(trainer.precision),
            context=trainer.precision_plugin.forward_context,
            share=trainer.global_rank,
            shares=trainer.world_size,
        )
        with isolate_rng(), _evaluating(model):
            mine = self._collect(request)
        trainer.strategy.barrier("active collection")
        shares = [trainer.strategy.broadcast(mine, src=rank) for rank in range(trainer.world_size)]
        return together(request, shares, self.folder)

    def _hand_over(self, trainer: Trainer) -> None:
        """Tell the data module what to train on from the next epoch on."""
        rounds = self.rounds[-1:] if self.settings.mode == "replace" else self.rounds
        found = [DatasetReader(self.folder / name) for one in rounds for name in one.datasets]
        _data(trainer).train = found if rounds and self.settings.mode == "replace" else [*self._first, *found]


def _data(trainer: Trainer) -> TripletDataModule:
    data = trainer.datamodule  # type: ignore[attr-defined]
    assert isinstance(data, TripletDataModule)
    return data


def _progress(trainer: Trainer) -> tuple[int, float]:
    """Epochs that are done, the one that is ending included, and the fraction of the training."""
    epochs = trainer.current_epoch + 1
    limits = ((trainer.global_step, trainer.max_steps), (epochs, trainer.max_epochs))
    return epochs, max(done / limit if limit and limit > 0 else 0.0 for done, limit in limits)


@contextmanager
def _evaluating(model: nn.Module) -> Iterator[None]:
    """Put a model into eval mode and each of its parts back into its own: a frozen one may be in eval mode anyway."""
    modes = {module: module.training for module in model.modules()}
    model.eval()
    try:
        yield
    finally:
        for module, training in modes.items():
            module.training = training


def _log(trainer: Trainer, found: Round) -> None:
    known = {name: value for name, value in found.summary().items() if value is not None and name != "step"}
    for logger in trainer.loggers:
        logger.log_metrics({f"rounds/{name}": float(value) for name, value in known.items()}, found.step)
