import os
from contextlib import nullcontext

import pytest
import torch
from lightning.pytorch import Callback

from deux.metrics.depth_errors import DepthErrors
from deux.testing.losses import perfect_sample
from deux.training.checkpointing import resume_checkpoints, resume_point
from deux.training.health import HealthCheck
from deux.training.module import DepthCompletion
from deux.training.objective import make_objective
from deux.training.schedule import Schedule

# Lightning 2.6 uses what newer PyTorch releases deprecate.
pytestmark = pytest.mark.filterwarnings(r"ignore:.isinstance\(treespec, LeafSpec\):FutureWarning")


class LossRecorder(Callback):
    def __init__(self, kill_at=None):
        self.losses = []
        self.places = []
        self.kill_at = kill_at

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        if trainer.global_step == self.kill_at:
            raise Killed
        self.places.append((trainer.current_epoch, batch_idx))

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        self.losses.append(float(outputs["loss"]))


class Killed(Exception):
    pass


@pytest.fixture
def train(small_model, fit):
    """Trains anew or from a checkpoint, up to a number of epochs of two steps; returns the losses of the steps."""

    def run(epochs, folder=None, resume=None):
        torch.manual_seed(len(str(resume)))  # a resumed run owes nothing to how its weights were initialised
        model = small_model()
        module = DepthCompletion(
            model,
            make_objective(model),
            schedule=Schedule(3e-3, boundaries=(3,), factors=(0.5,), unit="epoch", warmup_steps=3),
            metrics=DepthErrors(),
        )
        recorder = LossRecorder()
        callbacks = [recorder, HealthCheck(), *([resume_checkpoints(folder)] if folder else [])]
        fit(
            module,
            perfect_sample().batch,
            copies=2,
            checkpoint=resume,
            max_epochs=epochs,
            callbacks=callbacks,
            enable_checkpointing=bool(folder),
            limit_val_batches=1.0,
        )
        return recorder.losses

    return run


@pytest.fixture
def places(small_model, fit, tmp_path):
    """Trains for so many steps in epochs of three, or until it is killed; returns each step's (epoch, batch)."""

    def run(kill_at=None, **limits):
        recorder, model = LossRecorder(kill_at), small_model()
        with nullcontext() if kill_at is None else pytest.raises(Killed):
            fit(
                DepthCompletion(model, make_objective(model)),
                perfect_sample().batch,
                copies=3,
                checkpoint=resume_point(tmp_path),
                callbacks=[recorder, resume_checkpoints(tmp_path)],
                enable_checkpointing=True,
                reload_dataloaders_every_n_epochs=1,
                **limits,
            )
        return recorder.places

    return run


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
@pytest.mark.parametrize(
    "validation",
    [{}, {"limit_val_batches": 1, "val_check_interval": 2, "check_val_every_n_epoch": None}],
)
@pytest.mark.parametrize(("kill_at", "first"), [(4, 3), (7, 6)])
def test_a_resumed_run_that_counts_steps_leaves_no_batch_of_the_next_epoch_out(places, validation, kill_at, first):
    places(kill_at, max_steps=10, **validation)
    whole = [(step // 3, step % 3) for step in range(10)]
    assert places(max_steps=10, **validation) == whole[first:]


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
def test_a_resumed_run_goes_on_as_if_it_had_not_stopped(train, tmp_path):
    whole = train(epochs=4)
    train(epochs=2, folder=tmp_path)
    checkpoint = resume_point(tmp_path)
    assert checkpoint is not None
    assert train(epochs=4, folder=tmp_path, resume=checkpoint) == whole[4:]


def test_only_the_newest_checkpoint_stays_and_it_loads_without_code(train, tmp_path):
    train(epochs=3, folder=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["epoch=2-step=6.ckpt"]
    assert torch.load(tmp_path / "epoch=2-step=6.ckpt", weights_only=True)["global_step"] == 6


def test_a_damaged_checkpoint_is_passed_over(tmp_path):
    torch.save({"global_step": 1}, tmp_path / "old.ckpt")
    whole = (tmp_path / "old.ckpt").read_bytes()
    (tmp_path / "new.ckpt").write_bytes(whole[: len(whole) // 2])
    os.utime(tmp_path / "old.ckpt", (1, 1))
    with pytest.warns(UserWarning, match=r"new\.ckpt cannot be read"):
        assert resume_point(tmp_path) == tmp_path / "old.ckpt"


def test_no_checkpoint(tmp_path):
    assert resume_point(tmp_path) is None
    assert resume_point(tmp_path / "missing") is None
