from contextlib import nullcontext

import pytest
import torch
from lightning.pytorch import Callback
from lightning.pytorch.callbacks import EMAWeightAveraging, WeightAveraging

from deux.errors import DeuxError
from deux.testing.losses import perfect_sample
from deux.training.checkpointing import resume_checkpoints, resume_point
from deux.training.health import HealthCheck
from deux.training.module import DepthCompletion
from deux.training.network_precision import network_precision
from deux.training.objective import make_objective
from deux.training.weight_averaging import TailAveraging, check_one_mean

pytestmark = [
    # Lightning 2.6 uses what newer PyTorch releases deprecate.
    pytest.mark.filterwarnings(r"ignore:.isinstance\(treespec, LeafSpec\):FutureWarning"),
    # What `deux.tasks.console` silences, too.
    pytest.mark.filterwarnings("ignore:Found 1 module.s. in eval mode"),
    pytest.mark.filterwarnings("ignore:You have overridden `on_after_batch_transfer`"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers"),
    pytest.mark.filterwarnings("ignore:.*is smaller than the logging interval"),
    pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty"),
]


class Killed(Exception):
    pass


class Weights(Callback):
    """The weights after each step; the training is killed before one or asked to end after one."""

    def __init__(self, kill_at=None, stop_at=None):
        self.after, self.kill_at, self.stop_at = [], kill_at, stop_at

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        if trainer.global_step == self.kill_at:
            raise Killed

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        self.after.append(flat(pl_module.model))
        if trainer.global_step == self.stop_at:
            trainer.should_stop = True


def flat(model) -> torch.Tensor:
    return torch.cat([weight.detach().double().flatten() for weight in model.parameters()]).clone()


@pytest.fixture
def train(small_model, fit, tmp_path):
    """Ten steps in epochs of three; returns the weights after each step, and those of the trained model."""

    def run(fraction, kill_at=None, stop_at=None, resume=False, **arguments):
        torch.manual_seed(5 if resume else 0)
        model, weights = small_model(), Weights(kill_at, stop_at)
        averaging = [TailAveraging(fraction)] if fraction else []
        with nullcontext() if kill_at is None else pytest.raises(Killed):
            fit(
                DepthCompletion(model, make_objective(model)),
                perfect_sample().batch,
                copies=3,
                checkpoint=resume_point(tmp_path) if resume else None,
                **{"max_steps": 10} | arguments,
                reload_dataloaders_every_n_epochs=1,
                callbacks=[weights, HealthCheck(), *averaging, *resume_checkpoints(tmp_path, minutes=10.0)],
                enable_checkpointing=True,
            )
        return weights.after, flat(model)

    return run


@pytest.mark.parametrize(("fraction", "first"), [(0.4, 6), (1.0, 0), (0.01, 9)])
def test_the_model_is_the_mean_of_the_last_steps(train, fraction, first):
    after, model = train(fraction)
    torch.testing.assert_close(model, torch.stack(after[first:]).mean(dim=0), rtol=1e-5, atol=1e-7)


def test_the_training_itself_is_not_changed_by_it_nor_by_validations(train):
    with_it, model = train(0.4, limit_val_batches=1, val_check_interval=2, check_val_every_n_epoch=None)
    without, last = train(0.0)
    assert all(torch.equal(one, other) for one, other in zip(with_it, without, strict=True))
    assert not torch.equal(model, last)


@pytest.mark.parametrize("kill_at", [4, 8])
def test_a_training_that_was_killed_ends_with_the_same_mean(train, tmp_path, kill_at):
    """Killed before and within the last part, which begins with step 6."""
    _, whole = train(0.5)
    for file in tmp_path.glob("*.ckpt"):
        file.unlink()
    train(0.5, kill_at=kill_at)
    after, resumed = train(0.5, resume=True)
    assert 0 < len(after) < 10
    assert torch.equal(resumed, whole)


def test_a_training_that_had_ended_gives_its_mean_again(train):
    """As where the process was killed after the last checkpoint and before the model file was written."""
    _, whole = train(0.5)
    after, resumed = train(0.5, resume=True)
    assert not after
    assert torch.equal(resumed, whole)


def test_a_training_that_is_ended_before_its_last_part_keeps_its_weights(train):
    after, model = train(0.1, stop_at=3)
    assert len(after) < 9
    assert torch.equal(model, after[-1])


def test_steps_of_several_batches_count_once(train):
    after, model = train(0.4, accumulate_grad_batches=2)
    steps = after[1::3], after[2::3]  # after the second and the last batch of each epoch
    last = [weights for both in zip(*steps, strict=True) for weights in both][6:]
    torch.testing.assert_close(model, torch.stack(last).mean(dim=0), rtol=1e-5, atol=1e-7)


def test_two_means_of_the_weights_are_refused():
    ema, plain = EMAWeightAveraging(), WeightAveraging()
    check_one_mean(0.3, [HealthCheck()])
    check_one_mean(0.0, [HealthCheck(), ema])
    with pytest.raises(DeuxError, match=r"^training\.averaging=0\.3 and the callback EMAWeightAveraging both average"):
        check_one_mean(0.3, [ema])
    with pytest.raises(DeuxError, match=r"^the callback EMAWeightAveraging and the callback WeightAveraging .* out\.$"):
        check_one_mean(0.0, [ema, plain])


def test_a_training_without_end_has_no_last_part(train):
    with pytest.raises(DeuxError, match=r"training\.averaging=0\.2 is the last part .* has no end"):
        train(0.2, max_steps=-1, max_epochs=-1, max_time="00:00:00:01")


@pytest.mark.parametrize("precision", ["bf16-true", "64-true"])
def test_other_precisions_of_the_network_are_averaged_in_float32(train, precision):
    after, model = train(0.4, plugins=[network_precision(precision)])
    mean = torch.stack(after[6:]).mean(dim=0)
    tolerance = 2**-8 if precision == "bf16-true" else 1e-5
    torch.testing.assert_close(model, mean, rtol=tolerance, atol=1e-6)
