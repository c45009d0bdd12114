import math
import subprocess
import sys

import pytest
import torch
from lightning.pytorch import Callback

from deux.contracts import LossTerm
from deux.errors import DeuxError
from deux.testing.losses import perfect_sample
from deux.training.health import HealthCheck, _mean_of_processes
from deux.training.module import DepthCompletion
from deux.training.objective import make_objective
from deux.training.pose_source import LearnedPoseSource
from deux.training.schedule import Schedule

# Lightning 2.6 uses what newer PyTorch releases deprecate.
pytestmark = pytest.mark.filterwarnings(r"ignore:.isinstance\(treespec, LeafSpec\):FutureWarning")


@pytest.fixture
def train(small_model, fit):
    """Trains a model that begins at a depth of `start` for ten steps under the check."""

    def run(start=3.0, learning_rate=1e-4, batch=None, copies=10, **arguments):
        torch.manual_seed(0)
        model = small_model(start)
        module = DepthCompletion(model, make_objective(model), schedule=Schedule(learning_rate))
        check = HealthCheck(every=1, patience=4)
        fit(module, batch or perfect_sample().batch, copies, **{"max_steps": 10} | arguments, callbacks=[check])

    return run


@pytest.mark.parametrize(("start", "end"), [(1e4, "farthest value \\(10.00 m"), (1e-4, "nearest value \\(0.10 m")])
def test_stuck_predictions_are_noticed_once(train, start, end):
    with pytest.warns(UserWarning, match=f"stuck to its {end}.*lower training.learning_rate") as caught:
        train(start)
    assert sum("stuck" in str(warning.message) for warning in caught) == 1


@pytest.mark.parametrize("copies", [40, 6])  # the last two batches of an epoch of six make a step of their own
def test_steps_count_and_not_the_batches_whose_gradients_are_accumulated(train, copies):
    train(1e4, copies=copies, max_steps=3, accumulate_grad_batches=4)  # twelve or ten batches, and no warning
    with pytest.warns(UserWarning, match=r"for 4 steps, at step 4,"):
        train(1e4, copies=copies, max_steps=4, accumulate_grad_batches=4)


def test_an_ordinary_run_is_left_in_peace(train):
    train()  # warnings are errors in all tests


def test_a_loss_that_is_not_finite_stops_the_run(train):
    batch = perfect_sample().batch
    batch.image[0, 0, 0, 0] = torch.nan
    found = (
        r"training loss is not finite from step 1 on \(loss nan, .* at step 1, learning rate 0\.0001\): no weight had"
    )
    with pytest.raises(DeuxError, match=found):
        train(batch=batch)


class Broken(LossTerm):
    """Not a number from a call on, whatever is predicted."""

    def __init__(self, since=1):
        self.since, self.calls = since, 0

    def __call__(self, inputs):
        self.calls += 1
        return inputs.prediction.depth.mean() * (1.0 if self.calls < self.since else torch.nan)


@pytest.mark.parametrize("steps", [1, 2, 30])
def test_a_loss_term_that_is_not_finite_is_named(small_model, fit, steps):
    model = small_model(3.0)
    objective = make_objective(model)
    objective.terms["broken"], objective.weights["broken"] = Broken(), 1.0
    module = DepthCompletion(model, objective)
    blamed = (
        r"^the training loss is not finite from step 1 on \(loss nan, mean depth \d\.\d+ m at step 1, .*\), while the "
        r"depth and all terms but objective\.broken were finite then: no weight had changed"
    )
    with pytest.raises(DeuxError, match=blamed):
        fit(module, perfect_sample().batch, copies=steps, max_epochs=1, callbacks=[HealthCheck()])


@pytest.mark.parametrize(("every", "seen_at"), [(1, 4), (2, 4), (100, 6)])
def test_the_first_step_and_term_that_are_not_finite_are_named_later(small_model, fit, every, seen_at):
    model = small_model(3.0)
    objective = make_objective(model)
    objective.terms["broken"], objective.weights["broken"] = Broken(since=4), 1.0
    named = (
        rf"^the training loss is not finite from step 4 on .* at step {seen_at}, .*\), while the depth and all terms "
        r"but objective\.broken were finite then: look at what computes it, or lower training\.learning_rate"
    )
    module, batch = DepthCompletion(model, objective), perfect_sample().batch
    with pytest.raises(DeuxError, match=named):
        fit(module, batch, copies=6, max_epochs=1, callbacks=[HealthCheck(every)])


def test_a_loss_of_the_poses_alone_trains_no_depth_and_is_reported(small_model, fit):
    model = small_model(3.0)
    objective = make_objective(model, dict.fromkeys(model.objective) | {"pose_consistency": 1.0})
    module = DepthCompletion(model, objective, LearnedPoseSource(model.pose_network()))
    with pytest.raises(DeuxError, match=r"no gradient, though it has one for the poses: .* \(pose_consistency\) reads"):
        fit(module, perfect_sample().batch, copies=1, max_epochs=1, callbacks=[HealthCheck()])


def test_a_rate_that_is_too_high_is_reported_at_a_later_step(train):
    with pytest.raises(
        DeuxError, match=r"training loss is not finite from step [2-9] on .*\): lower training\.learning_rate"
    ):
        train(learning_rate=1e38, gradient_clip_val=None)


def test_weights_that_are_not_finite_stop_the_run_where_the_loss_stays_finite(small_model, fit):
    model = small_model(3.0)
    module = DepthCompletion(model, make_objective(model), LearnedPoseSource(model.pose_network()))
    with torch.no_grad():
        module.pose_source.network.layer.bias.fill_(torch.nan)
    with pytest.raises(DeuxError, match=r"tensors of weights are not finite at step 1"):
        fit(module, perfect_sample().batch, copies=1, max_epochs=1, callbacks=[HealthCheck()])


class Judged(HealthCheck):
    """Notes the step at which each check is looked at."""

    def __init__(self):
        super().__init__(every=3)
        self.looked = []

    def _finish_check(self, module):
        if self._reading is not None:
            self.looked.append((self._reading.step, module.trainer.global_step))
        super()._finish_check(module)


def test_a_check_is_looked_at_by_the_next_one_or_at_the_end_of_the_epoch(small_model, fit):
    model = small_model()
    check = Judged()
    module = DepthCompletion(model, make_objective(model))
    fit(module, perfect_sample(1, 16, 16).batch, copies=10, max_epochs=1, callbacks=[check])
    assert check.looked == [(1, 1), (3, 6), (6, 9), (9, 10), (10, 10)]


class Save(Callback):
    """Writes a checkpoint after a step."""

    def __init__(self, path, step):
        self.path, self.step = path, step

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        if trainer.global_step == self.step:
            trainer.save_checkpoint(self.path)


class Spoil(Callback):
    """Makes a weight not finite after a step."""

    def __init__(self, step):
        self.step = step

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        if trainer.global_step == self.step:
            with torch.no_grad():
                next(pl_module.parameters()).fill_(torch.nan)


@pytest.mark.parametrize(
    ("every", "spoilt", "message"),
    [
        (2, 1, "training loss is not finite from step 2 on .*: lower"),
        (100, 2, "of weights (is|are) not finite at step 2"),
    ],
)
def test_nothing_broken_is_written(small_model, fit, tmp_path, every, spoilt, message):
    model = small_model()
    callbacks = [Spoil(spoilt), HealthCheck(every), Save(tmp_path / "state.ckpt", step=2)]
    batch = perfect_sample(1, 16, 16).batch
    with pytest.raises(DeuxError, match=message):
        fit(DepthCompletion(model, make_objective(model)), batch, copies=10, max_epochs=1, callbacks=callbacks)
    assert not any(tmp_path.iterdir())


OTHER_PROCESS = """
import sys
import torch
torch.distributed.init_process_group("gloo", init_method=sys.argv[1], rank=1, world_size=2)
for value in (torch.nan, 5.0, 5.0):
    torch.distributed.all_reduce(torch.tensor([1.0, value]))
torch.distributed.destroy_process_group()
"""


def test_what_one_process_finds_all_of_them_find(tmp_path):
    address = f"file://{tmp_path}/meeting"
    other = subprocess.Popen([sys.executable, "-c", OTHER_PROCESS, address])
    torch.distributed.init_process_group("gloo", init_method=address, rank=0, world_size=2)
    try:
        of_the_other = _mean_of_processes(torch.tensor([1.0, 3.0])).tolist()
        of_its_own = _mean_of_processes(torch.tensor([1.0, torch.nan])).tolist()
        of_none = _mean_of_processes(torch.tensor([1.0, 3.0])).tolist()
        assert other.wait(timeout=60) == 0
    finally:
        torch.distributed.destroy_process_group()
        other.kill()
        other.wait()
    assert of_the_other[0] == of_its_own[0] == 1.0
    assert math.isnan(of_the_other[1])
    assert math.isnan(of_its_own[1])
    assert of_none == [1.0, 4.0]
