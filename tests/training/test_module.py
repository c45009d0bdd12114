import io
from contextlib import ExitStack, contextmanager

import pytest
import torch
from lightning.pytorch import Callback
from lightning.pytorch.plugins import MixedPrecision

from deux.contracts import LossTerm, Prediction
from deux.errors import DeuxError
from deux.metrics.depth_errors import METRICS
from deux.metrics.mean_errors import DepthErrors
from deux.registry import registry
from deux.testing.host_waits import HostWait, refuse_host_waits
from deux.testing.losses import perfect_sample
from deux.training.health import HealthCheck
from deux.training.module import DepthCompletion, logged_quantities
from deux.training.objective import Objective, make_objective
from deux.training.pose_source import make_pose_source
from deux.training.schedule import Schedule

# Lightning 2.6 uses what newer PyTorch releases deprecate.
pytestmark = [
    pytest.mark.filterwarnings(r"ignore:.isinstance\(treespec, LeafSpec\):FutureWarning"),
    pytest.mark.filterwarnings(r"ignore:Found \d+ module\(s\) in eval mode"),
]

FAST = Schedule(3e-3, boundaries=(0.8,), factors=(0.1,))


@pytest.fixture
def make_module(small_model):
    def make(pose="simulator", **arguments):
        torch.manual_seed(0)
        model = small_model()
        objective = make_objective(model)
        return DepthCompletion(model, objective, make_pose_source(pose, model), **{"schedule": FAST} | arguments)

    return make


def depth_error(module):
    batch = perfect_sample().batch
    with torch.no_grad():
        return float((module(batch).depth - batch.ground_truth).abs().mean())


@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
def test_training_without_ground_truth_finds_the_depth(make_module, fit, precision):
    batch = perfect_sample().batch
    batch.ground_truth = torch.full_like(batch.sparse_depth, torch.nan)  # whoever reads it ruins the loss
    module = make_module()
    before = depth_error(module)
    fit(module, batch, copies=60, max_steps=60, precision=precision)
    assert before > 0.5
    assert depth_error(module) < 0.2 * before


def test_learned_poses_train_with_the_model(make_module, fit):
    module = make_module(pose="learned")
    before = [parameter.detach().clone() for parameter in module.pose_source.parameters()]
    fit(module, perfect_sample().batch, copies=2, max_steps=2)
    assert before
    assert all(not torch.equal(x, y) for x, y in zip(before, module.pose_source.parameters(), strict=True))


def test_what_is_logged(make_module, fit):
    metrics = DepthErrors()
    module = make_module(metrics=metrics)
    trainer = fit(module, perfect_sample().batch, copies=2, max_epochs=1, limit_val_batches=1.0)
    terms = ["loss", "photometric_error", *type(module.model).objective]
    expected = {f"{stage}/{name}" for stage in ("train", "validation") for name in terms}
    expected |= {"train/learning_rate", *(f"validation/{name}" for name in ("mae", "rmse", "imae", "irmse"))}
    assert set(trainer.callback_metrics) == expected
    assert set(logged_quantities(module.objective, METRICS, validated=True)) == expected
    logged = logged_quantities(module.objective, METRICS, validated=False)
    assert set(logged) == {name for name in expected if name.startswith("train/")}
    assert float(trainer.callback_metrics["validation/mae"]) == pytest.approx(1000 * depth_error(module), rel=1e-3)
    assert not metrics.update_called


def test_frames_without_ground_truth_validate_without_metrics(make_module, fit):
    batch = perfect_sample().batch
    batch.ground_truth = None
    trainer = fit(make_module(metrics=DepthErrors()), batch, copies=1, max_epochs=1, limit_val_batches=1.0)
    assert "validation/loss" in trainer.callback_metrics
    assert "validation/mae" not in trainer.callback_metrics


@pytest.fixture
def rates(make_module, fit):
    """The learning rate of each batch, as (epoch, rate), of a run in epochs of so many batches."""

    def run(schedule, copies, **arguments):
        module, found = make_module(schedule=schedule), []
        step = module.training_step

        def recorded_step(batch, batch_idx):
            found.append((module.current_epoch, module.trainer.optimizers[0].param_groups[0]["lr"]))
            return step(batch, batch_idx)

        module.training_step = recorded_step
        fit(module, perfect_sample(1, 16, 16).batch, copies, **arguments)
        return found

    return run


def test_the_learning_rate_follows_the_schedule(rates):
    found = rates(Schedule(1e-3, boundaries=(0.5,), factors=(0.1,), warmup_steps=1), 6, max_steps=6)
    assert [rate for _, rate in found] == pytest.approx([5e-4, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4])


# Boundaries and rates as published: VOICED on KITTI to epochs 18, 24, 30; KBNet on VOID 1e-4 for 10 of 15 epochs.
PUBLISHED = {
    "voiced on kitti": (Schedule(1.2e-4, (18, 24), (0.5, 0.25), "epoch"), [1.2e-4] * 18 + [6e-5] * 6 + [3e-5] * 6),
    "kbnet on void": (Schedule(1e-4, (10,), (0.5,), "epoch"), [1e-4] * 10 + [5e-5] * 5),
}


@pytest.mark.parametrize("accumulate", [1, 2])
@pytest.mark.parametrize("name", PUBLISHED)
def test_an_epoch_that_reaches_a_boundary_has_the_new_rate_from_its_first_step(rates, name, accumulate):
    schedule, published = PUBLISHED[name]
    found = rates(schedule, 3, max_epochs=len(published), accumulate_grad_batches=accumulate)
    assert found == [(epoch, pytest.approx(rate)) for epoch, rate in enumerate(published) for _ in range(3)]


def test_outliers_leave_the_validity(make_module):
    batch = perfect_sample().batch
    batch.sparse_depth[0, 0, 4, 6] = 9.0  # two pixels from a point at two metres
    batch.validity[0, 0, 4, 6] = 1.0
    cleaned = make_module().on_after_batch_transfer(batch, 0)
    assert cleaned.validity[0, 0, 4, 6] == 0
    assert cleaned.validity.sum() == batch.validity.sum() - 1


def test_the_network_sees_the_thinned_points_and_the_losses_all(make_module):
    module, batch = make_module(), perfect_sample().batch
    batch.input_sparse_depth = torch.zeros_like(batch.sparse_depth)
    seen = []
    module.model.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[1]))
    prediction = module(batch)
    assert not seen[0].any()
    expected = (prediction.depth - batch.sparse_depth).abs()[batch.validity > 0].mean()
    torch.testing.assert_close(module.objective(batch, prediction).terms["sparse_depth"], expected.detach())


def test_frozen_parameters_are_not_optimised(make_module, fit):
    module = make_module()
    module.model.layers[0].requires_grad_(False)
    before = module.model.layers[0].weight.clone()
    fit(module, perfect_sample().batch, copies=2, max_steps=2)
    assert torch.equal(before, module.model.layers[0].weight)


def test_state_is_plain_tensors(make_module):
    buffer = io.BytesIO()
    torch.save(make_module(metrics=DepthErrors()).state_dict(), buffer)
    buffer.seek(0)
    assert all(name.startswith("model.") for name in torch.load(buffer, weights_only=True))


class Watched(Callback):
    """Lets a check look at the steps from the second to the one before last, and at all that lies between them."""

    def __init__(self, check, steps):
        self.check, self.steps, self.seen = check, steps, ExitStack()

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        if batch_idx == 1:
            self.seen.enter_context(self.check())
        if batch_idx == self.steps - 1:
            self.seen.close()

    def on_exception(self, trainer, pl_module, exception):
        self.seen.close()


@contextmanager
def on_a_card():
    torch.cuda.set_sync_debug_mode("error")
    try:
        yield
    finally:
        torch.cuda.set_sync_debug_mode("default")


COMBINATIONS = [(name, pose) for name in registry().names("depth_models") for pose in ("simulator", "learned")]
QUICK = [("kbnet", "learned"), ("fusionnet", "simulator")]
"""Those of every run of the tests; the others take minutes and are slow."""


def watched_steps(fit, prepared_sample, name, pose, check, copies=5, model=None, cuda_graphs=False, **arguments):
    """Trains a registered model with logging, clipping and health checks, watched by `check`."""
    torch.manual_seed(0)
    model = model or registry().create("depth_models", name, {})
    if pose == "learned" and model.pose_network() is None:
        pytest.skip(f"{name} has no pose network")
    batch = prepared_sample(model, 32, 64)
    poses, errors = make_pose_source(pose, model), DepthErrors()
    module = DepthCompletion(model, make_objective(model), poses, metrics=errors, cuda_graphs=cuda_graphs)
    watched = Watched(check, copies)
    arguments = {"precision": "bf16-mixed", "gradient_clip_val": 1.0} | arguments
    fit(module, batch, copies, max_steps=copies, callbacks=[watched, HealthCheck(every=2)], **arguments)


@pytest.mark.parametrize(
    ("name", "pose"),
    [pytest.param(*pair, marks=() if pair in QUICK else pytest.mark.slow) for pair in COMBINATIONS],
)
def test_no_step_waits_for_the_device(fit, prepared_sample, name, pose):
    watched_steps(fit, prepared_sample, name, pose, refuse_host_waits)


def test_a_step_that_waits_is_found(fit, prepared_sample, small_model):
    class Careless(small_model):
        def forward(self, image, *inputs, **prepared):
            assert image.mean().item() > 0
            return super().forward(image, *inputs, **prepared)

    with pytest.raises(HostWait, match="reads values"):
        watched_steps(fit, prepared_sample, None, "simulator", refuse_host_waits, model=Careless())


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("cuda_graphs", [True, False])
@pytest.mark.parametrize(("name", "pose"), COMBINATIONS)
def test_no_step_waits_for_a_card(fit, prepared_sample, name, pose, cuda_graphs):
    watched_steps(fit, prepared_sample, name, pose, on_a_card, accelerator="gpu", devices=1, cuda_graphs=cuda_graphs)


@pytest.mark.parametrize("clip", [{}, {"gradient_clip_val": 1e-3}])
@pytest.mark.parametrize("scaled", [False, True])
def test_adam_is_fused_unless_a_scaler_and_clipping_meet(make_module, fit, clip, scaled):
    scaler = torch.amp.GradScaler("cpu", init_scale=1.0) if scaled else None
    plugin = MixedPrecision("16-mixed" if scaled else "bf16-mixed", "cpu", scaler)
    trainer = fit(make_module(), perfect_sample(1, 16, 16).batch, 1, max_steps=1, plugins=[plugin], **clip)
    assert trainer.optimizers[0].defaults["fused"] is not (scaled and bool(clip))


@pytest.mark.parametrize("scaled", [False, True])
def test_adam_averages_as_configured(make_module, fit, scaled):
    scaler = torch.amp.GradScaler("cpu", init_scale=1.0) if scaled else None
    plugin = MixedPrecision("16-mixed" if scaled else "bf16-mixed", "cpu", scaler)
    arguments = {"max_steps": 1, "plugins": [plugin], "gradient_clip_val": 1.0}
    trainer = fit(make_module(betas=(0.8, 0.95)), perfect_sample(1, 16, 16).batch, 1, **arguments)
    assert trainer.optimizers[0].param_groups[0]["betas"] == (0.8, 0.95)


def unlearnable(model, change):
    """A copy of the small model's class whose depth is changed."""

    class Unlearnable(model):
        def forward(self, *inputs, **prepared):
            return change(self, super().forward(*inputs, **prepared))

    return Unlearnable()


def test_a_model_without_weights_is_reported(small_model, fit):
    model = small_model()
    model.requires_grad_(False)
    module = DepthCompletion(model, make_objective(model), schedule=FAST)
    with pytest.raises(DeuxError, match=r"^the depth model SmallModel has no trainable parameters: a model"):
        fit(module, perfect_sample().batch, copies=1, max_steps=1)


def test_a_loss_without_a_gradient_is_reported_with_its_cause(small_model, fit):
    model = unlearnable(small_model, lambda model, found: Prediction(found.depth.detach()))
    module = DepthCompletion(model, make_objective(model), schedule=FAST)
    with pytest.raises(
        DeuxError, match=r"^the loss of the depth model Unlearnable has no gradient, .*its depth has none"
    ):
        fit(module, perfect_sample().batch, copies=1, max_steps=1)

    class Constant(LossTerm):
        def __call__(self, inputs):
            return inputs.batch.sparse_depth.mean()

    model = small_model()
    module = DepthCompletion(model, Objective({"constant": (1.0, Constant())}, (0.1, 10.0)), schedule=FAST)
    with pytest.raises(
        DeuxError, match=r"SmallModel has no gradient, .* none of the loss terms \(constant\) has one alt"
    ):
        fit(module, perfect_sample().batch, copies=1, max_steps=1)
