import os

import pytest
import torch
from lightning.pytorch import Callback

from deux.evaluation.metrics import DepthMetrics
from deux.testing.losses import perfect_sample
from deux.training.checkpointing import resume_checkpoints, resume_point
from deux.training.health import HealthCheck
from deux.training.module import DepthCompletion
from deux.training.objective import make_objective
from deux.training.schedule import Schedule

# Lightning 2.6 uses what newer PyTorch releases deprecate.
pytestmark = pytest.mark.filterwarnings(r"ignore:.isinstance\(treespec, LeafSpec\):FutureWarning")


class LossRecorder(Callback):
    def __init__(self):
        self.losses = []

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        self.losses.append(float(outputs["loss"]))


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
            metrics=DepthMetrics(),
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
