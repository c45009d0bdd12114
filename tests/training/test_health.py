import pytest
import torch

from deux.errors import DeuxError
from deux.testing.losses import perfect_sample
from deux.training.health import HealthCheck
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
    with pytest.raises(DeuxError, match=r"training loss is nan .* at step 1, learning rate 0\.0001"):
        train(batch=batch)


def test_weights_that_are_not_finite_stop_the_run_where_the_loss_stays_finite(small_model, fit):
    model = small_model(3.0)
    module = DepthCompletion(model, make_objective(model), LearnedPoseSource(model.pose_network()))
    with torch.no_grad():
        module.pose_source.network.layer.bias.fill_(torch.nan)
    with pytest.raises(DeuxError, match=r"tensors of weights are not finite at step 2"):
        fit(module, perfect_sample().batch, copies=2, max_epochs=1, callbacks=[HealthCheck()])
